//! Answers in the form of the REST interface. A session is identified by its number among the trainee's sessions of the
//! task.

mod standing;

use serde::Serialize;
use utoipa::ToSchema;

pub use standing::{
    ChartEvent, ChartPoint, Charts, EventName, PassedBy, Refresher, RefresherState, RuleStanding, RuleState,
    StandingName, TaskPassed,
};

use crate::domain::error_sheet::NoErrorScore;
use crate::domain::feature::FeatureKey;
use crate::domain::named;
use crate::domain::session::{RecordedAtSource, SessionStatus, Supervision};
use crate::domain::standard::{Judgement, Target};
use crate::ids::SessionId;
use crate::statistics::interval::ConfidenceInterval;
use crate::statistics::{NoAnswer, TrialOutcome};
use crate::time::Day;

/// A trainee's progress over the sessions of one task.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct ProgressAnswer {
    /// Pipeline version whose results count: that of the newest result. `null` while there is no result.
    pub pipeline: Option<String>,
    /// Number of earlier sessions that are not listed, because there are too many, and do not count.
    pub earlier: usize,
    /// The sessions, oldest first.
    pub sessions: Vec<SessionStep>,
    /// The requested features over these sessions.
    pub features: Vec<FeatureSeries>,
    /// The error score over these sessions: a series for each version of the task's formula that scores some of them, the
    /// oldest version first; empty if the task has no formula. No standard uses it.
    pub error_scores: Vec<ErrorScoreSeries>,
    /// State of the pass rule of the standard in use; `null` without a rule. Sessions that arrived before its day do not
    /// count.
    pub rule: Option<RuleState>,
    /// The charts of the standard in use; `null` without a standard.
    pub charts: Option<Charts>,
    /// Refreshers one and three months after proficiency; none before proficiency, and none after a relapse.
    pub reminders: Vec<Refresher>,
    /// When the task was passed, under which version, and the criterion; `null` before that and after a relapse.
    pub passed: Option<TaskPassed>,
}

/// One session of the progress.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct SessionStep {
    /// Its number, from 1.
    pub number: usize,
    /// Its id.
    pub id: SessionId,
    /// When it was recorded.
    #[schema(format = "date-time")]
    pub recorded_at: String,
    /// Who says so.
    pub recorded_at_source: RecordedAtSource,
    /// False if that time rests only on a trainee's word or file.
    pub date_known: bool,
    /// Whether a member of staff saw the attempt; `null`: from before this was recorded.
    pub supervision: Option<Supervision>,
    /// When it had arrived completely; while it arrives, when it began to.
    #[schema(format = "date-time")]
    pub created_at: String,
    /// Its status.
    pub status: SessionStatus,
    /// Why it does not count; `null` if it counts.
    pub set_aside: Option<SetAside>,
    /// The version of the standard that judges it, that of the day on which it arrived; `null` where `trial` is.
    pub standard: Option<i64>,
    /// Whether it met the standard; `null` without a standard, and for sessions that are not tracked yet.
    pub trial: Option<TrialName>,
}

named! {
    /// Why a session does not count. It keeps its number, because it was practice.
    SetAside: "reason" {
        /// A user has set it aside; `GET /sessions/{id}/edits` says who, when and why.
        ByHand = "by_hand",
        /// It is an attempt of an exam that was declared void.
        Voided = "voided",
        /// It may show another box: a person has to say.
        BoxAsked = "box_asked",
        /// A person said that it shows another box.
        OtherBox = "other_box",
        /// It is not tracked yet.
        Pending = "pending",
        /// It could not be tracked.
        Failed = "failed",
        /// The quality gate refused it.
        Refused = "refused",
        /// Its result is of another pipeline version: track it again.
        OtherVersion = "other_version",
    }
}

named! {
    /// Outcome of a session against the whole standard.
    TrialName: "trial" {
        /// All targets were met.
        Passed = "passed",
        /// At least one target was missed.
        Failed = "failed",
        /// The outcome is unknown: neither a pass nor a miss.
        Unknown = "unknown",
    }
}

impl From<TrialOutcome> for TrialName {
    fn from(trial: TrialOutcome) -> Self {
        match trial {
            TrialOutcome::Passed => TrialName::Passed,
            TrialOutcome::Failed => TrialName::Failed,
            TrialOutcome::Unknown => TrialName::Unknown,
        }
    }
}

/// Why a value is withheld.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Withheld {
    /// Stable name of the reason, such as `too_few`.
    pub reason: String,
    /// The reason for people.
    pub detail: String,
    /// How many more are needed, if there are too few.
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

/// A value with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct IntervalEstimate {
    /// The best value.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl IntervalEstimate {
    /// A value with its interval.
    pub fn of(value: f64, ConfidenceInterval { low, high }: ConfidenceInterval) -> Self {
        Self { value, low, high }
    }
}

/// One feature over the sessions.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FeatureSeries {
    /// The feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: &'static str,
    /// Its unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// What is better: `lower`, `higher` or `neither`.
    pub better: &'static str,
    /// The standard's limit for it; `null` without a limit.
    pub target: Option<Target>,
    /// One point per session with a result, including sessions that are set aside.
    pub points: Vec<SeriesPoint>,
    /// Rank of the newest counted value in the cohort; `null` if it is withheld or no cohort was named.
    pub place: Option<CohortRank>,
    /// Why the rank is withheld.
    pub no_place: Option<Withheld>,
    /// Learning, judged from the counted values.
    pub learning: LearningAnswer,
}

