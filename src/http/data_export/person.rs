//! The files of one person in an export.

use std::fs::File;

use serde::Serialize;

use super::ExportJob;
use super::archive::{Archive, ExportFailure, unless_gone};
use crate::domain::blob::BlobHash;
use crate::domain::edit::EditsInForce;
use crate::domain::scope::Scope;
use crate::domain::text::{Code, Key, Login, Name};
use crate::domain::trainee::{Handedness, Level};
use crate::http::account::SignInEntry;
use crate::http::certificates::CertificateHistory;
use crate::http::exams::ExamResponse;
use crate::http::people::PersonResponse;
use crate::http::service::AuditChange;
use crate::http::sessions::{CutResponse, EditsResponse, MoveResponse, SessionResponse, write_edited_csv};
use crate::http::show::Time;
use crate::http::single_sign_on::IdentityResponse;
use crate::http::trainees::{AccessEntryResponse, ConsentResponse, RetentionResponse, TraineeResponse};
use crate::http::waiting_recordings::{RecordingProposal, WaitingRecordingResponse};
use crate::ids::{SessionId, TraineeId};
use crate::store::{
    CertificateFilter, ExamFilter, MergedRecord, PageRequest, SessionFilter, SessionOpening, SessionRecord,
    TraineeRecord,
};
use crate::time::Day;
use crate::vault::VaultError;

/// Sessions and audit entries that are read at a time.
const ROUND: u32 = 50;

/// Most entries of the access log in an export, the newest; like those of the audit trail.
const MAX_ACCESS_ENTRIES: usize = 10_000;

/// Says what a person's export is.
pub(super) const README: &str = "\
This file holds what Trocar stores about one person. In the export of an instructor, the account, the audit trail and the
groups of other instructors are left out. Staff get ratings, comments and error sheets of others on a session only after
they have rated it themselves; the person gets all.

audit.json         who changed this person's data, and what this person changed and from where: the newest 10,000
                   entries, with the network addresses of this person only
";

/// Says what the files in a person's folder are.
pub(super) const FILES: &str = "\
profile.json       name, level, hand, groups; account, sign-ins and accounts at
                   the provider of single sign-on, without the password;
                   when each session was opened; other records of the person
                   that were merged into this one
consent.json       whether the person consents to recordings, and all decisions
retention.json     for how long videos are kept
waiting_recordings.json  recordings that wait for a name, and that the list in the watched folder
                   gives to this person
certificates.json  certificates, with what happened to them
certificates/      the signed files
exams.json         exams, with what each attempt was judged by; no figure of
                   one that is not closed
box-pin.json       since when the person has a PIN for boxes
access.json        who opened this person's recordings, and exported them: the newest 10,000 entries; left out in the
                   export of an instructor
sessions/…/        one folder for each session:
  session.json     recording, quality, features with their error bars, versions
  ratings.json     ratings on forms, with remarks
  comments.json    comments
  error_sheets.json  errors that raters counted, and the score that they give
  edits.json       trims, corrections and answers of the staff, with reasons
  moves.json       moves of the session to another trainee, task or box
  cuts.json        cuts of a recording with two attempts into two sessions
  path.csv         the path of the tools: millimetres and seconds
  ….error.txt      in place of a path, preview, table or video that could not be read
  preview.jpg      one frame
  table.csv        the table of another program, if the session was imported
  video.…          the recording, if it was asked for and is still kept
sessions-filed-twice/…/  the same of recordings that this record and a merged
                   one both had: those of the merged one, which count nowhere
";

const FILE_ERROR: &str = "\
This file of the session could not be read. A path.csv beside this file is incomplete. Ask an administrator to look: the
service's log and `trocar admin check` name the cause.
";

/// Name, groups and account.
#[derive(Serialize)]
struct PersonProfile {
    trainee: TraineeResponse,
    /// The groups that the exporting person may see.
    groups: Vec<Name>,
    /// `null` without an account, and in the export of an instructor.
    account: Option<PersonResponse>,
    /// Empty without `account`.
    sign_ins: Vec<SignInEntry>,
    /// Accounts at the provider of single sign-on; empty without `account`.
    identities: Vec<IdentityResponse>,
    /// Other records of the person that are merged into this one; empty in the export of an instructor.
    merged_records: Vec<MergedRecordEntry>,
    /// When the person last opened each session, in the person's own export and that of administrators.
    openings: Vec<OpeningEntry>,
}

