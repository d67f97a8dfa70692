//! Recordings that wait for a name: send, list, look at, assign, discard.

mod assign;
mod files;
mod proposals;
mod send;

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

pub use assign::*;
pub use files::*;
use proposals::Proposer;
pub use send::*;

use super::auth::signed_in::Staff;
use super::error::{HandlerResult, ProblemResponse};
use super::read::{Json, Params, PathKey};
use super::show::{NamedReference, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::text::{Code, Key, Name};
use crate::domain::waiting_recording::RecordingSource;
use crate::ids::WaitingRecordingId;
use crate::store::{self, WaitingRecordingFilter, WaitingRecordingRecord};
use crate::time::{Day, from_rfc3339};

/// A recording that waits for a name.
#[derive(Debug, Serialize, ToSchema)]
pub struct WaitingRecordingResponse {
    id: WaitingRecordingId,
    /// The file's name as it was sent: plain text, never markup.
    filename: String,
    /// Its folder below the watched folder, with slashes; `null` outside one.
    folder: Option<String>,
    /// How it came.
    source: RecordingSource,
    /// The box; `null` if it is not known.
    #[serde(rename = "box")]
    in_box: Option<NamedReference>,
    /// The task; `null` if it is not known.
    task: Option<NamedReference>,
    /// Whose it is by the list in the watched folder; `null` if no list says it.
    trainee: Option<NamedReference>,
    /// Why it was not assigned as that list says; `null`: no list, or nothing against it.
    remark: Option<String>,
    /// What the names of the file and its folders speak of. A person has to confirm it.
    proposal: RecordingProposal,
    /// When it was recorded, as its sender says; `null`: not stated.
    recorded_at: Option<Time>,
    arrived_at: Time,
    /// When it is deleted unless it gets a name.
    deleted_at: Time,
    /// Name of the person who sent it; `null`: a box or the watched folder, or the account was deleted.
    sender: Option<String>,
    bytes: u64,
    media_type: String,
    /// Why no picture of it can be made; `null`: there is one, or it is being made.
    unreadable: Option<String>,
}

/// What the names of a file and its folders speak of.
#[derive(Debug, Default, Serialize, ToSchema)]
pub struct RecordingProposal {
    /// The trainee, among those in the scope of the caller; `null`: none, or several.
    pub(super) trainee: Option<NamedReference>,
    /// The task; `null`: none, or several.
    pub(super) task: Option<NamedReference>,
    /// The box; `null`: none, or several.
    #[serde(rename = "box")]
    pub(super) in_box: Option<NamedReference>,
}

fn reference<Id: ToString>(id: Option<Id>, name: Option<Name>, code: Option<Code>) -> Option<NamedReference> {
    Some(NamedReference { id: id?.to_string(), name: name?.to_string(), code: code?.to_string() })
}

impl WaitingRecordingResponse {
    /// The answer for a recording that is deleted at this time, with this proposal.
    pub(in crate::http) fn new(of: WaitingRecordingRecord, deleted_at_ms: i64, proposal: RecordingProposal) -> Self {
        Self {
            id: of.id,
            filename: of.filename.to_string(),
            folder: of.folder,
            source: of.source,
            in_box: reference(of.box_id, of.box_name, of.box_code),
            task: reference(of.task_id, of.task_name, of.task_code),
            trainee: reference(of.trainee_id, of.trainee_name, of.trainee_code),
            remark: of.remark,
            proposal,
            recorded_at: of.recorded_at_ms.map(Time),
            arrived_at: Time(of.arrived_at_ms),
            deleted_at: Time(deleted_at_ms),
            sender: of.sender.map(String::from),
            bytes: of.bytes,
            media_type: of.media_type,
            unreadable: of.unreadable,
        }
    }
}

/// Selects recordings that wait for a name.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct WaitingRecordingsQuery {
    /// Only of this box, by id or code.
    #[serde(rename = "box")]
    #[param(rename = "box", value_type = Option<String>)]
    in_box: Option<Key>,
    /// Only made on this day in UTC, such as `2026-11-30`: the day of recording if it is known, else of arrival.
    day: Option<String>,
    /// Only made at this moment or later (RFC 3339).
    #[param(format = DateTime)]
    from: Option<String>,
    /// Only made before this moment (RFC 3339).
    #[param(format = DateTime)]
    before: Option<String>,
    /// Only those that came like this.
    #[param(inline)]
    source: Option<RecordingSource>,
    /// Most items on the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the previous page.
    cursor: Option<String>,
}

