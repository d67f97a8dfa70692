//! A box's self-tests: each checks a recording of the printed checkerboard and a rod, and results in a traffic light.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::IntoResponse;
use serde::Serialize;
use utoipa::ToSchema;

use super::calibrations::parse_square_mm;
use super::form::{FormPictures, MultipartForm};
use crate::analysis::self_test::MAX_REACH_MM;
use crate::domain::calibration::BoardSize;
use crate::domain::job::{JobInput, SelfTestInput};
use crate::domain::scope::Scope;
use crate::domain::self_test::{SelfTestReport, TrafficLight};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::jobs::QueuedJobResponse;
use crate::http::read::{Json, Params, PathKey};
use crate::http::show::{PageResponse, Paging, Time};
use crate::http::state::App;
use crate::ids::{BoxId, CalibrationId, PaletteId, SelfTestId};
use crate::store;
use crate::time::start_of_day_ms;

/// A self-test of a box.
#[derive(Debug, Serialize, ToSchema)]
pub struct SelfTestResponse {
    id: SelfTestId,
    created_at: Time,
    /// Name of the person who tested it; `null` for trainees.
    who: Option<String>,
    /// The camera that was tested.
    calibration: CalibrationId,
    /// The colours that were tested.
    palette: PaletteId,
    #[serde(flatten)]
    report: SelfTestReport,
}

impl SelfTestResponse {
    fn new(found: store::SelfTestRecord, scope: &Scope) -> Self {
        Self {
            id: found.id,
            created_at: Time(found.created_at_ms),
            who: found.who.filter(|_| scope.is_staff()),
            calibration: found.calibration_id,
            palette: found.palette_id,
            report: found.report,
        }
    }
}

/// The traffic light of a box's last self-test today.
#[derive(Debug, Serialize, ToSchema)]
pub struct TodaysLight {
    id: SelfTestId,
    light: TrafficLight,
    created_at: Time,
}

impl App {
    /// The light of today's last self-test; the server's clock and time zone define today.
    pub(super) async fn light_of_today(&self, scope: &Scope, of: BoxId) -> HandlerResult<Option<TodaysLight>> {
        let since_ms = start_of_day_ms(self.clock.now_ms());
        let last = self.store.self_tests().light_since(scope, of, since_ms).await?;
        let shown = |store::SelfTestLight { id, light, created_at_ms }| TodaysLight {
            id,
            light,
            created_at: Time(created_at_ms),
        };
        Ok(last.map(shown))
    }
}

/// List a box's self-tests, newest first
#[utoipa::path(get, path = "/boxes/{id}/self-tests", tag = "boxes",
    params(("id" = String, Path, description = "id or code"), Paging),
    responses((status = OK, body = PageResponse<SelfTestResponse>)))]
pub async fn self_tests(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<SelfTestResponse>>> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let page = paging.request(format!("self-tests/{}", of.id), app.settings.page_items)?;
    let tests = app.store.self_tests().list(&by.scope, of.id, &page).await?;
    Ok(Json(PageResponse::of(tests, |test| SelfTestResponse::new(test, &by.scope))))
}

/// A recording of a self-test.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct SelfTestForm {
    /// The recording: the board alone, then a rod held on its corners, then the board alone.
    #[schema(value_type = String, format = Binary)]
    video: Vec<u8>,
    /// Inner corners as COLUMNSxROWS; required if the calibration was made with another board.
    board: Option<String>,
    /// Side of a square, mm; required with `board`.
    square_mm: Option<f64>,
    /// Distance from the end of the tape to the tip of the rod, mm. 0, the default, is for a rod that ends flat with
    /// its tape.
    reach_mm: Option<f64>,
}

/// Test the box with a recording
///
/// A job checks the recording and sets the box's traffic light.
#[utoipa::path(post, path = "/boxes/{id}/self-tests", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = SelfTestForm, content_type = "multipart/form-data"),
    responses((status = ACCEPTED, body = QueuedJobResponse)))]
pub async fn test(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    form: MultipartForm,
) -> HandlerResult<impl IntoResponse> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let calibration = app.store.calibrations().in_use(&by.scope, of.id).await?.ok_or_else(|| not_set_up("camera"))?;
    let palette = app.store.palettes().in_use(&by.scope, of.id).await?.ok_or_else(|| not_set_up("colours"))?;
    let SelfTestRequest { recording, board, reach_mm } = SelfTestRequest::read(form).await?;
    let file =
        recording.files.first().ok_or_else(|| ProblemResponse::invalid("video", "is missing; send the recording"))?;
    let (board, square_mm) = board.or_else(|| calibration.camera.board()).ok_or_else(|| {
        ProblemResponse::invalid(
            "board",
            "is missing, and the calibration does not name its board; give the inner corners, such as 9x6, and \
             square_mm",
        )
    })?;
    let input = SelfTestInput {
        of: of.id,
        person: by.scope.person(),
        calibration: calibration.id,
        palette: palette.id,
        board,
        square_mm,
        reach_mm,
        file: file.clone(),
    };
    let job = app.store.jobs().enqueue(&by.scope, JobInput::SelfTest(input)).await?;
    app.queue.work_arrived();
    Ok((StatusCode::ACCEPTED, Json(QueuedJobResponse { job: job.id })))
}

fn not_set_up(what: &str) -> ProblemResponse {
    Refusal::Conflict.with(format!("The box has no {what} yet, so it cannot be tested. Set it up first."))
}

/// The content of a [`SelfTestForm`].
struct SelfTestRequest {
    recording: FormPictures,
    board: Option<(BoardSize, f64)>,
    reach_mm: f64,
}

impl SelfTestRequest {
    async fn read(mut form: MultipartForm) -> HandlerResult<Self> {
        let (mut board, mut square_mm, mut reach_mm, mut recording) = (None, None, 0.0, FormPictures::default());
        while let Some(part) = form.next().await? {
            match part.name.as_str() {
                "board" => board = Some(part.text().await?.trim().parse::<BoardSize>()?),
                "square_mm" => square_mm = Some(parse_square_mm(&part.text().await?)?),
                "reach_mm" => reach_mm = parse_reach_mm(&part.text().await?)?,
                "video" => recording.add_video(part).await?,
                _ => return Err(part.unexpected("video, and board, square_mm or reach_mm")),
            }
        }
        let board = match (board, square_mm) {
            (Some(board), Some(square_mm)) => Some((board, square_mm)),
            (None, None) => None,
            (Some(_), None) => return Err(ProblemResponse::invalid("square_mm", "is missing; board needs it")),
            (None, Some(_)) => return Err(ProblemResponse::invalid("board", "is missing; square_mm needs it")),
        };
        Ok(Self { recording, board, reach_mm })
    }
}

fn parse_reach_mm(text: &str) -> HandlerResult<f64> {
    let reach: Option<f64> = text.trim().parse().ok();
    let possible = reach.filter(|mm| (0.0..=MAX_REACH_MM).contains(mm));
    possible.ok_or_else(|| {
        ProblemResponse::invalid("reach_mm", format!("expected a number of mm from 0 to {MAX_REACH_MM}"))
    })
}
