//! Exams: a task taken under supervision, and judged once by the version of the standard that was fixed before.
//!
//! An exam is passed when one of its attempts was completed and meets all limits of the standard, error bars included. A
//! recording cannot say whether the task was completed, and a short one meets each limit that is a most: the examiner says
//! it. The standard's rule for several sessions is one of training and does not apply: an examination is a single performance, as in FLS, and
//! further attempts are chances to show it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::hand::{Hand, ToolHands};
use super::named;
use super::session::{FeatureRow, FeatureSpace};
use super::standard::{Better, Judgement, SessionJudgement, StandardDefinition, Target, ValueToJudge};
use super::text::{Invalid, Key, Remark};
use super::trainee::Handedness;
use crate::time::Day;

/// Most attempts of an exam.
pub const MAX_ATTEMPTS: u32 = 3;

/// How much longer than the time since it was ordered a live recording may be, s: clocks and buffers of cameras.
const LIVE_TOLERANCE_S: f64 = 5.0;

named! {
    /// State of an exam.
    ExamState: "state" {
        /// It was planned and has not begun.
        Planned = "planned",
        /// The examiner has confirmed who the candidate is; attempts can be recorded.
        Running = "running",
        /// It has a result, which never changes.
        Closed = "closed",
        /// It was cancelled before an attempt counted.
        Cancelled = "cancelled",
    }
}

named! {
    /// Result of an exam.
    ExamResult: "result" {
        /// An attempt met the standard.
        Passed = "passed",
        /// No attempt met the standard, at least one missed it or was broken off, and none of the others leaves a doubt
        /// that is no fault of the candidate.
        NotPassed = "not_passed",
        /// No attempt met the standard, and it cannot be said that the candidate missed it.
        Undecided = "undecided",
    }
}

named! {
    /// How the examiner confirmed who the candidate is.
    IdentityCheck: "identity" {
        /// The badge of the centre or hospital, with a photo.
        Badge = "badge",
        /// An identity document, such as a passport.
        Document = "document",
        /// The examiner knows the candidate personally.
        Known = "known",
    }
}

named! {
    /// What an attempt was judged as.
    AttemptOutcome: "outcome" {
        /// All limits were met, error bars included.
        Passed = "passed",
        /// At least one limit was missed, error bar included.
        NotPassed = "not_passed",
        /// It cannot be said; the cause says why.
        Undecided = "undecided",
        /// The recording was refused by the quality check.
        Refused = "refused",
        /// There is no result: nothing was recorded, or the recording could not be measured.
        Failed = "failed",
    }
}

impl AttemptOutcome {
    /// True if these figures can have this outcome: a pass met all limits, and a miss missed at least one.
    pub fn follows_from(self, figures: &[JudgedFigure]) -> bool {
        match self {
            Self::Passed => !figures.is_empty() && figures.iter().all(|figure| figure.judgement == Judgement::Pass),
            Self::NotPassed => figures.iter().any(|figure| figure.judgement == Judgement::Fail),
            Self::Undecided | Self::Refused | Self::Failed => true,
        }
    }
}

named! {
    /// Why an attempt is undecided.
    AttemptCause: "cause" {
        /// The limit lies within the error bar of a value, or only the least value is known.
        ErrorBar = "error_bar",
        /// A value that a limit needs could not be measured, or its error is unknown.
        NotMeasured = "not_measured",
        /// The recording may show another box.
        OtherBox = "other_box",
        /// It was measured with another camera or other tape colours than the self-test tested.
        SetUp = "set_up",
        /// The recording ended early: camera, line or a person elsewhere ended it, or the consent.
        Interrupted = "interrupted",
        /// The recording is longer than the time since it was ordered, so it was not made then.
        NotLive = "not_live",
    }
}

named! {
    /// What the examiner says of an attempt: no recording shows it.
    AttemptCompletion: "completion" {
        /// The task was completed.
        Completed = "completed",
        /// It was broken off: not passed, also if the figures meet the standard.
        BrokenOff = "broken_off",
    }
}

