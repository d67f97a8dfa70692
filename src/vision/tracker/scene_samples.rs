//! What a recording shows of its box: frames spread over it, as cells, and the picture of the empty box.

use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::segmentation::cells::CellPicture;

/// Number of frames that show the box well: the median of a cell over them is known to a sixth of its noise.
pub const SCENE_FRAMES: usize = 60;

/// Frames of the box, in time order.
#[derive(Clone, Debug, Default)]
pub struct SceneSamples {
    pub(super) frames: Vec<CellPicture>,
    pub(super) empty: Option<CellPicture>,
}

impl SceneSamples {
    /// Adds a frame of the recording.
    pub fn add(&mut self, frame: &Frame<'_>) {
        self.frames.push(CellPicture::of(frame));
    }

    /// Sets the picture of the empty box: of the frames' size, and in any encoding. `encoding` is that of the frames.
    pub fn set_empty(&mut self, picture: &Frame<'_>, encoding: ColourEncoding) {
        self.empty = Some(CellPicture::of(picture).with_encoding(picture.encoding, encoding));
    }
}
