//! The limits of a standard, computed from people or chosen. Limits are always computed here, never taken from the
//! request, so that the origin stated in a standard is true.

use super::answer::Withheld;
use super::people::{ComparableWith, LAST_SESSIONS, fingerprint};
use super::{Cohorts, CohortsError, unknown_field};
use crate::domain::feature::{FeatureKey, depends_on_camera, resolve_space};
use crate::domain::hand::Hand;
use crate::domain::scope::Scope;
use crate::domain::session::FeatureSpace;
use crate::domain::standard::{
    ChartDesign, LimitMethod, MadeFrom, NewStandard, NewTarget, StandardDefinition, StandardRule, Target,
};
use crate::domain::text::{Invalid, Key};
use crate::domain::trainee::Handedness;
use crate::ids::{TaskId, TraineeId};
use crate::motion::PIPELINE_VERSION;
use crate::motion::features::{self, Direction, Feature, time};
use crate::statistics::standard::{self, best_share, contrasting_groups, fls, trimmed_experts};
use crate::statistics::{NoAnswer, PersonValues};
use crate::store::{CohortRecord, CohortValue, StoreError};

/// A standard that is not stored yet.
#[derive(Clone, Debug, PartialEq, serde::Serialize, utoipa::ToSchema)]
pub struct Proposal {
    /// Its targets, in the order of the request.
    pub targets: Vec<ProposedTarget>,
    /// Its pass rule.
    pub rule: Option<StandardRule>,
    /// Its charts.
    pub charts: ChartDesign,
}

/// A target, or the reason why there is none.
#[derive(Clone, Debug, PartialEq, serde::Serialize, utoipa::ToSchema)]
pub struct ProposedTarget {
    /// The target; `null` if no limit can be computed from the people.
    pub target: Option<Target>,
    /// Why there is no target.
    pub withheld: Option<Withheld>,
}

/// A method for a limit, with the values that it needs.
enum LimitSource {
    Chosen(standard::FeatureTarget),
    Experts(CohortValues),
    Groups(CohortValues, CohortValues),
    Best(CohortValues, f64),
}

/// A cohort's values.
struct CohortValues {
    handedness: Option<Handedness>,
    values: Vec<CohortValue>,
}

impl Proposal {
    /// The definition to store, if every target has a limit.
    ///
    /// # Errors
    /// A target has no limit; the error says why.
    pub fn definition(self) -> Result<StandardDefinition, Invalid> {
        let target = |proposed: ProposedTarget| {
            let why = proposed.withheld.map_or_else(String::new, |why| why.detail);
            proposed.target.ok_or_else(|| Invalid::new("targets", format!("one has no limit: {why}")))
        };
        let targets = self.targets.into_iter().map(target).collect::<Result<_, _>>()?;
        Ok(StandardDefinition { targets, rule: self.rule, charts: self.charts })
    }
}

impl Cohorts {
    /// Computes a standard for a task, without storing it.
    pub async fn propose(&self, scope: &Scope, of: TaskId, new: NewStandard) -> Result<Proposal, CohortsError> {
        let NewStandard { targets, rule, charts, valid_from: _ } = new.checked()?;
        let mut ready = Vec::with_capacity(targets.len());
        for target in targets {
            let NewTarget { feature, tool, in_hand, space, by } = target;
            let key =
                find_limited_feature(LimitedFeature { feature: &feature, tool: tool.as_deref(), in_hand, space })?;
            if ready.iter().any(|(known, _)| *known == key) {
                return Err(Invalid::new("targets", format!("limit {} twice", key.feature)).into());
            }
            let way = self.limit_source(scope, of, &key, by).await?;
            ready.push((key, way));
        }
        let charts = charts.unwrap_or_default();
        let known = self.cache.clone();
        let calculation = move || {
            known.charts(charts).map_err(|why| Invalid::new("charts", why.to_string()))?;
            let targets = ready.into_iter().map(|(key, way)| propose_target(key, &way)).collect();
            Ok::<_, Invalid>(Proposal { targets, rule, charts })
        };
        Ok(self.calculate(calculation).await??)
    }

