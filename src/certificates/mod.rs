//! Issues certificates: decides whether the standard is met, makes the sheet, signs it and stores it.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the service [`Certificates`] |
//! | `words.rs` | the words of a sheet, in its language |
//! | `sheet.rs` | the sheet as a PDF |
//! | `font.rs` | the font, and the part of it that a file needs |

mod font;
mod sheet;
mod words;

use crate::cohorts::answer::{PassedBy, SessionStep, TaskPassed};
use crate::cohorts::{Cohorts, CohortsError, ProgressSelection, TraineeProgress};
use crate::domain::certificate::key::CertificateSigner;
use crate::domain::certificate::signed_file;
use crate::domain::certificate::{
    CONTENT_FORMAT, CertificateBasis, CertificateCode, CertificateContent, CertificateLanguage, CertifiedExam,
    CertifiedSession, CertifiedStandard, EXAM_FORMAT, NewCertificate,
};
use crate::domain::exam::ExamResult;
use crate::domain::scope::Scope;
use crate::domain::standard::StandardDefinition;
use crate::domain::text::Key;
use crate::ids::{ExamId, SessionId};
use crate::store::{
    CertificateRecord, ExamRecord, IssuedCertificate, StandardRecord, Store, StoreError, TaskRecord, TraineeRecord,
};
use crate::time::{Day, SharedClock};

/// Why no certificate was issued.
#[derive(Debug, thiserror::Error)]
pub enum IssueError {
    /// The standard is not met, or a session that counted is not as it was.
    #[error("{0}")]
    NotMet(String),
    /// The sheet cannot show a character.
    #[error(
        "the certificate cannot show the character `{character}` of “{text}”: it has the Latin, Greek, Cyrillic, Armenian \
         and Georgian scripts. Write the name in one of these, then issue it again"
    )]
    Unprintable {
        /// The character.
        character: char,
        /// The line that has it.
        text: String,
    },
    /// The text does not fit on one page.
    #[error("the certificate does not fit on one page: the standard has too many limits, or too many sessions counted")]
    TooLong,
    /// The font of the program cannot be used.
    #[error("font: {0}")]
    Font(String),
    /// The sheet could not be made.
    #[error("sheet: {0}")]
    Sheet(String),
    /// The progress could not be computed.
    #[error(transparent)]
    Progress(#[from] CohortsError),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The service is shutting down, or making the sheet panicked.
    #[error("making the certificate did not finish")]
    Interrupted,
}

/// What a certificate is based on.
struct CertificateFacts {
    standard: CertifiedStandard,
    basis: CertificateBasis,
    /// The exam, and its id.
    exam: Option<(ExamId, CertifiedExam)>,
    earned_on: String,
    measurement: String,
    sessions: Vec<(SessionId, CertifiedSession)>,
}

/// The service for certificates. Clones share it.
#[derive(Clone)]
pub struct Certificates {
    store: Store,
    cohorts: Cohorts,
    clock: SharedClock,
}

impl Certificates {
    /// A service on this store.
    pub fn new(store: &Store, clock: &SharedClock) -> Self {
        Self { store: store.clone(), cohorts: Cohorts::new(store.clone(), clock.clone()), clock: clock.clone() }
    }

    /// Issues a certificate for a trainee whose progress meets the task's standard. `base`: the service's address, without
    /// a slash at its end.
    pub async fn issue(
        &self,
        scope: &Scope,
        trainee: &Key,
        new: NewCertificate,
        base: &str,
    ) -> Result<CertificateRecord, IssueError> {
        let asked = ProgressSelection { task: Some(new.task), ..ProgressSelection::default() };
        let TraineeProgress { trainee, task, answer, .. } = self.cohorts.progress(scope, trainee, asked).await?;
        let task = task.ok_or(StoreError::NotFound { what: "task" })?;
        let passed = answer.passed.ok_or_else(|| {
            let why = "the standard is not met yet, so there is no certificate. The page of the progress says what is missing";
            IssueError::NotMet(why.to_owned())
        })?;
        let standards = self.store.standards().of_tasks(scope, &[task.id]).await?;
        let standard = standards.into_iter().find(|one| one.version == passed.standard);
        let standard = standard.ok_or(StoreError::NotFound { what: "standard" })?;
        let measurement = answer.pipeline.unwrap_or_default();
        let facts = facts_of_progress(new.language, &standard, &passed, &answer.sessions, measurement);
        self.issue_facts(scope, (trainee, task), new.language, facts, base).await
    }

    /// Issues the certificate of an exam that was passed. `base`: as in [`Certificates::issue`].
    pub async fn issue_of_exam(
        &self,
        scope: &Scope,
        exam: ExamId,
        language: CertificateLanguage,
        base: &str,
    ) -> Result<CertificateRecord, IssueError> {
        let exam = self.store.exams().get(scope, exam).await?;
        let standard = self.store.standards().get(scope, exam.standard_id).await?;
        let (trainee, task) = (Key::from(&exam.trainee_id), Key::from(&exam.task_id));
        let facts = self.facts_of_exam(scope, language, &exam, &standard).await?;
        let trainee = self.store.trainees().get(scope, &trainee).await?;
        let task = self.store.tasks().get(scope, &task).await?;
        self.issue_facts(scope, (trainee, task), language, facts, base).await
    }

