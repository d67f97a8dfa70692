//! Comments on moments of sessions. People who may see a session may comment on it. Staff who rate see the comments of
//! other staff only after a rating of their own, so that comments cannot influence the rating.

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::comment::NewComment;
use crate::domain::text::{Name, Remark};
use crate::ids::{CommentId, PersonId, SessionId};

/// Access to the comments.
pub struct CommentStore<'s>(pub(super) &'s Store);

/// Maximum number of comments on one session: more would not be read.
pub const MAX_COMMENTS: i64 = 500;

/// Maximum number of comments of one trainee on one session. The rest of [`MAX_COMMENTS`] is left for the people who
/// teach, so that no trainee can stop them from commenting.
const MAX_OF_TRAINEE: i64 = 100;

/// A comment on a moment or a stretch of a session.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct CommentRecord {
    /// Its id.
    pub id: CommentId,
    /// Its author; `None` if the account has been deleted.
    pub person_id: Option<PersonId>,
    /// The author's name.
    pub who: Option<Name>,
    /// Beginning, seconds of the recording.
    pub from_s: f64,
    /// End, seconds of the recording; equal to `from_s` for a single moment.
    pub to_s: f64,
    /// The text.
    pub text: Remark,
    /// When, epoch ms.
    pub created_at_ms: i64,
    /// True if its author is a trainee.
    pub is_by_trainee: bool,
}

impl CommentRecord {
    /// True if the scope, which sees the session, may delete it: an own comment, or as staff one of a trainee or of a
    /// deleted account.
    pub fn may_be_deleted_by(&self, scope: &Scope) -> bool {
        let is_own = self.person_id.is_some() && self.person_id == scope.person();
        is_own || scope.is_staff() && (self.person_id.is_none() || self.is_by_trainee)
    }
}

/// The comments of a session that the caller may read, and the number of hidden ones.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibleComments {
    /// The comments, in the order of `from_s`.
    pub items: Vec<CommentRecord>,
    /// Number of comments by other staff that are hidden until the caller has rated.
    pub hidden: i64,
}

/// Selects at most `$6` comments on session `$3` that person `$4` may read: their own, the trainee's, and all if `$5`
/// is true. Those of a trainee whose session it was before it was moved are left out: they come back if it is moved back.
const SELECT_READABLE: &str = "
    SELECT * FROM comment_record
    WHERE $1 <> 'agent' AND session_id = $3 AND ($5 OR is_by_trainee OR coalesce(person_id = $4, FALSE))
      AND (NOT is_by_trainee
           OR person_id IN (SELECT person.id FROM person JOIN session ON session.trainee_id = person.trainee_id
                            WHERE session.id = $3))
    ORDER BY from_s, id LIMIT $6";

/// Counts the other comments.
const COUNT_HIDDEN: &str = "
    SELECT count(*) FROM comment_record
    WHERE $1 <> 'agent' AND session_id = $3 AND NOT ($5 OR is_by_trainee OR coalesce(person_id = $4, FALSE))";