    /// Looks up the values that a method needs.
    async fn limit_source(
        &self,
        scope: &Scope,
        of: TaskId,
        key: &FeatureKey,
        way: LimitMethod,
    ) -> Result<LimitSource, CohortsError> {
        Ok(match way {
            LimitMethod::Fixed { limit, unit } => LimitSource::Chosen(fixed_target(key.feature, limit, &unit)?),
            LimitMethod::Fls { preset } => LimitSource::Chosen(published_target(key, &preset)?),
            LimitMethod::TrimmedExperts { experts } => {
                LimitSource::Experts(self.cohort_values(scope, of, key, "experts", &experts).await?)
            }
            LimitMethod::ContrastingGroups { novices, experts } => {
                let novices = self.cohort_values(scope, of, key, "novices", &novices).await?;
                let experts = self.cohort_values(scope, of, key, "experts", &experts).await?;
                if key.needs_same_preference() && novices.handedness != experts.handedness {
                    let why =
                        "prefer another hand than the novices, but a tool is in one hand: choose people of one hand";
                    return Err(Invalid::new("experts", why).into());
                }
                LimitSource::Groups(novices, experts)
            }
            LimitMethod::BestShare { cohort, share } => {
                if !(share > 0.0 && share < 1.0) {
                    return Err(
                        Invalid::new("share", format!("is {share}; expected between 0 and 1, both excluded")).into()
                    );
                }
                LimitSource::Best(self.cohort_values(scope, of, key, "cohort", &cohort).await?, share)
            }
        })
    }

    async fn cohort_values(
        &self,
        scope: &Scope,
        task: TaskId,
        of: &FeatureKey,
        field: &'static str,
        cohort: &Key,
    ) -> Result<CohortValues, CohortsError> {
        if !scope.is_administrator() {
            // A user who chooses the people of a limit and sees the values of some of them can compute the others'
            // values.
            return Err(StoreError::Forbidden { what: "a limit made from people", whom: "administrators" }.into());
        }
        let CohortRecord { id, handedness, .. } =
            self.store.cohorts().get(scope, cohort).await.map_err(unknown_field(field))?;
        if depends_on_camera(of) {
            let why = "depends on the camera's direction, which differs between boxes: choose a fixed limit, or a \
                       feature that does not depend on it, such as path_length in 3d";
            return Err(Invalid::new("feature", why).into());
        }
        if of.needs_same_preference() && handedness.is_none() {
            let why = "has people who prefer either hand, but a tool is in one hand: choose a cohort of one preferred \
                       hand, or limit a feature of the dominant hand or of the whole session";
            return Err(Invalid::new(field, why).into());
        }
        let values = self.store.cohorts().values(id, task, LAST_SESSIONS, std::slice::from_ref(of)).await?;
        Ok(CohortValues { handedness, values })
    }
}

/// Limit of a tool name's length, characters.
const MAX_TOOL_CHARS: usize = 64;

/// The feature of a limit, as the request names it.
#[derive(Clone, Copy)]
pub(super) struct LimitedFeature<'t> {
    /// Stable name of the feature.
    pub feature: &'t str,
    /// The tool's marker.
    pub tool: Option<&'t str>,
    /// The hand that holds the tool.
    pub in_hand: Option<Hand>,
    /// The space that it is measured in.
    pub space: Option<FeatureSpace>,
}

/// Finds the feature that a target limits, and checks that it can have a limit.
pub(super) fn find_limited_feature(target: LimitedFeature<'_>) -> Result<FeatureKey, Invalid> {
    let feature = features::find(target.feature)?;
    let space = resolve_space(feature, target.space)?;
    if feature.direction == Direction::Neither {
        let why = format!("cannot have a limit: neither a higher nor a lower {} is better", feature.name);
        return Err(Invalid::new("feature", why));
    }
    let name = feature.name;
    match target.tool {
        _ if target.in_hand.is_some() && !feature.has_tool_values() => {
            Err(Invalid::new("in_hand", format!("must be left out: {name} is measured for the whole session")))
        }
        Some(_) if target.in_hand.is_some() => {
            Err(Invalid::new("tool", "must be left out where `in_hand` names a hand"))
        }
        None if !feature.has_session_value() && target.in_hand.is_none() => {
            Err(Invalid::new("in_hand", format!("is missing: {name} is measured for each hand, so name one")))
        }
        Some(_) if !feature.has_tool_values() => {
            Err(Invalid::new("tool", format!("must be left out: {name} is measured for the whole session")))
        }
        Some(tool) if tool.is_empty() || tool.chars().count() > MAX_TOOL_CHARS => {
            Err(Invalid::new("tool", format!("is not a tool's name: expected 1 to {MAX_TOOL_CHARS} characters")))
        }
        tool => Ok(FeatureKey { feature, tool: tool.map(str::to_owned), in_hand: target.in_hand, space }),
    }
}

