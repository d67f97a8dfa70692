//! Frames and gaps as bytes: one binary message each on the wire, one after the other in log and spool.
//!
//! ```text
//!  0  u8   kind: 1 frame, 2 gap
//!  1  u8   flags: 1 = key frame
//!  2  u16  0
//!  4  u32  epoch
//!  8  u64  number: counts the recording's frames from 0, in the order of decoding
//! 16  i64  time of a frame, ticks of the sender's time base; 0 for a gap
//! 24  u32  length of the payload
//! 28  u32  CRC-32 (as in PNG and zlib) of bytes 0..28 and of the payload
//! 32       payload: a frame's bytes; for a gap u64 last number, u8 reason
//! ```
//! Numbers are in network order.

use std::io::{self, Read};

use super::{MAX_FRAMES, MAX_PAYLOAD};
use crate::domain::named;

/// Length of the header, the bytes before the payload.
pub const HEADER_BYTES: usize = 32;
/// Maximum length of a record, bytes.
pub const MAX_RECORD_BYTES: usize = HEADER_BYTES + MAX_PAYLOAD;

/// Maximum number of damaged bytes searched for the next record: more than is ever written without a sync.
pub const MAX_HOLE_BYTES: usize = 32 << 20;

const FRAME: u8 = 1;
const GAP: u8 = 2;
const KEY_FRAME: u8 = 1;
/// Offset of the checksum in the header.
const CHECKSUM_OFFSET: usize = 28;
const GAP_PAYLOAD_BYTES: usize = 9;

named! {
    /// Why some frames will never arrive.
    GapReason: "gap" {
        /// The camera delivered no frames.
        Camera = "camera",
        /// The sender's spool was full, and its oldest part was deleted.
        SpoolFull = "spool-full",
        /// The sender lost power or was killed before the frames were in its spool.
        SenderStopped = "sender-stopped",
        /// The frames are missing for an unknown reason.
        NeverCame = "never-came",
    }
}

impl GapReason {
    fn code(self) -> u8 {
        match self {
            GapReason::Camera => 1,
            GapReason::SpoolFull => 2,
            GapReason::SenderStopped => 3,
            GapReason::NeverCame => 4,
        }
    }

    fn from_code(code: u8) -> Option<Self> {
        Self::ALL.iter().copied().find(|reason| reason.code() == code)
    }
}

/// One record. Its payload is borrowed from the bytes it was read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FeedRecord<'a> {
    /// Number of the connection that sent it; later connections have higher numbers.
    pub epoch: u32,
    /// The frame's number, or the first number of the gap.
    pub number: u64,
    /// A frame or a gap.
    pub body: RecordBody<'a>,
}

/// The content of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordBody<'a> {
    /// A frame.
    Frame {
        /// Capture time, ticks of the sender's time base.
        time: i64,
        /// Whether it can be decoded without earlier frames.
        is_key: bool,
        /// Its bytes.
        payload: &'a [u8],
    },
    /// Frames that will never arrive.
    Gap {
        /// Number of the last missing frame.
        last: u64,
        /// Why they will never arrive.
        reason: GapReason,
    },
}

/// Why bytes are not a valid record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotARecord {
    /// The bytes end before the record does.
    #[error("the record is cut after {0} bytes")]
    Cut(usize),
    /// More bytes follow the record.
    #[error("{0} bytes follow the record")]
    Trailing(usize),
    /// An unknown kind, flag or reserved bit.
    #[error("byte {0} of the record has an unknown value")]
    Unknown(usize),
    /// A payload that is empty or too long.
    #[error("a payload of {0} bytes; expected 1 to {MAX_PAYLOAD}")]
    Length(usize),
    /// A frame number above the maximum.
    #[error("frame number {0}; a recording has at most {MAX_FRAMES} frames")]
    Number(u64),
    /// A gap that ends before it begins.
    #[error("a gap from {0} to {1}; expected the first number, then the last")]
    Backwards(u64, u64),
    /// The checksum does not match.
    #[error("the checksum does not match: the bytes were damaged in transfer or on a disk")]
    Damaged,
}

impl<'a> FeedRecord<'a> {
    /// Appends the record's bytes.
    pub fn write(&self, into: &mut Vec<u8>) {
        let start = into.len();
        let gap = match self.body {
            RecordBody::Frame { .. } => [0; GAP_PAYLOAD_BYTES],
            RecordBody::Gap { last, reason } => {
                let mut bytes = [reason.code(); GAP_PAYLOAD_BYTES];
                bytes[..8].copy_from_slice(&last.to_be_bytes());
                bytes
            }
        };
        let (kind, flags, time, payload) = match self.body {
            RecordBody::Frame { time, is_key, payload } => (FRAME, if is_key { KEY_FRAME } else { 0 }, time, payload),
            RecordBody::Gap { .. } => (GAP, 0, 0, &gap[..]),
        };
        into.extend([kind, flags, 0, 0]);
        into.extend(self.epoch.to_be_bytes());
        into.extend(self.number.to_be_bytes());
        into.extend(time.to_be_bytes());
        into.extend((payload.len() as u32).to_be_bytes()); // at most MAX_PAYLOAD
        let check = checksum(&into[start..], payload);
        into.extend(check.to_be_bytes());
        into.extend(payload);
    }

