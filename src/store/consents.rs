//! Consent texts, and the decisions of trainees about recordings. [`require_consent`] is the check that every new session
//! passes, in the transaction that inserts it.

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::{BindScope, require_administrator, require_trainee};
use super::{Scope, Store};
use crate::domain::consent::{
    ConsentDecision, ConsentMeans, ConsentState, ConsentTextChange, ConsentWording, NewConsent, NewConsentText,
    RequiredVersions,
};
use crate::domain::text::{Key, Name, Paragraphs};
use crate::ids::{ConsentId, ConsentTextId, TraineeId};
use crate::time::Day;

/// Access to consent texts and consents.
pub struct ConsentStore<'s>(pub(super) &'s Store);

/// Maximum number of versions of the text: all of them are read at once.
pub const MAX_TEXTS: i64 = 200;
/// Maximum number of decisions about one trainee: all of them are read at once.
pub const MAX_CONSENTS: i64 = 200;
/// A trainee who was recorded within this time counts as active, ms.
const ACTIVE_MS: i64 = 30 * 86_400_000;

/// A published version of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConsentTextRecord {
    /// Its id.
    pub id: ConsentTextId,
    /// Its number, from 1 on.
    pub version: i64,
    /// The English text.
    pub en: Option<ConsentWording>,
    /// The German text.
    pub de: Option<ConsentWording>,
    /// From when on new recordings need consent to it, epoch ms; `None`: they do not.
    pub required_from_ms: Option<i64>,
    /// Name of the person who published it; `None` if the account has been deleted.
    pub who: Option<Name>,
    /// When, epoch ms.
    pub published_at_ms: i64,
}

#[derive(sqlx::FromRow)]
struct TextRow {
    id: ConsentTextId,
    version: i64,
    title_en: Option<Name>,
    body_en: Option<Paragraphs>,
    title_de: Option<Name>,
    body_de: Option<Paragraphs>,
    required_from_ms: Option<i64>,
    who: Option<Name>,
    published_at_ms: i64,
}

impl From<TextRow> for ConsentTextRecord {
    fn from(row: TextRow) -> Self {
        let wording = |title: Option<Name>, body: Option<Paragraphs>| {
            title.zip(body).map(|(title, body)| ConsentWording { title, body })
        };
        Self {
            id: row.id,
            version: row.version,
            en: wording(row.title_en, row.body_en),
            de: wording(row.title_de, row.body_de),
            required_from_ms: row.required_from_ms,
            who: row.who,
            published_at_ms: row.published_at_ms,
        }
    }
}

/// The trainees that requiring a version of the text would touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct ConsentEffect {
    /// All trainees.
    pub trainees: i64,
    /// Those who have not consented to the version or a later one.
    pub without_consent: i64,
    /// Those of them who were recorded within the last 30 days.
    pub active_without_consent: i64,
    /// Those of them who have no account, so that staff have to record a paper.
    pub without_account: i64,
}

/// A decision about recordings of a trainee.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct ConsentRecord {
    /// Its id.
    pub id: ConsentId,
    /// The decision.
    pub decision: ConsentDecision,
    /// How it was recorded.
    pub how: ConsentMeans,
    /// The text that it is about.
    pub text_id: ConsentTextId,
    /// The version of that text.
    pub version: i64,
    /// The day on the paper.
    pub signed_on: Option<Day>,
    /// Name of the person who recorded it; `None` if the account has been deleted.
    pub who: Option<Name>,
    /// When it was recorded, epoch ms.
    pub created_at_ms: i64,
}

/// Whether a trainee consents, and how it came to that.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraineeConsent {
    /// The state now.
    pub state: ConsentState,
    /// With [`ConsentState::Due`]: from when on new recordings are refused, epoch ms.
    pub due_at_ms: Option<i64>,
    /// The decisions, newest first.
    pub history: Vec<ConsentRecord>,
}

const SELECT_TEXTS: &str = "
    SELECT consent_text.id, version, title_en, body_en, title_de, body_de, required_from_ms, person.name AS who,
           published_at_ms
    FROM consent_text LEFT JOIN person ON person.id = consent_text.person_id
    WHERE $1 <> 'agent' ORDER BY version DESC LIMIT $2";

