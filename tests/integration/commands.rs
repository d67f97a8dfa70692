//! The command line as a person meets it: what it prints where, and its exit status.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::LazyLock;

use serde_json::Value;
use tempfile::TempDir;

use crate::process::Process;

/// A short simulated scene, made by the program itself: clip.mp4, camera.json, annotations.json, truth.json.
static SCENE: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let order = "simulate --quiet --scene rest --seed 3 --seconds 1 --boards 0 --out .";
    assert!(trocar(folder.path(), order).status.success());
    folder
});

/// Runs the program in a folder; the command line is split at blanks.
fn trocar(folder: &Path, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trocar")).args(line.split(' ')).current_dir(folder).output().unwrap()
}

/// A folder with a copy of the scene.
fn scene() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.mp4", "camera.json", "annotations.json", "truth.json"] {
        fs::copy(SCENE.path().join(name), folder.path().join(name)).unwrap();
    }
    folder
}

/// Changes one of the scene's JSON files.
fn change(folder: &Path, name: &str, change: impl Fn(&mut Value)) {
    let mut value: Value = serde_json::from_slice(&fs::read(folder.join(name)).unwrap()).unwrap();
    change(&mut value);
    fs::write(folder.join(name), value.to_string()).unwrap();
}

/// What the program says of input that it cannot use: one line on stderr, nothing on stdout, status 2.
fn refusal(folder: &Path, line: &str) -> String {
    let output = trocar(folder, line);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{line}: {said}");
    assert_eq!(said.trim_end().lines().count(), 1, "{line}: {said}");
    assert!(output.stdout.is_empty(), "{line}");
    said
}

const TRACK: &str = "track --quiet --camera camera.json --annotations annotations.json clip.mp4";

#[test]
fn a_recording_becomes_a_path_that_can_be_judged_and_scored() {
    let folder = scene();
    let track = trocar(folder.path(), &format!("{TRACK} --out track.csv --timings timings.json"));
    assert!(track.status.success() && track.stdout.is_empty() && track.stderr.is_empty(), "{track:?}");
    let timings: Value = serde_json::from_slice(&fs::read(folder.path().join("timings.json")).unwrap()).unwrap();
    assert_eq!(timings["frames"], 25);
    let stages: f64 = timings["wall_ms_of"].as_object().unwrap().values().map(|ms| ms.as_f64().unwrap()).sum();
    let wall = timings["wall_ms"].as_f64().unwrap();
    assert!(stages <= wall && wall - stages < 0.1 * wall, "the stages take {stages} of {wall} ms");
    let evaluated = trocar(folder.path(), "evaluate --json track.csv truth.json");
    let figures: Value = serde_json::from_slice(&evaluated.stdout).unwrap();
    assert_eq!(figures["all"]["levels"][0]["coverage"], 1.0, "{figures:#}");
    let scored = trocar(folder.path(), "score --task resting track.csv");
    assert!(scored.status.success() && !scored.stdout.is_empty(), "{scored:?}");
}

/// Keeps two rows of five, so that too little of the path was seen.
fn thin(folder: &Path) {
    let text = fs::read_to_string(folder.join("track.csv")).unwrap();
    let kept = text.lines().enumerate().filter(|(line, _)| line % 5 < 2).map(|(_, row)| format!("{row}\n"));
    fs::write(folder.join("thin.csv"), kept.collect::<String>()).unwrap();
}

