//! Rows that another tracker measured: the table is the body.

use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use http_body_util::{BodyExt, Limited};
use serde::Deserialize;
use utoipa::IntoParams;

use super::show::Session;
use crate::domain::text::TrackerName;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{Answer, Problem, Refusal};
use crate::http::read::{Params, content_length, too_large, unreadable};
use crate::http::show::Created;
use crate::http::state::App;
use crate::intake::About;

/// What is said of a tracker that has no name.
const NAMELESS: &str = "another tracker";

/// What the rows are of.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct RowsOf {
    /// Whose, by id or code.
    #[param(required)]
    trainee: Option<String>,
    /// Which task, by id or code.
    #[param(required)]
    task: Option<String>,
    /// Which box, by id or code. Where its tools are known, the rows must be of these.
    #[serde(rename = "box")]
    #[param(rename = "box", required)]
    in_box: Option<String>,
    /// What measured them, at most 40 characters; without it, `another tracker`. Only values of one tracker are compared.
    tracker: Option<String>,
    /// The file's name, for people.
    filename: Option<String>,
    /// When it was recorded, RFC 3339; without it, now.
    recorded_at: Option<String>,
}

/// Import the path of another tracker
///
/// A CSV table in UTF-8 with the columns `frame,time_s,tool,x_mm,y_mm,z_mm`; those of `GET /sessions/{id}/trajectory` beside them
/// are optional. It becomes a session without a video, scored as any other; its values have error bars only where the columns
/// `sigma_xy_mm` and `sigma_z_mm` say how far each row may be off. A table that no tracker writes is refused with the line and the
/// column.
#[utoipa::path(post, path = "/sessions/import", tag = "sessions", params(RowsOf),
    request_body(content = String, content_type = "text/csv"), responses((status = CREATED, body = Session)))]
pub async fn import(
    State(app): State<App>,
    by: Staff,
    Params(of): Params<RowsOf>,
    request: Request,
) -> Answer<Created<Session>> {
    expect_csv(request.headers())?;
    let RowsOf { trainee, task, in_box, tracker, filename, recorded_at } = of;
    let tracker: TrackerName = tracker.as_deref().unwrap_or(NAMELESS).parse()?;
    let filename = filename.or_else(|| Some("trajectory.csv".to_owned()));
    let about = app.intake.recognise(&by.scope, About { trainee, task, in_box, filename, recorded_at }).await?;
    let most = app.intake.max_table_bytes();
    if content_length(request.headers()).is_some_and(|length| length > most as u64) {
        return Err(too_large(most as u64));
    }
    let room = app.intake.room_for_table()?;
    let body = Limited::new(request.into_body(), most).collect().await;
    let table = body.map_err(|cause| unreadable(&*cause, most as u64))?.to_bytes();
    let (intake, scope) = (app.intake.clone(), by.scope);
    // On a task of its own: a sender that closes right after its last byte must not undo the import.
    let taken = app.shutdown.spawn(async move { intake.import(&scope, about, tracker, (table, room)).await });
    let session = taken.await.map_err(|cause| Problem::internal("taking a table", cause))??;
    Ok(Created { location: format!("/api/v1/sessions/{}", session.id), made: Session::of(session, None) })
}

fn expect_csv(headers: &HeaderMap) -> Answer<()> {
    let sent = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if sent.split(';').next().unwrap_or_default().trim().eq_ignore_ascii_case("text/csv") {
        return Ok(());
    }
    Err(Refusal::UnsupportedMediaType
        .with("Send the table itself: `curl -H 'Content-Type: text/csv' --data-binary @track.csv`."))
}
