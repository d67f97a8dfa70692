//! What a folder of recordings says about them: its list, and the times in names. `trocar upload` and the watched
//! folder of the server read them alike.

mod known;
mod map;
mod recorded_at;

pub use known::{KnownThing, find};
pub use map::{MapRow, MatchKind, RecordingMap};
pub use recorded_at::{RecordedAt, TimeSource};

/// The cell of a recording whose time is not known.
pub const UNKNOWN_TIME: &str = "unknown";
