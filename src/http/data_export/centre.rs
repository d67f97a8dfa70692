//! The files of the whole centre in an export.

use std::io::Write;

use serde::Serialize;
use serde_json::Value;

use super::archive::{Archive, ExportFailure, unless_gone};
use super::{ExportJob, person};
use crate::domain::centre::LogoFormat;
use crate::domain::text::Key;
use crate::http::centre::CentreResponse;
use crate::http::cohorts::CohortResponse;
use crate::http::courses::CoursePlan;
use crate::http::groups::GroupResponse;
use crate::http::people::PersonResponse;
use crate::http::service::AuditChange;
use crate::http::tasks::{ErrorListResponse, ScoreFormulaResponse, StandardResponse, TaskResponse};
use crate::ids::{CohortId, TraineeId};
use crate::store::{Page, PageRequest, StoreResult};

/// Rows that are read at a time.
const ROUND: u32 = 200;

const README: &str = "\
This file holds what Trocar stores about a centre. It is for reading and for other programs. It is no backup: it cannot be
restored.

centre.json        name of the centre, and its logo beside it
accounts.json      accounts, without their passwords
groups.json        groups and their members
tasks.json         tasks, with the versions of their standards, error items and score formulas
courses.json       course plans
cohorts.json       cohorts and their members
boxes.json         boxes, with their latest camera and colours
audit.json         who changed what, and the network address of each
trainees/CODE/     one folder for each trainee; its files are listed below

Ratings, comments and error sheets of others on a session are left out unless the person who exports has rated it.

";

/// A task with the versions of its standard, of its error items and of its score formula.
#[derive(Serialize)]
struct TaskWithVersions {
    task: TaskResponse,
    standards: Vec<StandardResponse>,
    error_lists: Vec<ErrorListResponse>,
    score_formulas: Vec<ScoreFormulaResponse>,
}

/// A cohort with the ids of its members.
#[derive(Serialize)]
struct CohortWithMembers {
    cohort: CohortResponse,
    members: Vec<TraineeId>,
}

/// Adds all files.
pub(super) fn add(job: &ExportJob, archive: &mut Archive) -> Result<(), ExportFailure> {
    archive.add_text("README.txt", &format!("{README}{}", person::FILES))?;
    let (store, scope) = (&job.app.store, &job.scope);
    add_name_and_logo(job, archive)?;
    let mut accounts = Vec::new();
    each(
        job,
        async |page| store.people().list(scope, page).await,
        |_, person| {
            accounts.push(PersonResponse::from(person));
            Ok(())
        },
    )?;
    archive.add_json("accounts.json", &accounts)?;
    let groups = job.wait(store.groups().list(scope))?.into_iter().map(GroupResponse::from);
    archive.add_json("groups.json", &groups.collect::<Vec<_>>())?;
    let mut tasks = Vec::new();
    each(
        job,
        async |page| store.tasks().list(scope, page).await,
        |_, task| {
            let found = unless_gone(job.wait(store.standards().list(scope, task.id)))?;
            let Some(standards) = found else { return Ok(()) };
            let standards = standards.into_iter().map(|standard| StandardResponse::new(standard, scope)).collect();
            let lists = job.wait(store.error_lists().list(scope, task.id))?;
            let error_lists = lists.into_iter().map(|list| ErrorListResponse::new(list, scope)).collect();
            let formulas = job.wait(store.score_formulas().list(scope, task.id))?;
            let score_formulas =
                formulas.into_iter().map(|formula| ScoreFormulaResponse::new(formula, scope)).collect();
            let task = TaskResponse::new(task, scope);
            tasks.push(TaskWithVersions { task, standards, error_lists, score_formulas });
            Ok(())
        },
    )?;
    archive.add_json("tasks.json", &tasks)?;
    let mut courses = Vec::new();
    each(
        job,
        async |page| store.courses().list(scope, page).await,
        |_, course| {
            courses.push(CoursePlan::new(course, scope));
            Ok(())
        },
    )?;
    archive.add_json("courses.json", &courses)?;
    let mut cohorts = Vec::new();
    each(
        job,
        async |page| store.cohorts().list(scope, page).await,
        |job, cohort| {
            let found = unless_gone(cohort_members(job, cohort.id))?;
            cohorts.extend(found.map(|members| CohortWithMembers { cohort: cohort.into(), members }));
            Ok(())
        },
    )?;
    archive.add_json("cohorts.json", &cohorts)?;
    let mut boxes = Vec::new();
    each(
        job,
        async |page| store.boxes().list(scope, page).await,
        |_, found| {
            boxes.extend(unless_gone(job.wait(job.app.box_response(scope, found)))?);
            Ok(())
        },
    )?;
    archive.add_json("boxes.json", &boxes)?;
    add_audit(job, archive)?;
    each(
        job,
        async |page| store.trainees().list(scope, page).await,
        |job, trainee| {
            unless_gone(person::add(job, &trainee, &format!("trainees/{}/", trainee.code), archive)).map(drop)
        },
    )
}

fn add_name_and_logo(job: &ExportJob, archive: &mut Archive) -> Result<(), ExportFailure> {
    archive.add_json("centre.json", &CentreResponse::from(job.wait(job.app.store.centre().get())?))?;
    let Some(logo) = job.wait(job.app.store.centre().logo())? else { return Ok(()) };
    let name = match logo.format {
        LogoFormat::Png => "logo.png",
        LogoFormat::Jpeg => "logo.jpg",
    };
    archive.add_file(name, logo.bytes.as_slice())
}

fn cohort_members(job: &ExportJob, cohort: CohortId) -> Result<Vec<TraineeId>, ExportFailure> {
    let (key, mut members) = (Key::from(&cohort), Vec::new());
    each(
        job,
        async |page| job.app.store.cohorts().members(&job.scope, &key, page).await,
        |_, member| {
            members.push(member);
            Ok(())
        },
    )?;
    Ok(members)
}

/// Adds the audit trail, entry by entry, since it can be long.
fn add_audit(job: &ExportJob, archive: &mut Archive) -> Result<(), ExportFailure> {
    let (store, scope) = (&job.app.store, &job.scope);
    let out = archive.add_written("audit.json")?;
    let mut separator = "[\n";
    each(
        job,
        async |page| store.audit().list(scope, page).await,
        |_, entry| {
            let entry: Value = serde_json::to_value(AuditChange::from(entry)).map_err(std::io::Error::other)?;
            write!(out, "{separator}{entry}")?;
            separator = ",\n";
            Ok(())
        },
    )?;
    out.write_all(if separator == "[\n" { b"[]\n" } else { b"\n]\n" })?;
    Ok(())
}

/// Calls `add` with each row of a list, which is read page by page.
fn each<T>(
    job: &ExportJob,
    read: impl AsyncFn(&PageRequest) -> StoreResult<Page<T>>,
    mut add: impl FnMut(&ExportJob, T) -> Result<(), ExportFailure>,
) -> Result<(), ExportFailure> {
    let mut after = None;
    loop {
        let page = job.wait(read(&PageRequest::new(ROUND, after)))?;
        page.items.into_iter().try_for_each(|item| add(job, item))?;
        after = page.next;
        if after.is_none() {
            return Ok(());
        }
    }
}