#[test]
fn a_refused_path_has_reasons_instead_of_features() {
    let folder = scene();
    let track =
        trocar(folder.path(), &format!("{} --out track.csv --quality quality.json", TRACK.replace("--quiet ", "")));
    assert!(String::from_utf8_lossy(&track.stderr).contains("verdict: valid"), "{track:?}");
    let quality: Value = serde_json::from_slice(&fs::read(folder.path().join("quality.json")).unwrap()).unwrap();
    assert_eq!((&quality["verdict"], &quality["tools"][0]["coverage"]), (&"valid".into(), &1.0.into()), "{quality:#}");
    thin(folder.path());
    let scored = trocar(folder.path(), "score --json thin.csv");
    assert!(scored.status.success(), "it was judged: {scored:?}");
    let sessions: Value = serde_json::from_slice(&scored.stdout).unwrap();
    assert_eq!((&sessions[0]["verdict"], &sessions[0]["reasons"][0]["name"]), (&"refused".into(), &"coverage".into()));
    let features = sessions[0]["features"].as_array().unwrap();
    assert!(!features.is_empty() && features.iter().all(|feature| feature["value"].is_null()), "{sessions:#}");
    let text = String::from_utf8(trocar(folder.path(), "score thin.csv").stdout).unwrap();
    assert!(text.contains("refused") && !text.contains("path_length"), "{text}");
}

/// A tool that circles at a depth, in mm, as any tracker could write it.
fn circle(folder: &Path, name: &str, tool: &str, depth_mm: f64) {
    let row = |frame: u32| {
        let time_s = f64::from(frame) / 25.0;
        let (sin, cos) = (0.8 * time_s).sin_cos();
        format!("{frame},{time_s},{tool},{},{},{depth_mm}\n", 30.0 * cos, 30.0 * sin)
    };
    let rows: String = (0..500).map(row).collect();
    fs::write(folder.join(name), format!("frame,time_s,tool,x_mm,y_mm,z_mm\n{rows}")).unwrap();
}

#[test]
fn a_path_is_held_against_one_that_shows_how_it_should_go() {
    let folder = tempfile::tempdir().unwrap();
    circle(folder.path(), "track.csv", "orange", 180.0);
    circle(folder.path(), "deeper.csv", "orange", 187.0);
    circle(folder.path(), "other.csv", "cyan", 180.0);
    let scored = trocar(folder.path(), "score --json --reference deeper.csv track.csv");
    let sessions: Value = serde_json::from_slice(&scored.stdout).unwrap();
    let strays = &sessions[0]["reference"]["tools"][0];
    assert_eq!(strays["tool"], "orange", "{sessions:#}");
    for figure in ["mean", "largest"] {
        assert!((strays[figure].as_f64().unwrap() - 7.0).abs() < 1e-3, "{strays}");
    }
    let text = String::from_utf8(trocar(folder.path(), "score --reference deeper.csv track.csv").stdout).unwrap();
    assert!(text.contains("strays from deeper.csv"), "{text}");
    assert!(refusal(folder.path(), "score --reference other.csv track.csv").contains("name them alike"));
}

/// Strokes round a ring at 30 a second for 20 s, with a rest from 8 s to 12 s, as `trocar track` writes them.
fn resting(folder: &Path) {
    let mut csv = String::from(
        "frame,time_s,tool,x_mm,y_mm,z_mm,vx_mm_s,vy_mm_s,vz_mm_s,axis_x,axis_y,axis_z,tip_u_px,tip_v_px,sigma_xy_mm,sigma_z_mm,state\n",
    );
    for frame in 0..600 {
        let t = f64::from(frame) / 30.0;
        let turn = std::f64::consts::TAU * (t.min(8.0) + (t - 12.0).max(0.0)) / 4.0;
        let (x, y) = (25.0 * turn.cos(), 25.0 * turn.sin());
        csv += &format!("{frame},{t},left,{x},{y},180,,,,,,,,,0.02,0.05,observed\n");
    }
    fs::write(folder.join("resting.csv"), csv).unwrap();
}

