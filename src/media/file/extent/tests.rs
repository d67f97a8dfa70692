//! A complete file is never called cut, and a cut one is.

use std::io::Cursor;
use std::path::Path;
use std::process::Command;

use proptest::prelude::*;

use super::*;
use crate::media::{MediaLimits, VideoFile};

/// 60 frames at 30 Hz, made with FFmpeg into a container; `more` are arguments before the file's name.
fn made(name: &str, more: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    ffmpeg(&format!("-f lavfi -i testsrc2=size=160x96:rate=30:duration=2 {more}"), &path);
    std::fs::read(path).unwrap()
}

fn ffmpeg(arguments: &str, out: &Path) {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-y"]).args(arguments.split(' ').filter(|one| !one.is_empty()));
    assert!(ffmpeg.arg(out).status().unwrap().success(), "{arguments}");
}

/// Frames that are decoded, and frames that the file states.
fn counts(bytes: &[u8]) -> (u64, Option<u64>) {
    let mut video = VideoFile::open(Cursor::new(bytes.to_vec()), MediaLimits::default()).unwrap();
    let shown = std::iter::from_fn(|| video.next_picture().unwrap()).count();
    (shown as u64, video.whole().frames_stated)
}

const CODEC: &str = "-c:v libx264 -g 10 -bf 2";

/// Every third frame is left out, and the others keep their times.
const UNEVEN: &str = "-vf select=mod(n\\,3) -vsync passthrough -c:v libx264 -g 10 -bf 2";

#[test]
fn a_complete_file_states_the_frames_that_it_gives_or_nothing() {
    let sound = "-f lavfi -i sine=duration=5 -c:a aac";
    for (name, arguments, shown, stated) in [
        ("even.mp4", CODEC.to_owned(), 60, Some(60)),
        ("uneven.mp4", UNEVEN.to_owned(), 40, Some(40)),
        ("parts.mp4", format!("{CODEC} -movflags frag_keyframe+empty_moov"), 60, Some(60)),
        ("uneven.mkv", UNEVEN.to_owned(), 40, None),
        ("uneven.avi", "-vf select=mod(n\\,3) -vsync passthrough -c:v mjpeg".to_owned(), 40, Some(40)),
        ("sound.ts", format!("{sound} {CODEC}"), 60, None),
        ("sound.mkv", format!("{sound} {CODEC}"), 60, None),
        ("sound.mp4", format!("{sound} {CODEC}"), 60, Some(60)),
    ] {
        assert_eq!(counts(&made(name, &arguments)), (shown, stated), "{name}");
    }
}

#[test]
fn frames_that_an_edit_list_hides_are_not_missing() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.mp4");
    std::fs::write(&whole, made("whole.mp4", "-c:v libx264 -g 60 -bf 2")).unwrap();
    for (start_s, shown) in [(0.5, 45), (1.5, 15)] {
        let trimmed = folder.path().join("trimmed.mp4");
        ffmpeg(&format!("-ss {start_s} -i {} -c copy", whole.display()), &trimmed);
        assert_eq!(counts(&std::fs::read(&trimmed).unwrap()), (shown, Some(shown)), "from {start_s} s");
    }
}

#[test]
fn a_cut_file_states_the_frames_of_the_whole() {
    for (name, arguments) in [
        ("tables_first.mp4", format!("{CODEC} -movflags faststart")),
        ("one_part.mp4", "-c:v libx264 -g 60 -bf 2 -movflags empty_moov -frag_duration 10000000".to_owned()),
        ("even.mkv", CODEC.to_owned()),
        ("even.avi", "-c:v mjpeg".to_owned()),
    ] {
        let whole = made(name, &arguments);
        for percent in [50, 70] {
            let (shown, stated) = counts(&whole[..whole.len() * percent / 100]);
            let stated = stated.unwrap_or_else(|| panic!("{name} {percent} %: no statement"));
            assert!(shown < 50 && (58..=62).contains(&stated), "{name} {percent} %: {shown} of {stated}");
        }
    }
}

proptest! {
    #[test]
    fn any_bytes_are_cut_or_not_and_are_read_from_their_beginning(
        kind in prop::sample::select(vec![&b"RIFF"[..], b"\x1a\x45\xdf\xa3\x84abcd\x18\x53\x80\x67", b"", b"\x1a\x45\xdf\xa3"]),
        rest in prop::collection::vec(any::<u8>(), 0..60),
    ) {
        let mut bytes = Cursor::new([kind, &rest].concat());
        is_cut(&mut bytes).unwrap();
        prop_assert_eq!(bytes.position(), 0);
    }
}
