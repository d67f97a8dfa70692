//! Compressed poses of a recording: an hour of two tools has 180,000 poses of 340 bytes each.
//!
//! From frame to frame a number changes only in its last digits, and most of the priors not at all. Each 32-bit word
//! is stored as the bits that differ from the previous pose (XOR), without leading zeros, in whole bytes. This saves a
//! third, without loss. The bytes that change with every frame, as most of a mantissa does, cannot be compressed by
//! any method.

use super::{StoredPose, WORDS, Words};

/// Bits of the tag that states how many bytes of a word follow.
const TAG_BITS: usize = 2;
/// Number of bytes by tag.
const BYTES: [usize; 1 << TAG_BITS] = [0, 2, 3, 4];
const TAGS_PER_BYTE: usize = 8 / TAG_BITS;
const TAG_BYTES: usize = WORDS.div_ceil(TAGS_PER_BYTE);

/// Memory is allocated in blocks of this size, so that growing copies nothing.
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
    pub fn push(&mut self, pose: &StoredPose) {
        const MAX_POSE_BYTES: usize = TAG_BYTES + 4 * WORDS;
        let words = pose.as_words();
        let mut block = self.blocks.pop().unwrap_or_default();
        if block.len() + MAX_POSE_BYTES > block.capacity() {
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

    /// Unpacks the poses, and frees each block's memory once it has been read.
    pub fn unpack(self) -> impl Iterator<Item = StoredPose> {
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
                poses.push(StoredPose::from_words(&words));
            }
            poses
        })
    }
}
