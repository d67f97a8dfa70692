//! Frames and gaps as bytes: on the wire one binary message each, in log and spool one after the other.
//!
//! ```text
//!  0  u8   kind: 1 frame, 2 gap
//!  1  u8   flags: 1 = key frame
//!  2  u16  0
//!  4  u32  epoch
//!  8  u64  number: counts the recording's frames from 0, in the order of decoding
//! 16  i64  time of a frame, ticks of the sender's time base; of a gap 0
//! 24  u32  length of what follows the head
//! 28  u32  CRC-32 (as in PNG and zlib) of bytes 0..28 and of what follows the head
//! 32       a frame: its bytes; a gap: u64 last number, u8 why
//! ```
//! Numbers are in network order.

use std::io::{self, Read};

use super::{MOST_FRAMES, MOST_PAYLOAD};
use crate::domain::named;

/// Bytes before the payload.
pub const HEAD: usize = 32;
/// Largest record, bytes.
pub const MOST_BYTES: usize = HEAD + MOST_PAYLOAD;

/// Bytes that hold no record and are looked through for the next one: more than is ever written without a sync.
pub const LONGEST_HOLE: usize = 32 << 20;

const FRAME: u8 = 1;
const GAP: u8 = 2;
const KEY: u8 = 1;
/// Where the checksum lies.
const CHECK: usize = 28;
const GAP_BYTES: usize = 9;

named! {
    /// Why some frames will never come.
    GapReason: "gap" {
        /// The camera gave none.
        Camera = "camera",
        /// The sender's spool was full, and its oldest part went.
        SpoolFull = "spool-full",
        /// The sender lost power or was killed before they were in its spool.
        SenderStopped = "sender-stopped",
        /// They are not there, and nobody knows why.
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

    fn of_code(code: u8) -> Option<Self> {
        Self::ALL.iter().copied().find(|reason| reason.code() == code)
    }
}

/// One record, its payload where it came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a> {
    /// The connection that sent it, in the order of connections.
    pub epoch: u32,
    /// The frame's number, or the gap's first.
    pub number: u64,
    /// What it is.
    pub body: Body<'a>,
}

/// What a record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body<'a> {
    /// A frame.
    Frame {
        /// When it was captured, ticks of the sender's time base.
        time: i64,
        /// Can it be decoded without the ones before?
        is_key: bool,
        /// Its bytes.
        payload: &'a [u8],
    },
    /// Frames that will never come.
    Gap {
        /// The last of them.
        last: u64,
        /// Why.
        reason: GapReason,
    },
}

/// Why bytes are no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotARecord {
    /// They end before the record does.
    #[error("the record is cut after {0} bytes")]
    Cut(usize),
    /// More bytes than the record has.
    #[error("{0} bytes follow the record")]
    Trailing(usize),
    /// A kind, flag or reserved bit that nobody knows.
    #[error("byte {0} of the head holds a value that is not in use")]
    Unknown(usize),
    /// A payload that is empty or too long.
    #[error("a payload of {0} bytes; expected 1 to {MOST_PAYLOAD}")]
    Length(usize),
    /// A number beyond any recording.
    #[error("frame number {0}; a recording has at most {MOST_FRAMES} frames")]
    Number(u64),
    /// A gap that ends before it begins.
    #[error("a gap from {0} to {1}")]
    Backwards(u64, u64),
    /// The bytes are not those that were sent.
    #[error("the checksum does not match: the bytes were damaged on the way or on a disk")]
    Damaged,
}

impl<'a> Record<'a> {
    /// Appends the record's bytes.
    pub fn write(&self, into: &mut Vec<u8>) {
        let start = into.len();
        let gap = match self.body {
            Body::Frame { .. } => [0; GAP_BYTES],
            Body::Gap { last, reason } => {
                let mut bytes = [reason.code(); GAP_BYTES];
                bytes[..8].copy_from_slice(&last.to_be_bytes());
                bytes
            }
        };
        let (kind, flags, time, payload) = match self.body {
            Body::Frame { time, is_key, payload } => (FRAME, if is_key { KEY } else { 0 }, time, payload),
            Body::Gap { .. } => (GAP, 0, 0, &gap[..]),
        };
        into.extend([kind, flags, 0, 0]);
        into.extend(self.epoch.to_be_bytes());
        into.extend(self.number.to_be_bytes());
        into.extend(time.to_be_bytes());
        into.extend((payload.len() as u32).to_be_bytes()); // at most MOST_PAYLOAD
        let check = checksum(&into[start..], payload);
        into.extend(check.to_be_bytes());
        into.extend(payload);
    }

    /// The record that a message holds, no more and no less.
    ///
    /// # Errors
    /// The message is no record.
    pub fn read(message: &'a [u8]) -> Result<Self, NotARecord> {
        let (record, rest) = Self::read_first(message)?;
        if rest.is_empty() { Ok(record) } else { Err(NotARecord::Trailing(rest.len())) }
    }

