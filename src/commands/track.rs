//! `trocar track`: the whole tracker without a server. Recording, camera and annotations in; trajectory out, and on stderr
//! whether it may be believed. A refused session was tracked all the same: its path is written, and the status is 0.

use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use indicatif::{ProgressBar, ProgressStyle};
use rustix::time::ClockId;

use super::{Failure, verdict};
use crate::domain::files::annotations::{self, AnnotationsFile, LabelledRectangle, MarkedTool};
use crate::domain::files::camera::CameraFile;
use crate::domain::files::quality::QualityDocument;
use crate::domain::files::trajectory::write_csv;
use crate::media::{Limits, MediaError, VideoFile};
use crate::pipeline::quality::{self, Evidence};
use crate::pipeline::segmentation::palette::{self, Verdict};
use crate::pipeline::segmentation::samples::{ColourSamples, Rectangle};
use crate::pipeline::tracker::{MotionSettings, PoseMethod, Side, ToolSpec, Tracker, TrackerSettings, Tracking, View};

/// Arguments of `trocar track`.
#[derive(clap::Args)]
pub struct Args {
    /// The camera that recorded: camera.json of `trocar calibrate`, or any in OpenCV's convention.
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// What an instructor marked: tape colours, tool sizes.
    #[arg(long, value_name = "FILE")]
    annotations: PathBuf,
    /// Where to write the trajectory (CSV); standard output without it.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// As live: the causal filter's path, without the smoother.
    #[arg(long, conflicts_with = "raw")]
    causal: bool,
    /// Each frame's own measurement, without any filter over time.
    #[arg(long)]
    raw: bool,
    /// How borders become positions.
    #[arg(long, value_enum, default_value_t = Pose::Planes)]
    pose: Pose,
    /// Write the CPU time of each stage to this file (JSON, milliseconds).
    #[arg(long, value_name = "FILE")]
    timings: Option<PathBuf>,
    /// Write how the session was seen, and whether its numbers may be believed, to this file (JSON).
    #[arg(long, value_name = "FILE")]
    quality: Option<PathBuf>,
    /// Say nothing but errors.
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
pub fn run(args: Args) -> Result<(), Failure> {
    let mut clock = StageClock::start();
    let camera = CameraFile::parse(&read(&args.camera)?).map_err(|e| about(&args.camera, e))?;
    let marked = AnnotationsFile::parse(&read(&args.annotations)?).map_err(|e| about(&args.annotations, e))?;
    clock.lap_of(Stage::Samples);
    let samples = collect_samples(&marked, &args, &mut clock)?;
    if !args.quiet {
        warn_of_colours(&marked, &samples);
        clock.lap_of(Stage::Samples);
    }
    let mut video = open(&args.video)?;
    clock.lap_of(Stage::Decoding);
    let mut settings = TrackerSettings::new(camera.camera(), tools(&marked, &args.annotations)?, samples);
    settings.view = marked.view.map(|view| match view {
        annotations::View::Top => View::Top,
        annotations::View::Side => View::Side,
    });
    settings.pose = match args.pose {
        Pose::Planes => PoseMethod::TangentPlanes,
        Pose::Width => PoseMethod::PinholeWidth,
    };
    let tracking = follow(&mut video, settings, &args, &mut clock)?;
    let trajectory = match (args.raw, args.causal) {
        (true, _) => &tracking.raw,
        (_, true) => &tracking.filtered,
        _ => &tracking.smoothed,
    };
    match &args.out {
        Some(path) => write_csv(trajectory, create(path)?).with_context(|| format!("writing {}", path.display()))?,
        None => write_csv(trajectory, io::stdout().lock()).context("writing to standard output")?,
    }
    clock.lap_of(Stage::Writing);
    if let Some(path) = &args.timings {
        clock.save(create(path)?).with_context(|| format!("writing {}", path.display()))?;
    }
    let evidence = Evidence {
        calibration_rms_px: camera.rms_px(),
        frames_expected: video.info().frames_expected,
        ..Evidence::of_tracking(&tracking, MotionSettings::default())
    };
    let figures = quality::measure(&evidence);
    let judged = quality::judge(&figures);
    if let Some(path) = &args.quality {
        let document = QualityDocument::new(&tracking.quality, &figures, &judged);
        let text = serde_json::to_string_pretty(&document).context("writing JSON")?;
        writeln!(create(path)?, "{text}").with_context(|| format!("writing {}", path.display()))?;
    }
    if !args.quiet {
        report(&tracking);
        eprint!("{}", verdict::text(&judged));
    }
    Ok(())
}

/// A line for each colour that is not good; `trocar palette --check` tells more.
fn warn_of_colours(marked: &AnnotationsFile, samples: &ColourSamples) {
    let colours: Vec<String> = marked.marked_colours().into_iter().map(str::to_owned).collect();
    for warning in palette::verdicts(samples, &colours).iter().filter_map(Verdict::warning) {
        eprintln!("warning: {warning}");
    }
}

/// Tracks every frame of the recording.
fn follow(
    video: &mut VideoFile,
    settings: TrackerSettings,
    args: &Args,
    clock: &mut StageClock,
) -> Result<Tracking, Failure> {
    let info = video.info();
    let progress = Progress::new(info.frames_expected, args.quiet);
    let next = |video: &mut VideoFile| video.next_picture().map_err(|e| about(&args.video, e));
    let mut picture = next(video)?;
    let encoding =
        picture.as_ref().map(|p| p.frame().encoding).ok_or_else(|| about(&args.video, MediaError::NoFrames))?;
    clock.lap_of(Stage::Decoding);
    let mut tracker = Tracker::new(settings, info.width, info.height, encoding).map_err(|e| about(&args.camera, e))?;
    clock.lap_of(Stage::Preparing);
    while let Some(seen) = picture {
        tracker.observe(&seen.frame());
        progress.step();
        clock.lap_of(Stage::Tracking);
        picture = next(video)?;
        clock.lap_of(Stage::Decoding);
    }
    progress.end();
    let tracking = tracker.finish();
    clock.lap_of(Stage::Finishing);
    Ok(tracking)
}

/// The pixels inside the marked rectangles, from the clip in which they were marked.
fn collect_samples(marked: &AnnotationsFile, args: &Args, clock: &mut StageClock) -> Result<ColourSamples, Failure> {
    let folder = args.annotations.parent().unwrap_or(Path::new("."));
    let path = marked.video.as_ref().map_or_else(|| args.video.clone(), |name| folder.join(name));
    let mut video = open(&path)?;
    let info = video.info();
    marked.check_inside(info.width, info.height).map_err(|e| about(&args.annotations, e))?;
    let last = marked.labels.iter().map(|l| l.frame).max().unwrap_or(0);
    let mut samples: Option<ColourSamples> = None;
    let mut decoded = 0;
    while decoded <= last {
        let Some(picture) = video.next_picture().map_err(|e| about(&path, e))? else {
            return Err(about(
                &args.annotations,
                anyhow!("a rectangle is on frame {last}, but {} has only {decoded} frames", path.display()),
            ));
        };
        clock.lap_of(Stage::Decoding);
        let frame = picture.frame();
        let samples = samples.get_or_insert_with(|| ColourSamples::new(frame.encoding));
        for label in marked.labels.iter().filter(|l| l.frame == decoded) {
            samples.collect(&frame, &rectangle(marked, label));
        }
        decoded += 1;
        clock.lap_of(Stage::Samples);
    }
    samples.ok_or_else(|| about(&path, MediaError::NoFrames))
}

/// A marked rectangle that has been checked to lie inside the frame, as a mark of its colour.
pub(super) fn rectangle(marked: &AnnotationsFile, label: &LabelledRectangle) -> Rectangle {
    let size = |n: i64| usize::try_from(n).unwrap_or(0);
    let [x, y, w, h] = [label.x, label.y, label.w, label.h].map(size);
    Rectangle { label: marked.colour_of(&label.label).to_owned(), x, y, w, h }
}

fn tools(marked: &AnnotationsFile, path: &Path) -> Result<Vec<ToolSpec>, Failure> {
    let tools = marked.marked_tools().map_err(|e| about(path, e))?;
    Ok(tools.into_iter().map(tool).collect())
}

fn tool(marked: MarkedTool) -> ToolSpec {
    let MarkedTool { name, colour, side, diameter_mm, band_length_mm } = marked;
    let side = side.map(|side| match side {
        annotations::Side::Left => Side::Left,
        annotations::Side::Right => Side::Right,
    });
    ToolSpec { name, colour, side, diameter_mm, band_length_mm }
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
            if reasons.is_empty() { "" } else { "; not measured or not believed: " },
            reasons.join(", ")
        );
    }
}

