//! Judges a trainee's sessions against one version of a standard: passes and misses, pass rule, charts, reminders.

use super::answer::{
    ChartEvent, ChartPoint, Charts, EventName, PassedBy, Refresher, RefresherState, RuleStanding, RuleState,
    StandingName, TaskPassed,
};
use super::series::NumberedSession;
use super::versions::StandardVersion;
use crate::domain::session::SessionStatus;
use crate::domain::standard::{ChartDesign, StandardDefinition, StandardRule, Target};
use crate::statistics::TrialOutcome;
use crate::statistics::lc_cusum::{CompetenceEvent, CompetenceHistory, LcCusumMonitor, LcCusumPoint, Standing};
use crate::statistics::pass_rule::{self, PassRule};
use crate::statistics::reminder::{self, ReminderState, reminders};
use crate::statistics::standard::TargetJudgement;
use crate::store::PracticeSession;
use crate::time::to_rfc3339;

/// The judgement of one version of a standard on the sessions that arrived while it was valid.
pub struct Verdicts<'p> {
    /// The version: 1, 2, … within the task.
    pub version: i64,
    /// The sessions, in the order of arrival.
    sessions: Vec<NumberedSession<'p>>,
    /// One per session, up to the last session with a result.
    trials: Vec<TrialOutcome>,
    /// State of the pass rule, if there is one.
    pub rule: Option<RuleState>,
    /// The charts.
    pub charts: Charts,
    /// Index of the session that showed proficiency, and the criterion; `None` before proficiency and after a relapse.
    proficient: Option<(usize, PassedBy)>,
    /// Indices of the passes that count for the proficiency.
    counted_passes: Vec<usize>,
}

impl<'p> Verdicts<'p> {
    /// Judges those of the sessions that count for this version, in order. `sessions` must not contain sessions that are
    /// set aside, because they are no trials.
    pub fn of(version: &StandardVersion, sessions: &[NumberedSession<'p>]) -> Self {
        let StandardVersion { definition, monitor, .. } = version;
        let counted = sessions.iter().filter(|session| version.counts(session.session.created_at_ms));
        let sessions: Vec<NumberedSession<'p>> = counted.copied().collect();
        let trials = trials(definition, &sessions);
        let numbers: Vec<usize> = sessions.iter().map(|session| session.number).collect();
        let followed = definition.rule.map(|rule| (rule, PassRule::from(rule).evaluate(&trials)));
        let career = monitor.follow(&trials);
        let last_declared = career.events.last().map(|event| event_session(*event) - 1);
        let has_relapsed = career.events.iter().any(|event| matches!(event, CompetenceEvent::Relapsed { .. }));
        let by_charts = last_declared.map(|index| (index, PassedBy::Charts));
        let proficient = match (&followed, career.standing) {
            (_, Standing::Relapsed) => None,
            (_, Standing::Proficient) if has_relapsed => by_charts,
            (Some((_, Ok(pass_rule::PassProgress::Met { at }))), _) => Some((at - 1, PassedBy::Rule)),
            (None, Standing::Proficient) => by_charts,
            _ => None,
        };
        let counted_passes = match proficient {
            Some((_, PassedBy::Rule)) => {
                definition.rule.map_or_else(Vec::new, |rule| PassRule::from(rule).counted_passes(&trials))
            }
            Some((last, PassedBy::Charts)) => {
                let relapse =
                    career.events.iter().rev().find(|event| matches!(event, CompetenceEvent::Relapsed { .. }));
                let from = relapse.map_or(0, |event| event_session(*event));
                (from..=last).filter(|index| trials.get(*index) == Some(&TrialOutcome::Passed)).collect()
            }
            None => Vec::new(),
        };
        let rule = followed.and_then(|(rule, followed)| Some(rule_state(rule, followed.ok()?, &numbers)));
        let charts = charts(definition.charts, monitor, &career, &numbers);
        Self { version: version.version, sessions, trials, rule, charts, proficient, counted_passes }
    }

    /// The judgement under which the task is passed: the newest, of versions given newest first. `None` if none is, or
    /// after a relapse under a newer version.
    pub fn earned<'v>(newest_first: impl Iterator<Item = &'v Self>) -> Option<&'v Self>
    where
        'p: 'v,
    {
        for verdicts in newest_first {
            if verdicts.proficient.is_some() {
                return Some(verdicts);
            }
            if verdicts.charts.standing == StandingName::Relapsed {
                return None;
            }
        }
        None
    }

    /// The sessions with their outcomes, up to the last session with a result.
    pub fn outcomes(&self) -> impl Iterator<Item = (&NumberedSession<'p>, TrialOutcome)> {
        self.sessions.iter().zip(self.trials.iter().copied())
    }