fn fixed_target(feature: &Feature, limit: f64, unit: &str) -> Result<standard::FeatureTarget, Invalid> {
    if unit != feature.unit {
        return Err(Invalid::new("unit", format!("is `{unit}`; {} is measured in `{}`", feature.name, feature.unit)));
    }
    let (least, most) = feature.range;
    if !(least..=most).contains(&limit) {
        return Err(Invalid::new("limit", format!("is {limit}; {} lies between {least} and {most}", feature.name)));
    }
    standard::FeatureTarget::fixed(limit, feature.direction).map_err(|why| Invalid::new("limit", why.to_string()))
}

fn published_target(key: &FeatureKey, preset: &str) -> Result<standard::FeatureTarget, Invalid> {
    if key.feature != &time::DURATION || key.is_of_one_hand() {
        return Err(Invalid::new("method", "fls gives times: use it only for the duration of the whole session"));
    }
    let known = fls::FLS.iter().find(|known| known.task == preset);
    known.map(|known| known.duration).ok_or_else(|| {
        let names: Vec<&str> = fls::FLS.iter().map(|known| known.task).collect();
        Invalid::new("preset", format!("`{preset}` is unknown; use one of {}", names.join(", ")))
    })
}

fn propose_target(key: FeatureKey, way: &LimitSource) -> ProposedTarget {
    match compute_target(&key, way) {
        Ok((target, from)) => ProposedTarget { target: Some(Target::of(key, target, from)), withheld: None },
        Err(why) => ProposedTarget { target: None, withheld: Some(why.into()) },
    }
}

fn compute_target(
    key: &FeatureKey,
    way: &LimitSource,
) -> Result<(standard::FeatureTarget, Option<MadeFrom>), NoAnswer> {
    let direction = key.feature.direction;
    let from = |groups: &[&PersonValues], handedness| {
        let handedness = if key.needs_same_preference() { handedness } else { None };
        Some(MadeFrom { pipeline: PIPELINE_VERSION.to_owned(), fingerprint: Some(fingerprint(groups)), handedness })
    };
    Ok(match way {
        LimitSource::Chosen(target) => (*target, None),
        LimitSource::Experts(experts) => {
            let people = experts.people(key)?;
            (trimmed_experts(&people, direction)?, from(&[&people], experts.handedness))
        }
        LimitSource::Groups(novices, experts) => {
            let [novice_people, expert_people] = distinct_people(novices, experts, key)?;
            let target = contrasting_groups(&novice_people, &expert_people, direction)?;
            (target, from(&[&novice_people, &expert_people], experts.handedness))
        }
        LimitSource::Best(group, share) => {
            let people = group.people(key)?;
            (best_share(&people, *share, direction)?, from(&[&people], group.handedness))
        }
    })
}

/// The people of both groups. Fails if a person is in both.
fn distinct_people(
    novices: &CohortValues,
    experts: &CohortValues,
    key: &FeatureKey,
) -> Result<[PersonValues; 2], NoAnswer> {
    let trainees = |group: &CohortValues| -> Vec<TraineeId> {
        group.like(key).rows(&group.values).into_iter().map(|(trainee, _)| trainee).collect()
    };
    let experts_are = trainees(experts);
    if trainees(novices).iter().any(|novice| experts_are.contains(novice)) {
        return Err(NoAnswer::PersonTwice);
    }
    Ok([novices.people(key)?, experts.people(key)?])
}

impl CohortValues {
    fn like<'l>(&self, of: &'l FeatureKey) -> ComparableWith<'l> {
        ComparableWith { of, pipeline: PIPELINE_VERSION, calibration: None, handedness: self.handedness, without: None }
    }

    fn people(&self, of: &FeatureKey) -> Result<PersonValues, NoAnswer> {
        self.like(of).people(&self.values)
    }
}
