//! What is answered, as it is told over REST. Sessions are named by their number among the trainee's sessions of the task.

use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::feature::FeatureKey;
use crate::domain::named;
use crate::domain::session::SessionStatus;
use crate::domain::standard::{ChartDesign, Judgement, Rule, Target};
use crate::ids::SessionId;
use crate::pipeline::score::interval::Interval;
use crate::pipeline::score::{NoAnswer, Trial};

/// A trainee's sessions of one task over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct Progress {
    /// Version of the program whose results count: that of the newest one. `null` while there is none.
    pub pipeline: Option<String>,
    /// Sessions before the first one here, which are too many to show and count for nothing.
    pub earlier: usize,
    /// The sessions, oldest first.
    pub sessions: Vec<Step>,
    /// The features that were asked for, over these sessions.
    pub features: Vec<Series>,
    /// How far they have come by the standard's pass rule; `null` without one.
    pub rule: Option<RuleState>,
    /// What the charts say; `null` without a standard.
    pub charts: Option<Charts>,
    /// Refreshers one and three months after proficiency; none before it, and none after a relapse.
    pub reminders: Vec<Reminder>,
}

/// One session on the way.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Step {
    /// Its number, from 1.
    pub number: usize,
    /// Its id.
    pub id: SessionId,
    /// When it was recorded.
    #[schema(format = "date-time")]
    pub recorded_at: String,
    /// How it stands.
    pub status: SessionStatus,
    /// Why it counts for nothing; `null`: it counts.
    pub set_aside: Option<SetAside>,
    /// Was the standard kept? `null` without one, and of sessions that are not tracked yet.
    pub trial: Option<TrialName>,
}

named! {
    /// Why a session counts for nothing. It keeps its number: it was practice.
    SetAside: "reason" {
        /// It is not tracked yet.
        Pending = "pending",
        /// It could not be tracked.
        Failed = "failed",
        /// The quality gate refused it.
        Refused = "refused",
        /// Its result is of another version of the program: track it again.
        OtherVersion = "other_version",
    }
}

named! {
    /// What a session was worth against the whole standard.
    TrialName: "trial" {
        /// All targets were kept.
        Passed = "passed",
        /// One was missed.
        Failed = "failed",
        /// Nobody knows: neither a pass nor a miss.
        Unknown = "unknown",
    }
}

impl From<Trial> for TrialName {
    fn from(trial: Trial) -> Self {
        match trial {
            Trial::Passed => TrialName::Passed,
            Trial::Failed => TrialName::Failed,
            Trial::Unknown => TrialName::Unknown,
        }
    }
}

/// Why something is not told.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Withheld {
    /// Stable name of the reason, such as `too_few`.
    pub reason: String,
    /// The same for people.
    pub detail: String,
    /// How many more it takes, where it is too few.
    pub missing: Option<usize>,
}

impl From<NoAnswer> for Withheld {
    fn from(why: NoAnswer) -> Self {
        let missing = match why {
            NoAnswer::TooFew { found, needed, .. } => Some(needed - found),
            _ => None,
        };
        Self { reason: why.name().to_owned(), detail: why.to_string(), missing }
    }
}

/// A value and where it lies with 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Estimate {
    /// The best value.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Estimate {
    /// A value with its interval.
    pub fn of(value: f64, Interval { low, high }: Interval) -> Self {
        Self { value, low, high }
    }
}

/// One feature over the sessions.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Series {
    /// Which feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: &'static str,
    /// Its unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// What is better: `lower`, `higher` or `neither`.
    pub better: &'static str,
    /// The limit that the standard sets it; `null` without one.
    pub target: Option<Target>,
    /// One point per session with a result, those that are set aside included.
    pub points: Vec<Point>,
    /// Where the newest counted value stands among the cohort's; `null` where that is withheld, or no cohort was named.
    pub place: Option<Place>,
    /// Why the place is withheld.
    pub no_place: Option<Withheld>,
    /// What the counted values say about learning.
    pub learning: Learning,
}

/// A session's value.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Point {
    /// The session's number.
    pub session: usize,
    /// The value; `null` where too little was seen.
    pub value: Option<f64>,
    /// The true value lies with 95 % between `low`
    pub low: Option<f64>,
    /// and `high`; `null` where that is not known.
    pub high: Option<f64>,
    /// What it is worth against the target; `null` without one.
    pub judgement: Option<Judgement>,
}

/// A place in a cohort.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Place {
    /// The session that is placed.
    pub session: usize,
    /// Share of the cohort's people below its value, per cent, equal ones by half.
    pub percentile: Estimate,
    /// Share of them that it is better than, per cent; `null` where neither more nor less is better.
    pub better_than: Option<Estimate>,
    /// How many people the cohort has for this.
    pub people: usize,
    /// Is the value's own error in the interval?
    pub error_known: bool,
}

/// What the sessions say about learning.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Learning {
    /// How it stands.
    pub state: LearningState,
    /// The curve; `null` in every other state.
    pub curve: Option<Curve>,
    /// When the curve keeps the target; `null` without a curve or a target.
    pub forecast: Option<Forecast>,
    /// Why it is withheld, or how many sessions it takes.
    pub withheld: Option<Withheld>,
}

named! {
    /// How learning stands.
    LearningState: "state" {
        /// The values follow a curve.
        Curve = "curve",
        /// They do not improve with the session's number, or not more than by chance.
        NoCurve = "no_curve",
        /// They improve, but do not bend towards a level yet.
        StillStraight = "still_straight",
        /// Nothing can be said; `withheld` says why.
        Withheld = "withheld",
    }
}

/// The curve A + B·exp(−(n − 1)/τ).
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Curve {
    /// The level that practice leads to, A.
    pub plateau: Estimate,
    /// How far from it the first session was, B.
    pub distance: Estimate,
    /// Sessions in which the distance shrinks to 37 %, τ.
    pub tau_sessions: Estimate,
    /// Standard deviation of a session about the curve.
    pub scatter: f64,
    /// How many sessions it was fitted to.
    pub sessions: usize,
    /// The curve, with the band in which it lies.
    pub line: Vec<LinePoint>,
}

/// The curve at one session.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct LinePoint {
    /// The session's number.
    pub session: u32,
    /// The curve there, and where it lies with 95 %.
    #[serde(flatten)]
    pub at: Estimate,
}

/// When a curve keeps the target.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Forecast {
    /// How it stands.
    pub state: ForecastState,
    /// From the session of this number on.
    pub at: Option<u32>,
    /// The earliest with 95 %.
    pub earliest: Option<u32>,
    /// The latest with 95 %; `null`: it may never be.
    pub latest: Option<u32>,
    /// Why there is none yet.
    pub withheld: Option<Withheld>,
}

named! {
    /// How a forecast stands.
    ForecastState: "state" {
        /// The curve keeps the target already.
        Reached = "reached",
        /// It will, if practice goes on like this.
        Ahead = "ahead",
        /// Not with this curve: its level does not keep the target.
        NotWithThisCurve = "not_with_this_curve",
        /// Too few sessions.
        Withheld = "withheld",
    }
}

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
