//! Who changed what of people's data: written in the transaction of the change, read by administrators.

use sqlx::sqlite::SqliteConnection;

use super::error::StoreResult;
use super::page::{Page, PageRequest};
use super::visibility::require_administrator;
use super::{Scope, Store};
use crate::domain::scope::Actor;

/// The audit trail.
pub struct Audit<'s>(pub(super) &'s Store);

/// One change.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct AuditEntry {
    /// Order of writing.
    pub id: i64,
    /// When, epoch ms.
    pub at_ms: i64,
    /// `person:ID`, `agent:BOX` or `service`.
    pub actor: String,
    /// `create`, `change`, `erase`, …
    pub action: String,
    /// What kind of thing was changed.
    pub noun: String,
    /// Its id.
    pub subject: String,
}

impl Audit<'_> {
    /// Changes, newest first.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<AuditEntry>> {
        require_administrator(scope, "the audit trail")?;
        let rows = sqlx::query_as(
            "SELECT id, at_ms, actor, action, noun, subject FROM audit
             WHERE $1 IS NULL OR id < CAST($1 AS INTEGER) ORDER BY id DESC LIMIT $2",
        );
        let rows = rows.bind(page.after()).bind(page.rows()).fetch_all(self.0.readers()).await?;
        Ok(Page::cut(rows, page, |entry: &AuditEntry| entry.id.to_string()))
    }
}

/// Notes a change, in the change's own transaction.
pub(super) async fn note(
    tx: &mut SqliteConnection,
    scope: &Scope,
    now_ms: i64,
    (action, noun): (&'static str, &'static str),
    subject: impl ToString,
) -> StoreResult<()> {
    let actor = match scope.actor() {
        Actor::Person(person) => format!("person:{person}"),
        Actor::Agent(of) => format!("agent:{of}"),
        Actor::Service => "service".to_owned(),
    };
    sqlx::query("INSERT INTO audit (at_ms, actor, action, noun, subject) VALUES ($1, $2, $3, $4, $5)")
        .bind(now_ms)
        .bind(actor)
        .bind(action)
        .bind(noun)
        .bind(subject.to_string())
        .execute(tx)
        .await?;
    Ok(())
}
