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
use crate::pipeline::trajectory::Trajectory;

mod admin;
mod agent;
mod calibrate;
mod child;
mod demonstration;
mod evaluate;
mod model;
mod palette;
mod progress;
mod score;
mod self_test;
pub mod serve;
pub mod simulate;
mod table;
mod track;
mod verdict;

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
    Serve(serve::Args),
    /// Record a box's camera and send the recording to the server while it is made.
    Agent(agent::Args),
    /// Compute a box's camera.json from photos or a video of a checkerboard.
    Calibrate(calibrate::Args),
    /// Find the best tape colours for a box, or check the colours that were marked.
    Palette(palette::Args),
    /// Test with the printed checkerboard and a taped rod whether a box still measures correctly.
    SelfTest(self_test::Args),
    /// Track the tools in a recording.
    Track(track::Args),
    /// Compute the features of trajectories and, with --model, the level of skill.
    Score(score::Args),
    /// Train a model of skill from the features of people whose level is known.
    Model(model::Args),
    /// Make a video, checkerboard photos, annotations and true positions of a simulated box.
    Simulate(simulate::Args),
    /// Compare trajectories with the truth, or with each other.
    Evaluate(evaluate::Args),
    /// Manage accounts and tokens, back up the data, check database and files.
    Admin(admin::Args),
    /// Run as a confined child process of the service; not for people.
    #[command(hide = true)]
    Child(child::Args),
}

/// Runs one command until it ends.
pub fn run(cli: Cli) -> Result<(), Failure> {
    match cli.command {
        Command::Serve(args) => serve::run(args),
        Command::Agent(args) => agent::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Palette(args) => palette::run(args),
        Command::SelfTest(args) => self_test::run(args),
        Command::Track(args) => track::run(args),
        Command::Score(args) => score::run(args),
        Command::Model(args) => model::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Admin(args) => admin::run(args),
        Command::Child(args) => child::run(args),
    }
}

/// Makes all new files of this process, SQLite's too, readable by their owner only: everything the service writes is
/// personal data, and the folder may be open to other users.
fn keep_to_ourselves() {
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o077));
}

/// Why a command failed. Displayed in one line that says what happened, where, and what to do.
#[derive(Debug)]
pub enum Failure {
    /// The command line, or a file named on it, cannot be used: exit status 2.
    Input(anyhow::Error),
    /// Any other failure: exit status 1.
    Failed(anyhow::Error),
}

impl Failure {
    /// The exit status of the process.
    pub fn status(&self) -> u8 {
        match self {
            Failure::Failed(_) => 1,
            Failure::Input(_) => 2,
        }
    }

    /// A failure caused by unusable input.
    pub fn input(error: impl Into<anyhow::Error>) -> Self {
        Failure::Input(error.into())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Failure::Input(error) | Failure::Failed(error)) = self;
        let chain = format!("{error:#}");
        f.write_str(&chain.replace('\n', " "))
    }
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        Failure::Failed(error)
    }
}

/// Reads a trajectory file. Every error in it is an input error, because the user has to correct the file.
fn read_trajectory(path: &Path) -> Result<Trajectory, Failure> {
    let file = File::open(path).with_context(|| format!("reading {}", path.display())).map_err(Failure::Input)?;
    let trajectory = read_csv(BufReader::new(file)).with_context(|| path.display().to_string());
    trajectory.map_err(Failure::Input)
}

/// Writes a command's result to standard output.
fn print_result(text: &str) -> Result<(), Failure> {
    Ok(io::stdout().lock().write_all(text.as_bytes()).context("writing to standard output")?)
}