const INSERT_TEXT: &str = "
    INSERT INTO consent_text (id, version, title_en, body_en, title_de, body_de, required_from_ms, person_id,
                              published_at_ms)
    SELECT $1, coalesce(max(version), 0) + 1, $2, $3, $4, $5, $6, $7, $8 FROM consent_text
    HAVING count(*) < $9";

const UPDATE_REQUIRED_FROM: &str = "UPDATE consent_text SET required_from_ms = $2 WHERE id = $1";

const SELECT_VERSION: &str = "SELECT version FROM consent_text WHERE id = $1";

/// Counts the trainees without a consent to version `$1` or a later one; `NULL`: to a version that is still to come.
const SELECT_EFFECT: &str = "
    WITH candidate AS (
        SELECT trainee.id, NOT coalesce(latest.decision = 'given' AND latest.version >= $1, FALSE) AS lacks
        FROM trainee LEFT JOIN latest_consent AS latest ON latest.trainee_id = trainee.id
        WHERE trainee.id NOT IN (SELECT trainee_id FROM hidden_trainee))
    SELECT count(*) AS trainees, count(*) FILTER (WHERE lacks) AS without_consent,
           count(*) FILTER (WHERE lacks AND EXISTS (SELECT 1 FROM session WHERE session.trainee_id = candidate.id
                                                    AND session.created_at_ms >= $2)) AS active_without_consent,
           count(*) FILTER (WHERE lacks AND NOT EXISTS (SELECT 1 FROM person WHERE person.trainee_id = candidate.id))
               AS without_account
    FROM candidate";

const SELECT_REQUIRED: &str = "
    SELECT max(version) FILTER (WHERE required_from_ms <= $1), max(version) FILTER (WHERE required_from_ms > $1)
    FROM consent_text";

/// Selects when the first version becomes required that is later than version `$2`.
const SELECT_DUE: &str = "
    SELECT min(required_from_ms) FROM consent_text WHERE required_from_ms > $1 AND version > $2";

const SELECT_LATEST: &str = "SELECT decision, version FROM latest_consent WHERE trainee_id = $1";

const SELECT_LATEST_OF_MANY: &str = "
    SELECT trainee.id, latest.decision, latest.version
    FROM trainee LEFT JOIN latest_consent AS latest ON latest.trainee_id = trainee.id
    WHERE trainee.id IN (SELECT value FROM json_each($3))
      AND ($1 = 'administrator'
           OR trainee.id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee.id NOT IN (SELECT trainee_id FROM hidden_trainee))";

const SELECT_HISTORY: &str = "
    SELECT consent.id, decision, how, text_id, version, signed_on, person.name AS who, consent.created_at_ms
    FROM consent JOIN consent_text ON consent_text.id = consent.text_id
    LEFT JOIN person ON person.id = consent.person_id
    WHERE consent.trainee_id = $1 ORDER BY consent.rowid DESC LIMIT $2";

const SELECT_LATEST_FOR_CHANGE: &str = "
    SELECT decision, text_id, created_at_ms FROM consent
    WHERE rowid = (SELECT max(latest.rowid) FROM consent AS latest WHERE latest.trainee_id = $1)";

