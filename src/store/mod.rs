//! SQL, and nothing but SQL: what the centre knows, behind functions named for their meaning.
//!
//! One writer thread (`writer`) owns the connection that writes and answers after the commit; reads come from a
//! pool that cannot write. Functions that touch people's data take a [`Scope`]: what it does not reach is not found.
//! A list is a [`Page`]. Times are epoch milliseconds. Every function either did what it says, durably, or nothing.
//!
//! | room | functions |
//! |---|---|
//! | [`Store::people`] | `create` `list` `get` `change` `delete` `set_password` · for sign-in: `by_login` · `count` |
//! | [`Store::groups`] | `create` `list` `get` `set_members` `delete` |
//! | [`Store::cookies`] | `create` `person_of` `counts` `delete` `delete_all_of` `forget_expired` `forget_all` |
//! | [`Store::tokens`] | `create` `list` `delete` `scope_of` |
//! | [`Store::trainees`] | `create` `enrol` `list` `of_group` `named` `get` `change` `erase` |
//! | [`Store::tasks`] | `create` `list` `get` `change` `delete` |
//! | [`Store::standards`] | `add` `in_use` `in_use_of` `get` `list` |
//! | [`Store::cohorts`] | `create` `list` `get` `members` `replace` `delete` `values` `values_seen` |
//! | [`Store::courses`] | `create` `list` `get` `of` `replace` `delete` `follow` `unfollow` `of_trainee` |
//! | [`Store::skill_models`] | `add` `in_use` `get` `list` `declared` |
//! | [`Store::boxes`] | `create` `list` `get` `change` `delete` |
//! | [`Store::calibrations`] | `add` `latest` `get` `list` |
//! | [`Store::palettes`] | `add` `latest` `get` `list` |
//! | [`Store::self_tests`] | `list` `light_since` |
//! | [`Store::uploads`] | `create` `get` `advance` `set_back` `finish` `delete` `expired` `unfinished` `count_unfinished` |
//! | [`Store::feeds`] | `open` `end` `forget` `forget_unfinished` `get` `unfinished` |
//! | [`Store::sessions`] | `create` `list` `get` `retry` `erase` `result` `evidence` `practice` `practice_of_many` `trained` `last_task` `refused_since` `unrated_since` |
//! | [`Store::ratings`] | `give` `of_session` `has_rated` `given` `values` |
//! | [`Store::comments`] | `add` `of_session` `withdraw` |
//! | [`Store::edits`] | `of_session` `in_force` `add` `undo` |
//! | [`Store::jobs`] | `enqueue` `list` `get` `retry` `counts` · for [`crate::queue`]: `claim` `heartbeat` `finish_…` `fail` `crashed` `give_back` `sweep` |
//! | [`Store::blobs`] | `unreferenced` `forget_if_unreferenced` `note` `has` `all` `total` |
//! | [`Store::audit`] | `list` · for [`crate::upkeep`]: `backed_up` · `last_backup` |

mod audit;
mod ballast;
mod blobs;
mod boxes;
mod calibrations;
mod codes;
mod cohorts;
mod columns;
mod comments;
mod cookies;
mod courses;
mod edits;
mod enrolment;
mod error;
mod feeds;
mod groups;
mod jobs;
mod open;
mod page;
mod palettes;
mod people;
mod ratings;
mod rescorings;
mod self_tests;
mod sessions;
mod skill_models;
mod standards;
mod tasks;
mod tokens;
mod trainees;
mod uploads;
mod visibility;
mod writer;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};
use sqlx::SqlitePool;
use sqlx::sqlite::SqliteConnection;

