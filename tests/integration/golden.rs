//! The numbers of ten clips, kept to the last byte: path, verdict and features, smoothed and causal.
//!
//! A change that should leave the numbers alone leaves `tests/golden/` alone. A change of the numbers replaces the files
//! with `make golden`, in a commit that says why the numbers change and by how much.
//!
//! The last digits depend on the rounding of the system's mathematical functions. The files hold for x86-64 with FMA and
//! glibc; elsewhere the test is skipped.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::process::program;
use crate::resources::shared;

/// The two ways to track a recording: the name in the file names, and the flag.
const MODES: [(&str, Option<&str>); 2] = [("smoothed", None), ("causal", Some("--causal"))];

/// Where a clip comes from.
enum Source {
    /// `trocar simulate` makes it from these arguments.
    Simulation(&'static str),
    /// The folder of shared data holds its camera, annotations and video.
    Shared { camera: &'static str, annotations: &'static str, video: &'static str },
}

/// Three simulated clips, which every checkout can make, and seven of the shared ones: rendered scenes, recordings that
/// once failed, and ray-traced boxes of each verdict.
const CLIPS: [(&str, Source); 10] = [
    ("pegs", Source::Simulation("--scene pegs --skill expert --seed 11 --seconds 3")),
    ("crossing", Source::Simulation("--scene crossing --view side --seed 5 --seconds 3")),
    ("rest", Source::Simulation("--scene rest --seed 3 --seconds 2")),
    (
        "scene_v3",
        Source::Shared {
            camera: "scenes/V3/camera_true.json",
            annotations: "scenes/V3/annotations.json",
            video: "scenes/V3/video.mp4",
        },
    ),
    (
        "scene_v5",
        Source::Shared {
            camera: "scenes/V5/camera_true.json",
            annotations: "scenes/V5/annotations.json",
            video: "scenes/V5/video.mp4",
        },
    ),
    (
        "field_distract",
        Source::Shared {
            camera: "field/camera.json",
            annotations: "field/annotations.json",
            video: "field/distract.mp4",
        },
    ),
    (
        "field_trimmed30",
        Source::Shared {
            camera: "field/camera.json",
            annotations: "field/annotations.json",
            video: "field/trimmed30.mp4",
        },
    ),
    (
        "world_band02",
        Source::Shared {
            camera: "worlds/dev/band02/contract/camera_true.json",
            annotations: "worlds/dev/band02/contract/annotations.json",
            video: "worlds/dev/band02/video.mp4",
        },
    ),
    (
        "world_band03",
        Source::Shared {
            camera: "worlds/dev/band03/contract/camera_true.json",
            annotations: "worlds/dev/band03/contract/annotations.json",
            video: "worlds/dev/band03/video.mp4",
        },
    ),
    (
        "world_band08",
        Source::Shared {
            camera: "worlds/dev/band08/contract/camera_true.json",
            annotations: "worlds/dev/band08/contract/annotations.json",
            video: "worlds/dev/band08/video.mp4",
        },
    ),
];

/// Camera, annotations and video of a clip.
struct Files {
    camera: PathBuf,
    annotations: PathBuf,
    video: PathBuf,
}

impl Source {
    /// `None`: the clip is a shared one and the shared data is absent.
    fn files(&self, folder: &Path) -> Option<Files> {
        match self {
            Self::Simulation(arguments) => {
                run(folder, &format!("simulate --quiet --boards 0 --out . {arguments}"));
                let [camera, annotations, video] =
                    ["camera.json", "annotations.json", "clip.mp4"].map(|f| folder.join(f));
                Some(Files { camera, annotations, video })
            }
            Self::Shared { camera, annotations, video } => {
                Some(Files { camera: shared(camera)?, annotations: shared(annotations)?, video: shared(video)? })
            }
        }
    }
}

#[test]
fn paths_and_features_of_ten_clips_are_the_same_to_the_last_byte() {
    if !rounds_like_the_golden_files() {
        crate::resources::skip("x86-64 with FMA, for which the golden files hold");
        return;
    }
    let mut differences = Vec::new();
    for (name, source) in &CLIPS {
        let folder = tempfile::tempdir().unwrap();
        let Some(files) = source.files(folder.path()) else {
            continue; // reported as skipped
        };
        for (mode, flag) in MODES {
            let (path, features) = measure(&folder, &files, flag);
            differences.extend(compare(&format!("tests/golden/{name}.{mode}.path.csv"), &path));
            differences.extend(compare(&format!("tests/golden/{name}.{mode}.features.tsv"), &features));
        }
    }
    assert!(
        differences.is_empty(),
        "these numbers changed; see tests/integration/golden.rs:\n{}",
        differences.join("\n")
    );
}

#[cfg(target_arch = "x86_64")]
fn rounds_like_the_golden_files() -> bool {
    std::arch::is_x86_feature_detected!("fma") && cfg!(target_env = "gnu")
}

#[cfg(not(target_arch = "x86_64"))]
fn rounds_like_the_golden_files() -> bool {
    false
}

/// The trajectory file of a clip, and its verdict and features as a table.
fn measure(folder: &TempDir, files: &Files, flag: Option<&str>) -> (String, String) {
    let [camera, annotations, video] = [&files.camera, &files.annotations, &files.video].map(|path| path.display());
    let flag = flag.map_or(String::new(), |flag| format!(" {flag}"));
    let inputs = format!("--camera {camera} --annotations {annotations} {video}");
    run(folder.path(), &format!("track --quiet{flag} --out track.csv --quality quality.json {inputs}"));
    let quality: Value = serde_json::from_slice(&fs::read(folder.path().join("quality.json")).unwrap()).unwrap();
    let scored: Value = serde_json::from_str(&run(folder.path(), "score --json track.csv")).unwrap();
    (fs::read_to_string(folder.path().join("track.csv")).unwrap(), table(&quality, &scored[0]))
}

/// Names and numbers without the sentences that explain them: these may be reworded.
fn table(quality: &Value, session: &Value) -> String {
    const COLUMNS: [&str; 9] = ["name", "tool", "space", "unit", "value", "as_measured", "sigma", "low", "high"];
    let reasons = |of: &Value| {
        let names = of["reasons"].as_array().unwrap().iter().map(|reason| text(&reason["name"]));
        names.collect::<Vec<_>>().join(" ")
    };
    let mut table = String::new();
    for (by, of) in [("track", quality), ("score", session)] {
        writeln!(table, "{by}\t{}\t{}", text(&of["verdict"]), reasons(of)).unwrap();
    }
    writeln!(table, "start_s, end_s\t{}\t{}", text(&session["start_s"]), text(&session["end_s"])).unwrap();
    writeln!(table, "{}", COLUMNS.join("\t")).unwrap();
    for feature in session["features"].as_array().unwrap() {
        writeln!(table, "{}", COLUMNS.map(|column| text(&feature[column])).join("\t")).unwrap();
    }
    table
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => String::new(),
        other => other.to_string(),
    }
}

/// What differs from a file of the checkout; with `TROCAR_GOLDEN=write` the file is replaced instead.
pub fn compare(name: &str, measured: &str) -> Option<String> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
    if std::env::var_os("TROCAR_GOLDEN").is_some_and(|order| order == "write") {
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, measured).unwrap();
        return None;
    }
    let golden = fs::read_to_string(&file).unwrap_or_default();
    let different = golden.lines().zip(measured.lines()).enumerate().find(|(_, (old, new))| old != new);
    match different {
        Some((line, (old, new))) => Some(format!("{name}:{}\n  - {old}\n  + {new}", line + 1)),
        None if golden.len() == measured.len() => None,
        None => Some(format!("{name}: {} lines, were {}", measured.lines().count(), golden.lines().count())),
    }
}

/// Runs the program to its end and returns what it prints. A refused session is a result: its exit status is 0.
fn run(folder: &Path, line: &str) -> String {
    let output = program().args(line.split(' ')).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "trocar {line}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}
