//! The database of a centre. All SQL is here, behind functions named for their meaning.
//!
//! One writer thread (`writer`) owns the only connection that writes and replies after the commit; reads use a pool
//! that cannot write. Functions on personal data take a [`Scope`]: rows outside it are reported as not found. A list is
//! a [`Page`]. Times are epoch milliseconds. Every function either completes durably or changes nothing.
//!
//! A statement is a constant above the functions that run it; a test prepares all of them. Parts that several statements
//! have in common are views (`migrations/0019_views.sql`). Visibility rules are in `visibility`.
//!
//! | accessor | functions |
//! |---|---|
//! | [`Store::people`] | `create` `list` `get` `change` `delete` `set_password` `has_password` · for sign-in: `by_login` · `count` |
//! | [`Store::groups`] | `create` `list` `get` `set_members` `delete` |
//! | [`Store::cookies`] | `create` `known_place` `person_of` `is_valid` `valid_of` `of_person` `end` `delete` `forget_expired` `forget_all` |
//! | [`Store::tokens`] | `create` `list` `of_person` `delete` `delete_own` `scope_of` |
//! | [`Store::identities`] | `sign_in` `link` `list` `of_person` `remove` `remove_own` `is_provider_sign_in` `sign_out` |
//! | [`Store::password_links`] | `create` `list` `withdraw` `look_up` `set_password` |
//! | [`Store::invitations`] | `accounts` `create` |
//! | [`Store::trainees`] | `create` `enrol` `list` `of_group` `named` `get` `audience` `groups` `change` `erase` |
//! | [`Store::tasks`] | `create` `list` `get` `changeable` `change` `delete` |
//! | [`Store::standards`] | `add` `newest` `in_use` `at` `of_tasks` `get` `list` |
//! | [`Store::cohorts`] | `create` `list` `get` `members` `replace` `delete` `values` `values_seen` |
//! | [`Store::courses`] | `create` `list` `get` `changeable` `of` `replace` `delete` `follow` `unfollow` `of_trainee` |
//! | [`Store::skill_models`] | `add` `in_use` `get` `list` `declared` |
//! | [`Store::boxes`] | `create` `list` `get` `changeable` `change` `delete` |
//! | [`Store::calibrations`] | `add` `in_use` `get` `list` |
//! | [`Store::palettes`] | `in_use` `get` `list` |
//! | [`Store::box_versions`] | `of_session` `set_calibration_valid_from` `set_palette_valid_from` |
//! | [`Store::self_tests`] | `list` `light_since` `last_passed` `camera_has_moved` |
//! | [`Store::box_agents`] | `list` `note_seen` `note_command` `note_unnamed_command` |
//! | [`Store::check_in_pins`] | `own_set_at` `set_at` `set` `remove` `by_code` |
//! | [`Store::uploads`] | `create` `get` `advance` `set_back` `finish` `delete` `expired` `unfinished` |
//! | [`Store::feeds`] | `open` `end` `forget` `forget_unfinished` `get` `unfinished` |
//! | [`Store::sessions`] | `create` `list` `get` `shared` `retry` `erase` `result` `result_with_edits` `evidence` `practice` `practice_of_many` `trainee_tasks` `trainees_of_task` `last_task` `refused_since` `unrated_since` |
//! | [`Store::waiting_recordings`] | `add` `known` `list` `get` `count` `proposable` `assign` `discard` `forget` `set_preview` `of_trainee` |
//! | [`Store::ratings`] | `give` `of_session` `has_rated` `given` `values` |
//! | [`Store::comments`] | `add` `of_session` `withdraw` |
//! | [`Store::feedback`] | `unseen` `new_results` `open` `mark_all_seen` `openings` |
//! | [`Store::attention`] | `dismiss` `list` `dismissed_alarms` `undo` |
//! | [`Store::error_lists`] | `add` `in_use` `list` |
//! | [`Store::score_formulas`] | `add` `list` |
//! | [`Store::error_sheets`] | `of_session` `begin` `open_items` `mark` `unmark` `set_values` `finish` `discard` `given` |
//! | [`Store::edits`] | `of_session` `in_force` `add` `undo` |
//! | [`Store::session_cuts`] | `of_session` `add` `join` |
//! | [`Store::session_moves`] | `of_session` `add` |
//! | [`Store::record_merges`] | `of_trainee` `records_of` `preview_trainees` `merge_trainees` `separate_trainees` `of_box` `preview_boxes` `merge_boxes` `separate_boxes` |
//! | [`Store::rescorings`] | `create` `cancel` `list` `get` `items` `trainees` · for [`crate::rescoring`]: `queue_waiting` `ended` `settle` `end_completed` |
//! | [`Store::jobs`] | `enqueue` `list` `get` `retry` `counts` · for [`crate::queue`]: `claim` `heartbeat` `finish_…` `fail` `mark_crashed` `release` `sweep` |
//! | [`Store::blobs`] | `unreferenced` `forget_if_unreferenced` `note` `has` `is_dropped` `all` `uses` `total` |
//! | [`Store::erasures`] | `after` `last` `repeat` `restore_times` `completed_later` `add` |
//! | [`Store::pending_erasures`] | `extent` `request` `list` `take_back` `due` |
//! | [`Store::retention`] | `old_videos` `drop_videos` `release_failed_pictures` |
//! | [`Store::personal_retention`] | `of_trainee` `due_videos` `set` |
//! | [`Store::consents`] | `texts` `publish` `change_text` `effect` `of_trainee` `states` `record` |
//! | [`Store::access_log`] | `write` `of_trainee` `forget` |
//! | [`Store::installation`] | `id` `backup_folder` `set_backup_folder` |
//! | [`Store::centre`] | `get` `logo` `set_name` `set_logo` |
//! | [`Store::certificates`] | `signer` `keys` `replace_key` `issuer` `add` `list` `get` `events` `pdf` `keep` `withdraw` `reinstate` `published` |
//! | [`Store::exams`] | `plan` `list` `get` `cancel` `start` `order` `take_back` `waiting` `set_completion` `void` `close` `of_session` `is_sealed` `is_ordered` `audience` |
//! | [`Store::first_steps`] | `get` |
//! | [`Store::audit`] | `list` · for [`crate::upkeep`]: `record_backup` · `last_backup` |

