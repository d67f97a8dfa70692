//! `trocar self-test`: tests whether a box still measures as well as when it was set up.
//!
//! Input is a recording of the printed checkerboard and of a taped rod that is held on the board's corners. A table
//! goes to stdout, and the same figures as JSON to a file. Yellow is a warning; red and *not measured* are failures.

use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow};

use super::progress::Meter;
use super::table::TextTable;
use super::track::{about, marked_samples, read, tracker_settings};
use super::{CommandFailure, print_result};
use crate::analysis::clock::open_with_clock;
use crate::analysis::scene::collect_scene;
use crate::analysis::self_test::{MAX_REACH_MM, SelfTestSetup, test_video};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::files::camera::CameraFile;
use crate::domain::self_test::{HoldReport, SelfTestReport, TrafficLight};
use crate::media::MediaLimits;
use crate::motion::quality::ports::Ports;
use crate::vision::camera::Board;
use crate::vision::camera::report::CornerCounts;

/// Arguments of `trocar self-test`.
#[derive(clap::Args)]
pub struct SelfTestArgs {
    /// Camera of the box: camera.json from `trocar calibrate`.
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// Annotations of an instructor: tape colours and tool sizes.
    #[arg(long, value_name = "FILE")]
    annotations: PathBuf,
    /// Number of inner corners of the board, where four squares meet: COLUMNSxROWS [default: the board of the
    /// calibration].
    #[arg(long, value_name = "9x6", requires = "square_mm")]
    board: Option<CornerCounts>,
    /// Side of a square, measured on the print, mm.
    #[arg(long, value_name = "MM", requires = "board")]
    square_mm: Option<f64>,
    /// Distance from the end of the tape to the tool's point, mm; 0 for a rod that ends where its tape ends.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = reach)]
    reach_mm: f64,
    /// File to write all figures to (JSON).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Show no progress on stderr.
    #[arg(long)]
    quiet: bool,
    /// The recording: first 3 s of the board alone in the box, then the end of the rod held still for 2 s on each of six
    /// inner corners of the board, spread over it.
    video: PathBuf,
}

/// Runs the command.
pub fn run(args: SelfTestArgs) -> Result<(), CommandFailure> {
    let camera = CameraFile::parse(&read(&args.camera)?).map_err(|e| about(&args.camera, e))?;
    let marked = AnnotationsFile::parse(&read(&args.annotations)?).map_err(|e| about(&args.annotations, e))?;
    let board = board(&args, &camera)?;
    let samples = marked_samples(&marked, &args.annotations, &args.video)?;
    let settings = tracker_settings(&args.annotations, &camera, &marked, &samples)?;
    let asked =
        SelfTestSetup { board, reach_mm: args.reach_mm, calibration_rms_px: camera.rms_px(), ports: Ports::default() };
    let (mut meter, mut frames) = (Meter::new(args.quiet), 0);
    let (file, limits) = (File::open(&args.video).map_err(|e| about(&args.video, e))?, MediaLimits::default());
    let file = Arc::new(file);
    let scene = collect_scene(&settings, file.clone(), limits, || ()).map_err(|e| about(&args.video, e))?;
    let (video, _) = open_with_clock(file, None, limits).map_err(|e| about(&args.video, e))?;
    let report = test_video(video, &scene, settings, asked, |done, of| {
        frames = done;
        meter.show("frames", done as usize, of.unwrap_or(done) as usize);
    });
    let report = report.map_err(|e| about(&args.video, e))?;
    meter.finish(&format!("{frames} frames tracked and searched for the board"));
    if let Some(path) = &args.out {
        let text = serde_json::to_string_pretty(&report).context("writing JSON")? + "\n";
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    print_result(&text_of(&report))?;
    match report.light {
        TrafficLight::Green | TrafficLight::Yellow => Ok(()),
        TrafficLight::Red => {
            Err(CommandFailure::Failed(anyhow!("the result is red: repair the box before it is used for training")))
        }
        TrafficLight::NotMeasured => {
            Err(CommandFailure::Failed(anyhow!("the box could not be measured: repeat the self-test")))
        }
    }
}

fn board(args: &SelfTestArgs, camera: &CameraFile) -> Result<Board, CommandFailure> {
    let given = args.board.map(|size| (size.columns, size.rows)).zip(args.square_mm);
    let of_calibration = || camera.board().map(|(size, mm)| ((size.columns as usize, size.rows as usize), mm));
    let ((columns, rows), square_mm) = given
        .or_else(of_calibration)
        .ok_or_else(|| about(&args.camera, anyhow!("names no board; add --board COLUMNSxROWS and --square-mm MM")))?;
    Board::new(columns, rows, square_mm).map_err(CommandFailure::input)
}

fn reach(text: &str) -> Result<f64, String> {
    let value: Option<f64> = text.parse().ok();
    let possible = value.filter(|mm| (0.0..=MAX_REACH_MM).contains(mm));
    possible.ok_or_else(|| format!("expected a number of mm from 0 to {MAX_REACH_MM}"))
}

fn text_of(report: &SelfTestReport) -> String {
    let mut text = format!("light: {}\n", light_text(report.light));
    for part in &report.parts {
        text += &format!("  {} {}: {}\n", part.part, light_text(part.light), part.finding);
        if !part.advice.is_empty() {
            text += &format!("    → {}\n", part.advice);
        }
    }
    for (number, placement) in (1..).zip(&report.placements) {
        text += &format!(
            "\nboard {number}: {:.1} to {:.1} s, {:.0} mm away, {:.2} px RMS on {} frames\n",
            placement.from_s, placement.to_s, placement.depth_mm, placement.rms_px, placement.looks
        );
    }
    if !report.holds.is_empty() {
        text += &format!("\nEvery rest of a tool, mm:\n{}", hold_table(&report.holds));
    }
    text
}

fn light_text(light: TrafficLight) -> String {
    light.name().replace('_', " ")
}

fn hold_table(holds: &[HoldReport]) -> String {
    let mut table = TextTable::new(["tool", "from s", "to s", "board", "corner", "error", "along", "across", "stated"]);
    for hold in holds {
        let (seconds, mm) =
            (|s: f64| format!("{s:.1}"), |mm: Option<f64>| mm.map_or("–".into(), |mm| format!("{mm:.2}")));
        let corner = hold.column.zip(hold.row).map(|(column, row)| format!("{column},{row}"));
        let why = hold.not_counted.map(|why| why.name().replace('_', " "));
        let stated = hold.inside.map_or("–", |inside| if inside { "inside" } else { "outside" });
        table.add_row([
            hold.tool.clone(),
            seconds(hold.from_s),
            seconds(hold.to_s),
            hold.placement.map_or("–".into(), |n| n.to_string()),
            corner.or(why).unwrap_or_default(),
            mm(hold.error_mm),
            mm(hold.along_mm),
            mm(hold.across_mm),
            stated.to_owned(),
        ]);
    }
    table.to_text()
}
