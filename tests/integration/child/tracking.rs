//! Tracking in a child gives, to the last bit, what the same tracker gives without one.

use std::io::BufReader;

use trocar::analysis::protocol::{ColourMark, PaletteWork, TrackWork};
use trocar::domain::clock::{ClockBasis, RecordingClock, TimeCorrection};
use trocar::domain::files::annotations::{AnnotationsFile, LabelledRectangle};
use trocar::domain::files::camera::CameraFile;
use trocar::media::{MediaLimits, Picture, VideoFile};
use trocar::vision::segmentation::samples::{ColourSamples, MarkedRectangle};
use trocar::vision::tracker::{MAX_WARM_UP_FRAMES, Tracker, TrackerSettings, Tracking};
use trocar::vision::trajectory::{PathKind, Sample};

use super::*;
use crate::resources::shared;

/// One of the shared rendered scenes.
pub struct SharedScene {
    folder: PathBuf,
    pub annotations: AnnotationsFile,
    pub camera: CameraFile,
}

impl SharedScene {
    /// The scene of this name; `None` if the shared data is not available.
    pub fn find(name: &str) -> Option<Self> {
        let folder = shared("scenes")?.join(name);
        let text = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
        let annotations = AnnotationsFile::parse(&text("annotations.json")).unwrap();
        let camera = CameraFile::parse(&text("camera_true.json")).unwrap();
        Some(Self { folder, annotations, camera })
    }

    pub fn video(&self) -> PathBuf {
        self.folder.join("video.mp4")
    }

    pub fn tools(&self) -> Vec<String> {
        self.annotations.marked_tools().unwrap().into_iter().map(|tool| tool.name).collect()
    }

    pub fn marks(&self) -> Vec<ColourMark> {
        let mark = |l: &LabelledRectangle| {
            let [x, y, w, h] = [l.x, l.y, l.w, l.h].map(|n| n.try_into().unwrap());
            let rectangle = MarkedRectangle { label: l.label.clone(), x, y, w, h };
            ColourMark { frame: l.frame, rectangle, stroke: l.stroke }
        };
        self.annotations.labels.iter().map(mark).collect()
    }

    fn palette(&self) -> ColourSamples {
        let work = ChildWork::Palette(PaletteWork {
            marks: self.marks(),
            tools: self.tools(),
            frames: None,
            has_empty_box: false,
        });
        ask(work, &self.video()).unwrap().palette.samples.unwrap()
    }

    fn settings(&self, samples: ColourSamples) -> TrackerSettings {
        let tools = self.annotations.marked_tools().unwrap().into_iter().map(Into::into).collect();
        let view = self.annotations.view.map(Into::into);
        TrackerSettings { view, ..TrackerSettings::new(self.camera.camera(), tools, samples) }
    }

    fn work(&self, samples: ColourSamples, time: Option<TimeCorrection>) -> ChildWork {
        ChildWork::Track(TrackWork { tracker: self.settings(samples), time })
    }
}

fn ask(work: ChildWork, input: &Path) -> Result<ChildOutput, AttemptFailure> {
    ask_with(work, &[input])
}

fn ask_with(work: ChildWork, inputs: &[&Path]) -> Result<ChildOutput, AttemptFailure> {
    let attempt = ChildAttempt {
        program: &program(),
        request: ChildRequest { threads: 2, work },
        inputs: inputs.iter().map(|input| File::open(input).unwrap()).collect(),
        budget: &Budget { wall: std::time::Duration::from_secs(600), ..budget() },
        stop: &StopSwitch::new().unwrap(),
    };
    run_attempt(attempt, |_| {}).0
}

/// Tracks the same recording in this process.
fn track_in_process(scene: &SharedScene, settings: TrackerSettings) -> Tracking {
    let open = || VideoFile::open(BufReader::new(File::open(scene.video()).unwrap()), MediaLimits::default()).unwrap();
    let pictures = |mut video: VideoFile| std::iter::from_fn(move || video.next_picture().unwrap());
    let (video, info) = (open(), open().info());
    let first: Vec<Picture> = pictures(video).take(MAX_WARM_UP_FRAMES).collect();
    let first: Vec<_> = first.iter().map(Picture::frame).collect();
    let mut tracker = Tracker::new(settings, info.width, info.height, first[0].encoding).unwrap();
    tracker.warm_up(&first);
    pictures(open()).for_each(|picture| drop(tracker.observe(&picture.frame())));
    tracker.finish()
}

#[test]
fn a_child_tracks_to_the_last_bit_as_the_tracker_does() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let palette = scene.palette();
    let output = ask(scene.work(palette.clone(), None), &scene.video()).unwrap().track;
    let tracking = track_in_process(&scene, scene.settings(palette));
    let [raw, filtered, smoothed] =
        [PathKind::Raw, PathKind::Filtered, PathKind::Smoothed].map(|kind| tracking.trajectory(kind));
    assert!(!output.smoothed.is_empty());
    assert!(output.raw == raw.samples, "raw"); // thousands of rows: not worth printing
    assert!(output.filtered == filtered.samples, "filtered");
    assert!(output.smoothed == smoothed.samples, "smoothed");
    assert_eq!(output.recording.times_s, smoothed.frame_times_s);
    assert_eq!(output.recording.seen.len(), output.recording.times_s.len() * smoothed.tools.len());
}