mod access_log;
mod attention;
mod audit;
mod blobs;
mod box_agents;
mod box_versions;
mod boxes;
mod calibrations;
mod centre;
mod certificates;
mod check_in_pins;
mod codes;
mod cohorts;
mod columns;
mod comments;
mod consents;
mod cookies;
mod courses;
mod disk_reserve;
mod edits;
mod enrolment;
mod erasures;
mod error;
mod error_lists;
mod error_sheets;
mod exams;
mod feedback;
mod feeds;
mod first_steps;
mod groups;
mod identities;
mod installation;
mod invitations;
mod jobs;
mod open;
mod owners;
mod page;
mod palettes;
mod password_links;
mod pending_erasures;
mod people;
mod personal_retention;
mod ratings;
mod record_merges;
mod rescorings;
mod retention;
mod schema_version;
mod self_tests;
mod sender_limits;
mod session_cuts;
mod session_moves;
mod sessions;
mod skill_models;
mod standards;
mod surroundings;
mod tasks;
mod tokens;
mod trainees;
mod update_copy;
mod uploads;
mod visibility;
mod waiting_recordings;
mod writer;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use serde::{Deserialize, Serialize};
use sqlx::SqlitePool;
use sqlx::sqlite::SqliteConnection;
use tokio::sync::watch;

