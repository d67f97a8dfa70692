//! Every route, in one list.

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::get;
use tower_http::catch_panic::CatchPanicLayer;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::auth::{origin, sign_in};
use super::base_path::complete_addresses;
use super::compress::compress;
use super::pace::{Pace, keep_pace};
use super::state::App;
use super::{account, attention, centre, first_steps, service};
use super::{
    boxes, certificates, cohorts, consent_texts, courses, dashboard, data_export, docs, events, exams, features, feed,
    feedback, groups, health, jobs, observe, password_links, people, protect, push, replaced_routes, rescorings,
    scheme, sessions, single_sign_on, tasks, tokens,
};
use super::{error, openapi, trainees, uploads, waiting_recordings};

/// The API under `/api/v1`.
fn api_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .merge(account_routes())
        .merge(group_routes())
        .merge(box_routes())
        .merge(trainee_routes())
        .merge(task_routes())
        .merge(rescoring_routes())
        .merge(cohort_routes())
        .merge(course_routes())
        .merge(session_routes())
        .merge(waiting_recording_routes())
        .merge(certificate_routes())
        .merge(exam_routes())
        .merge(upload_routes())
        .merge(operation_routes())
        .merge(replaced_routes::replaced_routes())
}

/// Sign-in, accounts and tokens.
fn account_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(sign_in::sign_in))
        .routes(routes!(sign_in::sign_out))
        .routes(routes!(single_sign_on::describe))
        .routes(routes!(single_sign_on::start))
        .routes(routes!(single_sign_on::finish))
        .routes(routes!(single_sign_on::sign_out))
        .routes(routes!(people::me))
        .routes(routes!(sign_in::change_password))
        .routes(routes!(account::sign_ins))
        .routes(routes!(account::end_sign_in))
        .routes(routes!(account::tokens))
        .routes(routes!(boxes::pin, boxes::set_pin, boxes::remove_pin))
        .routes(routes!(account::delete_token))
        .routes(routes!(people::list, people::create))
        .routes(routes!(people::change, people::delete))
        .routes(routes!(password_links::list, password_links::create))
        .routes(routes!(password_links::open))
        .routes(routes!(password_links::use_link))
        .routes(routes!(password_links::withdraw))
        .routes(routes!(single_sign_on::own, single_sign_on::start_link))
        .routes(routes!(single_sign_on::remove_own))
        .routes(routes!(single_sign_on::list))
        .routes(routes!(single_sign_on::remove))
        .routes(routes!(tokens::list, tokens::create))
        .routes(routes!(tokens::delete))
}

/// Groups and their progress.
fn group_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(groups::list, groups::create))
        .routes(routes!(groups::get, groups::delete))
        .routes(routes!(groups::set_members))
        .routes(routes!(groups::progress))
}

/// Boxes, and the recordings that they send live.
fn box_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(boxes::list, boxes::create))
        .routes(routes!(boxes::get, boxes::change, boxes::delete))
        .routes(routes!(boxes::merges, boxes::merge))
        .routes(routes!(boxes::preview_merge))
        .routes(routes!(boxes::separate))
        .routes(routes!(boxes::camera, boxes::put_camera))
        .routes(routes!(boxes::calibrations, boxes::calibrate))
        .routes(routes!(boxes::date_calibration))
        .routes(routes!(boxes::check_photo))
        .routes(routes!(boxes::palettes, boxes::learn_palette))
        .routes(routes!(boxes::date_palette))
        .routes(routes!(boxes::preview_palette))
        .routes(routes!(boxes::resize_tools))
        .routes(routes!(boxes::advise))
        .routes(routes!(boxes::self_tests, boxes::test))
        .routes(routes!(boxes::agents))
        .routes(routes!(boxes::agent))
        .routes(routes!(boxes::agent_connection))
        .routes(routes!(boxes::start_agent))
        .routes(routes!(boxes::stop_agent))
        .routes(routes!(boxes::check_in, boxes::check_out))
        .routes(routes!(feed::feed))
        .routes(routes!(push::push))
}

