//! Recordings as boxes, phones and cut connections make them.

use super::clips::{ffmpeg, test_picture};
use super::*;

/// Makes a clip and decodes it; `None` without the `ffmpeg` program.
fn heard(name: &str, arguments: &str) -> Option<Heard> {
    let folder = tempfile::tempdir().unwrap();
    let clip = ffmpeg(arguments, &folder.path().join(name))?;
    Some(probe(&clip).0.unwrap_or_else(|failure| panic!("{name}: {failure:?}")))
}

#[test]
fn every_accepted_container_and_codec_gives_every_frame() {
    let cases = [
        ("h264.mp4", "-c:v libx264 -preset ultrafast"),
        ("b-frames.mkv", "-c:v libx264 -preset fast -bf 3"),
        ("h264.ts", "-c:v libx264 -preset ultrafast"),
        ("hevc.mov", "-c:v libx265 -preset ultrafast -x265-params log-level=none"),
        ("mjpeg.avi", "-c:v mjpeg"),
        ("mpeg4.avi", "-c:v mpeg4"),
        ("vp8.webm", "-c:v libvpx -deadline realtime"),
        ("vp9.webm", "-c:v libvpx-vp9 -deadline realtime -cpu-used 8"),
    ];
    for (name, codec) in cases {
        let Some(heard) = heard(name, &test_picture("320x240", 50, codec)) else { return };
        assert_eq!((heard.size, heard.times_s.len()), (Some((320, 240)), 50), "{name}");
        assert!((heard.times_s[49] - 49.0 / 25.0).abs() < 0.011, "{name}: {:?}", heard.times_s);
    }
}