pub use audit::{Audit, AuditEntry, Backup};
pub use blobs::Blobs;
pub use boxes::{Boxes, TrainingBox};
pub use calibrations::{Calibration, Calibrations};
pub use cohorts::{Cohort, CohortValue, Cohorts};
pub use comments::{Comment, Comments, SeenComments};
pub use cookies::{Cookie, Cookies};
pub use courses::{Course, CourseStep, Courses, Enrolled, Followed};
pub use edits::{Edit, Edits, SessionEdits};
pub use enrolment::Enrolment;
pub use error::{StoreError, StoreResult};
pub use feeds::{Feed, Feeds, NewFeed};
pub use groups::{Group, Groups, Members};
pub use jobs::{Job, Jobs, Lease, QueueCounts, Swept};
pub use page::{Page, PageRequest};
pub use palettes::{Palette, Palettes};
pub use people::{NewPerson, People, Person, PersonChange};
pub use ratings::{GivenRating, Rating, Ratings, SeenRatings, SessionValue};
pub use rescorings::{Compared, EndedItem, Rescoring, RescoringItem, RescoringTrainee, Rescorings};
pub use self_tests::{SelfTest, SelfTestLight, SelfTests};
pub use sessions::{
    Measurement, Outcome, Practice, Practised, Session, SessionFilter, SessionPlace, SessionResult, Sessions, Trained,
    Waiting,
};
pub use skill_models::{DeclaredSession, NewSkillModel, SkillModel, SkillModels};
pub use standards::{Standard, Standards};
pub use tasks::{Task, Tasks};
pub use tokens::{ActsAs, NewToken, Token, Tokens};
pub use trainees::{Trainee, Trainees};
pub use uploads::{Finished, NewUpload, Upload, Uploads};

use crate::domain::scope::Scope;
use crate::time::SharedClock;
use ballast::Ballast;
use writer::Writer;

/// How the store uses its database.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StoreSettings {
    /// Connections that read at the same time. More serve more simultaneous pages; each costs about 2 MiB. Usually 4.
    pub readers: u32,
    /// Writes that may wait for the writer before further ones are held back. Usually 256.
    pub waiting_writes: usize,
    /// Writes that may share one commit. More: fewer fsyncs under load, later answers. Usually 64.
    pub writes_per_commit: usize,
    /// How long to wait for a lock or a free connection before giving up as busy, ms. Usually 5000.
    pub busy_timeout_ms: u64,
    /// Times that a job may crash or fall silent before it is quarantined. Usually 3.
    pub max_attempts: u32,
}

impl Default for StoreSettings {
    fn default() -> Self {
        Self { readers: 4, waiting_writes: 256, writes_per_commit: 64, busy_timeout_ms: 5_000, max_attempts: 3 }
    }
}

/// The centre's database. Clones are the same store.
#[derive(Clone, Debug)]
pub struct Store {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    readers: SqlitePool,
    writer: Writer,
    clock: SharedClock,
    settings: StoreSettings,
    ballast: Ballast,
    /// For letting in who erases.
    door: Ballast,
    /// Was something erased since the write-ahead log was emptied?
    erased: AtomicBool,
}

impl Store {
    /// Opens the database at this path, made if it is missing, its schema brought up to date.
    pub async fn open(path: &Path, settings: &StoreSettings, clock: SharedClock) -> StoreResult<Self> {
        let connection = open::writer(path, settings).await?;
        let readers = open::readers(path, settings).await?;
        let writer = Writer::start(connection, settings.waiting_writes, settings.writes_per_commit)
            .map_err(|error| StoreError::Unusable(format!("its writer cannot start: {error}")))?;
        let (ballast, door) = (Ballast::to_erase(path), Ballast::to_let_in(path));
        ballast.restore().await;
        door.restore().await;
        let (path, settings) = (path.to_owned(), settings.clone());
        let erased = AtomicBool::new(true); // perhaps in an earlier life
        Ok(Self { inner: Arc::new(Inner { path, readers, writer, clock, settings, ballast, door, erased }) })
    }

    /// What SQLite finds wrong with its own file and with references between rows; nothing is as it should be.
    pub async fn check(&self) -> StoreResult<Vec<String>> {
        let integrity: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check").fetch_all(self.readers()).await?;
        let dangling: Vec<String> =
            sqlx::query_scalar("SELECT \"table\" FROM pragma_foreign_key_check").fetch_all(self.readers()).await?;
        let dangling = dangling.into_iter().map(|table| format!("a row of `{table}` refers to one that is not there"));
        Ok(integrity.into_iter().filter(|line| line != "ok").chain(dangling).collect())
    }

    /// Closes the database, for all clones: what was asked before is done, what is asked after is refused as closed. Not
    /// needed at the end of the process, which may come at any moment anyway.
    pub async fn close(&self) {
        self.inner.readers.close().await;
        self.inner.writer.close().await;
    }

