//! Recordings as boxes, phones and cut connections make them.

use super::clips::{ffmpeg, test_picture};
use super::*;

/// Makes a clip and decodes it; `None` without the `ffmpeg` program.
fn decode_clip(name: &str, arguments: &str) -> Option<ChildOutput> {
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
        let Some(output) = decode_clip(name, &test_picture("320x240", 50, codec)) else { return };
        assert_eq!((output.probe.size, output.probe.times_s.len()), (Some((320, 240)), 50), "{name}");
        assert!((output.probe.times_s[49] - 49.0 / 25.0).abs() < 0.011, "{name}: {:?}", output.probe.times_s);
    }
}

#[test]
fn odd_sizes_depths_and_subsampling_are_decoded() {
    let cases = [
        ("odd.mp4", "641x359", "-vf format=yuv444p -c:v libx264 -preset ultrafast"),
        ("odd.avi", "641x359", "-vf format=yuvj420p -c:v mjpeg"),
        ("422.mkv", "320x240", "-pix_fmt yuv422p -c:v libx264 -preset ultrafast"),
        ("444.mkv", "320x240", "-pix_fmt yuv444p -c:v libx264 -preset ultrafast"),
        ("10-bit.mp4", "322x242", "-pix_fmt yuv420p10le -c:v libx264 -preset ultrafast"),
        ("10-bit-422.mkv", "320x240", "-pix_fmt yuv422p10le -c:v libx264 -preset ultrafast"),
        ("full-range.avi", "320x240", "-pix_fmt yuvj422p -c:v mjpeg"),
        ("rgb.mkv", "320x240", "-pix_fmt rgb24 -c:v libx264rgb -preset ultrafast"),
        ("grey.mkv", "320x240", "-pix_fmt gray -c:v libx264 -preset ultrafast"),
    ];
    for (name, size, codec) in cases {
        // Unlike testsrc2, testsrc keeps an odd size.
        let picture = format!("-f lavfi -i testsrc=size={size}:rate=25 -frames:v 10 {codec}");
        let Some(output) = decode_clip(name, &picture) else { return };
        let stated = output.probe.size.map(|(width, height)| format!("{width}x{height}"));
        assert_eq!((stated.as_deref(), output.probe.times_s.len()), (Some(size), 10), "{name}");
        assert!(output.probe.preview.is_some(), "{name}");
    }
}

