//! Spools for the tests of this folder.

use std::ops::Range;

use tempfile::TempDir;

use super::*;
use crate::domain::feed::record::RecordBody;
use crate::domain::feed::{FrameCodec, PROTOCOL, TimeBase};

pub fn hello(now_ms: i64) -> Hello {
    Hello {
        protocol: PROTOCOL,
        recording: FeedId::at(now_ms),
        trainee: "ada".into(),
        task: "peg".into(),
        codec: FrameCodec::Jpeg,
        width: 64,
        height: 48,
        time_base: TimeBase::try_from([1, 90_000]).unwrap(),
        began_at: "2026-11-21T20:14:00Z".into(),
        sender: String::new(),
        resumes: true,
    }
}

/// A spool with a recording that has just begun.
pub fn spool(most_bytes: u64) -> (TempDir, Spool, FeedId) {
    let folder = tempfile::tempdir().unwrap();
    let mut spool = Spool::open(folder.path(), most_bytes).unwrap();
    let id = spool.begin(hello(1_795_000_000_000), "box-1").unwrap();
    (folder, spool, id)
}

pub fn payload(number: u64) -> Vec<u8> {
    vec![number as u8; 100]
}

/// Appends key frames of 132 bytes, header included.
pub fn add(spool: &mut Spool, numbers: Range<u64>) {
    add_groups(spool, numbers, 1);
}

/// Appends frames with a key frame every `key_every`.
pub fn add_groups(spool: &mut Spool, numbers: Range<u64>, key_every: u64) {
    for number in numbers {
        append(spool, number, number % key_every == 0, &payload(number));
    }
}

/// Appends key frames with this payload length.
pub fn add_sized(spool: &mut Spool, numbers: Range<u64>, bytes: usize) {
    numbers.for_each(|number| append(spool, number, true, &vec![1; bytes]));
}

fn append(spool: &mut Spool, number: u64, is_key: bool, payload: &[u8]) {
    let body = RecordBody::Frame { time: number as i64 * 3600, is_key, payload };
    spool.append(&FeedRecord { epoch: 0, number, body }).unwrap();
}
