//! Judges a trainee's sessions against a standard: passes and misses, pass rule, charts, reminders.

use super::answer::{
    ChartEvent, ChartPoint, Charts, EventName, Passed, PassedBy, Reminder, ReminderState, RuleStanding, RuleState,
    StandingName,
};
use super::series::Numbered;
use crate::domain::session::SessionStatus;
use crate::domain::standard::{ChartDesign, Definition, Rule, Target};
use crate::domain::trainee::Handedness;
use crate::pipeline::score::Trial;
use crate::pipeline::score::lc_cusum::{Career, Event, Monitor, Point, Standing};
use crate::pipeline::score::pass_rule::{self, PassRule};
use crate::pipeline::score::reminder::{self, State, reminders};
use crate::pipeline::score::standard::Judgement;
use crate::store::Practised;
use crate::time::to_rfc3339;

/// The judgement of a standard on the sessions.
pub struct Verdicts {
    /// One per session, up to the last session with a result.
    pub trials: Vec<Trial>,
    /// State of the pass rule, if there is one.
    pub rule: Option<RuleState>,
    /// The charts.
    pub charts: Charts,
    /// Index of the session that showed proficiency, and the criterion; `None` before proficiency and after a relapse.
    proficient: Option<(usize, PassedBy)>,
    /// Indices of the passes that count for the proficiency.
    made_of: Vec<usize>,
}

