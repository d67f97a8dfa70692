//! A task's model of skill: made of people of declared levels, and asked what it says of a session.

use tokio::sync::OwnedSemaphorePermit;

use super::{Cohorts, CohortsError};
use crate::domain::scope::Scope;
use crate::domain::session::FeatureRow;
use crate::domain::skill::{
    Definition, ModelFile, Reading, Readings, ReasonName, SkillVerdict, features_offered, most_common_tools,
};
use crate::ids::{TaskId, TraineeId};
use crate::pipeline::PIPELINE_VERSION;
use crate::pipeline::score::skill::{Dataset, FEWEST_PER_LEVEL, Level, MOST_PER_LEVEL, NoModel, SESSIONS_EACH, Sample};
use crate::store::{DeclaredSession, NewSkillModel, SessionResult, SkillModel, StoreError};

/// Why no model was made.
#[derive(Clone, Debug, PartialEq)]
pub struct NoSkillModel {
    /// Stable name of the reason.
    pub reason: &'static str,
    /// The reason, for people.
    pub detail: String,
    /// How many people of each level are missing, where that is the reason.
    pub missing: Option<Vec<(&'static str, usize)>>,
}

impl From<NoModel> for NoSkillModel {
    fn from(why: NoModel) -> Self {
        let missing = match &why {
            NoModel::TooFewPeople { found } => {
                let of = |level: Level| (level.name(), FEWEST_PER_LEVEL.saturating_sub(found[level as usize]));
                Some(Level::ALL.map(of).into())
            }
            _ => None,
        };
        Self { reason: why.name(), detail: why.to_string(), missing }
    }
}

impl Cohorts {
    /// Makes a task's next model from what people of declared levels did, and keeps it, whoever waits for it or not. One at a
    /// time.
    pub async fn train(&self, scope: &Scope, of: TaskId) -> Result<SkillModel, CohortsError> {
        if !scope.is_administrator() {
            // A model is made of people whom an instructor need not see.
            return Err(
                StoreError::Forbidden { what: "making models of people's skill", whom: "administrators" }.into()
            );
        }
        let place = self.training.clone().try_acquire_owned().map_err(|_| CohortsError::Training)?;
        let work = self.clone().train_in(place, scope.clone(), of);
        tokio::spawn(work).await.map_err(|_| CohortsError::Broken)?
    }

    async fn train_in(self, place: OwnedSemaphorePermit, scope: Scope, of: TaskId) -> Result<SkillModel, CohortsError> {
        let models = self.store.skill_models();
        let sessions = models.declared(of, PIPELINE_VERSION, SESSIONS_EACH, MOST_PER_LEVEL).await?;
        let making = tokio::task::spawn_blocking(move || (make(sessions), place));
        let (made, _place) = making.await.map_err(|_| CohortsError::Broken)?;
        Ok(models.add(&scope, of, made.map_err(NoSkillModel::from)?).await?)
    }

    /// What a task's model in use says of a result of somebody's session. Of people whose sessions it was made of it says
    /// nothing: it would tell what it was told, and is worth something else there than was measured.
    pub async fn verdict(
        &self,
        scope: &Scope,
        (of, trainee): (TaskId, TraineeId),
        result: &SessionResult,
    ) -> Result<SkillVerdict, CohortsError> {
        let Some(model) = self.store.skill_models().in_use(scope, of).await? else {
            let detail = "the task has no model of skill; administrators make one";
            return Ok(SkillVerdict::without(ReasonName::NoModel, detail));
        };
        let (version, report) = (model.version, model.report.clone());
        let is_its_own = self.store.skill_models().is_made_of(model.id, trainee).await?;
        let verdict = match askable(&model, result) {
            Err(without) => *without,
            Ok(_) if is_its_own => {
                let detail =
                    "the model was made of this person's own sessions among others: it would tell what it was told";
                SkillVerdict::without(ReasonName::InTraining, detail)
            }
            Ok(definition) => {
                let (readings, tools) = (Readings::of(result.features.iter().map(reading)), result.tools.len());
                self.calculate(move || definition.judge(&readings, tools)).await?
            }
        };
        Ok(verdict.by(version, &report))
    }
}

/// The model, if it may be asked of this result.
fn askable(model: &SkillModel, result: &SessionResult) -> Result<Definition, Box<SkillVerdict>> {
    let without = |name, detail: String| Err(Box::new(SkillVerdict::without(name, detail)));
    let Some(definition) = model.definition.clone() else {
        let detail =
            "somebody of whom the model was made was erased, and the model with them; administrators make another";
        return without(ReasonName::Withdrawn, detail.to_owned());
    };
    if result.quality["verdict"] == "refused" {
        return without(ReasonName::Refused, "the session's measurement is refused: see its quality".to_owned());
    }
    let (own, other) = (&result.versions.pipeline, &model.pipeline);
    if own != other {
        let detail =
            format!("the session was measured by version {own} of the program, the model's sessions by {other}");
        return without(ReasonName::OtherPipeline, detail);
    }
    Ok(definition)
}

fn make(sessions: Vec<DeclaredSession>) -> Result<NewSkillModel, NoModel> {
    let tools = most_common_tools(sessions.iter().map(|session| session.tools));
    let features = features_offered();
    let sample = |session: DeclaredSession| Sample {
        person: session.trainee,
        level: session.level.into(),
        values: Readings::of(session.readings).values(&features),
    };
    let samples: Vec<Sample<_>> = sessions.into_iter().filter(|session| session.tools == tools).map(sample).collect();
    let data = Dataset::of(&features, &samples)?;
    let mut trainees: Vec<_> = samples.into_iter().map(|sample| sample.person).collect();
    trainees.sort();
    trainees.dedup();
    let ModelFile { pipeline, fingerprint, report, model, .. } =
        ModelFile::make(&data, (None, PIPELINE_VERSION.to_owned(), tools), |_, _| ())?;
    Ok(NewSkillModel { pipeline, fingerprint, definition: model, report, trainees })
}

fn reading(row: &FeatureRow) -> Reading {
    let bar = row.error.as_ref().and_then(|error| error.as_ref().ok()).map(|error| [error.low, error.high]);
    let value = row.value.as_ref().ok().copied();
    Reading { feature: row.name.clone(), tool: row.tool.clone(), space: row.space, value, bar }
}
