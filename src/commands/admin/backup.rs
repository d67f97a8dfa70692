//! `trocar admin backup`: a copy to keep elsewhere.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;

use super::super::Failure;
use super::Centre;
use crate::settings::DATABASE;
use crate::time::System;
use crate::upkeep::{self, UpkeepError};

/// Arguments of `trocar admin backup`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder to make, or an empty one
    to: PathBuf,
}

/// Prints what the backup holds.
pub async fn run(centre: &Centre, args: &Args) -> Result<(), Failure> {
    let done = upkeep::back_up((&centre.store, &centre.vault), &args.to, DATABASE, Arc::new(System)).await;
    let files = match done {
        Err(used @ UpkeepError::Used(_)) => return Err(Failure::input(used)),
        done => done.with_context(|| format!("backing up to `{}`", args.to.display()))?,
    };
    println!("`{}` holds the database and {files} files, all verified", args.to.display());
    println!("to restore, copy it where the data folder shall be, or run: trocar serve --data {}", args.to.display());
    Ok(())
}