#[test]
fn features_point_to_the_seconds_that_made_them() {
    let folder = tempfile::tempdir().unwrap();
    resting(folder.path());
    let plain = String::from_utf8(trocar(folder.path(), "score resting.csv").stdout).unwrap();
    assert!(!plain.contains("evidence"), "only where it is asked for: {plain}");
    let text = String::from_utf8(trocar(folder.path(), "score --evidence resting.csv").stdout).unwrap();
    let line = text.lines().find(|line| line.contains("idle_share (3d) of left: rest")).expect(&text);
    let from: f64 = line.split("rest ").nth(1).unwrap().split('–').next().unwrap().parse().unwrap();
    assert!((from - 8.0).abs() < 0.3, "{line}");
    assert!(text.contains("– the whole task made it alike: "), "{text}");
    let json = trocar(folder.path(), "score --json --evidence resting.csv");
    let sessions: Value = serde_json::from_slice(&json.stdout).unwrap();
    let rows = sessions[0]["evidence"].as_array().unwrap();
    let idle = rows.iter().find(|row| row["feature"] == "idle_share").unwrap();
    assert_eq!((&idle["what"], &idle["unit"], &idle["none"]), (&"rest".into(), &"s".into(), &Value::Null));
    assert!((idle["stretches"][0]["to_s"].as_f64().unwrap() - 12.0).abs() < 0.3, "{idle}");
}

#[test]
fn a_tool_in_another_colour_is_refused_but_what_was_tracked_is_written() {
    let folder = scene();
    change(folder.path(), "annotations.json", |marks| {
        let labels = marks["labels"].as_array_mut().unwrap();
        labels.retain(|label| label["label"] != "orange");
        let background = labels.iter().find(|label| label["label"] == "background").unwrap().clone();
        labels.push(background);
        labels.last_mut().unwrap()["label"] = "orange".into();
    });
    let track = trocar(folder.path(), &format!("{} --out track.csv", TRACK.replace("--quiet ", "")));
    let said = String::from_utf8(track.stderr).unwrap();
    assert_eq!(track.status.code(), Some(0), "{said}");
    assert!(said.contains("verdict: refused"), "{said}");
    assert!(fs::read_to_string(folder.path().join("track.csv")).unwrap().starts_with("frame,time_s,tool"), "{said}");
}

#[test]
fn a_report_is_one_page_beside_the_figures() {
    let folder = scene();
    assert!(trocar(folder.path(), &format!("{TRACK} --out track.csv")).status.success());
    let plain = trocar(folder.path(), "evaluate track.csv truth.json");
    let output = trocar(folder.path(), "evaluate --report report.html track.csv truth.json");
    assert!(output.status.success() && output.stdout == plain.stdout, "{output:?}");
    let page = fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.starts_with("<!doctype html>") && page.contains("track.csv against truth.json"), "{page:.500}");
    let nowhere = trocar(folder.path(), "evaluate --report nowhere/report.html track.csv truth.json");
    let said = String::from_utf8(nowhere.stderr).unwrap();
    assert!(nowhere.status.code() == Some(1) && said.contains("nowhere/report.html"), "{said}");
}

#[test]
fn without_a_file_to_write_to_the_path_goes_to_stdout_and_nothing_else_does() {
    let output = trocar(SCENE.path(), TRACK);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("frame,time_s,tool,"), "{text:.80}");
    let loud = trocar(SCENE.path(), &TRACK.replace("--quiet ", ""));
    assert_eq!(String::from_utf8(loud.stdout).unwrap(), text);
    assert!(!loud.stderr.is_empty());
}

#[test]
fn two_tools_with_the_same_good_tape_pass_the_check() {
    let folder = tempfile::tempdir().unwrap();
    let order = "simulate --quiet --scene exchange --tapes orange,orange --seed 4 --seconds 5 --size 640x360";
    assert!(trocar(folder.path(), &format!("{order} --boards 0 --out .")).status.success());
    let check = trocar(folder.path(), "palette --check annotations.json --json");
    let report: Value = serde_json::from_slice(&check.stdout).unwrap();
    let verdict = &report["verdicts"][0];
    assert_eq!((&verdict["tool"], &verdict["grade"]), (&"orange".into(), &"good".into()), "{verdict}");
    assert!(verdict["false_area"]["largest_of_band"].as_f64().is_some_and(|bands| bands < 0.2), "{verdict}");
    assert!(check.status.success() && check.stderr.is_empty(), "{check:?}");
}

