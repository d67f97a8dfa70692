//! Laws of the spool: a cut file loses nothing before the cut, and dropped frames are recorded as gaps.

use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::process::Command;

use proptest::prelude::*;

use super::testing::{add, add_sized, hello, payload, spool};
use super::*;
use crate::domain::feed::record::{GapReason, RecordBody};

/// A spool whose segments hold ten frames each.
const SMALL: u64 = 8 * 10 * 132;

fn numbers(ranges: &[[u64; 2]]) -> FrameNumbers {
    let mut numbers = FrameNumbers::default();
    ranges.iter().for_each(|[first, last]| numbers.add(*first, *last).unwrap());
    numbers
}

/// Numbers of the readable frames, and the gaps with their reasons.
fn held(spool: &mut Spool, id: FeedId) -> (FrameNumbers, Vec<(u64, u64, GapReason)>) {
    let (mut frames, mut gaps, mut next) = (FrameNumbers::default(), Vec::new(), 0);
    while let Some(entry) = spool.get(id).and_then(|recording| recording.at_or_after(next)) {
        let bytes = spool.read(id, entry).unwrap();
        let record = FeedRecord::read(&bytes).unwrap();
        match record.body {
            RecordBody::Frame { payload: read, .. } => {
                assert_eq!(read, payload(record.number));
                frames.add(record.number, record.number).unwrap();
            }
            RecordBody::Gap { last, reason } => gaps.push((record.number, last, reason)),
        }
        next = entry.last + 1;
    }
    (frames, gaps)
}

/// The recording's segment files, in order.
fn files(spool: &Spool, id: FeedId) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = fs::read_dir(spool.path(id)).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|suffix| suffix == "records"));
    paths.sort();
    paths
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// However the last file is cut, the records before the cut remain, and acknowledged numbers are not needed.
    #[test]
    fn a_cut_costs_only_what_lies_behind_it(frames in 1u64..40, acknowledged in 0u64..40, cut in 0.0f64..=1.0) {
        let (folder, mut spool, id) = spool(SMALL);
        add(&mut spool, 0..frames);
        let acknowledged = acknowledged.min(frames);
        let durable = if acknowledged > 0 { numbers(&[[0, acknowledged - 1]]) } else { FrameNumbers::default() };
        spool.acknowledge(id, durable.clone()).unwrap();
        let (before, _) = held(&mut spool, id);
        let last = files(&spool, id).pop().unwrap();
        let whole = fs::metadata(&last).unwrap().len();
        let cut = (whole as f64 * cut) as u64;
        drop(spool);
        fs::File::options().write(true).open(&last).unwrap().set_len(cut).unwrap();

        let mut spool = Spool::open(folder.path(), SMALL).unwrap();
        let (after, gaps) = held(&mut spool, id);
        let lost = whole.div_ceil(132) - cut / 132;
        for number in 0..frames - lost {
            prop_assert!(after.contains(number) || durable.contains(number), "{number} of {after:?}");
        }
        for number in (0..frames).filter(|number| after.contains(*number)) {
            prop_assert!(before.contains(number));
        }
        prop_assert!(gaps.is_empty());
        // Recording can continue.
        spool.live = Some(id);
        add(&mut spool, frames..frames + 3);
        prop_assert!(held(&mut spool, id).0.contains_all(frames, frames + 2));
    }

    /// A full spool keeps the newest frames, and every number is a frame, durable, or in a gap.
    #[test]
    fn a_full_spool_keeps_the_newest_and_records_gaps_for_the_rest(
        frames in 81u64..400, acknowledged in 0u64..30, reopened: bool,
    ) {
        let (folder, mut spool, id) = spool(SMALL);
        add(&mut spool, 0..60);
        let durable = if acknowledged > 0 { numbers(&[[0, acknowledged - 1]]) } else { FrameNumbers::default() };
        spool.acknowledge(id, durable.clone()).unwrap();
        add(&mut spool, 60..60 + frames);
        if reopened {
            drop(spool);
            spool = Spool::open(folder.path(), SMALL).unwrap();
        }
        let end = 60 + frames;
        prop_assert!(spool.bytes() <= SMALL);
        let (kept, gaps) = held(&mut spool, id);
        prop_assert!(kept.contains_all(end - 60, end - 1), "{kept:?}");
        let mut accounted = durable;
        kept.ranges().iter().for_each(|[first, last]| accounted.add(*first, *last).unwrap());
        for (first, last, reason) in &gaps {
            prop_assert_eq!(*reason, GapReason::SpoolFull);
            prop_assert!((*first..=*last).all(|number| !kept.contains(number)));
            accounted.add(*first, *last).unwrap();
        }
        prop_assert_eq!(accounted.missing_below(end), Vec::<[u64; 2]>::new());
        prop_assert!(gaps.len() <= 2, "adjacent gaps are joined: {:?}", gaps);
    }
}

