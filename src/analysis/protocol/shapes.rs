//! Wire forms of cameras, tools, colours and reports.

use serde::{Deserialize, Serialize};

use super::decode;
use super::placement::FulcrumShape;
use super::rows::ReasonShape;
use crate::domain::files::annotations;
use crate::vision::camera::Camera;
use crate::vision::frame::{ColourEncoding, Matrix, Range};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::segmentation::palette::{ColourSeparation, Margin};
use crate::vision::segmentation::samples::{ColourSample, ColourSamples, MarkedRectangle};
use crate::vision::tracker::{
    Absence, CameraView, DiameterBasis, EffectiveDiameter, Gap, HandSide, LightSample, Quality, ToolQuality, ToolSpec,
};

/// Wire form of [`Camera`]: `width height` and `fx fy cx cy k1 k2 p1 p2 k3`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraShape {
    size: [u32; 2],
    numbers: [f64; 9],
}

impl From<Camera> for CameraShape {
    fn from(c: Camera) -> Self {
        Self { size: [c.width, c.height], numbers: [c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3] }
    }
}

impl From<CameraShape> for Camera {
    fn from(CameraShape { size: [width, height], numbers }: CameraShape) -> Self {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = numbers;
        Self { width, height, fx, fy, cx, cy, k1, k2, p1, p2, k3 }
    }
}

/// Wire form of [`ToolSpec`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToolShape {
    /// The tool's name.
    pub name: String,
    /// Colour of its tape.
    pub colour: String,
    /// Side of the hand that holds it, where it is known.
    pub side: Option<SideShape>,
    /// Outer diameter over the tape, mm.
    pub diameter_mm: f64,
    /// Band length, mm, where known.
    pub band_length_mm: Option<f64>,
}

impl From<ToolShape> for ToolSpec {
    fn from(ToolShape { name, colour, side, diameter_mm, band_length_mm }: ToolShape) -> Self {
        Self { name, colour, side: side.map(HandSide::from), diameter_mm, band_length_mm }
    }
}

/// Wire form of [`HandSide`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SideShape {
    /// Left in the picture.
    Left,
    /// Right in the picture.
    Right,
}

impl From<annotations::Side> for SideShape {
    fn from(side: annotations::Side) -> Self {
        match side {
            annotations::Side::Left => Self::Left,
            annotations::Side::Right => Self::Right,
        }
    }
}

impl From<SideShape> for HandSide {
    fn from(side: SideShape) -> Self {
        match side {
            SideShape::Left => Self::Left,
            SideShape::Right => Self::Right,
        }
    }
}

/// Wire form of [`CameraView`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ViewShape {
    /// From above.
    Top,
    /// From the side.
    Side,
}

impl From<annotations::View> for ViewShape {
    fn from(view: annotations::View) -> Self {
        match view {
            annotations::View::Top => Self::Top,
            annotations::View::Side => Self::Side,
        }
    }
}

impl From<ViewShape> for CameraView {
    fn from(view: ViewShape) -> Self {
        match view {
            ViewShape::Top => Self::Top,
            ViewShape::Side => Self::Side,
        }
    }
}

/// A marked rectangle on a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarkShape {
    /// Decoded frame, from 0.
    pub frame: u64,
    /// Label.
    pub label: String,
    /// First column, first row, columns, rows.
    pub x_y_w_h: [u32; 4],
    /// Rectangles of one frame and label with the same number belong to one mark.
    pub stroke: Option<u32>,
}

impl MarkShape {
    /// The rectangle, for the pipeline.
    pub fn rectangle(&self) -> MarkedRectangle {
        let [x, y, w, h] = self.x_y_w_h.map(|n| n as usize);
        MarkedRectangle { label: self.label.clone(), x, y, w, h }
    }
}

/// Wire form of [`ColourSamples`]; box palettes are stored in it too.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PaletteShape {
    /// Codes span 0–255.
    full_range: bool,
    /// Number of the standard: 601, 709 or 2020.
    matrix: u16,
    /// Labels.
    pub labels: Vec<String>,
    /// Label index and codes of each sample.
    pub samples: Vec<(u32, [u8; 3])>,
    /// How many samples each marked rectangle gave, in order; empty in palettes stored before rectangles were kept.
    rectangles: Vec<u32>,
}

impl From<&ColourSamples> for PaletteShape {
    fn from(palette: &ColourSamples) -> Self {
        let matrix = match palette.encoding.matrix {
            Matrix::Bt601 => 601,
            Matrix::Bt709 => 709,
            Matrix::Bt2020 => 2020,
        };
        Self {
            full_range: palette.encoding.range == Range::Full,
            matrix,
            labels: palette.labels.clone(),
            samples: palette.samples.iter().map(|s| (s.label as u32, s.yuv)).collect(),
            rectangles: palette.samples.chunk_by(|a, b| a.rectangle == b.rectangle).map(|of| of.len() as u32).collect(),
        }
    }
}

