//! `trocar calibrate`: computes camera.json from photos or a video of a checkerboard.
//!
//! The table of photos, the camera and its standard deviations go to stdout, progress goes to stderr.

use std::fs::File;
use std::io::{BufReader, IsTerminal, Read, Seek, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::CommandFailure;
use crate::analysis::calibration::{self, CheckedCalibration, Views, ViewsError, calibrate_and_check};
use crate::domain::camera_warning::camera_warnings;
use crate::domain::files::calibration::camera_file;
use crate::media::MediaLimits;
use crate::vision::camera::report::CornerCounts;
use crate::vision::camera::{Board, BoardView, Calibration, PhotoReport};

/// Arguments of `trocar calibrate`.
#[derive(clap::Args)]
pub struct CalibrateArgs {
    /// Number of inner corners of the board, where four squares meet: COLUMNSxROWS.
    #[arg(long, value_name = "9x6")]
    board: CornerCounts,
    /// Side of a square, measured on the print, mm.
    #[arg(long, value_name = "MM")]
    square_mm: f64,
    /// File to write the camera to.
    #[arg(long, value_name = "FILE", default_value = "camera.json")]
    out: PathBuf,
    /// Show no progress on stderr.
    #[arg(long)]
    quiet: bool,
    /// Photos (JPEG, PNG, BMP) of the board, tilted to different sides, all of the same size; or one video of it.
    #[arg(required = true, value_name = "PHOTO…|VIDEO")]
    inputs: Vec<PathBuf>,
}

/// Runs the command.
pub fn run(args: CalibrateArgs) -> Result<(), CommandFailure> {
    let board = Board::new(args.board.columns, args.board.rows, args.square_mm).map_err(CommandFailure::input)?;
    let progress = CalibrateProgress::new(args.quiet);
    let views = views(&args.inputs, board, &progress)?;
    progress.end();
    let CheckedCalibration { calibration, at_edge } = match calibrate_and_check(&views, board) {
        Ok(checked) => checked,
        Err(refusal) => {
            print_photos(&views.views)?;
            return Err(CommandFailure::input(refusal.without_photo_reasons()));
        }
    };
    print_calibration(&calibration)?;
    let file = camera_file(
        &calibration,
        &at_edge,
        &jiff::Timestamp::now().round(jiff::Unit::Second).map_err(anyhow::Error::from)?.to_string(),
    );
    for warning in camera_warnings(&file) {
        eprintln!("warning: {}", warning.text);
    }
    std::fs::write(&args.out, file.to_json()).with_context(|| format!("writing {}", args.out.display()))?;
    Ok(())
}

fn views(inputs: &[PathBuf], board: Board, progress: &CalibrateProgress) -> Result<Views, CommandFailure> {
    let opened = inputs.iter().map(|path| open(path)).collect::<Result<Vec<_>, CommandFailure>>()?;
    let names = inputs.iter().map(|path| name_of(path));
    let limits = MediaLimits::default();
    let found = match <[OpenInput; 1]>::try_from(opened) {
        Ok([video]) if !video.is_photo => {
            let name: String = names.collect();
            calibration::views_of_video(&name, video.file, board, limits, |done, of| progress.frame(done, of))
        }
        Ok(photo) => views_of_photos(names.zip(photo), board, limits, progress),
        Err(photos) => views_of_photos(names.zip(photos), board, limits, progress),
    };
    found.map_err(|error| CommandFailure::input(with_hint(error)))
}

fn views_of_photos(
    photos: impl ExactSizeIterator<Item = (String, OpenInput)>,
    board: Board,
    limits: MediaLimits,
    progress: &CalibrateProgress,
) -> Result<Views, ViewsError> {
    let (mut done, count) = (0, photos.len());
    let bytes = photos.map(|(name, opened)| (name, BufReader::new(opened.file)));
    calibration::views_of_photos(bytes, board, limits, |name| {
        done += 1;
        progress.photo(done, count, name);
    })
}

struct OpenInput {
    file: File,
    is_photo: bool,
}

fn open(path: &Path) -> Result<OpenInput, CommandFailure> {
    let place = || format!("opening {}", path.display());
    let mut file = File::open(path).with_context(place).map_err(CommandFailure::Input)?;
    if !file.metadata().is_ok_and(|m| m.is_file()) {
        return Err(CommandFailure::Input(anyhow!("{} is not a file; name the photos themselves", path.display())));
    }
    let mut first_bytes = [0; 64];
    let read = file.read(&mut first_bytes).and_then(|n| file.rewind().map(|()| n)).with_context(place);
    let is_photo = calibration::is_photo(&first_bytes[..read.map_err(CommandFailure::Input)?]);
    Ok(OpenInput { file, is_photo })
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Adds to FFmpeg's error that a single file is read as a video, because the user may have meant a photo.
fn with_hint(error: ViewsError) -> anyhow::Error {
    let hint = matches!(error, ViewsError::Video { .. });
    let error = anyhow::Error::from(error);
    if hint { error.context("a single file is taken as a video unless it is a JPEG, PNG or BMP photo") } else { error }
}

/// Prints each photo and why it was left out, for the case that the calibration failed.
fn print_photos(views: &[BoardView]) -> Result<(), CommandFailure> {
    let width = views.iter().map(|view| view.name.chars().count()).max().unwrap_or(0);
    let mut out = std::io::stdout().lock();
    for BoardView { name, corners } in views {
        let outcome = corners.as_ref().err().map_or("board found".to_owned(), |reason| reason.to_string());
        writeln!(out, "{name:width$}  {outcome}").map_err(anyhow::Error::from)?;
    }
    Ok(())
}

fn print_calibration(calibration: &Calibration) -> Result<(), CommandFailure> {
    let text = table(calibration);
    std::io::stdout().lock().write_all(text.as_bytes()).map_err(anyhow::Error::from)?;
    Ok(())
}

/// The table of photos, then the camera's parameters with their standard deviations.
fn table(calibration: &Calibration) -> String {
    let width = calibration.photos.iter().map(|p| p.name.chars().count()).max().unwrap_or(0).max("photo".len());
    let mut text = format!("{:width$}  used  rms_px  reason\n", "photo");
    for PhotoReport { name, rms_px, reason } in &calibration.photos {
        let used = if reason.is_none() { "yes" } else { "no" };
        let rms = rms_px.map_or("–".to_owned(), |rms| format!("{rms:.3}"));
        let reason = reason.as_ref().map_or(String::new(), |r| r.to_string());
        text += format!("{name:width$}  {used:4}  {rms:>6}  {reason}").trim_end();
        text.push('\n');
    }
    let (used, given) = (calibration.used_count(), calibration.photos.len());
    text += &format!("\n{used} of {given} photos used, RMS {:.3} px, ", calibration.rms_px);
    text += &format!("corners in {:.0} % of the picture\n\n", 100.0 * calibration.coverage.share());
    let (c, s) = (calibration.camera, calibration.sigma);
    for (name, value, sigma) in [("fx", c.fx, s.fx), ("fy", c.fy, s.fy), ("cx", c.cx, s.cx), ("cy", c.cy, s.cy)] {
        text += &format!("{name}  {value:11.3} ± {sigma:.3}\n");
    }
    let lens = [("k1", c.k1, s.k1), ("k2", c.k2, s.k2), ("p1", c.p1, s.p1), ("p2", c.p2, s.p2), ("k3", c.k3, s.k3)];
    for (name, value, sigma) in lens {
        text += &format!("{name}  {value:11.6} ± {sigma:.6}\n");
    }
    text
}

/// Progress on stderr: a bar on a terminal, else plain lines; nothing if quiet.
struct CalibrateProgress {
    bar: ProgressBar,
    plain: bool,
}

impl CalibrateProgress {
    fn new(quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let target = if quiet || !terminal { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        Self { bar, plain: !quiet && !terminal }
    }

    fn photo(&self, done: usize, of: usize, name: &str) {
        self.bar.set_length(of as u64);
        self.bar.set_position(done as u64);
        self.bar.set_message(name.to_owned());
        if self.plain {
            eprintln!("{done}/{of} {name}");
        }
    }

    fn frame(&self, done: u64, of: Option<u64>) {
        self.bar.set_length(of.unwrap_or(done));
        self.bar.set_position(done);
        if self.plain && done.is_multiple_of(250) {
            eprintln!("frame {done}{}", of.map_or(String::new(), |n| format!("/{n}")));
        }
    }

    fn end(&self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests;