    /// When the task was passed, and the criterion.
    pub fn passed(&self) -> Option<TaskPassed> {
        let (index, by) = self.proficient?;
        let session = self.sessions.get(index)?;
        let made_of = self.counted_passes.iter().filter_map(|index| self.sessions.get(*index));
        let sessions = made_of.map(|session| session.number).collect();
        let at = to_rfc3339(session.session.recorded_at_ms);
        Some(TaskPassed { by, standard: self.version, session: session.number, at, sessions })
    }

    /// The refreshers and their current states, with all sessions as practice.
    pub fn reminders(&self, sessions: &[NumberedSession<'_>], now_ms: i64) -> Vec<Refresher> {
        let Some(since) = self.proficient.and_then(|(index, _)| self.sessions.get(index)) else { return Vec::new() };
        let counted = sessions.iter().filter(|session| session.counts).map(|session| session.session.recorded_at_ms);
        let practised: Vec<i64> = counted.collect();
        let answer = |reminder: reminder::Reminder| {
            let (state, done_at) = match reminder.state {
                ReminderState::Ahead => (RefresherState::Ahead, None),
                ReminderState::Due => (RefresherState::Due, None),
                ReminderState::Done(at) => (RefresherState::Done, Some(to_rfc3339(at))),
            };
            Refresher { due_at: to_rfc3339(reminder.due_ms), state, done_at }
        };
        reminders(since.session.recorded_at_ms, &practised, now_ms).map(answer).into()
    }
}

/// The outcome of each session, up to the last session with a result. Earlier sessions that are not tracked yet are
/// unknown, because they may be misses; later ones are left out.
fn trials(definition: &StandardDefinition, sessions: &[NumberedSession<'_>]) -> Vec<TrialOutcome> {
    let pending = |session: &NumberedSession<'_>| {
        let PracticeSession { result, status, .. } = session.session;
        result.is_none() && *status != SessionStatus::Failed
    };
    let ended = sessions.iter().rposition(|session| !pending(session)).map_or(0, |last| last + 1);
    let trial = |session: &NumberedSession<'_>| {
        if !session.counts {
            return TrialOutcome::Unknown;
        }
        let judged = |target: &Target| {
            let judged = session.value_to_judge(&target.of);
            judged.map_or(TargetJudgement::NotMeasured, |judged| target.judge(judged).into())
        };
        TrialOutcome::of_all(&definition.targets.iter().map(judged).collect::<Vec<_>>())
    };
    sessions[..ended].iter().map(trial).collect()
}

fn rule_state(rule: StandardRule, followed: pass_rule::PassProgress, numbers: &[usize]) -> RuleState {
    let in_state = |state| RuleState { rule, state, met_at: None, have_in_a_row: None, have_more: None, unknown: None };
    match followed {
        pass_rule::PassProgress::Met { at } => {
            RuleState { met_at: numbers.get(at - 1).copied(), ..in_state(RuleStanding::Met) }
        }
        pass_rule::PassProgress::OutOfReach => in_state(RuleStanding::OutOfReach),
        pass_rule::PassProgress::Open { in_a_row, more, unknown } => RuleState {
            have_in_a_row: Some(in_a_row),
            have_more: Some(more),
            unknown: Some(unknown),
            ..in_state(RuleStanding::Open)
        },
    }
}

fn event_session(event: CompetenceEvent) -> usize {
    match event {
        CompetenceEvent::Declared { at, .. } | CompetenceEvent::Relapsed { at, .. } => at,
    }
}

fn charts(design: ChartDesign, monitor: &LcCusumMonitor, career: &CompetenceHistory, numbers: &[usize]) -> Charts {
    let by_then = |shares: &[f64]| shares.get(design.declare_within.saturating_sub(1)).copied();
    let (declares_at, alarms_at) = monitor.limits();
    let event = |event: &CompetenceEvent| {
        let session = numbers.get(event_session(*event) - 1).copied().unwrap_or_default();
        match *event {
            CompetenceEvent::Declared { judged, wrong_by_then, .. } => {
                ChartEvent { event: EventName::Declared, session, judged, wrong_by_then }
            }
            CompetenceEvent::Relapsed { judged, .. } => {
                ChartEvent { event: EventName::Relapsed, session, judged, wrong_by_then: None }
            }
        }
    };
    let point = |(number, point): (&usize, &Option<LcCusumPoint>)| {
        point.map(|point| ChartPoint { session: *number, learning: point.learning, score: point.score })
    };
    Charts {
        design,
        declared_wrongly: by_then(&monitor.declared_wrongly),
        declared_rightly: by_then(&monitor.declared_rightly),
        relapse_found_median: monitor.relapse_found_median,
        relapse_found_90: monitor.relapse_found_90,
        declares_at,
        alarms_at,
        standing: match career.standing {
            Standing::NotYet => StandingName::NotYet,
            Standing::Proficient => StandingName::Proficient,
            Standing::Relapsed => StandingName::Relapsed,
        },
        judged: career.judged,
        events: career.events.iter().map(event).collect(),
        path: numbers.iter().zip(&career.path).map(point).collect(),
    }
}