impl PaletteShape {
    /// Decodes a stored palette.
    ///
    /// # Errors
    /// The bytes were stored by no version of this program.
    pub fn stored(bytes: &[u8]) -> Result<Self, postcard::Error> {
        let without_rectangles = || decode(&[bytes, &[0]].concat()); // postcard encodes an empty list as one zero byte
        decode(bytes).or_else(|_| without_rectangles())
    }

    /// The samples for the pipeline; `None` if a sample has an unknown label, the rectangles do not add up, or the
    /// matrix is unknown.
    pub fn colour_samples(&self) -> Option<ColourSamples> {
        let matrix = match self.matrix {
            601 => Matrix::Bt601,
            709 => Matrix::Bt709,
            2020 => Matrix::Bt2020,
            _ => return None,
        };
        let range = if self.full_range { Range::Full } else { Range::Limited };
        let sample = |(&(label, yuv), rectangle): (&(u32, [u8; 3]), u32)| {
            ((label as usize) < self.labels.len()).then_some(ColourSample { label: label as usize, rectangle, yuv })
        };
        let samples = self.samples.iter().zip(self.rectangle_of_samples()?).map(sample).collect::<Option<_>>()?;
        Some(ColourSamples { encoding: ColourEncoding { range, matrix }, labels: self.labels.clone(), samples })
    }

    /// The rectangle of each sample; one rectangle per label where rectangles were not stored.
    fn rectangle_of_samples(&self) -> Option<Vec<u32>> {
        if self.rectangles.is_empty() {
            return Some(self.samples.iter().map(|(label, _)| *label).collect());
        }
        let all: u64 = self.rectangles.iter().map(|n| u64::from(*n)).sum();
        let of_each = |(rectangle, n): (u32, &u32)| std::iter::repeat_n(rectangle, *n as usize);
        (all == self.samples.len() as u64).then(|| (0..).zip(&self.rectangles).flat_map(of_each).collect())
    }

    /// Number of samples per label, in the order of the labels.
    pub fn counts(&self) -> Vec<(String, u64)> {
        let count = |label: usize| self.samples.iter().filter(|s| s.0 as usize == label).count() as u64;
        self.labels.iter().enumerate().map(|(i, name)| (name.clone(), count(i))).collect()
    }
}

/// A checkerboard: inner corners and the side of a square.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoardShape {
    /// Inner corners in a row.
    pub columns: u32,
    /// Rows of inner corners.
    pub rows: u32,
    /// Side of a square, mm.
    pub square_mm: f64,
}

/// Wire form of [`Quality`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct QualityShape {
    /// Number of frames.
    pub frames: u64,
    /// Number of frames that were recorded interlaced.
    pub frames_interlaced: u64,
    /// Per tool.
    pub tools: Vec<ToolQualityShape>,
    /// Scene light: time in s, ratio of luma, shift of blue and of red.
    pub light: Vec<[f64; 4]>,
}

/// Wire form of [`ToolQuality`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToolQualityShape {
    /// Numbers of frames on which it was measured, bridged, missing.
    pub observed_predicted_missing: [u64; 3],
    /// How often each reason prevented a measurement.
    pub reasons: Vec<(ReasonShape, u64)>,
    /// RMS distance of border points from the fitted outline, pixels.
    pub border_residual_px: Option<f64>,
    /// Frame-to-frame error of a measured depth, mm: the median standard deviation of its part that does not last.
    pub passing_depth_mm: Option<f64>,
    /// The tape's effective diameter and its standard deviation, mm; true if estimated from this session.
    pub effective_diameter: Option<([f64; 2], bool)>,
    /// First and last frame of each gap, and why the tool was lost; `None` if it had left the view.
    pub gaps: Vec<(u64, u64, Option<ReasonShape>)>,
    /// Distance of its colour from the other tools' and from the background.
    pub colour: [Option<MarginShape>; 2],
    /// Position of its trocar, if known well.
    pub fulcrum: Option<FulcrumShape>,
}

/// Wire form of [`Margin`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarginShape {
    /// Margin and spread, steps.
    pub margin_spread_steps: [f64; 2],
    /// The nearest label.
    pub nearest: String,
}

impl From<&Margin> for MarginShape {
    fn from(Margin { margin_steps, spread_steps, nearest }: &Margin) -> Self {
        Self { margin_spread_steps: [*margin_steps, *spread_steps], nearest: nearest.clone() }
    }
}

impl From<&MarginShape> for Margin {
    fn from(shape: &MarginShape) -> Self {
        let [margin_steps, spread_steps] = shape.margin_spread_steps;
        Self { margin_steps, spread_steps, nearest: shape.nearest.clone() }
    }
}