pub use access_log::{
    AccessEntry, AccessKey, AccessLogStore, AccessedRecordings, HOUR_MS, MAX_ENTRIES as MAX_ACCESS_ENTRIES, NewAccess,
};
pub use attention::{AlarmKey, AttentionStore, DismissalRecord, RECENT_MS};
pub use audit::{AuditEntry, AuditStore, Backup};
pub use blobs::{BlobStore, BlobUse};
pub use box_agents::{BoxAgentRecord, BoxAgentStore, BoxCommand};
pub use box_versions::{BoxVersionStore, SessionSetup, UsedVersion};
pub use boxes::{BoxRecord, BoxStore};
pub use calibrations::{CalibrationRecord, CalibrationStore};
pub use centre::{CentreRecord, CentreStore};
pub use certificates::{
    CertificateEvent, CertificateFilter, CertificateKeyRecord, CertificateRecord, CertificateStore, IssuedCertificate,
    PublicCertificate,
};
pub use check_in_pins::{CheckInPinRecord, CheckInPinStore};
pub use cohorts::{CohortRecord, CohortStore, CohortValue};
pub use comments::{CommentRecord, CommentStore, VisibleComments};
pub use consents::{ConsentEffect, ConsentRecord, ConsentStore, ConsentTextRecord, TraineeConsent};
pub use cookies::{
    CookieHolder, CookieLifetime, CookieStore, KNOWN_PLACE_LIFETIME, NewSignIn, SignInOrigin, SignInRecord,
};
pub use courses::{CourseRecord, CourseStep, CourseStore, GroupCoursePlan, TraineeCourse};
pub use edits::{EditBasis, EditRecord, EditStore, SessionEdits};
pub use enrolment::{EnrolledTrainee, Enrolment, EnrolmentInvitations, EnrolmentOptions};
pub use erasures::ErasureStore;
pub use error::{StoreError, StoreResult};
pub use error_lists::{ErrorListRecord, ErrorListStore, ScoreFormulaRecord, ScoreFormulaStore};
pub use error_sheets::{ErrorMarkRecord, ErrorSheetRecord, ErrorSheetStore, GivenErrorSheet, VisibleErrorSheets};
pub use exams::{
    AttemptRecord, ExamFilter, ExamOfSession, ExamRecord, ExamStore, PlannedExam, SealedSubject, WaitingAttempt,
};
pub use feedback::{FeedbackEntry, FeedbackStore, SessionOpening};
pub use feeds::{FeedRow, FeedStore, NewFeed};
pub use first_steps::{FirstStepsRecord, FirstStepsStore};
pub use groups::{GroupRecord, GroupStore, Members};
pub use identities::{IdentityRecord, IdentityRefusal, IdentityStore, NewProviderSignIn};
pub use installation::InstallationStore;
pub use invitations::{InvitationRecord, InvitationStore, InvitationTerms, Invitations, Invitee, TraineeAccount};
pub use jobs::{JobRecord, JobStore, Lease, MAX_LOST_LEASES, QueueCounts, SweepResult};
pub use page::{Cursor, NotACursor, Page, PageRequest};
pub use palettes::{PaletteRecord, PaletteStore};
pub use password_links::{PasswordLinkRecord, PasswordLinkStore};
pub use pending_erasures::{ErasureExtent, PendingErasure, PendingErasureStore, StayingRecording};
pub use people::{NewPerson, PersonChange, PersonRecord, PersonStore};
pub use personal_retention::{PersonalRetentionRecord, PersonalRetentionStore};
pub use ratings::{GivenRating, RatingRecord, RatingStore, SessionValue, VisibleRatings};
pub use record_merges::{MergeEffect, MergedCount, MergedRecord, PartCount, RecordMerge, RecordMergeStore};
pub use rescorings::{EndedItem, RescoringItem, RescoringRecord, RescoringStore, RescoringTrainee, ResultComparison};
pub use retention::{RetentionStore, VideoAge};
pub use schema_version::SchemaState;
pub use self_tests::{SelfTestLight, SelfTestRecord, SelfTestStore};
pub use sender_limits::SenderLimits;
pub use session_cuts::{SessionCutRecord, SessionCutStore};
pub use session_moves::{FiledUnder, SessionDestination, SessionMoveRecord, SessionMoveStore};
pub use sessions::{
    AttentionItem, Practice, PracticeMeasurement, PracticeResult, PracticeSession, SameRecording, SameRecordings,
    SessionCount, SessionFilter, SessionOrderKey, SessionRecord, SessionResult, SessionStore, SharedSession,
    TraineeTask,
};
pub use skill_models::{DeclaredSession, NewSkillModel, SkillModelRecord, SkillModelStore};
pub use standards::{StandardRecord, StandardStore};
pub use surroundings::SurroundingsStore;
pub use tasks::{TaskRecord, TaskStore};
pub use tokens::{ActsAs, NewToken, TokenRecord, TokenStore};
pub use trainees::{TraineeRecord, TraineeStore};
pub use uploads::{FinishedUpload, NewUpload, UploadRecord, UploadStore};
pub use visibility::TraineeAudience;
pub use waiting_recordings::{
    ArrivedRecording, AssignedRecording, AssignmentTarget, NewWaitingRecording, ProposableThing, ProposableThings,
    WaitingRecordingFilter, WaitingRecordingRecord, WaitingRecordingStore,
};

