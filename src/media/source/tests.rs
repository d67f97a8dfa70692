//! A captured source must give the same frames and times as an upload of it.

use std::fs::File;
use std::io::Cursor;
use std::path::Path;
use std::process::Command;

use super::*;
use crate::media::testing::{recording, seen, with_matrix};
use crate::media::{CodedFrame, Muxer, SampleFormat, Stream};

fn captured(path: &Path) -> (SourceInfo, Vec<CapturedFrame>) {
    let mut source = CaptureSource::open(path.to_str().unwrap(), &[], || false).unwrap();
    let frames = std::iter::from_fn(|| source.next_frame().unwrap()).collect();
    (source.info().clone(), frames)
}

/// Number, time and pixel hash of every frame of a recording.
fn shown(bytes: Vec<u8>) -> Vec<(u64, f64, u64)> {
    let mut video = VideoFile::open(Cursor::new(bytes), MediaLimits::default()).unwrap();
    std::iter::from_fn(|| video.next_picture().unwrap()).map(|picture| seen(&picture.frame())).collect()
}

/// The recording that the server would assemble from the frames.
fn assembled(info: &SourceInfo, frames: &[CapturedFrame]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mp4");
    let stream = Stream { codec: info.codec, size: info.size, time_base: info.time_base, first: &frames[0].bytes };
    let mut muxer = Muxer::create(File::create(&path).unwrap(), stream).unwrap();
    let mut times: Vec<i64> = frames.iter().map(|frame| frame.time).collect();
    times.sort_unstable();
    let delay = times.iter().zip(frames).map(|(time, frame)| time - frame.time).max().unwrap();
    for (frame, time) in frames.iter().zip(&times) {
        let CapturedFrame { is_key, bytes, .. } = frame;
        let coded = CodedFrame { pts: frame.time, dts: time - delay, duration: 1, is_key: *is_key, bytes };
        muxer.write(coded).unwrap();
    }
    muxer.finish().unwrap();
    std::fs::read(&path).unwrap()
}

/// A clip made with FFmpeg, in any format.
fn made(folder: &Path, name: &str, how: &str) -> std::path::PathBuf {
    let path = folder.join(name);
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args("-v error -f lavfi -i testsrc2=size=160x96:rate=30:duration=2".split(' '));
    assert!(ffmpeg.args(how.split(' ')).arg(&path).status().unwrap().success());
    path
}

#[test]
fn a_clip_of_ours_comes_out_as_it_went_in() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.mp4");
    let clip = recording(SampleFormat::Yuv420, 60);
    std::fs::write(&path, &clip).unwrap();
    let (info, frames) = captured(&path);
    assert_eq!((info.codec, info.coded_from.clone(), info.is_file), (FrameCodec::H264, None, true));
    assert!(info.has_end);
    assert!(
        frames.windows(2).any(|pair| pair[1].time < pair[0].time),
        "frames are shown in another order than decoded"
    );
    assert!(frames.windows(2).all(|pair| pair[0].due_s < pair[1].due_s));
    assert_eq!(shown(assembled(&info, &frames)), shown(clip));
}

#[test]
fn every_form_of_a_clip_keeps_its_frames_and_times() {
    let folder = tempfile::tempdir().unwrap();
    for (name, how, codec) in [
        ("b_frames.mkv", "-c:v libx264 -g 20 -bf 3", FrameCodec::H264),
        ("stream.ts", "-c:v libx264 -g 20 -bf 2 -muxdelay 0.5", FrameCodec::H264),
        ("live.ts", "-c:v libx264 -g 20 -tune zerolatency -bsf:v filter_units=remove_types=6", FrameCodec::H264),
        ("pictures.avi", "-c:v mjpeg -q:v 3", FrameCodec::Jpeg),
    ] {
        let path = made(folder.path(), name, how);
        let (info, frames) = captured(&path);
        assert_eq!((info.codec, info.coded_from.as_deref()), (codec, None), "{name}");
        let keys = frames.iter().filter(|frame| frame.is_key);
        assert!(keys.clone().count() >= 3, "{name}");
        assert!(keys.into_iter().all(|key| crate::media::can_start_decoding(codec, &key.bytes)), "{name}");
        let [sent, clip] = [assembled(&info, &frames), std::fs::read(&path).unwrap()].map(shown);
        assert_eq!(sent.len(), 60, "{name}");
        for (sent, clip) in sent.iter().zip(&clip) {
            assert!(
                (sent.0, sent.2) == (clip.0, clip.2) && (sent.1 - clip.1).abs() < 1e-5,
                "{name}: {sent:?} {clip:?}"
            );
        }
    }
}

