//! The replies of every child, in their order.

use proptest::prelude::*;

use super::*;
use crate::analysis::child::probe::ProbeWork;
use crate::analysis::child::recording::RecordingRecord;
use crate::analysis::child::track::TrackRecord;
use crate::analysis::protocol::encode;
use crate::domain::problem::Problem;
use crate::vision::trajectory::PathKind;

/// Validates these replies after the confinement.
fn validate_all(replies: Vec<ChildReply>) -> Result<ChildOutput, String> {
    let work = ChildWork::Probe(ProbeWork);
    let mut validator = OutputValidator::new(&work, MediaLimits::default());
    for reply in [ChildReply::Confined { landlock: true }].into_iter().chain(replies) {
        validator.validate(&encode(&reply).unwrap())?;
    }
    Ok(validator.into_output())
}

#[test]
fn replies_out_of_order_are_refused() {
    let announced = RecordingRecord::Announced { width: 640, height: 480, frames_expected: None };
    let cases = [
        vec![ChildReply::Confined { landlock: true }],
        vec![ChildReply::Record(WorkRecord::Calibrate("{}".into()))],
        vec![ChildReply::Done, ChildReply::Done],
        vec![ChildReply::Done, ChildReply::Record(WorkRecord::Probe(announced))],
        vec![ChildReply::Problem(Problem::new("no such name!", "", ""))],
    ];
    for replies in cases {
        let said = format!("{replies:?}");
        assert!(validate_all(replies).is_err(), "{said}");
    }
}

#[test]
fn nothing_is_accepted_before_confinement() {
    let work = ChildWork::Probe(ProbeWork);
    let mut validator = OutputValidator::new(&work, MediaLimits::default());
    assert!(validator.validate(&encode(&ChildReply::Done).unwrap()).is_err());
}

#[test]
fn a_problems_texts_are_short_and_without_control_characters() {
    let problem = Problem::new("not-a-video", "a\nb", "x".repeat(10_000) + "\x1b[31m");
    let heard = validate_all(vec![ChildReply::Problem(problem)]).unwrap().problem.unwrap();
    assert_eq!((heard.title.as_str(), heard.detail.len()), ("a b", 4000));
}

proptest! {
    #[test]
    fn arbitrary_records_are_accepted_or_refused_but_never_panic(
        records in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 1..8),
    ) {
        let work = ChildWork::Track(crate::analysis::child::track::tests::work());
        let path = TrackRecord::Path { kind: PathKind::Raw, rows: vec![] };
        // Two bytes select the records of tracking; random bytes alone would seldom reach them.
        let tracking = encode(&ChildReply::Record(WorkRecord::Track(path))).unwrap()[..2].to_vec();
        let mut validator = OutputValidator::new(&work, MediaLimits::default());
        validator.validate(&encode(&ChildReply::Confined { landlock: true }).unwrap()).unwrap();
        for record in records {
            let _ = validator.validate(&record);
            let _ = validator.validate(&[&tracking[..], &record].concat());
        }
    }
}