const INSERT_CONSENT: &str = "
    INSERT INTO consent (id, trainee_id, text_id, decision, how, signed_on, person_id, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6, $7, $8 WHERE (SELECT count(*) FROM consent WHERE trainee_id = $2) < $9";

impl ConsentStore<'_> {
    /// The published versions of the text, newest first.
    pub async fn texts(&self, scope: &Scope) -> StoreResult<Vec<ConsentTextRecord>> {
        let rows = sqlx::query_as(SELECT_TEXTS).bind(scope.role()).bind(MAX_TEXTS);
        let rows: Vec<TextRow> = rows.fetch_all(self.0.readers()).await?;
        Ok(rows.into_iter().map(ConsentTextRecord::from).collect())
    }

    /// Publishes a text as the next version.
    pub async fn publish(&self, scope: &Scope, new: NewConsentText) -> StoreResult<ConsentTextRecord> {
        require_administrator(scope, "publishing consent texts")?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), ConsentTextId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let [(title_en, body_en), (title_de, body_de)] =
                    [new.en, new.de].map(|wording| wording.map(|text| (text.title, text.body)).unzip());
                let insert =
                    sqlx::query(INSERT_TEXT).bind(id).bind(title_en).bind(body_en).bind(title_de).bind(body_de);
                let insert = insert.bind(new.required_from.map(Day::start_ms)).bind(by.person()).bind(now_ms);
                if insert.bind(MAX_TEXTS).execute(&mut *tx).await?.rows_affected() == 0 {
                    return Err(StoreError::refused(format!(
                        "{MAX_TEXTS} versions were published, which is the limit"
                    )));
                }
                note(tx, &by, now_ms, ("publish", "consent_text"), id).await
            })
            .await?;
        self.text(scope, id).await
    }

    /// Sets from when on new recordings need consent to a version. The text itself never changes.
    pub async fn change_text(
        &self,
        scope: &Scope,
        id: ConsentTextId,
        change: ConsentTextChange,
    ) -> StoreResult<ConsentTextRecord> {
        require_administrator(scope, "changing when a consent text is required")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let required_from_ms = change.required_from.map(Day::start_ms);
                let update =
                    sqlx::query(UPDATE_REQUIRED_FROM).bind(id).bind(required_from_ms).execute(&mut *tx).await?;
                if update.rows_affected() == 0 {
                    return Err(not_found("consent text"));
                }
                note(tx, &by, now_ms, ("change", "consent_text"), id).await
            })
            .await?;
        self.text(scope, id).await
    }

    async fn text(&self, scope: &Scope, id: ConsentTextId) -> StoreResult<ConsentTextRecord> {
        let all = self.texts(scope).await?;
        all.into_iter().find(|text| text.id == id).ok_or(not_found("consent text"))
    }

    /// The trainees that requiring this text would touch; `None`: one that is not published yet.
    pub async fn effect(&self, scope: &Scope, text: Option<ConsentTextId>) -> StoreResult<ConsentEffect> {
        require_administrator(scope, "the effect of a consent text")?;
        let version: Option<i64> = match text {
            Some(id) => {
                let version = sqlx::query_scalar(SELECT_VERSION).bind(id).fetch_optional(self.0.readers()).await?;
                Some(version.ok_or(not_found("consent text"))?)
            }
            None => None,
        };
        let effect = sqlx::query_as(SELECT_EFFECT).bind(version).bind(self.0.now_ms() - ACTIVE_MS);
        Ok(effect.fetch_one(self.0.readers()).await?)
    }

    /// Whether a trainee consents, with all decisions.
    pub async fn of_trainee(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<TraineeConsent> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        let now_ms = self.0.now_ms();
        let mut reader = self.0.readers().acquire().await?;
        let history = sqlx::query_as(SELECT_HISTORY).bind(trainee).bind(MAX_CONSENTS);
        let history: Vec<ConsentRecord> = history.fetch_all(&mut *reader).await?;
        let state = state_of(&mut reader, trainee, now_ms).await?;
        let due_at_ms: Option<i64> = match state {
            ConsentState::Due => {
                let given = history.first().map_or(0, |latest| latest.version);
                sqlx::query_scalar(SELECT_DUE).bind(now_ms).bind(given).fetch_one(&mut *reader).await?
            }
            _ => None,
        };
        Ok(TraineeConsent { state, due_at_ms, history })
    }

    /// The states of those of these trainees that the scope sees.
    pub async fn states(&self, scope: &Scope, ids: &[TraineeId]) -> StoreResult<HashMap<TraineeId, ConsentState>> {
        type LatestRow = (TraineeId, Option<ConsentDecision>, Option<i64>);
        let mut reader = self.0.readers().acquire().await?;
        let rows = sqlx::query_as(SELECT_LATEST_OF_MANY).bind_scope(scope).bind(Json(ids));
        let rows: Vec<LatestRow> = rows.fetch_all(&mut *reader).await?;
        let required = required_versions(&mut reader, self.0.now_ms()).await?;
        let state = |(id, decision, version): LatestRow| (id, ConsentState::of(decision.zip(version), required));
        Ok(rows.into_iter().map(state).collect())
    }

    /// Refuses new recordings of a trainee who does not consent, before their bytes are sent. What inserts a session
    /// checks it again.
    ///
    /// # Errors
    /// [`StoreError::ConsentMissing`].
    pub async fn require(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<()> {
        let states = self.states(scope, &[trainee]).await?;
        let state = *states.get(&trainee).ok_or(not_found("trainee"))?;
        if state.allows_recordings() { Ok(()) } else { Err(StoreError::ConsentMissing { state }) }
    }

    /// Records a decision of a trainee. Returns what holds now.
    ///
    /// # Errors
    /// A withdrawal without a consent, or a paper that is older than the refusal or withdrawal that it would replace.
    pub async fn record(
        &self,
        scope: &Scope,
        trainee: TraineeId,
        new: NewConsent,
        how: ConsentMeans,
    ) -> StoreResult<TraineeConsent> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                require_trainee(tx, &by, trainee).await?;
                let text = text_of_decision(tx, trainee, &new).await?;
                let signed_on = new.signed_on.filter(|_| how == ConsentMeans::Paper);
                let insert = sqlx::query(INSERT_CONSENT).bind(ConsentId::at(now_ms)).bind(trainee).bind(text);
                let insert = insert.bind(new.decision).bind(how).bind(signed_on).bind(by.person());
                let inserted = insert.bind(now_ms).bind(MAX_CONSENTS).execute(&mut *tx).await;
                if inserted.map_err(missing("text"))?.rows_affected() == 0 {
                    return Err(StoreError::refused(format!(
                        "{MAX_CONSENTS} decisions of this trainee are on record, which is the limit"
                    )));
                }
                let action = match new.decision {
                    ConsentDecision::Given => "record consent",
                    ConsentDecision::Refused => "refuse consent",
                    ConsentDecision::Withdrawn => "withdraw consent",
                };
                note(tx, &by, now_ms, (action, "trainee"), trainee).await
            })
            .await?;
        self.of_trainee(scope, trainee).await
    }
}

