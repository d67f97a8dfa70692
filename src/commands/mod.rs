//! The command line: one file per sub-command, each with its arguments and a `run`.
//!
//! Results alone go to stdout; progress and errors go to stderr. Exit status 0 done, 1 failed, 2 wrong usage or input.

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
    /// Run the whole service: HTTP, dashboard, queue and workers.
    Serve(serve::Args),
    /// Stand beside a box: send what its camera sees while it is recorded.
    Agent(agent::Args),
    /// Make a camera.json from photos or a video of a checkerboard.
    Calibrate(calibrate::Args),
    /// Find the best tape for a box, or judge the colours that were marked.
    Palette(palette::Args),
    /// Test a box with the printed checkerboard and a taped rod: does it still measure what it should?
    SelfTest(self_test::Args),
    /// Track the tools in a recording.
    Track(track::Args),
    /// Compute features of trajectories, and what a model of skill says of them.
    Score(score::Args),
    /// Make a model of skill from features of people of declared levels.
    Model(model::Args),
    /// Make a clip, checkerboard photos, annotations and truth of a simulated box.
    Simulate(simulate::Args),
    /// Compare trajectories with the truth, or with each other.
    Evaluate(evaluate::Args),
    /// Accounts, tokens, and the check of database and files.
    Admin(admin::Args),
    /// Run as a confined child of the service; not for people.
    #[command(hide = true)]
    Child(child::Args),
}

/// Runs one command to its end.
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

/// Whatever the service writes is personal data: files that this process makes are its owner's alone, SQLite's too, even in
/// a folder that others may enter.
fn keep_to_ourselves() {
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o077));
}

/// Why a command did not end well, in one line that says what, where and what to do.
#[derive(Debug)]
pub enum Failure {
    /// The command line or a file named on it cannot be used: status 2.
    Input(anyhow::Error),
    /// Anything else: status 1.
    Failed(anyhow::Error),
}

impl Failure {
    /// The process's exit status.
    pub fn status(&self) -> u8 {
        match self {
            Failure::Failed(_) => 1,
            Failure::Input(_) => 2,
        }
    }

    /// Input that cannot be used.
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

/// Reads a trajectory file; what is wrong with it is the person's to mend.
fn read_trajectory(path: &Path) -> Result<Trajectory, Failure> {
    let file = File::open(path).with_context(|| format!("reading {}", path.display())).map_err(Failure::Input)?;
    let trajectory = read_csv(BufReader::new(file)).with_context(|| path.display().to_string());
    trajectory.map_err(Failure::Input)
}

/// Writes a command's result to standard output.
fn print_result(text: &str) -> Result<(), Failure> {
    Ok(io::stdout().lock().write_all(text.as_bytes()).context("writing to standard output")?)
}
