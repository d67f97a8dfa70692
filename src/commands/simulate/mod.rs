//! `trocar simulate`: makes a clip, checkerboard photos, camera, annotations and truth of a simulated box.

mod bare;
mod scene;

use std::path::PathBuf;

use anyhow::anyhow;

pub use self::bare::EMPTY_BOX;
pub use self::scene::{SceneOrder, SceneProgress, write_scene};
use super::CommandFailure;
use super::progress::Meter;
use crate::media::SampleFormat;
use crate::simulation::schedule::Evenness;
use crate::simulation::tool::{ShaftDesign, SimulatedMarker, TapeDesign};
use crate::simulation::{RigView, Scenario, Setup, Skill};

/// Arguments of `trocar simulate`.
#[derive(clap::Args)]
pub struct SimulateArgs {
    /// Scene: wire, rectangle, approach, slide, rest, pegs, crossing, exchange, self-test, long-rest, hidden-tip,
    /// moved-pegs or black-props.
    #[arg(long)]
    scene: String,
    /// Seed of the hands' motion and the sensor's noise; the same seed gives the same pixels.
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    seed: u64,
    /// Folder to write to; created if missing.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Picture size, pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1280x720", value_parser = size)]
    size: (u32, u32),
    /// Number of frames; without this and --seconds, until the task is done.
    #[arg(long, value_name = "N", conflicts_with = "seconds", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: Option<u32>,
    /// Length in seconds; the task is repeated if it is shorter.
    #[arg(long, value_name = "N", value_parser = seconds)]
    seconds: Option<f64>,
    /// Frames per second.
    #[arg(long, value_name = "HZ", default_value_t = 25.0, value_parser = rate)]
    fps: f64,
    /// Level of the simulated person: novice, intermediate or expert.
    #[arg(long, default_value = "intermediate")]
    skill: String,
    /// Number of the person within the level: each number is a different person, the same in every scene [default: the
    /// level's average].
    #[arg(long, value_name = "NUMBER")]
    person: Option<u64>,
    /// Position of the camera: top or side.
    #[arg(long, default_value = "top")]
    view: String,
    /// Number of the box: it sets lens, mounting and mat. Clips of one box share one calibration.
    #[arg(long = "box", value_name = "NUMBER", default_value_t = 1)]
    rig: u64,
    /// What shows where the tools are: band (of tape) or bare (no tape, a steel collar before the jaws). Bare tools are
    /// called left and right, and a picture of the empty box is written, too.
    #[arg(long, default_value = "band")]
    marker: String,
    /// Tapes of the left and the right tool: orange, cyan, magenta, lime, yellow or violet. If both are the same, the
    /// tools are called left and right [default: orange,cyan].
    #[arg(long)]
    tapes: Option<String>,
    /// Shafts of both tools: black, grey or white.
    #[arg(long, default_value = "black")]
    shaft: String,
    /// Outer diameter of the tools, over the tape if they have some, mm.
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = diameter)]
    diameter_mm: f64,
    /// Shift of the camera to its right since the box was set up, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = moved, allow_negative_numbers = true)]
    camera_moved_mm: f64,
    /// Number of checkerboard photos.
    #[arg(long, value_name = "N", default_value_t = 18, value_parser = clap::value_parser!(u16).range(0..=99))]
    boards: u16,
    /// Bend the board on the last three photos.
    #[arg(long)]
    bent: bool,
    /// Make time stamps uneven and leave out frames, as in a live feed.
    #[arg(long)]
    uneven: bool,
    /// Pixel format of the clip: yuv420p, yuv422p, yuv444p, yuv420p10 or yuv444p10.
    #[arg(long, default_value = "yuv420p")]
    pixels: String,
    /// Show no progress.
    #[arg(long)]
    quiet: bool,
}

/// Runs the command.
pub fn run(args: SimulateArgs) -> Result<(), CommandFailure> {
    let order = scene_order(&args).map_err(CommandFailure::Input)?;
    let mut meter = Meter::new(args.quiet);
    let times = write_scene(&args.out, &order, &mut |what, done, all| meter.show(what, done, all))?;
    meter.finish(&format!("{} frames of `{}` in {}", times.len(), args.scene, args.out.display()));
    Ok(())
}

