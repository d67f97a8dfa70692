//! The agents that stand by at boxes: when each was seen last, and who made a box record or checked in there.

use super::audit::note;
use super::error::{StoreResult, missing};
use super::visibility::{BindScope, require_trainee};
use super::{Scope, Store};
use crate::ids::{BoxId, TraineeId};

/// Access to the agents of boxes.
pub struct BoxAgentStore<'s>(pub(super) &'s Store);

/// When the agent of a box was seen last.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct BoxAgentRecord {
    /// Its box.
    pub box_id: BoxId,
    /// Its program and version.
    pub program: String,
    /// When its last state arrived, precise to a minute, epoch ms.
    pub last_seen_ms: i64,
}

/// What a person, or a trainee at the box, made a box do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxCommand {
    /// Start a recording.
    Start,
    /// End the recording.
    Stop,
    /// Start a recording without a name.
    StartUnnamed,
    /// Check a trainee in.
    CheckIn,
    /// Check the trainee out.
    CheckOut,
}

impl BoxCommand {
    fn action(self) -> &'static str {
        match self {
            Self::Start => "start recording",
            Self::Stop => "stop recording",
            Self::StartUnnamed => "start recording without a name",
            Self::CheckIn => "check in",
            Self::CheckOut => "check out",
        }
    }
}

const SELECT_BOX_AGENTS: &str = "
    SELECT box_id, program, last_seen_ms FROM box_agent WHERE $1 <> 'agent' OR $2 = box_id";

const UPSERT_BOX_AGENT: &str = "
    INSERT INTO box_agent (box_id, program, last_seen_ms) VALUES ($1, $2, $3)
    ON CONFLICT (box_id) DO UPDATE SET program = excluded.program, last_seen_ms = excluded.last_seen_ms";

impl BoxAgentStore<'_> {
    /// The agents that were ever seen, of the boxes that the scope sees.
    pub async fn list(&self, scope: &Scope) -> StoreResult<Vec<BoxAgentRecord>> {
        Ok(sqlx::query_as(SELECT_BOX_AGENTS).bind_scope(scope).fetch_all(self.0.readers()).await?)
    }

    /// Notes that the agent of a box was seen now.
    pub async fn note_seen(&self, of: BoxId, program: String) -> StoreResult<()> {
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let upsert = sqlx::query(UPSERT_BOX_AGENT).bind(of).bind(program).bind(now_ms);
                upsert.execute(&mut *tx).await.map_err(missing("box")).map(drop)
            })
            .await
    }

    /// Notes in the audit trail what a box is made to do with a trainee: an entry about each of the two. `seen_by`: the
    /// scope that must see the trainee, if other than that of the actor.
    pub async fn note_command(
        &self,
        by: &Scope,
        seen_by: &Scope,
        command: BoxCommand,
        (of, trainee): (BoxId, TraineeId),
    ) -> StoreResult<()> {
        let (by, seen_by, now_ms) = (by.clone(), seen_by.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                require_trainee(tx, &seen_by, trainee).await?;
                note(tx, &by, now_ms, (command.action(), "box"), of).await?;
                note(tx, &by, now_ms, (command.action(), "trainee"), trainee).await
            })
            .await
    }

    /// Notes in the audit trail what a box is made to do without a trainee.
    pub async fn note_unnamed_command(&self, by: &Scope, command: BoxCommand, of: BoxId) -> StoreResult<()> {
        let (by, now_ms) = (by.clone(), self.0.now_ms());
        self.0.write(async move |tx| note(tx, &by, now_ms, (command.action(), "box"), of).await).await
    }
}
