//! `trocar palette`: recommends tapes for a box, and checks the colours of the marked tapes.

mod advise;
mod check;

use std::path::PathBuf;

use super::{CommandFailure, print_result};

/// Arguments of `trocar palette`.
#[derive(clap::Args)]
#[command(
    after_help = "Exit status of --check: 0 if every colour is good or at risk, 1 if one is bad, 2 if the input cannot \
                  be used."
)]
pub struct PaletteArgs {
    /// Rank tapes for this empty box: a photo (JPEG, PNG) or a video; only the first frame of a video is used.
    #[arg(long, value_name = "FRAME_OR_VIDEO", required_unless_present = "check", conflicts_with = "check")]
    advise: Option<PathBuf>,
    /// Check the colours that are marked in these annotations, and show the shafts of tools without tape on the marked
    /// frames.
    #[arg(long, value_name = "ANNOTATIONS")]
    check: Option<PathBuf>,
    /// With --check: the video that the annotations' frame numbers belong to, or a photo, which is frame 0; needed if
    /// they do not name it.
    #[arg(value_name = "VIDEO", requires = "check")]
    video: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: PaletteArgs) -> Result<(), CommandFailure> {
    match (args.advise, args.check) {
        (Some(picture), _) => advise::run(&picture, args.json),
        (None, Some(annotations)) => check::run(&annotations, args.video.as_deref(), args.json),
        (None, None) => {
            Err(CommandFailure::Input(anyhow::anyhow!("give --advise FRAME_OR_VIDEO or --check ANNOTATIONS VIDEO")))
        }
    }
}
