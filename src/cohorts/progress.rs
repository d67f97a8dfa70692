//! A trainee's sessions of a task over time.
//!
//! Sessions are numbered in the order of recording, as their senders state it. They are judged in the order of
//! arrival, each by the version of the standard of its day ([`super::versions`]): which passes come in a row, the charts,
//! proficiency. All of them are practice and have a number, but sessions that are
//! refused, failed, set aside or of another pipeline version do not count otherwise. The version that counts is that of
//! the newest valid result: after an update of the program, older sessions count again once they are rescored.

use std::collections::{BTreeSet, HashMap, HashSet};

use super::answer::{ProgressAnswer, SessionStep, SetAside};
use super::cache::ComputedCache;
use super::error_scores::{PracticeScores, error_score_series};
use super::people::LAST_SESSIONS;
use super::series::{NumberedSession, TraineeContext, feature_series};
use super::verdicts::Verdicts;
use super::versions::TaskStandards;
use super::{Cohorts, CohortsError, unknown_field};
use crate::domain::feature::{FeatureKey, resolve_space};
use crate::domain::hand::Hand;
use crate::domain::scope::Scope;
use crate::domain::session::{BoxQuestion, FeatureSpace, SessionStatus};
use crate::domain::text::{Invalid, Key};
use crate::domain::trainee::Handedness;
use crate::ids::{SessionId, TaskId};
use crate::motion::features::{self, FEATURES, Feature, time};
use crate::statistics::TrialOutcome;
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
    /// Only this hand.
    pub in_hand: Option<Hand>,
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
    /// The version of the task's standard that judges recordings that arrive now.
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
        let (standards, standard) = self.task_standards(scope, task.id).await?;
        let shown = FeatureSelection::of(&asked, &standards)?;
        let mut features = shown.features();
        if !features.contains(&&time::DURATION) {
            features.push(&time::DURATION); // for the error score
        }
        let practice = self.store.sessions().practice(scope, trainee.id, task.id, &features, MAX_SESSIONS).await?;
        let scores = self.practice_scores(scope, task.id, &practice.sessions).await?;
        let keys = shown.keys([&practice]);
        let among = match &cohort {
            Some(cohort) => Some(self.store.cohorts().values(cohort.id, task.id, LAST_SESSIONS, &keys).await?),
            None => None,
        };
        let (known, now_ms) = (self.cache.clone(), self.clock.now_ms());
        let (id, handedness) = (trainee.id, trainee.handedness);
        let calculation = move || {
            let context = TraineeContext { trainee: id, handedness, among: among.as_deref() };
            progress_answer((&practice, &scores), (&shown, keys), &standards, &context, &known, now_ms)
        };
        let course = self.calculate(calculation).await?;
        Ok(TraineeProgress { trainee, task: Some(task), standard, cohort, answer: course })
    }

    /// The versions of a task's standard, and the one that judges recordings that arrive now.
    pub(super) async fn task_standards(
        &self,
        scope: &Scope,
        task: TaskId,
    ) -> Result<(TaskStandards, Option<StandardRecord>), CohortsError> {
        let records = self.store.standards().of_tasks(scope, &[task]).await?;
        let now_ms = self.clock.now_ms();
        let current = records.iter().find(|record| record.valid_from_ms <= now_ms).cloned();
        let known = self.cache.clone();
        let standards = self.calculate(move || TaskStandards::of(records, &known, now_ms)).await?;
        Ok((standards, current))
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
    pub(super) fn of(asked: &ProgressSelection, standards: &TaskStandards) -> Result<Self, CohortsError> {
        if asked.tool.is_some() && asked.in_hand.is_some() {
            return Err(Invalid::new("tool", "must be left out where `in_hand` names a hand").into());
        }
        let judged = standards.limited_features();
        let current = standards.current().map_or(&[][..], |version| &version.definition.targets);
        let feature = match &asked.feature {
            Some(name) => features::find(name).map_err(Invalid::from)?,
            None if !current.is_empty() => {
                let is_asked = |of: &FeatureKey| {
                    (asked.tool.is_none() || of.tool == asked.tool)
                        && (asked.in_hand.is_none() || of.in_hand == asked.in_hand)
                        && asked.space.is_none_or(|space| of.space == space)
                };
                let keys = current.iter().map(|target| &target.of).filter(|of| is_asked(of));
                let keys: Vec<FeatureKey> = keys.cloned().collect();
                if keys.is_empty() {
                    let why = "has no limit in the task's standard: name a feature as well";
                    return Err(Invalid::new(asked.named_field(), why).into());
                }
                return Ok(Self { keys, of_all_tools: None, judged });
            }
            None => DEFAULT_FEATURE,
        };
        let space = resolve_space(feature, asked.space)?;
        let is_of_one = asked.tool.is_some() || asked.in_hand.is_some();
        let (keys, of_all_tools) = match asked.feature {
            Some(_) if !is_of_one => (Vec::new(), Some((feature, space))),
            _ => (vec![FeatureKey { feature, tool: asked.tool.clone(), in_hand: asked.in_hand, space }], None),
        };
        Ok(Self { keys, of_all_tools, judged })
    }

    pub(super) fn features(&self) -> Vec<&'static Feature> {
        let keys = self.keys.iter().chain(&self.judged).map(|key| key.feature);
        let wanted: HashSet<&'static Feature> = keys.chain(self.of_all_tools.map(|(feature, _)| feature)).collect();
        FEATURES.iter().copied().filter(|feature| wanted.contains(feature)).collect()
    }

    /// True if the series of this feature has the session. Where a feature is shown for every tool, a session whose hands are
    /// known is in the series of the hands: that of a tool has only those whose hand is unknown.
    fn shows(&self, of: &FeatureKey, session: &NumberedSession<'_>) -> bool {
        let Some(tool) = of.tool.as_ref().filter(|_| self.of_all_tools.is_some()) else { return true };
        session.session.result.as_ref().is_none_or(|result| result.hands.side_of(tool).is_none())
    }

    /// The feature to show if none of the sessions has a value for it.
    pub(super) fn default_key(&self) -> FeatureKey {
        let (feature, space) = self.of_all_tools.unwrap_or((DEFAULT_FEATURE, FeatureSpace::Space3d));
        FeatureKey::of_session(feature, space)
    }

    /// The features to show. For a feature of all tools: that of the whole session, of the left and the right hand, and
    /// of each tool whose hand no session says, in the order of names.
    pub(super) fn keys<'p>(&self, practised: impl IntoIterator<Item = &'p Practice>) -> Vec<FeatureKey> {
        let Some((feature, space)) = self.of_all_tools else { return self.keys.clone() };
        let mut found: BTreeSet<(Option<u8>, Option<&str>)> = BTreeSet::new();
        for session in practised.into_iter().flat_map(|practice| &practice.sessions) {
            let hands = session.result.as_ref().map(|result| &result.hands);
            let measured = session.measured.iter().map(|measured| &measured.of);
            for of in measured.filter(|of| of.feature == feature && of.space == space) {
                let tool = of.tool.as_deref();
                found.insert(match tool.and_then(|tool| hands?.side_of(tool)) {
                    Some(side) => (Some(side as u8), None),
                    None => (None, tool),
                });
            }
        }
        let (of_hands, mut keys): (Vec<_>, Vec<_>) = found.into_iter().partition(|(side, _)| side.is_some());
        keys.sort_by_key(|(_, tool)| *tool);
        let whole = keys.iter().take_while(|(_, tool)| tool.is_none()).count();
        keys.splice(whole..whole, of_hands);
        let side = |side: u8| if side == Hand::Left as u8 { Hand::Left } else { Hand::Right };
        let key = |(of, tool): (Option<u8>, Option<&str>)| FeatureKey {
            feature,
            tool: tool.map(str::to_owned),
            in_hand: of.map(side),
            space,
        };
        keys.into_iter().map(key).collect()
    }
}

