//! Certificates, what happened to them, and the keys that sign them.
//!
//! A certificate never changes. What happens to a session that it relies on puts it under review: [`mark`] is the one
//! function for this, and every statement that moves, edits or erases sessions calls it in its transaction.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_administrator, require_staff, require_trainee};
use super::{Scope, Store};
use crate::domain::certificate::key::{CertificateKeyId, CertificatePublicKey, CertificateSigner};
use crate::domain::certificate::{CertificateCode, CertificateContent, CertificateEventKind, CertificateState};
use crate::domain::text::{Invalid, Name, Remark};
use crate::ids::{CertificateId, ExamId, PersonId, SessionId, TaskId, TraineeId};

/// Most certificates of one trainee. A standard that is met gives one in each language.
const MAX_OF_TRAINEE: i64 = 200;

/// Access to the certificates.
pub struct CertificateStore<'s>(pub(super) &'s Store);

/// A key that signs certificates, or did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CertificateKeyRecord {
    /// Its id.
    pub id: CertificateKeyId,
    /// The public part.
    pub public: CertificatePublicKey,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
    /// When another one replaced it, epoch ms; `None`: it is in use.
    pub retired_at_ms: Option<i64>,
}

/// A signed certificate to store.
#[derive(Clone, Debug)]
pub struct IssuedCertificate {
    /// The trainee.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
    /// The exam that was passed; `None`: it rests on the progress.
    pub exam: Option<ExamId>,
    /// The sessions that it relies on, in the order of the content.
    pub sessions: Vec<SessionId>,
    /// What it says.
    pub content: CertificateContent,
    /// The signed file.
    pub pdf: Vec<u8>,
}

/// A certificate without its file.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct CertificateRecord {
    /// Its id.
    pub id: CertificateId,
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The task; `None` if it was deleted.
    pub task_id: Option<TaskId>,
    /// What it says.
    #[sqlx(json)]
    pub content: CertificateContent,
    /// When it was issued, epoch ms.
    pub issued_at_ms: i64,
    /// Its state.
    pub state: CertificateState,
    /// Since when, epoch ms.
    pub state_at_ms: i64,
    /// Why it was withdrawn, for the public.
    pub reason: Option<Remark>,
}

/// Something that happened to a certificate.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct CertificateEvent {
    /// What happened.
    pub kind: CertificateEventKind,
    /// Number of the session that it is about.
    pub session_number: Option<i64>,
    /// Name of the person; `None` if deleted, or if the service did it.
    pub who: Option<Name>,
    /// The reason, in the person's words.
    pub reason: Option<Remark>,
    /// When, epoch ms.
    pub at_ms: i64,
}

/// What anyone with a certificate's address may know.
#[derive(Clone, Debug, PartialEq)]
pub struct PublicCertificate {
    /// Its state.
    pub state: CertificateState,
    /// Since when, epoch ms.
    pub state_at_ms: i64,
    /// Why it was withdrawn.
    pub reason: Option<Remark>,
    /// What it says; `None`: the person's data were erased.
    pub content: Option<CertificateContent>,
    /// What put it under review and is not decided yet: kind, number of the session, epoch ms.
    pub marks: Vec<(CertificateEventKind, Option<i64>, i64)>,
}

/// Selects certificates of a list.
#[derive(Clone, Copy, Debug, Default)]
pub struct CertificateFilter {
    /// Only those of this trainee.
    pub trainee: Option<TraineeId>,
    /// Only those in this state.
    pub state: Option<CertificateState>,
}

#[derive(sqlx::FromRow)]
struct KeyRow {
    id: CertificateKeyId,
    public_key: Vec<u8>,
    created_at_ms: i64,
    retired_at_ms: Option<i64>,
}

#[derive(sqlx::FromRow)]
struct PublicRow {
    id: CertificateId,
    state: CertificateState,
    state_at_ms: i64,
    reason: Option<Remark>,
    content: Option<Json<CertificateContent>>,
    /// When the erasure of the person's data was requested, epoch ms; `None`: it was not.
    erasure_requested_at_ms: Option<i64>,
}

const SELECT_SEED: &str = "SELECT secret_key FROM certificate_key WHERE retired_at_ms IS NULL";

const SELECT_KEYS: &str = "
    SELECT id, public_key, created_at_ms, retired_at_ms FROM certificate_key ORDER BY created_at_ms DESC, id";

const INSERT_KEY: &str = "
    INSERT INTO certificate_key (id, public_key, secret_key, created_at_ms) VALUES ($1, $2, $3, $4)";

