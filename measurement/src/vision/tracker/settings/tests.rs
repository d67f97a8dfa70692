//! Settings that cannot work, and the problem named for each.

use super::*;
use crate::vision::camera::testing::STRAIGHT as CAMERA;
use crate::vision::frame::{ColourEncoding, Matrix, Range};
use crate::vision::segmentation::samples::ColourSample;

/// Tools by name, colour and side; orange, cyan and the background are marked.
fn of(tools: &[(&str, &str, Option<HandSide>)]) -> TrackerSettings {
    let samples = ColourSamples {
        encoding: ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 },
        labels: ["orange", "background", "cyan"].map(str::to_owned).to_vec(),
        samples: (0..3).map(|label| ColourSample { label, rectangle: label as u32, yuv: [100; 3] }).collect(),
        places: Vec::new(),
    };
    let spec = |(name, colour, side): &(&str, &str, Option<HandSide>)| ToolSpec {
        name: (*name).to_owned(),
        colour: (*colour).to_owned(),
        side: *side,
        diameter_mm: 5.0,
        marker: Marker::Band { length_mm: None },
    };
    TrackerSettings::new(CAMERA, tools.iter().map(spec).collect(), samples)
}

fn problem(tools: &[(&str, &str, Option<HandSide>)]) -> Option<SettingsProblem> {
    of(tools).check(CAMERA.width, CAMERA.height).err()
}

#[test]
fn tools_of_one_colour_share_its_class() {
    let pair = [("a", "orange", None), ("b", "cyan", None), ("c", "orange", None)];
    assert_eq!(problem(&pair), None);
    assert_eq!(of(&pair).classes(), [1, 0, 2]);
    assert_eq!(of(&pair).pairs(), [[0, 2]]);
    assert!(of(&pair[..2]).pairs().is_empty());
}

#[test]
fn one_stated_side_determines_both() {
    let pairs = |first, second| of(&[("a", "orange", first), ("b", "orange", second)]).pairs();
    assert_eq!(pairs(Some(HandSide::Left), None), [[0, 1]]);
    assert_eq!(pairs(None, Some(HandSide::Right)), [[0, 1]]);
    assert_eq!(pairs(Some(HandSide::Right), None), [[1, 0]]);
    assert_eq!(pairs(None, Some(HandSide::Left)), [[1, 0]]);
}

#[test]
fn indistinguishable_tools_are_rejected() {
    let left = Some(HandSide::Left);
    let same_side = problem(&[("a", "orange", left), ("b", "orange", left)]);
    assert_eq!(same_side, Some(SettingsProblem::SameSide("a".into(), "b".into())));
    let three = problem(&[("a", "orange", None), ("b", "orange", None), ("c", "orange", None)]);
    assert_eq!(three, Some(SettingsProblem::CrowdedColour(3, "orange".into())));
    assert_eq!(problem(&[("a", "lime", None)]), Some(SettingsProblem::NoSamples("a".into())));
}
