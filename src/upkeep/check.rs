//! `trocar admin check`: checks the database itself and against the files, without changing either.

use std::collections::HashSet;
use std::fmt;

use super::UpkeepResult;
use super::backup::unless_stopped;
use super::orphans::OrphanFiles;
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::certificate::signed_file::{self, SignatureVerdict};
use crate::domain::scope::Scope;
use crate::ids::{CertificateId, FeedId, UploadId};
use crate::shutdown::Shutdown;
use crate::store::{BlobUse, CertificateFilter, PageRequest, Store, StoreError};
use crate::vault::{FileLoss, Vault, VaultError, VaultResult};

/// A problem that the check found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finding {
    /// The database file is damaged, or a reference dangles.
    Database(String),
    /// A row refers to a file that cannot be used.
    LostFile(LostFile),
    /// A file that no row needs: harmless if there are few; the next start removes them.
    OrphanFile(BlobHash),
    /// So many files have no row that the database is probably not theirs.
    ManyOrphans {
        /// Number of files without a row.
        orphans: usize,
        /// Number of all files.
        files: usize,
    },
    /// An upload's file holds fewer bytes than were acknowledged.
    ShortUpload(UploadId),
    /// An unfinished feed has no log.
    MissingFeed(FeedId),
    /// Records of a feed's log are damaged, and these frames are in no other record: first and last number of each
    /// range.
    DamagedFeed(FeedId, Vec<[u64; 2]>),
    /// A log without an unfinished feed: harmless; the service removes it.
    OrphanFeed(FeedId),
    /// The file of a certificate is not as it was signed, or says something else than its row.
    ChangedCertificate(CertificateId),
}

/// A file that the database refers to and that cannot be used, with what refers to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LostFile {
    /// Its hash, which is its name.
    pub hash: BlobHash,
    /// Why it cannot be used.
    pub loss: FileLoss,
    /// The sessions and boxes that refer to it; at most 20.
    pub uses: Vec<BlobUse>,
}

impl fmt::Display for LostFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let uses: Vec<String> = self.uses.iter().map(ToString::to_string).collect();
        let uses = if uses.is_empty() { "nothing refers to it".to_owned() } else { uses.join("; ") };
        write!(f, "{} file {}: {uses}", self.loss.name(), self.hash.file())?;
        match &self.loss {
            FileLoss::Unreadable(why) => write!(f, " ({why})"),
            FileLoss::Missing | FileLoss::Damaged => Ok(()),
        }
    }
}

impl Finding {
    /// True if data is lost; otherwise it is only a harmless leftover.
    pub fn is_loss(&self) -> bool {
        !matches!(self, Finding::OrphanFile(_) | Finding::OrphanFeed(_))
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Finding::Database(what) => write!(f, "database: {what}"),
            Finding::LostFile(file) => file.fmt(f),
            Finding::OrphanFile(hash) => {
                write!(f, "file that nothing refers to: {hash} (the next start removes it, if there are few)")
            }
            Finding::ManyOrphans { orphans, files } => write!(
                f,
                "no row of the database names {orphans} of {files} files; they are kept, because the database is \
                 probably older than they are or of another folder, or their deletion failed earlier (see the log): \
                 put the right database back; if this database is the right one, stop the service and run `trocar \
                 admin delete-orphans`"
            ),
            Finding::ShortUpload(id) => write!(f, "upload {id} holds fewer bytes than were acknowledged"),
            Finding::MissingFeed(id) => write!(f, "feed {id} has not ended, and its log is missing"),
            Finding::DamagedFeed(id, frames) => {
                let ranges: Vec<String> = frames.iter().map(|[first, last]| format!("{first} to {last}")).collect();
                let frames = ranges.join(", ");
                write!(
                    f,
                    "feed {id} has damaged records and lacks the frames {frames}: those that were acknowledged to its \
                     sender are lost; it sends the others again when it connects"
                )
            }
            Finding::ChangedCertificate(id) => {
                write!(f, "certificate {id}: its file is not as it was signed; withdraw it, and issue it again")
            }
            Finding::OrphanFeed(id) => write!(f, "log that no feed needs: {id} (the service removes it)"),
        }
    }
}

