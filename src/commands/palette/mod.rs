//! `trocar palette`: which tape to buy for a box, and whether the tape that was marked is a good one.

mod advise;
mod check;

use std::path::PathBuf;

use super::{Failure, print_result};

/// Arguments of `trocar palette`.
#[derive(clap::Args)]
#[command(
    after_help = "Exit status of --check: 0 when every colour is good or at risk, 1 when one is bad, 2 when the input cannot be used."
)]
pub struct Args {
    /// Rank tapes against the empty box: a photo (JPEG, PNG), or a video of which the first frame counts.
    #[arg(long, value_name = "FRAME_OR_VIDEO", required_unless_present = "check", conflicts_with = "check")]
    advise: Option<PathBuf>,
    /// Judge the colours that are marked in these annotations.
    #[arg(long, value_name = "ANNOTATIONS")]
    check: Option<PathBuf>,
    /// With --check, the clip in which the annotations count frames; needed where they name none.
    #[arg(value_name = "VIDEO", requires = "check")]
    video: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    match (args.advise, args.check) {
        (Some(picture), _) => advise::run(&picture, args.json),
        (None, Some(annotations)) => check::run(&annotations, args.video.as_deref(), args.json),
        (None, None) => {
            Err(Failure::Input(anyhow::anyhow!("give --advise FRAME_OR_VIDEO or --check ANNOTATIONS VIDEO")))
        }
    }
}