const INSERT_COMMENT: &str = "
    INSERT INTO comment (id, session_id, person_id, from_s, to_s, text, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6, $7
    WHERE (SELECT count(*) FROM comment WHERE session_id = $2) < $8
      AND (SELECT count(*) FROM comment WHERE session_id = $2 AND person_id = $3) < $9";

const SCALE_COMMENTS: &str = "
    UPDATE comment SET from_s = min(from_s * $2, 86400), to_s = min(to_s * $2, 86400) WHERE session_id = $1";

const COUNT_OWN_COMMENTS: &str = "SELECT count(*) FROM comment WHERE session_id = $1 AND person_id = $2";

/// Deletes a comment of person `$3`, and if `$4` is true one of a trainee or of a deleted account. Returns its author.
const DELETE_COMMENT: &str = "
    DELETE FROM comment
    WHERE id = $1 AND session_id = $2
      AND (coalesce(person_id = $3, FALSE)
           OR $4 AND (person_id IS NULL
                      OR EXISTS (SELECT 1 FROM person WHERE person.id = comment.person_id AND person.role = 'trainee')))
    RETURNING person_id";

/// Multiplies the times of a session's comments, because its recording has other times now.
pub(super) async fn scale_comments(tx: &mut SqliteConnection, session: SessionId, ratio: f64) -> StoreResult<()> {
    sqlx::query(SCALE_COMMENTS).bind(session).bind(ratio).execute(tx).await?;
    Ok(())
}

impl CommentStore<'_> {
    /// Adds a comment. Its times are not checked against the length of the recording, which may be unknown.
    ///
    /// # Errors
    /// The session has [`MAX_COMMENTS`] comments, or `MAX_OF_TRAINEE` of this trainee.
    pub async fn add(
        &self,
        scope: &Scope,
        session: SessionId,
        new: NewComment,
        span: [f64; 2],
    ) -> StoreResult<CommentRecord> {
        self.0.sessions().get(scope, session).await?;
        let person = scope.person().ok_or(StoreError::Forbidden { what: "commenting", whom: "people" })?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), CommentId::at(self.0.now_ms()));
        let [from_s, to_s] = span;
        let max_own = if scope.is_staff() { MAX_COMMENTS } else { MAX_OF_TRAINEE };
        self.0
            .write(async move |tx| {
                let insert = sqlx::query(INSERT_COMMENT);
                let insert = insert.bind(id).bind(session).bind(person).bind(from_s).bind(to_s).bind(new.text);
                let insert = insert.bind(now_ms).bind(MAX_COMMENTS).bind(max_own);
                let inserted = insert.execute(&mut *tx).await.map_err(missing("session"))?;
                if inserted.rows_affected() == 0 {
                    let own = sqlx::query_scalar(COUNT_OWN_COMMENTS).bind(session).bind(person);
                    let own: i64 = own.fetch_one(&mut *tx).await?;
                    return Err(StoreError::refused(if own >= max_own {
                        format!("you have made {own} comments on this session; withdraw one of them first")
                    } else {
                        format!("the session has {MAX_COMMENTS} comments; withdraw one first")
                    }));
                }
                note(tx, &by, now_ms, ("create", "comment"), id).await
            })
            .await?;
        let all = self.of_session(scope, session).await?.items;
        all.into_iter().find(|comment| comment.id == id).ok_or(not_found("comment"))
    }

    /// The comments of a session that the caller may read, in the order of `from_s`.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<VisibleComments> {
        self.0.sessions().get(scope, session).await?;
        let all = !scope.is_staff() || self.0.ratings().has_rated(scope, session).await?;
        let rows = sqlx::query_as(SELECT_READABLE);
        let rows = rows.bind_scope(scope).bind(session).bind(scope.person()).bind(all).bind(MAX_COMMENTS);
        let items = rows.fetch_all(self.0.readers()).await?;
        let count = sqlx::query_scalar(COUNT_HIDDEN);
        let count = count.bind_scope(scope).bind(session).bind(scope.person()).bind(all);
        Ok(VisibleComments { items, hidden: count.fetch_one(self.0.readers()).await? })
    }

    /// Deletes one of the caller's own comments, or as staff one of a trainee or of a deleted account. Any other comment
    /// is reported as not found.
    pub async fn withdraw(&self, scope: &Scope, session: SessionId, id: CommentId) -> StoreResult<()> {
        self.0.sessions().get(scope, session).await?;
        let (by, now_ms, person, is_staff) = (scope.clone(), self.0.now_ms(), scope.person(), scope.is_staff());
        self.0
            .write_with_delete_reserve(|| {
                let by = by.clone();
                async move |tx| {
                    let delete = sqlx::query_scalar(DELETE_COMMENT).bind(id).bind(session).bind(person).bind(is_staff);
                    let author: Option<Option<PersonId>> = delete.fetch_optional(&mut *tx).await?;
                    let author = author.ok_or(not_found("comment"))?;
                    let action = if author.is_some() && author == person { "withdraw" } else { "delete" };
                    note(tx, &by, now_ms, (action, "comment"), id).await
                }
            })
            .await
    }
}
