//! The limits of a standard, computed from people or chosen. Limits are always computed here, never taken from the
//! request, so that the origin stated in a standard is true.

use super::answer::Withheld;
use super::people::{LAST_SESSIONS, Like, fingerprint};
use super::{Cohorts, CohortsError, named};
use crate::domain::feature::{self, FeatureKey, is_of_one_camera};
use crate::domain::scope::Scope;
use crate::domain::session::FeatureSpace;
use crate::domain::standard::{ChartDesign, Definition, MadeFrom, NewStandard, NewTarget, Rule, Target, Way};
use crate::domain::text::{Invalid, Key};
use crate::domain::trainee::Handedness;
use crate::ids::{TaskId, TraineeId};
use crate::pipeline::PIPELINE_VERSION;
use crate::pipeline::features::{Direction, Feature, time};
use crate::pipeline::score::standard::{self, best_share, contrasting_groups, fls, trimmed_experts};
use crate::pipeline::score::{NoAnswer, People};
use crate::store::{Cohort, CohortValue, StoreError};

/// A standard that is not stored yet.
#[derive(Clone, Debug, PartialEq, serde::Serialize, utoipa::ToSchema)]
pub struct Proposal {
    /// Its targets, in the order of the request.
    pub targets: Vec<Proposed>,
    /// Its pass rule.
    pub rule: Option<Rule>,
    /// Its charts.
    pub charts: ChartDesign,
}

/// A target, or the reason why there is none.
#[derive(Clone, Debug, PartialEq, serde::Serialize, utoipa::ToSchema)]
pub struct Proposed {
    /// The target; `null` if no limit can be computed from the people.
    pub target: Option<Target>,
    /// Why there is no target.
    pub withheld: Option<Withheld>,
}

/// A method for a limit, with the values that it needs.
enum Ready {
    Chosen(standard::Target),
    Experts(Group),
    Groups(Group, Group),
    Best(Group, f64),
}

/// A cohort's values.
struct Group {
    handedness: Option<Handedness>,
    values: Vec<CohortValue>,
}

impl Proposal {
    /// The definition to store, if every target has a limit.
    ///
    /// # Errors
    /// A target has no limit; the error says why.
    pub fn definition(self) -> Result<Definition, Invalid> {
        let target = |proposed: Proposed| {
            let why = proposed.withheld.map_or_else(String::new, |why| why.detail);
            proposed.target.ok_or_else(|| Invalid::new("targets", format!("one has no limit: {why}")))
        };
        let targets = self.targets.into_iter().map(target).collect::<Result<_, _>>()?;
        Ok(Definition { targets, rule: self.rule, charts: self.charts })
    }
}

impl Cohorts {
    /// Computes a standard for a task, without storing it.
    pub async fn propose(&self, scope: &Scope, of: TaskId, new: NewStandard) -> Result<Proposal, CohortsError> {
        let NewStandard { targets, rule, charts } = new.checked()?;
        let mut ready = Vec::with_capacity(targets.len());
        for target in targets {
            let NewTarget { feature, tool, space, by } = target;
            let (feature, key) = limited(Limited { feature: &feature, tool: tool.as_deref(), space })?;
            if ready.iter().any(|(_, known, _)| *known == key) {
                return Err(Invalid::new("targets", format!("limit {} twice", key.feature)).into());
            }
            let way = self.ready(scope, of, feature, &key, by).await?;
            ready.push((feature, key, way));
        }
        let charts = charts.unwrap_or_default();
        let known = self.known.clone();
        let calculation = move || {
            known.charts(charts).map_err(|why| Invalid::new("charts", why.to_string()))?;
            let targets = ready.into_iter().map(|(feature, key, way)| proposed(feature, key, &way)).collect();
            Ok::<_, Invalid>(Proposal { targets, rule, charts })
        };
        Ok(self.calculate(calculation).await??)
    }