impl QualityShape {
    /// The wire form, for a recording with this many interlaced frames.
    pub fn new(quality: &Quality, frames_interlaced: u64) -> Self {
        let tool = |t: &ToolQuality| ToolQualityShape {
            observed_predicted_missing: [t.observed, t.predicted, t.missing],
            reasons: t.reasons.iter().map(|(&reason, &n)| (reason.into(), n)).collect(),
            border_residual_px: t.border_residual_px,
            passing_depth_mm: t.transient_depth_sigma_mm,
            effective_diameter: t.effective_diameter.map(|d| ([d.mm, d.sigma_mm], d.basis == DiameterBasis::Session)),
            gaps: t.gaps.iter().map(gap_shape).collect(),
            colour: [&t.colour.from_tools, &t.colour.from_background].map(|m| m.as_ref().map(Into::into)),
            fulcrum: t.fulcrum.map(FulcrumShape::from),
        };
        let light = |l: &LightSample| [l.time_s, l.luma_ratio, l.chroma_shift[0], l.chroma_shift[1]];
        Self {
            frames: quality.frames,
            frames_interlaced,
            tools: quality.tools.iter().map(tool).collect(),
            light: quality.light.iter().map(light).collect(),
        }
    }
}

fn gap_shape(gap: &Gap) -> (u64, u64, Option<ReasonShape>) {
    let reason = match gap.absence {
        Absence::LeftView => None,
        Absence::Lost(reason) => Some(reason.into()),
    };
    (gap.first, gap.last, reason)
}

impl QualityShape {
    /// The quality for the pipeline, for tools with these names.
    pub fn quality(&self, tools: &[String]) -> Quality {
        let tool = |(name, shape): (&String, &ToolQualityShape)| {
            let [observed, predicted, missing] = shape.observed_predicted_missing;
            let [from_tools, from_background] = shape.colour.each_ref().map(|m| m.as_ref().map(Into::into));
            let gap = |&(first, last, reason): &(u64, u64, Option<ReasonShape>)| {
                let absence = reason.map_or(Absence::LeftView, |reason| Absence::Lost(reason.into()));
                Gap { first, last, absence }
            };
            ToolQuality {
                tool: name.clone(),
                observed,
                predicted,
                missing,
                reasons: shape.reasons.iter().map(|&(reason, n)| (reason.into(), n)).collect(),
                border_residual_px: shape.border_residual_px,
                transient_depth_sigma_mm: shape.passing_depth_mm,
                effective_diameter: shape.effective_diameter.map(|([mm, sigma_mm], of_session)| {
                    let basis = if of_session { DiameterBasis::Session } else { DiameterBasis::Usual };
                    EffectiveDiameter { mm, sigma_mm, basis }
                }),
                gaps: shape.gaps.iter().map(gap).collect(),
                colour: ColourSeparation { from_tools, from_background },
                fulcrum: shape.fulcrum.map(Fulcrum::from),
            }
        };
        let light =
            |&[time_s, luma_ratio, blue, red]: &[f64; 4]| LightSample { time_s, luma_ratio, chroma_shift: [blue, red] };
        Quality {
            frames: self.frames,
            tools: tools.iter().zip(&self.tools).map(tool).collect(),
            light: self.light.iter().map(light).collect(),
        }
    }
}

/// A calibration as the content of camera.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibrationShape {
    /// The file's content.
    pub camera_json: String,
}

#[cfg(test)]
mod tests {
    use super::super::encode;
    use super::*;

    fn samples() -> ColourSamples {
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt709 };
        let sample = |label, rectangle, y| ColourSample { label, rectangle, yuv: [y, 100, 150] };
        let samples = vec![sample(0, 0, 10), sample(0, 0, 11), sample(1, 1, 12), sample(0, 2, 13)];
        ColourSamples { encoding, labels: vec!["orange".into(), "background".into()], samples }
    }

    #[test]
    fn a_stored_palette_keeps_its_rectangles() {
        let bytes = encode(&PaletteShape::from(&samples())).unwrap();
        assert_eq!(PaletteShape::stored(&bytes).unwrap().colour_samples().unwrap(), samples());
    }

    #[test]
    fn a_palette_stored_before_rectangles_has_one_a_label() {
        let PaletteShape { full_range, matrix, labels, samples, .. } = PaletteShape::from(&samples());
        let bytes = encode(&(full_range, matrix, labels, samples)).unwrap();
        let read = PaletteShape::stored(&bytes).unwrap().colour_samples().unwrap();
        let rectangles: Vec<u32> = read.samples.iter().map(|s| s.rectangle).collect();
        assert_eq!(rectangles, [0, 0, 1, 0]);
    }

    #[test]
    fn rectangles_that_do_not_add_up_are_no_palette() {
        let shape = PaletteShape { rectangles: vec![4_000_000_000, 1], ..PaletteShape::from(&samples()) };
        assert_eq!(shape.colour_samples(), None);
        assert!(PaletteShape::stored(&[7; 9]).is_err());
    }
}
