//! Tools without tape on the command line: their paths, the check of tapes, and the picture of the empty box.

use std::fs;
use std::process::Output;

use nalgebra::Vector3;
use serde_json::{Value, json};
use trocar::domain::files::truth::TruthFile;

use crate::feed::scene::{Folder, rows};
use crate::process::program;

/// A short scene whose annotations are changed.
fn scene_with(change: impl FnOnce(&mut Value)) -> Folder {
    let scene = Folder::of("--seed 5 --seconds 2 --size 640x360");
    let path = scene.file("annotations.json");
    let mut marks: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut marks);
    fs::write(path, marks.to_string()).unwrap();
    scene
}

fn run(scene: &Folder, line: &str) -> Output {
    program().args(line.split(' ')).current_dir(scene.file("")).output().unwrap()
}

const TRACK: &str = "track --quiet --camera camera.json --annotations annotations.json clip.mp4";

#[test]
fn without_any_tape_the_check_of_tapes_says_so_and_succeeds() {
    let scene = scene_with(|marks| {
        marks["needs"] = json!(2);
        marks["tools"] = json!([{"tool": "left", "diameter_mm": 5.0, "marker": {"kind": "shaft"}}]);
        for label in marks["labels"].as_array_mut().unwrap() {
            // The tape lies on the shaft; in this test it is one colour with it.
            if !["background", "jaw"].contains(&label["label"].as_str().unwrap()) {
                label["label"] = json!("shaft");
            }
        }
    });
    let checked = run(&scene, "palette --check annotations.json");
    let text = String::from_utf8(checked.stdout).unwrap();
    assert!(checked.status.success() && checked.stderr.is_empty(), "{text}");
    assert!(text.starts_with("None of the tools has tape"), "{text}");
    let report: Value = serde_json::from_slice(&run(&scene, "palette --check annotations.json --json").stdout).unwrap();
    assert_eq!((&report["verdicts"], &report["warnings"]), (&json!([]), &json!([])));
}

#[test]
fn a_picture_of_the_empty_box_is_found_and_has_the_size_of_the_recording() {
    let scene = scene_with(|marks| marks["empty_box"] = json!("empty.png"));
    let refusal = |line: &str| {
        let refused = run(&scene, line);
        assert_eq!(refused.status.code(), Some(2), "{refused:?}");
        String::from_utf8(refused.stderr).unwrap()
    };
    assert!(refusal(TRACK).contains("empty.png"), "the file is missing");
    image::RgbImage::new(64, 48).save(scene.file("empty.png")).unwrap();
    let other_size = refusal(TRACK);
    assert!(other_size.contains("64×48") && other_size.contains("640×360"), "{other_size}");
    fs::write(scene.file("text.jpg"), "no photo").unwrap();
    assert!(refusal(&format!("{TRACK} --empty text.jpg")).contains("text.jpg"), "the option takes precedence");
    image::RgbImage::new(640, 360).save(scene.file("right.png")).unwrap();
    let tracked = run(&scene, &format!("{TRACK} --empty right.png"));
    assert!(tracked.status.success(), "{tracked:?}");
}

#[test]
fn bare_tools_are_followed_through_a_recording() {
    const MOST_MM: f64 = 5.0;
    let scene = Folder::of("--marker bare --seed 5 --seconds 3 --size 960x540");
    let tracked = run(&scene, &format!("{TRACK} --out track.csv"));
    assert!(tracked.status.success(), "{tracked:?}");
    let truth = TruthFile::parse(&fs::read_to_string(scene.file("truth.json")).unwrap()).unwrap();
    let path = rows(&scene.file("track.csv"));
    for tool in ["left", "right"] {
        let tip_at = |number: u64| {
            let frame = truth.frames.iter().find(|frame| frame.frame == number).unwrap();
            Vector3::from(frame.tools.iter().find(|of| of.tool == tool).unwrap().tip_mm)
        };
        let rows: Vec<_> = path.iter().filter(|(_, name, _)| name == tool).collect();
        assert!(rows.len() >= 20, "{tool}: {} of 75 frames", rows.len());
        for (frame, _, at) in rows {
            let tip = tip_at(*frame);
            // Depth is known less well, so only the error across the line of sight counts.
            let off_mm = (Vector3::from(*at) - tip).cross(&tip.normalize()).norm();
            assert!(off_mm < MOST_MM, "{tool}, frame {frame}: {off_mm} mm");
        }
    }
}
