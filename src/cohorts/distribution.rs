//! The distribution of a feature over people, and the shares that a limit would judge wrongly. Only people in the
//! caller's scope are included, although a cohort may hold people of the whole centre.

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::Withheld;
use super::people::{ComparableWith, LAST_SESSIONS};
use super::propose::{LimitedFeature, find_limited_feature};
use super::{Cohorts, CohortsError, unknown_field};
use crate::domain::feature::{FeatureKey, depends_on_camera};
use crate::domain::hand::Hand;
use crate::domain::scope::Scope;
use crate::domain::session::FeatureSpace;
use crate::domain::standard::MisjudgedShare;
use crate::domain::text::{Invalid, Key};
use crate::domain::trainee::Handedness;
use crate::ids::TaskId;
use crate::motion::PIPELINE_VERSION;
use crate::statistics::standard::{meeting_rate, missing_rate};
use crate::store::CohortValue;

/// Parameters of a distribution.
#[derive(Clone, Debug)]
pub struct DistributionSelection {
    /// Stable name of a feature with a better direction (lower or higher).
    pub feature: String,
    /// The tool's marker.
    pub tool: Option<String>,
    /// The hand that holds the tool.
    pub in_hand: Option<Hand>,
    /// The space; by default three dimensions, if the feature is measured there.
    pub space: Option<FeatureSpace>,
    /// The cohorts; if none is named, all people in the caller's scope.
    pub cohorts: Vec<Key>,
    /// For a feature of a tool, or of the left or right hand: the hand that the people prefer.
    pub hand: Option<Handedness>,
    /// A limit to judge the people by.
    pub limit: Option<f64>,
}

/// The distribution of a feature over the people in the caller's scope, and the effect of a limit.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Distribution {
    /// The feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: &'static str,
    /// Its unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// What is better: `lower` or `higher`.
    pub better: &'static str,
    /// Pipeline version of the values.
    pub pipeline: &'static str,
    /// For a feature of a tool, or of the left or right hand: the hand that these people prefer.
    pub hand: Option<Handedness>,
    /// The limit of the request.
    pub limit: Option<f64>,
    /// One entry per cohort.
    pub groups: Vec<GroupSpread>,
}

/// One group's values.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GroupSpread {
    /// The cohort's code; `null` for all people in the caller's scope.
    pub cohort: Option<String>,
    /// The cohort's name.
    pub name: Option<String>,
    /// One value per person in the caller's scope, the median of their last sessions, in rising order.
    pub values: Vec<f64>,
    /// The share that meets the limit: among novices, the false passes. `null` without a limit, or if it is withheld.
    pub keeping: Option<MisjudgedShare>,
    /// The share that misses the limit: among experts, the false fails.
    pub breaking: Option<MisjudgedShare>,
    /// Why the shares are withheld.
    pub withheld: Option<Withheld>,
}

/// A cohort's code and name, with its values.
struct GroupValues {
    cohort: Option<(String, String)>,
    handedness: Option<Handedness>,
    values: Vec<CohortValue>,
}

impl Cohorts {
    /// The distribution of a feature over people at a task.
    pub async fn distribution(
        &self,
        scope: &Scope,
        of: TaskId,
        asked: DistributionSelection,
    ) -> Result<Distribution, CohortsError> {
        let DistributionSelection { feature, tool, in_hand, space, cohorts, hand, limit } = asked;
        let key = find_limited_feature(LimitedFeature { feature: &feature, tool: tool.as_deref(), in_hand, space })?;
        if depends_on_camera(&key) {
            let why = "depends on the camera's direction, which differs between boxes: choose a feature that does not";
            return Err(Invalid::new("feature", why).into());
        }
        if limit.is_some_and(|limit| !limit.is_finite()) {
            return Err(Invalid::new("limit", "is not a number").into());
        }
        if key.needs_same_preference() && hand.is_none() {
            let why = "is missing: a tool is in one hand, so name the hand that the people prefer";
            return Err(Invalid::new("hand", why).into());
        }
        let mut over = Vec::with_capacity(cohorts.len().max(1));
        if cohorts.is_empty() {
            over.push(self.group_values(scope, of, &key, None, hand).await?);
        }
        for cohort in &cohorts {
            over.push(self.group_values(scope, of, &key, Some(cohort), hand).await?);
        }
        let calculation = move || {
            let feature = key.feature;
            let groups = over.iter().map(|over| group_spread(&key, over, limit)).collect();
            let (title, unit, better) = (feature.title, feature.unit, feature.direction.name());
            let hand = if key.needs_same_preference() { hand } else { None };
            Distribution { of: key, title, unit, better, pipeline: PIPELINE_VERSION, hand, limit, groups }
        };
        self.calculate(calculation).await
    }

    async fn group_values(
        &self,
        scope: &Scope,
        task: TaskId,
        of: &FeatureKey,
        cohort: Option<&Key>,
        hand: Option<Handedness>,
    ) -> Result<GroupValues, CohortsError> {
        let cohort = match cohort {
            Some(key) => Some(self.store.cohorts().get(scope, key).await.map_err(unknown_field("cohort"))?),
            None => None,
        };
        let id = cohort.as_ref().map(|cohort| cohort.id);
        let keys = std::slice::from_ref(of);
        let values = self.store.cohorts().values_seen(scope, id, task, LAST_SESSIONS, keys).await?;
        let cohort = cohort.map(|cohort| (cohort.code.to_string(), cohort.name.to_string()));
        Ok(GroupValues { cohort, handedness: hand, values })
    }
}

fn group_spread(of: &FeatureKey, over: &GroupValues, limit: Option<f64>) -> GroupSpread {
    let like = ComparableWith {
        of,
        pipeline: PIPELINE_VERSION,
        calibration: None,
        handedness: over.handedness,
        without: None,
    };
    let (cohort, name) = over.cohort.clone().unzip();
    let without_shares =
        |values, withheld| GroupSpread { cohort, name, values, keeping: None, breaking: None, withheld };
    let people = match like.people(&over.values) {
        Ok(people) => people,
        Err(why) => return without_shares(Vec::new(), Some(why.into())),
    };
    let values = people.values().to_vec();
    let Some(limit) = limit else { return without_shares(values, None) };
    let direction = of.feature.direction;
    match (meeting_rate(&people, limit, direction), missing_rate(&people, limit, direction)) {
        (Ok(kept), Ok(broken)) => {
            GroupSpread { keeping: Some(kept.into()), breaking: Some(broken.into()), ..without_shares(values, None) }
        }
        (Err(why), _) | (_, Err(why)) => without_shares(values, Some(why.into())),
    }
}