/// Another record of the person, and what is hidden of it.
#[derive(Serialize)]
struct MergedRecordEntry {
    id: TraineeId,
    code: Code,
    name: Name,
    level: Option<Level>,
    handedness: Option<Handedness>,
    created_at: Time,
    /// Login of its account, which cannot sign in any more.
    login: Option<Login>,
    merged_at: Time,
}

impl From<MergedRecord> for MergedRecordEntry {
    fn from(merged: MergedRecord) -> Self {
        let MergedRecord { id, code, name, level, handedness, created_at_ms, login, merged_at_ms } = merged;
        Self {
            id,
            code,
            name,
            level,
            handedness,
            created_at: Time(created_at_ms),
            login,
            merged_at: Time(merged_at_ms),
        }
    }
}

/// When a session was last opened.
#[derive(Serialize)]
struct OpeningEntry {
    session: SessionId,
    opened_at: Time,
}

/// Whether the trainee has a PIN for boxes. The PIN itself is not stored.
#[derive(Serialize)]
struct PinExport {
    set_at: Option<Time>,
}

/// Adds the files of a trainee below the folder `below`, which is empty or ends with a slash.
pub(super) fn add(
    job: &ExportJob,
    trainee: &TraineeRecord,
    below: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    job.app.note_export(&job.scope, trainee.id);
    archive.add_json(&format!("{below}profile.json"), &job.wait(profile(job, trainee))?)?;
    add_consent(job, trainee, below, archive)?;
    add_certificates(job, trainee, below, archive)?;
    add_exams(job, trainee, below, archive)?;
    add_sessions(job, trainee.id, &format!("{below}sessions/"), archive)?;
    if !job.has_account(trainee) {
        return Ok(());
    }
    let hidden = ExportJob { app: job.app.clone(), scope: Scope::service(), runtime: job.runtime.clone(), ..*job };
    for merged in job.wait(job.app.store.record_merges().records_of(&job.scope, trainee.id))? {
        add_sessions(&hidden, merged.id, &format!("{below}sessions-filed-twice/"), archive)?;
    }
    Ok(())
}

/// Adds the sessions of a trainee's record below the folder `below`.
fn add_sessions(job: &ExportJob, trainee: TraineeId, below: &str, archive: &mut Archive) -> Result<(), ExportFailure> {
    let filter = SessionFilter { trainee: Some(Key::from(&trainee)), ..SessionFilter::default() };
    let mut after = None;
    loop {
        let store = &job.app.store;
        let page = job.wait(store.sessions().list(&job.scope, &filter, &PageRequest::new(ROUND, after)))?;
        for session in page.items {
            let id = session.id;
            let folder = format!("{below}{}-{id}/", Day::of(session.recorded_at_ms));
            unless_gone(add_session(job, &session, &folder, archive))?;
        }
        after = page.next;
        if after.is_none() {
            return Ok(());
        }
    }
}

async fn profile(job: &ExportJob, trainee: &TraineeRecord) -> Result<PersonProfile, ExportFailure> {
    let (app, scope) = (&job.app, &job.scope);
    let account = if job.has_account(trainee) { app.store.people().of_trainee(scope, trainee.id).await? } else { None };
    let sign_ins = match &account {
        Some(account) => app.store.cookies().of_person(account.id, None, app.sign_in_lifetime()).await?,
        None => Vec::new(),
    };
    let identities = match &account {
        Some(account) => app.store.identities().of_person(scope, account.id).await?,
        None => Vec::new(),
    };
    let openings = match &account {
        Some(account) => app.store.feedback().openings(account.id).await?,
        None => Vec::new(),
    };
    let merged_records = match job.has_account(trainee) {
        true => app.store.record_merges().records_of(scope, trainee.id).await?,
        false => Vec::new(),
    };
    let opening = |of: SessionOpening| OpeningEntry { session: of.session_id, opened_at: Time(of.opened_at_ms) };
    Ok(PersonProfile {
        openings: openings.into_iter().map(opening).collect(),
        merged_records: merged_records.into_iter().map(MergedRecordEntry::from).collect(),
        trainee: TraineeResponse::new(trainee.clone(), scope),
        groups: app.store.trainees().groups(scope, trainee.id).await?,
        account: account.map(PersonResponse::from),
        sign_ins: sign_ins.into_iter().map(SignInEntry::from).collect(),
        identities: identities.into_iter().map(IdentityResponse::from).collect(),
    })
}