pub(super) fn read(path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path).map_err(|e| about(path, e))
}

pub(super) fn open(path: &Path) -> Result<VideoFile, Failure> {
    let file = File::open(path).map_err(|e| about(path, e))?;
    VideoFile::open(file, Limits::default()).map_err(|e| about(path, e))
}

fn create(path: &Path) -> Result<BufWriter<File>, Failure> {
    Ok(BufWriter::new(File::create(path).with_context(|| format!("cannot write {}", path.display()))?))
}

/// Input that cannot be used, with the file it came from.
pub(super) fn about(path: &Path, error: impl Into<anyhow::Error>) -> Failure {
    Failure::Input(error.into().context(path.display().to_string()))
}

/// A bar on a terminal, a line every few seconds elsewhere, nothing when quiet.
struct Progress {
    bar: ProgressBar,
    plain: bool,
    expected: Option<u64>,
    last_line: std::cell::Cell<Instant>,
}

impl Progress {
    fn new(expected: Option<u64>, quiet: bool) -> Self {
        const LOOK: &str = "tracking {bar:30} {pos}/{len} frames, {eta} left";
        let terminal = io::stderr().is_terminal() && !quiet;
        let bar = if terminal { ProgressBar::new(expected.unwrap_or(0)) } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template(LOOK) {
            bar.set_style(style);
        }
        Self { bar, plain: !terminal && !quiet, expected, last_line: std::cell::Cell::new(Instant::now()) }
    }