/// A retired key signs nothing more, so its secret part is deleted.
const RETIRE_KEY: &str = "
    UPDATE certificate_key SET secret_key = NULL, retired_at_ms = max($1, created_at_ms) WHERE retired_at_ms IS NULL";

const SELECT_ISSUER: &str = "SELECT name FROM person WHERE id = $1";

const SELECT_CERTIFICATES: &str = "
    SELECT id, trainee_id, task_id, content, issued_at_ms, state, state_at_ms, reason FROM certificate
    WHERE trainee_id IS NOT NULL
      AND ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($3 IS NULL OR trainee_id = $3) AND ($4 IS NULL OR state = $4) AND ($5 IS NULL OR id < $5)
    ORDER BY id DESC LIMIT $6";

const SELECT_CERTIFICATE: &str = "
    SELECT id, trainee_id, task_id, content, issued_at_ms, state, state_at_ms, reason FROM certificate
    WHERE id = $3 AND trainee_id IS NOT NULL
      AND ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))";

const SELECT_PDF: &str = "SELECT pdf FROM certificate WHERE id = $1 AND pdf IS NOT NULL";

const SELECT_EVENTS: &str = "
    SELECT event.kind, event.session_number, person.name AS who, event.reason, event.at_ms
    FROM certificate_event AS event LEFT JOIN person ON person.id = event.person_id
    WHERE event.certificate_id = $1 ORDER BY event.number";

/// The marks since staff decided last.
const SELECT_MARKS: &str = "
    SELECT kind, session_number, at_ms FROM certificate_event
    WHERE certificate_id = $1 AND kind NOT IN ('issued', 'kept', 'withdrawn', 'reinstated')
      AND number > (SELECT coalesce(max(decided.number), 0) FROM certificate_event AS decided
                    WHERE decided.certificate_id = $1 AND decided.kind IN ('kept', 'reinstated'))
    ORDER BY number LIMIT 100";

/// Anyone who has the code may read what the certificate says, unless the person waits for the erasure of their data.
const SELECT_PUBLIC: &str = "
    SELECT id, state, state_at_ms, reason, content,
           (SELECT requested_at_ms FROM pending_erasure
            WHERE trainee_id = coalesce((SELECT kept_id FROM merged_trainee
                                         WHERE merged_trainee.trainee_id = certificate.trainee_id),
                                        certificate.trainee_id)) AS erasure_requested_at_ms
    FROM certificate WHERE code = $1";

const SELECT_COUNT: &str = "SELECT count(*) FROM certificate WHERE trainee_id = $1";

const SELECT_SAME: &str = "
    SELECT EXISTS (SELECT 1 FROM certificate
                   WHERE trainee_id = $1 AND task_id = $2 AND standard_version = $3 AND language = $4
                     AND state IN ('valid', 'under_review') AND exam_id IS $5)";

/// Of these sessions, those that count for this trainee and task as they did when the certificate was written.
const SELECT_COUNTED: &str = "
    SELECT count(*) FROM assessed_session
    WHERE id IN (SELECT value FROM json_each($1)) AND trainee_id = $2 AND task_id = $3 AND verdict <> 'refused'";

const SELECT_IS_PASSED: &str = "
    SELECT EXISTS (SELECT 1 FROM exam
                   WHERE id = $1 AND trainee_id = $2 AND task_id = $3 AND state = 'closed' AND result = 'passed')";

const INSERT_CERTIFICATE: &str = "
    INSERT INTO certificate (id, code, trainee_id, task_id, standard_version, language, content, pdf, key_id, person_id,
                             issued_at_ms, state, state_at_ms, exam_id)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, 'valid', $11, $12)";

const INSERT_SESSION: &str = "INSERT INTO certificate_session (certificate_id, number, session_id) VALUES ($1, $2, $3)";

const INSERT_EVENT: &str = "
    INSERT INTO certificate_event (certificate_id, kind, person_id, reason, at_ms) VALUES ($1, $2, $3, $4, $5)";

const INSERT_MARKS: &str = "
    INSERT INTO certificate_event (certificate_id, kind, session_number, person_id, at_ms)
    SELECT relied.certificate_id, $2, relied.number, $3, $4
    FROM certificate_session AS relied JOIN certificate ON certificate.id = relied.certificate_id
    WHERE relied.session_id IN (SELECT value FROM json_each($1)) AND certificate.state <> 'erased'";