/// Bytes that can be read once, in pieces as from a pipe.
struct Trickle(Cursor<Vec<u8>>);

impl Read for Trickle {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let piece = into.len().min(4096);
        self.0.read(&mut into[..piece])
    }
}

fn pushed(bytes: Vec<u8>) -> Result<(SourceInfo, Vec<CapturedFrame>), SourceError> {
    let mut source = CaptureSource::pushed(Trickle(Cursor::new(bytes)), MediaLimits::default())?;
    let frames = std::iter::from_fn(|| source.next_frame().unwrap()).collect();
    Ok((source.info().clone(), frames))
}

#[test]
fn a_stream_that_comes_once_gives_what_its_file_gives() {
    let folder = tempfile::tempdir().unwrap();
    for (name, how, codec) in [
        ("plain.ts", "-c:v libx264 -g 20 -bf 2", FrameCodec::H264),
        ("grain.ts", "-vf noise=alls=90:allf=t -c:v libx264 -qp 2 -g 60 -s 640x384", FrameCodec::H264),
        ("wraps.ts", "-c:v libx264 -g 20 -bf 2 -output_ts_offset 95441", FrameCodec::H264),
        ("plain.mkv", "-c:v libx264 -g 20 -bf 3", FrameCodec::H264),
        ("pictures.mkv", "-c:v mjpeg -q:v 3", FrameCodec::Jpeg),
        ("other.webm", "-c:v libvpx", FrameCodec::Jpeg),
    ] {
        let path = made(folder.path(), name, how);
        let (info, frames) = pushed(std::fs::read(&path).unwrap()).unwrap();
        let (_, of_the_file) = captured(&path);
        assert_eq!((info.codec, frames.len()), (codec, 60), "{name}");
        let [last, spans] = [59, 60].map(|n| n as f64 / 30.0);
        let times_s: Vec<f64> = frames.iter().map(|frame| info.time_base.seconds(frame.time)).collect();
        assert!(times_s.iter().all(|time_s| (0.0..spans).contains(time_s)), "{name}: {times_s:?}");
        assert!(times_s.iter().any(|time_s| (time_s - last).abs() < 2e-3), "{name}: {times_s:?}");
        assert_eq!(frames, of_the_file, "{name}");
    }
}

#[test]
fn a_stream_that_is_no_live_one_is_refused() {
    let clip = recording(SampleFormat::Yuv420, 10);
    for bytes in
        [clip, b"#EXTM3U\n#EXTINF:1,\n/etc/passwd\n".to_vec(), b"ffconcat version 1.0\nfile x".to_vec(), vec![]]
    {
        assert!(matches!(pushed(bytes), Err(SourceError::Open(_))));
    }
}