    /// Reads a message that holds exactly one record.
    ///
    /// # Errors
    /// The message is not exactly one record.
    pub fn read(message: &'a [u8]) -> Result<Self, NotARecord> {
        let (record, rest) = Self::read_first(message)?;
        if rest.is_empty() { Ok(record) } else { Err(NotARecord::Trailing(rest.len())) }
    }

    /// Reads the first of several records; returns it and the bytes after it.
    ///
    /// # Errors
    /// No complete record; [`NotARecord::Cut`] if more bytes could complete it.
    pub fn read_first(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), NotARecord> {
        let cut = NotARecord::Cut(bytes.len());
        let (head, rest) = bytes.split_at_checked(HEADER_BYTES).ok_or(cut)?;
        let length = payload_length(head)?;
        let (payload, rest) = rest.split_at_checked(length).ok_or(cut)?;
        if checksum(&head[..CHECKSUM_OFFSET], payload) != u32::from_be_bytes(bytes_at(head, CHECKSUM_OFFSET)) {
            return Err(NotARecord::Damaged);
        }
        let (epoch, number) = (u32::from_be_bytes(bytes_at(head, 4)), u64::from_be_bytes(bytes_at(head, 8)));
        let body = match head[0] {
            FRAME => RecordBody::Frame {
                time: i64::from_be_bytes(bytes_at(head, 16)),
                is_key: head[1] == KEY_FRAME,
                payload,
            },
            _ => gap_body(number, payload)?,
        };
        if number >= MAX_FRAMES {
            return Err(NotARecord::Number(number));
        }
        Ok((Self { epoch, number, body }, rest))
    }

    /// Length of the record, bytes.
    pub fn bytes(&self) -> usize {
        match self.body {
            RecordBody::Frame { payload, .. } => HEADER_BYTES + payload.len(),
            RecordBody::Gap { .. } => HEADER_BYTES + GAP_PAYLOAD_BYTES,
        }
    }

    /// The last frame number that the record covers.
    pub fn last_number(&self) -> u64 {
        match self.body {
            RecordBody::Frame { .. } => self.number,
            RecordBody::Gap { last, .. } => last,
        }
    }
}

/// Reads consecutive records and passes each one to `give` with the offset of its beginning. Returns the end of the
/// last record. Damaged bytes, in a payload or a header, are skipped if a record follows within [`MAX_HOLE_BYTES`],
/// because later records may have been acknowledged. A tail without a record was never acknowledged.
///
/// # Errors
/// The bytes cannot be read, or `give` refuses a record.
pub fn read_all<E: From<io::Error>>(
    mut from: impl Read,
    mut give: impl FnMut(u64, FeedRecord<'_>) -> Result<(), E>,
) -> Result<u64, E> {
    let (mut buffer, mut held) = (vec![0; 2 * MAX_RECORD_BYTES], 0);
    let (mut place, mut end) = (0, 0);
    loop {
        let read = from.read(&mut buffer[held..])?;
        held += read;
        let is_over = read == 0;
        let mut rest = &buffer[..held];
        while !rest.is_empty() {
            let bytes = match FeedRecord::read_first(rest) {
                Ok((record, behind)) => {
                    give(place, record)?;
                    let bytes = rest.len() - behind.len();
                    end = place + bytes as u64;
                    bytes
                }
                Err(NotARecord::Cut(_)) if !is_over => break,
                // The next record can begin at any later byte: the length itself may be damaged, and the bytes it
                // covers may be intact records. Bytes that cannot begin a header are rejected at once.
                Err(_) => 1,
            };
            rest = &rest[bytes..];
            place += bytes as u64;
        }
        if is_over || place > end + MAX_HOLE_BYTES as u64 {
            return Ok(end);
        }
        let kept = rest.len();
        buffer.copy_within(held - kept..held, 0);
        held = kept;
    }
}

/// Length of the payload according to the header, if the header is valid.
fn payload_length(head: &[u8]) -> Result<usize, NotARecord> {
    let expected: u8 = match head[0] {
        FRAME => KEY_FRAME,
        GAP => 0,
        _ => return Err(NotARecord::Unknown(0)),
    };
    if head[1] > expected {
        return Err(NotARecord::Unknown(1));
    }
    if let Some(place) = [2, 3].into_iter().find(|place| head[*place] != 0) {
        return Err(NotARecord::Unknown(place));
    }
    let length = u32::from_be_bytes(bytes_at(head, 24)) as usize;
    let fits = if head[0] == GAP { length == GAP_PAYLOAD_BYTES } else { (1..=MAX_PAYLOAD).contains(&length) };
    if fits { Ok(length) } else { Err(NotARecord::Length(length)) }
}

fn gap_body(first: u64, payload: &[u8]) -> Result<RecordBody<'static>, NotARecord> {
    let last = u64::from_be_bytes(bytes_at(payload, 0));
    let reason = GapReason::from_code(payload[8]).ok_or(NotARecord::Unknown(HEADER_BYTES + 8))?;
    if last < first {
        return Err(NotARecord::Backwards(first, last));
    }
    if last >= MAX_FRAMES {
        return Err(NotARecord::Number(last));
    }
    Ok(RecordBody::Gap { last, reason })
}

fn checksum(head: &[u8], payload: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(head);
    hasher.update(payload);
    hasher.finalize()
}

/// `N` bytes from an offset; the caller guarantees that they exist.
fn bytes_at<const N: usize>(bytes: &[u8], from: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[from + i])
}

#[cfg(test)]
mod tests;