named! {
    /// Where an attempt is.
    AttemptState: "state" {
        /// It is being recorded.
        Recording = "recording",
        /// It is being measured.
        Scoring = "scoring",
        /// It has an outcome.
        Judged = "judged",
        /// It was recorded; the candidate sees more when the exam is closed.
        Sealed = "sealed",
    }
}

named! {
    /// How an attempt is recorded.
    RecordingWay: "way" {
        /// The agent that stands by at the box begins at once.
        Agent = "agent",
        /// The page *Record* of this device records.
        Browser = "browser",
    }
}

named! {
    /// Why no exam can be started in a box now: a self-test is needed.
    ExamBoxProblem: "problem" {
        /// The box was not tested today.
        NotTestedToday = "not_tested_today",
        /// The latest self-test of today is red, or has no result.
        NotPassed = "not_passed",
        /// The camera or the tape colours were set after the self-test.
        ChangedSince = "changed_since",
        /// A recording since the self-test shows that the camera has moved.
        CameraMoved = "camera_moved",
        /// The light has changed since the self-test.
        LightChanged = "light_changed",
    }
}

/// An exam to plan.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewExam {
    /// The candidate, by id or code.
    #[schema(value_type = String)]
    pub trainee: Key,
    /// The task, by id or code.
    #[schema(value_type = String)]
    pub task: Key,
    /// The box, by id or code.
    #[serde(rename = "box")]
    #[schema(value_type = String)]
    pub in_box: Key,
    /// How many attempts the candidate has, 1 to 3.
    #[schema(minimum = 1, maximum = 3)]
    pub attempts: u32,
    /// A note of the day on which it is to be held; absent: none.
    #[serde(default)]
    pub day: Option<Day>,
}

impl NewExam {
    /// Checks the number of attempts.
    ///
    /// # Errors
    /// It is not 1 to 3.
    pub fn check(&self) -> Result<(), Invalid> {
        match (1..=MAX_ATTEMPTS).contains(&self.attempts) {
            true => Ok(()),
            false => Err(Invalid::new("attempts", format!("is {}; expected 1 to {MAX_ATTEMPTS}", self.attempts))),
        }
    }
}

/// The start of an exam.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ExamStart {
    /// How the examiner confirmed who the candidate is.
    pub identity: IdentityCheck,
}

/// An attempt to record.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewAttempt {
    /// How it is recorded.
    pub way: RecordingWay,
}

/// Why an attempt is voided.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct VoidReason {
    /// The technical failure, 1 to 2000 characters.
    #[schema(value_type = String)]
    pub reason: Remark,
}

/// Whether the task of an attempt was completed.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CompletionStatement {
    /// What the examiner saw.
    pub completion: AttemptCompletion,
}

/// A value of an attempt, judged by a limit. It stays as it is when the session is scored again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JudgedFigure {
    /// Stable name of the feature, such as `path_length`.
    pub feature: String,
    /// Its title for people.
    pub title: String,
    /// Its unit; `1` for shares, counts and ratios.
    pub unit: String,
    /// The marker of the tool; `null` for a feature of the whole session.
    pub tool: Option<String>,
    /// The hand that the limit is for; `null` if it is for a tool or the whole session.
    pub in_hand: Option<Hand>,
    /// Where it was measured.
    pub space: FeatureSpace,
    /// Which side of the limit is better.
    pub better: Better,
    /// The limit.
    pub limit: f64,
    /// The value; `null`: not measured.
    pub value: Option<f64>,
    /// Lower end of the 95 % interval of the true value; `null`: not known.
    pub low: Option<f64>,
    /// Upper end of that interval; `null`: not known.
    pub high: Option<f64>,
    /// The judgement by this limit.
    pub judgement: Judgement,
}

