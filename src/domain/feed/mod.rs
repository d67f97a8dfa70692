//! The feed of a box: frames that arrive during the recording. The protocol is described in `docs/feed.md`.
//!
//! A sender sends [`messages::Hello`]; the answer holds its *epoch* and the frames that are durable already. The sender
//! then sends [`record::FeedRecord`]s: frames in any order, each with its number, and gaps for frames that will never
//! arrive. The server keeps the set of numbers that it has ([`numbers::FrameNumbers`]) and acknowledges only durable
//! frames. The server's log and the agent's spool hold the same bytes as the wire.
//!
//! | file | holds |
//! |---|---|
//! | [`record`] | frames and gaps as bytes, with a checksum |
//! | [`messages`] | the JSON messages |
//! | [`numbers`] | sets of frame numbers, as ranges |
//! | [`close_reason`] | why a connection was closed |
//! | [`early_end`] | why a recording ended early |
//! | [`start`] | when a recording began |
//! | [`playable`] | the frames that can be decoded and shown |
//! | [`arrival`] | how fast a stream arrived, against its stamps |

pub mod arrival;
pub mod close_reason;
pub mod early_end;
pub mod messages;
pub mod numbers;
pub mod playable;
pub mod record;
pub mod start;

use super::named;
use super::text::Invalid;

/// The protocol version of this program.
pub const PROTOCOL: u32 = 1;

/// Maximum number of frames in a recording: 4 hours at 60 Hz, and some reserve.
pub const MAX_FRAMES: u64 = 1_000_000;

/// Maximum duration of a recording, s.
pub const MAX_DURATION_S: f64 = 4.0 * 3600.0;

/// Maximum size of a frame, bytes: twice the size of a photo-like 1080p JPEG.
pub const MAX_PAYLOAD: usize = 1 << 20;

/// Maximum number of ranges of a recording's frame numbers. Each outage adds one; without the limit, a sender that
/// skips every other frame would create half a million.
pub const MAX_RANGES: usize = 4096;

named! {
    /// Encoding of the frames.
    FrameCodec: "codec" {
        /// Each frame a JPEG.
        Jpeg = "jpeg",
        /// Each frame an access unit of H.264 in Annex B form; parameter sets come with every key frame.
        H264 = "h264",
    }
}

/// The unit of a sender's time stamps: a tick lasts `num / den` seconds.
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

    /// A time in seconds, bit for bit the same as in the recording made from the feed.
    pub fn seconds(self, ticks: i64) -> f64 {
        ticks as f64 * (f64::from(self.num) / f64::from(self.den))
    }
}

impl TryFrom<[u32; 2]> for TimeBase {
    type Error = Invalid;

    fn try_from([num, den]: [u32; 2]) -> Result<Self, Invalid> {
        /// Coarser ticks could give two frames the same time.
        const MIN_HZ: u32 = 1000;
        /// With finer ticks, a recording of four hours would exceed the 31 bits that containers have for a duration.
        const MAX_DEN: u32 = 100_000;
        if den.checked_div(num).is_none_or(|hertz| hertz < MIN_HZ) || den > MAX_DEN {
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