/// The text that a decision is about, after a check against the latest decision.
async fn text_of_decision(
    tx: &mut SqliteConnection,
    trainee: TraineeId,
    new: &NewConsent,
) -> StoreResult<ConsentTextId> {
    let latest = sqlx::query_as(SELECT_LATEST_FOR_CHANGE).bind(trainee).fetch_optional(tx).await?;
    let latest: Option<(ConsentDecision, ConsentTextId, i64)> = latest;
    match (new.decision, latest) {
        (ConsentDecision::Withdrawn, Some((ConsentDecision::Given, text, _))) => Ok(text),
        (ConsentDecision::Withdrawn, _) => {
            Err(StoreError::refused("the trainee has no consent that could be withdrawn"))
        }
        (ConsentDecision::Refused, Some((ConsentDecision::Given, ..))) => {
            Err(StoreError::refused("the trainee has consented: withdraw the consent instead"))
        }
        (ConsentDecision::Given, Some((ConsentDecision::Refused | ConsentDecision::Withdrawn, _, at_ms)))
            if new.signed_on.is_some_and(|day| day < Day::of(at_ms)) =>
        {
            Err(StoreError::refused(format!(
                "the paper was signed before the trainee decided against recordings on {}: ask for a new consent",
                Day::of(at_ms)
            )))
        }
        _ => new.text.ok_or(not_found("text")),
    }
}

async fn required_versions(reader: &mut SqliteConnection, now_ms: i64) -> StoreResult<RequiredVersions> {
    let (now, later) = sqlx::query_as(SELECT_REQUIRED).bind(now_ms).fetch_one(reader).await?;
    Ok(RequiredVersions { now, later })
}

pub(super) async fn state_of(
    reader: &mut SqliteConnection,
    trainee: TraineeId,
    now_ms: i64,
) -> StoreResult<ConsentState> {
    let latest = sqlx::query_as(SELECT_LATEST).bind(trainee).fetch_optional(&mut *reader).await?;
    Ok(ConsentState::of(latest, required_versions(reader, now_ms).await?))
}

/// Refuses a new session, or an upload that would become one, of a trainee who does not consent.
pub(super) async fn require_consent(tx: &mut SqliteConnection, trainee: TraineeId, now_ms: i64) -> StoreResult<()> {
    let state = state_of(tx, trainee, now_ms).await?;
    if state.allows_recordings() { Ok(()) } else { Err(StoreError::ConsentMissing { state }) }
}

/// Refuses to go on with a recording that has begun, if the trainee decided against recordings meanwhile.
pub(super) async fn require_no_refusal(tx: &mut SqliteConnection, trainee: TraineeId, now_ms: i64) -> StoreResult<()> {
    let state = state_of(tx, trainee, now_ms).await?;
    if state.ends_running_recordings() { Err(StoreError::ConsentMissing { state }) } else { Ok(()) }
}