#[test]
fn what_a_feed_does_not_know_becomes_upright_jpegs() {
    let folder = tempfile::tempdir().unwrap();
    let turned = folder.path().join("turned.mp4");
    let mut turn = Command::new("ffmpeg");
    turn.args(["-v", "error", "-i"]).arg(made(folder.path(), "upright.mp4", "-c:v libx264"));
    assert!(turn.args("-c copy -metadata:s:v rotate=90".split(' ')).arg(&turned).status().unwrap().success());
    for (path, from, size) in [
        (made(folder.path(), "raw.avi", "-c:v rawvideo -pix_fmt yuyv422"), "rawvideo", (160, 96)),
        (made(folder.path(), "clip.webm", "-c:v libvpx"), "vp8", (160, 96)),
        (made(folder.path(), "clip.h264", "-c:v libx264 -bf 2"), "h264", (160, 96)),
        (turned, "h264", (96, 160)),
    ] {
        let (info, frames) = captured(&path);
        let name = path.display();
        assert_eq!((info.codec, info.coded_from.as_deref(), info.size), (FrameCodec::Jpeg, Some(from), size), "{name}");
        assert_eq!(frames.len(), 60, "{name}");
        assert!(frames.windows(2).all(|pair| pair[0].time < pair[1].time), "{name}");
        assert_eq!(shown(assembled(&info, &frames)).len(), 60, "{name}");
    }
}

#[test]
fn a_mirrored_source_is_sent_as_players_show_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mirrored.mp4");
    let one = 1 << 16;
    let mirrored = with_matrix(recording(SampleFormat::Yuv420, 10), [-one, 0, 0, 0, one, 0, 96 * one, 0, 1 << 30]);
    std::fs::write(&path, &mirrored).unwrap();
    let (info, frames) = captured(&path);
    assert_eq!((info.codec, info.coded_from.as_deref()), (FrameCodec::Jpeg, Some("h264")));
    let mut video = VideoFile::open(Cursor::new(mirrored), MediaLimits::default()).unwrap();
    for captured in &frames {
        let picture = video.next_picture().unwrap().unwrap();
        let jpeg = JpegMaker::new(JpegStyle::FULL).code(&picture.frame()).unwrap();
        assert!(captured.bytes == jpeg, "frame {}", picture.frame().index);
    }
    let tilted = with_matrix(recording(SampleFormat::Yuv420, 10), [one, 9000, 0, -9000, one, 0, 0, 0, 1 << 30]);
    std::fs::write(&path, tilted).unwrap();
    let refused = CaptureSource::open(path.to_str().unwrap(), &[], || false).err();
    assert!(matches!(refused, Some(SourceError::Media(MediaError::Orientation(_)))), "{refused:?}");
}

#[test]
fn a_playlist_has_an_end_once_it_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let whole = made(folder.path(), "whole.m3u8", "-c:v libx264 -g 30 -f hls -hls_time 1 -hls_list_size 0");
    let live = folder.path().join("live.m3u8");
    let text = std::fs::read_to_string(&whole).unwrap();
    std::fs::write(&live, text.replace("#EXT-X-ENDLIST", "")).unwrap();
    for (playlist, has_end) in [(whole, true), (live, false)] {
        let source = CaptureSource::open(playlist.to_str().unwrap(), &[], || false).unwrap();
        assert_eq!(source.info().has_end, has_end, "{playlist:?}");
    }
}

#[test]
fn a_source_that_is_none_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("text.mp4");
    std::fs::write(&path, "no video at all").unwrap();
    for address in [path.to_str().unwrap(), "/no/such/file", "a\0b", "/dev/null"] {
        assert!(CaptureSource::open(address, &[], || false).is_err(), "{address:?}");
    }
}

#[test]
fn clocks_are_the_streams_own_where_a_feed_can_have_them() {
    let base = |num, den| feed_time_base(ff::Rational(num, den)).unwrap().fraction();
    assert_eq!([base(1, 12_800), base(1, 90_000), base(1, 1000)], [(1, 12_800), (1, 90_000), (1, 1000)]);
    assert_eq!([base(1, 25), base(1001, 30_000)], [(1, 100_000), (1, 90_000)], "its ticks are whole numbers of these");
    assert_eq!([base(1, 1_000_000), base(1, 180_000)], [(1, 90_000), (1, 90_000)]);
}
