//! `trocar admin`: administration on the machine itself: accounts, tokens, backup, check of database and files.
//!
//! It works while the service runs: each change is one transaction, and the service sees it with its next query.
#![expect(clippy::print_stdout, reason = "only results go to stdout")]

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
    /// Check the database and the files, without changing them; exit status 1 if data is lost.
    Check(check::Args),
    /// Copy database and files into an empty folder; the service may run. The copy can be used as a data folder.
    Backup(backup::Args),
    /// List, add and delete accounts; set passwords.
    #[command(subcommand)]
    User(user::Command),
    /// List, add and delete access tokens of programs.
    #[command(subcommand)]
    Token(token::Command),
}

/// An open data folder.
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
        let folder = open(&settings).await?;
        match args.command {
            Command::Check(args) => check::run(&folder, &args).await,
            Command::Backup(args) => backup::run(&folder, &args).await,
            Command::User(command) => user::run(&folder, command).await,
            Command::Token(command) => token::run(&folder, command).await,
        }
    })
}

async fn open(settings: &Settings) -> Result<Centre, Failure> {
    let database = settings.database();
    if !database.exists() {
        let shown = settings.data.display();
        let why =
            anyhow!("`{shown}` is not a Trocar data folder: name another with --data, or run `trocar serve` first");
        return Err(Failure::input(why));
    }
    let store = Store::open(&database, &settings.store, Arc::new(System)).await.context("opening the database")?;
    let vault = Vault::open(&settings.data).await.context("opening the data folder")?;
    Ok(Centre { store, vault })
}

/// A [`CommandFailure`] for an error of the store: exit status 2 if the input is wrong, else 1.
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
