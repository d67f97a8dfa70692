//! The program `trocar`: reads the command line, runs one command and turns its outcome into an exit status.

use std::process::ExitCode;

use clap::Parser;
use trocar::commands::{self, Cli};

fn main() -> ExitCode {
    let cli = Cli::parse(); // clap itself exits with status 2 on wrong usage
    match commands::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("trocar: {failure}");
            ExitCode::from(failure.status())
        }
    }
}
