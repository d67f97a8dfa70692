//! `trocar admin`: administration on the machine itself: accounts, tokens, backup, check of database and files.
//!
//! It works while the service runs: each change is one transaction, and the service sees it with its next query.
#![expect(clippy::print_stdout, reason = "only results go to stdout")]

mod backup;
mod check;
mod restore;
mod token;
mod user;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use clap::Subcommand;

use super::{CommandFailure, restrict_new_files_to_owner};
use crate::settings::{Flags, Settings};
use crate::store::{Store, StoreError};
use crate::time::SystemClock;
use crate::vault::Vault;

/// Arguments of `trocar admin`.
#[derive(clap::Args)]
pub struct AdminArgs {
    /// Data folder of the service
    #[arg(long, global = true, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Settings file
    #[arg(long, global = true, value_name = "FILE")]
    settings: Option<PathBuf>,
    #[command(subcommand)]
    command: AdminCommand,
}

#[derive(Subcommand)]
enum AdminCommand {
    /// Check the database and the files, without changing them; exit status 1 if data is lost.
    Check(check::CheckArgs),
    /// Copy database and files into an empty folder; the service may run.
    Backup(backup::BackupArgs),
    /// Make a data folder (--data) of a backup, and erase again what was erased since the backup.
    Restore(restore::RestoreArgs),
    /// List, add and delete accounts; set passwords.
    #[command(subcommand)]
    User(user::UserCommand),
    /// List, add and delete access tokens of programs.
    #[command(subcommand)]
    Token(token::TokenCommand),
}

/// An open data folder.
struct DataFolder {
    store: Store,
    vault: Vault,
}

/// Runs the command.
pub fn run(args: AdminArgs) -> Result<(), CommandFailure> {
    let flags = Flags { data: args.data, settings: args.settings, ..Flags::default() };
    let settings = Settings::load(flags).map_err(CommandFailure::input)?;
    restrict_new_files_to_owner();
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    runtime.block_on(async {
        if let AdminCommand::Restore(args) = args.command {
            return restore::run(&settings.data, args).await; // the data folder does not exist yet
        }
        let folder = open_data_folder(&settings).await?;
        match args.command {
            AdminCommand::Check(args) => check::run(&folder, &args).await,
            AdminCommand::Backup(args) => backup::run(&folder, &args).await,
            AdminCommand::Restore(_) => Ok(()), // done above
            AdminCommand::User(command) => user::run(&folder, command).await,
            AdminCommand::Token(command) => token::run(&folder, command).await,
        }
    })
}

async fn open_data_folder(settings: &Settings) -> Result<DataFolder, CommandFailure> {
    let database = settings.database();
    if !database.exists() {
        let shown = settings.data.display();
        let why =
            anyhow!("`{shown}` is not a Trocar data folder: name another with --data, or run `trocar serve` first");
        return Err(CommandFailure::input(why));
    }
    let store = Store::open(&database, &settings.store, Arc::new(SystemClock)).await.context("opening the database")?;
    let vault = Vault::open(&settings.data).await.context("opening the data folder")?;
    Ok(DataFolder { store, vault })
}

/// A [`CommandFailure`] for an error of the store: exit status 2 if the input is wrong, else 1.
fn store_failure(error: StoreError) -> CommandFailure {
    match error {
        StoreError::NotFound { .. }
        | StoreError::Taken { .. }
        | StoreError::InUse { .. }
        | StoreError::Refused { .. }
        | StoreError::Forbidden { .. } => CommandFailure::input(error),
        _ => CommandFailure::Failed(error.into()),
    }
}
