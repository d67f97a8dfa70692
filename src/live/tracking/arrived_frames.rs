//! The frames of a recording that arrived since the service started: those that cannot be read yet, and those that a
//! new child needs.

use std::collections::VecDeque;

/// Most frames since a key frame for a new child to begin at that key frame. With more, it begins at the next one.
const MAX_RECENT_FRAMES: usize = 1024;

/// A frame's position in the log, bytes.
#[derive(Clone, Copy)]
pub(super) struct FramePosition {
    pub(super) offset: u64,
    pub(super) bytes: u32,
}

/// A frame that arrived and cannot be read in the log yet.
struct UnwrittenFrame {
    position: FramePosition,
    /// A child can begin with it.
    is_key: bool,
}

/// The frames that arrived.
#[derive(Default)]
pub(super) struct ArrivedFrames {
    unwritten: VecDeque<UnwrittenFrame>,
    /// The frames since the last key frame: a new child needs them.
    recent: Vec<FramePosition>,
    /// Number of frames that can be read.
    readable: usize,
}

impl ArrivedFrames {
    /// A frame has been appended to the log, perhaps not written yet.
    pub(super) fn append(&mut self, position: FramePosition, is_key: bool) {
        self.unwritten.push_back(UnwrittenFrame { position, is_key });
    }

    /// The next frame that can be read once `bytes` of the log are written. It is one of the recent frames from now on.
    /// A key frame makes the earlier ones unnecessary, unless a child still needs all (`keeps_all`).
    pub(super) fn next_written(&mut self, bytes: u64, keeps_all: bool) -> Option<FramePosition> {
        let ends_within = |frame: &mut UnwrittenFrame| {
            let FramePosition { offset, bytes: length } = frame.position;
            offset + u64::from(length) <= bytes
        };
        let UnwrittenFrame { position, is_key } = self.unwritten.pop_front_if(ends_within)?;
        if (is_key && !keeps_all) || self.recent.len() == MAX_RECENT_FRAMES {
            self.recent.clear();
        }
        self.readable += 1;
        if is_key || !self.recent.is_empty() {
            self.recent.push(position);
        }
        Some(position)
    }

    /// Number of frames that wait to be written.
    pub(super) fn unwritten(&self) -> usize {
        self.unwritten.len()
    }

    /// Number of frames that can be read.
    pub(super) fn readable(&self) -> usize {
        self.readable
    }

    /// The frames that a new child receives first.
    pub(super) fn recent(&self) -> &[FramePosition] {
        &self.recent
    }

    /// True if the recent frames are all that arrived.
    pub(super) fn are_all_recent(&self) -> bool {
        self.readable == self.recent.len()
    }

    /// Forgets the recent frames: a new child begins at the next key frame.
    pub(super) fn forget_recent(&mut self) {
        self.recent.clear();
    }
}
