use std::fs;

use super::*;
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::files::camera::CameraFile;
use crate::domain::files::truth::TruthFile;
use crate::media::{MediaLimits, VideoFile};

fn tiny(scenario: Scenario) -> SceneOrder {
    let setup = Setup { width: 256, height: 144, ..Setup::new(scenario, Skill::NOVICE, 3) };
    SceneOrder { frames: Some(8), boards: 2, bent: 1, evenness: Evenness::Uneven, ..SceneOrder::new(setup) }
}

#[test]
fn a_scene_is_whole_and_its_files_agree_with_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/scene");
    let times = write_scene(&path, &tiny(Scenario::Rectangle), &mut |_, _, _| {}).unwrap();
    let text = |name: &str| fs::read_to_string(path.join(name)).unwrap();
    let camera = CameraFile::parse(&text("camera.json")).unwrap().camera();
    let truth = TruthFile::parse(&text("truth.json")).unwrap();
    let annotations = AnnotationsFile::parse(&text("annotations.json")).unwrap();
    annotations.check_inside(camera.width, camera.height).unwrap();
    let names: Vec<String> = annotations.marked_tools().unwrap().into_iter().map(|t| t.name).collect();
    assert_eq!(names, ["orange", "cyan"]);

    let clip = fs::File::open(path.join(annotations.video.unwrap())).unwrap();
    let mut video = VideoFile::open(clip, MediaLimits::default()).unwrap();
    assert_eq!((video.info().width, video.info().height), (camera.width, camera.height));
    let mut decoded = Vec::new();
    while let Some(picture) = video.next_picture().unwrap() {
        decoded.push(picture.frame().time_s);
    }
    let listed: Vec<f64> = truth.frames.iter().map(|f| f.time_s).collect();
    assert_eq!(listed, times);
    assert_eq!(decoded.len(), 8);
    assert!(decoded.iter().zip(&listed).all(|(a, b)| (a - b).abs() < 1e-5), "{decoded:?} against {listed:?}");

    for board in ["boards/board_01.jpg", "boards/board_02.jpg"] {
        let photo = image::open(path.join(board)).unwrap();
        assert_eq!((photo.width(), photo.height()), (camera.width, camera.height));
    }
}

#[test]
fn a_scene_of_bare_tools_has_their_annotations_and_a_picture_of_the_empty_box() {
    let folder = tempfile::tempdir().unwrap();
    let order = tiny(Scenario::Rectangle);
    let setup = Setup { marker: SimulatedMarker::Bare, ..order.setup };
    write_scene(folder.path(), &SceneOrder { setup, boards: 0, ..order }, &mut |_, _, _| {}).unwrap();
    let text = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let annotations: serde_json::Value = serde_json::from_str(&text("annotations.json")).unwrap();
    let tool = |side: &str| {
        let marker = serde_json::json!({"kind": "shaft", "collar_mm": 8.0});
        serde_json::json!({"tool": side, "side": side, "diameter_mm": 5.0, "marker": marker})
    };
    assert_eq!(annotations["needs"], 2);
    assert_eq!(annotations["tools"], serde_json::json!([tool("left"), tool("right")]));
    let labels: std::collections::BTreeSet<&str> =
        annotations["labels"].as_array().unwrap().iter().filter_map(|mark| mark["label"].as_str()).collect();
    assert_eq!(labels.into_iter().collect::<Vec<_>>(), ["background", "shaft"]);
    let empty = image::open(folder.path().join(annotations["empty_box"].as_str().unwrap())).unwrap();
    assert_eq!((empty.width(), empty.height()), (256, 144));
    let truth = TruthFile::parse(&text("truth.json")).unwrap();
    let names: Vec<&str> = truth.frames[0].tools.iter().map(|tool| tool.tool.as_str()).collect();
    assert_eq!(names, ["left", "right"]);
}

