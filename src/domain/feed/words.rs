//! What sender and server say in JSON, one text message each.

use serde::{Deserialize, Serialize};

use super::{FrameCodec, TimeBase};
use crate::ids::{FeedId, SessionId};

/// What a sender says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case", deny_unknown_fields)]
pub enum FromSender {
    /// The first word of every connection.
    Hello(Hello),
    /// The recording is over.
    End {
        /// How many frames it has: one more than the largest number.
        frames: u64,
    },
}

/// Who sends what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hello {
    /// [`super::PROTOCOL`].
    pub protocol: u32,
    /// The recording's own id, made by the sender: whoever says the same one goes on with the same recording.
    pub recording: FeedId,
    /// Who trains, by id or code.
    pub trainee: String,
    /// What they do, by id or code.
    pub task: String,
    /// How the frames are coded.
    pub codec: FrameCodec,
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// The clock in which times are counted.
    pub time_base: TimeBase,
    /// When the recording began, RFC 3339, by the sender's clock on the wall.
    pub began_at: String,
    /// The sender's program and version, for people.
    #[serde(default)]
    pub sender: String,
}

/// What the server says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum FromServer {
    /// The answer to a hello.
    Welcome {
        /// The session that the recording is.
        session: SessionId,
        /// The epoch that every record of this connection must bear. A later connection has a higher one, and closes this.
        epoch: u32,
        /// Frames and gaps that are durable already: need not be sent again.
        durable: Vec<[u64; 2]>,
    },
    /// These frames and gaps are durable: the sender may forget them.
    Ack {
        /// All of them, as ranges.
        durable: Vec<[u64; 2]>,
    },
    /// The answer to an end that came too early.
    Missing {
        /// Frames that have not come: send them, or a gap.
        frames: Vec<[u64; 2]>,
    },
    /// The recording is whole, and a session like any other. The last word.
    Ended {
        /// The session.
        session: SessionId,
        /// All frames and gaps that came, every one of them durable; left out where the server knows of the session alone, as
        /// when it ended before this connection. Senders that were written before it was said do without.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        durable: Option<Vec<[u64; 2]>>,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documents_last_words_are_these() {
        let document = include_str!("../../../docs/feed.md");
        let session: SessionId = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45".parse().unwrap();
        for durable in [None, Some(vec![[0, 7500]])] {
            let word = FromServer::Ended { session, durable };
            let said = serde_json::to_string(&word).unwrap();
            assert_eq!(serde_json::from_str::<FromServer>(&said).unwrap(), word);
            assert!(document.contains(&format!("`{said}`")), "{said}");
        }
    }
}