/// Trainees and their progress.
fn trainee_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(trainees::list, trainees::create))
        .routes(routes!(trainees::get, trainees::change, trainees::erase))
        .routes(routes!(trainees::progress))
        .routes(routes!(trainees::enrol))
        .routes(routes!(trainees::trainee_accounts))
        .routes(routes!(trainees::invite))
        .routes(routes!(trainees::xapi))
        .routes(routes!(trainees::erasure_extent))
        .routes(routes!(trainees::pending_erasures))
        .routes(routes!(trainees::restore))
        .routes(routes!(trainees::merges, trainees::merge))
        .routes(routes!(trainees::preview_merge))
        .routes(routes!(trainees::separate))
        .routes(routes!(data_export::trainee))
        .merge(consent_routes())
}

/// Consent to recordings, how long they are kept, and who looked at them.
fn consent_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(consent_texts::list, consent_texts::publish))
        .routes(routes!(consent_texts::effect))
        .routes(routes!(consent_texts::change))
        .routes(routes!(trainees::consent))
        .routes(routes!(trainees::record_consent))
        .routes(routes!(trainees::retention, trainees::set_retention))
        .routes(routes!(trainees::preview_retention))
        .routes(routes!(trainees::access_entries))
}

/// Tasks with their features, standards, error items and models.
fn task_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(tasks::list, tasks::create))
        .routes(routes!(tasks::get, tasks::change, tasks::delete))
        .routes(routes!(tasks::features))
        .routes(routes!(features::list))
        .routes(routes!(tasks::standards, tasks::set_standard))
        .routes(routes!(tasks::propose_standard))
        .routes(routes!(tasks::presets))
        .routes(routes!(tasks::distribution))
        .routes(routes!(tasks::agreement))
        .routes(routes!(tasks::correlations))
        .routes(routes!(tasks::error_examples))
        .routes(routes!(tasks::error_lists, tasks::set_error_list))
        .routes(routes!(tasks::score_formulas, tasks::set_score_formula))
        .routes(routes!(tasks::preview_score_formula))
        .routes(routes!(tasks::error_agreement))
        .routes(routes!(tasks::models, tasks::train_model))
        .routes(routes!(tasks::model))
}

/// Orders to score the sessions of a task again.
fn rescoring_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(rescorings::create))
        .routes(routes!(rescorings::list))
        .routes(routes!(rescorings::get))
        .routes(routes!(rescorings::cancel))
        .routes(routes!(rescorings::sessions))
        .routes(routes!(rescorings::trainees))
}

/// Groups of people to compare with.
fn cohort_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(cohorts::list, cohorts::create))
        .routes(routes!(cohorts::get, cohorts::replace, cohorts::delete))
        .routes(routes!(cohorts::members))
}

/// Courses, and who follows them.
fn course_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(courses::list, courses::create))
        .routes(routes!(courses::get, courses::replace, courses::delete))
        .routes(routes!(courses::of_group, courses::follow, courses::unfollow))
        .routes(routes!(courses::of_trainee))
}

/// Sessions: recordings, results, ratings, comments, error sheets and edits.
fn session_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(sessions::list, sessions::send))
        .routes(routes!(sessions::count))
        .routes(routes!(sessions::import))
        .routes(routes!(sessions::get, sessions::erase))
        .routes(routes!(sessions::results))
        .routes(routes!(sessions::retry))
        .routes(routes!(sessions::end))
        .routes(routes!(sessions::supervise))
        .routes(routes!(sessions::live))
        .routes(routes!(sessions::trajectory))
        .routes(routes!(sessions::features))
        .routes(routes!(sessions::xapi))
        .routes(routes!(sessions::video))
        .routes(routes!(sessions::preview))
        .routes(routes!(sessions::diagnostics))
        .routes(routes!(sessions::evidence))
        .routes(routes!(sessions::session_advice))
        .routes(routes!(sessions::rating_forms))
        .routes(routes!(sessions::ratings, sessions::rate))
        .routes(routes!(sessions::comments, sessions::comment))
        .routes(routes!(sessions::withdraw_comment))
        .routes(routes!(feedback::feedback))
        .routes(routes!(feedback::mark_seen))
        .routes(routes!(feedback::open_session))
        .routes(routes!(sessions::error_sheets, sessions::begin_error_sheet))
        .routes(routes!(sessions::set_error_values, sessions::discard_error_sheet))
        .routes(routes!(sessions::finish_error_sheet))
        .routes(routes!(sessions::mark_error))
        .routes(routes!(sessions::unmark_error))
        .routes(routes!(sessions::edits, sessions::edit))
        .routes(routes!(sessions::undo_edit))
        .routes(routes!(sessions::moves, sessions::move_session))
        .routes(routes!(sessions::cuts, sessions::cut))
        .routes(routes!(sessions::join))
}

