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

impl ShaftAppearance {
    /// Evidence in each cell, nats, from −[`MAX_EVIDENCE`] to [`MAX_EVIDENCE`]. Where the empty box looks like the
    /// shaft, it may be a tool that never moves: there the colour alone and the difference from the background count
    /// half each.
    pub fn evidence(&self, cells: &CellPicture) -> Vec<f32> {
        let of_cell = |(cell, codes): (usize, &[u8; 3])| {
            let codes = codes.map(f32::from);
            let (shaft, any) = (self.shaft.log_density(codes), self.any.log_density(codes));
            let limited = |ratio: f32| ratio.clamp(-MAX_EVIDENCE, MAX_EVIDENCE);
            let different = limited(shaft - self.background.log_density(cell, codes, any));
            if self.background.is_like_shaft(cell) { 0.5 * (different + limited(shaft - any)) } else { different }
        };
        cells.codes.iter().enumerate().map(of_cell).collect()
    }
}