#[test]
fn debug_pictures_show_the_chosen_frames_stage_by_stage_and_change_no_result() {
    let folder = scene();
    let said = trocar(folder.path(), &format!("{TRACK} --debug-dir pictures/new --debug-frames 0,7,99"));
    assert!(said.status.success() && said.stderr.is_empty(), "{said:?}");
    assert_eq!(said.stdout, trocar(folder.path(), TRACK).stdout);
    let pictures = folder.path().join("pictures/new");
    let mut names: Vec<String> =
        fs::read_dir(&pictures).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let stages = ["1_colours", "2_edges_tool1_fit1", "3_result"];
    let of_frames = ["000000", "000007"].map(|frame| stages.map(|stage| format!("frame_{frame}_{stage}.png")));
    assert_eq!(names, of_frames.as_flattened());
    let drawn = |stage: &str| image::open(pictures.join(format!("frame_000007_{stage}.png"))).unwrap().into_rgb8();
    let result = drawn("3_result");
    assert!(result.width() == 1280 && result.height() > 720, "the picture and its legend");
    let tip = tip_px(&said.stdout, 7).map(|px| px.round() as u32);
    let at_tip = |picture: &image::RgbImage| picture.get_pixel(tip[0], tip[1] + picture.height() - 720).0;
    const FIRST_TOOL: [u8; 3] = [255, 40, 255];
    assert_eq!(at_tip(&result), FIRST_TOOL, "its cross is at {tip:?}");
    // Blur mixes the band's rim with what is beside it, so that a little is no tape's at the tip itself.
    let colours = drawn("1_colours");
    let band = |at: &(u32, u32, &image::Rgb<u8>)| at.2.0 == FIRST_TOOL && at.1 > colours.height() - 720;
    let nearest = colours
        .enumerate_pixels()
        .filter(band)
        .map(|(x, y, _)| x.abs_diff(tip[0]).max((y + 720 - colours.height()).abs_diff(tip[1])));
    assert!(nearest.clone().min().unwrap() < 12 && nearest.clone().count() > 400, "the band's cells begin at the tip");
    let edges = drawn("2_edges_tool1_fit1");
    let count = |ink: [u8; 3]| edges.pixels().filter(|pixel| pixel.0 == ink).count();
    let (agree, elsewhere) = (count([70, 230, 70]), count([255, 60, 60]));
    assert!(agree > 1000 && agree > 5 * elsewhere, "{agree} green pixels and {elsewhere} red ones on clean tape");
}

/// Where a path has the tip on a frame, pixels.
fn tip_px(csv: &[u8], frame: u32) -> [f64; 2] {
    let text = String::from_utf8(csv.to_vec()).unwrap();
    let row = text.lines().find(|line| line.starts_with(&format!("{frame},"))).unwrap();
    [12, 13].map(|column| row.split(',').nth(column).unwrap().parse().unwrap())
}

#[test]
fn a_folder_that_debug_pictures_cannot_use_is_named_before_anything_is_tracked() {
    let folder = scene();
    fs::create_dir(folder.path().join("full")).unwrap();
    fs::write(folder.path().join("full/notes.txt"), "mine").unwrap();
    let said = refusal(folder.path(), &format!("{TRACK} --debug-dir full"));
    assert!(said.contains("full: is not empty") && said.contains("name a new or an empty folder"), "{said}");
    let said = refusal(folder.path(), &format!("{TRACK} --debug-dir clip.mp4"));
    assert!(said.contains("clip.mp4"), "{said}");
    for alone in ["--debug-every 5", "--debug-frames 1", "--debug-dir new --debug-every 0"] {
        assert_eq!(trocar(folder.path(), &format!("{TRACK} {alone}")).status.code(), Some(2), "{alone}");
    }
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let folder = scene();
    for name in ["camera.json", "annotations.json", "clip.mp4"] {
        let said = refusal(folder.path(), &TRACK.replace(name, "absent.file"));
        assert!(said.contains("absent.file"), "{said}");
    }
}