const SET_UNDER_REVIEW: &str = "
    UPDATE certificate SET state = 'under_review', state_at_ms = $2
    WHERE state = 'valid'
      AND id IN (SELECT certificate_id FROM certificate_session
                 WHERE session_id IN (SELECT value FROM json_each($1)))";

const SET_STATE: &str = "
    UPDATE certificate SET state = $2, state_at_ms = $3, reason = $4 WHERE id = $1 AND state = $5";

impl CertificateStore<'_> {
    /// The key in use. The first call makes it.
    pub async fn signer(&self) -> StoreResult<CertificateSigner> {
        let known: Option<Vec<u8>> = sqlx::query_scalar(SELECT_SEED).fetch_optional(self.0.readers()).await?;
        if let Some(seed) = known {
            return signer_of(seed);
        }
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let known: Option<Vec<u8>> = sqlx::query_scalar(SELECT_SEED).fetch_optional(&mut *tx).await?;
                match known {
                    Some(seed) => signer_of(seed), // another request made it a moment ago
                    None => insert_key(tx, &Scope::service(), now_ms).await,
                }
            })
            .await
    }

    /// All keys, the newest first. They are public.
    pub async fn keys(&self) -> StoreResult<Vec<CertificateKeyRecord>> {
        let rows: Vec<KeyRow> = sqlx::query_as(SELECT_KEYS).fetch_all(self.0.readers()).await?;
        rows.into_iter().map(key_record).collect()
    }

    /// Makes a new key that signs from now on, and deletes the secret part of the one before. What that one signed stays
    /// valid.
    pub async fn replace_key(&self, scope: &Scope) -> StoreResult<CertificateKeyId> {
        require_administrator(scope, "the keys of certificates")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                sqlx::query(RETIRE_KEY).bind(now_ms).execute(&mut *tx).await?;
                Ok(insert_key(tx, &by, now_ms).await?.public().id())
            })
            .await
    }

    /// The caller's name, as a certificate shows who issued it.
    pub async fn issuer(&self, scope: &Scope) -> StoreResult<String> {
        let Some(person) = scope.person() else { return Ok("Trocar".to_owned()) };
        let name: Option<Name> =
            sqlx::query_scalar(SELECT_ISSUER).bind(person).fetch_optional(self.0.readers()).await?;
        Ok(name.ok_or(not_found("person"))?.into())
    }

    /// Stores a certificate.
    ///
    /// # Errors
    /// A session that it relies on no longer counts, or there is the same certificate already.
    pub async fn add(&self, scope: &Scope, issued: IssuedCertificate) -> StoreResult<CertificateRecord> {
        require_staff(scope, "issuing certificates")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        let id = CertificateId::at(now_ms);
        self.0
            .write(async move |tx| {
                require_trainee(tx, &by, issued.trainee).await?;
                refuse_unfit(tx, &issued).await?;
                insert(tx, &by, (id, now_ms), issued).await?;
                note(tx, &by, now_ms, ("issue", "certificate"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// The certificates that the scope sees, the newest first.
    pub async fn list(
        &self,
        scope: &Scope,
        filter: CertificateFilter,
        page: &PageRequest,
    ) -> StoreResult<Page<CertificateRecord>> {
        let rows = sqlx::query_as(SELECT_CERTIFICATES).bind_scope(scope).bind(filter.trainee).bind(filter.state);
        let rows = rows.bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |certificate: &CertificateRecord| certificate.id.to_string()))
    }

    /// One certificate.
    pub async fn get(&self, scope: &Scope, id: CertificateId) -> StoreResult<CertificateRecord> {
        let row =
            sqlx::query_as(SELECT_CERTIFICATE).bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("certificate"))
    }

    /// What happened to a certificate, oldest first.
    pub async fn events(&self, scope: &Scope, id: CertificateId) -> StoreResult<Vec<CertificateEvent>> {
        self.get(scope, id).await?;
        Ok(sqlx::query_as(SELECT_EVENTS).bind(id).fetch_all(self.0.readers()).await?)
    }

    /// The signed file of a certificate.
    pub async fn pdf(&self, scope: &Scope, id: CertificateId) -> StoreResult<Vec<u8>> {
        self.get(scope, id).await?;
        let pdf: Option<Vec<u8>> = sqlx::query_scalar(SELECT_PDF).bind(id).fetch_optional(self.0.readers()).await?;
        pdf.ok_or(not_found("certificate"))
    }

    /// Decides that a certificate under review stays valid.
    pub async fn keep(&self, scope: &Scope, id: CertificateId, why: Remark) -> StoreResult<CertificateRecord> {
        require_staff(scope, "reviewing certificates")?;
        self.decide(scope, id, CertificateEventKind::Kept, why).await
    }

    /// Withdraws a certificate. The reason is public.
    pub async fn withdraw(&self, scope: &Scope, id: CertificateId, why: Remark) -> StoreResult<CertificateRecord> {
        require_administrator(scope, "withdrawing certificates")?;
        self.decide(scope, id, CertificateEventKind::Withdrawn, why).await
    }

    /// Makes a withdrawn certificate valid again.
    pub async fn reinstate(&self, scope: &Scope, id: CertificateId, why: Remark) -> StoreResult<CertificateRecord> {
        require_administrator(scope, "reinstating certificates")?;
        self.decide(scope, id, CertificateEventKind::Reinstated, why).await
    }

    async fn decide(
        &self,
        scope: &Scope,
        id: CertificateId,
        kind: CertificateEventKind,
        why: Remark,
    ) -> StoreResult<CertificateRecord> {
        let before = self.get(scope, id).await?.state;
        let (state, action, fits, refusal) = match kind {
            CertificateEventKind::Withdrawn => (
                CertificateState::Withdrawn,
                "withdraw",
                matches!(before, CertificateState::Valid | CertificateState::UnderReview),
                "the certificate is withdrawn already",
            ),
            CertificateEventKind::Reinstated => (
                CertificateState::Valid,
                "reinstate",
                before == CertificateState::Withdrawn,
                "the certificate is not withdrawn, so there is nothing to take back",
            ),
            _ => (
                CertificateState::Valid,
                "keep",
                before == CertificateState::UnderReview,
                "the certificate is not under review, so there is nothing to decide",
            ),
        };
        if !fits {
            return Err(StoreError::refused(refusal));
        }
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let public = (state == CertificateState::Withdrawn).then(|| why.clone());
                let update = sqlx::query(SET_STATE).bind(id).bind(state).bind(now_ms).bind(public).bind(before);
                if update.execute(&mut *tx).await?.rows_affected() == 0 {
                    let why = "another person has just changed the certificate: look at it again";
                    return Err(StoreError::refused(why));
                }
                insert_event(tx, (id, kind), by.person(), Some(why), now_ms).await?;
                note(tx, &by, now_ms, (action, "certificate"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// What the public may know of the certificate with this code. The code is the permission: 130 random bits that are on
    /// the certificate.
    pub async fn published(&self, code: &CertificateCode) -> StoreResult<Option<PublicCertificate>> {
        let row: Option<PublicRow> = sqlx::query_as(SELECT_PUBLIC).bind(code).fetch_optional(self.0.readers()).await?;
        let Some(row) = row else { return Ok(None) };
        if row.erasure_requested_at_ms.is_some() || row.content.is_none() {
            let state_at_ms = row.erasure_requested_at_ms.unwrap_or(row.state_at_ms);
            let state = CertificateState::Erased;
            return Ok(Some(PublicCertificate { state, state_at_ms, reason: None, content: None, marks: Vec::new() }));
        }
        let marks = match row.state {
            CertificateState::UnderReview => {
                sqlx::query_as(SELECT_MARKS).bind(row.id).fetch_all(self.0.readers()).await?
            }
            _ => Vec::new(),
        };
        let PublicRow { state, state_at_ms, reason, content, .. } = row;
        Ok(Some(PublicCertificate { state, state_at_ms, reason, content: content.map(|json| json.0), marks }))
    }
}

/// Puts the certificates that rely on these sessions under review, in the transaction that moves, edits or erases them. Call
/// it before the rows of the sessions are deleted.
pub(super) async fn mark(
    tx: &mut SqliteConnection,
    by: &Scope,
    sessions: &[SessionId],
    kind: CertificateEventKind,
    now_ms: i64,
) -> StoreResult<()> {
    let marks = sqlx::query(INSERT_MARKS).bind(Json(sessions)).bind(kind).bind(by.person()).bind(now_ms);
    if marks.execute(&mut *tx).await?.rows_affected() > 0 {
        sqlx::query(SET_UNDER_REVIEW).bind(Json(sessions)).bind(now_ms).execute(&mut *tx).await?;
    }
    Ok(())
}

fn signer_of(seed: Vec<u8>) -> StoreResult<CertificateSigner> {
    let unusable = |_| StoreError::Unusable("the key of certificates is damaged".to_owned());
    let seed: [u8; 32] = seed.try_into().map_err(unusable)?;
    CertificateSigner::from_seed(seed).map_err(|error: Invalid| StoreError::Unusable(error.to_string()))
}

fn key_record(row: KeyRow) -> StoreResult<CertificateKeyRecord> {
    let damaged = |_| StoreError::Unusable("a public key of certificates is damaged".to_owned());
    let public = CertificatePublicKey(row.public_key.try_into().map_err(damaged)?);
    let KeyRow { id, created_at_ms, retired_at_ms, .. } = row;
    Ok(CertificateKeyRecord { id, public, created_at_ms, retired_at_ms })
}

async fn insert_key(tx: &mut SqliteConnection, by: &Scope, now_ms: i64) -> StoreResult<CertificateSigner> {
    let signer = CertificateSigner::random().map_err(|error| StoreError::Unusable(error.to_string()))?;
    let id = signer.public().id();
    let insert = sqlx::query(INSERT_KEY).bind(&id).bind(signer.public().0.to_vec()).bind(signer.seed().to_vec());
    insert.bind(now_ms).execute(&mut *tx).await?;
    note(tx, by, now_ms, ("create", "certificate_key"), id).await?;
    Ok(signer)
}

/// Refuses a certificate that there is already, or whose sessions changed while it was written.
async fn refuse_unfit(tx: &mut SqliteConnection, issued: &IssuedCertificate) -> StoreResult<()> {
    let IssuedCertificate { trainee, task, exam, sessions, content, .. } = issued;
    let count: i64 = sqlx::query_scalar(SELECT_COUNT).bind(trainee).fetch_one(&mut *tx).await?;
    if count >= MAX_OF_TRAINEE {
        return Err(StoreError::refused(format!("the trainee has {MAX_OF_TRAINEE} certificates, which is the limit")));
    }
    let same = sqlx::query_scalar(SELECT_SAME).bind(trainee).bind(task).bind(content.standard.version);
    let same = same.bind(content.language).bind(exam);
    if same.fetch_one(&mut *tx).await? {
        return Err(StoreError::refused(
            "this certificate was issued already: download it, or let an administrator withdraw it first",
        ));
    }
    if let Some(exam) = exam {
        // The stored judgement of a closed exam stays; a later score of the session does not matter.
        let passed = sqlx::query_scalar(SELECT_IS_PASSED).bind(exam).bind(trainee).bind(task);
        return match passed.fetch_one(tx).await? {
            true => Ok(()),
            false => Err(StoreError::refused("the exam was not passed by this person: look at it again")),
        };
    }
    let counted = sqlx::query_scalar(SELECT_COUNTED).bind(Json(sessions)).bind(trainee).bind(task);
    let counted: i64 = counted.fetch_one(&mut *tx).await?;
    match usize::try_from(counted) == Ok(sessions.len()) && !sessions.is_empty() {
        true => Ok(()),
        false => Err(StoreError::refused("a session that counted has just changed: look at the progress again")),
    }
}

async fn insert(
    tx: &mut SqliteConnection,
    by: &Scope,
    (id, now_ms): (CertificateId, i64),
    issued: IssuedCertificate,
) -> StoreResult<()> {
    let IssuedCertificate { trainee, task, exam, sessions, content, pdf } = issued;
    let numbers: Vec<i64> = content.sessions.iter().map(|session| session.number as i64).collect();
    let insert = sqlx::query(INSERT_CERTIFICATE).bind(id).bind(content.code.clone()).bind(trainee).bind(task);
    let insert = insert.bind(content.standard.version).bind(content.language);
    let key = content.key.clone();
    let insert = insert.bind(Json(content)).bind(pdf).bind(key).bind(by.person()).bind(now_ms).bind(exam);
    insert.execute(&mut *tx).await.map_err(missing("task"))?;
    for (session, number) in sessions.into_iter().zip(numbers) {
        let insert = sqlx::query(INSERT_SESSION).bind(id).bind(number).bind(session);
        insert.execute(&mut *tx).await.map_err(missing("session"))?;
    }
    insert_event(tx, (id, CertificateEventKind::Issued), by.person(), None, now_ms).await
}

async fn insert_event(
    tx: &mut SqliteConnection,
    (id, kind): (CertificateId, CertificateEventKind),
    by: Option<PersonId>,
    reason: Option<Remark>,
    now_ms: i64,
) -> StoreResult<()> {
    sqlx::query(INSERT_EVENT).bind(id).bind(kind).bind(by).bind(reason).bind(now_ms).execute(tx).await?;
    Ok(())
}