/// What an attempt is judged from.
#[derive(Clone, Copy, Debug)]
pub struct AttemptResult<'r> {
    /// The features of the current result.
    pub features: &'r [FeatureRow],
    /// The tools in the hands.
    pub hands: &'r ToolHands,
    /// The candidate's preferred hand at the start of the exam, if known.
    pub handedness: Option<Handedness>,
    /// Version of the program that measured them.
    pub pipeline: &'r str,
    /// True if the quality check refused the recording.
    pub is_refused: bool,
    /// True if the recording may show another box.
    pub may_be_other_box: bool,
    /// True if it was measured with the camera and tape colours that the self-test tested.
    pub has_tested_set_up: bool,
    /// True if the recording ended early.
    pub is_interrupted: bool,
    /// Length of the recording, s.
    pub duration_s: f64,
    /// Time from the order of the recording to its complete arrival, s.
    pub since_order_s: f64,
}

/// The judgement of an attempt.
#[derive(Clone, Debug, PartialEq)]
pub struct AttemptJudgement {
    /// The outcome.
    pub outcome: AttemptOutcome,
    /// Why it is undecided.
    pub cause: Option<AttemptCause>,
    /// The values with their limits.
    pub figures: Vec<JudgedFigure>,
}

/// Judges an attempt by the standard of its exam.
pub fn judge(standard: &StandardDefinition, of: AttemptResult<'_>) -> AttemptJudgement {
    let in_session = standard.in_session(of.hands, of.handedness);
    let pairs = standard.targets.iter().zip(&in_session.targets);
    let figures: Vec<JudgedFigure> = pairs.map(|(named, target)| judged_figure(named, target, of)).collect();
    let whole = in_session.judge_all(|target| judged_figure(target, target, of).judgement);
    let is_late = of.duration_s > of.since_order_s + LIVE_TOLERANCE_S;
    let (outcome, cause) = if of.is_refused {
        (AttemptOutcome::Refused, None)
    } else if of.is_interrupted {
        (AttemptOutcome::Undecided, Some(AttemptCause::Interrupted))
    } else if is_late {
        (AttemptOutcome::Undecided, Some(AttemptCause::NotLive))
    } else if of.may_be_other_box {
        (AttemptOutcome::Undecided, Some(AttemptCause::OtherBox))
    } else if !of.has_tested_set_up {
        (AttemptOutcome::Undecided, Some(AttemptCause::SetUp))
    } else {
        match whole {
            SessionJudgement::Pass => (AttemptOutcome::Passed, None),
            SessionJudgement::Fail => (AttemptOutcome::NotPassed, None),
            SessionJudgement::Unknown => {
                let at_limit = figures.iter().any(|figure| figure.judgement == Judgement::Undecided);
                let cause = if at_limit { AttemptCause::ErrorBar } else { AttemptCause::NotMeasured };
                (AttemptOutcome::Undecided, Some(cause))
            }
        }
    };
    AttemptJudgement { outcome, cause, figures }
}

/// `named`: the limit as the standard has it; `target`: the same with the tool that was in the hand.
fn judged_figure(named: &Target, target: &Target, of: AttemptResult<'_>) -> JudgedFigure {
    let row = of.features.iter().find(|row| super::feature::StoredFeatureKey::from(*row) == target.of);
    let value = row.and_then(|row| row.value.as_ref().ok().copied());
    let is_lower_bound = row.is_some_and(FeatureRow::is_lower_bound);
    let error = row.and_then(|row| row.error.as_ref()).and_then(|error| error.as_ref().ok());
    let bar = error.map(|error| [error.low, error.high]);
    let (pipeline, handedness) = (of.pipeline, of.handedness);
    let judgement = match row {
        Some(_) => target.judge(ValueToJudge { value, bar, is_lower_bound, pipeline, handedness }),
        None => Judgement::NotMeasured,
    };
    JudgedFigure {
        feature: target.of.feature.name.to_owned(),
        title: target.title.clone(),
        unit: target.unit.clone(),
        tool: target.of.tool.clone(),
        in_hand: named.of.in_hand,
        space: target.of.space,
        better: target.better,
        limit: target.limit,
        value,
        low: bar.map(|[low, _]| low).or(value.filter(|_| is_lower_bound)),
        high: bar.map(|[_, high]| high),
        judgement,
    }
}

/// An attempt that counts, as the result of its exam depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CountedAttempt {
    /// What its recording was judged as.
    pub outcome: AttemptOutcome,
    /// Why it is undecided.
    pub cause: Option<AttemptCause>,
    /// What the examiner says of it.
    pub completion: AttemptCompletion,
}

