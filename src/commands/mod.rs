//! The command line: one file per subcommand, each with its arguments and a `run` function.
//!
//! Only results go to stdout; progress and errors go to stderr. Exit status: 0 done, 1 failed, 2 wrong usage or input.

use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Write};
use std::path::Path;

use anyhow::Context;
use clap::{Parser, Subcommand};

use crate::domain::files::trajectory::read_csv;
use crate::vision::trajectory::Trajectory;

mod admin;
mod agent;
mod backup_command;
mod calibrate;
mod child;
mod demonstration;
mod evaluate;
mod greeting;
mod model;
mod palette;
mod progress;
mod score;
mod self_test;
pub mod serve;
pub mod simulate;
mod table;
mod track;
mod upload;
mod verdict;
mod verify;

/// Measures how surgeons move in a laparoscopic box trainer.
#[derive(Parser)]
#[command(name = "trocar", version, about, propagate_version = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run the service: web pages, programming interface, queue and workers.
    Serve(serve::ServeArgs),
    /// Record a box's camera and send the recording to the server while it is made.
    Agent(Box<agent::AgentArgs>),
    /// Compute a box's camera.json from photos or a video of a checkerboard.
    Calibrate(calibrate::CalibrateArgs),
    /// Find the best tape colours for a box, or check the colours that were marked.
    Palette(palette::PaletteArgs),
    /// Test with the printed checkerboard and a taped rod whether a box still measures correctly.
    SelfTest(self_test::SelfTestArgs),
    /// Track the tools in a recording.
    Track(track::TrackArgs),
    /// Compute the features of trajectories and, with --model, the level of skill.
    Score(score::ScoreArgs),
    /// Train a model of skill from the features of people whose level is known.
    Model(model::ModelArgs),
    /// Make a video, checkerboard photos, annotations and true positions of a simulated box.
    Simulate(simulate::SimulateArgs),
    /// Compare trajectories with the truth, or with each other.
    Evaluate(evaluate::EvaluateArgs),
    /// Send a folder of old recordings to the service: first shows what would happen, then sends.
    Upload(upload::UploadArgs),
    /// Verify a certificate: is it genuine, what does it say, is it still valid?
    Verify(verify::VerifyArgs),
    /// Manage accounts and tokens, back up the data, check database and files.
    Admin(admin::AdminArgs),
    /// Run as a confined child process of the service; not for people.
    #[command(hide = true)]
    Child(child::ChildArgs),
}

/// Runs one command until it ends.
pub fn run(cli: Cli) -> Result<(), CommandFailure> {
    match cli.command {
        Command::Serve(args) => serve::run(args),
        Command::Agent(args) => agent::run(*args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Palette(args) => palette::run(args),
        Command::SelfTest(args) => self_test::run(args),
        Command::Track(args) => track::run(args),
        Command::Score(args) => score::run(args),
        Command::Model(args) => model::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Upload(args) => upload::run(args),
        Command::Verify(args) => verify::run(args),
        Command::Admin(args) => admin::run(args),
        Command::Child(args) => child::run(args),
    }
}

/// Makes all new files of this process, SQLite's too, readable by their owner only: everything the service writes is
/// personal data, and the folder may be open to other users.
fn restrict_new_files_to_owner() {
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o077));
}

/// Why a command failed. Displayed in one line that says what happened, where, and what to do.
#[derive(Debug)]
pub enum CommandFailure {
    /// The command line, or a file named on it, cannot be used: exit status 2.
    Input(anyhow::Error),
    /// Any other failure: exit status 1.
    Failed(anyhow::Error),
}

impl CommandFailure {
    /// The exit status of the process.
    pub fn status(&self) -> u8 {
        match self {
            CommandFailure::Failed(_) => 1,
            CommandFailure::Input(_) => 2,
        }
    }

    /// A failure caused by unusable input.
    pub fn input(error: impl Into<anyhow::Error>) -> Self {
        CommandFailure::Input(error.into())
    }
}

impl fmt::Display for CommandFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (CommandFailure::Input(error) | CommandFailure::Failed(error)) = self;
        let mut shown = String::new();
        for cause in error.chain().map(ToString::to_string) {
            // Many errors name their cause in their own text.
            if !shown.contains(&cause) {
                let separator = if shown.is_empty() { "" } else { ": " };
                shown += &format!("{separator}{cause}");
            }
        }
        f.write_str(&shown.replace('\n', " "))
    }
}

impl From<anyhow::Error> for CommandFailure {
    fn from(error: anyhow::Error) -> Self {
        CommandFailure::Failed(error)
    }
}

/// Reads a trajectory file. Every error in it is an input error, because the user has to correct the file.
fn read_trajectory(path: &Path) -> Result<Trajectory, CommandFailure> {
    let file =
        File::open(path).with_context(|| format!("reading {}", path.display())).map_err(CommandFailure::Input)?;
    let trajectory = read_csv(BufReader::new(file)).with_context(|| path.display().to_string());
    trajectory.map_err(CommandFailure::Input)
}

/// Writes a command's result to standard output.
fn print_result(text: &str) -> Result<(), CommandFailure> {
    Ok(io::stdout().lock().write_all(text.as_bytes()).context("writing to standard output")?)
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;
    use crate::vault::VaultError;

    #[test]
    fn a_failure_names_each_cause_once() {
        let source = io::Error::from_raw_os_error(13).into();
        let inner = VaultError::Io { doing: "opening", path: "/data/lock".into(), source };
        let failure = CommandFailure::Failed(anyhow::Error::from(inner).context("using /data"));
        assert_eq!(failure.to_string(), "using /data: opening `/data/lock`: Permission denied (os error 13)");
        let failure = CommandFailure::input(anyhow!("the cause").context("two\nlines"));
        assert_eq!(failure.to_string(), "two lines: the cause");
    }
}