fn scene_order(args: &SimulateArgs) -> anyhow::Result<SceneOrder> {
    let scenario = one_of("scene", &args.scene, Scenario::ALL.map(Scenario::name), Scenario::named)?;
    let level = one_of("skill", &args.skill, Skill::ALL.map(|s| s.name), Skill::named)?;
    let skill = args.person.map_or(level, |person| level.of_person(person));
    let frames = args.frames.map(|n| n as usize).or(args.seconds.map(|s| (s * args.fps).round().max(1.0) as usize));
    let standard = Setup::new(scenario, skill, args.seed);
    let marker =
        one_of("marker", &args.marker, SimulatedMarker::ALL.map(SimulatedMarker::name), SimulatedMarker::named)?;
    let setup = Setup {
        view: one_of("view", &args.view, ["top", "side"], view)?,
        rig: args.rig,
        width: args.size.0,
        height: args.size.1,
        min_duration_s: frames.map_or(0.0, |n| n as f64 / args.fps),
        marker,
        tapes: args.tapes.as_deref().map_or(Ok(standard.tapes), |text| tapes(text, marker))?,
        shaft: one_of("shaft", &args.shaft, ShaftDesign::ALL.map(|s| s.name), ShaftDesign::named)?,
        diameter_mm: args.diameter_mm,
        camera_moved_mm: args.camera_moved_mm,
        ..standard
    };
    let names = ["yuv420p", "yuv422p", "yuv444p", "yuv420p10", "yuv444p10"];
    let samples = one_of("pixels", &args.pixels, names, samples)?;
    if samples != SampleFormat::Yuv444
        && samples != SampleFormat::Yuv444Deep
        && (args.size.0 % 2 == 1 || args.size.1 % 2 == 1)
    {
        return Err(anyhow!("--size {}x{}: an odd size needs --pixels yuv444p", args.size.0, args.size.1));
    }
    Ok(SceneOrder {
        frames,
        fps: args.fps,
        evenness: if args.uneven { Evenness::Uneven } else { Evenness::Even },
        samples,
        boards: usize::from(args.boards),
        bent: if args.bent { 3.min(usize::from(args.boards)) } else { 0 },
        ..SceneOrder::new(setup)
    })
}

fn one_of<T, const N: usize>(
    what: &str,
    name: &str,
    names: [&str; N],
    find: impl Fn(&str) -> Option<T>,
) -> anyhow::Result<T> {
    find(name).ok_or_else(|| anyhow!("no {what} is called `{name}`; use one of {}", names.join(", ")))
}

fn view(name: &str) -> Option<RigView> {
    match name {
        "top" => Some(RigView::Top),
        "side" => Some(RigView::Side),
        _ => None,
    }
}

fn samples(name: &str) -> Option<SampleFormat> {
    match name {
        "yuv420p" => Some(SampleFormat::Yuv420),
        "yuv422p" => Some(SampleFormat::Yuv422),
        "yuv444p" => Some(SampleFormat::Yuv444),
        "yuv420p10" => Some(SampleFormat::Yuv420Deep),
        "yuv444p10" => Some(SampleFormat::Yuv444Deep),
        _ => None,
    }
}

fn tapes(text: &str, marker: SimulatedMarker) -> anyhow::Result<[TapeDesign; 2]> {
    if marker == SimulatedMarker::Bare {
        return Err(anyhow!("--tapes {text}: bare tools have no tape; leave out --tapes or --marker bare"));
    }
    let names = TapeDesign::ALL.map(|t| t.name);
    let found: Vec<TapeDesign> = text
        .split(',')
        .map(|name| one_of("tape", name.trim(), names, TapeDesign::named))
        .collect::<anyhow::Result<_>>()?;
    match found[..] {
        [left, right] => Ok([left, right]),
        _ => Err(anyhow!("--tapes {text}: expected two tapes, such as orange,cyan")),
    }
}

fn size(text: &str) -> Result<(u32, u32), String> {
    const RANGE: std::ops::RangeInclusive<u32> = 64..=4096;
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    sides
        .filter(|(w, h)| RANGE.contains(w) && RANGE.contains(h))
        .ok_or_else(|| "expected WIDTHxHEIGHT, each 64 to 4096, such as 1280x720".to_owned())
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.01, 36_000.0)
}

fn rate(text: &str) -> Result<f64, String> {
    number(text, 1.0, 240.0)
}

fn diameter(text: &str) -> Result<f64, String> {
    number(text, 1.0, 20.0)
}

fn moved(text: &str) -> Result<f64, String> {
    number(text, -50.0, 50.0)
}

fn number(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value: Option<f64> = text.parse().ok();
    value.filter(|v| (least..=most).contains(v)).ok_or_else(|| format!("expected a number from {least} to {most}"))
}

#[cfg(test)]
mod tests;
