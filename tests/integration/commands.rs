//! The command line from the view of a user: its output on stdout and stderr, and its exit status.

use std::collections::BTreeSet;
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

/// Runs a command that must refuse its input: one line on stderr, nothing on stdout, status 2. Returns the line.
fn refusal(folder: &Path, line: &str) -> String {
    let output = trocar(folder, line);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{line}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{line}: {stderr}");
    assert!(output.stdout.is_empty(), "{line}");
    stderr
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

#[test]
fn the_true_frame_rate_or_duration_scales_all_times() {
    let folder = scene();
    let last_time = |options: &str| {
        let output = trocar(folder.path(), &format!("{TRACK}{options}"));
        assert!(output.status.success(), "{options}: {output:?}");
        let table = String::from_utf8(output.stdout).unwrap();
        table.lines().next_back().unwrap().split(',').nth(1).unwrap().parse::<f64>().unwrap()
    };
    assert!((last_time("") - 0.96).abs() < 1e-6);
    assert!((last_time(" --frame-rate 50") - 0.48).abs() < 1e-6);
    assert!((last_time(" --duration 1.92") - 1.92).abs() < 1e-6);
    let said = trocar(folder.path(), &format!("{} --out t.csv --frame-rate 50", TRACK.replace("--quiet ", "")));
    let said = String::from_utf8(said.stderr).unwrap();
    assert!(said.contains("all times of the file are multiplied by 0.5000"), "{said}");
    for (options, name) in [
        ("--frame-rate 0", "--frame-rate"),
        ("--duration 86400", "--duration"),
        ("--frame-rate 1000 --duration 5", "--duration"),
    ] {
        let output = trocar(folder.path(), &format!("{TRACK} {options}"));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && stderr.contains(name), "{options}: {stderr}");
    }
}

/// Keeps two of five rows, so that the coverage of the path is too low.
fn write_sparse_path(folder: &Path) {
    let text = fs::read_to_string(folder.join("track.csv")).unwrap();
    let kept = text.lines().enumerate().filter(|(line, _)| line % 5 < 2).map(|(_, row)| format!("{row}\n"));
    fs::write(folder.join("sparse.csv"), kept.collect::<String>()).unwrap();
}

#[test]
fn a_refused_path_has_reasons_instead_of_features() {
    let folder = scene();
    let track =
        trocar(folder.path(), &format!("{} --out track.csv --quality quality.json", TRACK.replace("--quiet ", "")));
    assert!(String::from_utf8_lossy(&track.stderr).contains("verdict: usable with care"), "{track:?}");
    let quality: Value = serde_json::from_slice(&fs::read(folder.path().join("quality.json")).unwrap()).unwrap();
    let reasons: Vec<&Value> = quality["reasons"].as_array().unwrap().iter().map(|reason| &reason["name"]).collect();
    let expected = ["no_trocar", "error_bar"]; // a resting tool shows no trocar, and it is small in the picture
    assert!(reasons.iter().all(|name| expected.iter().any(|expected| name == expected)), "{quality:#}");
    assert!(reasons.iter().any(|name| *name == "no_trocar"), "{quality:#}");
    assert_eq!(quality["tools"][0]["coverage"], 1.0, "{quality:#}");
    write_sparse_path(folder.path());
    let scored = trocar(folder.path(), "score --json sparse.csv");
    assert!(scored.status.success(), "a refused verdict is no error: {scored:?}");
    let sessions: Value = serde_json::from_slice(&scored.stdout).unwrap();
    assert_eq!((&sessions[0]["verdict"], &sessions[0]["reasons"][0]["name"]), (&"refused".into(), &"coverage".into()));
    let features = sessions[0]["features"].as_array().unwrap();
    assert!(!features.is_empty() && features.iter().all(|feature| feature["value"].is_null()), "{sessions:#}");
    let text = String::from_utf8(trocar(folder.path(), "score sparse.csv").stdout).unwrap();
    assert!(text.contains("refused") && !text.contains("path_length"), "{text}");
}

/// Writes the path of a tool that circles at a depth, in mm, with the columns that every tracker has.
fn write_circle(folder: &Path, name: &str, tool: &str, depth_mm: f64) {
    let row = |frame: u32| {
        let time_s = f64::from(frame) / 25.0;
        let (sin, cos) = (0.8 * time_s).sin_cos();
        format!("{frame},{time_s},{tool},{},{},{depth_mm}\n", 30.0 * cos, 30.0 * sin)
    };
    let rows: String = (0..500).map(row).collect();
    fs::write(folder.join(name), format!("frame,time_s,tool,x_mm,y_mm,z_mm\n{rows}")).unwrap();
}

