//! `trocar admin`: administration on the machine itself: accounts, tokens, backup, check of database and files.
//!
//! It works while the service runs, except `delete-orphans`. Commands that only read change no byte of the data folder.
//! The others write through SQLite's own lock: each change is one transaction, which waits for `store.busy_timeout_ms`
//! while the service writes, and the service sees it with its next query. A lock of the folder would keep a crashed
//! service from being started again during a long backup. No command changes the schema; a database of another version
//! is refused.
#![expect(clippy::print_stdout, reason = "only results go to stdout")]

mod backup;
mod check;
mod delete_orphans;
mod restore;
mod token;
mod user;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, anyhow};
use clap::Subcommand;

use super::{CommandFailure, restrict_new_files_to_owner, serve};
use crate::settings::{Flags, Settings};
use crate::store::{Store, StoreError};
use crate::time::SystemClock;
use crate::upkeep::{self, BACKUP_MARK, LostFile, UpkeepError};
use crate::vault::Vault;

/// What to do about files that are missing or damaged in the data folder.
const LOST_FILES: &str = "A lost file: copy it from a backup that has it to the same place in the data folder, while \
                          the service runs or not; if no backup has it, delete what refers to it";

/// Arguments of `trocar admin`.
#[derive(clap::Args)]
pub struct AdminArgs {
    /// Data folder of the service [default: trocar-data, or `data` in the settings]
    #[arg(long, global = true, value_name = "DIR", display_order = 100)]
    data: Option<PathBuf>,
    /// Settings file [default: trocar.toml in the data folder]
    #[arg(long, global = true, value_name = "FILE", display_order = 101)]
    settings: Option<PathBuf>,
    #[command(subcommand)]
    command: AdminCommand,
}

#[derive(Subcommand)]
enum AdminCommand {
    #[command(flatten)]
    InFolder(FolderCommand),
    /// Make a data folder (--data, new or empty) of a backup, and erase again what was erased since the backup.
    #[command(display_order = 3)]
    Restore(restore::RestoreArgs),
}

/// A command on a data folder that exists.
#[derive(Subcommand)]
enum FolderCommand {
    /// Check the database and the files, without changing them; exit status 1 if data is lost.
    #[command(display_order = 1)]
    Check(check::CheckArgs),
    /// Copy database and files into a new or empty folder; the service may run. Exit status 1 if files are lost.
    #[command(display_order = 2)]
    Backup(backup::BackupArgs),
    /// Delete the stored files that the database does not name; the service must be stopped.
    #[command(display_order = 4)]
    DeleteOrphans,
    /// List, add and delete accounts; set passwords.
    #[command(subcommand, display_order = 5)]
    User(user::UserCommand),
    /// List, add and delete access tokens of programs.
    #[command(subcommand, display_order = 6)]
    Token(token::TokenCommand),
}

impl FolderCommand {
    /// True if the command changes nothing in this data folder.
    fn only_reads(&self, data: &Path) -> bool {
        match self {
            FolderCommand::Check(_) => true,
            // The audit trail notes it, unless the disk is read-only.
            FolderCommand::Backup(_) => matches!(upkeep::require_writable(data), Err(UpkeepError::ReadOnly(_))),
            FolderCommand::DeleteOrphans => false,
            FolderCommand::User(command) => matches!(command, user::UserCommand::List),
            FolderCommand::Token(command) => matches!(command, token::TokenCommand::List),
        }
    }
}

/// An open data folder.
struct DataFolder {
    store: Store,
    vault: Vault,
    /// How long a link for a password is valid.
    password_link: Duration,
}

/// Runs the command.
pub fn run(args: AdminArgs) -> Result<(), CommandFailure> {
    let flags = Flags { data: args.data, settings: args.settings, ..Flags::default() };
    let settings = Settings::load(flags).map_err(CommandFailure::input)?;
    restrict_new_files_to_owner();
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting the runtime")?;
    runtime.block_on(async {
        match args.command {
            AdminCommand::Restore(args) => restore::run(&settings.data, args).await,
            AdminCommand::InFolder(command) if command.only_reads(&settings.data) => {
                let folder = DataFolder::open_to_read(&settings).await?;
                let done = run_in(&folder, command).await;
                folder.store.require_unchanged().map_err(store_failure)?;
                done
            }
            AdminCommand::InFolder(command) => {
                let folder = DataFolder::open_to_write(&settings).await?;
                let done = run_in(&folder, command).await;
                let cleared = upkeep::clear_after_command(&folder.store, &folder.vault).await;
                folder.store.close().await; // moves the write-ahead log into the database, if no service has it open
                done?;
                Ok(cleared.context("done, but traces of erased or changed data may be left; run the service once")?)
            }
        }
    })
}

