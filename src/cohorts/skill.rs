//! A task's model of skill: its training on people of declared levels, and its verdict on a session.

use tokio::sync::OwnedSemaphorePermit;

use super::{Cohorts, CohortsError};
use crate::domain::scope::Scope;
use crate::domain::session::FeatureRow;
use crate::domain::skill::{
    ModelDefinition, ModelFile, NoLevelReasonName, Reading, Readings, SkillVerdict, most_common_tool_count,
    verdict_features,
};
use crate::ids::{TaskId, TraineeId};
use crate::motion::{PIPELINE_VERSION, features};
use crate::statistics::skill::{
    LabelledSession, MAX_PER_LEVEL, MAX_SESSIONS_EACH, MIN_PER_LEVEL, NoModel, SkillDataset, SkillLevel,
};
use crate::store::{DeclaredSession, NewSkillModel, SessionResult, SkillModelRecord, StoreError};

/// Why no model could be trained.
#[derive(Clone, Debug, PartialEq)]
pub struct NoSkillModel {
    /// Stable name of the reason.
    pub reason: &'static str,
    /// The reason, for people.
    pub detail: String,
    /// Number of missing people per level, if there are too few.
    pub missing: Option<Vec<(&'static str, usize)>>,
}

impl From<NoModel> for NoSkillModel {
    fn from(why: NoModel) -> Self {
        let missing = match &why {
            NoModel::TooFewPeople { found } => {
                let of = |level: SkillLevel| (level.name(), MIN_PER_LEVEL.saturating_sub(found[level as usize]));
                Some(SkillLevel::ALL.map(of).into())
            }
            _ => None,
        };
        Self { reason: why.name(), detail: why.to_string(), missing }
    }
}

impl Cohorts {
    /// Trains a task's next model on the sessions of people of declared levels, and stores it even if the caller no
    /// longer waits. Only one training runs at a time.
    pub async fn train(&self, scope: &Scope, of: TaskId) -> Result<SkillModelRecord, CohortsError> {
        if !scope.is_administrator() {
            // The training uses people outside an instructor's scope.
            return Err(
                StoreError::Forbidden { what: "training models of people's skill", whom: "administrators" }.into()
            );
        }
        let place = self.training_slots.clone().try_acquire_owned().map_err(|_| CohortsError::Training)?;
        let work = self.clone().train_with_permit(place, scope.clone(), of);
        tokio::spawn(work).await.map_err(|_| CohortsError::Interrupted)?
    }

    async fn train_with_permit(
        self,
        place: OwnedSemaphorePermit,
        scope: Scope,
        of: TaskId,
    ) -> Result<SkillModelRecord, CohortsError> {
        let models = self.store.skill_models();
        let sessions = models.declared(of, PIPELINE_VERSION, MAX_SESSIONS_EACH, MAX_PER_LEVEL).await?;
        let making = tokio::task::spawn_blocking(move || (train_model(sessions), place));
        let (made, _place) = making.await.map_err(|_| CohortsError::Interrupted)?;
        Ok(models.add(&scope, of, made.map_err(NoSkillModel::from)?).await?)
    }

    /// The verdict of a task's current model on the result of a session. It gives none on people whose sessions it was
    /// trained on: the model has seen their declared level, so its stated accuracy does not hold for them.
    pub async fn verdict(
        &self,
        scope: &Scope,
        (of, trainee): (TaskId, TraineeId),
        result: &SessionResult,
    ) -> Result<SkillVerdict, CohortsError> {
        let Some(model) = self.store.skill_models().in_use(scope, of).await? else {
            let detail = "the task has no model of skill; an administrator can train one";
            return Ok(SkillVerdict::without_level(NoLevelReasonName::NoModel, detail));
        };
        let (version, report) = (model.version, model.report.clone());
        let is_its_own = self.store.skill_models().is_trained_on(model.id, trainee).await?;
        let verdict = match usable_definition(&model, result) {
            Err(without) => *without,
            Ok(_) if is_its_own => {
                let detail = "the model was trained on this person's sessions, so its verdict would not be independent";
                SkillVerdict::without_level(NoLevelReasonName::InTraining, detail)
            }
            Ok(definition) => {
                let (readings, tools) = (Readings::of(result.features.iter().filter_map(reading)), result.tools.len());
                self.calculate(move || definition.judge(&readings, tools)).await?
            }
        };
        Ok(verdict.from_model(version, &report))
    }
}

/// The model, if it can judge this result; else the verdict without a level.
fn usable_definition(model: &SkillModelRecord, result: &SessionResult) -> Result<ModelDefinition, Box<SkillVerdict>> {
    let without = |name, detail: String| Err(Box::new(SkillVerdict::without_level(name, detail)));
    let Some(definition) = model.definition.clone() else {
        let detail = "data that the model was trained on were erased or moved to another person or task, so the model was \
                      erased too; an administrator can train another";
        return without(NoLevelReasonName::Withdrawn, detail.to_owned());
    };
    if result.quality["verdict"] == "refused" {
        return without(NoLevelReasonName::Refused, "the session is refused: see its quality".to_owned());
    }
    let (own, other) = (&result.versions.pipeline, &model.pipeline);
    if own != other {
        let detail = format!("the session was measured by pipeline version {own}, the model's sessions by {other}");
        return without(NoLevelReasonName::OtherPipeline, detail);
    }
    Ok(definition)
}

fn train_model(sessions: Vec<DeclaredSession>) -> Result<NewSkillModel, NoModel> {
    let tools = most_common_tool_count(sessions.iter().map(|session| session.tools));
    let features = verdict_features();
    let sample = |session: DeclaredSession| LabelledSession {
        person: session.trainee,
        level: session.level.into(),
        values: Readings::of(session.readings).values(&features),
    };
    let samples: Vec<LabelledSession<_>> =
        sessions.into_iter().filter(|session| session.tools == tools).map(sample).collect();
    let data = SkillDataset::of(&features, &samples)?;
    let mut trainees: Vec<_> = samples.into_iter().map(|sample| sample.person).collect();
    trainees.sort();
    trainees.dedup();
    let ModelFile { pipeline, fingerprint, report, model, .. } =
        ModelFile::train(&data, (None, PIPELINE_VERSION.to_owned(), tools), |_, _| ())?;
    Ok(NewSkillModel { pipeline, fingerprint, definition: model, report, trainees })
}

/// A stored value; `None` for a feature that this version does not measure.
fn reading(row: &FeatureRow) -> Option<Reading> {
    let feature = features::find(&row.name).ok()?;
    let bar = row.error.as_ref().and_then(|error| error.as_ref().ok()).map(|error| [error.low, error.high]);
    Some(Reading { feature, tool: row.tool.clone(), space: row.space, value: row.two_sided_value(), bar })
}
