//! What is answered, as it is told over REST. Sessions are named by their number among the trainee's sessions of the task.

mod standing;

use serde::Serialize;
use utoipa::ToSchema;

pub use standing::{
    ChartEvent, ChartPoint, Charts, EventName, Passed, PassedBy, Reminder, ReminderState, RuleStanding, RuleState,
    StandingName,
};

use crate::domain::feature::FeatureKey;
use crate::domain::named;
use crate::domain::session::SessionStatus;
use crate::domain::standard::{Judgement, Target};
use crate::ids::SessionId;
use crate::pipeline::score::interval::Interval;
use crate::pipeline::score::{NoAnswer, Trial};

/// The course of a trainee's sessions of one task.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct Course {
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
    /// By what the task counts as learnt; `null` as long as it does not, and after a relapse.
    pub passed: Option<Passed>,
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
        /// Somebody has set it aside; `GET /sessions/{id}/edits` says who, when and why.
        ByHand = "by_hand",
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

/// The curve A + B·exp(−(n − n₁)/τ), n₁ being the number of the first session that it was fitted to.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Curve {
    /// The level that practice leads to, A.
    pub plateau: Estimate,
    /// How far from it that first session was, B.
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
