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
            let is_like_shaft = self.background.is_like_shaft(cell);
            // Most cells clearly show the box. There the limit is reached without the exact densities.
            let most = self.shaft.most_log_density(codes) - self.background.least_log_density(cell, codes);
            if most <= -MAX_EVIDENCE && !is_like_shaft {
                return -MAX_EVIDENCE;
            }
            let (shaft, any) = (self.shaft.log_density(codes), self.any.log_density(codes));
            let limited = |ratio: f32| ratio.clamp(-MAX_EVIDENCE, MAX_EVIDENCE);
            let different = limited(shaft - self.background.log_density(cell, codes, any));
            let share = self.background.share_of_difference(cell);
            share * different + (1.0 - share) * limited(shaft - any)
        };
        cells.codes.iter().enumerate().map(of_cell).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::segmentation::cells::CellGrid;

    #[test]
    fn a_cell_that_clearly_shows_the_box_has_the_evidence_of_the_exact_densities() {
        let grid = CellGrid { cell_px: 4, columns: 256, rows: 4 };
        let picture =
            |codes: &dyn Fn(usize) -> [u8; 3]| CellPicture { grid, codes: (0..grid.count()).map(codes).collect() };
        let empty = picture(&|cell| [[150, 128, 128], [60, 128, 128], [35, 127, 129], [200, 100, 150]][cell / 256]);
        let frame = picture(&|cell| [(cell % 256) as u8, 90 + (cell % 77) as u8, 128]);
        let shaft = ShaftColour::new(&[[30, 128, 128], [40, 127, 129]]).unwrap();
        let any = AnyColour::new([&empty, &frame]);
        let background = Background::from_empty(&empty, std::slice::from_ref(&empty), &shaft, &any).unwrap();
        let appearance = ShaftAppearance { shaft, any, background };
        let exact = |(cell, codes): (usize, &[u8; 3])| {
            let codes = codes.map(f32::from);
            let (shaft, any) = (appearance.shaft.log_density(codes), appearance.any.log_density(codes));
            let limited = |ratio: f32| ratio.clamp(-MAX_EVIDENCE, MAX_EVIDENCE);
            let different = limited(shaft - appearance.background.log_density(cell, codes, any));
            let is_like_shaft = appearance.background.is_like_shaft(cell);
            if is_like_shaft { 0.5 * (different + limited(shaft - any)) } else { different }
        };
        let exact: Vec<f32> = frame.codes.iter().enumerate().map(exact).collect();
        assert_eq!(appearance.evidence(&frame), exact);
        assert!(exact.contains(&-MAX_EVIDENCE) && exact.iter().any(|nats| *nats > 0.0));
    }
}