#[test]
fn a_path_with_a_row_that_no_hand_reaches_is_refused_and_the_row_is_named() {
    let folder = tempfile::tempdir().unwrap();
    write_circle(folder.path(), "track.csv", "orange", 180.0);
    let good = fs::read_to_string(folder.path().join("track.csv")).unwrap();
    let row = good.lines().nth(11).unwrap();
    assert!(row.starts_with("10,0.4,orange,"), "{row}");
    fs::write(folder.path().join("wrong.csv"), good.replace(row, "10,0.4,orange,9998,0,180")).unwrap();
    let text = String::from_utf8(trocar(folder.path(), "score wrong.csv").stdout).unwrap();
    for words in
        ["verdict: refused", "orange: its path has a step of", "frame 10 (0.400 s)", "delete it and all others"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(!text.contains("path_length"), "{text}");
    let json = trocar(folder.path(), "score --json wrong.csv");
    let sessions: Value = serde_json::from_slice(&json.stdout).unwrap();
    let names: Vec<&str> =
        sessions[0]["reasons"].as_array().unwrap().iter().map(|reason| reason["name"].as_str().unwrap()).collect();
    assert_eq!((&sessions[0]["verdict"], names), (&"refused".into(), vec!["jump", "spike"]));
    assert!(sessions[0]["features"].as_array().unwrap().iter().all(|feature| feature["value"].is_null()));
}

#[test]
fn a_path_is_compared_with_a_reference_path() {
    let folder = tempfile::tempdir().unwrap();
    write_circle(folder.path(), "track.csv", "orange", 180.0);
    write_circle(folder.path(), "deeper.csv", "orange", 187.0);
    write_circle(folder.path(), "other.csv", "cyan", 180.0);
    let scored = trocar(folder.path(), "score --json --reference deeper.csv track.csv");
    let sessions: Value = serde_json::from_slice(&scored.stdout).unwrap();
    let deviation = &sessions[0]["reference"]["tools"][0];
    assert_eq!(deviation["tool"], "orange", "{sessions:#}");
    for figure in ["mean", "largest"] {
        assert!((deviation[figure].as_f64().unwrap() - 7.0).abs() < 1e-3, "{deviation}");
    }
    let text = String::from_utf8(trocar(folder.path(), "score --reference deeper.csv track.csv").stdout).unwrap();
    assert!(text.contains("strays from deeper.csv"), "{text}");
    assert!(refusal(folder.path(), "score --reference other.csv track.csv").contains("name them alike"));
}

/// Writes the path of a tool that circles for 20 s at 30 frames a second and rests from 8 s to 12 s, in the format of
/// `trocar track`.
fn write_resting_path(folder: &Path) {
    let mut csv = String::from(
        "frame,time_s,tool,x_mm,y_mm,z_mm,vx_mm_s,vy_mm_s,vz_mm_s,axis_x,axis_y,axis_z,tip_u_px,tip_v_px,sigma_xy_mm,sigma_z_mm,state\n",
    );
    for frame in 0..600 {
        let t = f64::from(frame) / 30.0;
        let angle = std::f64::consts::TAU * (t.min(8.0) + (t - 12.0).max(0.0)) / 4.0;
        let (x, y) = (25.0 * angle.cos(), 25.0 * angle.sin());
        csv += &format!("{frame},{t},left,{x},{y},180,,,,,,,,,0.02,0.05,observed\n");
    }
    fs::write(folder.join("resting.csv"), csv).unwrap();
}

#[test]
fn features_name_the_seconds_that_they_come_from() {
    let folder = tempfile::tempdir().unwrap();
    write_resting_path(folder.path());
    let plain = String::from_utf8(trocar(folder.path(), "score resting.csv").stdout).unwrap();
    assert!(!plain.contains("evidence"), "only with --evidence: {plain}");
    let text = String::from_utf8(trocar(folder.path(), "score --evidence resting.csv").stdout).unwrap();
    let line = text.lines().find(|line| line.contains("idle_share (3d) of left: rest")).expect(&text);
    let from: f64 = line.split("rest ").nth(1).unwrap().split('–').next().unwrap().parse().unwrap();
    assert!((from - 8.0).abs() < 0.3, "{line}");
    assert!(text.contains("– the whole task contributed equally: "), "{text}");
    let json = trocar(folder.path(), "score --json --evidence resting.csv");
    let sessions: Value = serde_json::from_slice(&json.stdout).unwrap();
    let rows = sessions[0]["evidence"].as_array().unwrap();
    let idle = rows.iter().find(|row| row["feature"] == "idle_share").unwrap();
    assert_eq!((&idle["what"], &idle["unit"], &idle["none"]), (&"rest".into(), &"s".into(), &Value::Null));
    assert!((idle["stretches"][0]["to_s"].as_f64().unwrap() - 12.0).abs() < 0.3, "{idle}");
}

#[test]
fn a_tool_in_another_colour_is_refused_but_its_path_is_written() {
    let folder = scene();
    change(folder.path(), "annotations.json", |marks| {
        let labels = marks["labels"].as_array_mut().unwrap();
        labels.retain(|label| label["label"] != "orange");
        let background = labels.iter().find(|label| label["label"] == "background").unwrap().clone();
        labels.push(background);
        labels.last_mut().unwrap()["label"] = "orange".into();
    });
    let track = trocar(folder.path(), &format!("{} --out track.csv", TRACK.replace("--quiet ", "")));
    let stderr = String::from_utf8(track.stderr).unwrap();
    assert_eq!(track.status.code(), Some(0), "{stderr}");
    assert!(stderr.contains("verdict: refused"), "{stderr}");
    assert!(fs::read_to_string(folder.path().join("track.csv")).unwrap().starts_with("frame,time_s,tool"), "{stderr}");
}

#[test]
fn a_report_is_one_page_beside_the_figures() {
    let folder = scene();
    assert!(trocar(folder.path(), &format!("{TRACK} --out track.csv")).status.success());
    let plain = trocar(folder.path(), "evaluate track.csv truth.json");
    let output = trocar(folder.path(), "evaluate --report report.html track.csv truth.json");
    assert!(output.status.success() && output.stdout == plain.stdout, "{output:?}");
    let page = fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("track.csv against truth.json"), "{page:.500}");
    let nowhere = trocar(folder.path(), "evaluate --report nowhere/report.html track.csv truth.json");
    let stderr = String::from_utf8(nowhere.stderr).unwrap();
    assert!(nowhere.status.code() == Some(1) && stderr.contains("nowhere/report.html"), "{stderr}");
}

