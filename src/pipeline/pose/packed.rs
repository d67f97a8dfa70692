//! Poses as a recording keeps them: an hour of two tools has 180,000, of 340 bytes each.
//!
//! From frame to frame a number changes in its last digits only, and most of what was believed not at all. Of each 32 bits
//! those are kept that differ from the pose before, but for zeros in front, in whole bytes: a third less in all, and to the
//! last bit the same when they are taken out again. Bytes that change with every frame, as most of a mantissa does, no
//! method makes less of.

use super::{KeptPose, WORDS, Words};

/// Bits that tell how many bytes of a word follow.
const TAG_BITS: usize = 2;
/// How many do, by tag.
const BYTES: [usize; 1 << TAG_BITS] = [0, 2, 3, 4];
const TAGS_PER_BYTE: usize = 8 / TAG_BITS;
const TAG_BYTES: usize = WORDS.div_ceil(TAGS_PER_BYTE);

/// Memory is taken in such pieces, so that growing copies nothing.
const BLOCK_BYTES: usize = 1 << 16;

/// Poses in the order of their frames.
#[derive(Clone, Debug)]
pub struct PackedPoses {
    last: Words,
    blocks: Vec<Vec<u8>>,
}

impl Default for PackedPoses {
    fn default() -> Self {
        Self { last: [0; WORDS], blocks: Vec::new() }
    }
}

impl PackedPoses {
    /// Takes the next pose.
    pub fn push(&mut self, pose: &KeptPose) {
        const MOST: usize = TAG_BYTES + 4 * WORDS;
        let words = pose.words();
        let mut block = self.blocks.pop().unwrap_or_default();
        if block.len() + MOST > block.capacity() {
            self.blocks.extend(Some(block).filter(|full| !full.is_empty()));
            block = Vec::with_capacity(BLOCK_BYTES);
        }
        let tags = block.len();
        block.resize(tags + TAG_BYTES, 0);
        for (place, (word, last)) in words.iter().zip(&self.last).enumerate() {
            let change = word ^ last;
            let tag = match change {
                0 => 0,
                1..=0xffff => 1,
                0x1_0000..=0xff_ffff => 2,
                _ => 3,
            };
            block[tags + place / TAGS_PER_BYTE] |= (tag << (place % TAGS_PER_BYTE * TAG_BITS)) as u8;
            block.extend_from_slice(&change.to_le_bytes()[..BYTES[tag]]);
        }
        self.last = words;
        self.blocks.push(block);
    }

    /// The poses again, each block's memory being freed once it has been read.
    pub fn unpack(self) -> impl Iterator<Item = KeptPose> {
        let mut words = [0; WORDS];
        self.blocks.into_iter().flat_map(move |block| {
            let mut poses = Vec::new();
            let mut rest = &block[..];
            while let Some((tags, changes)) = rest.split_at_checked(TAG_BYTES) {
                rest = changes;
                for (place, word) in words.iter_mut().enumerate() {
                    let tag = tags[place / TAGS_PER_BYTE] >> (place % TAGS_PER_BYTE * TAG_BITS);
                    let (change, after) = rest.split_at(BYTES[usize::from(tag) % BYTES.len()]);
                    let mut bytes = [0; 4];
                    bytes[..change.len()].copy_from_slice(change);
                    *word ^= u32::from_le_bytes(bytes);
                    rest = after;
                }
                poses.push(KeptPose::of_words(&words));
            }
            poses
        })
    }
}