use crate::domain::scope::Scope;
use crate::time::SharedClock;
use disk_reserve::DiskReserve;
use open::FileStamp;
use writer::Writer;

/// How the store uses its database.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StoreSettings {
    /// Connections that read at the same time. More serve more simultaneous requests; each costs about 2 MiB. Usually
    /// 4.
    pub readers: u32,
    /// Writes that may wait for the writer; further callers are held back. Usually 256.
    pub waiting_writes: usize,
    /// Writes that may share one commit. More: fewer fsyncs under load, but later replies. Usually 64.
    pub writes_per_commit: usize,
    /// Wait for a lock or a free connection before the store reports that it is busy, ms. Usually 5000.
    pub busy_timeout_ms: u64,
    /// Number of crashes of its child process after which a job is quarantined. Usually 3.
    pub max_attempts: u32,
    /// Limits of one sender.
    pub senders: SenderLimits,
}

impl Default for StoreSettings {
    fn default() -> Self {
        Self {
            readers: 4,
            waiting_writes: 256,
            writes_per_commit: 64,
            busy_timeout_ms: 5_000,
            max_attempts: 3,
            senders: SenderLimits::default(),
        }
    }
}

/// The centre's database. Clones share one store.
#[derive(Clone, Debug)]
pub struct Store {
    inner: Arc<StoreInner>,
}

#[derive(Debug)]
struct StoreInner {
    path: PathBuf,
    /// The path, or SQLite's address of the file with the parameters that it is read with.
    address: PathBuf,
    readers: SqlitePool,
    /// `None`: the store only reads.
    writer: Option<Writer>,
    /// The database file when it was opened, if it is read without a lock.
    opened: Option<FileStamp>,
    clock: SharedClock,
    settings: StoreSettings,
    delete_reserve: DiskReserve,
    /// Space for signing in on a full disk.
    sign_in_reserve: DiskReserve,
    /// Sends after each commit that may have ended a sign-in or a token.
    ended_sign_ins: watch::Sender<()>,
    /// Has anything been erased since the write-ahead log was last emptied?
    has_erased_data: AtomicBool,
    /// Number of the last erasure that is no longer in the write-ahead log; negative: unknown.
    last_purged: AtomicI64,
}

const CHECK_INTEGRITY: &str = "PRAGMA integrity_check";

const SELECT_DANGLING: &str = "SELECT \"table\" FROM pragma_foreign_key_check";

const SELECT_BYTES: &str = "SELECT page_count * page_size FROM pragma_page_count(), pragma_page_size()";

impl Store {
    /// Damage that SQLite finds in its file, dangling references between rows, and closed exams whose result does not fit
    /// their attempts; empty if all is well.
    pub async fn check(&self) -> StoreResult<Vec<String>> {
        let integrity: Vec<String> = sqlx::query_scalar(CHECK_INTEGRITY).fetch_all(self.readers()).await?;
        let dangling: Vec<String> = sqlx::query_scalar(SELECT_DANGLING).fetch_all(self.readers()).await?;
        let dangling = dangling.into_iter().map(|table| format!("a row of `{table}` refers to one that is not there"));
        let exams = exams::wrong_exams(self).await?;
        Ok(integrity.into_iter().filter(|line| line != "ok").chain(dangling).chain(exams).collect())
    }

    /// Closes the database for all clones: earlier requests are completed, later ones are refused as closed. A process
    /// may also end without calling this.
    pub async fn close(&self) {
        self.inner.readers.close().await;
        if let Some(writer) = &self.inner.writer {
            writer.close().await;
        }
    }

