//! `trocar admin restore`: makes a data folder of a backup.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, anyhow};

use super::super::CommandFailure;
use super::print_lost;
use crate::domain::text::count_of;
use crate::settings::DATABASE_FILE;
use crate::shutdown::Shutdown;
use crate::time::{SystemClock, from_rfc3339, to_rfc3339};
use crate::upkeep::{self, ErasureListChoice, Restored, UpkeepError};

/// Arguments of `trocar admin restore`.
#[derive(clap::Args)]
pub struct RestoreArgs {
    /// Folder of the backup, as `trocar admin backup` made it
    backup: PathBuf,
    /// List of what was erased since the backup [default: `erasures` beside the backup]
    #[arg(long, value_name = "FILE", conflicts_with = "without_erasures")]
    erasures: Option<PathBuf>,
    /// Accept a list that is complete only until this time, such as 2027-01-31T00:00:00Z: people who were erased later
    /// come back [default: complete within the last day]
    #[arg(long, value_name = "TIME", value_parser = parse_time_ms, conflicts_with = "without_erasures")]
    erasures_until: Option<i64>,
    /// Restore without such a list: people who were erased since the backup come back
    #[arg(long)]
    without_erasures: bool,
}

fn parse_time_ms(text: &str) -> Result<i64, &'static str> {
    from_rfc3339(text).ok_or("expected a time such as 2027-01-31T00:00:00Z")
}

/// Restores the backup into the data folder, which must be empty, not exist yet, or be left by an interrupted restore.
/// Fails if the backup lacks files; the others are restored all the same.
pub async fn run(data: &Path, args: RestoreArgs) -> Result<(), CommandFailure> {
    let list = ErasureListChoice { file: args.erasures, until_ms: args.erasures_until };
    let erasures = (!args.without_erasures).then_some(list);
    let stop = Shutdown::new();
    stop.begin_on_signals().context("listening for signals")?;
    let done = upkeep::restore(&args.backup, data, erasures, DATABASE_FILE, Arc::new(SystemClock), &stop).await;
    let Restored { files, missing, erased_again, known_until_ms, kept } = match done {
        Err(
            wrong @ (UpkeepError::Used(_)
            | UpkeepError::NoBackup(_)
            | UpkeepError::UnfinishedBackup(_)
            | UpkeepError::NoList(_)
            | UpkeepError::ForeignList(_)
            | UpkeepError::ShortList { .. }),
        ) => return Err(CommandFailure::input(wrong)),
        done => done.with_context(|| format!("restoring to `{}`", data.display()))?,
    };
    for entry in &erased_again {
        println!("erased again: {entry}");
    }
    for entry in &kept {
        println!("not erased again: {entry}");
    }
    println!("restored: `{}` holds the database and {}, all verified", data.display(), count_of(files, "file"));
    println!("erased again: {} people and recordings that were erased since the backup", erased_again.len());
    match known_until_ms {
        Some(until_ms) => println!("erasures are known until: {}", to_rfc3339(until_ms)),
        None => println!("erasures are not known: people who were erased since the backup are in it"),
    }
    println!("to run it: trocar serve --data {}", data.display());
    println!("if it is the folder of the installed service: sudo systemctl start trocar");
    print_lost(&missing);
    if missing.is_empty() {
        return Ok(());
    }
    Err(CommandFailure::Failed(anyhow!(
        "`{}` is restored and can be used, but the backup lacks the {} files above: copy them from another backup that \
         has them to the same place in the data folder, or delete what refers to them",
        data.display(),
        missing.len()
    )))
}
