//! A small box with two bare tools, for tests. The tests of the crate `trocar` include this file, too.

use crate::vision::camera::Camera;
use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};
use crate::vision::segmentation::samples::{ColourSample, ColourSamples};
use crate::vision::tracker::{HandSide, Marker, ToolSpec, TrackerSettings};

/// Width and height of the frames, pixels.
pub const SIZE: (u32, u32) = (160, 120);

/// Encoding of the frames.
pub const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };

/// Codes of the box and of the black shafts.
const BOX: [u8; 3] = [150, 128, 128];
const SHAFT: [u8; 3] = [30, 128, 128];

/// Settings for a bare tool on each side.
pub fn two_bare_tools() -> TrackerSettings {
    let camera = Camera {
        width: SIZE.0,
        height: SIZE.1,
        fx: 125.0,
        fy: 125.0,
        cx: 79.5,
        cy: 59.5,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
        focal_sigma: 0.0,
    };
    let sample = |label, yuv| ColourSample { label, rectangle: label as u32, yuv };
    let samples = ColourSamples {
        encoding: ENCODING,
        labels: ["shaft", "background"].map(str::to_owned).to_vec(),
        samples: vec![sample(0, SHAFT), sample(1, BOX)],
        places: Vec::new(),
    };
    let tool = |(name, side): (&str, HandSide)| ToolSpec {
        name: name.to_owned(),
        colour: "shaft".to_owned(),
        side: Some(side),
        diameter_mm: 5.0,
        marker: Marker::Shaft { collar_mm: None, jaw_mm: None },
    };
    let tools = [("left", HandSide::Left), ("right", HandSide::Right)].map(tool);
    TrackerSettings::new(camera, tools.into(), samples)
}

/// A picture of the box without tools.
pub struct EvenPicture([Vec<u8>; 3]);

impl EvenPicture {
    /// All of one colour.
    pub fn of_box() -> Self {
        Self(BOX.map(|code| vec![code; (SIZE.0 * SIZE.1) as usize]))
    }

    /// The same picture as a frame at this time, s.
    pub fn frame(&self, time_s: f64) -> Frame<'_> {
        let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
        let [y, u, v] = self.0.each_ref().map(|data| Plane { data, stride: width, width, height });
        let (shift_x, shift_y, chroma_first_px, encoding) = (0, 0, [0.0; 2], ENCODING);
        Frame { index: 0, time_s, y, u, v, shift_x, shift_y, chroma_first_px, encoding }
    }
}