    /// Writes a consistent copy of the whole database to a file and replaces an existing one. The store stays usable
    /// meanwhile.
    pub async fn snapshot(&self, into: &Path) -> StoreResult<()> {
        open::snapshot(&self.inner.address, &self.inner.settings, into).await
    }

    /// Size of the database in bytes, without its write-ahead log.
    pub async fn bytes(&self) -> StoreResult<u64> {
        let pages: i64 = sqlx::query_scalar(SELECT_BYTES).fetch_one(self.readers()).await?;
        Ok(pages.unsigned_abs())
    }

    /// Writes the disk reserves again after a deletion on a full disk, if there is space now.
    pub async fn restore_reserves(&self) {
        self.inner.delete_reserve.restore().await;
        self.inner.sign_in_reserve.restore().await;
    }

    /// After an erasure, also by another process: moves the write-ahead log into the database file and empties it, so
    /// that no copy of the erased data is left. `false` if a reader prevents it: try again later.
    pub async fn purge_erased(&self) -> StoreResult<bool> {
        let last = self.erasures().last().await?;
        let has_erased = self.inner.has_erased_data.swap(false, Ordering::AcqRel);
        if !has_erased && self.inner.last_purged.load(Ordering::Acquire) == last {
            return Ok(true);
        }
        let emptied = self.writer()?.empty_log().await;
        if matches!(emptied, Ok(true)) {
            self.inner.last_purged.store(last, Ordering::Release);
        } else {
            self.inner.has_erased_data.store(true, Ordering::Release);
        }
        emptied
    }

    /// Changes after each commit of this process that may have ended a sign-in or a token, now and then without one.
    pub fn ended_sign_ins(&self) -> watch::Receiver<()> {
        self.inner.ended_sign_ins.subscribe()
    }

    /// The pool of reading connections.
    fn readers(&self) -> &SqlitePool {
        &self.inner.readers
    }

    fn writer(&self) -> StoreResult<&Writer> {
        self.inner.writer.as_ref().ok_or_else(|| StoreError::Unusable("it is open for reading only".to_owned()))
    }

    /// Runs `work` in a transaction of the writer and returns once it is durable.
    async fn write<T, F>(&self, work: F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        self.writer()?.run(work).await
    }

    /// Like [`Store::write`], for what may end sign-ins or tokens: [`Store::ended_sign_ins`] then changes.
    async fn write_ending_sign_ins<T, F>(&self, work: F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        let result = self.write(work).await;
        self.inner.ended_sign_ins.send_replace(());
        result
    }

    /// Like [`Store::write_ending_sign_ins`], for deletions: on a full disk the delete reserve is freed and the work is
    /// done again, since SQLite needs space even to delete.
    async fn write_with_delete_reserve<T, F>(&self, work: impl Fn() -> F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        let result = self.write_with_reserve(&self.inner.delete_reserve, work).await;
        self.inner.has_erased_data.store(true, Ordering::Release);
        self.inner.ended_sign_ins.send_replace(());
        result
    }

    /// Like [`Store::write_ending_sign_ins`], for signing in: on a full disk the sign-in reserve is freed.
    async fn write_with_sign_in_reserve<T, F>(&self, work: impl Fn() -> F) -> StoreResult<T>
    where
        F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<T> + Send + 'static,
        T: Send + 'static,
    {
        let result = self.write_with_reserve(&self.inner.sign_in_reserve, work).await;
        self.inner.ended_sign_ins.send_replace(());
        result
    }

    async fn write_with_reserve<T, F>(&self, ballast: &DiskReserve, work: impl Fn() -> F) -> StoreResult<T>
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

    /// Limits of one sender.
    fn sender_limits(&self) -> SenderLimits {
        self.inner.settings.senders.clone()
    }

    /// Number of crashes of its child process after which a job is quarantined.
    pub fn max_attempts(&self) -> u32 {
        self.inner.settings.max_attempts
    }
}