#[test]
fn what_is_acknowledged_goes_in_whole_segments() {
    let (_folder, mut spool, id) = spool(SMALL);
    add(&mut spool, 0..35);
    assert_eq!(files(&spool, id).len(), 4);
    spool.acknowledge(id, numbers(&[[0, 4], [10, 24]])).unwrap();
    assert_eq!(files(&spool, id).len(), 3, "only the second segment, 10 to 19, is complete on the server");
    assert_eq!(held(&mut spool, id).0, numbers(&[[0, 9], [20, 34]]));
    assert_eq!(spool.get(id).unwrap().waiting(), (15, 15 * 132));
    spool.acknowledge(id, numbers(&[[0, 34]])).unwrap();
    assert_eq!(held(&mut spool, id).0, numbers(&[[30, 34]]), "the segment in use stays");
    assert_eq!(spool.get(id).unwrap().end, 35);
}

#[test]
fn the_reason_of_a_lost_source_outlives_the_agent() {
    let (folder, mut spool, id) = spool(SMALL);
    add(&mut spool, 0..3);
    spool.note_source_lost("the source ended").unwrap();
    spool.end_live();
    drop(spool);
    let spool = Spool::open(folder.path(), SMALL).unwrap();
    assert_eq!(spool.get(id).unwrap().source_lost.as_deref(), Some("the source ended"));
}

#[test]
fn a_last_frame_without_disk_space_becomes_a_gap() {
    let (_folder, mut spool, id) = spool(SMALL);
    add(&mut spool, 0..3);
    let body = RecordBody::Frame { time: 0, is_key: true, payload: &[0; SMALL as usize] };
    spool.append(&FeedRecord { epoch: 0, number: 3, body }).unwrap_err();
    spool.end_live();
    let full = |first, last| (first, last, GapReason::SpoolFull);
    assert_eq!(held(&mut spool, id), (FrameNumbers::default(), vec![full(0, 2), full(3, 3)]));
}

#[test]
fn a_file_that_has_no_room_for_its_first_record_is_none() {
    let disk = tempfile::tempdir().unwrap();
    let in_the_disk = |program: &str, words: &[&str]| {
        let output = Command::new(program).args(words).arg(disk.path()).output();
        output.is_ok_and(|output| output.status.success())
    };
    if !in_the_disk("mount", &["-t", "tmpfs", "-o", "size=4m", "tmpfs"]) {
        crate::resources::skip("the right to mount a small file system");
        return;
    }
    let mut spool = Spool::open(&disk.path().join("spool"), 8 * 500_000).unwrap();
    let id = spool.begin(hello(1_000), "box-1").unwrap();
    add_sized(&mut spool, 0..5, 100_000); // a segment
    let mut filler = File::create(disk.path().join("filler")).unwrap();
    while filler.write_all(&[0; 4096]).is_ok() {}
    let body = RecordBody::Frame { time: 0, is_key: true, payload: &[0; 1_000_000] };
    let full = spool.append(&FeedRecord { epoch: 0, number: 5, body }).unwrap_err();
    assert!(is_disk_full(&full), "{full}");
    assert_eq!(held(&mut spool, id).1, [(0, 4, GapReason::SpoolFull)]);
    assert_eq!(files(&spool, id).len(), 1);
    drop((spool, filler));
    assert!(in_the_disk("umount", &["-l"]));
}

#[test]
fn a_file_that_is_there_already_costs_one_record_and_not_all_that_follow() {
    let (_folder, mut spool, id) = spool(SMALL);
    fs::write(spool.path(id).join("00000000.records"), b"").unwrap(); // created, but the rest failed
    let body = RecordBody::Frame { time: 0, is_key: true, payload: &payload(0) };
    spool.append(&FeedRecord { epoch: 0, number: 0, body }).unwrap_err();
    add(&mut spool, 1..4);
    assert_eq!(held(&mut spool, id).0, numbers(&[[1, 3]]));
}