/// Rows to read per query.
const ROUND: u32 = 1_000;

/// Compares the database with the files. With `thorough`, every file is read and verified.
pub async fn check(store: &Store, vault: &Vault, thorough: bool) -> UpkeepResult<Vec<Finding>> {
    check_until((store, vault), thorough, &Shutdown::new()).await
}

/// Like [`check`]; a stop ends it at once.
pub(super) async fn check_until(
    (store, vault): (&Store, &Vault),
    thorough: bool,
    stop: &Shutdown,
) -> UpkeepResult<Vec<Finding>> {
    let problems = unless_stopped(stop, store.check()).await?;
    let mut findings: Vec<Finding> = problems.into_iter().map(Finding::Database).collect();
    check_rows((store, vault), thorough, stop, &mut findings).await?;
    check_files(store, vault, &mut findings).await?;
    for upload in store.uploads().unfinished().await? {
        let there = vault.upload_length(upload.id).await;
        if there.map_or(true, |there| there < upload.received) && upload.received > 0 {
            findings.push(Finding::ShortUpload(upload.id));
        }
    }
    check_feeds(store, vault, &mut findings).await?;
    check_certificates(store, stop, &mut findings).await?;
    Ok(findings)
}

/// Checks that the file of each certificate is as it was signed and says what its row says.
async fn check_certificates(store: &Store, stop: &Shutdown, findings: &mut Vec<Finding>) -> UpkeepResult<()> {
    let (service, all) = (Scope::service(), CertificateFilter::default());
    let keys: Vec<_> = store.certificates().keys().await?.into_iter().map(|key| key.public).collect();
    let mut after = None;
    loop {
        let page = PageRequest::new(PageRequest::MAX_LIMIT, after);
        let page = unless_stopped(stop, store.certificates().list(&service, all, &page)).await?;
        for certificate in page.items {
            let file = match store.certificates().pdf(&service, certificate.id).await {
                Err(StoreError::NotFound { .. }) => continue, // erased meanwhile
                file => file?,
            };
            let verdict = signed_file::verify(&file, &keys);
            let is_intact =
                matches!(verdict, SignatureVerdict::Genuine { content, .. } if *content == certificate.content);
            if !is_intact {
                findings.push(Finding::ChangedCertificate(certificate.id));
            }
        }
        after = page.next;
        if after.is_none() {
            return Ok(());
        }
    }
}

/// Checks that every unfinished feed has an intact log, and every log an unfinished feed. Logs are always read to the
/// end, even without `thorough`: there are few, and their names contain no hash.
async fn check_feeds(store: &Store, vault: &Vault, findings: &mut Vec<Finding>) -> UpkeepResult<()> {
    let unfinished: HashSet<FeedId> = store.feeds().unfinished().await?.iter().map(|feed| feed.id).collect();
    let logs: HashSet<FeedId> = vault.feed_logs().await?.into_iter().collect();
    for id in sorted(unfinished.union(&logs)) {
        let is_unfinished =
            async || UpkeepResult::Ok(store.feeds().unfinished().await?.iter().any(|feed| feed.id == id));
        let has_log = async || UpkeepResult::Ok(vault.feed_logs().await?.contains(&id));
        let finding = match (unfinished.contains(&id), logs.contains(&id)) {
            (true, false) => is_missing(is_unfinished, has_log).await?.then_some(Finding::MissingFeed(id)),
            (false, _) => is_orphan(is_unfinished, has_log).await?.then_some(Finding::OrphanFeed(id)),
            (true, true) => match vault.feed_damage(id).await {
                Err(VaultError::NotFound) => None, // the feed has ended meanwhile
                frames => {
                    Some(frames?).filter(|frames| !frames.is_empty()).map(|frames| Finding::DamagedFeed(id, frames))
                }
            },
        };
        findings.extend(finding);
    }
    Ok(())
}

/// Checks a suspect again, with the log between two reads of the row: a feed has its row before its log, and its log is
/// deleted only after the row is marked as ended.
async fn is_missing(
    is_unfinished: impl AsyncFn() -> UpkeepResult<bool>,
    has_log: impl AsyncFn() -> UpkeepResult<bool>,
) -> UpkeepResult<bool> {
    Ok(is_unfinished().await? && !has_log().await? && is_unfinished().await?)
}

