//! The files of one person in an export.

use serde::Serialize;

use super::ExportJob;
use super::archive::{Archive, ExportFailure};
use crate::domain::edit::EditsInForce;
use crate::domain::text::{Key, Name};
use crate::http::account::SignInEntry;
use crate::http::error::ProblemResponse;
use crate::http::people::PersonResponse;
use crate::http::service::AuditChange;
use crate::http::sessions::{EditsResponse, SessionResponse, write_edited_csv};
use crate::http::trainees::TraineeResponse;
use crate::store::{PageRequest, SessionFilter, SessionRecord, SessionResult, StoreError, TraineeRecord};
use crate::time::Day;

/// Sessions and audit entries that are read at a time.
const ROUND: u32 = 50;

/// Says what the files of a person's export are.
pub(super) const README: &str = "\
This file holds what Trocar stores about one person.

profile.json       name, level, groups; account and sign-ins, without the password
audit.json         who changed this person's data, and what this person changed
sessions/…/        one folder for each session:
  session.json     recording, quality, features with their error bars, versions
  ratings.json     ratings on forms
  comments.json    comments
  edits.json       trims, corrections and answers of the staff, with reasons
  path.csv         the path of the tools: millimetres and seconds
  preview.jpg      one frame
  table.csv        the table of another program, if the session was imported
  video.…          the recording, if it was asked for and is still kept
";

/// Name, groups and account.
#[derive(Serialize)]
struct PersonProfile {
    trainee: TraineeResponse,
    groups: Vec<Name>,
    /// `null` without an account.
    account: Option<PersonResponse>,
    /// Empty unless the trainee or an administrator exports.
    sign_ins: Vec<SignInEntry>,
}

/// Adds the files of a trainee below the folder `below`, which is empty or ends with a slash.
pub(super) fn add(
    job: &ExportJob,
    trainee: &TraineeRecord,
    below: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    archive.add_json(&format!("{below}profile.json"), &job.wait(profile(job, trainee))?)?;
    archive.add_json(&format!("{below}audit.json"), &job.wait(audit(job, trainee))?)?;
    let filter = SessionFilter { trainee: Some(Key::from(&trainee.id)), ..SessionFilter::default() };
    let mut after = None;
    loop {
        let store = &job.app.store;
        let page = job.wait(store.sessions().list(&job.scope, &filter, &PageRequest::new(ROUND, after)))?;
        for session in page.items {
            let id = session.id;
            let folder = format!("{below}sessions/{}-{id}/", Day::of(session.recorded_at_ms));
            match add_session(job, (trainee, session), &folder, archive) {
                // Erased after the page was read.
                Err(ExportFailure::Store(StoreError::NotFound { .. })) => {}
                added => added?,
            }
        }
        after = page.next;
        if after.is_none() {
            return Ok(());
        }
    }
}

async fn profile(job: &ExportJob, trainee: &TraineeRecord) -> Result<PersonProfile, ExportFailure> {
    let (app, scope) = (&job.app, &job.scope);
    let account = app.store.people().of_trainee(scope, trainee.id).await?;
    let sign_ins = match &account {
        Some(account) if scope.is_administrator() || scope.person() == Some(account.id) => {
            app.store.cookies().of_person(account.id, None, app.sign_in_lifetime()).await?
        }
        _ => Vec::new(),
    };
    Ok(PersonProfile {
        trainee: TraineeResponse::new(trainee.clone(), scope),
        groups: app.store.trainees().groups(scope, trainee.id).await?,
        account: account.map(PersonResponse::from),
        sign_ins: sign_ins.into_iter().map(SignInEntry::from).collect(),
    })
}

async fn audit(job: &ExportJob, trainee: &TraineeRecord) -> Result<Vec<AuditChange>, ExportFailure> {
    let entries = job.app.store.audit().about(&job.scope, trainee.id).await?;
    Ok(entries.into_iter().map(AuditChange::from).collect())
}

fn add_session(
    job: &ExportJob,
    (trainee, session): (&TraineeRecord, SessionRecord),
    folder: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let (app, id) = (&job.app, session.id);
    let scope = &job.scope_for(trainee);
    let scored = job.wait(app.store.sessions().result_with_edits(scope, id))?;
    let edits = job.wait(app.store.edits().of_session(scope, id))?;
    let shown = SessionResponse::of(session.clone(), scored.as_ref().map(|(result, _)| result.clone()));
    archive.add_json(&format!("{folder}session.json"), &shown)?;
    archive.add_json(&format!("{folder}ratings.json"), &job.wait(app.ratings_of(scope, id))?)?;
    archive.add_json(&format!("{folder}comments.json"), &job.wait(app.comments_of(scope, id))?)?;
    archive.add_json(&format!("{folder}edits.json"), &EditsResponse::from(edits))?;
    if let Some((result, in_force)) = scored {
        add_result(job, (&result, &in_force), folder, archive)?;
    }
    add_recording(job, &session, folder, archive)
}

/// Adds the path and the preview.
fn add_result(
    job: &ExportJob,
    (result, edits): (&SessionResult, &EditsInForce),
    folder: &str,
    archive: &mut Archive,
) -> Result<(), ExportFailure> {
    let app = &job.app;
    let stored =
        job.wait(app.stored_indexes.open_paths(&app.vault, result.trajectory)).map_err(ProblemResponse::from)?;
    write_edited_csv(&stored, &edits.changes, archive.add_written(&format!("{folder}path.csv"))?)?;
    if let Some(preview) = result.preview {
        let (file, _) = job.wait(app.vault.open_blob(preview))?;
        archive.add_file(&format!("{folder}preview.jpg"), file)?;
    }
    Ok(())
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
    let (file, _) = job.wait(job.app.vault.open_blob(stored))?;
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
