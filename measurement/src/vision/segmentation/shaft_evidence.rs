//! Evidence for a bare shaft in each cell of a frame: the log ratio of two probabilities, that a shaft shows these
//! codes and that anything else does.

use super::background::Background;
use super::cells::CellPicture;
use super::shaft_colour::{AnyColour, ShaftColour};

/// Largest evidence of one cell, nats: neighbouring cells share their errors, so that none may say more.
pub const MAX_EVIDENCE: f32 = 3.0;

/// The colours of a shaft, of anything, and of the empty box.
#[derive(Clone)]
pub struct ShaftAppearance {
    /// Of the shaft.
    pub shaft: ShaftColour,
    /// Of anything.
    pub any: AnyColour,
    /// Of the empty box.
    pub background: Background,
}

/// Least contrast of a shaft's border, codes of luma and of chroma: with less, noise and texture move the edge by more
/// than a pixel.
pub const LEAST_CONTRAST_CODES: [f64; 2] = [12.0, 8.0];

/// Contrast of an edge of a bare shaft as a multiple of the least: the larger of that in luma, positive if the
/// inside is darker, and that in chroma, positive if the inside is nearer to the shaft's `grey`.
pub fn contrast(inside: [f64; 3], outside: [f64; 3], grey: [f64; 2]) -> f64 {
    let colourful = |[_, u, v]: [f64; 3]| (u - grey[0]).hypot(v - grey[1]);
    let luma = (outside[0] - inside[0]) / LEAST_CONTRAST_CODES[0];
    let chroma = (colourful(outside) - colourful(inside)) / LEAST_CONTRAST_CODES[1];
    if luma.abs() > chroma.abs() { luma } else { chroma }
}

impl ShaftAppearance {
    /// Contrast of an edge of the shaft, whose outside shows the box, as a multiple of the least. What is brighter than
    /// the empty box there is gloss, and counts as no brighter than the box.
    pub fn contrast_with_box(&self, inside: [f32; 3], outside: [f32; 3], empty: [f32; 3]) -> f32 {
        let outside = [outside[0].min(empty[0]), outside[1], outside[2]];
        contrast(inside.map(f64::from), outside.map(f64::from), self.shaft.chroma().map(f64::from)) as f32
    }

    /// Evidence in each cell, nats, from −[`MAX_EVIDENCE`] to [`MAX_EVIDENCE`]. Where the empty box looks like the
    /// shaft, it may be a tool that never moves: there the colour alone counts, too
    /// ([`Background::share_of_difference`]).
    pub fn evidence(&self, cells: &CellPicture) -> Vec<f32> {
        let of_cell = |(cell, codes): (usize, &[u8; 3])| {
            let codes = codes.map(f32::from);
            let (shaft, any) = (self.shaft.log_density(codes), self.any.log_density(codes));
            let limited = |ratio: f32| ratio.clamp(-MAX_EVIDENCE, MAX_EVIDENCE);
            let different = limited(shaft - self.background.log_density(cell, codes, any));
            let share = self.background.share_of_difference(cell);
            share * different + (1.0 - share) * limited(shaft - any)
        };
        cells.codes.iter().enumerate().map(of_cell).collect()
    }
}
