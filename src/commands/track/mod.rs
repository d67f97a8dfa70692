//! `trocar track`: the whole tracker without a server. From recording, camera and annotations it computes a trajectory,
//! and prints the quality verdict to stderr. The trajectory of a refused session is written too, with exit status 0.

mod debug;
mod empty_box;
mod marks;
mod progress;
mod reference;
mod stages;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;

use debug::{DebugArgs, DebugPictures, DebugScene};
use empty_box::empty_box;
use marks::{ClipMarks, SampleCollector};
use progress::TrackProgress;
use reference::ReferenceSegmenter;
use stages::{StageClock, TrackStage};

use super::{CommandFailure, verdict};
use crate::analysis::clock::{ClockError, open_with_clock};
use crate::analysis::marked::colours_of;
use crate::analysis::scene::collect_scene;
use crate::domain::clock::{ClockBasis, RecordingClock, StampFacts, TimeCorrection};
use crate::domain::files::annotations::{AnnotationsFile, LabelledRectangle};
use crate::domain::files::camera::CameraFile;
use crate::domain::files::quality::QualityDocument;
use crate::domain::files::trajectory::write_csv;
use crate::domain::text::Invalid;
use crate::heap;
use crate::media::{MediaError, MediaLimits, Picture, ReadAhead, VideoFile};
use crate::motion::quality::{self, QualityInput};
use crate::vision::frame::Frame;
use crate::vision::segmentation::palette::{self, TapeVerdict};
use crate::vision::segmentation::samples::{ColourSamples, MarkedRectangle};
use crate::vision::tracker::{
    CameraView, FirstLook, MAX_WARM_UP_FRAMES, MotionSettings, PoseMethod, SceneSamples, SecondLook, ToolSpec, Tracker,
    TrackerSettings, Tracking,
};
use crate::vision::trajectory::{PathKind, Sample, Trajectory};

/// Arguments of `trocar track`.
#[derive(clap::Args)]
pub struct TrackArgs {
    /// Camera of the recording: camera.json from `trocar calibrate`, or another file in OpenCV's convention.
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// Annotations of an instructor: tape colours and tool sizes.
    #[arg(long, value_name = "FILE")]
    annotations: PathBuf,
    /// Photo of the box without tools, for tools without tape; it takes precedence over the one that the annotations
    /// name.
    #[arg(long, value_name = "PICTURE")]
    empty: Option<PathBuf>,
    /// File to write the trajectory to (CSV) [default: standard output].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the positions as in a live feed: each frame uses only earlier frames.
    #[arg(long, conflicts_with = "raw")]
    causal: bool,
    /// Write each frame's own measurement, without filtering over time.
    #[arg(long)]
    raw: bool,
    /// Method that computes positions from the borders of the tape.
    #[arg(long, value_enum, default_value_t = Pose::Planes)]
    pose: Pose,
    /// Follow bare dark shafts by a reference method from the literature, to compare other methods with it.
    #[arg(long, value_enum, value_name = "METHOD",
        conflicts_with_all = ["causal", "raw", "pose", "quality", "dir", "every", "frames"])]
    segmenter: Option<ReferenceSegmenter>,
    /// Write the CPU time and wall time of each stage to this file (JSON, milliseconds).
    #[arg(long, value_name = "FILE")]
    timings: Option<PathBuf>,
    /// Write the quality figures and the verdict on the session to this file (JSON).
    #[arg(long, value_name = "FILE")]
    quality: Option<PathBuf>,
    #[command(flatten)]
    debug: DebugArgs,
    /// True frame rate of the recording, where its time stamps are wrong: all times are scaled to it.
    #[arg(long, value_name = "HZ", conflicts_with = "duration")]
    frame_rate: Option<f64>,
    /// True time from the first frame to the last, seconds, where the time stamps are wrong.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Print only errors.
    #[arg(long)]
    quiet: bool,
    /// The recording.
    video: PathBuf,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Pose {
    /// Tangent planes and a joint fit of borders and band ends.
    Planes,
    /// The thesis's width formula.
    Width,
}