impl WaitingRecordingsQuery {
    fn filter(&self) -> HandlerResult<WaitingRecordingFilter> {
        let (mut from_ms, mut before_ms) =
            (moment("from", self.from.as_deref())?, moment("before", self.before.as_deref())?);
        if let Some(text) = &self.day {
            let day: Day =
                text.parse().map_err(|_| ProblemResponse::invalid("day", "expected a day such as 2026-11-30"))?;
            let (start_ms, end_ms) = (day.start_ms(), day.plus_days(1).start_ms());
            from_ms = Some(from_ms.map_or(start_ms, |from| from.max(start_ms)));
            before_ms = Some(before_ms.map_or(end_ms, |before| before.min(end_ms)));
        }
        Ok(WaitingRecordingFilter { in_box: self.in_box.clone(), source: self.source, from_ms, before_ms })
    }
}

fn moment(field: &'static str, text: Option<&str>) -> HandlerResult<Option<i64>> {
    let unreadable = || ProblemResponse::invalid(field, "expected an RFC 3339 time such as 2026-11-21T20:14:00Z");
    text.map(|text| from_rfc3339(text).ok_or_else(unreadable)).transpose()
}

/// List the recordings that wait for a name, the last made first
///
/// All staff see recordings whose person is not known. One that the list in the watched folder gives to a trainee is
/// seen by those who see the trainee. A recording without a name is not tracked, and it is deleted at `deleted_at`.
#[utoipa::path(get, path = "/waiting-recordings", tag = "waiting recordings", params(WaitingRecordingsQuery),
    responses((status = OK, body = PageResponse<WaitingRecordingResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Staff,
    Params(which): Params<WaitingRecordingsQuery>,
) -> HandlerResult<Json<PageResponse<WaitingRecordingResponse>>> {
    let filter = which.filter()?;
    let page = Paging::new(which.limit, which.cursor).request("waiting-recordings", app.settings.page_items)?;
    let page = app.store.waiting_recordings().list(&by.scope, &filter, &page).await?;
    let proposer = match page.items.is_empty() {
        true => Proposer::default(),
        false => Proposer::new(&app, &by.scope).await?,
    };
    Ok(Json(PageResponse::of(page, |found| app.shown_waiting(found, &proposer))))
}

/// How many recordings wait for a name.
#[derive(Debug, Serialize, ToSchema)]
pub struct WaitingRecordingCount {
    /// Recordings that the caller sees.
    count: i64,
    /// Days after its arrival when a recording without a name is deleted.
    kept_days: u32,
}

/// Count the recordings that wait for a name
#[utoipa::path(get, path = "/waiting-recording-count", tag = "waiting recordings",
    responses((status = OK, body = WaitingRecordingCount)))]
pub async fn count(State(app): State<App>, by: Staff) -> HandlerResult<Json<WaitingRecordingCount>> {
    let count = app.store.waiting_recordings().count(&by.scope).await?;
    Ok(Json(WaitingRecordingCount { count, kept_days: app.retention.unnamed_days }))
}

/// Read a recording that waits for a name
#[utoipa::path(get, path = "/waiting-recordings/{id}", tag = "waiting recordings",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = WaitingRecordingResponse)))]
pub async fn get(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<Json<WaitingRecordingResponse>> {
    let found = app.store.waiting_recordings().get(&by.scope, at.id()?).await?;
    let proposer = Proposer::new(&app, &by.scope).await?;
    Ok(Json(app.shown_waiting(found, &proposer)))
}

/// Discard a recording that waits for a name
///
/// It is deleted, also from a backup that is restored later. This cannot be undone.
#[utoipa::path(delete, path = "/waiting-recordings/{id}", tag = "waiting recordings",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn discard(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.waiting_recordings().discard(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

impl App {
    fn shown_waiting(&self, found: store::WaitingRecordingRecord, proposer: &Proposer) -> WaitingRecordingResponse {
        let deleted_at_ms = self.retention.unnamed_until_ms(found.arrived_at_ms);
        let proposal = proposer.propose(&found);
        WaitingRecordingResponse::new(found, deleted_at_ms, proposal)
    }
}