/// Adds the consents, how long videos are kept, and, unless an instructor exports, who looked at the recordings: that names
/// staff of other groups.
fn add_consent(
    job: &ExportJob,
    trainee: &TraineeRecord,
    below: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let (app, scope) = (&job.app, &job.scope);
    let consent = job.wait(app.store.consents().of_trainee(scope, trainee.id))?;
    archive.add_json(&format!("{below}consent.json"), &ConsentResponse::from(consent))?;
    let centre = app.retention.videos_months;
    let pin = PinExport { set_at: job.wait(app.store.check_in_pins().set_at(scope, trainee.id))?.map(Time) };
    archive.add_json(&format!("{below}box-pin.json"), &pin)?;
    let kept = job.wait(app.store.personal_retention().of_trainee(scope, trainee.id, centre))?;
    archive.add_json(&format!("{below}retention.json"), &RetentionResponse::new(kept, centre))?;
    let waiting = job.wait(app.store.waiting_recordings().of_trainee(scope, trainee.id))?.into_iter().map(|found| {
        let deleted_at_ms = app.retention.unnamed_until_ms(found.arrived_at_ms);
        WaitingRecordingResponse::new(found, deleted_at_ms, RecordingProposal::default())
    });
    archive.add_json(&format!("{below}waiting_recordings.json"), &waiting.collect::<Vec<_>>())?;
    if !job.has_account(trainee) {
        return Ok(());
    }
    let (mut entries, mut after) = (Vec::new(), None);
    while entries.len() < MAX_ACCESS_ENTRIES {
        let page = PageRequest::new(PageRequest::MAX_LIMIT, after);
        let page = job.wait(app.store.access_log().of_trainee(scope, trainee.id, &page))?;
        entries.extend(page.items.into_iter().map(AccessEntryResponse::from));
        after = page.next;
        if after.is_none() {
            break;
        }
    }
    archive.add_json(&format!("{below}access.json"), &entries)
}

/// Adds the certificates, with their signed files.
fn add_certificates(
    job: &ExportJob,
    trainee: &TraineeRecord,
    below: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let (store, scope) = (&job.app.store, &job.scope);
    let filter = CertificateFilter { trainee: Some(trainee.id), state: None };
    let (mut all, mut after) = (Vec::new(), None);
    loop {
        let page = job.wait(store.certificates().list(scope, filter, &PageRequest::new(ROUND, after)))?;
        for certificate in page.items {
            let id = certificate.id;
            let events = job.wait(store.certificates().events(scope, id))?;
            let file = job.wait(store.certificates().pdf(scope, id))?;
            let day = &certificate.content.issued_on;
            archive.add_file(&format!("{below}certificates/{day}-{id}.pdf"), file.as_slice())?;
            all.push(CertificateHistory::new(certificate, events, scope));
        }
        after = page.next;
        if after.is_none() {
            return archive.add_json(&format!("{below}certificates.json"), &all);
        }
    }
}

/// Adds the exams, as the exporting person may see them.
fn add_exams(
    job: &ExportJob,
    trainee: &TraineeRecord,
    below: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let filter = ExamFilter { trainee: Some(trainee.id), state: None };
    let (mut all, mut after) = (Vec::new(), None);
    loop {
        let page = job.wait(job.app.store.exams().list(&job.scope, filter, &PageRequest::new(ROUND, after)))?;
        all.extend(page.items.into_iter().map(ExamResponse::from));
        after = page.next;
        if after.is_none() {
            return archive.add_json(&format!("{below}exams.json"), &all);
        }
    }
}

/// Adds the entries of the audit trail about a trainee, unless an instructor exports: they name staff of other groups.
pub(super) fn add_audit(job: &ExportJob, trainee: &TraineeRecord, archive: &mut Archive) -> Result<(), ExportFailure> {
    if !job.has_account(trainee) {
        return Ok(());
    }
    let entries = job.wait(job.app.store.audit().about(&job.scope, trainee.id))?;
    archive.add_json("audit.json", &entries.into_iter().map(AuditChange::from).collect::<Vec<_>>())
}

