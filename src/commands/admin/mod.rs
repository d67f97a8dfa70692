//! `trocar admin`: what is done on the machine itself: accounts, tokens, the check of database and files.
//!
//! Works beside a running service: each change is one transaction, and the service sees it with its next question.
#![expect(clippy::print_stdout, reason = "results alone go to stdout")]

mod backup;
mod check;
mod token;
mod user;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use clap::Subcommand;

use super::{Failure, keep_to_ourselves};
use crate::settings::{Flags, Settings};
use crate::store::{Store, StoreError};
use crate::time::System;
use crate::vault::Vault;

/// Arguments of `trocar admin`.
#[derive(clap::Args)]
pub struct Args {
    /// Data folder of the service
    #[arg(long, global = true, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Settings file
    #[arg(long, global = true, value_name = "FILE")]
    settings: Option<PathBuf>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Compare the database with the files, without changing either; status 1 if something is lost.
    Check(check::Args),
    /// Copy database and files into an empty folder while the service works; the copy is a data folder itself.
    Backup(backup::Args),
    /// Accounts of people.
    #[command(subcommand)]
    User(user::Command),
    /// Access tokens of programs.
    #[command(subcommand)]
    Token(token::Command),
}

/// The data folder, open.
struct Centre {
    store: Store,
    vault: Vault,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    let flags = Flags { data: args.data, settings: args.settings, ..Flags::default() };
    let settings = Settings::load(flags).map_err(Failure::input)?;
    keep_to_ourselves();
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    runtime.block_on(async {
        let centre = open(&settings).await?;
        match args.command {
            Command::Check(args) => check::run(&centre, &args).await,
            Command::Backup(args) => backup::run(&centre, &args).await,
            Command::User(command) => user::run(&centre, command).await,
            Command::Token(command) => token::run(&centre, command).await,
        }
    })
}

async fn open(settings: &Settings) -> Result<Centre, Failure> {
    let database = settings.database();
    if !database.exists() {
        let shown = settings.data.display();
        let why =
            anyhow!("`{shown}` is not a data folder of Trocar: name it with --data, or start `trocar serve` first");
        return Err(Failure::input(why));
    }
    let store = Store::open(&database, &settings.store, Arc::new(System)).await.context("opening the database")?;
    let vault = Vault::open(&settings.data).await.context("opening the data folder")?;
    Ok(Centre { store, vault })
}

/// What a person typed cannot be used (status 2), or something broke (status 1).
fn refused(error: StoreError) -> Failure {
    match error {
        StoreError::NotFound { .. }
        | StoreError::Taken { .. }
        | StoreError::InUse { .. }
        | StoreError::Refused { .. }
        | StoreError::Forbidden { .. } => Failure::input(error),
        _ => Failure::Failed(error.into()),
    }
}