#[test]
fn a_scene_written_twice_is_the_same_to_the_byte() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str| {
        write_scene(&folder.path().join(name), &tiny(Scenario::Pegs), &mut |_, _, _| {}).unwrap();
    };
    write("a");
    write("b");
    assert!(!folder.path().join("a").join(bare::EMPTY_BOX).exists(), "taped tools need no picture of the empty box");
    for name in ["clip.mp4", "truth.json", "annotations.json", "camera.json", "boards/board_02.jpg"] {
        let read = |run: &str| fs::read(folder.path().join(run).join(name)).unwrap();
        assert!(read("a") == read("b"), "{name} differs");
    }
}

#[test]
fn marks_lie_on_what_they_name() {
    let order = tiny(Scenario::Crossing);
    let world = crate::simulation::World::new(&Setup { width: 1280, height: 720, ..order.setup });
    let renderer = crate::simulation::render::Renderer::new(&world);
    let times: Vec<f64> = (0..60).map(|i| f64::from(i) * 0.1).collect();
    let marks = crate::simulation::marks::mark_recording(&world, &times);
    for (name, blue, red) in [("orange", false, true), ("cyan", true, false)] {
        let of_tape: Vec<_> = marks.iter().filter(|m| m.label == name).collect();
        assert!(of_tape.len() >= 9, "{} marks on {name}", of_tape.len());
        for mark in of_tape {
            let picture = renderer.render(times[mark.frame]);
            let frame = picture.frame(0, 0.0);
            for (x, y) in [(mark.x, mark.y), (mark.x + mark.w - 1, mark.y + mark.h - 1), (mark.x + mark.w / 2, mark.y)]
            {
                let [_, u, v] = frame.yuv_at(x as usize, y as usize);
                assert_eq!((u > 135, v > 150), (blue, red), "{name} at {x}, {y} of frame {}: U {u}, V {v}", mark.frame);
            }
        }
    }
}

#[test]
fn impossible_scenes_are_refused_with_the_possible_values() {
    let parse = |more: &[&str]| {
        let words = ["simulate", "--out", "/nowhere"].iter().chain(more).copied();
        let cli = <TestCli as clap::Parser>::try_parse_from(words).map_err(|e| e.to_string())?;
        scene_order(&cli.args).map_err(|e| e.to_string())
    };
    let refusal = |more: &[&str]| parse(more).unwrap_err();
    assert!(
        refusal(&["--scene", "surgery"])
            .contains("wire, rectangle, approach, slide, rest, pegs, crossing, exchange, self-test")
    );
    assert!(refusal(&["--scene", "wire", "--skill", "god"]).contains("novice, intermediate, expert"));
    assert!(refusal(&["--scene", "wire", "--size", "99999x2"]).contains("1280x720"));
    assert!(refusal(&["--scene", "wire", "--size", "641x361"]).contains("yuv444p"));
    assert!(refusal(&["--scene", "wire", "--tapes", "orange"]).contains("two tapes"));
    assert!(refusal(&["--scene", "wire", "--marker", "tape"]).contains("band, bare"));
    assert!(refusal(&["--scene", "wire", "--shaft", "red"]).contains("black, grey, white"));
    assert!(refusal(&["--scene", "wire", "--marker", "bare", "--tapes", "cyan,lime"]).contains("leave out --tapes"));
    assert_eq!(parse(&["--scene", "wire", "--marker", "bare"]).unwrap().setup.marker, SimulatedMarker::Bare);
    assert!(refusal(&["--scene", "wire", "--frames", "0"]).contains("--frames"));
    assert!(refusal(&["--scene", "wire", "--frames", "9", "--seconds", "2"]).contains("cannot be used with"));
    assert_eq!(parse(&["--scene", "wire", "--seconds", "2", "--fps", "30"]).unwrap().frames, Some(60));
}

#[derive(clap::Parser)]
struct TestCli {
    #[command(flatten)]
    args: SimulateArgs,
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    let path = folder.path().join("file/scene");
    let error = write_scene(&path, &tiny(Scenario::Wire), &mut |_, _, _| {}).unwrap_err();
    assert!(format!("{error:#}").contains("cannot make the folder"), "{error:#}");
}
