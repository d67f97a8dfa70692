//! The log of who looked at whose recordings: one entry for each viewer, session and hour. [`crate::access_log`] collects
//! the entries and writes them together.

use sqlx::sqlite::SqliteConnection;

use super::error::StoreResult;
use super::page::{Page, PageRequest};
use super::{Scope, Store};
use crate::domain::access::AccessedPart;
use crate::domain::role::Role;
use crate::domain::text::{Key, Name};
use crate::ids::{PersonId, SessionId, TokenId, TraineeId};

/// Access to the log.
pub struct AccessLogStore<'s>(pub(super) &'s Store);

/// Most entries of the log: beyond it, the oldest are deleted. About 200 MB.
pub const MAX_ENTRIES: i64 = 1_000_000;
/// Most entries that are deleted in one transaction.
const ROUND: i64 = 2_000;
/// Length of the time that has one entry, ms.
pub const HOUR_MS: i64 = 3_600_000;

/// What was opened: a session, or all recordings of a trainee.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AccessedRecordings {
    /// One session.
    Session(SessionId),
    /// All that is stored about a trainee.
    Trainee(TraineeId),
}

/// A viewer in one hour, and what was opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AccessKey {
    /// What was opened.
    pub opened: AccessedRecordings,
    /// The account.
    pub person: PersonId,
    /// The role that it was opened with.
    pub role: Role,
    /// The token, if a program opened it.
    pub token: Option<TokenId>,
    /// Hours since the epoch.
    pub hour: i64,
}

/// An entry to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewAccess {
    /// Who opened what.
    pub key: AccessKey,
    /// When, epoch ms.
    pub at_ms: i64,
    /// The sum of the numbers of the parts ([`AccessedPart::bit`]).
    pub parts: i64,
}

#[derive(sqlx::FromRow)]
struct AccessRow {
    id: i64,
    session_id: Option<SessionId>,
    task: Option<Name>,
    recorded_at_ms: Option<i64>,
    who: Option<Name>,
    role: Role,
    program: String,
    at_ms: i64,
    parts: i64,
}

/// An entry of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AccessEntry {
    /// Order of writing.
    pub id: i64,
    /// The session; `None` for an export of all recordings, and if the session was erased.
    pub session: Option<SessionId>,
    /// Name of the session's task.
    pub task: Option<Name>,
    /// When the session was recorded, epoch ms.
    pub recorded_at_ms: Option<i64>,
    /// Name of the viewer; `None` if the account was deleted.
    pub who: Option<Name>,
    /// The role that it was opened with.
    pub role: Role,
    /// Name of the token that a program used; `None`: a browser.
    pub program: Option<String>,
    /// The first time in the hour, epoch ms.
    pub at_ms: i64,
    /// What was opened.
    pub parts: Vec<AccessedPart>,
}

impl From<AccessRow> for AccessEntry {
    fn from(row: AccessRow) -> Self {
        Self {
            id: row.id,
            session: row.session_id,
            task: row.task,
            recorded_at_ms: row.recorded_at_ms,
            who: row.who,
            role: row.role,
            program: Some(row.program).filter(|name| !name.is_empty()),
            at_ms: row.at_ms,
            parts: AccessedPart::in_sum(row.parts),
        }
    }
}

/// A session or account that was erased meanwhile gives no entry.
const INSERT_OF_SESSION: &str = "
    INSERT INTO access_entry (trainee_id, session_id, person_id, role, program, hour, at_ms, parts)
    SELECT session.trainee_id, session.id, person.id, $3,
           CASE WHEN $4 IS NULL THEN '' ELSE coalesce((SELECT name FROM token WHERE token.id = $4), '–') END, $5, $6, $7
    FROM session JOIN person ON person.id = $2 WHERE session.id = $1
    ON CONFLICT (session_id, person_id, program, hour) DO UPDATE SET parts = access_entry.parts | excluded.parts";

const INSERT_OF_TRAINEE: &str = "
    INSERT INTO access_entry (trainee_id, session_id, person_id, role, program, hour, at_ms, parts)
    SELECT trainee.id, NULL, person.id, $3,
           CASE WHEN $4 IS NULL THEN '' ELSE coalesce((SELECT name FROM token WHERE token.id = $4), '–') END, $5, $6, $7
    FROM trainee JOIN person ON person.id = $2 WHERE trainee.id = $1";