/// Recordings that wait for a name.
fn waiting_recording_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(waiting_recordings::list, waiting_recordings::send))
        .routes(routes!(waiting_recordings::count))
        .routes(routes!(waiting_recordings::assign))
        .routes(routes!(waiting_recordings::get, waiting_recordings::discard))
        .routes(routes!(waiting_recordings::video))
        .routes(routes!(waiting_recordings::preview))
}

/// Certificates, and what anyone may read about them.
fn certificate_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(certificates::list))
        .routes(routes!(certificates::issue))
        .routes(routes!(certificates::get))
        .routes(routes!(certificates::pdf))
        .routes(routes!(certificates::keep))
        .routes(routes!(certificates::withdraw))
        .routes(routes!(certificates::reinstate))
        .routes(routes!(certificates::check_file))
        .routes(routes!(certificates::check))
        .routes(routes!(certificates::keys, certificates::replace_key))
        .routes(routes!(certificates::key))
}

/// Exams and their attempts.
fn exam_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(exams::list, exams::plan))
        .routes(routes!(exams::get))
        .routes(routes!(exams::cancel))
        .routes(routes!(exams::start))
        .routes(routes!(exams::order))
        .routes(routes!(exams::set_completion))
        .routes(routes!(exams::void))
        .routes(routes!(exams::close))
        .routes(routes!(exams::issue))
}

/// Jobs, the state of the service, events, and this description.
fn operation_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(jobs::list))
        .routes(routes!(jobs::get))
        .routes(routes!(jobs::retry))
        .routes(routes!(attention::attention))
        .routes(routes!(centre::get, centre::set_name))
        .routes(routes!(centre::logo, centre::set_logo, centre::remove_logo))
        .routes(routes!(first_steps::first_steps))
        .routes(routes!(attention::dismissals, attention::dismiss))
        .routes(routes!(attention::undo_dismissal))
        .routes(routes!(service::service))
        .routes(routes!(service::audit))
        .routes(routes!(data_export::centre))
        .routes(routes!(events::events))
        .routes(routes!(openapi::document))
}

/// Resumable uploads, which use the tus protocol.
fn upload_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(uploads::describe, uploads::create))
        .routes(routes!(uploads::progress, uploads::append, uploads::terminate))
        .layer(from_fn(uploads::check_tus_version))
}

/// Health checks and metrics.
fn monitoring_routes() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(health::healthz))
        .routes(routes!(health::readyz))
        .routes(routes!(health::metrics))
}

/// All routes of the service: API, description, dashboard, health checks.
pub fn routes(app: App) -> Router {
    let (routes, mut document) = OpenApiRouter::with_openapi(openapi::base())
        .nest("/api/v1", api_routes())
        .merge(monitoring_routes())
        .split_for_parts();
    openapi::complete_operations(&mut document, &app.settings.base_path);
    routes
        .route("/docs", get(docs::entry))
        .route("/docs/", get(docs::index))
        .route("/docs/{*path}", get(docs::asset))
        .fallback(dashboard::page)
        .method_not_allowed_fallback(error::method_not_allowed)
        .layer(DefaultBodyLimit::disable()) // each extractor of a body enforces its own limit
        .layer(axum::Extension(openapi::OpenApiDocument::new(&document)))
        .layer(from_fn_with_state(app.settings.base_path.clone(), complete_addresses))
        .layer(from_fn_with_state(Pace::from(&app.settings), keep_pace))
        .layer(from_fn(origin::check_origin))
        .layer(compress())
        .layer(CatchPanicLayer::custom(error::panic_response))
        .layer(from_fn(protect::protect))
        .layer(from_fn_with_state(app.clone(), scheme::keep_to_https))
        .layer(from_fn(observe::observe))
        .with_state(app)
}
