//! A trainee's sessions of a task over time.
//!
//! Sessions are numbered in the order of recording, as their senders state it. They are judged in the order of
//! arrival: which passes come in a row, the charts, proficiency. All of them are practice and have a number, but sessions that are
//! refused, failed, set aside or of another pipeline version do not count otherwise. The version that counts is that of
//! the newest valid result: after an update of the program, older sessions count again once they are rescored.

use std::collections::{HashMap, HashSet};

use super::answer::{ProgressAnswer, SessionStep, SetAside};
use super::cache::ComputedCache;
use super::people::LAST_SESSIONS;
use super::series::{NumberedSession, TraineeContext, feature_series};
use super::verdicts::Verdicts;
use super::{Cohorts, CohortsError, unknown_field};
use crate::domain::feature::{FeatureKey, resolve_space};
use crate::domain::scope::Scope;
use crate::domain::session::{BoxQuestion, FeatureSpace, SessionStatus};
use crate::domain::standard::StandardDefinition;
use crate::domain::text::{Invalid, Key};
use crate::domain::trainee::Handedness;
use crate::ids::SessionId;
use crate::motion::features::{self, FEATURES, Feature, time};
use crate::statistics::TrialOutcome;
use crate::statistics::lc_cusum::LcCusumMonitor;
use crate::store::{CohortRecord, Practice, PracticeSession, StandardRecord, TaskRecord, TraineeRecord};
use crate::time::to_rfc3339;

/// Limit of sessions; the newest ones are used.
pub const MAX_SESSIONS: u32 = 1000;

/// The feature that is shown if neither the request nor a standard names one.
static DEFAULT_FEATURE: &Feature = &time::DURATION;

/// Selects the task, the features and the cohort of a progress request.
#[derive(Clone, Debug, Default)]
pub struct ProgressSelection {
    /// The task; by default that of the trainee's newest session.
    pub task: Option<Key>,
    /// The feature; by default the features that the standard limits.
    pub feature: Option<String>,
    /// Only this tool.
    pub tool: Option<String>,
    /// The space; by default three dimensions, if the feature is measured there.
    pub space: Option<FeatureSpace>,
    /// The cohort to rank the trainee in.
    pub cohort: Option<Key>,
}

/// A trainee's progress at a task, with the objects that it refers to.
#[derive(Debug)]
pub struct TraineeProgress {
    /// The trainee.
    pub trainee: TraineeRecord,
    /// The task; `None` if none was named and the trainee has no session.
    pub task: Option<TaskRecord>,
    /// The task's standard.
    pub standard: Option<StandardRecord>,
    /// The cohort that the trainee is ranked in.
    pub cohort: Option<CohortRecord>,
    /// The progress.
    pub answer: ProgressAnswer,
}

impl Cohorts {
    /// A trainee's progress at a task.
    pub async fn progress(
        &self,
        scope: &Scope,
        trainee: &Key,
        asked: ProgressSelection,
    ) -> Result<TraineeProgress, CohortsError> {
        let trainee = self.store.trainees().get(scope, trainee).await?;
        let cohort = match &asked.cohort {
            Some(key) => Some(self.store.cohorts().get(scope, key).await.map_err(unknown_field("cohort"))?),
            None => None,
        };
        let Some(task) = self.selected_task(scope, &trainee, asked.task.as_ref()).await? else {
            return Ok(TraineeProgress {
                trainee,
                task: None,
                standard: None,
                cohort,
                answer: ProgressAnswer::default(),
            });
        };
        let standard = self.store.standards().in_use(scope, task.id).await?;
        let shown = FeatureSelection::of(&asked, standard.as_ref().map(|standard| &standard.definition))?;
        let features = shown.features();
        let practice = self.store.sessions().practice(scope, trainee.id, task.id, &features, MAX_SESSIONS).await?;
        let keys = shown.keys([&practice]);
        let among = match &cohort {
            Some(cohort) => Some(self.store.cohorts().values(cohort.id, task.id, LAST_SESSIONS, &keys).await?),
            None => None,
        };
        let (known, now_ms) = (self.cache.clone(), self.clock.now_ms());
        let (id, handedness) = (trainee.id, trainee.handedness);
        let definition = standard.as_ref().map(|standard| standard.definition.clone().without_fingerprints());
        let calculation = move || {
            let context = TraineeContext { trainee: id, handedness, among: among.as_deref() };
            let monitor = definition.as_ref().and_then(|definition| known.charts(definition.charts).ok());
            progress_answer(&practice, keys, definition.as_ref().zip(monitor.as_deref()), &context, &known, now_ms)
        };
        let course = self.calculate(calculation).await?;
        Ok(TraineeProgress { trainee, task: Some(task), standard, cohort, answer: course })
    }