/// Checks a suspect twice more, the row first: a feed that was just beginning has a row by now, and one that was ending
/// has no log any more. One that did both between two reads has no log at the last.
async fn is_orphan(
    is_unfinished: impl AsyncFn() -> UpkeepResult<bool>,
    has_log: impl AsyncFn() -> UpkeepResult<bool>,
) -> UpkeepResult<bool> {
    Ok(!is_unfinished().await? && has_log().await? && !is_unfinished().await? && has_log().await?)
}

fn sorted<'a>(ids: impl Iterator<Item = &'a FeedId>) -> Vec<FeedId> {
    let mut ids: Vec<FeedId> = ids.copied().collect();
    ids.sort_unstable_by_key(ToString::to_string);
    ids
}

/// Checks that every row has its file.
async fn check_rows(
    (store, vault): (&Store, &Vault),
    thorough: bool,
    stop: &Shutdown,
    findings: &mut Vec<Finding>,
) -> UpkeepResult<()> {
    let mut after = None;
    loop {
        let blobs = store.blobs().all(after, ROUND).await?;
        for blob in &blobs {
            let checked = if thorough { vault.verify(*blob, stop).await } else { check_length(vault, *blob).await };
            if let Some(loss) = checked? {
                let uses = store.blobs().uses(&Scope::service(), blob.hash).await?;
                findings.push(Finding::LostFile(LostFile { hash: blob.hash, loss, uses }));
            }
        }
        after = blobs.last().map(|blob| blob.hash);
        if after.is_none() {
            return Ok(());
        }
    }
}

/// Checks only that a blob can be opened and has its length.
async fn check_length(vault: &Vault, blob: Blob) -> VaultResult<Option<FileLoss>> {
    match vault.open_blob(blob.hash).await {
        Ok((_, bytes)) => Ok((bytes != blob.bytes).then_some(FileLoss::Damaged)),
        Err(error) => error.loss().map_or(Err(error), |loss| Ok(Some(loss))),
    }
}

/// Checks that every file has its row.
async fn check_files(store: &Store, vault: &Vault, findings: &mut Vec<Finding>) -> UpkeepResult<()> {
    let found = OrphanFiles::find(store, vault).await?;
    findings.extend(found.dropped.iter().chain(&found.unnamed).map(|hash| Finding::OrphanFile(*hash)));
    if !found.are_of_crash() {
        findings.push(Finding::ManyOrphans { orphans: found.unnamed.len(), files: found.files });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// True if the check reports a feed with this state at each moment: whether it has an unfinished row, and a log.
    /// Each read takes one moment.
    async fn is_reported(state: impl Fn(usize) -> (bool, bool)) -> bool {
        let moment = Cell::new(0);
        let look = || state(moment.replace(moment.get() + 1));
        let (is_unfinished, has_log) = (async || UpkeepResult::Ok(look().0), async || UpkeepResult::Ok(look().1));
        match (is_unfinished().await.unwrap(), has_log().await.unwrap()) {
            (true, false) => is_missing(is_unfinished, has_log).await.unwrap(),
            (false, true) => is_orphan(is_unfinished, has_log).await.unwrap(),
            _ => false,
        }
    }

    #[tokio::test]
    async fn a_feed_that_begins_or_ends_during_the_check_is_not_reported() {
        // A row, then a log; the row ends, then the log is deleted. The steps take at most two moments each.
        for case in 0..6 * 3 * 6 * 3usize {
            let [before, row_alone, both, log_alone] = [case % 6, case / 6 % 3, case / 18 % 6, case / 108 % 3];
            let begins = before + row_alone;
            let ends = begins + both;
            let state = |at| ((before..ends).contains(&at), (begins..ends + log_alone).contains(&at));
            assert!(!is_reported(state).await, "{before} {row_alone} {both} {log_alone}");
        }
        assert!(is_reported(|_| (true, false)).await && is_reported(|_| (false, true)).await);
    }
}
