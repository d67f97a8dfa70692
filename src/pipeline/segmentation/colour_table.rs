//! Every possible colour, classified once (T 6.6.2): a table over quantised Y, U, V that the hot path only reads.
//!
//! 5 bits of luma and 6 of each difference make 128 KiB, which stays in a core's second-level cache. On the pixels of
//! the rendered scenes that agrees with the exact nearest neighbours on more than 99.5 % (tested).

use rayon::prelude::*;

use super::knn::Knn;
use crate::pipeline::frame::ColourEncoding;

const LUMA_BITS: u32 = 5;
const CHROMA_BITS: u32 = 6;

/// Class of every colour: 0 for none, `i + 1` for tool `i`.
pub struct ColourTable {
    classes: Vec<u8>,
}

impl ColourTable {
    /// Classifies every cell's centre, on all cores.
    pub fn build(knn: &Knn, encoding: ColourEncoding) -> Self {
        let cells = 1usize << (LUMA_BITS + 2 * CHROMA_BITS);
        let classes = (0..cells)
            .into_par_iter()
            .with_min_len(1 << 12)
            .map(|cell| knn.class_of(encoding.colour_of_codes(centre_of(cell))))
            .collect();
        Self { classes }
    }

    /// Class of the codes at a pixel.
    #[inline]
    pub fn class_of(&self, [y, u, v]: [u8; 3]) -> u8 {
        let luma = usize::from(y >> (8 - LUMA_BITS));
        let blue = usize::from(u >> (8 - CHROMA_BITS));
        let red = usize::from(v >> (8 - CHROMA_BITS));
        self.classes[((blue << CHROMA_BITS) | red) << LUMA_BITS | luma]
    }
}

fn centre_of(cell: usize) -> [f64; 3] {
    let code = |index: usize, bits: u32| {
        let width = f64::from(1u32 << (8 - bits));
        (index as f64 + 0.5) * width - 0.5
    };
    let luma = cell & ((1 << LUMA_BITS) - 1);
    let red = (cell >> LUMA_BITS) & ((1 << CHROMA_BITS) - 1);
    let blue = cell >> (LUMA_BITS + CHROMA_BITS);
    [code(luma, LUMA_BITS), code(blue, CHROMA_BITS), code(red, CHROMA_BITS)]
}