/// Adds a session. All is read before the first file is written, since the session can be erased meanwhile.
fn add_session(
    job: &ExportJob,
    session: &SessionRecord,
    folder: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let (app, scope, id) = (&job.app, &job.scope, session.id);
    let scored = job.wait(app.store.sessions().result_with_edits(scope, id))?;
    let edits = job.wait(app.store.edits().of_session(scope, id))?;
    let moves = job.wait(app.store.session_moves().of_session(scope, id))?;
    let cuts = job.wait(app.store.session_cuts().of_session(scope, id))?;
    let (ratings, comments) = (job.wait(app.ratings_of(scope, id))?, job.wait(app.comments_of(scope, id))?);
    let error_sheets = job.wait(app.error_sheets_of(scope, id))?;
    let shown = SessionResponse::of(session.clone(), scored.as_ref().map(|(result, _)| result.clone()));
    archive.add_json(&format!("{folder}session.json"), &shown)?;
    archive.add_json(&format!("{folder}ratings.json"), &ratings)?;
    archive.add_json(&format!("{folder}comments.json"), &comments)?;
    archive.add_json(&format!("{folder}error_sheets.json"), &error_sheets)?;
    archive.add_json(&format!("{folder}edits.json"), &EditsResponse::from(edits))?;
    let moves: Vec<MoveResponse> =
        moves.into_iter().map(|made| MoveResponse::for_trainee(made, session.trainee_id)).collect();
    archive.add_json(&format!("{folder}moves.json"), &moves)?;
    let cuts: Vec<CutResponse> = cuts.into_iter().map(CutResponse::for_trainee).collect();
    archive.add_json(&format!("{folder}cuts.json"), &cuts)?;
    if let Some((result, in_force)) = scored {
        add_path(job, id, (result.trajectory, &in_force), folder, archive)?;
        if let Some(preview) = result.preview
            && let Some(file) = open(job, id, (preview, &format!("{folder}preview")), archive)?
        {
            archive.add_file(&format!("{folder}preview.jpg"), file)?;
        }
    }
    add_recording(job, session, folder, archive)
}

/// Adds the path, or says in a file that it cannot be read: one damaged file must not withhold all others.
fn add_path(
    job: &ExportJob,
    session: SessionId,
    path: (BlobHash, &EditsInForce),
    folder: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    match write_path(job, path, folder, archive) {
        Err(failure @ ExportFailure::Vault(VaultError::ShuttingDown)) => Err(failure),
        Err(error @ (ExportFailure::Vault(_) | ExportFailure::File(_))) => {
            job.wait(job.app.store.sessions().get(&job.scope, session))?; // not found if it was erased meanwhile
            tracing::warn!(%session, %error, "path not exported; path.error.txt in its place");
            archive.add_text(&format!("{folder}path.error.txt"), FILE_ERROR)
        }
        written => written,
    }
}

fn write_path(
    job: &ExportJob,
    (path, edits): (BlobHash, &EditsInForce),
    folder: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let app = &job.app;
    let stored = job.wait(app.stored_indexes.open_paths(&app.vault, path))?;
    Ok(write_edited_csv(&stored, &edits.changes, archive.add_written(&format!("{folder}path.csv"))?)?)
}

/// Opens a stored file. If it is lost, a text with this name says so in its place. `None` then, and if it was deleted
/// meanwhile, as a video may be.
fn open(
    job: &ExportJob,
    session: SessionId,
    (stored, name): (BlobHash, &str),
    archive: &mut Archive,
) -> Result<Option<File>, ExportFailure> {
    let error = match job.wait(job.app.vault.open_blob(stored)) {
        Ok((file, _)) => return Ok(Some(file)),
        Err(error) => error,
    };
    let Some(loss) = error.loss() else { return Err(error.into()) };
    if job.wait(job.app.store.blobs().has(stored))? {
        tracing::warn!(%session, file = stored.file(), %loss, "stored file lost; a text in its place in the export");
        archive.add_text(&format!("{name}.error.txt"), FILE_ERROR)?;
    }
    Ok(None)
}

/// Adds the recording, if it was asked for and is kept, or the table of another program.
fn add_recording(
    job: &ExportJob,
    session: &SessionRecord,
    folder: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let Some(stored) = session.video.filter(|_| session.video_dropped_at_ms.is_none()) else { return Ok(()) };
    let is_table = session.tracker.is_some();
    if !is_table && !job.with_videos {
        return Ok(());
    }
    let name = format!("{folder}{}", if is_table { "table" } else { "video" });
    let Some(file) = open(job, session.id, (stored, &name), archive)? else { return Ok(()) };
    if is_table {
        std::io::copy(&mut &file, archive.add_written(&format!("{folder}table.csv"))?)?;
        return Ok(());
    }
    archive.add_file(&format!("{folder}video.{}", extension(session.filename.as_str())), file)
}

/// The extension of a sender's file name; `bin` if it is none that is safe in a path.
fn extension(filename: &str) -> &str {
    let after_dot = filename.rsplit_once('.').map_or("", |(_, extension)| extension);
    let is_plain = (1..=5).contains(&after_dot.len()) && after_dot.chars().all(|c| c.is_ascii_alphanumeric());
    if is_plain { after_dot } else { "bin" }
}
