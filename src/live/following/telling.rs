//! What a child is told: the places of records, those that wait for its turn, and those that it is not done with.

use std::collections::VecDeque;
use std::io::{PipeWriter, Write};
use std::time::{Duration, Instant};

use crate::analysis::protocol::Place;

/// Between two pictures for watchers: as many as eyes need, and no more.
const PICTURE_EVERY: Duration = Duration::from_millis(80);

/// One end of a pipe to a child, while there is one, and what goes through it.
#[derive(Default)]
pub(super) struct Telling {
    places: Option<PipeWriter>,
    /// Records that wait for the child's turn.
    untold: VecDeque<Untold>,
    /// When each record arrived that it was told of and is not done with.
    behind: VecDeque<Instant>,
    picture_at: Option<Instant>,
}

struct Untold {
    offset: u64,
    bytes: u32,
    came: Instant,
}

impl Telling {
    /// To another child, of which the earlier one's records are none.
    pub(super) fn begin(&mut self, places: PipeWriter) {
        (self.places, self.untold, self.behind) = (Some(places), VecDeque::new(), VecDeque::new());
    }

    /// Will it be told of more?
    pub(super) fn goes_on(&self) -> bool {
        self.places.is_some()
    }

    /// A record of so many bytes, from this one of the log on, waits for the child's turn.
    pub(super) fn wait_for_turn(&mut self, (offset, bytes): (u64, u32)) {
        if self.goes_on() {
            self.untold.push_back(Untold { offset, bytes, came: Instant::now() });
        }
    }

    /// Records that it was told of and is not done with.
    pub(super) fn told(&self) -> usize {
        self.behind.len()
    }

    /// Records that wait for its turn.
    pub(super) fn untold(&self) -> usize {
        self.untold.len()
    }

    /// Tells it of the records that have waited longest, at most so many.
    pub(super) fn next(&mut self, most: usize, is_watched: bool) {
        let Some(places) = &mut self.places else { return };
        for Untold { offset, bytes, came } in self.untold.drain(..most.min(self.untold.len())) {
            let now = Instant::now();
            let wants_picture = is_watched && self.picture_at.is_none_or(|at| now.duration_since(at) >= PICTURE_EVERY);
            // Far fewer places wait in a pipe than it holds, so this does not block; a broken one belongs to a child that ended.
            let place = Place::Record { offset, bytes, wants_picture };
            if places.write_all(&place.to_bytes()).is_ok() {
                self.behind.push_back(came);
                if wants_picture {
                    self.picture_at = Some(now);
                }
            }
        }
    }

    /// Tells it of all that waits, and that no more comes.
    pub(super) fn end(&mut self) {
        self.next(usize::MAX, false);
        self.places = None;
    }

    /// The child is done with a record, which arrived then.
    pub(super) fn done(&mut self) -> Option<Instant> {
        self.behind.pop_front()
    }

    /// Nobody waits any more for what it is told of.
    pub(super) fn forget(&mut self) {
        self.behind.clear();
    }

    /// Asks a child that hears nothing whether it lives.
    pub(super) fn beat(&mut self) {
        if self.behind.is_empty()
            && let Some(places) = &mut self.places
        {
            let _ = places.write_all(&Place::Beat.to_bytes()); // a broken pipe is a child that has ended
        }
    }
}