/// Every picture format shows the same world: the preview's colours agree with those of plain 4:2:0.
#[test]
fn colours_do_not_depend_on_how_they_were_coded() {
    let bars = |codec: &str| format!("-f lavfi -i smptebars=size=320x240:rate=25 -frames:v 3 {codec}");
    let cases = [
        ("reference.mkv", "-pix_fmt yuv420p -c:v libx264 -preset ultrafast -qp 1"),
        ("444.mkv", "-pix_fmt yuv444p -c:v libx264 -preset ultrafast -qp 1"),
        ("10-bit.mkv", "-pix_fmt yuv420p10le -c:v libx264 -preset ultrafast -qp 1"),
        ("rgb.mkv", "-pix_fmt rgb24 -c:v libx264rgb -preset ultrafast -qp 1"),
        ("jpeg.avi", "-pix_fmt yuvj422p -c:v mjpeg -q:v 1"),
    ];
    let mut reference: Option<Vec<u8>> = None;
    for (name, codec) in cases {
        let Some(output) = decode_clip(name, &bars(codec)) else { return };
        let picture = image::load_from_memory(&output.probe.preview.unwrap()).unwrap().to_rgb8();
        let colours: Vec<u8> = (0..7).flat_map(|bar| picture.get_pixel(bar * 45 + 22, 60).0).collect();
        let first = reference.get_or_insert_with(|| colours.clone());
        let worst = colours.iter().zip(first.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(worst <= 6, "{name}: {colours:?} beside {first:?}");
    }
}

#[test]
fn a_rotated_recording_has_its_displayed_size() {
    let folder = tempfile::tempdir().unwrap();
    let upright = folder.path().join("upright.mp4");
    let Some(upright) = ffmpeg(&test_picture("320x240", 5, "-c:v libx264 -preset ultrafast"), &upright) else { return };
    let rotate = format!("-i {} -c copy -metadata:s:v:0 rotate=90", upright.display());
    let rotated = ffmpeg(&rotate, &folder.path().join("rotated.mp4")).unwrap();
    assert_eq!(probe(&rotated).0.unwrap().probe.size, Some((240, 320)));
}

#[test]
fn a_variable_rate_and_dropped_frames_keep_their_times() {
    // Frames 10 to 19 are missing; the ones after them keep their own time.
    let dropped = "-vf select='not(between(n\\,10\\,19))' -vsync passthrough -c:v libx264 -preset ultrafast";
    for name in ["dropped.mp4", "dropped.mkv", "dropped.ts"] {
        let Some(output) = decode_clip(name, &test_picture("320x240", 30, dropped)) else { return };
        assert_eq!(output.probe.times_s.len(), 30, "{name}");
        let gap = output.probe.times_s[10] - output.probe.times_s[9];
        assert!((gap - 11.0 / 25.0).abs() < 0.002, "{name}: {:?}", output.probe.times_s);
    }
}

#[test]
fn times_count_from_the_streams_start_in_every_container() {
    let late = "-itsoffset 0.5 -f lavfi -i testsrc2=size=320x240:rate=25 -f lavfi -i anullsrc -t 1.5 \
                -c:v libx264 -preset ultrafast -c:a aac"
        .to_owned();
    let cases = [
        ("offset.ts", test_picture("320x240", 25, "-c:v libx264 -preset ultrafast -bf 2")),
        ("late.mp4", late.clone()),
        ("late.mkv", late),
    ];
    for (name, arguments) in cases {
        let Some(output) = decode_clip(name, &arguments) else { return };
        assert!(output.probe.times_s[0].abs() < 0.001, "{name}: {:?}", &output.probe.times_s[..3]);
        assert!((output.probe.times_s[24] - 24.0 / 25.0).abs() < 0.002, "{name}: {:?}", output.probe.times_s);
    }
}

#[test]
fn times_continue_after_the_clock_was_set_back() {
    let folder = tempfile::tempdir().unwrap();
    let part = |offset: &str, name: &str| {
        let arguments =
            test_picture("320x240", 25, &format!("-c:v libx264 -preset ultrafast -output_ts_offset {offset}"));
        ffmpeg(&arguments, &folder.path().join(name)).map(|path| std::fs::read(path).unwrap())
    };
    let (Some(late), Some(early)) = (part("5000", "late.ts"), part("10", "early.ts")) else { return };
    let joined = folder.path().join("joined.ts");
    std::fs::write(&joined, [late, early].concat()).unwrap();
    let times_s = probe(&joined).0.unwrap().probe.times_s;
    assert_eq!(times_s.len(), 50);
    assert!(times_s.windows(2).all(|pair| (pair[1] - pair[0] - 0.04).abs() < 0.01), "{times_s:?}");
}

#[test]
fn a_recording_cut_anywhere_ends_where_its_bytes_end_or_says_why_not() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["whole.avi", "whole.mkv", "whole.ts", "whole.mp4"] {
        let picture = test_picture("320x240", 50, "-c:v libx264 -preset ultrafast -g 10");
        let Some(whole) = ffmpeg(&picture, &folder.path().join(name)) else { return };
        let bytes = std::fs::read(whole).unwrap();
        let cut = folder.path().join(name.replace("whole", "cut"));
        for percent in [1, 10, 50, 90, 99] {
            std::fs::write(&cut, &bytes[..bytes.len() * percent / 100]).unwrap();
            match probe(&cut).0 {
                Ok(output) => assert!(output.probe.times_s.len() <= 50 * percent / 100 + 2, "{name} {percent} %"),
                Err(AttemptFailure::Impossible(_)) => {
                    assert!(name == "whole.mp4" || percent < 50, "{name} {percent} %")
                }
                Err(other) => panic!("{name} {percent} %: {other:?}"),
            }
        }
    }
}

