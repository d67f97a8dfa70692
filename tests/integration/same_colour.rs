//! Two tools with the same tape, rendered and tracked: neither gets the name or path of the other.

use trocar::checks::evaluation::{Accuracy, accuracy};
use trocar::simulation::tool::TapeDesign;
use trocar::simulation::{RigView, Scenario, Setup, Skill};
use trocar::vision::trajectory::PathKind;

use crate::truth::Recording;

fn exchange(view: RigView, seed: u64) -> Recording {
    let tapes = [TapeDesign::ALL[0]; 2];
    let setup = Setup { width: 960, height: 540, view, tapes, ..Setup::new(Scenario::Exchange, Skill::EXPERT, seed) };
    Recording::with(&setup, None)
}

fn judged(recording: &Recording) -> Accuracy {
    let tracking = recording.track(recording.world.rig.camera);
    for tool in &tracking.quality.tools {
        eprintln!("{}: {} observed, {} bridged, {:?}", tool.tool, tool.observed, tool.predicted, tool.reasons);
    }
    let truth = recording.truth();
    let of_raw = accuracy(&tracking.trajectory(PathKind::Raw), &truth).unwrap();
    assert_eq!(of_raw.all.levels[0].swaps, 0, "single measurements");
    accuracy(&tracking.trajectory(PathKind::Smoothed), &truth).unwrap()
}

fn assert_names_are_kept(view: RigView, seed: u64) {
    let accuracy = judged(&exchange(view, seed));
    let level = &accuracy.all.levels[0];
    let rms_mm = level.errors.unwrap().three_d.rms;
    eprintln!(
        "{view:?}, seed {seed}: found {}/{}, swaps {}, false {}, 3-D RMS {rms_mm:.2} mm",
        level.found, level.frames, level.swaps, accuracy.all.false_tracks
    );
    assert_eq!((level.swaps, accuracy.all.false_tracks), (0, 0));
    assert!(level.found as f64 > 0.9 * level.frames as f64, "found {} of {}", level.found, level.frames);
    assert!(rms_mm < 5.0, "{rms_mm} mm");
    assert_eq!(accuracy.tools.iter().filter_map(|t| t.tool.as_deref()).collect::<Vec<_>>(), ["left", "right"]);
}

#[test]
fn tools_that_cross_and_return_in_the_other_order_keep_their_names_seen_from_above() {
    assert_names_are_kept(RigView::Top, 4);
}

#[test]
fn tools_that_cross_and_return_in_the_other_order_keep_their_names_seen_from_the_side() {
    assert_names_are_kept(RigView::Side, 4);
}

/// A tool returns so near the camera that the gloss along its tape divides its colour into two bands.
#[test]
fn a_piece_of_a_near_band_is_not_taken_for_a_far_band() {
    assert_names_are_kept(RigView::Top, 2);
    assert_names_are_kept(RigView::Top, 6);
}