#[test]
fn the_oldest_recording_goes_first() {
    let (_folder, mut spool, old) = spool(SMALL);
    add(&mut spool, 0..30);
    let new = spool.begin(hello(1_000), "box-1").unwrap(); // the clock was set back
    add(&mut spool, 0..60);
    assert_eq!(held(&mut spool, old), (numbers(&[[20, 29]]), vec![(0, 19, GapReason::SpoolFull)]));
    assert_eq!(held(&mut spool, new).0, numbers(&[[0, 59]]));
}

#[test]
fn a_damaged_frame_is_a_hole_and_no_frame() {
    let (folder, mut spool, id) = spool(SMALL);
    add(&mut spool, 0..12);
    let first = files(&spool, id).remove(0);
    let mut bytes = fs::read(&first).unwrap();
    bytes[3 * 132 + 50] ^= 1;
    fs::write(&first, bytes).unwrap();
    let entry = spool.get(id).unwrap().at_or_after(3).unwrap();
    assert_eq!(spool.read(id, entry), None);
    assert_eq!(held(&mut spool, id).0, numbers(&[[0, 2], [4, 11]]));
    drop(spool);
    let mut spool = Spool::open(folder.path(), SMALL).unwrap();
    assert_eq!(held(&mut spool, id).0, numbers(&[[0, 2], [4, 11]]));
}

#[test]
fn a_recording_that_the_server_ended_too_early_goes_on_as_another() {
    let (folder, mut spool, id) = spool(SMALL);
    add(&mut spool, 0..15);
    let new = FeedId::at(1_795_000_009_000);
    spool.renew(id, new).unwrap();
    add(&mut spool, 15..20);
    assert_eq!(spool.get(new).unwrap().hello.recording, new);
    drop(spool);
    let mut spool = Spool::open(folder.path(), SMALL).unwrap();
    assert_eq!((spool.ids(), held(&mut spool, new).0), (vec![new], numbers(&[[0, 19]])));
    assert_eq!(spool.get(new).unwrap().in_box.as_deref(), Some("box-1"));
    drop(spool);
    fs::remove_file(folder.path().join(new.to_string()).join("box")).unwrap(); // as earlier versions left it
    let spool = Spool::open(folder.path(), SMALL).unwrap();
    assert_eq!(spool.get(new).unwrap().in_box, None);
}

#[test]
fn one_agent_at_a_time_has_a_spool_and_what_is_removed_is_gone() {
    let (folder, mut spool, id) = spool(SMALL);
    add(&mut spool, 0..3);
    assert!(Spool::open(folder.path(), SMALL).is_err());
    spool.close(id).unwrap();
    drop(spool);
    let mut spool = Spool::open(folder.path(), SMALL).unwrap();
    assert!(spool.get(id).unwrap().is_closing());
    spool.remove(id).unwrap();
    drop(spool);
    assert_eq!(Spool::open(folder.path(), SMALL).unwrap().ids(), []);
}

#[test]
fn the_file_that_an_earlier_version_made_of_a_recording_is_removed_and_the_recording_stays() {
    let (folder, mut spool, id) = spool(SMALL);
    add(&mut spool, 0..9);
    let files = ["recording.mp4", "recording.new"].map(|name| spool.path(id).join(name));
    drop(spool);
    files.iter().for_each(|file| fs::write(file, [1; 4000]).unwrap());
    let mut spool = Spool::open(folder.path(), SMALL).unwrap();
    assert!(files.iter().all(|file| !file.exists()));
    assert_eq!(held(&mut spool, id).0, numbers(&[[0, 8]]));
}

#[test]
fn a_recording_that_was_not_ended_was_broken_off() {
    let (folder, mut one, ended) = spool(1 << 20);
    add(&mut one, 0..3);
    one.end_live();
    assert_eq!(one.get(ended).unwrap().broken_off, None);
    drop(one);
    let mut again = Spool::open(folder.path(), 1 << 20).unwrap();
    assert_eq!(again.get(ended).unwrap().broken_off, None, "it had ended");
    let stopped = again.begin(hello(1_795_000_000_001), "box-1").unwrap();
    again.note_broken_off("stopped");
    again.end_live();
    assert_eq!(again.get(stopped).unwrap().broken_off.as_deref(), Some("stopped"));
    let killed = again.begin(hello(1_795_000_000_002), "box-1").unwrap();
    drop(again);
    let last = Spool::open(folder.path(), 1 << 20).unwrap();
    assert!([stopped, killed].iter().all(|id| last.get(*id).unwrap().broken_off.is_some()));
}