    fn step(&self) {
        const EVERY: Duration = Duration::from_secs(5);
        self.bar.inc(1);
        if self.plain && self.last_line.get().elapsed() >= EVERY {
            self.last_line.set(Instant::now());
            let of = self.expected.map(|n| format!(" of {n}")).unwrap_or_default();
            eprintln!("tracking: {}{of} frames", self.bar.position());
        }
    }

    fn end(&self) {
        self.bar.finish_and_clear();
    }
}

/// What a run passes through; all but decoding are our own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Decoding,
    Samples,
    Preparing,
    Tracking,
    Finishing,
    Writing,
}

/// CPU time per stage.
///
/// All our own stages run on the thread that keeps this clock, and none of its time escapes the laps: what the process
/// used besides is the decoder's threads and the program's start. Unlike time on the wall, that is the same on a busy machine.
struct StageClock {
    began: Instant,
    last_ms: f64,
    laps: Vec<(Stage, f64)>,
}

impl StageClock {
    fn start() -> Self {
        Self { began: Instant::now(), last_ms: cpu_ms(ClockId::ThreadCPUTime), laps: Vec::new() }
    }

    /// Puts the time since the last lap down to a stage.
    fn lap_of(&mut self, stage: Stage) {
        let now = cpu_ms(ClockId::ThreadCPUTime);
        self.laps.push((stage, now - self.last_ms));
        self.last_ms = now;
    }

    /// All laps of the stages that are asked for.
    fn laps_of(&self, asked: impl Fn(Stage) -> bool) -> Vec<f64> {
        self.laps.iter().filter(|(stage, _)| asked(*stage)).map(|(_, ms)| *ms).collect()
    }

