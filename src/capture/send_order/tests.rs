//! Live frames first, each frame once, none left out.

use proptest::prelude::*;
use tempfile::TempDir;

use super::*;
use crate::capture::spool::Spool;
use crate::capture::spool::testing::{add_groups, add_sized, spool};
use crate::ids::FeedId;

/// A spool with this many frames, a key frame every ten.
fn with(frames: u64) -> (TempDir, Spool, FeedId) {
    let (folder, mut spool, id) = spool(1 << 30);
    add_groups(&mut spool, 0..frames, 10);
    (folder, spool, id)
}

fn numbers(ranges: &[[u64; 2]]) -> FrameNumbers {
    let mut numbers = FrameNumbers::default();
    ranges.iter().for_each(|[first, last]| numbers.add(*first, *last).unwrap());
    numbers
}

/// The numbers of all frames that are sent now.
fn all(order: &mut SendOrder, recording: &SpooledRecording, is_live: bool) -> Vec<u64> {
    let sent = std::iter::from_fn(|| order.next(recording, is_live));
    sent.map(|next| if let NextSend::Record(entry) = next { entry.number } else { panic!("{next:?}") }).collect()
}

#[test]
fn after_an_outage_live_goes_out_first_from_a_key_frame_and_the_rest_behind_it() {
    let (_folder, mut spool, id) = with(505);
    spool.acknowledge(id, numbers(&[[0, 99]])).unwrap();
    let mut order = SendOrder::default();
    let recording = spool.get(id).unwrap();
    let sent: Vec<u64> = (0..20)
        .map_while(|_| order.next(recording, true))
        .map(|next| match next {
            NextSend::Record(entry) => entry.number,
            NextSend::Lost(_) => panic!(),
        })
        .collect();
    assert_eq!(sent, (500..505).chain(100..115).collect::<Vec<_>>());
    add_groups(&mut spool, 505..507, 10);
    let rest = all(&mut order, spool.get(id).unwrap(), true);
    assert_eq!(rest, (505..507).chain(115..500).collect::<Vec<_>>(), "live comes before what is left of the rest");
    assert!(order.is_done(spool.get(id).unwrap()));
}

#[test]
fn a_short_cut_and_a_recording_that_is_over_go_out_in_order() {
    let (_folder, mut spool, id) = with(160);
    spool.acknowledge(id, numbers(&[[0, 99]])).unwrap();
    assert_eq!(all(&mut SendOrder::default(), spool.get(id).unwrap(), true), (100..160).collect::<Vec<_>>());
    spool.acknowledge(id, FrameNumbers::default()).unwrap();
    assert_eq!(all(&mut SendOrder::default(), spool.get(id).unwrap(), false), (0..160).collect::<Vec<_>>());
}

#[test]
fn the_rest_waits_while_much_is_under_way_and_live_does_not() {
    let (_folder, mut spool, id) = spool(1 << 30);
    add_sized(&mut spool, 0..200, 100_000);
    let mut order = SendOrder::default();
    let first = all(&mut order, spool.get(id).unwrap(), true);
    assert_eq!((first[0], first.len() as u64), (199, 1 + MAX_IN_FLIGHT_BYTES as u64 / 100_032));
    add_sized(&mut spool, 200..201, 100_000);
    assert_eq!(all(&mut order, spool.get(id).unwrap(), true), [200]);
    let durable = numbers(&[[199, 199]]);
    order.apply_ack(&durable);
    assert_eq!(all(&mut order, spool.get(id).unwrap(), true).len(), 0, "200 took its place");
    order.apply_ack(&numbers(&[[199, 200]]));
    assert_eq!(all(&mut order, spool.get(id).unwrap(), true), [20]);
}

#[test]
fn a_recording_is_done_if_the_server_has_all_or_the_spool_lacks_the_last() {
    let (_folder, mut spool, id) = with(30);
    spool.end_live();
    spool.acknowledge(id, numbers(&[[0, 34]])).unwrap(); // the agent lost its last frames in a power cut
    let mut order = SendOrder::default();
    assert_eq!(all(&mut order, spool.get(id).unwrap(), false), Vec::<u64>::new());
    assert!(order.is_done(spool.get(id).unwrap()));
    spool.acknowledge(id, numbers(&[[0, 3], [34, 34]])).unwrap();
    let mut order = SendOrder::default();
    assert_eq!(all(&mut order, spool.get(id).unwrap(), false), (4..30).collect::<Vec<_>>());
    assert!(order.is_done(spool.get(id).unwrap()), "the server asks for the rest");
}

#[test]
fn missing_frames_are_sent_again_or_reported_as_lost() {
    let (_folder, spool, id) = with(30);
    let recording = spool.get(id).unwrap();
    let mut order = SendOrder::default();
    all(&mut order, recording, false);
    assert!(order.is_done(recording));
    order.request_missing(vec![[4, 5], [28, 40]]);
    assert!(!order.is_done(recording));
    let answers: Vec<NextSend> = std::iter::from_fn(|| order.next(recording, false)).collect();
    let again = |number: u64| NextSend::Record(recording.at_or_after(number).unwrap());
    assert_eq!(answers, [again(4), again(5), again(28), again(29), NextSend::Lost([30, 40])]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_missing_frame_is_sent_exactly_once(
        frames in 1u64..400, spans in prop::collection::vec((0u64..400, 0u64..60), 0..5), later in 0u64..200,
        is_live: bool,
    ) {
        let (_folder, mut spool, id) = with(frames);
        let mut durable = FrameNumbers::default();
        for (first, more) in spans.into_iter().filter(|(first, _)| *first < frames) {
            durable.add(first, (first + more).min(frames - 1)).unwrap();
        }
        spool.acknowledge(id, durable.clone()).unwrap();
        let mut order = SendOrder::default();
        let mut sent = all(&mut order, spool.get(id).unwrap(), is_live);
        add_groups(&mut spool, frames..frames + later, 10);
        sent.extend(all(&mut order, spool.get(id).unwrap(), is_live));
        sent.sort_unstable();
        prop_assert_eq!(sent, (0..frames + later).filter(|number| !durable.contains(*number)).collect::<Vec<_>>());
        prop_assert!(order.is_done(spool.get(id).unwrap()));
    }
}
