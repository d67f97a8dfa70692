//! Frames before the start of the presentation exist for decoding alone, and players do not show them.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::*;
use crate::media::CaptureSource;
use crate::media::testing::seen;

/// A clip of 72 frames at 25 Hz whose groups are open: frames before a key frame are stored after it.
fn open_groups(folder: &Path) -> PathBuf {
    let path = folder.join("open.mp4");
    let groups = "open-gop=1:keyint=24:bframes=3:b-adapt=0:scenecut=0";
    ffmpeg(&format!("-f lavfi -i testsrc2=size=160x96:rate=25 -frames:v 72 -c:v libx264 -x264-params {groups}"), &path);
    path
}

fn ffmpeg(arguments: &str, out: &Path) {
    let mut ffmpeg = Command::new("ffmpeg");
    let made = ffmpeg.args(["-v", "error", "-y"]).args(arguments.split(' ')).arg(out).status().unwrap();
    assert!(made.success(), "{arguments}");
}

fn open(path: &Path) -> VideoFile {
    VideoFile::open(Cursor::new(std::fs::read(path).unwrap()), MediaLimits::default()).unwrap()
}

/// Time and pixel hash of every frame.
fn shown(path: &Path) -> Vec<(f64, u64)> {
    let mut video = open(path);
    let pictures = std::iter::from_fn(|| video.next_picture().unwrap());
    pictures.map(|picture| seen(&picture.frame())).map(|(_, time_s, pixels)| (time_s, pixels)).collect()
}

/// The clip from 1.3 s on without coding it again, as an editor or a phone writes it: frame 33 is the first after the
/// cut, 0.02 s later. Decoding begins with the key frame 24.
const TRIMS: [(&str, &str); 2] =
    [("list.mp4", "-movflags +faststart"), ("parts.mp4", "-movflags frag_keyframe+delay_moov")];

#[test]
fn frames_before_the_start_of_the_presentation_are_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let whole = open_groups(folder.path());
    let all = shown(&whole);
    for (name, how) in TRIMS {
        let trimmed = folder.path().join(name);
        ffmpeg(&format!("-ss 1.3 -i {} -c copy {how}", whole.display()), &trimmed);
        let kept = shown(&trimmed);
        assert_eq!(kept.len(), 72 - 33, "{name}");
        let first_s = if name == "parts.mp4" { 0.02 } else { kept[0].0 };
        assert!((kept[0].0 - first_s).abs() < 1e-3, "{name}: {:?}", kept[0]);
        for (number, ((time_s, pixels), of_whole)) in kept.iter().zip(&all[33..]).enumerate() {
            assert!((time_s - first_s - number as f64 / 25.0).abs() < 1e-3, "{name}: frame {number} at {time_s}");
            assert_eq!(*pixels, of_whole.1, "{name}: frame {number}");
        }
        let times_s: Vec<f64> = kept.iter().map(|frame| frame.0).collect();
        let facts = crate::domain::clock::StampFacts::of_times(&times_s);
        assert!((open(&trimmed).stamps().duration_s - facts.duration_s).abs() < 1e-6, "{name}");
        assert_eq!(open(&trimmed).show_frames(&[0, 5], |_| ()), None, "{name}: the first packet is not frame 0");
    }
}

#[test]
fn frames_stored_after_a_key_frame_and_shown_before_the_start_are_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let whole = open_groups(folder.path());
    let all = shown(&whole);
    for (name, how) in TRIMS {
        let trimmed = folder.path().join(name);
        ffmpeg(&format!("-ss 0.96 -i {} -c copy {how}", whole.display()), &trimmed);
        let kept: Vec<u64> = shown(&trimmed).into_iter().map(|frame| frame.1).collect();
        assert!(kept.iter().eq(all[24..].iter().map(|frame| &frame.1)), "{name}: {} frames", kept.len());
    }
}

#[test]
fn an_agent_sends_a_trimmed_file_as_it_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let whole = open_groups(folder.path());
    for (name, how) in TRIMS {
        for start in ["0.96", "1.3"] {
            let trimmed = folder.path().join(name);
            ffmpeg(&format!("-ss {start} -i {} -c copy {how}", whole.display()), &trimmed);
            let mut source = CaptureSource::open(trimmed.to_str().unwrap(), &[], || false).unwrap();
            let time_base = source.info().time_base;
            let sent = std::iter::from_fn(|| source.next_frame().unwrap());
            let mut sent_s: Vec<f64> = sent.map(|frame| time_base.seconds(frame.time)).collect();
            sent_s.sort_by(f64::total_cmp);
            let shown = shown(&trimmed);
            assert_eq!(sent_s.len(), shown.len(), "{name} from {start} s");
            let is_same = |(sent_s, shown): (&f64, &(f64, u64))| (sent_s - shown.0).abs() < 1e-3;
            assert!(sent_s.iter().zip(&shown).all(is_same), "{name} from {start} s: {sent_s:?}");
        }
    }
}

#[test]
fn a_picture_that_begins_later_than_the_file_says_when() {
    let folder = tempfile::tempdir().unwrap();
    let late = "-f lavfi -i sine=duration=2 -itsoffset 0.5 -f lavfi -i testsrc2=size=160x96:rate=25:duration=1 -map 0 -map 1 -vsync passthrough";
    for (name, more, starts_at_s) in [
        ("late.mp4", "-c:v libx264 -c:a aac", 0.5),
        ("late.mkv", "-c:v libx264 -c:a aac", 0.5),
        ("late.webm", "-c:v libvpx -c:a libopus", 0.5),
        ("late.ts", "-c:v libx264 -c:a aac", 0.0), // no player counts its stamps from zero
    ] {
        let path = folder.path().join(name);
        ffmpeg(&format!("{late} {more}"), &path);
        for factor in [1.0, 0.125] {
            let mut video = open(&path);
            video.scale_times(factor);
            let first = video.next_picture().unwrap().unwrap();
            assert!(first.frame().time_s.abs() < 1e-6, "{name}");
            // In Matroska, FFmpeg moves all stamps by the delay of its sound coder, at most 43 ms.
            assert!((video.whole().starts_at_s - starts_at_s).abs() < 0.05, "{name}: {:?}", video.whole());
        }
    }
}

#[test]
fn pixels_that_are_not_square_change_the_shown_size_alone() {
    let folder = tempfile::tempdir().unwrap();
    for (shape, shown) in [("4/3", (213, 96)), ("1/2", (160, 192)), ("1", (160, 96))] {
        let path = folder.path().join("shape.mp4");
        let picture = "-f lavfi -i testsrc2=size=160x96:rate=25 -frames:v 3";
        ffmpeg(&format!("{picture} -vf setsar={shape} -c:v libx264"), &path);
        let turned = folder.path().join("turned.mp4");
        ffmpeg(&format!("-i {} -c copy -metadata:s:v rotate=90", path.display()), &turned);
        let (upright, turned) = (open(&path).info(), open(&turned).info());
        assert_eq!((upright.width, upright.height, upright.shown_size), (160, 96, shown), "{shape}");
        assert_eq!((turned.width, turned.height, turned.shown_size), (96, 160, (shown.1, shown.0)), "{shape}");
    }
}