/// Defines the accessors, each a borrowed store with the functions of one topic.
macro_rules! accessors {
    ($($(#[$doc:meta])* $function:ident: $accessor:ident;)*) => {
        impl Store { $(
            $(#[$doc])*
            pub fn $function(&self) -> $accessor<'_> {
                $accessor(self)
            }
        )* }
    };
}

accessors! {
    /// Accounts that can sign in.
    people: PersonStore;
    /// Training groups: which instructors teach which trainees.
    groups: GroupStore;
    /// Signed-in browsers.
    cookies: CookieStore;
    /// Access tokens of programs.
    tokens: TokenStore;
    /// Accounts at providers of single sign-on.
    identities: IdentityStore;
    /// Links for choosing a password.
    password_links: PasswordLinkStore;
    /// Trainees.
    trainees: TraineeStore;
    /// Tasks that trainees practise.
    tasks: TaskStore;
    /// Standards of tasks.
    standards: StandardStore;
    /// Reference groups to compare trainees with.
    cohorts: CohortStore;
    /// Course plans, and which groups follow one.
    courses: CourseStore;
    /// Models that estimate a trainee's level.
    skill_models: SkillModelStore;
    /// Training boxes.
    boxes: BoxStore;
    /// The agents that stand by at boxes.
    box_agents: BoxAgentStore;
    /// PINs that trainees check in with at boxes.
    check_in_pins: CheckInPinStore;
    /// Versions of the boxes' cameras.
    calibrations: CalibrationStore;
    /// Which version of camera and colours a recording is tracked with.
    box_versions: BoxVersionStore;
    /// Versions of the boxes' colours.
    palettes: PaletteStore;
    /// Self-tests of boxes, with their traffic lights.
    self_tests: SelfTestStore;
    /// Recordings that are being uploaded.
    uploads: UploadStore;
    /// Recordings that are streamed frame by frame.
    feeds: FeedStore;
    /// Complete recordings and their results.
    sessions: SessionStore;
    /// Recordings that wait for a name.
    waiting_recordings: WaitingRecordingStore;
    /// Ratings of sessions.
    ratings: RatingStore;
    /// Comments on moments of sessions.
    comments: CommentStore;
    /// Feedback that is new to trainees.
    feedback: FeedbackStore;
    /// What staff dismissed from their lists of what needs attention.
    attention: AttentionStore;
    /// Lists of error items of tasks.
    error_lists: ErrorListStore;
    /// Score formulas of tasks.
    score_formulas: ScoreFormulaStore;
    /// Error sheets of sessions.
    error_sheets: ErrorSheetStore;
    /// Edits of scored sessions.
    edits: EditStore;
    /// Cuts of recordings with two attempts.
    session_cuts: SessionCutStore;
    /// Moves of sessions to the right trainee, task or box.
    session_moves: SessionMoveStore;
    /// Merges of two records of one person or box.
    record_merges: RecordMergeStore;
    /// What stands still in boxes and recordings.
    surroundings: SurroundingsStore;
    /// Rescoring orders.
    rescorings: RescoringStore;
    /// Jobs that are queued, running or ended.
    jobs: JobStore;
    /// Files that the database refers to.
    blobs: BlobStore;
    /// The audit trail.
    audit: AuditStore;
    /// Ids of erased people and recordings.
    erasures: ErasureStore;
    /// Trainees who wait for their erasure.
    pending_erasures: PendingErasureStore;
    /// The installation that the database belongs to.
    installation: InstallationStore;
    /// The centre's name and logo.
    centre: CentreStore;
    /// Certificates, and the keys that sign them.
    certificates: CertificateStore;
    /// Exams and their attempts.
    exams: ExamStore;
    /// What a new centre has, and lacks.
    first_steps: FirstStepsStore;
    /// Accounts of trainees, and links for their passwords.
    invitations: InvitationStore;
    /// Videos and pictures that are kept for a limited time.
    retention: RetentionStore;
    /// How long the videos of single trainees are kept.
    personal_retention: PersonalRetentionStore;
    /// Consent texts and consents.
    consents: ConsentStore;
    /// Who looked at whose recordings.
    access_log: AccessLogStore;
}

#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