impl Verdicts {
    /// Judges the sessions in order. `sessions` must not contain sessions that are set aside, because they are no
    /// trials.
    pub fn of(
        definition: &Definition,
        monitor: &Monitor,
        sessions: &[Numbered<'_>],
        handedness: Option<Handedness>,
    ) -> Self {
        let trials = trials(definition, sessions, handedness);
        let numbers: Vec<usize> = sessions.iter().map(|session| session.number).collect();
        let followed = definition.rule.map(|rule| (rule, PassRule::from(rule).follow(&trials)));
        let career = monitor.follow(&trials);
        let last_declared = career.events.last().map(|event| number_of(*event) - 1);
        let has_relapsed = career.events.iter().any(|event| matches!(event, Event::Relapsed { .. }));
        let by_charts = last_declared.map(|index| (index, PassedBy::Charts));
        let proficient = match (&followed, career.now) {
            (_, Standing::Relapsed) => None,
            (_, Standing::Proficient) if has_relapsed => by_charts,
            (Some((_, Ok(pass_rule::Progress::Met { at }))), _) => Some((at - 1, PassedBy::Rule)),
            (None, Standing::Proficient) => by_charts,
            _ => None,
        };
        let made_of = match proficient {
            Some((_, PassedBy::Rule)) => {
                definition.rule.map_or_else(Vec::new, |rule| PassRule::from(rule).made_of(&trials))
            }
            Some((last, PassedBy::Charts)) => {
                let relapse = career.events.iter().rev().find(|event| matches!(event, Event::Relapsed { .. }));
                let from = relapse.map_or(0, |event| number_of(*event));
                (from..=last).filter(|index| trials.get(*index) == Some(&Trial::Passed)).collect()
            }
            None => Vec::new(),
        };
        let rule = followed.and_then(|(rule, followed)| Some(rule_state(rule, followed.ok()?, &numbers)));
        Self { charts: charts(definition.charts, monitor, &career, &numbers), trials, rule, proficient, made_of }
    }

    /// When the task was passed, and the criterion.
    pub fn passed(&self, sessions: &[Numbered<'_>]) -> Option<Passed> {
        let (index, by) = self.proficient?;
        let session = sessions.get(index)?;
        let made_of = self.made_of.iter().filter_map(|index| sessions.get(*index)).map(|session| session.number);
        let at = to_rfc3339(session.session.recorded_at_ms);
        Some(Passed { by, session: session.number, at, sessions: made_of.collect() })
    }

    /// The refreshers and their current states.
    pub fn reminders(&self, sessions: &[Numbered<'_>], now_ms: i64) -> Vec<Reminder> {
        let Some(since) = self.proficient.and_then(|(index, _)| sessions.get(index)) else { return Vec::new() };
        let counted = sessions.iter().filter(|session| session.counts).map(|session| session.session.recorded_at_ms);
        let practised: Vec<i64> = counted.collect();
        let answer = |reminder: reminder::Reminder| {
            let (state, done_at) = match reminder.state {
                State::Ahead => (ReminderState::Ahead, None),
                State::Due => (ReminderState::Due, None),
                State::Done(at) => (ReminderState::Done, Some(to_rfc3339(at))),
            };
            Reminder { due_at: to_rfc3339(reminder.due_ms), state, done_at }
        };
        reminders(since.session.recorded_at_ms, &practised, now_ms).map(answer).into()
    }
}

/// The outcome of each session, up to the last session with a result. Earlier sessions that are not tracked yet are
/// unknown, because they may be misses; later ones are left out.
fn trials(definition: &Definition, sessions: &[Numbered<'_>], handedness: Option<Handedness>) -> Vec<Trial> {
    let pending = |session: &Numbered<'_>| {
        let Practised { result, status, .. } = session.session;
        result.is_none() && *status != SessionStatus::Failed
    };
    let ended = sessions.iter().rposition(|session| !pending(session)).map_or(0, |last| last + 1);
    let trial = |session: &Numbered<'_>| {
        if !session.counts {
            return Trial::Unknown;
        }
        let judged = |target: &Target| {
            let judged = session.evidence(&target.of, handedness);
            judged.map_or(Judgement::NotMeasured, |judged| target.judge(judged).into())
        };
        Trial::of_all(&definition.targets.iter().map(judged).collect::<Vec<_>>())
    };
    sessions[..ended].iter().map(trial).collect()
}

fn rule_state(rule: Rule, followed: pass_rule::Progress, numbers: &[usize]) -> RuleState {
    let in_state = |state| RuleState { rule, state, met_at: None, have_in_a_row: None, have_more: None, unknown: None };
    match followed {
        pass_rule::Progress::Met { at } => {
            RuleState { met_at: numbers.get(at - 1).copied(), ..in_state(RuleStanding::Met) }
        }
        pass_rule::Progress::OutOfReach => in_state(RuleStanding::OutOfReach),
        pass_rule::Progress::Open { in_a_row, more, unknown } => RuleState {
            have_in_a_row: Some(in_a_row),
            have_more: Some(more),
            unknown: Some(unknown),
            ..in_state(RuleStanding::Open)
        },
    }
}

fn number_of(event: Event) -> usize {
    match event {
        Event::Declared { at, .. } | Event::Relapsed { at, .. } => at,
    }
}

fn charts(design: ChartDesign, monitor: &Monitor, career: &Career, numbers: &[usize]) -> Charts {
    let by_then = |shares: &[f64]| shares.get(design.declare_within.saturating_sub(1)).copied();
    let (declares_at, alarms_at) = monitor.limits();
    let event = |event: &Event| {
        let session = numbers.get(number_of(*event) - 1).copied().unwrap_or_default();
        match *event {
            Event::Declared { judged, wrong_by_then, .. } => {
                ChartEvent { event: EventName::Declared, session, judged, wrong_by_then }
            }
            Event::Relapsed { judged, .. } => {
                ChartEvent { event: EventName::Relapsed, session, judged, wrong_by_then: None }
            }
        }
    };
    let point = |(number, point): (&usize, &Option<Point>)| {
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
        standing: match career.now {
            Standing::NotYet => StandingName::NotYet,
            Standing::Proficient => StandingName::Proficient,
            Standing::Relapsed => StandingName::Relapsed,
        },
        judged: career.judged,
        events: career.events.iter().map(event).collect(),
        path: numbers.iter().zip(&career.path).map(point).collect(),
    }
}
