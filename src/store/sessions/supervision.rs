//! Marks that a member of staff saw the attempt that a session shows.

use super::super::audit::note;
use super::super::certificates;
use super::super::error::{StoreResult, not_found};
use super::super::exams::refuse_if_of_exam;
use super::super::visibility::require_staff;
use super::{SessionRecord, SessionStore};
use crate::domain::certificate::CertificateEventKind;
use crate::domain::session::Supervision;
use crate::ids::SessionId;
use crate::store::Scope;

pub(in crate::store) const UPDATE_SUPERVISION: &str =
    "UPDATE session SET supervision = $2, supervised_by = $3, supervised_at_ms = $4 WHERE id = $1";

impl SessionStore<'_> {
    /// Marks an attempt as seen by the caller, or takes the mark back. An attempt that has the mark keeps its first one.
    pub async fn set_supervised(&self, scope: &Scope, id: SessionId, supervised: bool) -> StoreResult<SessionRecord> {
        let session = self.get(scope, id).await?;
        require_staff(scope, "marking attempts as supervised")?;
        let is_marked = matches!(session.supervision, Some(Supervision::SentByStaff | Supervision::Marked));
        if is_marked == supervised && session.supervision.is_some() {
            return Ok(session);
        }
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        let (supervision, action) =
            if supervised { (Supervision::Marked, "supervise") } else { (Supervision::None, "unsupervise") };
        self.0
            .write(async move |tx| {
                refuse_if_of_exam(tx, id).await?;
                let update = sqlx::query(UPDATE_SUPERVISION).bind(id).bind(supervision).bind(by.person()).bind(now_ms);
                if update.execute(&mut *tx).await?.rows_affected() == 0 {
                    return Err(not_found("session"));
                }
                certificates::mark(tx, &by, &[id], CertificateEventKind::SessionChanged, now_ms).await?;
                note(tx, &by, now_ms, (action, "session"), id).await
            })
            .await?;
        self.get(scope, id).await
    }
}
