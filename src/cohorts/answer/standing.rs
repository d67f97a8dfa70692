//! A trainee's standing against a standard: pass rule, charts, reminders.

use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::named;
use crate::domain::standard::{ChartDesign, StandardRule};

/// State of a pass rule.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct RuleState {
    /// The rule.
    #[serde(flatten)]
    pub rule: StandardRule,
    /// Whether it is met.
    pub state: RuleStanding,
    /// Number of the session that met it.
    pub met_at: Option<usize>,
    /// Passes in a row so far, at most as many as the rule asks for; `null` once it is met or out of reach.
    pub have_in_a_row: Option<usize>,
    /// Passes after these so far.
    pub have_more: Option<usize>,
    /// Number of sessions so far with an unknown outcome.
    pub unknown: Option<usize>,
}

named! {
    /// Whether a pass rule is met.
    RuleStanding: "state" {
        /// The rule is met.
        Met = "met",
        /// The rule is not met yet.
        Open = "open",
        /// The rule can no longer be met, even if all unknown sessions were passes.
        OutOfReach = "out_of_reach",
    }
}

/// The charts: LC-CUSUM until proficiency, CUSUM from then on. Shares are 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Charts {
    /// Design of the charts.
    pub design: ChartDesign,
    /// Share of inadequate trainees that are declared proficient within `design.declare_within` judged sessions.
    pub declared_wrongly: Option<f64>,
    /// Share of adequate trainees that are declared proficient within as many.
    pub declared_rightly: Option<f64>,
    /// Number of judged sessions until half of all relapses are detected; `null` beyond 200.
    pub relapse_found_median: Option<usize>,
    /// Number of judged sessions until nine of ten relapses are detected; `null` beyond 200.
    pub relapse_found_90: Option<usize>,
    /// Score at which proficiency is declared.
    pub declares_at: f64,
    /// Score at which a relapse is declared.
    pub alarms_at: f64,
    /// The trainee's standing.
    pub standing: StandingName,
    /// Judged sessions since the last event.
    pub judged: usize,
    /// Declarations and relapses, in order.
    pub events: Vec<ChartEvent>,
    /// One point per session; `null` if the session's outcome is unknown.
    pub path: Vec<Option<ChartPoint>>,
}

named! {
    /// A trainee's standing on the charts.
    StandingName: "standing" {
        /// The sessions so far show neither proficiency nor the opposite.
        NotYet = "not_yet",
        /// Proficient.
        Proficient = "proficient",
        /// Was proficient, has relapsed, and is not proficient again yet.
        Relapsed = "relapsed",
    }
}

/// An event on the charts, at a session.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct ChartEvent {
    /// Kind of the event.
    pub event: EventName,
    /// Number of the session.
    pub session: usize,
    /// Number of judged sessions until the event.
    pub judged: usize,
    /// For a declaration: share of inadequate trainees who would be declared by then too; `null` beyond 200 sessions.
    pub wrong_by_then: Option<f64>,
}

named! {
    /// Kind of an event on the charts.
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
    /// `true` for the LC-CUSUM chart before proficiency, `false` for the CUSUM chart after it.
    pub learning: bool,
    /// The score after the session.
    pub score: f64,
}

/// When a task was passed, and the criterion.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct TaskPassed {
    /// The criterion: the pass rule or the charts.
    pub by: PassedBy,
    /// The version of the standard that was passed. A later version does not take it back.
    pub standard: i64,
    /// Number of the session that completed it.
    pub session: usize,
    /// When that session was recorded.
    #[schema(format = "date-time")]
    pub at: String,
    /// Numbers of the passes that count: those of the rule, or all since the start of the chart that declared
    /// proficiency.
    pub sessions: Vec<usize>,
}

named! {
    /// The criterion for passing a task.
    PassedBy: "by" {
        /// The standard's pass rule.
        Rule = "rule",
        /// The charts.
        Charts = "charts",
    }
}

/// A refresher.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Refresher {
    /// When it is due.
    #[schema(format = "date-time")]
    pub due_at: String,
    /// Its state.
    pub state: RefresherState,
    /// When the task was practised for it.
    #[schema(format = "date-time")]
    pub done_at: Option<String>,
}

named! {
    /// State of a reminder.
    RefresherState: "state" {
        /// Not due yet.
        Ahead = "ahead",
        /// Due, and not practised since.
        Due = "due",
        /// Practised.
        Done = "done",
    }
}
