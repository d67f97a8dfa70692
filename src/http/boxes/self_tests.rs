//! A box's self-tests: each checks a recording of the printed checkerboard and a rod, and results in a traffic light.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::IntoResponse;
use serde::Serialize;
use utoipa::ToSchema;

use super::calibrations::square;
use super::form::{Form, Pictures};
use crate::analysis::self_test::MOST_REACH_MM;
use crate::domain::calibration::BoardSize;
use crate::domain::job::{JobInput, SelfTestInput};
use crate::domain::scope::Scope;
use crate::domain::self_test::{Light, SelfTestReport};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{Answer, Problem, Refusal};
use crate::http::jobs::Queued;
use crate::http::read::{At, Json, Params};
use crate::http::show::{Page, Paging, Time};
use crate::http::state::App;
use crate::ids::{BoxId, CalibrationId, PaletteId, SelfTestId};
use crate::store;
use crate::time::day_began_ms;

/// A self-test of a box.
#[derive(Debug, Serialize, ToSchema)]
pub struct SelfTest {
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

impl SelfTest {
    fn new(found: store::SelfTest, scope: &Scope) -> Self {
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
    light: Light,
    created_at: Time,
}

impl App {
    /// The light of today's last self-test; the server's clock and time zone define today.
    pub(super) async fn light_of_today(&self, scope: &Scope, of: BoxId) -> Answer<Option<TodaysLight>> {
        let since_ms = day_began_ms(self.clock.now_ms());
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
    params(("id" = String, Path, description = "id or code"), Paging), responses((status = OK, body = Page<SelfTest>)))]
pub async fn self_tests(
    State(app): State<App>,
    by: Member,
    At(key): At,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<SelfTest>>> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let page = paging.request(app.settings.page_items)?;
    let tests = app.store.self_tests().list(&by.scope, of.id, &page).await?;
    Ok(Json(Page::of(tests, |test| SelfTest::new(test, &by.scope))))
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
    request_body(content = SelfTestForm, content_type = "multipart/form-data"), responses((status = ACCEPTED, body = Queued)))]
pub async fn test(State(app): State<App>, by: Staff, At(key): At, form: Form) -> Answer<impl IntoResponse> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let calibration = app.store.calibrations().latest(&by.scope, of.id).await?.ok_or_else(|| unready("camera"))?;
    let palette = app.store.palettes().latest(&by.scope, of.id).await?.ok_or_else(|| unready("colours"))?;
    let Asked { recording, board, reach_mm } = Asked::read(form).await?;
    let file = recording.files.first().ok_or_else(|| Problem::invalid("video", "is missing; send the recording"))?;
    let (board, square_mm) = board.or_else(|| calibration.camera.board()).ok_or_else(|| {
        Problem::invalid(
            "board",
            "is missing, and the calibration does not name its board; give the inner corners, such as 9x6, and square_mm",
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
    Ok((StatusCode::ACCEPTED, Json(Queued { job: job.id })))
}

fn unready(what: &str) -> Problem {
    Refusal::Conflict.with(format!("The box has no {what} yet, so it cannot be tested. Set it up first."))
}

/// The content of a [`SelfTestForm`].
struct Asked {
    recording: Pictures,
    board: Option<(BoardSize, f64)>,
    reach_mm: f64,
}

impl Asked {
    async fn read(mut form: Form) -> Answer<Self> {
        let (mut board, mut square_mm, mut reach_mm, mut recording) = (None, None, 0.0, Pictures::default());
        while let Some(part) = form.next().await? {
            match part.name.as_str() {
                "board" => board = Some(part.text().await?.trim().parse::<BoardSize>()?),
                "square_mm" => square_mm = Some(square(&part.text().await?)?),
                "reach_mm" => reach_mm = reach(&part.text().await?)?,
                "video" => recording.add_video(part).await?,
                _ => return Err(part.unexpected("video, and board, square_mm or reach_mm")),
            }
        }
        let board = match (board, square_mm) {
            (Some(board), Some(square_mm)) => Some((board, square_mm)),
            (None, None) => None,
            (Some(_), None) => return Err(Problem::invalid("square_mm", "is missing; board needs it")),
            (None, Some(_)) => return Err(Problem::invalid("board", "is missing; square_mm needs it")),
        };
        Ok(Self { recording, board, reach_mm })
    }
}

fn reach(text: &str) -> Answer<f64> {
    let reach: Option<f64> = text.trim().parse().ok();
    let possible = reach.filter(|mm| (0.0..=MOST_REACH_MM).contains(mm));
    possible.ok_or_else(|| Problem::invalid("reach_mm", format!("expected a number of mm from 0 to {MOST_REACH_MM}")))
}
