//! How somebody stands by a standard: pass rule, charts, reminders.

use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::named;
use crate::domain::standard::{ChartDesign, Rule};

/// How far by a pass rule.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct RuleState {
    /// The rule.
    #[serde(flatten)]
    pub rule: Rule,
    /// How it stands.
    pub state: RuleStanding,
    /// The session by which it was met.
    pub met_at: Option<usize>,
    /// Passes in a row so far, up to those that the rule asks for; `null` once it is met or out of reach.
    pub have_in_a_row: Option<usize>,
    /// Passes after these so far.
    pub have_more: Option<usize>,
    /// Sessions so far of which nobody knows whether they were passed.
    pub unknown: Option<usize>,
}

named! {
    /// How a pass rule stands.
    RuleStanding: "state" {
        /// Met.
        Met = "met",
        /// Not yet.
        Open = "open",
        /// It cannot be met any more, whatever the unknown sessions were.
        OutOfReach = "out_of_reach",
    }
}

/// What the charts say: LC-CUSUM until proficiency, CUSUM from then on. Shares are 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Charts {
    /// What they were designed for.
    pub design: ChartDesign,
    /// Share of inadequate trainees that are called proficient within `design.declare_within` judged sessions.
    pub declared_wrongly: Option<f64>,
    /// Share of adequate ones that are.
    pub declared_rightly: Option<f64>,
    /// Judged sessions after a relapse by which half of them are found; `null` beyond 200.
    pub relapse_found_median: Option<usize>,
    /// The same for nine of ten.
    pub relapse_found_90: Option<usize>,
    /// Score at which proficiency is told.
    pub declares_at: f64,
    /// Score at which a relapse is.
    pub alarms_at: f64,
    /// How the trainee stands.
    pub standing: StandingName,
    /// Judged sessions since the last event.
    pub judged: usize,
    /// Declarations and relapses, in turn.
    pub events: Vec<ChartEvent>,
    /// One point per session; `null` where nobody knows whether it was passed.
    pub path: Vec<Option<ChartPoint>>,
}

named! {
    /// How a trainee stands by the charts.
    StandingName: "standing" {
        /// The sessions so far do not show proficiency, nor the contrary.
        NotYet = "not_yet",
        /// Proficient.
        Proficient = "proficient",
        /// Was proficient, relapsed, and is not yet again.
        Relapsed = "relapsed",
    }
}

/// What happened on the charts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct ChartEvent {
    /// What.
    pub event: EventName,
    /// At which session.
    pub session: usize,
    /// Judged sessions that it took.
    pub judged: usize,
    /// Of a declaration: share of inadequate trainees who would have been declared by then too; `null` beyond 200.
    pub wrong_by_then: Option<f64>,
}

named! {
    /// An event on the charts.
    EventName: "event" {
        /// Declared proficient.
        Declared = "declared",
        /// Relapsed.
        Relapsed = "relapsed",
    }
}

/// A score on one of the charts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct ChartPoint {
    /// The session's number.
    pub session: usize,
    /// `true` while learning, `false` while keeping what was learnt.
    pub learning: bool,
    /// The score after it.
    pub score: f64,
}

/// By what a task counts as learnt.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Passed {
    /// By the pass rule, or by the charts.
    pub by: PassedBy,
    /// The session by which it was so.
    pub session: usize,
    /// When that was recorded.
    #[schema(format = "date-time")]
    pub at: String,
    /// The passes that made it: those that the rule counted, or all since the chart began that declared it.
    pub sessions: Vec<usize>,
}

named! {
    /// What says that a task is learnt.
    PassedBy: "by" {
        /// The standard's pass rule.
        Rule = "rule",
        /// The charts.
        Charts = "charts",
    }
}

/// A refresher.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Reminder {
    /// When it is due.
    #[schema(format = "date-time")]
    pub due_at: String,
    /// How it stands.
    pub state: ReminderState,
    /// When it was practised.
    #[schema(format = "date-time")]
    pub done_at: Option<String>,
}

named! {
    /// How a reminder stands.
    ReminderState: "state" {
        /// Not due yet.
        Ahead = "ahead",
        /// Due, and not practised since.
        Due = "due",
        /// Practised.
        Done = "done",
    }
}