    /// Looks up the values that a method needs.
    async fn ready(
        &self,
        scope: &Scope,
        of: TaskId,
        feature: &'static Feature,
        key: &FeatureKey,
        way: Way,
    ) -> Result<Ready, CohortsError> {
        Ok(match way {
            Way::Fixed { limit, unit } => Ready::Chosen(fixed(feature, limit, &unit)?),
            Way::Fls { preset } => Ready::Chosen(published(key, &preset)?),
            Way::TrimmedExperts { experts } => Ready::Experts(self.group(scope, of, key, "experts", &experts).await?),
            Way::ContrastingGroups { novices, experts } => {
                let novices = self.group(scope, of, key, "novices", &novices).await?;
                let experts = self.group(scope, of, key, "experts", &experts).await?;
                if key.tool.is_some() && novices.handedness != experts.handedness {
                    let why =
                        "prefer another hand than the novices, but a tool is in one hand: choose people of one hand";
                    return Err(Invalid::new("experts", why).into());
                }
                Ready::Groups(novices, experts)
            }
            Way::BestShare { cohort, share } => {
                if !(share > 0.0 && share < 1.0) {
                    return Err(
                        Invalid::new("share", format!("is {share}; expected between 0 and 1, both excluded")).into()
                    );
                }
                Ready::Best(self.group(scope, of, key, "cohort", &cohort).await?, share)
            }
        })
    }

    async fn group(
        &self,
        scope: &Scope,
        task: TaskId,
        of: &FeatureKey,
        field: &'static str,
        cohort: &Key,
    ) -> Result<Group, CohortsError> {
        if !scope.is_administrator() {
            // A user who chooses the people of a limit and sees the values of some of them can compute the others'
            // values.
            return Err(StoreError::Forbidden { what: "a limit made from people", whom: "administrators" }.into());
        }
        let Cohort { id, handedness, .. } = self.store.cohorts().get(scope, cohort).await.map_err(named(field))?;
        if is_of_one_camera(of) {
            let why = "depends on the camera's direction, which differs between boxes: choose a fixed limit, or a feature \
                       that does not depend on it, such as path_length in 3d";
            return Err(Invalid::new("feature", why).into());
        }
        if of.tool.is_some() && handedness.is_none() {
            let why = "has people who prefer either hand, but a tool is in one hand: choose a cohort of one preferred hand, \
                       or limit a feature of the whole session";
            return Err(Invalid::new(field, why).into());
        }
        let values = self.store.cohorts().values(id, task, LAST_SESSIONS, std::slice::from_ref(of)).await?;
        Ok(Group { handedness, values })
    }
}

/// Limit of a tool name's length, characters.
const LONGEST_TOOL: usize = 64;

/// The feature of a limit, as the request names it.
#[derive(Clone, Copy)]
pub(super) struct Limited<'t> {
    /// Stable name of the feature.
    pub feature: &'t str,
    /// The tool's marker.
    pub tool: Option<&'t str>,
    /// The space that it is measured in.
    pub space: Option<FeatureSpace>,
}

/// Finds the feature that a target limits, and checks that it can have a limit.
pub(super) fn limited(target: Limited<'_>) -> Result<(&'static Feature, FeatureKey), Invalid> {
    let feature = feature::named(target.feature)?;
    let space = feature::space_of(feature, target.space)?;
    if feature.direction == Direction::Neither {
        let why = format!("cannot have a limit: neither a higher nor a lower {} is better", feature.name);
        return Err(Invalid::new("feature", why));
    }
    let name = feature.name;
    match target.tool {
        None if !feature.is_of_session() => {
            Err(Invalid::new("tool", format!("is missing: {name} is measured for each tool, so name one")))
        }
        Some(_) if !feature.is_of_tools() => {
            Err(Invalid::new("tool", format!("must be left out: {name} is measured for the whole session")))
        }
        Some(tool) if tool.is_empty() || tool.chars().count() > LONGEST_TOOL => {
            Err(Invalid::new("tool", format!("is not a tool's name: expected 1 to {LONGEST_TOOL} characters")))
        }
        _ => Ok((feature, FeatureKey { feature: name.to_owned(), tool: target.tool.map(str::to_owned), space })),
    }
}