/// V1 with the tag of a phone that captured at this rate.
fn tagged_clip(scene: &SharedScene, folder: &Path, rate_hz: f64) -> Option<PathBuf> {
    let video = scene.video();
    let arguments = format!(
        "-i {} -c copy -movflags use_metadata_tags -metadata com.android.capture.fps={rate_hz}",
        video.display()
    );
    clips::ffmpeg(&arguments, &folder.join("tagged.mp4"))
}

#[test]
fn times_are_scaled_before_tracking_so_that_speeds_follow() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let palette = scene.palette();
    let as_stamped = ask(scene.work(palette.clone(), None), &scene.video()).unwrap().track;
    let stamps = &as_stamped.recording.times_s;
    assert_eq!(as_stamped.clock, Some(RecordingClock::default()));
    let rate_hz = 1.0 / (stamps[1] - stamps[0]);
    let length_s = stamps[stamps.len() - 1] - stamps[0];
    for time in [TimeCorrection::FrameRate(2.0 * rate_hz), TimeCorrection::Duration(0.5 * length_s)] {
        let output = ask(scene.work(palette.clone(), Some(time)), &scene.video()).unwrap().track;
        let clock = output.clock.unwrap();
        assert!(clock.basis == time.basis() && (clock.factor - 0.5).abs() < 1e-6, "{clock:?}");
        let expected: Vec<f64> = stamps.iter().map(|time_s| time_s * clock.factor).collect();
        assert_eq!(output.recording.times_s, expected);
        let speed = |rows: &[Sample]| {
            rows.iter().filter_map(|row| row.velocity_mm_s).map(|v| v.norm()).sum::<f64>() / rows.len() as f64
        };
        let ratio = speed(&output.smoothed) / speed(&as_stamped.smoothed);
        assert!((1.8..2.2).contains(&ratio), "speeds rise {ratio}-fold in half the time");
    }
    match ask(scene.work(palette, Some(TimeCorrection::Duration(1e4 * length_s))), &scene.video()) {
        Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, "impossible-time", "{problem:?}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn slow_motion_is_recognised_by_its_tag_and_a_person_overrules_it() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let palette = scene.palette();
    let folder = tempfile::tempdir().unwrap();
    let plain = ask(scene.work(palette.clone(), None), &scene.video()).unwrap().track.recording.times_s;
    let rate_hz = 1.0 / (plain[1] - plain[0]);
    let Some(clip) = tagged_clip(&scene, folder.path(), (8.0 * rate_hz).round()) else { return };
    let slow = ask(scene.work(palette.clone(), None), &clip).unwrap().track;
    let clock = slow.clock.unwrap();
    assert!(clock.basis == ClockBasis::CaptureRate && (clock.factor - 0.125).abs() < 1e-3, "{clock:?}");
    assert!((slow.recording.times_s[8] - plain[1]).abs() < 1e-3);
    let overruled = ask(scene.work(palette, Some(TimeCorrection::FrameRate(rate_hz))), &clip).unwrap().track;
    let clock = overruled.clock.unwrap();
    assert!(clock.basis == ClockBasis::FrameRate && (clock.factor - 1.0).abs() < 1e-6, "{clock:?}");
    assert_eq!(clock.capture_rate_hz, Some((8.0 * rate_hz).round()));
}

#[test]
fn a_camera_of_another_size_is_named() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let camera = trocar::vision::camera::Camera { width: 640, height: 480, ..scene.camera.camera() };
    let work = TrackerSettings { camera, ..scene.settings(scene.palette()) };
    match ask(ChildWork::Track(TrackWork { tracker: work, time: None }), &scene.video()) {
        Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, "camera-size", "{problem:?}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_picture_of_the_empty_box_of_another_size_is_named() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("empty.png");
    image::RgbImage::new(64, 48).save(&picture).unwrap();
    let colours = PaletteWork { marks: scene.marks(), tools: scene.tools(), frames: None, has_empty_box: true };
    let track = scene.work(scene.palette(), None);
    for work in [ChildWork::Palette(colours), track] {
        match ask_with(work, &[&scene.video(), &picture]) {
            Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, "empty-box-size", "{problem:?}"),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_recording_without_the_marker_says_so() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let work = scene.work(scene.palette(), None);
    let folder = tempfile::tempdir().unwrap();
    let CameraFile { width, height, .. } = scene.camera;
    let grey = format!("-f lavfi -i color=gray:size={width}x{height}:rate=25 -frames:v 10 -c:v libx264");
    let Some(clip) = clips::ffmpeg(&grey, &folder.path().join("grey.mp4")) else { return };
    match ask(work, &clip) {
        Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, "no-tool-seen", "{problem:?}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn impossible_marks_are_refused_by_name() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let mark = |frame, [x, y, w, h]: [usize; 4]| ColourMark {
        frame,
        rectangle: MarkedRectangle { label: "orange".into(), x, y, w, h },
        stroke: None,
    };
    let cases = [
        (mark(1_000_000, [1, 1, 2, 2]), "mark-beyond-the-end"),
        (mark(0, [1, 1, u32::MAX as usize, 2]), "mark-outside"),
        (mark(0, [1, 1, 0, 2]), "mark-outside"),
    ];
    for (mark, slug) in cases {
        let work =
            ChildWork::Palette(PaletteWork { marks: vec![mark], tools: vec![], frames: None, has_empty_box: false });
        match ask(work, &scene.video()) {
            Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, slug, "{problem:?}"),
            other => panic!("{slug}: {other:?}"),
        }
    }
}
