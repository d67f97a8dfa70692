//! The watched folder of the server: other programs put recordings there, such as a recorder that saves to a network
//! share.
//!
//! ```text
//! look every few seconds ─▶ a file that does not change any more ─▶ copy into the vault, hashed
//!   ─▶ first frames in a confined child ─▶ one transaction: session, or a recording that waits for a name
//!   ─▶ the file is moved to `taken`, or deleted
//! ```
//! **Exactly once.** Only the transaction makes a recording; the file stays until it is committed. A service that ends
//! before it leaves a file that is taken at the next start, and a blob without a row, which is collected. One that ends
//! after it finds the file again, sees by its hash that the recording is there, and only moves it.
//!
//! The folder is polled, because network shares do not report changes. A file that is no readable recording is moved to
//! `refused`, with a text beside it that says why. What cannot be taken stays where it is and is logged once.

mod list;
mod scan;
mod settings;
mod take;

pub use settings::InboxSettings;

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;

use crate::analysis::QuickAnalysis;
use crate::intake::Intake;
use crate::time::SharedClock;
use list::PeopleList;
use scan::{InboxFile, InboxScan, InboxStamp, REFUSED, TAKEN, scan};

/// Messages that are remembered, so that each is logged once.
const MAX_REPORTED: usize = 10_000;

/// Watches the folder.
pub struct Inbox {
    intake: Intake,
    pictures: QuickAnalysis,
    clock: SharedClock,
    settings: InboxSettings,
    folder: PathBuf,
    /// The files of the last look: how they were, and since when.
    seen: HashMap<String, (InboxStamp, i64)>,
    /// Files that are done, but cannot be moved away.
    stuck: HashSet<(String, InboxStamp)>,
    reported: HashSet<String>,
}

impl Inbox {
    /// The watch over the folder of these settings; `None` without a folder. `pictures` makes the pictures of
    /// recordings.
    pub fn new(intake: Intake, pictures: QuickAnalysis, clock: SharedClock, settings: InboxSettings) -> Option<Self> {
        let folder = settings.folder.clone()?;
        let (seen, stuck, reported) = (HashMap::new(), HashSet::new(), HashSet::new());
        Some(Self { intake, pictures, clock, settings, folder, seen, stuck, reported })
    }

    /// Takes recordings until the service ends.
    pub async fn run(mut self) {
        let shutdown = self.intake.shutdown.clone();
        tracing::info!(folder = %self.folder.display(), "watching the folder for recordings");
        while !shutdown.is_begun() {
            self.look().await;
            tokio::select! {
                () = shutdown.begun() => {}
                () = self.clock.sleep(self.settings.poll()) => {}
            }
        }
    }

    /// One look into the folder.
    async fn look(&mut self) {
        let folder = self.folder.clone();
        let made = [folder.join(TAKEN), folder.join(REFUSED)];
        let found = tokio::task::spawn_blocking(move || {
            let found = scan(&folder)?;
            made.iter().try_for_each(std::fs::create_dir_all)?;
            Ok::<InboxScan, std::io::Error>(found)
        });
        let found = match found.await {
            Ok(Ok(found)) => found,
            Ok(Err(error)) => {
                let why = format!(
                    "the folder cannot be used ({error}): see that it exists, and that the service may write there"
                );
                return self.report(why);
            }
            Err(_) => return, // the service is ending
        };
        found.obstacles.into_iter().for_each(|obstacle| self.report(obstacle));
        let mut all = found.files;
        all.extend(found.list.clone());
        let mut settled = self.settled(all);
        let list = match &found.list {
            None => PeopleList::None,
            // A list that is just being written may name the wrong person: the recordings wait for it.
            Some(list) if !settled.contains(list) => return,
            Some(list) => self.read_list(list.clone()).await,
        };
        settled.retain(|file| Some(file) != found.list.as_ref());
        for file in settled {
            if self.intake.shutdown.is_begun() {
                return;
            }
            if self.stuck.contains(&(file.path.clone(), file.stamp)) {
                continue;
            }
            if self.take(file, &list).await.is_break() {
                return; // what is missing is missing for the others, too
            }
        }
    }

    async fn read_list(&mut self, file: InboxFile) -> PeopleList {
        let place = self.folder.join(&file.path);
        let read = tokio::task::spawn_blocking(move || PeopleList::read(&place, file.stamp.bytes)).await;
        let list = read.unwrap_or_else(|_| PeopleList::Unusable("it cannot be read".to_owned()));
        if let PeopleList::Unusable(why) = &list {
            self.report(format!("`{}` is not used: {why}", file.path));
        }
        list
    }

    /// The files that have not changed for long enough.
    fn settled(&mut self, files: Vec<InboxFile>) -> Vec<InboxFile> {
        let now_ms = self.clock.now_ms();
        let before = std::mem::take(&mut self.seen);
        let mut settled = Vec::new();
        for file in files {
            let since_ms = match before.get(&file.path) {
                Some((stamp, since_ms)) if *stamp == file.stamp => *since_ms,
                _ => now_ms,
            };
            self.seen.insert(file.path.clone(), (file.stamp, since_ms));
            if now_ms - since_ms >= self.settings.settle_ms() {
                settled.push(file);
            }
        }
        settled
    }

    /// Logs a message, once.
    fn report(&mut self, message: String) {
        if self.reported.len() >= MAX_REPORTED {
            self.reported.clear();
        }
        if self.reported.insert(message.clone()) {
            tracing::warn!(folder = %self.folder.display(), "watched folder: {message}");
        }
    }
}