#[test]
fn without_an_output_file_only_the_path_goes_to_stdout() {
    let output = trocar(SCENE.path(), TRACK);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("frame,time_s,tool,"), "{text:.80}");
    let with_progress = trocar(SCENE.path(), &TRACK.replace("--quiet ", ""));
    assert_eq!(String::from_utf8(with_progress.stdout).unwrap(), text);
    assert!(!with_progress.stderr.is_empty());
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
    let track = trocar(folder.path(), &format!("{TRACK} --debug-dir pictures/new --debug-frames 0,7,99"));
    assert!(track.status.success() && track.stderr.is_empty(), "{track:?}");
    assert_eq!(track.stdout, trocar(folder.path(), TRACK).stdout);
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
    let tip = tip_px(&track.stdout, 7).map(|px| px.round() as u32);
    let at_tip = |picture: &image::RgbImage| picture.get_pixel(tip[0], tip[1] + picture.height() - 720).0;
    const FIRST_TOOL: [u8; 3] = [255, 40, 255];
    assert_eq!(at_tip(&result), FIRST_TOOL, "the tool's cross is at {tip:?}");
    // Blur mixes the band's edge with its surroundings, so a few pixels at the tip do not have the tape's colour.
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

/// The tip's position on one frame of a path, pixels.
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
    let stderr = refusal(folder.path(), &format!("{TRACK} --debug-dir full"));
    assert!(stderr.contains("full: is not empty") && stderr.contains("name a new or an empty folder"), "{stderr}");
    let stderr = refusal(folder.path(), &format!("{TRACK} --debug-dir clip.mp4"));
    assert!(stderr.contains("clip.mp4"), "{stderr}");
    for alone in ["--debug-every 5", "--debug-frames 1", "--debug-dir new --debug-every 0"] {
        assert_eq!(trocar(folder.path(), &format!("{TRACK} {alone}")).status.code(), Some(2), "{alone}");
    }
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let folder = scene();
    for name in ["camera.json", "annotations.json", "clip.mp4"] {
        let stderr = refusal(folder.path(), &TRACK.replace(name, "absent.file"));
        assert!(stderr.contains("absent.file"), "{stderr}");
    }
}

#[test]
fn a_camera_of_another_picture_size_is_refused_with_both_sizes() {
    let folder = scene();
    change(folder.path(), "camera.json", |camera| camera["width"] = 1111.into());
    let stderr = refusal(folder.path(), TRACK);
    assert!(stderr.contains("1111") && stderr.contains("1280"), "{stderr}");
}