fn fixed(feature: &Feature, limit: f64, unit: &str) -> Result<standard::Target, Invalid> {
    if unit != feature.unit {
        return Err(Invalid::new("unit", format!("is `{unit}`; {} is measured in `{}`", feature.name, feature.unit)));
    }
    let (least, most) = feature.range;
    if !(least..=most).contains(&limit) {
        return Err(Invalid::new("limit", format!("is {limit}; {} lies between {least} and {most}", feature.name)));
    }
    standard::Target::fixed(limit, feature.direction).map_err(|why| Invalid::new("limit", why.to_string()))
}

fn published(key: &FeatureKey, preset: &str) -> Result<standard::Target, Invalid> {
    if key.feature != time::DURATION.name || key.tool.is_some() {
        return Err(Invalid::new("method", "fls gives times: use it only for the duration of the whole session"));
    }
    let known = fls::FLS.iter().find(|known| known.task == preset);
    known.map(|known| known.duration).ok_or_else(|| {
        let names: Vec<&str> = fls::FLS.iter().map(|known| known.task).collect();
        Invalid::new("preset", format!("`{preset}` is unknown; use one of {}", names.join(", ")))
    })
}

fn proposed(feature: &'static Feature, key: FeatureKey, way: &Ready) -> Proposed {
    match target(feature, &key, way) {
        Ok((target, from)) => Proposed { target: Some(Target::of(key, feature, target, from)), withheld: None },
        Err(why) => Proposed { target: None, withheld: Some(why.into()) },
    }
}

fn target(feature: &Feature, key: &FeatureKey, way: &Ready) -> Result<(standard::Target, Option<MadeFrom>), NoAnswer> {
    let from = |groups: &[&People], handedness| {
        let handedness = key.tool.as_ref().and(handedness);
        Some(MadeFrom { pipeline: PIPELINE_VERSION.to_owned(), fingerprint: Some(fingerprint(groups)), handedness })
    };
    Ok(match way {
        Ready::Chosen(target) => (*target, None),
        Ready::Experts(experts) => {
            let people = experts.people(key)?;
            (trimmed_experts(&people, feature.direction)?, from(&[&people], experts.handedness))
        }
        Ready::Groups(novices, experts) => {
            let [novice_people, expert_people] = apart(novices, experts, key)?;
            let target = contrasting_groups(&novice_people, &expert_people, feature.direction)?;
            (target, from(&[&novice_people, &expert_people], experts.handedness))
        }
        Ready::Best(group, share) => {
            let people = group.people(key)?;
            (best_share(&people, *share, feature.direction)?, from(&[&people], group.handedness))
        }
    })
}

/// The people of both groups. Fails if a person is in both.
fn apart(novices: &Group, experts: &Group, key: &FeatureKey) -> Result<[People; 2], NoAnswer> {
    let trainees = |group: &Group| -> Vec<TraineeId> {
        group.like(key).rows(&group.values).into_iter().map(|(trainee, _)| trainee).collect()
    };
    let experts_are = trainees(experts);
    if trainees(novices).iter().any(|novice| experts_are.contains(novice)) {
        return Err(NoAnswer::PersonTwice);
    }
    Ok([novices.people(key)?, experts.people(key)?])
}

impl Group {
    fn like<'l>(&self, of: &'l FeatureKey) -> Like<'l> {
        Like { of, pipeline: PIPELINE_VERSION, calibration: None, handedness: self.handedness, without: None }
    }

    fn people(&self, of: &FeatureKey) -> Result<People, NoAnswer> {
        self.like(of).people(&self.values)
    }
}