async fn run_in(folder: &DataFolder, command: FolderCommand) -> Result<(), CommandFailure> {
    match command {
        FolderCommand::Check(args) => check::run(folder, &args).await,
        FolderCommand::Backup(args) => backup::run(folder, &args).await,
        FolderCommand::DeleteOrphans => delete_orphans::run(folder).await,
        FolderCommand::User(command) => user::run(folder, command).await,
        FolderCommand::Token(command) => token::run(folder, command).await,
    }
}

impl DataFolder {
    /// Opens a folder without changing anything in it; it may be a backup.
    async fn open_to_read(settings: &Settings) -> Result<Self, CommandFailure> {
        let database = existing_database(settings).await?;
        let store = Store::open_read_only(&database, &settings.store, Arc::new(SystemClock)).await;
        let data = settings.data.display();
        if matches!(store, Err(StoreError::OlderSchema)) && settings.data.join(BACKUP_MARK).exists() {
            return Err(CommandFailure::Failed(anyhow!(
                "an earlier version of the program made the backup `{data}`: restore it into a new folder with `trocar \
                 admin restore {data} --data NEW-FOLDER`, which verifies it, or check it with the version that made it"
            )));
        }
        Self::opened(store, settings).await
    }

    /// Opens a folder for changes.
    async fn open_to_write(settings: &Settings) -> Result<Self, CommandFailure> {
        let database = existing_database(settings).await?;
        serve::refuse_backup(&settings.data).map_err(CommandFailure::input)?;
        upkeep::require_writable(&settings.data).map_err(anyhow::Error::from)?;
        let store = Store::open_existing(&database, &settings.store, Arc::new(SystemClock)).await;
        Self::opened(store, settings).await
    }

    async fn opened(store: Result<Store, StoreError>, settings: &Settings) -> Result<Self, CommandFailure> {
        if matches!(store, Err(StoreError::NoSchema)) {
            refuse_lost_database(settings).await?;
        }
        Ok(Self {
            store: store.context("opening the database")?,
            vault: Vault::open_existing(&settings.data),
            password_link: settings.http.password_link(),
        })
    }
}

/// Opens the database of a data folder without changing anything in it, for a command that only reads.
pub(super) async fn open_store_to_read(settings: &Settings) -> Result<Store, CommandFailure> {
    Ok(DataFolder::open_to_read(settings).await?.store)
}

/// Prints one line for each file.
fn print_lost(files: &[LostFile]) {
    for file in files {
        println!("{file}");
    }
}

async fn existing_database(settings: &Settings) -> Result<PathBuf, CommandFailure> {
    let database = settings.database();
    let is_there = upkeep::is_readable(&database).map_err(anyhow::Error::from)?;
    if is_there && fs::metadata(&database).is_ok_and(|found| found.len() > 0) {
        return Ok(database);
    }
    refuse_lost_database(settings).await?;
    let shown = settings.data.display();
    let why = anyhow!("`{shown}` is not a Trocar data folder: name another with --data, or run `trocar serve` first");
    Err(CommandFailure::input(why))
}

/// Fails if the folder has files of an earlier database. Call it if the database is missing or empty.
async fn refuse_lost_database(settings: &Settings) -> Result<(), CommandFailure> {
    let vault = Vault::open_existing(&settings.data);
    upkeep::refuse_lost_database(&vault, &settings.database()).await.map_err(CommandFailure::input)
}

/// A [`CommandFailure`] for an error of the store: exit status 2 if the input is wrong, else 1.
fn store_failure(error: StoreError) -> CommandFailure {
    match error {
        StoreError::NotFound { .. }
        | StoreError::Taken { .. }
        | StoreError::InUse { .. }
        | StoreError::Refused { .. }
        | StoreError::Forbidden { .. } => CommandFailure::input(error),
        StoreError::Busy => CommandFailure::Failed(anyhow!("{error}, and nothing was changed: try again in a moment")),
        _ => CommandFailure::Failed(error.into()),
    }
}