impl ProgressSelection {
    /// The field that names a tool, hand or space.
    fn named_field(&self) -> &'static str {
        match (&self.tool, self.in_hand) {
            (Some(_), _) => "tool",
            (None, Some(_)) => "in_hand",
            (None, None) => "space",
        }
    }
}

/// The progress over these sessions.
fn progress_answer(
    (practice, scores): (&Practice, &PracticeScores),
    (shown, keys): (&FeatureSelection, Vec<FeatureKey>),
    standards: &TaskStandards,
    context: &TraineeContext<'_>,
    known: &ComputedCache,
    now_ms: i64,
) -> ProgressAnswer {
    let (sessions, course) = judge_sessions(practice, standards, context.handedness, now_ms);
    let of = |key: &FeatureKey| {
        let sessions: Vec<NumberedSession<'_>> =
            sessions.iter().filter(|session| shown.shows(key, session)).copied().collect();
        feature_series(key, &sessions, standards, context, known)
    };
    let error_scores = error_score_series(&sessions, scores);
    ProgressAnswer { features: keys.iter().map(of).collect(), error_scores, ..course }
}

/// Numbers the sessions and judges them. The answer's features are still empty.
pub(super) fn judge_sessions<'p>(
    practice: &'p Practice,
    standards: &TaskStandards,
    preferred: Option<Handedness>,
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
        preferred,
    };
    let sessions: Vec<NumberedSession<'_>> = practice.sessions.iter().enumerate().map(number).collect();
    let by_arrival = in_order_of_arrival(&sessions);
    let verdicts: Vec<Verdicts> = standards.newest_first().map(|version| Verdicts::of(version, &by_arrival)).collect();
    let mut trials: HashMap<SessionId, (i64, TrialOutcome)> = HashMap::new();
    for verdicts in verdicts.iter().rev() {
        let judged = verdicts.outcomes().filter(|(at, _)| {
            standards.at(at.session.created_at_ms).is_some_and(|version| version.version == verdicts.version)
        });
        trials.extend(judged.map(|(at, outcome)| (at.session.id, (verdicts.version, outcome))));
    }
    let current = standards.current().and_then(|now| verdicts.iter().find(|of| of.version == now.version));
    let earned = Verdicts::earned(verdicts.iter().filter(|of| current.is_some_and(|now| of.version <= now.version)));
    let step = |at: &NumberedSession<'_>| SessionStep {
        number: at.number,
        id: at.session.id,
        recorded_at: to_rfc3339(at.session.recorded_at_ms),
        recorded_at_source: at.session.recorded_at_source,
        date_known: at.session.date_known,
        supervision: at.session.supervision,
        created_at: to_rfc3339(at.session.created_at_ms),
        status: at.session.status,
        set_aside: set_aside(at.session),
        standard: trials.get(&at.session.id).map(|(version, _)| *version),
        trial: trials.get(&at.session.id).map(|(_, trial)| (*trial).into()),
    };
    let course = ProgressAnswer {
        pipeline: pipeline.clone(),
        earlier: practice.earlier,
        sessions: sessions.iter().map(step).collect(),
        features: Vec::new(),
        error_scores: Vec::new(),
        rule: current.and_then(|verdicts| verdicts.rule.clone()),
        reminders: earned.map_or_else(Vec::new, |verdicts| verdicts.reminders(&by_arrival, now_ms)),
        passed: earned.and_then(Verdicts::passed),
        charts: current.map(|verdicts| verdicts.charts.clone()),
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
        _ if session.is_voided => return Some(SetAside::Voided),
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