    /// Writes a copy of the whole database, as it is at one moment, to a file, in place of what is there. Work goes on
    /// meanwhile.
    pub async fn snapshot(&self, into: &Path) -> StoreResult<()> {
        open::snapshot(&self.inner.path, &self.inner.settings, into).await
    }

    /// Bytes of the database, without its log.
    pub async fn bytes(&self) -> StoreResult<u64> {
        let sql = "SELECT page_count * page_size FROM pragma_page_count(), pragma_page_size()";
        let pages: i64 = sqlx::query_scalar(sql).fetch_one(self.readers()).await?;
        Ok(pages.unsigned_abs())
    }

    /// Takes the ballast's space again after an erasure on a full disk, if there is room now.
    pub async fn restore_ballast(&self) {
        self.inner.ballast.restore().await;
        self.inner.door.restore().await;
    }

    /// After an erasure: moves everything from the write-ahead log into the database file and empties the log, so that
    /// what was erased is nowhere any more. `false` if a reader stands in the way: try again later.
    pub async fn forget_erased(&self) -> StoreResult<bool> {
        if !self.inner.erased.swap(false, Ordering::AcqRel) {
            return Ok(true);
        }
        let emptied = self.inner.writer.empty_log().await;
        if !matches!(emptied, Ok(true)) {
            self.inner.erased.store(true, Ordering::Release);
        }
        emptied
    }

    /// The connections that read.
    fn readers(&self) -> &SqlitePool {
        &self.inner.readers
    }

    /// Runs `work` in a transaction of the writer and answers once it is durable.
    async fn write<T, F>(&self, work: F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        self.inner.writer.run(work).await
    }

    /// Like [`Store::write`], for work that makes room: when the disk is full the ballast is freed and the work done again, since
    /// SQLite needs space even to delete.
    async fn erase<T, F>(&self, work: impl Fn() -> F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        let result = self.write_with(&self.inner.ballast, work).await;
        self.inner.erased.store(true, Ordering::Release);
        result
    }

    /// Like [`Store::write`], for letting in who makes room.
    async fn let_in<T, F>(&self, work: impl Fn() -> F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        self.write_with(&self.inner.door, work).await
    }

    async fn write_with<T, F>(&self, ballast: &Ballast, work: impl Fn() -> F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        match self.write(work()).await {
            Err(StoreError::DiskFull) if ballast.release().await => self.write(work()).await,
            result => result,
        }
    }

    fn now_ms(&self) -> i64 {
        self.inner.clock.now_ms()
    }

    fn max_attempts(&self) -> u32 {
        self.inner.settings.max_attempts
    }
}

/// Each room is a borrowed store under a name of its own.
macro_rules! rooms {
    ($($(#[$doc:meta])* $function:ident: $room:ident;)*) => {
        impl Store { $(
            $(#[$doc])*
            pub fn $function(&self) -> $room<'_> {
                $room(self)
            }
        )* }
    };
}

rooms! {
    /// Who can sign in.
    people: People;
    /// Which instructors teach which trainees.
    groups: Groups;
    /// Browsers that are signed in.
    cookies: Cookies;
    /// Programs' ways in.
    tokens: Tokens;
    /// Who trains.
    trainees: Trainees;
    /// What they do.
    tasks: Tasks;
    /// What that asks for.
    standards: Standards;
    /// Who is compared with whom.
    cohorts: Cohorts;
    /// What courses ask for, and which groups follow one.
    courses: Courses;
    /// What tells their levels apart.
    skill_models: SkillModels;
    /// Where they do it.
    boxes: Boxes;
    /// Versions of boxes' cameras.
    calibrations: Calibrations;
    /// Versions of boxes' colours.
    palettes: Palettes;
    /// Boxes' traffic lights.
    self_tests: SelfTests;
    /// Recordings that are arriving.
    uploads: Uploads;
    /// Recordings that are arriving frame by frame.
    feeds: Feeds;
    /// Recordings that are here, and what came of them.
    sessions: Sessions;
    /// What raters give sessions.
    ratings: Ratings;
    /// What people say about seconds of sessions.
    comments: Comments;
    /// What people change about scored sessions.
    edits: Edits;
    /// Orders to score sessions again.
    rescorings: Rescorings;
    /// Work that waits, runs or has ended.
    jobs: Jobs;
    /// Which files the database refers to.
    blobs: Blobs;
    /// Who changed what.
    audit: Audit;
}

#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
