//! Records read back as they were written, and damage loses only the damaged records.

use proptest::prelude::*;

use super::*;

fn bytes(record: &FeedRecord<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    record.write(&mut bytes);
    bytes
}

fn frame(epoch: u32, number: u64, time: i64, is_key: bool, payload: &[u8]) -> FeedRecord<'_> {
    FeedRecord { epoch, number, body: RecordBody::Frame { time, is_key, payload } }
}

proptest! {
    #[test]
    fn a_frame_comes_back(
        epoch: u32, number in 0..MAX_FRAMES, time: i64, is_key: bool,
        payload in prop::collection::vec(any::<u8>(), 1..300),
    ) {
        let record = frame(epoch, number, time, is_key, &payload);
        let written = bytes(&record);
        prop_assert_eq!(FeedRecord::read(&written), Ok(record));
    }

    #[test]
    fn a_gap_comes_back(epoch: u32, first in 0..MAX_FRAMES, more in 0u64..1000, reason in 0usize..4) {
        let last = (first + more).min(MAX_FRAMES - 1);
        let body = RecordBody::Gap { last, reason: GapReason::ALL[reason] };
        let record = FeedRecord { epoch, number: first, body };
        let written = bytes(&record);
        prop_assert_eq!(FeedRecord::read(&written), Ok(record));
    }

    #[test]
    fn one_damaged_byte_is_noticed(place in 0usize..60, by in 1u8..=255) {
        let mut damaged = bytes(&frame(3, 7, 40_000, true, &[5; 28]));
        damaged[place] ^= by;
        prop_assert!(FeedRecord::read(&damaged).is_err());
    }

    #[test]
    fn any_bytes_are_a_record_or_an_error(any in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = FeedRecord::read_first(&any);
    }
}

#[test]
fn records_follow_one_another_and_the_last_may_be_cut() {
    let payload = [9; 20];
    let (first, second) = (frame(1, 0, 0, true, &payload), frame(1, 1, 3600, false, &payload));
    let both = [bytes(&first), bytes(&second)].concat();
    let (read, rest) = FeedRecord::read_first(&both).unwrap();
    assert_eq!((read, FeedRecord::read(rest)), (first, Ok(second)));
    for cut in 0..rest.len() {
        assert_eq!(FeedRecord::read_first(&rest[..cut]), Err(NotARecord::Cut(cut)));
    }
}

#[test]
fn damage_loses_only_the_damaged_record_and_a_cut_tail_is_ignored() {
    let payload = [7; 50];
    let all: Vec<u8> = (0..5).flat_map(|number| bytes(&frame(1, number, 0, true, &payload))).collect();
    let one = all.len() / 5;
    let found = |log: &[u8]| {
        let mut numbers = Vec::new();
        let end = read_all(log, |_, record| {
            numbers.push(record.number);
            io::Result::Ok(())
        });
        (numbers, end.unwrap() as usize)
    };
    assert_eq!(found(&all), (vec![0, 1, 2, 3, 4], 5 * one));
    let mut damaged = all.clone();
    damaged[2 * one + 40] ^= 1;
    assert_eq!(found(&damaged), (vec![0, 1, 3, 4], 5 * one));
    damaged[4 * one + 40] ^= 1;
    assert_eq!(found(&damaged), (vec![0, 1, 3], 4 * one), "nothing lies behind it");
    assert_eq!(found(&all[..5 * one - 1]).1, 4 * one);
    let zeros = [&all[..one], &[0; 500]].concat();
    assert_eq!(found(&zeros), (vec![0], one));
    for (place, value) in [(0, 7), (1, 2), (24, 0xff), (26, 1)] {
        let mut headless = all.clone();
        headless[2 * one + place] = value; // the last value makes the payload seem to reach beyond the end
        assert_eq!(found(&headless), (vec![0, 1, 3, 4], 5 * one), "byte {place} of a head");
    }
    let payload_of_one = one - HEADER_BYTES;
    for length in [1, payload_of_one - 1, payload_of_one + 9, payload_of_one + 2 * one, 3 * one] {
        let mut lying = all.clone();
        lying[one + 24..one + 28].copy_from_slice(&(length as u32).to_be_bytes());
        assert_eq!(found(&lying), (vec![0, 2, 3, 4], 5 * one), "a head that speaks of {length} bytes");
    }
    let hole = [&all[..one], &vec![0; 3 * MAX_RECORD_BYTES], &all[one..]].concat();
    assert_eq!(found(&hole), (vec![0, 1, 2, 3, 4], hole.len()), "what lies behind a hole is kept");
    let endless = [&all[..one], &vec![0; MAX_HOLE_BYTES + 2 * MAX_RECORD_BYTES], &all[one..]].concat();
    assert_eq!(found(&endless).1, one, "but the search has a limit");
}

#[test]
fn invalid_records_are_refused_by_name() {
    let refused = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = bytes(&frame(1, 5, 0, false, &[1, 2, 3]));
        change(&mut bytes);
        let check = checksum(&bytes[..CHECKSUM_OFFSET], &bytes[HEADER_BYTES..]);
        bytes[CHECKSUM_OFFSET..HEADER_BYTES].copy_from_slice(&check.to_be_bytes());
        FeedRecord::read(&bytes).unwrap_err()
    };
    assert_eq!(refused(&|b| b[0] = 3), NotARecord::Unknown(0));
    assert_eq!(refused(&|b| b[1] = 2), NotARecord::Unknown(1));
    assert_eq!(refused(&|b| b[3] = 1), NotARecord::Unknown(3));
    assert_eq!(refused(&|b| b[9] = 1), NotARecord::Number((1 << 48) + 5));
    assert_eq!(refused(&|b| b[24] = 1), NotARecord::Length((1 << 24) + 3));
    assert_eq!(refused(&|b| b.push(4)), NotARecord::Damaged);
}

#[test]
fn the_documents_test_vectors_are_these_records() {
    let document = include_str!("../../../../docs/feed.md");
    let vector = |begins: &str| {
        let row = document.lines().find(|line| line.starts_with(&format!("| {begins}"))).unwrap();
        let hex = row.rsplit('`').nth(1).unwrap();
        (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect::<Vec<u8>>()
    };
    let jpeg = [0xff, 0xd8, 0xff, 0xd9];
    assert_eq!(vector("a key frame:"), bytes(&frame(2, 7, 25_200, true, &jpeg)));
    assert_eq!(vector("not a key frame:"), bytes(&frame(1, 0, 0, false, &[0])));
    let gap = FeedRecord { epoch: 2, number: 8, body: RecordBody::Gap { last: 11, reason: GapReason::SpoolFull } };
    assert_eq!(vector("a gap:"), bytes(&gap));
}

#[test]
fn the_document_names_every_close_code() {
    use crate::domain::feed::close_reason::CloseCode;
    let document = include_str!("../../../../docs/feed.md");
    for code in CloseCode::ALL {
        let row = format!("| {} |", code.number());
        assert!(document.lines().any(|line| line.starts_with(&row)), "{code:?}");
    }
}