/// A session's value.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct SeriesPoint {
    /// The session's number.
    pub session: usize,
    /// The value; `null` if too little was seen.
    pub value: Option<f64>,
    /// Lower end of the value's 95 % interval; `null` if it is unknown.
    pub low: Option<f64>,
    /// Upper end of the value's 95 % interval; `null` if it is unknown.
    pub high: Option<f64>,
    /// True if the true value is at least this one: the recording shows only a part of the attempt.
    pub is_lower_bound: bool,
    /// The value judged against the target; `null` without a target.
    pub judgement: Option<Judgement>,
}

/// The error score over the sessions that one version of the formula scores. Scores of different versions are not
/// comparable.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ErrorScoreSeries {
    /// The version.
    pub formula: i64,
    /// The first day of the sessions that it scores, by their arrival; `null`: it scores all.
    pub valid_from: Option<Day>,
    /// One point for each of these sessions, also for those without a score.
    pub points: Vec<ErrorScorePoint>,
}

/// A session's error score, as the session's page shows it to this caller.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ErrorScorePoint {
    /// The session's number.
    pub session: usize,
    /// The score; `null` if `none` says why there is none. That is never a zero.
    pub value: Option<f64>,
    /// Lower end of its error bar; `null` if it is unknown.
    pub low: Option<f64>,
    /// Upper end of its error bar; `null` if it is unknown.
    pub high: Option<f64>,
    /// Number of finished sheets in it.
    pub sheets: usize,
    /// Why there is no score; `null` if there is one.
    pub none: Option<NoScore>,
}

/// Why a session has no error score.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct NoScore {
    /// Its stable name.
    pub reason: NoErrorScore,
    /// The reason for people.
    pub detail: &'static str,
}

impl From<NoErrorScore> for NoScore {
    fn from(reason: NoErrorScore) -> Self {
        Self { reason, detail: reason.detail() }
    }
}

/// Rank of a value in a cohort.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct CohortRank {
    /// Number of the ranked session.
    pub session: usize,
    /// Share of the cohort's people with a lower value, per cent; equal values count half.
    pub percentile: IntervalEstimate,
    /// Share of the cohort's people with a worse value, per cent; `null` if neither lower nor higher is better.
    pub better_than: Option<IntervalEstimate>,
    /// Number of people in the cohort with a comparable value.
    pub people: usize,
    /// True if the interval includes the error of the value itself.
    pub error_known: bool,
}

/// Learning over the sessions.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct LearningAnswer {
    /// Its state.
    pub state: LearningState,
    /// The curve; `null` in every other state.
    pub curve: Option<LearningCurveAnswer>,
    /// When the curve meets the target; `null` without a curve or a target.
    pub forecast: Option<ForecastAnswer>,
    /// Why learning is withheld, and how many sessions are missing.
    pub withheld: Option<Withheld>,
}

named! {
    /// State of learning.
    LearningState: "state" {
        /// The values follow a learning curve.
        Curve = "curve",
        /// The values do not improve with the session's number, or not more than by chance.
        NoCurve = "no_curve",
        /// The values improve, but do not level off yet.
        StillStraight = "still_straight",
        /// Withheld; `withheld` says why.
        Withheld = "withheld",
    }
}

/// The curve A + B·exp(−(n − n₁)/τ). n₁ is the number of the first session of the fit.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct LearningCurveAnswer {
    /// The level that practice leads to, A.
    pub plateau: IntervalEstimate,
    /// Distance of the first session from that level, B.
    pub distance: IntervalEstimate,
    /// Number of sessions until the distance has shrunk to 37 %, τ.
    pub tau_sessions: IntervalEstimate,
    /// Standard deviation of sessions about the curve.
    pub scatter: f64,
    /// Number of sessions of the fit.
    pub sessions: usize,
    /// Points of the curve, with its 95 % band.
    pub line: Vec<CurvePoint>,
}

/// The curve at one session.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct CurvePoint {
    /// The session's number.
    pub session: u32,
    /// The curve at this session, with its 95 % interval.
    #[serde(flatten)]
    pub at: IntervalEstimate,
}

/// When a learning curve meets the target.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ForecastAnswer {
    /// Its state.
    pub state: ForecastState,
    /// Number of the first session at which the curve meets the target.
    pub at: Option<u32>,
    /// Lower end of its 95 % interval.
    pub earliest: Option<u32>,
    /// Upper end of its 95 % interval; `null` if the target may never be met.
    pub latest: Option<u32>,
    /// Why there is no forecast yet.
    pub withheld: Option<Withheld>,
}

named! {
    /// State of a forecast.
    ForecastState: "state" {
        /// The curve meets the target already.
        Reached = "reached",
        /// The curve will meet the target if practice continues like this.
        Ahead = "ahead",
        /// The curve will not meet the target: its plateau misses it.
        NotWithThisCurve = "not_with_this_curve",
        /// Too few sessions.
        Withheld = "withheld",
    }
}