    async fn facts_of_exam(
        &self,
        scope: &Scope,
        language: CertificateLanguage,
        exam: &ExamRecord,
        standard: &StandardRecord,
    ) -> Result<CertificateFacts, IssueError> {
        let not_passed = || {
            IssueError::NotMet("the exam was not passed, or is not closed yet, so there is no certificate".to_owned())
        };
        let passed = exam.result == Some(ExamResult::Passed);
        let attempt = exam.passing().filter(|_| passed).ok_or_else(not_passed)?;
        let (Some(identity), Some(examiner), Some(started_at_ms), Some(session)) =
            (exam.identity, &exam.examiner, exam.started_at_ms, attempt.session_id)
        else {
            return Err(not_passed());
        };
        let session = self.store.sessions().get(scope, session).await?;
        let certified = CertifiedExam {
            held_on: words::day_of(started_at_ms),
            examiner: examiner.to_string(),
            identity,
            attempts_used: exam.used(),
            attempts_allowed: exam.attempts,
            voided: exam.voided(),
        };
        let shown = CertifiedSession {
            number: attempt.number as usize,
            recorded_on: words::day_of(attempt.began_at_ms),
            day_known: true,
            supervision: session.supervision,
        };
        Ok(CertificateFacts {
            standard: certified_standard(language, (standard.version, standard.created_at_ms), &standard.definition),
            basis: CertificateBasis::Exam,
            exam: Some((exam.id, certified)),
            earned_on: words::day_of(attempt.began_at_ms),
            measurement: attempt.pipeline.clone().unwrap_or_default(),
            sessions: vec![(session.id, shown)],
        })
    }

    /// Issues a certificate that says these facts.
    async fn issue_facts(
        &self,
        scope: &Scope,
        (trainee, task): (TraineeRecord, TaskRecord),
        language: CertificateLanguage,
        facts: CertificateFacts,
        base: &str,
    ) -> Result<CertificateRecord, IssueError> {
        let centre = self.store.centre().get().await?.name.map(String::from);
        let logo = self.store.centre().logo().await?;
        let issuer = self.store.certificates().issuer(scope).await?;
        let signer = self.store.certificates().signer().await?;
        let code = CertificateCode::random();
        let CertificateFacts { standard, basis, exam, earned_on, measurement, sessions } = facts;
        let (exam, certified_exam) = exam.unzip();
        let (ids, sessions): (Vec<SessionId>, Vec<CertifiedSession>) = sessions.into_iter().unzip();
        let content = CertificateContent {
            format: if exam.is_some() { EXAM_FORMAT } else { CONTENT_FORMAT },
            address: format!("{base}/verify/{code}"),
            code,
            language,
            centre,
            trainee: trainee.name.to_string(),
            task: task.name.to_string(),
            standard,
            basis,
            exam: certified_exam,
            earned_on,
            sessions,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            measurement,
            issuer,
            issued_on: Day::of(self.clock.now_ms()).to_string(),
            key: signer.public().id(),
        };
        let (content, pdf) = tokio::task::spawn_blocking(move || signed(content, logo.as_ref(), &signer))
            .await
            .map_err(|_| IssueError::Interrupted)??;
        let issued = IssuedCertificate { trainee: trainee.id, task: task.id, exam, sessions: ids, content, pdf };
        Ok(self.store.certificates().add(scope, issued).await?)
    }
}

fn signed(
    content: CertificateContent,
    logo: Option<&crate::domain::centre::Logo>,
    signer: &CertificateSigner,
) -> Result<(CertificateContent, Vec<u8>), IssueError> {
    let (pdf, at) = sheet::draw(&content, logo)?;
    Ok((content, signed_file::sign(pdf, at, signer)))
}

/// A standard as a certificate says it.
fn certified_standard(
    language: CertificateLanguage,
    (version, created_at_ms): (i64, i64),
    definition: &StandardDefinition,
) -> CertifiedStandard {
    CertifiedStandard {
        version,
        set_on: words::day_of(created_at_ms),
        limits: definition.targets.iter().map(|target| words::limit(language, target)).collect(),
        rule: None,
    }
}

fn facts_of_progress(
    language: CertificateLanguage,
    standard: &StandardRecord,
    passed: &TaskPassed,
    steps: &[SessionStep],
    measurement: String,
) -> CertificateFacts {
    let rule = standard.definition.rule.filter(|_| passed.by == PassedBy::Rule);
    let certified = certified_standard(language, (standard.version, standard.created_at_ms), &standard.definition);
    let day = |time: &str| time.chars().take(10).collect::<String>();
    let counted = steps.iter().filter(|step| passed.sessions.contains(&step.number)).map(|step| {
        let session = CertifiedSession {
            number: step.number,
            recorded_on: day(&step.recorded_at),
            day_known: step.date_known,
            supervision: step.supervision,
        };
        (step.id, session)
    });
    CertificateFacts {
        standard: CertifiedStandard { rule: rule.map(|rule| words::rule(language, &rule)), ..certified },
        basis: if rule.is_some() { CertificateBasis::Rule } else { CertificateBasis::Charts },
        exam: None,
        earned_on: day(&passed.at),
        measurement,
        sessions: counted.collect(),
    }
}