    async fn selected_task(
        &self,
        scope: &Scope,
        of: &TraineeRecord,
        asked: Option<&Key>,
    ) -> Result<Option<TaskRecord>, CohortsError> {
        if let Some(key) = asked {
            return Ok(Some(self.store.tasks().get(scope, key).await.map_err(unknown_field("task"))?));
        }
        match self.store.sessions().last_task(scope, of.id).await? {
            Some(id) => Ok(Some(self.store.tasks().get(scope, &Key::from(&id)).await?)),
            None => Ok(None),
        }
    }
}

/// The features to show, and the features needed to judge the sessions.
pub(super) struct FeatureSelection {
    keys: Vec<FeatureKey>,
    /// A feature to show for every tool that has it.
    of_all_tools: Option<(&'static Feature, FeatureSpace)>,
    judged: Vec<FeatureKey>,
}

impl FeatureSelection {
    pub(super) fn of(asked: &ProgressSelection, standard: Option<&StandardDefinition>) -> Result<Self, CohortsError> {
        let judged: Vec<FeatureKey> = standard
            .map_or_else(Vec::new, |standard| standard.targets.iter().map(|target| target.of.clone()).collect());
        let feature = match &asked.feature {
            Some(name) => features::find(name).map_err(Invalid::from)?,
            None if !judged.is_empty() => {
                let is_asked = |of: &&FeatureKey| {
                    (asked.tool.is_none() || of.tool == asked.tool) && asked.space.is_none_or(|space| of.space == space)
                };
                let keys: Vec<FeatureKey> = judged.iter().filter(is_asked).cloned().collect();
                if keys.is_empty() {
                    let why = "has no limit in the task's standard: name a feature as well";
                    return Err(Invalid::new(if asked.tool.is_some() { "tool" } else { "space" }, why).into());
                }
                return Ok(Self { keys, of_all_tools: None, judged });
            }
            None => DEFAULT_FEATURE,
        };
        let space = resolve_space(feature, asked.space)?;
        let key = |tool| FeatureKey { feature, tool, space };
        let (keys, of_all_tools) = match (&asked.tool, &asked.feature) {
            (Some(tool), _) => (vec![key(Some(tool.clone()))], None),
            (None, Some(_)) => (Vec::new(), Some((feature, space))),
            (None, None) => (vec![key(None)], None),
        };
        Ok(Self { keys, of_all_tools, judged })
    }

    pub(super) fn features(&self) -> Vec<&'static Feature> {
        let keys = self.keys.iter().chain(&self.judged).map(|key| key.feature);
        let wanted: HashSet<&'static Feature> = keys.chain(self.of_all_tools.map(|(feature, _)| feature)).collect();
        FEATURES.iter().copied().filter(|feature| wanted.contains(feature)).collect()
    }

    /// The feature to show if none of the sessions has a value for it.
    pub(super) fn default_key(&self) -> FeatureKey {
        let (feature, space) = self.of_all_tools.unwrap_or((DEFAULT_FEATURE, FeatureSpace::Space3d));
        FeatureKey { feature, tool: None, space }
    }

    /// The features to show. For a feature of all tools: one per tool that has it in these sessions, in the order of
    /// names.
    pub(super) fn keys<'p>(&self, practised: impl IntoIterator<Item = &'p Practice>) -> Vec<FeatureKey> {
        let Some((feature, space)) = self.of_all_tools else { return self.keys.clone() };
        let sessions = practised.into_iter().flat_map(|practice| &practice.sessions);
        let measured = sessions.flat_map(|session| &session.measured).map(|measured| &measured.of);
        let mut tools: Vec<Option<String>> =
            measured.filter(|of| of.feature == feature && of.space == space).map(|of| of.tool.clone()).collect();
        tools.sort();
        tools.dedup();
        tools.into_iter().map(|tool| FeatureKey { feature, tool, space }).collect()
    }
}