#[test]
fn a_mark_outside_the_picture_or_behind_the_last_frame_is_refused() {
    let folder = scene();
    change(folder.path(), "annotations.json", |marks| marks["labels"][0]["x"] = 5000.into());
    let stderr = refusal(folder.path(), TRACK);
    assert!(stderr.contains("annotations.json") && stderr.contains("5000"), "{stderr}");
    let folder = scene();
    change(folder.path(), "annotations.json", |marks| marks["labels"][0]["frame"] = 400.into());
    let stderr = refusal(folder.path(), TRACK);
    assert!(stderr.contains("400") && stderr.contains("25 frames"), "{stderr}");
}

/// Tracks the scene twice: with marks in the recording itself, and with marks in a copy of it, which is decoded up to
/// the last mark.
fn track_with_marks_in_clip_and_in_copy(folder: &Path) -> [String; 2] {
    fs::copy(folder.join("clip.mp4"), folder.join("copy.mp4")).unwrap();
    ["clip.mp4", "copy.mp4"].map(|marked| {
        change(folder, "annotations.json", |marks| marks["video"] = marked.into());
        let track = trocar(folder, TRACK);
        assert!(track.status.success(), "{track:?}");
        String::from_utf8(track.stdout).unwrap()
    })
}

#[test]
fn marks_in_the_recording_give_the_path_that_marks_in_a_copy_give() {
    let folder = scene();
    let [in_clip, in_copy] = track_with_marks_in_clip_and_in_copy(folder.path());
    assert!(in_clip.lines().count() > 25, "{in_clip}");
    assert_eq!(in_clip, in_copy);
}

#[test]
fn marks_count_only_decoded_frames_if_a_packet_holds_no_picture() {
    let folder = scene();
    let clip = folder.path().join("clip.mp4");
    let mut bytes = fs::read(&clip).unwrap();
    let slice = unreferenced_slice(&bytes);
    bytes[slice] = 12; // now it is filler, and its packet holds no picture
    fs::write(&clip, bytes).unwrap();
    let [in_clip, in_copy] = track_with_marks_in_clip_and_in_copy(folder.path());
    assert_eq!(in_clip, in_copy);
}

/// Offset of the header of the first slice that no other slice refers to, in an MP4 with one H.264 stream.
fn unreferenced_slice(mp4: &[u8]) -> usize {
    let mut at = mp4.windows(4).position(|name| name == b"mdat").unwrap() + 4;
    while mp4[at + 4] != 1 {
        at += 4 + u32::from_be_bytes(*mp4[at..].first_chunk().unwrap()) as usize;
    }
    at + 4
}

#[test]
fn a_file_that_is_no_recording_is_refused() {
    let folder = scene();
    fs::write(folder.path().join("clip.mp4"), "Dear diary, this is no video.\n".repeat(100)).unwrap();
    let stderr = refusal(folder.path(), TRACK);
    assert!(stderr.contains("clip.mp4"), "{stderr}");
}

#[test]
fn paths_and_truths_that_cannot_be_read_are_refused() {
    let folder = scene();
    let stderr = refusal(folder.path(), "evaluate truth.json clip.mp4");
    assert!(stderr.contains("truth.json"), "{stderr}");
    assert!(refusal(folder.path(), "evaluate truth.json").contains("track.csv"));
    fs::write(folder.path().join("empty.csv"), "").unwrap();
    assert!(refusal(folder.path(), "score --task any empty.csv").contains("empty.csv"));
}

#[test]
fn a_reference_method_refuses_tape_and_options_that_it_has_not() {
    let folder = scene();
    for method in ["mixture", "zhou"] {
        let stderr = refusal(folder.path(), &format!("{TRACK} --segmenter {method}"));
        assert!(stderr.contains("annotations.json") && stderr.contains("give a tool the marker `shaft`"), "{stderr}");
        for other in ["--raw", "--causal", "--pose width", "--quality quality.json", "--debug-dir pictures"] {
            let output = trocar(folder.path(), &format!("{TRACK} --segmenter {method} {other}"));
            let stderr = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(2), "{other}: {stderr}");
            assert!(stderr.contains("cannot be used with"), "{other}: {stderr}");
        }
    }
}

#[test]
fn wrong_usage_exits_with_status_2() {
    for line in ["", "dance", "track", "simulate --scene nowhere --out scene", "calibrate --board 9by6 a.jpg"] {
        assert_eq!(trocar(SCENE.path(), line).status.code(), Some(2), "{line}");
    }
}