/// Runs the command.
pub fn run(args: TrackArgs) -> Result<(), CommandFailure> {
    heap::use_single_heap().context("limiting memory to one heap")?;
    let mut clock = StageClock::start();
    let mut pictures = DebugPictures::open(&args.debug)?;
    let camera = CameraFile::parse(&read(&args.camera)?).map_err(|e| about(&args.camera, e))?;
    let marked = AnnotationsFile::parse(&read(&args.annotations)?).map_err(|e| about(&args.annotations, e))?;
    clock.add_lap(TrackStage::Samples);
    let marks = ClipMarks::new(&marked, &args.annotations, &args.video);
    if let Some(segmenter) = args.segmenter {
        return reference::run(&args, segmenter, &camera, &marked, &marks, clock);
    }
    let PassResult { tracking, live, frames_expected, frames_interlaced, time, .. } =
        collect_and_track(&args, &camera, &marked, &marks, pictures.as_mut(), &mut clock)?;
    heap::release_free_memory(); // the paths need the memory now
    let mut trajectory = match (args.raw, live) {
        (true, _) => tracking.trajectory(PathKind::Raw),
        (_, Some(samples)) => Trajectory { samples, ..tracking.trajectory(PathKind::Smoothed) },
        _ => tracking.trajectory(PathKind::Smoothed),
    };
    write_path(&args, &trajectory, clock)?;
    if args.raw || args.causal {
        trajectory = tracking.trajectory(PathKind::Smoothed);
    }
    let evidence = QualityInput {
        calibration_rms_px: camera.rms_px(),
        frames_expected,
        frames_interlaced: Some(frames_interlaced),
        ..QualityInput::of_tracking(&tracking, &trajectory, MotionSettings::default())
    };
    let figures = quality::measure(&evidence);
    let judged = quality::judge(&figures);
    if let Some(path) = &args.quality {
        let document = QualityDocument::new(&tracking.quality, &figures, &judged);
        let text = serde_json::to_string_pretty(&document).context("writing JSON")?;
        let mut file = create(path)?;
        writeln!(file, "{text}").and_then(|()| file.flush()).with_context(|| format!("writing {}", path.display()))?;
    }
    if !args.quiet {
        report_times(time, &tracking.trajectory(PathKind::Smoothed).frame_times_s);
        report(&tracking);
        pictures.iter().for_each(|pictures| eprintln!("{}", pictures.report()));
        eprint!("{}", verdict::text(&judged));
    }
    Ok(())
}