const SELECT_ENTRIES: &str = "
    SELECT access_entry.id, session.id AS session_id, task.name AS task, session.recorded_at_ms, person.name AS who,
           access_entry.role, access_entry.program, access_entry.at_ms, access_entry.parts
    FROM access_entry LEFT JOIN session ON session.id = access_entry.session_id
    LEFT JOIN task ON task.id = session.task_id LEFT JOIN person ON person.id = access_entry.person_id
    WHERE access_entry.trainee_id = $1 AND ($2 IS NULL OR access_entry.id < CAST($2 AS INTEGER))
      AND (session.id IS NULL OR session.id NOT IN (SELECT session_id FROM sealed_session))
    ORDER BY access_entry.id DESC LIMIT $3";

const SELECT_HAS_OLD: &str = "
    SELECT EXISTS (SELECT 1 FROM access_entry WHERE at_ms < $1)
        OR (SELECT coalesce(max(id) - min(id), 0) FROM access_entry) >= $2";

const DELETE_OLD: &str = "
    DELETE FROM access_entry WHERE id IN (SELECT id FROM access_entry WHERE at_ms < $1 ORDER BY at_ms LIMIT $2)";

/// Deletes what is beyond the newest `$1` entries. Ids grow by one with each entry.
const DELETE_BEYOND: &str = "
    DELETE FROM access_entry
    WHERE id IN (SELECT id FROM access_entry
                 WHERE id <= (SELECT max(newest.id) FROM access_entry AS newest) - $1 ORDER BY id LIMIT $2)";

impl AccessLogStore<'_> {
    /// Writes entries in one transaction. An entry that exists in its hour only gets the further parts.
    pub async fn write(&self, entries: Vec<NewAccess>) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                for entry in &entries {
                    insert(tx, entry).await?;
                }
                Ok(())
            })
            .await
    }

    /// Who opened recordings of a trainee in the scope, newest first.
    pub async fn of_trainee(
        &self,
        scope: &Scope,
        trainee: TraineeId,
        page: &PageRequest,
    ) -> StoreResult<Page<AccessEntry>> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        let rows = sqlx::query_as(SELECT_ENTRIES).bind(trainee).bind(page.after()).bind(page.row_limit());
        let rows: Vec<AccessRow> = rows.fetch_all(self.0.readers()).await?;
        let rows = rows.into_iter().map(AccessEntry::from).collect();
        Ok(Page::from_rows(rows, page, |entry: &AccessEntry| entry.id.to_string()))
    }

    /// Deletes some entries from before this time, and some beyond the newest `most`. True if more may be left.
    pub async fn forget(&self, before_ms: i64, most: i64) -> StoreResult<bool> {
        let has_old = sqlx::query_scalar(SELECT_HAS_OLD).bind(before_ms).bind(most);
        let has_old: bool = has_old.fetch_one(self.0.readers()).await?;
        if !has_old {
            return Ok(false); // checked with a reader first, since every write costs a commit
        }
        self.0
            .write(async move |tx| {
                let old = sqlx::query(DELETE_OLD).bind(before_ms).bind(ROUND).execute(&mut *tx).await?;
                let beyond = sqlx::query(DELETE_BEYOND).bind(most).bind(ROUND).execute(&mut *tx).await?;
                Ok(old.rows_affected() + beyond.rows_affected() > 0)
            })
            .await
    }
}

async fn insert(tx: &mut SqliteConnection, NewAccess { key, at_ms, parts }: &NewAccess) -> StoreResult<()> {
    let insert = match key.opened {
        AccessedRecordings::Session(session) => sqlx::query(INSERT_OF_SESSION).bind(session),
        AccessedRecordings::Trainee(trainee) => sqlx::query(INSERT_OF_TRAINEE).bind(trainee),
    };
    let insert = insert.bind(key.person).bind(key.role).bind(key.token).bind(key.hour).bind(*at_ms).bind(*parts);
    insert.execute(tx).await?;
    Ok(())
}