#[test]
fn a_camera_of_another_picture_size_is_refused_with_both_sizes() {
    let folder = scene();
    change(folder.path(), "camera.json", |camera| camera["width"] = 1111.into());
    let said = refusal(folder.path(), TRACK);
    assert!(said.contains("1111") && said.contains("1280"), "{said}");
}

#[test]
fn a_mark_outside_the_picture_or_behind_the_last_frame_is_refused() {
    let folder = scene();
    change(folder.path(), "annotations.json", |marks| marks["labels"][0]["x"] = 5000.into());
    let said = refusal(folder.path(), TRACK);
    assert!(said.contains("annotations.json") && said.contains("5000"), "{said}");
    let folder = scene();
    change(folder.path(), "annotations.json", |marks| marks["labels"][0]["frame"] = 400.into());
    let said = refusal(folder.path(), TRACK);
    assert!(said.contains("400") && said.contains("25 frames"), "{said}");
}

/// Tracks the scene twice: marked in the recording itself, and in a copy of it, which is decoded up to the last mark.
fn tracked_with_marks_here_and_in_a_copy(folder: &Path) -> [String; 2] {
    fs::copy(folder.join("clip.mp4"), folder.join("copy.mp4")).unwrap();
    ["clip.mp4", "copy.mp4"].map(|marked| {
        change(folder, "annotations.json", |marks| marks["video"] = marked.into());
        let track = trocar(folder, TRACK);
        assert!(track.status.success(), "{track:?}");
        String::from_utf8(track.stdout).unwrap()
    })
}

#[test]
fn marked_frames_decoded_in_passing_give_the_path_that_counting_up_to_them_gives() {
    let folder = scene();
    let [here, in_copy] = tracked_with_marks_here_and_in_a_copy(folder.path());
    assert!(here.lines().count() > 25, "{here}");
    assert_eq!(here, in_copy);
}

#[test]
fn marks_count_the_frames_that_come_where_a_packet_gives_none() {
    let folder = scene();
    let clip = folder.path().join("clip.mp4");
    let mut bytes = fs::read(&clip).unwrap();
    let lost = slice_to_which_no_other_refers(&bytes);
    bytes[lost] = 12; // now it is filler, and its packet holds no picture
    fs::write(&clip, bytes).unwrap();
    let [here, in_copy] = tracked_with_marks_here_and_in_a_copy(folder.path());
    assert_eq!(here, in_copy);
}

/// Where the first such slice's head lies in an MP4 whose media are one stream of H.264.
fn slice_to_which_no_other_refers(mp4: &[u8]) -> usize {
    let mut at = mp4.windows(4).position(|name| name == b"mdat").unwrap() + 4;
    while mp4[at + 4] != 1 {
        at += 4 + u32::from_be_bytes(*mp4[at..].first_chunk().unwrap()) as usize;
    }
    at + 4
}

#[test]
fn what_is_no_recording_is_refused() {
    let folder = scene();
    fs::write(folder.path().join("clip.mp4"), "Dear diary, this is no video.\n".repeat(100)).unwrap();
    let said = refusal(folder.path(), TRACK);
    assert!(said.contains("clip.mp4"), "{said}");
}

#[test]
fn paths_and_truths_that_cannot_be_read_are_refused() {
    let folder = scene();
    let said = refusal(folder.path(), "evaluate truth.json clip.mp4");
    assert!(said.contains("truth.json"), "{said}");
    assert!(refusal(folder.path(), "evaluate truth.json").contains("track.csv"));
    fs::write(folder.path().join("empty.csv"), "").unwrap();
    assert!(refusal(folder.path(), "score --task any empty.csv").contains("empty.csv"));
}

#[test]
fn wrong_usage_has_the_status_of_wrong_usage() {
    for line in ["", "dance", "track", "simulate --scene nowhere --out scene", "calibrate --board 9by6 a.jpg"] {
        assert_eq!(trocar(SCENE.path(), line).status.code(), Some(2), "{line}");
    }
}

