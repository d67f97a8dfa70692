//! How a feature is spread over people, and whom a limit would be wrong about, wherever it lies. Only of people whom the one who
//! asks sees anyway: cohorts hold anybody of the centre.

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::Withheld;
use super::people::{LAST_SESSIONS, Like};
use super::propose::{Limited, limited};
use super::{Cohorts, CohortsError, named};
use crate::domain::feature::{FeatureKey, is_of_one_camera};
use crate::domain::scope::Scope;
use crate::domain::session::FeatureSpace;
use crate::domain::standard::Share;
use crate::domain::text::{Invalid, Key};
use crate::domain::trainee::Handedness;
use crate::ids::TaskId;
use crate::pipeline::PIPELINE_VERSION;
use crate::pipeline::features::Feature;
use crate::pipeline::score::standard::{breaking, keeping};
use crate::store::CohortValue;

/// What is asked of a feature's spread.
#[derive(Clone, Debug)]
pub struct AskedSpread {
    /// Stable name of a feature of which more or less is better.
    pub feature: String,
    /// The tool's marker.
    pub tool: Option<String>,
    /// Where it is measured; without it, in three dimensions, if it is measured there.
    pub space: Option<FeatureSpace>,
    /// Over which cohorts; over everybody seen, if none is named.
    pub cohorts: Vec<Key>,
    /// Of a tool's feature: over those who prefer this hand.
    pub hand: Option<Handedness>,
    /// Where a limit would lie.
    pub limit: Option<f64>,
}

/// How a feature is spread over people whom one sees, and what a limit would make of them.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Distribution {
    /// Which feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: &'static str,
    /// Its unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// What is better: `lower` or `higher`.
    pub better: &'static str,
    /// Version of the program whose values these are.
    pub pipeline: &'static str,
    /// Of a tool's feature: the hand that these people prefer.
    pub hand: Option<Handedness>,
    /// The limit that was asked about.
    pub limit: Option<f64>,
    /// The people, group by group.
    pub groups: Vec<Spread>,
}

/// One group's values.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Spread {
    /// The cohort's code; `null`: everybody whom one sees.
    pub cohort: Option<String>,
    /// What people call it.
    pub name: Option<String>,
    /// One value a person, the median of their last sessions, in rising order: of those whom one sees.
    pub values: Vec<f64>,
    /// The share that keeps the limit: of novices, the false passes. `null` without a limit, or where it is withheld.
    pub keeping: Option<Share>,
    /// The share that breaks it: of experts, the false fails.
    pub breaking: Option<Share>,
    /// Why the shares are withheld.
    pub withheld: Option<Withheld>,
}

/// People and what they are called.
struct Over {
    cohort: Option<(String, String)>,
    handedness: Option<Handedness>,
    values: Vec<CohortValue>,
}

impl Cohorts {
    /// How a feature is spread over people at a task.
    pub async fn distribution(
        &self,
        scope: &Scope,
        of: TaskId,
        asked: AskedSpread,
    ) -> Result<Distribution, CohortsError> {
        let AskedSpread { feature, tool, space, cohorts, hand, limit } = asked;
        let (feature, key) = limited(Limited { feature: &feature, tool: tool.as_deref(), space })?;
        if is_of_one_camera(&key) {
            let why = "lies along the camera's own axes, which differ between boxes: choose one that is the same from everywhere";
            return Err(Invalid::new("feature", why).into());
        }
        if limit.is_some_and(|limit| !limit.is_finite()) {
            return Err(Invalid::new("limit", "is no number").into());
        }
        if key.tool.is_some() && hand.is_none() {
            let why = "is missing: a tool is in one hand, so say which hand the people prefer";
            return Err(Invalid::new("hand", why).into());
        }
        let mut over = Vec::with_capacity(cohorts.len().max(1));
        if cohorts.is_empty() {
            over.push(self.over(scope, of, &key, None, hand).await?);
        }
        for cohort in &cohorts {
            over.push(self.over(scope, of, &key, Some(cohort), hand).await?);
        }
        let calculation = move || {
            let groups = over.iter().map(|over| spread(&key, feature, over, limit)).collect();
            let (title, unit, better) = (feature.title, feature.unit, feature.direction.name());
            let hand = key.tool.as_ref().and(hand);
            Distribution { of: key, title, unit, better, pipeline: PIPELINE_VERSION, hand, limit, groups }
        };
        self.calculate(calculation).await
    }

    async fn over(
        &self,
        scope: &Scope,
        task: TaskId,
        of: &FeatureKey,
        cohort: Option<&Key>,
        hand: Option<Handedness>,
    ) -> Result<Over, CohortsError> {
        let cohort = match cohort {
            Some(key) => Some(self.store.cohorts().get(scope, key).await.map_err(named("cohort"))?),
            None => None,
        };
        let id = cohort.as_ref().map(|cohort| cohort.id);
        let keys = std::slice::from_ref(of);
        let values = self.store.cohorts().values_seen(scope, id, task, LAST_SESSIONS, keys).await?;
        let cohort = cohort.map(|cohort| (cohort.code.to_string(), cohort.name.to_string()));
        Ok(Over { cohort, handedness: hand, values })
    }
}

fn spread(of: &FeatureKey, feature: &'static Feature, over: &Over, limit: Option<f64>) -> Spread {
    let like = Like { of, pipeline: PIPELINE_VERSION, calibration: None, handedness: over.handedness, without: None };
    let (cohort, name) = over.cohort.clone().unzip();
    let told = |values, withheld| Spread { cohort, name, values, keeping: None, breaking: None, withheld };
    let people = match like.people(&over.values) {
        Ok(people) => people,
        Err(why) => return told(Vec::new(), Some(why.into())),
    };
    let values = people.values().to_vec();
    let Some(limit) = limit else { return told(values, None) };
    match (keeping(&people, limit, feature.direction), breaking(&people, limit, feature.direction)) {
        (Ok(kept), Ok(broken)) => {
            Spread { keeping: Some(kept.into()), breaking: Some(broken.into()), ..told(values, None) }
        }
        (Err(why), _) | (_, Err(why)) => told(values, Some(why.into())),
    }
}