/// The progress over these sessions.
fn progress_answer(
    practice: &Practice,
    keys: Vec<FeatureKey>,
    standard: Option<(&StandardDefinition, &LcCusumMonitor)>,
    context: &TraineeContext<'_>,
    known: &ComputedCache,
    now_ms: i64,
) -> ProgressAnswer {
    let (sessions, course) = judge_sessions(practice, standard, context.handedness, now_ms);
    let definition = standard.map(|(definition, _)| definition);
    let of = |key: &FeatureKey| feature_series(key, &sessions, definition, context, known);
    ProgressAnswer { features: keys.iter().map(of).collect(), ..course }
}

/// Numbers the sessions and judges them. The answer's features are still empty.
pub(super) fn judge_sessions<'p>(
    practice: &'p Practice,
    standard: Option<(&StandardDefinition, &LcCusumMonitor)>,
    handedness: Option<Handedness>,
    now_ms: i64,
) -> (Vec<NumberedSession<'p>>, ProgressAnswer) {
    let believed = |session: &'_ PracticeSession| {
        session.result.clone().filter(|outcome| !outcome.refused && !session.is_uncounted)
    };
    let newest = practice.sessions.iter().rev().find_map(believed);
    let pipeline = newest.map(|outcome| outcome.pipeline.clone());
    let set_aside = |session: &PracticeSession| set_aside_reason(session, pipeline.as_deref());
    let number = |(index, session)| NumberedSession {
        number: practice.earlier + index + 1,
        counts: set_aside(session).is_none(),
        session,
    };
    let sessions: Vec<NumberedSession<'_>> = practice.sessions.iter().enumerate().map(number).collect();
    let by_arrival = in_order_of_arrival(&sessions);
    let verdicts = standard.map(|(definition, monitor)| Verdicts::of(definition, monitor, &by_arrival, handedness));
    let trials = verdicts.iter().flat_map(|verdicts| &verdicts.trials);
    let trials: HashMap<SessionId, TrialOutcome> =
        by_arrival.iter().map(|at| at.session.id).zip(trials.copied()).collect();
    let step = |at: &NumberedSession<'_>| SessionStep {
        number: at.number,
        id: at.session.id,
        recorded_at: to_rfc3339(at.session.recorded_at_ms),
        recorded_at_source: at.session.recorded_at_source,
        created_at: to_rfc3339(at.session.created_at_ms),
        status: at.session.status,
        set_aside: set_aside(at.session),
        trial: trials.get(&at.session.id).map(|trial| (*trial).into()),
    };
    let course = ProgressAnswer {
        pipeline: pipeline.clone(),
        earlier: practice.earlier,
        sessions: sessions.iter().map(step).collect(),
        features: Vec::new(),
        rule: verdicts.as_ref().and_then(|verdicts| verdicts.rule.clone()),
        reminders: verdicts.as_ref().map_or_else(Vec::new, |verdicts| verdicts.reminders(&by_arrival, now_ms)),
        passed: verdicts.as_ref().and_then(|verdicts| verdicts.passed(&by_arrival)),
        charts: verdicts.map(|verdicts| verdicts.charts),
    };
    (sessions, course)
}

/// The sessions that are trials, in the order of arrival. The times of recordings are stated by their senders,
/// and must not decide which ones come in a row.
fn in_order_of_arrival<'p>(sessions: &[NumberedSession<'p>]) -> Vec<NumberedSession<'p>> {
    let mut trials: Vec<NumberedSession<'p>> = sessions.iter().filter(|at| !at.session.is_uncounted).copied().collect();
    trials.sort_by_key(|at| at.session.arrival);
    trials
}

fn set_aside_reason(session: &PracticeSession, pipeline: Option<&str>) -> Option<SetAside> {
    match session.box_question {
        Some(BoxQuestion::Asked) => return Some(SetAside::BoxAsked),
        Some(BoxQuestion::OtherBox) => return Some(SetAside::OtherBox),
        _ if session.is_uncounted => return Some(SetAside::ByHand),
        _ => {}
    }
    match (&session.result, session.status) {
        (None, SessionStatus::Failed) => Some(SetAside::Failed),
        (None, _) => Some(SetAside::Pending),
        (Some(outcome), _) if outcome.refused => Some(SetAside::Refused),
        (Some(outcome), _) if Some(outcome.pipeline.as_str()) != pipeline => Some(SetAside::OtherVersion),
        (Some(_), _) => None,
    }
}