    /// The first of several records, and the bytes behind it.
    ///
    /// # Errors
    /// There is no whole record; [`NotARecord::Cut`] if there may be one once more bytes have come.
    pub fn read_first(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), NotARecord> {
        let cut = NotARecord::Cut(bytes.len());
        let (head, rest) = bytes.split_at_checked(HEAD).ok_or(cut)?;
        let length = payload_length(head)?;
        let (payload, rest) = rest.split_at_checked(length).ok_or(cut)?;
        if checksum(&head[..CHECK], payload) != u32::from_be_bytes(part(head, CHECK)) {
            return Err(NotARecord::Damaged);
        }
        let (epoch, number) = (u32::from_be_bytes(part(head, 4)), u64::from_be_bytes(part(head, 8)));
        let body = match head[0] {
            FRAME => Body::Frame { time: i64::from_be_bytes(part(head, 16)), is_key: head[1] == KEY, payload },
            _ => gap(number, payload)?,
        };
        if number >= MOST_FRAMES {
            return Err(NotARecord::Number(number));
        }
        Ok((Self { epoch, number, body }, rest))
    }

    /// Its length, bytes.
    pub fn bytes(&self) -> usize {
        match self.body {
            Body::Frame { payload, .. } => HEAD + payload.len(),
            Body::Gap { .. } => HEAD + GAP_BYTES,
        }
    }

    /// The last number that it speaks of.
    pub fn last(&self) -> u64 {
        match self.body {
            Body::Frame { .. } => self.number,
            Body::Gap { last, .. } => last,
        }
    }
}

/// Reads records that lie one after the other, and gives each of them with the place where it begins. Returns where the last
/// of them ends. What is damaged is passed over, be it a payload or a head, if there are records within [`LONGEST_HOLE`] behind
/// it: they may have been acknowledged. A tail in which no record lies was not.
///
/// # Errors
/// The bytes cannot be read, or whoever is given a record refuses.
pub fn read_all<E: From<io::Error>>(
    mut from: impl Read,
    mut give: impl FnMut(u64, Record<'_>) -> Result<(), E>,
) -> Result<u64, E> {
    let (mut buffer, mut held) = (vec![0; 2 * MOST_BYTES], 0);
    let (mut place, mut end) = (0, 0);
    loop {
        let read = from.read(&mut buffer[held..])?;
        held += read;
        let is_over = read == 0;
        let mut rest = &buffer[..held];
        while !rest.is_empty() {
            let bytes = match Record::read_first(rest) {
                Ok((record, behind)) => {
                    give(place, record)?;
                    let bytes = rest.len() - behind.len();
                    end = place + bytes as u64;
                    bytes
                }
                Err(NotARecord::Cut(_)) if !is_over => break,
                // The next record begins anywhere behind: the length may be what is damaged, and whatever it spans may be whole
                // records. Bytes that no head can begin with cost nothing.
                Err(_) => 1,
            };
            rest = &rest[bytes..];
            place += bytes as u64;
        }
        if is_over || place > end + LONGEST_HOLE as u64 {
            return Ok(end);
        }
        let kept = rest.len();
        buffer.copy_within(held - kept..held, 0);
        held = kept;
    }
}

/// Length of the payload that a head announces, if the head can be one at all.
fn payload_length(head: &[u8]) -> Result<usize, NotARecord> {
    let expected: u8 = match head[0] {
        FRAME => KEY,
        GAP => 0,
        _ => return Err(NotARecord::Unknown(0)),
    };
    if head[1] > expected {
        return Err(NotARecord::Unknown(1));
    }
    if let Some(place) = [2, 3].into_iter().find(|place| head[*place] != 0) {
        return Err(NotARecord::Unknown(place));
    }
    let length = u32::from_be_bytes(part(head, 24)) as usize;
    let fits = if head[0] == GAP { length == GAP_BYTES } else { (1..=MOST_PAYLOAD).contains(&length) };
    if fits { Ok(length) } else { Err(NotARecord::Length(length)) }
}

fn gap(first: u64, payload: &[u8]) -> Result<Body<'static>, NotARecord> {
    let last = u64::from_be_bytes(part(payload, 0));
    let reason = GapReason::of_code(payload[8]).ok_or(NotARecord::Unknown(HEAD + 8))?;
    if last < first {
        return Err(NotARecord::Backwards(first, last));
    }
    if last >= MOST_FRAMES {
        return Err(NotARecord::Number(last));
    }
    Ok(Body::Gap { last, reason })
}

fn checksum(head: &[u8], payload: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(head);
    hasher.update(payload);
    hasher.finalize()
}

/// So many bytes from a place on, which the caller knows to be there.
fn part<const N: usize>(bytes: &[u8], from: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[from + i])
}

#[cfg(test)]
mod tests;