#[test]
fn sound_alone_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let sound = "-f lavfi -i sine=duration=1 -c:a aac";
    let Some(clip) = ffmpeg(sound, &folder.path().join("sound.mp4")) else { return };
    assert_eq!(refusal(&clip), "no-video-stream");
}

#[test]
fn a_codec_that_is_not_accepted_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let picture = test_picture("320x240", 5, "-c:v ffv1");
    let Some(clip) = ffmpeg(&picture, &folder.path().join("ffv1.mkv")) else { return };
    assert_eq!(refusal(&clip), "codec-not-accepted");
}

#[test]
fn a_file_that_is_no_video_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("notes.mp4");
    std::fs::write(&text, "Trainee was tired.\n").unwrap();
    assert_eq!(refusal(&text), "not-a-video");
}

#[test]
fn a_recording_whose_recorder_was_killed_is_refused_as_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("clip.mp4");
    let Some(clip) = ffmpeg(&test_picture("320x240", 25, "-c:v libx264 -preset ultrafast"), &clip) else { return };
    let whole = std::fs::read(&clip).unwrap();
    let index = whole.windows(4).position(|four| four == b"moov").unwrap();
    std::fs::write(&clip, &whole[..index - 4]).unwrap();
    assert_eq!(refusal(&clip), "recording-cut-off");
}

#[test]
fn only_the_first_field_of_an_interlaced_frame_is_used() {
    for (first_line, fields) in [
        (0, "-vf tinterlace=interleave_top,fieldorder=tff -flags +ilme+ildct -x264opts tff=1"),
        (1, "-vf tinterlace=interleave_bottom,fieldorder=bff -flags +ilme+ildct -x264opts bff=1"),
    ] {
        check_first_field(first_line, fields);
    }
}

/// Decodes an interlaced clip whose first field begins at this line, and compares it with a clip of twice the rate.
fn check_first_field(first_line: usize, fields: &str) {
    const DOUBLE_RATE: &str = "-f lavfi -i testsrc2=size=320x240:rate=50 -frames:v";
    const CODEC: &str = "-c:v libx264 -preset ultrafast -qp 1 -pix_fmt yuv420p";
    let folder = tempfile::tempdir().unwrap();
    let whole = ffmpeg(&format!("{DOUBLE_RATE} 20 {CODEC}"), &folder.path().join("whole.mp4"));
    let fields = ffmpeg(&format!("{DOUBLE_RATE} 10 {CODEC} {fields}"), &folder.path().join("fields.mp4"));
    let (Some(whole), Some(fields)) = (whole, fields) else { return };
    let open = |path| VideoFile::open(std::fs::File::open(path).unwrap(), MediaLimits::default()).unwrap();
    let (mut whole, mut fields) = (open(whole), open(fields));
    let (kept, filled) = (first_line, 1 - first_line);
    let mut frames = 0;
    while let Some(picture) = fields.next_picture().unwrap() {
        let (first, _second) = (whole.next_picture().unwrap().unwrap(), whole.next_picture().unwrap());
        assert!(picture.is_interlaced() && !first.is_interlaced());
        let (seen, first) = (picture.frame(), first.frame());
        let difference = |y: usize| (0..320).map(|x| seen.y.at(x, y).abs_diff(first.y.at(x, y))).max().unwrap();
        assert!((kept..240).step_by(2).all(|y| difference(y) < 8), "frame {frames}: not the first field");
        let between = |x: usize, y: usize| seen.y.at(x, y - 1).midpoint(seen.y.at(x, y + 1)) == seen.y.at(x, y);
        let inner = (filled..239).step_by(2).filter(|y| *y > 0);
        assert!(
            inner.clone().count() > 100 && inner.clone().all(|y| (0..320).all(|x| between(x, y))),
            "frame {frames}"
        );
        assert!((seen.time_s - first.time_s).abs() < 1e-6, "{} s, not {} s", seen.time_s, first.time_s);
        frames += 1;
    }
    assert_eq!(frames, 10);
}