#[test]
fn what_the_service_writes_is_its_owners_alone() {
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), Permissions::from_mode(0o755)).unwrap();
    let _service = Process::start(folder.path());
    let mut seen = 0;
    for entry in fs::read_dir(folder.path()).unwrap().map(Result::unwrap) {
        let mode = entry.metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0, "{} is {mode:o}", entry.path().display());
        seen += 1;
    }
    assert!(seen >= 4, "database, ballast, blobs, uploads");
}

/// Calls every second background rectangle the tool: its colour becomes the box's.
fn spoil_colours(folder: &Path) {
    change(folder, "annotations.json", |marks| {
        let labels = marks["labels"].as_array_mut().unwrap();
        let tool = labels.iter().find(|l| l["label"] != "background" && l["label"] != "shaft" && l["label"] != "jaw");
        let tool = tool.unwrap()["label"].clone();
        let background = labels.iter_mut().filter(|label| label["label"] == "background");
        background.step_by(2).for_each(|label| label["label"] = tool.clone());
    });
}

#[test]
fn good_colours_are_told_in_a_table_or_as_json() {
    let check = "palette --check annotations.json";
    let output = trocar(SCENE.path(), check);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{text}");
    assert!(text.contains("background") && text.contains("30 % darker") && text.contains("good"), "{text}");
    let report: Value = serde_json::from_slice(&trocar(SCENE.path(), &format!("{check} --json")).stdout).unwrap();
    assert_eq!((&report["verdicts"][0]["grade"], &report["warnings"]), (&"good".into(), &Value::Array(vec![])));
    let row = &report["confusion"][0]["lights"][0];
    let shares = [&row["no_tool"], &row["tools"][0]["share"]].map(|share| share.as_f64().unwrap());
    assert!((shares[0] + shares[1] - 1.0).abs() < 1e-9, "{row}");
}

#[test]
fn a_bad_colour_fails_the_check_after_its_table_and_is_told_before_tracking() {
    let folder = scene();
    spoil_colours(folder.path());
    let output = trocar(folder.path(), "palette --check annotations.json");
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(String::from_utf8(output.stdout).unwrap().contains("is bad: "));
    let track = trocar(folder.path(), &TRACK.replace("--quiet ", ""));
    let said = String::from_utf8(track.stderr).unwrap();
    assert!(said.starts_with("warning: the colour `") && said.contains("is bad: "), "{said}");
}

#[test]
fn advice_takes_a_photo_or_a_video() {
    let folder = scene();
    image::RgbImage::from_pixel(64, 48, image::Rgb([204, 6, 5])).save(folder.path().join("red.png")).unwrap();
    let text = String::from_utf8(trocar(folder.path(), "palette --advise red.png").stdout).unwrap();
    assert!(text.contains("For one tool take ") && text.contains("Do not take red: 100.00 %"), "{text}");
    let advice: Value =
        serde_json::from_slice(&trocar(folder.path(), "palette --advise clip.mp4 --json").stdout).unwrap();
    assert_eq!((advice["tapes"].as_array().unwrap().len(), advice["pairs"].as_array().unwrap().len()), (10, 45));
}

#[test]
fn what_the_palette_command_cannot_use_is_named() {
    let folder = scene();
    for name in ["annotations.json", "absent.png"] {
        let said = refusal(folder.path(), &format!("palette --advise {name}"));
        assert!(said.contains(name), "{said}");
    }
    change(folder.path(), "annotations.json", |marks| drop(marks.as_object_mut().unwrap().remove("video")));
    let said = refusal(folder.path(), "palette --check annotations.json");
    assert!(said.contains("names no `video`"), "{said}");
    assert!(trocar(folder.path(), "palette --check annotations.json clip.mp4").status.success());
    assert_eq!(trocar(folder.path(), "palette").status.code(), Some(2));
}