#[test]
fn a_data_folder_that_cannot_be_made_is_named() {
    let output = trocar(SCENE.path(), "serve --listen 127.0.0.1:0 --data /proc/foo/x");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let expected = "opening the data folder `/proc/foo/x`: making the folder `/proc/foo/x`: No such file";
    assert!(stderr.contains(expected), "{stderr}");
}

#[test]
fn only_the_owner_may_read_the_services_files() {
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

/// Labels every second background rectangle as the tool, so that the tool has the colours of the box.
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
fn good_colours_are_reported_in_a_table_or_as_json() {
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
fn a_bad_colour_fails_the_check_after_its_table_and_gives_a_warning_before_tracking() {
    let folder = scene();
    spoil_colours(folder.path());
    let output = trocar(folder.path(), "palette --check annotations.json");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(String::from_utf8(output.stdout).unwrap().contains("is bad: "));
    let track = trocar(folder.path(), &TRACK.replace("--quiet ", ""));
    let stderr = String::from_utf8(track.stderr).unwrap();
    assert!(stderr.starts_with("warning: the colour `") && stderr.contains("is bad: "), "{stderr}");
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
fn input_that_the_palette_command_cannot_use_is_named() {
    let folder = scene();
    for name in ["annotations.json", "absent.png"] {
        let stderr = refusal(folder.path(), &format!("palette --advise {name}"));
        assert!(stderr.contains(name), "{stderr}");
    }
    change(folder.path(), "annotations.json", |marks| drop(marks.as_object_mut().unwrap().remove("video")));
    let stderr = refusal(folder.path(), "palette --check annotations.json");
    assert!(stderr.contains("names no `video`"), "{stderr}");
    assert!(trocar(folder.path(), "palette --check annotations.json clip.mp4").status.success());
    assert_eq!(trocar(folder.path(), "palette").status.code(), Some(2));
}

/// The help of a command and of all its subcommands, by command line.
fn helps(line: &str, found: &mut Vec<(String, String)>) {
    let output = trocar(Path::new("."), format!("{line} --help").trim_start());
    assert!(output.status.success(), "trocar {line} --help");
    let text = String::from_utf8(output.stdout).unwrap();
    let listed = text.lines().skip_while(|row| *row != "Commands:").skip(1).take_while(|row| !row.is_empty());
    let names = listed.filter(|row| row.starts_with("  ") && !row.starts_with("   "));
    let names: Vec<String> = names.filter_map(|row| row.split_whitespace().next().map(str::to_owned)).collect();
    found.push((line.to_owned(), text));
    for name in names.iter().filter(|name| *name != "help") {
        helps(format!("{line} {name}").trim_start(), found);
    }
}

#[test]
fn every_option_has_a_help_text_without_a_path_into_the_docs_and_those_of_the_docs_exist() {
    let mut found = Vec::new();
    helps("", &mut found);
    assert!(found.len() > 25, "{found:?}");
    let mut options: BTreeSet<String> = BTreeSet::new();
    for (line, text) in &found {
        assert!(!text.contains("docs/"), "the help of `{line}` must say it itself:\n{text}");
        let rows: Vec<&str> = text.lines().collect();
        for (at, row) in rows.iter().enumerate().filter(|(_, row)| row.trim_start().starts_with('-')) {
            let Some((_, name)) = row.split_once("--") else { continue };
            let name = name.split([' ', ',']).next().unwrap();
            options.insert(format!("--{name}"));
            let (_, rest) = row.split_once(&format!("--{name}")).unwrap();
            let is_said_here = rest.trim_start().trim_start_matches(|sign| sign != ' ').trim_start().len() > 3;
            let is_said_below =
                rows.get(at + 1).is_some_and(|next| next.trim().len() > 3 && !next.trim().starts_with('-'));
            assert!(is_said_here || is_said_below, "`{line}`: --{name} has no help text:\n{text}");
        }
    }
    let docs = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/command_line.md")).unwrap();
    let named = docs.split([' ', '`', '[', ']', '(', ')', ',', ';', '\n']).filter(|word| word.starts_with("--"));
    let named: BTreeSet<&str> = named.map(|word| word.trim_end_matches(['.', ':'])).collect();
    let missing: Vec<&&str> = named.iter().filter(|name| !options.contains(**name)).collect();
    assert!(named.len() > 30 && missing.is_empty(), "docs/command_line.md names unknown options: {missing:?}");
}
