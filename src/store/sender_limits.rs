//! Limits of one sender: what it may have unfinished, and what it may send in a day. No person and no box can use up
//! what others need. A limit is checked in the transaction that takes the place.

use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteConnection;

use super::Scope;
use super::error::{StoreError, StoreResult};
use crate::domain::role::Role;
use crate::domain::scope::Actor;
use crate::domain::text::count_of;
use crate::ids::BoxId;

/// Limits of one sender: a person, or the agent of a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SenderLimits {
    /// Unfinished uploads. Usually 20.
    pub uploads: u64,
    /// Unfinished recordings that a person sends frame by frame, in all boxes. Usually 4. All people together may have
    /// half of a box's (`live.max_unfinished`), so that its agent always finds a place.
    pub feeds: u64,
    /// Recordings of a trainee or a box in 24 hours. Usually 300: a recording of three minutes, for 15 hours.
    pub daily_recordings: u64,
    /// Bytes of recordings of a trainee or a box in 24 hours. Usually 64 GiB: 15 hours at 10 Mbit/s.
    pub daily_bytes: u64,
    /// Browsers where a person is signed in; a further one signs out the oldest. Usually 20.
    pub sign_ins: u32,
}

impl Default for SenderLimits {
    fn default() -> Self {
        Self { uploads: 20, feeds: 4, daily_recordings: 300, daily_bytes: 64 << 30, sign_ins: 20 }
    }
}

/// Length of the day of the daily limits, ms.
const DAY_MS: i64 = 24 * 3_600_000;

const COUNT_UPLOADS: &str = "SELECT count(*) FROM upload WHERE session_id IS NULL AND expires_at_ms > $1";

const SUM_UPLOADS_OF: &str = "
    SELECT count(*), coalesce(sum(length), 0) FROM upload
    WHERE session_id IS NULL AND expires_at_ms > $1
      AND CASE WHEN $2 IS NULL THEN person_id IS NULL AND box_id = $3 ELSE person_id = $2 END";

const SUM_RECORDINGS_OF: &str = "
    SELECT count(*), coalesce(sum(blob.bytes), 0)
    FROM audit LEFT JOIN session ON session.id = subject
    LEFT JOIN waiting_recording AS waiting ON waiting.id = subject
    LEFT JOIN blob ON blob.hash = coalesce(session.video, waiting.video)
    WHERE actor = $1 AND at_ms > $2 AND noun IN ('session', 'waiting_recording') AND action IN ('create', 'import')";

const COUNT_FEEDS: &str = "
    SELECT count(*) FILTER (WHERE box_id = $1), count(*) FILTER (WHERE box_id = $1 AND actor LIKE 'person:%'),
           count(*) FILTER (WHERE actor = $2)
    FROM feed WHERE ended_at_ms IS NULL AND id <> $3";

/// Checks that one more upload of this length has a place: of all, and of its sender.
pub(super) async fn check_upload(
    tx: &mut SqliteConnection,
    scope: &Scope,
    limits: &SenderLimits,
    (max_unfinished, length): (u64, u64),
    now_ms: i64,
) -> StoreResult<()> {
    let (count, bytes) = unfinished_uploads(tx, scope, now_ms).await?;
    if scope.actor() != Actor::Service && count >= limits.uploads {
        let why = format!(
            "{count} of your uploads are unfinished, and no more are allowed at a time. Finish or delete one, or wait \
             until one expires."
        );
        return Err(StoreError::LimitReached { why, most: limits.uploads });
    }
    check_day(tx, scope, limits, (count, bytes + length), now_ms).await?;
    let all: i64 = sqlx::query_scalar(COUNT_UPLOADS).bind(now_ms).fetch_one(tx).await?;
    if all.unsigned_abs() >= max_unfinished {
        let why = format!("{all} uploads of all senders are unfinished. Try again when one of them has ended.");
        return Err(StoreError::LimitReached { why, most: max_unfinished });
    }
    Ok(())
}

/// Checks that one more recording has a place in its sender's day. `pending` are recordings and bytes that the sender
/// has announced, and that are no sessions yet. Administrators and instructors have no daily limit.
pub(super) async fn check_day(
    tx: &mut SqliteConnection,
    scope: &Scope,
    limits: &SenderLimits,
    pending: (u64, u64),
    now_ms: i64,
) -> StoreResult<()> {
    if !matches!(scope.role(), Role::Trainee | Role::Agent) {
        return Ok(());
    }
    let sums = sqlx::query_as(SUM_RECORDINGS_OF).bind(scope.actor().to_string()).bind(now_ms - DAY_MS);
    let (count, bytes): (i64, i64) = sums.fetch_one(tx).await?;
    let advice = "Continue later, or ask an administrator.";
    if count.unsigned_abs() + pending.0 >= limits.daily_recordings {
        let most = limits.daily_recordings;
        let sent = count_of(most, "recording");
        let why = format!("You have sent {sent} within 24 hours, which is the limit. {advice}");
        return Err(StoreError::LimitReached { why, most });
    }
    if bytes.unsigned_abs() + pending.1 > limits.daily_bytes {
        let most = limits.daily_bytes;
        let why = format!(
            "Your recordings within 24 hours would have more than {:.1} GiB, the most that is allowed. {advice}",
            most as f64 / f64::from(1 << 30)
        );
        return Err(StoreError::LimitReached { why, most });
    }
    Ok(())
}

/// Checks that one more recording that arrives frame by frame has a place in its box, and with its sender.
pub(super) async fn check_feed(
    tx: &mut SqliteConnection,
    scope: &Scope,
    limits: &SenderLimits,
    (of, id, max_of_box): (BoxId, impl ToString, u64),
    now_ms: i64,
) -> StoreResult<()> {
    let counts = sqlx::query_as(COUNT_FEEDS).bind(of).bind(scope.actor().to_string()).bind(id.to_string());
    let (all, by_people, own): (i64, i64, i64) = counts.fetch_one(&mut *tx).await?;
    let is_person = scope.person().is_some();
    let (found, most, whose) = match () {
        () if is_person && own.unsigned_abs() >= limits.feeds => (own, limits.feeds, "you have"),
        () if is_person && by_people.unsigned_abs() >= max_of_box.div_ceil(2) => {
            (by_people, max_of_box.div_ceil(2), "people have in this box")
        }
        () if all.unsigned_abs() >= max_of_box => (all, max_of_box, "this box has"),
        () => return check_day(tx, scope, limits, (0, 0), now_ms).await,
    };
    let why = format!("{whose} {found} unfinished recordings: end them, or wait until they end by themselves");
    Err(StoreError::LimitReached { why, most })
}

/// Number and total length of the sender's unfinished uploads.
async fn unfinished_uploads(tx: &mut SqliteConnection, scope: &Scope, now_ms: i64) -> StoreResult<(u64, u64)> {
    let of_box = match scope.actor() {
        Actor::Agent(of) => Some(of),
        Actor::Person(_) | Actor::Service => None,
    };
    let sums = sqlx::query_as(SUM_UPLOADS_OF).bind(now_ms).bind(scope.person()).bind(of_box);
    let (count, bytes): (i64, i64) = sums.fetch_one(tx).await?;
    Ok((count.unsigned_abs(), bytes.unsigned_abs()))
}
