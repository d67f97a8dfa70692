//! Models of skill of tasks. Every member may read how accurate a model is; administrators train models. A version
//! never changes.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::scope::Scope;
use crate::domain::skill::ModelReport;
use crate::domain::text::Key;
use crate::http::auth::signed_in::{Administrator, Member};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, PathPair};
use crate::http::show::{Created, PageResponse, Time};
use crate::http::state::App;
use crate::ids::ModelId;
use crate::store::SkillModelRecord;

/// A version of a task's model of skill.
#[derive(Debug, Serialize, ToSchema)]
pub struct SkillModelResponse {
    id: ModelId,
    /// 1, 2, … within the task; the highest is the one in use.
    version: i64,
    /// Version of the program that measured its training sessions. It judges only sessions of the same version.
    pipeline: String,
    /// `logistic`, `lda`, `knn`, `tree` or `svm`; `null`, like the next two, once the model is withdrawn.
    learner: Option<String>,
    /// The learner's parameter.
    parameter: Option<String>,
    /// The features that the model uses, those that separate the levels best first.
    features: Option<Vec<String>>,
    report: ModelReport,
    /// SHA-256 of the training values. `null` for all but administrators: a person who knows most of the values could
    /// recover the last one from it.
    fingerprint: Option<String>,
    /// Name of the person who trained it; `null` for trainees, and if the person was deleted.
    who: Option<String>,
    created_at: Time,
    /// When the model was withdrawn: a person in its training data was erased, and with the person everything that it
    /// had learned. `null`: not withdrawn.
    withdrawn_at: Option<Time>,
}

impl SkillModelResponse {
    fn new(model: SkillModelRecord, scope: &Scope) -> Self {
        let definition = model.definition.as_ref();
        Self {
            id: model.id,
            version: model.version,
            pipeline: model.pipeline,
            learner: definition.map(|of| of.learner.clone()),
            parameter: definition.map(|of| of.parameter.clone()),
            features: definition.map(|of| of.features.iter().map(|scaled| scaled.feature.clone()).collect()),
            report: model.report,
            fingerprint: Some(model.fingerprint).filter(|_| scope.is_administrator()),
            who: model.who.filter(|_| scope.is_staff()),
            created_at: Time(model.created_at_ms),
            withdrawn_at: model.withdrawn_at_ms.map(Time),
        }
    }
}

/// List a task's models of skill, newest first
///
/// The first one is in use.
#[utoipa::path(get, path = "/tasks/{id}/models", tag = "tasks",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<SkillModelResponse>)))]
pub async fn models(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<SkillModelResponse>>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    let models = app.store.skill_models().list(&by.scope, of).await?;
    Ok(Json(PageResponse::whole(models.into_iter().map(|model| SkillModelResponse::new(model, &by.scope)))))
}

/// Train a task's model of skill
///
/// The result is the next version, unless the version in use was trained with the same data. Training uses the last
/// three usable sessions of each person with a declared level, measured by this version of the program, and at most 40
/// people of a level. It takes some minutes and continues if the client disconnects; one model is trained at a time.
/// Training is refused with fewer than eight people of a level; `missing` then gives the number of people still needed.
#[utoipa::path(post, path = "/tasks/{id}/models", tag = "tasks",
    params(("id" = String, Path, description = "id or code")),
    responses((status = CREATED, body = SkillModelResponse)))]
pub async fn train_model(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
) -> HandlerResult<Created<SkillModelResponse>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    let made = SkillModelResponse::new(app.cohorts.train(&by.scope, of).await?, &by.scope);
    Ok(Created { location: format!("/api/v1/tasks/{of}/models/{}", made.version), made })
}

/// Read one version of a task's model of skill
#[utoipa::path(get, path = "/tasks/{id}/models/{version}", tag = "tasks",
    params(("id" = String, Path, description = "id or code"), ("version" = i64, Path, description = "1, 2, …")),
    responses((status = OK, body = SkillModelResponse)))]
pub async fn model(
    State(app): State<App>,
    by: Member,
    PathPair(key, version): PathPair<String, i64>,
) -> HandlerResult<Json<SkillModelResponse>> {
    let of = app.store.tasks().get(&by.scope, &Key::from(&key)).await?.id;
    let model = app.store.skill_models().get(&by.scope, of, version).await?;
    Ok(Json(SkillModelResponse::new(model, &by.scope)))
}