/// Writes the trajectory, and the times that the stages took.
fn write_path(args: &TrackArgs, trajectory: &Trajectory, mut clock: StageClock) -> anyhow::Result<()> {
    match &args.out {
        Some(path) => write_csv(trajectory, create(path)?).with_context(|| format!("writing {}", path.display()))?,
        None => write_csv(trajectory, io::stdout().lock()).context("writing to standard output")?,
    }
    clock.add_lap(TrackStage::Writing);
    if let Some(path) = &args.timings {
        clock.save(create(path)?).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}

/// Collects the marked colours and tracks.
///
/// To save time, the samples are first collected without decoding most frames. Tracking decodes all frames and collects
/// them again. In a damaged recording the two can differ; then both steps are repeated without this shortcut.
fn collect_and_track(
    args: &TrackArgs,
    camera: &CameraFile,
    marked: &AnnotationsFile,
    marks: &ClipMarks<'_>,
    mut pictures: Option<&mut DebugPictures>,
    clock: &mut StageClock,
) -> Result<PassResult, CommandFailure> {
    if let Some(samples) = marks.collect_from_few_frames(clock)? {
        warn_about_colours(args, marked, &samples);
        clock.add_lap(TrackStage::Samples);
        let followed = track_recording(
            args,
            marked,
            settings(args, camera, marked, &samples)?,
            Some(marks),
            pictures.as_deref_mut(),
            clock,
        )?;
        if followed.samples.as_ref().is_some_and(|again| *again == samples) {
            return Ok(followed);
        }
    }
    clock.restart_tracking();
    let samples = marks.collect(clock)?;
    warn_about_colours(args, marked, &samples);
    clock.add_lap(TrackStage::Samples);
    track_recording(args, marked, settings(args, camera, marked, &samples)?, None, pictures, clock)
}

fn settings(
    args: &TrackArgs,
    camera: &CameraFile,
    marked: &AnnotationsFile,
    samples: &ColourSamples,
) -> Result<TrackerSettings, CommandFailure> {
    let pose = match args.pose {
        Pose::Planes => PoseMethod::TangentPlanes,
        Pose::Width => PoseMethod::PinholeWidth,
    };
    Ok(TrackerSettings { pose, ..tracker_settings(&args.annotations, camera, marked, samples)? })
}

/// Default settings for the tools of an annotations file.
pub(super) fn tracker_settings(
    annotations: &Path,
    camera: &CameraFile,
    marked: &AnnotationsFile,
    samples: &ColourSamples,
) -> Result<TrackerSettings, CommandFailure> {
    let mut settings = TrackerSettings::new(camera.camera(), tools(marked, annotations)?, samples.clone());
    settings.view = marked.view.map(CameraView::from);
    Ok(settings)
}

/// Samples of the marked colours, from the clip that the annotations name, else from the clip to be tracked.
pub(super) fn marked_samples(
    marked: &AnnotationsFile,
    file: &Path,
    tracked: &Path,
) -> Result<ColourSamples, CommandFailure> {
    ClipMarks::new(marked, file, tracked).collect(&mut StageClock::start())
}

/// Prints a line for each tape colour that is not good. `trocar palette --check` gives details.
fn warn_about_colours(args: &TrackArgs, marked: &AnnotationsFile, samples: &ColourSamples) {
    if args.quiet {
        return;
    }
    for warning in
        palette::verdicts(samples, &colours_of(&marked.tape_colours())).iter().filter_map(TapeVerdict::warning)
    {
        eprintln!("warning: {warning}");
    }
}

/// Result of one pass over the recording.
struct PassResult {
    tracking: Tracking,
    /// The causal samples of each frame, with `--causal`.
    live: Option<Vec<Sample>>,
    /// The marked colours, collected again, if requested.
    samples: Option<ColourSamples>,
    frames_expected: Option<u64>,
    frames_interlaced: u64,
    time: RecordingClock,
}

/// Tracks every frame of the recording, while another thread decodes the next frames.
fn track_recording(
    args: &TrackArgs,
    marked: &AnnotationsFile,
    settings: TrackerSettings,
    marks: Option<&ClipMarks<'_>>,
    mut pictures: Option<&mut DebugPictures>,
    clock: &mut StageClock,
) -> Result<PassResult, CommandFailure> {
    let in_video = |error: MediaError| about(&args.video, error);
    let mut box_scene = box_scene(args, &settings, clock)?;
    let (video, time) = open_with_time(args)?;
    let info = video.info();
    clock.add_lap(TrackStage::Opening);
    let progress = TrackProgress::new(info.frames_expected, args.quiet);
    let scene = DebugScene::new(&settings);
    let mut ahead = ReadAhead::new(video).map_err(in_video)?;
    let first: Vec<Frame<'_>> =
        ahead.first_pictures(MAX_WARM_UP_FRAMES).map_err(in_video)?.iter().map(Picture::frame).collect();
    let encoding = first.first().ok_or_else(|| in_video(MediaError::NoFrames))?.encoding;
    clock.add_lap(TrackStage::Waiting);
    let tracker = Tracker::new(settings, info.width, info.height, encoding);
    let mut tracker = tracker.map_err(|problem| about(&args.camera, problem.of_shown(info.shown_size)))?;
    // Read before the first frame is tracked: a picture that cannot be used is refused at once.
    if let Some(picture) = empty_box(args, marked, &info)? {
        box_scene.set_empty(&picture.frame(), encoding);
    }
    tracker.learn_scene(&box_scene);
    drop(box_scene);
    tracker.warm_up(&first);
    clock.add_lap(TrackStage::Preparing);
    let mut again = marks.map(ClipMarks::collector);
    let mut frames_interlaced = 0;
    let mut live = args.causal.then(Vec::new);
    while let Some(seen) = ahead.next_picture().map_err(in_video)? {
        clock.add_lap(TrackStage::Waiting);
        let frame = seen.frame();
        frames_interlaced += u64::from(seen.is_interlaced());
        if let Some(again) = &mut again {
            again.add_frame(&frame);
        }
        let report = match pictures.as_mut().filter(|pictures| pictures.wants(frame.index)) {
            None => {
                let report = tracker.observe(&frame);
                clock.add_lap(TrackStage::Tracking);
                report
            }
            Some(pictures) => {
                let (report, trace) = tracker.observe_traced(&frame);
                clock.add_lap(TrackStage::Tracking);
                pictures.draw(&scene, &frame, &report, &trace)?;
                clock.add_lap(TrackStage::Writing);
                report
            }
        };
        if let Some(live) = &mut live {
            live.extend(report.tools.iter().filter_map(|tool| tool.filtered));
        }
        progress.step();
    }
    progress.end();
    let frames_expected = ahead.whole().frames_stated;
    drop(ahead); // the paths need the memory now
    // Causal positions use only earlier frames, so they have no second look.
    let tracking = match live {
        Some(_) => tracker.finish(),
        None => match tracker.finish_first_look() {
            FirstLook::Enough(tracking) => tracking,
            FirstLook::LookAgain(second) => look_again(args, *second, clock)?,
        },
    };
    clock.add_lap(TrackStage::Finishing);
    let samples = again.and_then(SampleCollector::into_samples);
    Ok(PassResult { tracking, live, samples, frames_expected, frames_interlaced, time })
}

/// Frames that show the box, for tools without tape.
fn box_scene(
    args: &TrackArgs,
    settings: &TrackerSettings,
    clock: &mut StageClock,
) -> Result<SceneSamples, CommandFailure> {
    let file = File::open(&args.video).map_err(|e| about(&args.video, e))?;
    let scene = collect_scene(settings, file.into(), MediaLimits::default(), || ());
    clock.add_lap(TrackStage::DecodingScene);
    scene.map_err(|e| about(&args.video, e))
}

/// Tracks the recording once more, with what the first look has taught.
fn look_again(args: &TrackArgs, mut second: SecondLook, clock: &mut StageClock) -> Result<Tracking, CommandFailure> {
    let in_video = |error: MediaError| about(&args.video, error);
    clock.add_lap(TrackStage::Finishing);
    let (video, _) = open_with_time(args)?;
    let progress = TrackProgress::new(video.info().frames_expected, args.quiet);
    let mut ahead = ReadAhead::new(video).map_err(in_video)?;
    while let Some(seen) = ahead.next_picture().map_err(in_video)? {
        clock.add_lap(TrackStage::Waiting);
        second.observe(&seen.frame());
        clock.add_lap(TrackStage::Tracking);
        progress.step();
    }
    progress.end();
    Ok(second.finish().0)
}

/// A labelled rectangle as a mark of its colour. The rectangle must lie inside the frame.
pub(super) fn rectangle(marked: &AnnotationsFile, label: &LabelledRectangle) -> MarkedRectangle {
    let size = |n: i64| usize::try_from(n).unwrap_or(0);
    let [x, y, w, h] = [label.x, label.y, label.w, label.h].map(size);
    MarkedRectangle { label: marked.colour_of(&label.label).to_owned(), x, y, w, h }
}

/// The tools that the annotations name.
pub(super) fn tools(marked: &AnnotationsFile, path: &Path) -> Result<Vec<ToolSpec>, CommandFailure> {
    let tools = marked.marked_tools().map_err(|e| about(path, e))?;
    Ok(tools.into_iter().map(ToolSpec::from).collect())
}

/// Opens the recording with the times that the arguments or its capture rate give.
fn open_with_time(args: &TrackArgs) -> Result<(VideoFile, RecordingClock), CommandFailure> {
    let time = TimeCorrection::new(args.frame_rate, args.duration);
    let time = time.map_err(|invalid| CommandFailure::Input(anyhow::anyhow!("{}", as_options(&invalid))))?;
    let file = File::open(&args.video).map_err(|e| about(&args.video, e))?;
    match open_with_clock(file, time, MediaLimits::default()) {
        Err(ClockError::Correction(invalid)) => {
            Err(CommandFailure::Input(anyhow::anyhow!("{}: {}", args.video.display(), as_options(&invalid))))
        }
        opened => opened.map_err(|e| about(&args.video, e)),
    }
}

/// A refusal of a correction, with the names of the options instead of those of the API.
fn as_options(invalid: &Invalid) -> String {
    invalid.to_string().replace("true_frame_rate_hz", "--frame-rate").replace("true_duration_s", "--duration")
}

/// Says that the times are not those of the file, or that they may be wrong.
fn report_times(clock: RecordingClock, times_s: &[f64]) {
    let RecordingClock { basis, factor, capture_rate_hz } = clock;
    let stamped_hz = StampFacts::of_times(times_s).before(factor).rate_hz;
    match (basis, capture_rate_hz) {
        (ClockBasis::Stamps, Some(rate)) if clock.may_be_slow_motion(stamped_hz) => eprintln!(
            "times: the file says that it was captured at {rate} frames a second and plays at {:.4}. If it is slow motion, \
             give --frame-rate {rate}; if frames were lost in the dark, the times are right",
            stamped_hz.unwrap_or_default()
        ),
        (ClockBasis::Stamps, _) => {}
        (ClockBasis::CaptureRate, Some(rate)) => eprintln!(
            "times: the file says that it was captured at {rate} frames a second and plays at {:.4}; all times are \
             multiplied by {factor:.4}. If that is wrong, give --frame-rate",
            rate * factor
        ),
        _ => eprintln!("times: all times of the file are multiplied by {factor:.4}"),
    }
}

fn report(tracking: &Tracking) {
    for tool in &tracking.quality.tools {
        let reasons: Vec<String> = tool.reasons.iter().map(|(r, n)| format!("{} {n}", r.name())).collect();
        eprintln!(
            "{}: measured on {} of {} frames, bridged on {}{}{}",
            tool.tool,
            tool.observed,
            tracking.quality.frames,
            tool.predicted,
            if reasons.is_empty() { "" } else { "; reasons for missing measurements: " },
            reasons.join(", ")
        );
    }
}

pub(super) fn read(path: &Path) -> Result<String, CommandFailure> {
    std::fs::read_to_string(path).map_err(|e| about(path, e))
}

pub(super) fn open(path: &Path) -> Result<VideoFile, CommandFailure> {
    let file = File::open(path).map_err(|e| about(path, e))?;
    VideoFile::open(file, MediaLimits::default()).map_err(|e| about(path, e))
}

fn create(path: &Path) -> anyhow::Result<BufWriter<File>> {
    Ok(BufWriter::new(File::create(path).with_context(|| format!("cannot write {}", path.display()))?))
}

/// An input failure with the path of the file that caused it.
pub(super) fn about(path: &Path, error: impl Into<anyhow::Error>) -> CommandFailure {
    CommandFailure::Input(error.into().context(path.display().to_string()))
}
