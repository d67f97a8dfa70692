//! Two tools with the same tape, rendered, through the whole tracker: nobody is taken for somebody else.

use trocar::pipeline::evaluation::{Accuracy, accuracy};
use trocar::pipeline::trajectory::Kind;
use trocar::simulation::tool::Tape;
use trocar::simulation::{Scenario, Setup, Skill, View};

use crate::truth::Recording;

fn exchange(view: View) -> Recording {
    let tapes = [Tape::ALL[0]; 2];
    let setup = Setup { width: 960, height: 540, view, tapes, ..Setup::new(Scenario::Exchange, Skill::EXPERT, 4) };
    Recording::with(&setup, None)
}

fn judged(recording: &Recording) -> Accuracy {
    let tracking = recording.track(recording.world.rig.camera);
    for tool in &tracking.quality.tools {
        eprintln!("{}: {} observed, {} bridged, {:?}", tool.tool, tool.observed, tool.predicted, tool.reasons);
    }
    let truth = recording.truth();
    let of_raw = accuracy(&tracking.trajectory(Kind::Raw), &truth).unwrap();
    assert_eq!(of_raw.all.levels[0].swaps, 0, "single measurements");
    accuracy(&tracking.trajectory(Kind::Smoothed), &truth).unwrap()
}

fn names_are_kept(view: View) {
    let accuracy = judged(&exchange(view));
    let level = &accuracy.all.levels[0];
    let rms_mm = level.errors.unwrap().three_d.rms;
    eprintln!(
        "{view:?}: found {}/{}, swaps {}, false {}, 3-D RMS {rms_mm:.2} mm",
        level.found, level.frames, level.swaps, accuracy.all.false_tracks
    );
    assert_eq!((level.swaps, accuracy.all.false_tracks), (0, 0));
    assert!(level.found as f64 > 0.9 * level.frames as f64, "found {} of {}", level.found, level.frames);
    assert!(rms_mm < 5.0, "{rms_mm} mm");
    assert_eq!(accuracy.tools.iter().filter_map(|t| t.tool.as_deref()).collect::<Vec<_>>(), ["left", "right"]);
}

#[test]
fn two_that_cross_leave_and_return_in_the_other_order_seen_from_above() {
    names_are_kept(View::Top);
}

#[test]
fn two_that_cross_leave_and_return_in_the_other_order_seen_from_the_side() {
    names_are_kept(View::Side);
}
