//! Lists of erasures beside the data and beside the backups. A backup that is restored later must not bring erased
//! people back, so the list has to outlive the data folder.
//!
//! A list is a text file with one erasure a line ([`Erasure`]). It is only appended to.

use std::collections::HashSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use super::{UpkeepError, UpkeepResult};
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::domain::text::Invalid;
use crate::store::Store;

/// File name of a list.
pub const ERASURE_LIST: &str = "erasures";
/// Erasures per query.
const ROUND: u32 = 1_000;

/// The lists that a running service keeps.
#[derive(Debug)]
pub struct ErasureLists {
    lists: Vec<ErasureList>,
}

/// One list, and how far it is.
#[derive(Debug)]
struct ErasureList {
    path: PathBuf,
    /// Number of the last erasure that the list has; `None` until the file was read.
    last: Option<i64>,
}

impl ErasureLists {
    /// The list in the data folder, and the one in the folder of backups, if there is one.
    pub fn new(data: &Path, backups: Option<&Path>) -> Self {
        let folders = [Some(data), backups].into_iter().flatten();
        Self { lists: folders.map(|folder| ErasureList { path: folder.join(ERASURE_LIST), last: None }).collect() }
    }

    /// Appends the erasures that the lists lack; durable when this returns.
    ///
    /// # Errors
    /// The first failure. The other lists are written all the same.
    pub async fn update(&mut self, store: &Store) -> UpkeepResult<()> {
        let mut attempts = super::Attempts::default();
        for list in &mut self.lists {
            attempts.note(list.update(store).await);
        }
        attempts.finish(())
    }
}

impl ErasureList {
    async fn update(&mut self, store: &Store) -> UpkeepResult<()> {
        let new = erasures_after(store, self.last.unwrap_or(0)).await?;
        let erasures: Vec<Erasure> = new.iter().map(|(_, erasure)| erasure.clone()).collect();
        match self.last {
            Some(_) => append(&self.path, &erasures)?,
            // Once after a start: the list may lack any of them, for example because it was lost.
            None => extend_list(&self.path, &erasures)?,
        }
        self.last = Some(new.last().map_or(self.last.unwrap_or(0), |(number, _)| *number));
        Ok(())
    }
}

/// All erasures after this number, with their numbers.
pub(super) async fn erasures_after(store: &Store, number: i64) -> UpkeepResult<Vec<(i64, Erasure)>> {
    let mut found: Vec<(i64, Erasure)> = Vec::new();
    loop {
        let last = found.last().map_or(number, |(number, _)| *number);
        let more = store.erasures().after(last, ROUND).await?;
        if more.is_empty() {
            return Ok(found);
        }
        found.extend(more);
    }
}

/// Appends the erasures that a list lacks; durable when this returns.
pub fn extend_list(path: &Path, erasures: &[Erasure]) -> UpkeepResult<()> {
    let mut known: HashSet<String> = read_list(path)?.iter().map(key).collect();
    let new: Vec<Erasure> = erasures.iter().filter(|erasure| known.insert(key(erasure))).cloned().collect();
    append(path, &new)
}

/// What makes an entry the same as another: an erasure happens once, but it may be requested and taken back repeatedly.
fn key(erasure: &Erasure) -> String {
    match erasure.kind {
        ErasedKind::Trainee | ErasedKind::Session | ErasedKind::Person => erasure.id.clone(),
        ErasedKind::Pending | ErasedKind::TakenBack => erasure.to_string(),
    }
}

/// The erasures of a list; none if there is no such file.
pub fn read_list(path: &Path) -> UpkeepResult<Vec<Erasure>> {
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(list_error(path)(error)),
    };
    let wrong = |why: String| UpkeepError::List { path: path.to_owned(), why };
    // A power cut can leave a part of the last line. It was not acknowledged, and is written again.
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    whole.lines().map(|line| line.parse().map_err(|invalid: Invalid| wrong(invalid.why))).collect()
}

fn append(path: &Path, erasures: &[Erasure]) -> UpkeepResult<()> {
    let lines: String = erasures.iter().map(|erasure| format!("{erasure}\n")).collect();
    if lines.is_empty() && path.exists() {
        return Ok(());
    }
    let failed = list_error(path);
    cut_part_of_line(path).map_err(&failed)?;
    let mut file = OpenOptions::new().append(true).create(true).mode(0o600).open(path).map_err(&failed)?;
    file.write_all(lines.as_bytes()).and_then(|()| file.sync_all()).map_err(&failed)?;
    let folder = path.parent().unwrap_or(path);
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(&failed)
}

/// Cuts off the part of a line that a power cut left.
fn cut_part_of_line(path: &Path) -> io::Result<()> {
    let bytes = match fs::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
    };
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    if whole < bytes.len() { OpenOptions::new().write(true).open(path)?.set_len(whole as u64) } else { Ok(()) }
}

fn list_error(path: &Path) -> impl Fn(io::Error) -> UpkeepError {
    let path = path.to_owned();
    move |error| UpkeepError::List { path: path.clone(), why: error.to_string() }
}