    fn save(&self, mut out: impl Write) -> io::Result<()> {
        let tracking = self.laps_of(|stage| stage == Stage::Tracking);
        let once = |asked| self.laps_of(|stage| stage == asked).iter().sum::<f64>();
        let own: f64 = self.laps_of(|stage| stage != Stage::Decoding).iter().sum();
        let text = serde_json::json!({
            "frames": tracking.len(),
            "own_cpu_ms_per_frame": own / tracking.len().max(1) as f64,
            "track_cpu_ms_per_frame": summary(&tracking),
            "once_cpu_ms": {
                "collect_samples": once(Stage::Samples),
                "prepare_tracker": once(Stage::Preparing),
                "fulcrum_and_smoother": once(Stage::Finishing),
                "write": once(Stage::Writing),
            },
            "decoding_and_start_cpu_ms": cpu_ms(ClockId::ProcessCPUTime) - own,
            "wall_ms": self.began.elapsed().as_secs_f64() * 1e3,
        });
        writeln!(out, "{text:#}")
    }
}

/// CPU time so far, ms.
fn cpu_ms(clock: ClockId) -> f64 {
    let time = rustix::time::clock_gettime(clock);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

/// Median, 95th percentile and mean.
fn summary(laps: &[f64]) -> serde_json::Value {
    let mut sorted = laps.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0);
    let mean = laps.iter().sum::<f64>() / laps.len().max(1) as f64;
    serde_json::json!({ "median": at(0.5), "p95": at(0.95), "mean": mean })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::segmentation::colour_table::ColourTable;
    use crate::pipeline::segmentation::knn::Knn;

    fn shared() -> Option<PathBuf> {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let named = std::env::var_os("TROCAR_SHARED").map(PathBuf::from);
        let beside = ["../shared", "../../shared"].map(|p| here.join(p));
        named.into_iter().chain(beside).find(|p| p.join("scenes").is_dir())
    }

    /// What quantising costs, on every pixel that tracking would look up.
    #[test]
    fn the_table_agrees_with_exact_neighbours_on_nearly_all_real_pixels() {
        let Some(shared) = shared() else {
            eprintln!("SKIPPED: no shared scenes; set TROCAR_SHARED");
            return;
        };
        for scene in ["V1", "V2"] {
            let folder = shared.join("scenes").join(scene);
            let args = Args {
                camera: folder.join("camera_true.json"),
                annotations: folder.join("annotations.json"),
                out: None,
                causal: false,
                raw: false,
                pose: Pose::Planes,
                timings: None,
                quality: None,
                quiet: true,
                video: folder.join("video.mp4"),
            };
            let marked = AnnotationsFile::parse(&read(&args.annotations).unwrap()).unwrap();
            let samples = collect_samples(&marked, &args, &mut StageClock::start()).unwrap();
            let names: Vec<String> = marked.marked_tools().unwrap().into_iter().map(|t| t.name).collect();
            let class = |label: &String| names.iter().position(|n| n == label).map_or(0, |i| i as u8 + 1);
            let classes: Vec<u8> = samples.labels.iter().map(class).collect();
            let knn = Knn::new(&samples, &classes).unwrap();
            let table = ColourTable::new(Knn::new(&samples, &classes).unwrap(), samples.encoding);
            let picture = open(&args.video).unwrap().next_picture().unwrap().unwrap();
            let frame = picture.frame();
            let pixels: Vec<(usize, usize)> = (0..frame.height())
                .step_by(6)
                .flat_map(|y| (0..frame.width()).step_by(6).map(move |x| (x, y)))
                .collect();
            let agree = |(x, y): &&(usize, usize)| {
                let codes = frame.yuv_at(*x, *y);
                table.class_of(codes) == knn.class_of(samples.encoding.colour_of(codes))
            };
            let share = pixels.iter().filter(agree).count() as f64 / pixels.len() as f64;
            eprintln!("{scene}: {:.3} % of {} pixels agree", 100.0 * share, pixels.len());
            assert!(share >= 0.995, "{scene}: only {:.2} % agree", 100.0 * share);
        }
    }
}
