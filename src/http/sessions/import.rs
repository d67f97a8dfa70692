//! Imports a path that another tracker measured; the table is the request's body.

use axum::body::Bytes;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use futures_util::{Stream, StreamExt};
use serde::Deserialize;
use utoipa::IntoParams;

use super::show::SessionResponse;
use crate::analysis::QuickAnalysisError;
use crate::domain::scope::Scope;
use crate::domain::session::ForeignPath;
use crate::domain::text::TrackerName;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{Params, content_length, too_large};
use crate::http::show::Created;
use crate::http::state::App;
use crate::intake::{BoxError, IntakeError, RecordingDescription, ResolvedRecording};
use crate::store::SessionRecord;

/// Name of a tracker if the request names none.
const UNNAMED_TRACKER: &str = "another tracker";

/// What the imported path belongs to.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ImportQuery {
    /// The trainee, by id or code.
    #[param(required)]
    trainee: Option<String>,
    /// The task, by id or code.
    #[param(required)]
    task: Option<String>,
    /// The box, by id or code. If the box's tools are known, the table may contain only these.
    #[serde(rename = "box")]
    #[param(rename = "box", required)]
    in_box: Option<String>,
    /// Name of the tracker, at most 40 characters; default: `another tracker`. Only values of the same
    /// tracker are compared.
    tracker: Option<String>,
    /// Name of the file, for people.
    filename: Option<String>,
    /// When it was recorded, RFC 3339; default: now.
    recorded_at: Option<String>,
}

/// Import the path of another tracker
///
/// The body is a CSV table in UTF-8 with the columns `frame,time_s,tool,x_mm,y_mm,z_mm`. The other columns of `GET
/// /sessions/{id}/trajectory` are optional. The table becomes a session without a video and is scored like any other.
/// Its features have error bars only if each row states its error: the covariance in `cov_xx_mm2`, `cov_xy_mm2`,
/// `cov_xz_mm2`, `cov_yy_mm2`, `cov_yz_mm2` and `cov_zz_mm2`, or `sigma_xy_mm` and `sigma_z_mm` alone. An invalid table
/// is refused; the problem names the line and the column. The same path of the same trainee and task is refused as
/// `duplicate-recording`, even if the bytes of the table differ.
#[utoipa::path(post, path = "/sessions/import", tag = "sessions", params(ImportQuery),
    request_body(content = String, content_type = "text/csv"), responses((status = CREATED, body = SessionResponse)))]
pub async fn import(
    State(app): State<App>,
    by: Staff,
    Params(of): Params<ImportQuery>,
    request: Request,
) -> HandlerResult<Created<SessionResponse>> {
    expect_csv(request.headers())?;
    let ImportQuery { trainee, task, in_box, tracker, filename, recorded_at } = of;
    let tracker: TrackerName = tracker.as_deref().unwrap_or(UNNAMED_TRACKER).parse()?;
    let filename = filename.or_else(|| Some("trajectory.csv".to_owned()));
    let about =
        RecordingDescription { trainee, task, in_box, filename, recorded_at, ..RecordingDescription::default() };
    let about = app.intake.resolve(&by.scope, about).await?;
    let most = app.intake.max_table_bytes();
    if content_length(request.headers()).is_some_and(|length| length > most) {
        return Err(too_large(most));
    }
    let bytes = request.into_body().into_data_stream().map(|bytes| bytes.map_err(Into::into));
    // In a separate task: a sender that closes right after its last byte must not cancel the import.
    let (importing, scope) = (app.clone(), by.scope);
    let taken = app.shutdown.spawn(async move { importing.import_table(&scope, about, tracker, bytes).await });
    let session = taken.await.map_err(|cause| ProblemResponse::internal("importing a table", cause))??;
    Ok(Created { location: format!("/api/v1/sessions/{}", session.id), made: SessionResponse::of(session, None) })
}

impl App {
    /// Stores a table as it arrives, has a child process check it, and makes a session of it.
    async fn import_table<B>(
        &self,
        scope: &Scope,
        about: ResolvedRecording,
        tracker: TrackerName,
        bytes: B,
    ) -> HandlerResult<SessionRecord>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let table = match self.intake.store_table(bytes).await {
            Err(IntakeError::Empty) => return Err(ProblemResponse::invalid("table", "is empty; send a table as CSV")),
            stored => stored?,
        };
        let limits = self.intake.table_limits(&about).await?;
        match self.quick_analysis.check_table(table.blob().hash, limits).await {
            Ok(Ok(hash)) => Ok(self.intake.import(scope, about, ForeignPath { tracker, hash }, table).await?),
            Ok(Err(why)) => Err(ProblemResponse::invalid("table", why)),
            Err(QuickAnalysisError::Crashed(why)) => Err(ProblemResponse::internal("checking a table", why)),
            Err(error) => Err(error.into()),
        }
    }
}

fn expect_csv(headers: &HeaderMap) -> HandlerResult<()> {
    let sent = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if sent.split(';').next().unwrap_or_default().trim().eq_ignore_ascii_case("text/csv") {
        return Ok(());
    }
    Err(Refusal::UnsupportedMediaType
        .with("Send the table itself as the body: `curl -H 'Content-Type: text/csv' --data-binary @track.csv`."))
}
