//! A recording is measured as players show it: turned, mirrored, trimmed, with pixels of any shape.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::child::clips::ffmpeg;
use crate::process::program;
use crate::resources::shared;

/// A simulated scene: clip.mp4, camera.json, annotations.json.
fn scene() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let arguments = "simulate --quiet --scene pegs --skill expert --seed 4 --seconds 1 --boards 0 --out .";
    let made = program().args(arguments.split(' ')).current_dir(folder.path()).status().unwrap();
    assert!(made.success());
    folder
}

/// Tracks a clip with a folder's camera and annotations: the path, and the names of the findings.
fn track(folder: &Path, clip: &Path) -> (String, Vec<String>) {
    let results = tempfile::tempdir().unwrap();
    let [path, quality] = ["track.csv", "quality.json"].map(|name| results.path().join(name));
    let mut command = program();
    command.args("track --quiet --camera camera.json --annotations annotations.json".split(' ')).current_dir(folder);
    command.arg("--out").arg(&path).arg("--quality").arg(&quality).arg(clip);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}: {}", clip.display(), String::from_utf8_lossy(&output.stderr));
    let quality: Value = serde_json::from_slice(&fs::read(quality).unwrap()).unwrap();
    let findings = quality["reasons"].as_array().unwrap().iter().map(|reason| reason["name"].as_str().unwrap().into());
    (fs::read_to_string(path).unwrap(), findings.collect())
}

/// Writes a mirror image into the display matrix of an MP4 file with one track.
fn flag_as_mirrored(mp4: &Path, width: i32) {
    let mut bytes = fs::read(mp4).unwrap();
    let header = bytes.windows(4).position(|name| name == b"tkhd").unwrap();
    let matrix = [-65_536, 0, 0, 0, 65_536, 0, width << 16, 0, 1 << 30];
    bytes[header + 44..header + 80].copy_from_slice(&matrix.map(i32::to_be_bytes).concat());
    fs::write(mp4, bytes).unwrap();
}

#[test]
fn a_mirrored_copy_that_is_flagged_as_mirrored_gives_the_same_rows() {
    let folder = scene();
    let clip = folder.path().join("clip.mp4");
    let copy = |name: &str, filter: &str| {
        ffmpeg(&format!("-i {} {filter} -c:v libx264 -qp 0", clip.display()), &folder.path().join(name))
    };
    let (Some(plain), Some(mirrored)) = (copy("plain.mp4", ""), copy("mirrored.mp4", "-vf hflip")) else { return };
    let rows = track(folder.path(), &plain).0;
    assert!(rows.lines().count() > 40 && rows.contains("observed"));
    flag_as_mirrored(&mirrored, 1280);
    assert_eq!(track(folder.path(), &mirrored).0, rows);
}

#[test]
fn complete_files_are_not_called_cut() {
    let Some(folder) = shared("field") else { return };
    for name in ["trimmed100.mp4", "trimmed30.mp4", "vfr_third.mkv"] {
        let findings = track(&folder, &folder.join(name)).1;
        assert!(!findings.iter().any(|finding| finding == "cut_file"), "{name}: {findings:?}");
    }
}

#[test]
fn a_cut_file_is_called_cut() {
    let folder = scene();
    let whole = folder.path().join("whole.mkv");
    let clip = folder.path().join("clip.mp4");
    let Some(whole) = ffmpeg(&format!("-i {} -c copy", clip.display()), &whole) else { return };
    let bytes = fs::read(whole).unwrap();
    let cut = folder.path().join("cut.mkv");
    fs::write(&cut, &bytes[..bytes.len() * 7 / 10]).unwrap();
    let findings = track(folder.path(), &cut).1;
    assert!(findings.iter().any(|finding| finding == "cut_file"), "{findings:?}");
}

#[test]
fn a_camera_of_the_shown_size_is_refused_with_the_stored_and_the_shown_size() {
    let folder = scene();
    let (clip, narrow) = (folder.path().join("clip.mp4"), folder.path().join("narrow.mp4"));
    let how = format!("-i {} -vf scale=960:720,setsar=4/3 -c:v libx264 -preset ultrafast", clip.display());
    let Some(narrow) = ffmpeg(&how, &narrow) else { return };
    let mut command = program();
    command.args("track --quiet --camera camera.json --annotations annotations.json".split(' '));
    let output = command.current_dir(folder.path()).arg(narrow).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(["960×720 as stored", "show it as 1280×720"].iter().all(|part| said.contains(part)), "{said}");
}
