//! The feed of a box: frames that arrive while they are recorded, in the words of `docs/feed.md`.
//!
//! A sender says [`words::Hello`], is told its *epoch* and what is durable already, and sends [`record::Record`]s: frames
//! in any order, each with its number, and gaps where there will never be one. What the server holds is a set of numbers
//! ([`numbers::Numbers`]); what it acknowledges is durable. The same bytes that travel lie in the server's log and in the
//! agent's spool.
//!
//! | file | holds |
//! |---|---|
//! | [`record`] | frames and gaps as bytes, with a checksum |
//! | [`words`] | what is said in JSON |
//! | [`numbers`] | sets of frame numbers, as ranges |
//! | [`farewell`] | why a connection was closed |

pub mod farewell;
pub mod numbers;
pub mod record;
pub mod words;

use super::named;
use super::text::Invalid;

/// The version of the protocol that this program speaks.
pub const PROTOCOL: u32 = 1;

/// Frames of one recording at most, as of any recording: 4 hours at 60 Hz, and some.
pub const MOST_FRAMES: u64 = 1_000_000;

/// Longest recording, s.
pub const LONGEST_S: f64 = 4.0 * 3600.0;

/// Largest frame, bytes: a photo-like JPEG of 1080p has half of it.
pub const MOST_PAYLOAD: usize = 1 << 20;

/// Most ranges that a recording's numbers may fall into. Each outage makes one; a sender that skips every other frame would
/// make half a million.
pub const MOST_RANGES: usize = 4096;

named! {
    /// How frames are coded.
    FrameCodec: "codec" {
        /// Each frame a JPEG.
        Jpeg = "jpeg",
        /// Each frame an access unit of H.264 in Annex B form; parameter sets come with every key frame.
        H264 = "h264",
    }
}

/// The clock in which a sender counts: a tick lasts `num / den` seconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "[u32; 2]", into = "[u32; 2]")]
pub struct TimeBase {
    num: u32,
    den: u32,
}

impl TimeBase {
    /// Numerator and denominator.
    pub fn fraction(self) -> (u32, u32) {
        (self.num, self.den)
    }

    /// A time in seconds, to the last bit what it is in the recording that is made of the feed.
    pub fn seconds(self, ticks: i64) -> f64 {
        ticks as f64 * (f64::from(self.num) / f64::from(self.den))
    }
}

impl TryFrom<[u32; 2]> for TimeBase {
    type Error = Invalid;

    fn try_from([num, den]: [u32; 2]) -> Result<Self, Invalid> {
        /// Coarser ticks could not tell frames apart.
        const COARSEST_HZ: u32 = 1000;
        /// In finer ones a recording of four hours would not fit into the 31 bits that containers have for a duration.
        const MOST_DEN: u32 = 100_000;
        if den.checked_div(num).is_none_or(|hertz| hertz < COARSEST_HZ) || den > MOST_DEN {
            return Err(Invalid::new("time_base", "expected [1, n] with n from 1000 to 100000 ticks a second"));
        }
        Ok(Self { num, den })
    }
}

impl From<TimeBase> for [u32; 2] {
    fn from(TimeBase { num, den }: TimeBase) -> Self {
        [num, den]
    }
}
