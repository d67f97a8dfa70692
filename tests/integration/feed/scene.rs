//! A simulated scene as a box would send it: the recording, split into H.264 frames.

use std::path::{Path, PathBuf};
use std::process::Command;

use reqwest::Method;
use reqwest::multipart::{Form, Part};
use serde_json::Value;
use tempfile::TempDir;

use crate::process::program;
use crate::support::{Client, read};

/// A scene on disk, and its frames.
pub struct Scene {
    pub folder: Folder,
    pub frames: Vec<Frame>,
    /// Width and height of its pictures, pixels.
    pub size: (u32, u32),
    /// Ticks per second: the unit of the frames' times.
    pub ticks_per_s: u32,
}

/// One frame, in the order of decoding.
pub struct Frame {
    pub time: i64,
    pub is_key: bool,
    pub bytes: Vec<u8>,
}

/// The folder of a scene's files.
pub struct Folder(TempDir);

impl Folder {
    /// Pegs, simulated with these options.
    pub fn of(options: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let order = format!("simulate --quiet --scene pegs {options} --boards 0 --out");
        assert!(program().args(order.split(' ')).arg(folder.path()).status().unwrap().success());
        Self(folder)
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

impl Scene {
    /// A scene of this length; `None`, with a message, without the programs that split a recording.
    pub fn new(seconds: u32) -> Option<Self> {
        Self::in_folder(Folder::of(&format!("--seed 5 --seconds {seconds} --size 640x360")))
    }

    /// The scene in this folder.
    pub fn in_folder(folder: Folder) -> Option<Self> {
        let (frames, ticks_per_s) = frames_of_h264(&folder.file("clip.mp4"))?;
        let camera: Value = serde_json::from_slice(&std::fs::read(folder.file("camera.json")).unwrap()).unwrap();
        let size = ["width", "height"].map(|side| u32::try_from(camera[side].as_u64().unwrap()).unwrap()).into();
        Some(Self { frames, size, ticks_per_s, folder })
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.file(name)
    }
}

/// A scene of 1080p, encoded again.
pub struct Clip {
    pub scene: Folder,
    pub file: PathBuf,
    pub is_bare: bool,
    pub is_jpeg: bool,
    pub frames: Vec<Frame>,
}

impl Clip {
    /// Encodes a scene with tape or with bare tools with these options of `ffmpeg`, into a folder.
    pub fn new(folder: &Path, is_bare: bool, coding: &str) -> Option<Self> {
        let marker = if is_bare { "bare" } else { "band" };
        let scene = Folder::of(&format!("--seed 5 --seconds 8 --size 1920x1080 --marker {marker}"));
        let is_jpeg = coding.contains("mjpeg");
        let file = folder.join(if is_jpeg { "clip.avi" } else { "clip.mp4" });
        let mut code = Command::new("ffmpeg");
        code.args(["-v", "error", "-y", "-i"]).arg(scene.file("clip.mp4")).args(coding.split(' ')).arg(&file);
        run(&mut code)?;
        let frames = if is_jpeg { frames_of_jpeg(&file, folder)? } else { frames_of_h264(&file)?.0 };
        Some(Self { scene, file, is_bare, is_jpeg, frames })
    }

    /// Millions of bits a second at this frame rate.
    pub fn mbit_s(&self, fps: u64) -> f64 {
        let bytes: usize = self.frames.iter().map(|frame| frame.bytes.len()).sum();
        8e-6 * bytes as f64 / self.frames.len() as f64 * fps as f64
    }
}

fn frames_of_jpeg(clip: &Path, folder: &Path) -> Option<Vec<Frame>> {
    let pictures = folder.join("%05d.jpg");
    run(Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-i"])
        .arg(clip)
        .args(["-c", "copy", "-f", "image2"])
        .arg(pictures))?;
    let read = |number: usize| std::fs::read(folder.join(format!("{number:05}.jpg"))).ok();
    let frame = |(number, bytes): (i64, Vec<u8>)| Frame { time: 3600 * number, is_key: true, bytes };
    Some((0..).zip((1_usize..).map_while(read)).map(frame).collect())
}

fn frames_of_h264(clip: &Path) -> Option<(Vec<Frame>, u32)> {
    let raw = clip.with_extension("h264");
    // A delimiter before each frame shows where it begins.
    let units = ["-c", "copy", "-bsf:v", "h264_mp4toannexb,h264_metadata=aud=insert", "-f", "h264"];
    run(Command::new("ffmpeg").args(["-v", "error", "-y", "-i"]).arg(clip).args(units).arg(&raw))?;
    let entries = ["-v", "error", "-select_streams", "v", "-show_entries", "packet=pts,flags:stream=time_base"];
    let json = run(Command::new("ffprobe").args(entries).args(["-of", "json"]).arg(clip))?;
    let description: Value = serde_json::from_slice(&json).unwrap();
    let time_base = description["streams"][0]["time_base"].as_str().unwrap().strip_prefix("1/").unwrap();
    let packets = description["packets"].as_array().unwrap();
    let units = access_units(&std::fs::read(&raw).unwrap());
    assert_eq!(units.len(), packets.len());
    let frame = |(packet, bytes): (&Value, Vec<u8>)| Frame {
        time: packet["pts"].as_i64().unwrap(),
        is_key: packet["flags"].as_str().unwrap().starts_with('K'),
        bytes,
    };
    Some((packets.iter().zip(units).map(frame).collect(), time_base.parse().unwrap()))
}

/// The bytes of a clip in another container; no frame is encoded again.
pub fn remuxed(clip: &Path, container: &str) -> Option<Vec<u8>> {
    slowed(clip, container, 1)
}

/// The same with time stamps this many times as far apart.
pub fn slowed(clip: &Path, container: &str, times: u32) -> Option<Vec<u8>> {
    let path = clip.with_extension(container);
    let copy = ["-c", "copy", "-f", container];
    let scale = ["-itsscale", &times.to_string()];
    run(Command::new("ffmpeg").args(["-v", "error", "-y"]).args(scale).arg("-i").arg(clip).args(copy).arg(&path))?;
    Some(std::fs::read(path).unwrap())
}

/// Gives a box a scene's camera and colours.
pub async fn set_up_box(administrator: &Client, in_box: &str, scene: &Folder) {
    let camera = std::fs::read(scene.file("camera.json")).unwrap();
    let request = administrator.request(Method::PUT, &format!("/api/v1/boxes/{in_box}/camera"));
    let put = request.header("content-type", "application/json").body(camera).send().await.unwrap();
    assert!(put.status().is_success());
    let form = Form::new()
        .text("annotations", std::fs::read_to_string(scene.file("annotations.json")).unwrap())
        .part("video", Part::bytes(std::fs::read(scene.file("clip.mp4")).unwrap()));
    let form = match std::fs::read(scene.file("empty.jpg")) {
        Ok(photo) => form.part("empty_box", Part::bytes(photo).file_name("empty.jpg")),
        Err(_) => form, // only scenes of bare tools have one
    };
    let request = administrator.request(Method::POST, &format!("/api/v1/boxes/{in_box}/palettes")).multipart(form);
    let queued = read(request.send().await.unwrap(), reqwest::StatusCode::ACCEPTED).await;
    let job = format!("/api/v1/jobs/{}", queued["job"].as_str().unwrap());
    administrator.read_until(&job, |job| job["state"] == "done").await;
}

fn run(command: &mut Command) -> Option<Vec<u8>> {
    match command.output() {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            Some(output.stdout)
        }
        Err(error) => {
            crate::resources::skip(format_args!("{:?} ({error}); `make test` installs it", command.get_program()));
            None
        }
    }
}

/// Splits a stream at its delimiters.
fn access_units(stream: &[u8]) -> Vec<Vec<u8>> {
    const DELIMITER: [u8; 5] = [0, 0, 0, 1, 9];
    let starts: Vec<usize> =
        stream.windows(5).enumerate().filter(|(_, bytes)| *bytes == DELIMITER).map(|(at, _)| at).collect();
    let ends = starts.iter().skip(1).copied().chain([stream.len()]);
    starts.iter().zip(ends).map(|(start, end)| stream[*start..end].to_vec()).collect()
}

/// The causal path of a scene from `trocar track`: frame, tool, and tip in mm.
pub fn causal_path(scene: &Scene) -> Vec<(u64, String, [f64; 3])> {
    let out = scene.file("causal.csv");
    let track = program()
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

/// The rows of a path in a file: frame, tool, and tip in mm.
pub fn rows(csv: &Path) -> Vec<(u64, String, [f64; 3])> {
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column =
        |name: &str| head.iter().position(|column| *column == name).unwrap_or_else(|| panic!("{name}: {head:?}"));
    let [frame, tool, x, y, z] = ["frame", "tool", "x_mm", "y_mm", "z_mm"].map(column);
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |column: usize| cells[column].parse().ok();
        Some((cells[frame].parse().unwrap(), cells[tool].to_owned(), [number(x)?, number(y)?, number(z)?]))
    };
    lines.filter_map(row).collect()
}

/// A key frame of half the size.
pub fn one_of_another_size(scene: &Scene) -> Vec<u8> {
    let small = scene.file("small.h264");
    let code = ["-frames:v", "1", "-s", "320x180", "-c:v", "libx264", "-f", "h264"];
    run(Command::new("ffmpeg").args(["-v", "error", "-y", "-i"]).arg(scene.file("clip.mp4")).args(code).arg(&small))
        .unwrap();
    std::fs::read(small).unwrap()
}
