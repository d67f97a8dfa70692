//! Clips made by the `ffmpeg` program, each once per run.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs `ffmpeg` with these arguments and the output's path; `None`, with a message, if the program is missing.
pub fn ffmpeg(arguments: &str, out: &Path) -> Option<PathBuf> {
    let made = Command::new("ffmpeg")
        .args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y"])
        .args(arguments.split_whitespace())
        .arg(out)
        .status();
    match made {
        Ok(status) => {
            assert!(status.success(), "ffmpeg {arguments} {}", out.display());
            Some(out.to_owned())
        }
        Err(error) => {
            crate::resources::skip(format_args!("the ffmpeg program ({error}); `make test` installs it"));
            None
        }
    }
}

/// Arguments for a moving test picture of this size and length, followed by `more`.
pub fn test_picture(size: &str, frames: u32, more: &str) -> String {
    format!("-f lavfi -i testsrc2=size={size}:rate=25 -frames:v {frames} {more}")
}
