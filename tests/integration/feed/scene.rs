//! A simulated scene as a box would send it: the recording, taken apart into frames of H.264.

use std::path::{Path, PathBuf};
use std::process::Command;

use reqwest::Method;
use reqwest::multipart::{Form, Part};
use serde_json::Value;
use tempfile::TempDir;

use crate::api::centre::Centre;
use crate::support::{read, soon};

/// Width and height of its pictures, pixels.
pub const SIZE: (u32, u32) = (640, 360);

/// A scene on disk, and its frames.
pub struct Scene {
    folder: TempDir,
    pub frames: Vec<Frame>,
    /// Denominator of a tick, of which it lasts one.
    pub ticks_per_s: u32,
}

/// One frame, in the order of decoding.
pub struct Frame {
    pub time: i64,
    pub is_key: bool,
    pub bytes: Vec<u8>,
}

impl Scene {
    /// A scene of so many seconds; `None`, said loudly, without the programs that take a recording apart.
    pub fn new(seconds: u32) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let order = format!("simulate --quiet --scene pegs --seed 5 --seconds {seconds} --size 640x360 --boards 0 --out");
        let made = Command::new(env!("CARGO_BIN_EXE_trocar")).args(order.split(' ')).arg(folder.path()).status();
        assert!(made.unwrap().success());
        let clip = folder.path().join("clip.mp4");
        let raw = folder.path().join("clip.h264");
        // A delimiter before each frame shows where it begins.
        let units = ["-c", "copy", "-bsf:v", "h264_mp4toannexb,h264_metadata=aud=insert", "-f", "h264"];
        run(Command::new("ffmpeg").args(["-v", "error", "-y", "-i"]).arg(&clip).args(units).arg(&raw))?;
        let entries = ["-v", "error", "-select_streams", "v", "-show_entries", "packet=pts,flags:stream=time_base"];
        let told = run(Command::new("ffprobe").args(entries).args(["-of", "json"]).arg(&clip))?;
        let told: Value = serde_json::from_slice(&told).unwrap();
        let time_base = told["streams"][0]["time_base"].as_str().unwrap().strip_prefix("1/").unwrap();
        let packets = told["packets"].as_array().unwrap();
        let units = access_units(&std::fs::read(&raw).unwrap());
        assert_eq!(units.len(), packets.len());
        let frame = |(packet, bytes): (&Value, Vec<u8>)| Frame {
            time: packet["pts"].as_i64().unwrap(),
            is_key: packet["flags"].as_str().unwrap().starts_with('K'),
            bytes,
        };
        let ticks_per_s = time_base.parse().unwrap();
        Some(Self { frames: packets.iter().zip(units).map(frame).collect(), ticks_per_s, folder })
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Gives a centre's box the scene's camera and colours.
    pub async fn furnish(&self, centre: &Centre) {
        let camera = std::fs::read(self.file("camera.json")).unwrap();
        let request = centre.administrator.request(Method::PUT, "/api/v1/boxes/box-1/camera");
        let put = request.header("content-type", "application/json").body(camera).send().await.unwrap();
        assert!(put.status().is_success());
        let form = Form::new()
            .text("annotations", std::fs::read_to_string(self.file("annotations.json")).unwrap())
            .part("video", Part::bytes(std::fs::read(self.file("clip.mp4")).unwrap()));
        let request = centre.administrator.request(Method::PUT, "/api/v1/boxes/box-1/palette").multipart(form);
        let queued = read(request.send().await.unwrap(), reqwest::StatusCode::ACCEPTED).await;
        let job = format!("/api/v1/jobs/{}", queued["job"].as_str().unwrap());
        soon("the colours", async {
            while centre.administrator.read(&job).await["state"] != "done" {
                tokio::time::sleep(std::time::Duration::from_millis(50)).await;
            }
        })
        .await;
    }
}

fn run(command: &mut Command) -> Option<Vec<u8>> {
    match command.output() {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            Some(output.stdout)
        }
        Err(error) => {
            eprintln!("SKIPPED: {:?} cannot be run ({error}); install ffmpeg to try feeds of H.264", command.get_program());
            None
        }
    }
}

/// Cuts a stream where a delimiter begins.
fn access_units(stream: &[u8]) -> Vec<Vec<u8>> {
    const DELIMITER: [u8; 5] = [0, 0, 0, 1, 9];
    let starts: Vec<usize> =
        stream.windows(5).enumerate().filter(|(_, bytes)| *bytes == DELIMITER).map(|(at, _)| at).collect();
    let ends = starts.iter().skip(1).copied().chain([stream.len()]);
    starts.iter().zip(ends).map(|(start, end)| stream[*start..end].to_vec()).collect()
}

/// The causal path of a scene, by the command: frame and tool, and tip in mm.
pub fn causal_path(scene: &Scene) -> Vec<(u64, String, [f64; 3])> {
    let out = scene.file("causal.csv");
    let track = Command::new(env!("CARGO_BIN_EXE_trocar"))
        .args(["track", "--causal", "--camera"])
        .arg(scene.file("camera.json"))
        .arg("--annotations")
        .arg(scene.file("annotations.json"))
        .arg("--out")
        .arg(&out)
        .arg(scene.file("clip.mp4"))
        .output()
        .unwrap();
    assert!(track.status.success(), "{}", String::from_utf8_lossy(&track.stderr));
    rows(&out)
}

fn rows(csv: &Path) -> Vec<(u64, String, [f64; 3])> {
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| head.iter().position(|column| *column == name).unwrap_or_else(|| panic!("{name}: {head:?}"));
    let [frame, tool, x, y, z] = ["frame", "tool", "x_mm", "y_mm", "z_mm"].map(column);
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |column: usize| cells[column].parse().ok();
        Some((cells[frame].parse().unwrap(), cells[tool].to_owned(), [number(x)?, number(y)?, number(z)?]))
    };
    lines.filter_map(row).collect()
}
