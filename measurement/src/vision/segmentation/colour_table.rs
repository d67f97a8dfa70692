//! Class of every colour (T 6.6.2): a table over quantised Y, U, V, filled on demand.
//!
//! 5 bits of luma and 6 of each difference make 128 KiB, which fits into a core's second-level cache. On the pixels of
//! the rendered scenes it agrees with the exact nearest neighbours on more than 99.5 % (tested). A recording contains
//! a few thousand of the 131,072 colours: each is classified when it is first seen, and only read after that.

use std::sync::atomic::{AtomicU8, Ordering};

use super::{Classify, Segment};
use crate::vision::frame::{ColourEncoding, Frame};

const LUMA_BITS: u32 = 5;
const CHROMA_BITS: u32 = 6;

/// Marks a colour that has not been classified yet; more than any tool's class.
const UNSEEN: u8 = u8::MAX;

/// Class of every colour: 0 for no tool, from 1 on for the tools' colours.
pub struct ColourTable {
    /// Atomic only so that lookups need no exclusive access: concurrent writers of a cell write the same class.
    classes: Vec<AtomicU8>,
    classifier: Box<dyn Classify>,
    encoding: ColourEncoding,
}

impl ColourTable {
    /// An empty table for pictures of this encoding.
    pub fn new(classifier: impl Classify + 'static, encoding: ColourEncoding) -> Self {
        let cells = 1usize << (LUMA_BITS + 2 * CHROMA_BITS);
        Self {
            classes: (0..cells).map(|_| AtomicU8::new(UNSEEN)).collect(),
            classifier: Box::new(classifier),
            encoding,
        }
    }

    /// Class of these codes of Y, U, V.
    #[inline]
    pub fn class_of(&self, [y, u, v]: [u8; 3]) -> u8 {
        let luma = usize::from(y >> (8 - LUMA_BITS));
        let blue = usize::from(u >> (8 - CHROMA_BITS));
        let red = usize::from(v >> (8 - CHROMA_BITS));
        let cell = ((blue << CHROMA_BITS) | red) << LUMA_BITS | luma;
        match self.classes[cell].load(Ordering::Relaxed) {
            UNSEEN => self.classify(cell),
            class => class,
        }
    }

    /// Classifies a cell by its centre.
    #[cold]
    fn classify(&self, cell: usize) -> u8 {
        let class = self.classifier.class_of(self.encoding.colour_of_codes(centre_of(cell)));
        self.classes[cell].store(class, Ordering::Relaxed);
        class
    }
}

impl Segment for ColourTable {
    fn class_at(&self, frame: &Frame<'_>, x: usize, y: usize) -> u8 {
        self.class_of(frame.yuv_at(x, y))
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