impl CountedAttempt {
    /// True if it was completed and met the standard.
    pub fn is_passed(self) -> bool {
        self.completion == AttemptCompletion::Completed && self.outcome == AttemptOutcome::Passed
    }

    /// True if it missed the standard, or was broken off.
    fn is_missed(self) -> bool {
        self.completion == AttemptCompletion::BrokenOff || self.outcome == AttemptOutcome::NotPassed
    }

    /// True if it was completed and only the measurement or the box leaves open whether it met the standard.
    fn is_in_doubt(self) -> bool {
        let is_of_measurement = self.cause.is_some_and(|cause| match cause {
            AttemptCause::ErrorBar | AttemptCause::NotMeasured | AttemptCause::OtherBox | AttemptCause::SetUp => true,
            AttemptCause::Interrupted | AttemptCause::NotLive => false,
        });
        self.completion == AttemptCompletion::Completed
            && self.outcome == AttemptOutcome::Undecided
            && is_of_measurement
    }
}

/// The result of an exam from the attempts that count; `None` without one.
///
/// Once an attempt has missed the standard, one without a usable recording is used without a pass: a candidate who has
/// failed could otherwise cover the camera in the next attempt and have no result. Without an attempt that missed it, nothing
/// says that the candidate failed, so the exam is undecided.
pub fn result_of(attempts: &[CountedAttempt]) -> Option<ExamResult> {
    if attempts.is_empty() {
        return None;
    }
    if attempts.iter().any(|attempt| attempt.is_passed()) {
        return Some(ExamResult::Passed);
    }
    let is_missed = attempts.iter().any(|attempt| attempt.is_missed());
    let is_in_doubt = attempts.iter().any(|attempt| attempt.is_in_doubt());
    Some(if is_missed && !is_in_doubt { ExamResult::NotPassed } else { ExamResult::Undecided })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::feature::FeatureKey;
    use crate::domain::session::FeatureError;
    use crate::domain::standard::ChartDesign;
    use crate::motion::features::time::DURATION;
    use crate::statistics::standard::FeatureTarget;

    fn standard(limit: f64) -> StandardDefinition {
        let key = FeatureKey::of_session(&DURATION, FeatureSpace::Image);
        let limit = FeatureTarget::fixed(limit, crate::motion::features::Direction::Lower).unwrap();
        StandardDefinition { targets: vec![Target::of(key, limit, None)], rule: None, charts: ChartDesign::default() }
    }

    fn row(value: Result<f64, String>, half: f64) -> FeatureRow {
        let error = value.as_ref().ok().map(|value| {
            Ok(FeatureError { as_measured: *value, sigma: half / 2.0, low: value - half, high: value + half })
        });
        FeatureRow {
            name: DURATION.name.to_owned(),
            title: DURATION.title.to_owned(),
            unit: DURATION.unit.to_owned(),
            tool: None,
            space: FeatureSpace::Image,
            value,
            error,
        }
    }

    fn judged(features: &[FeatureRow], change: impl FnOnce(&mut AttemptResult<'_>)) -> AttemptJudgement {
        let hands = ToolHands::default();
        let mut of = AttemptResult {
            features,
            hands: &hands,
            handedness: None,
            pipeline: "1",
            is_refused: false,
            may_be_other_box: false,
            has_tested_set_up: true,
            is_interrupted: false,
            duration_s: 60.0,
            since_order_s: 70.0,
        };
        change(&mut of);
        judge(&standard(50.0), of)
    }

    #[test]
    fn only_a_whole_error_bar_on_one_side_decides() {
        for (value, outcome, cause) in [
            (Ok(40.0), AttemptOutcome::Passed, None),
            (Ok(60.0), AttemptOutcome::NotPassed, None),
            (Ok(51.0), AttemptOutcome::Undecided, Some(AttemptCause::ErrorBar)),
            (Err("too little was seen".to_owned()), AttemptOutcome::Undecided, Some(AttemptCause::NotMeasured)),
        ] {
            let judged = judged(&[row(value.clone(), 2.0)], |_| {});
            assert_eq!((judged.outcome, judged.cause), (outcome, cause), "{value:?}");
            assert_eq!(judged.figures[0].value, value.ok());
            assert!(judged.outcome.follows_from(&judged.figures));
            let is_undecided = outcome == AttemptOutcome::Undecided;
            assert_eq!(AttemptOutcome::Passed.follows_from(&judged.figures), outcome == AttemptOutcome::Passed);
            assert!(!is_undecided || !AttemptOutcome::NotPassed.follows_from(&judged.figures));
        }
        let nothing = judged(&[], |_| {});
        assert_eq!((nothing.outcome, nothing.cause), (AttemptOutcome::Undecided, Some(AttemptCause::NotMeasured)));
    }

    #[test]
    fn a_refused_foreign_or_prepared_recording_is_never_passed() {
        let good = [row(Ok(40.0), 2.0)];
        assert_eq!(judged(&good, |of| of.is_refused = true).outcome, AttemptOutcome::Refused);
        assert_eq!(judged(&good, |of| of.may_be_other_box = true).cause, Some(AttemptCause::OtherBox));
        assert_eq!(judged(&good, |of| of.has_tested_set_up = false).cause, Some(AttemptCause::SetUp));
        let interrupted = judged(&good, |of| of.is_interrupted = true);
        assert_eq!(
            (interrupted.outcome, interrupted.cause),
            (AttemptOutcome::Undecided, Some(AttemptCause::Interrupted))
        );
        assert_eq!(judged(&good, |of| of.since_order_s = 54.9).cause, Some(AttemptCause::NotLive));
        assert_eq!(judged(&good, |of| of.since_order_s = 55.1).outcome, AttemptOutcome::Passed);
    }

    fn counted(outcome: AttemptOutcome, cause: Option<AttemptCause>, completion: AttemptCompletion) -> CountedAttempt {
        CountedAttempt { outcome, cause, completion }
    }

    #[test]
    fn one_completed_pass_passes_and_doubt_of_the_measurement_is_no_failure() {
        use AttemptCause::{ErrorBar, Interrupted, NotLive, NotMeasured, OtherBox, SetUp};
        use AttemptCompletion::{BrokenOff, Completed};
        use AttemptOutcome::{Failed, NotPassed, Passed, Refused, Undecided};
        let done = |outcome| counted(outcome, None, Completed);
        let doubt = |cause| counted(Undecided, Some(cause), Completed);
        let broken = |outcome| counted(outcome, None, BrokenOff);
        let (pass, miss) = (done(Passed), done(NotPassed));
        assert_eq!(result_of(&[]), None);
        for (attempts, result) in [
            (vec![miss, pass], ExamResult::Passed),
            (vec![done(Failed), pass], ExamResult::Passed),
            (vec![broken(Passed), pass], ExamResult::Passed),
            (vec![miss, miss], ExamResult::NotPassed),
            (vec![broken(Passed)], ExamResult::NotPassed),
            (vec![broken(Failed)], ExamResult::NotPassed),
            (vec![done(Refused)], ExamResult::Undecided),
            (vec![done(Failed), done(Refused)], ExamResult::Undecided),
            (vec![doubt(Interrupted)], ExamResult::Undecided),
            (vec![miss, done(Refused)], ExamResult::NotPassed),
            (vec![miss, done(Failed)], ExamResult::NotPassed),
            (vec![miss, doubt(Interrupted)], ExamResult::NotPassed),
            (vec![miss, doubt(NotLive)], ExamResult::NotPassed),
            (vec![miss, counted(Undecided, Some(ErrorBar), BrokenOff)], ExamResult::NotPassed),
        ] {
            assert_eq!(result_of(&attempts), Some(result), "{attempts:?}");
        }
        for cause in [ErrorBar, NotMeasured, OtherBox, SetUp] {
            assert_eq!(result_of(&[miss, doubt(cause)]), Some(ExamResult::Undecided), "{cause:?}");
        }
    }
}
