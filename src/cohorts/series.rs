//! One feature over a trainee's sessions: its points, its rank in a cohort, its learning curve.

use super::answer::{
    CohortRank, CurvePoint, FeatureSeries, ForecastAnswer, ForecastState, IntervalEstimate, LearningAnswer,
    LearningCurveAnswer, LearningState, SeriesPoint, Withheld,
};
use super::cache::ComputedCache;
use super::people::ComparableWith;
use super::versions::TaskStandards;
use crate::domain::feature::{FeatureKey, depends_on_camera};
use crate::domain::standard::{Target, ValueToJudge};
use crate::domain::trainee::Handedness;
use crate::ids::TraineeId;
use crate::motion::features::Direction;
use crate::statistics::curve::{self, NumberedValue};
use crate::statistics::interval::MeasuredValue;
use crate::statistics::{NoAnswer, cohort};
use crate::store::{CohortValue, PracticeMeasurement, PracticeResult, PracticeSession};

/// Number of points of a fitted curve. Charts draw straight lines between them.
const LINE_POINTS: u32 = 32;

/// The trainee, and the cohort to rank them in.
pub struct TraineeContext<'w> {
    /// The trainee.
    pub trainee: TraineeId,
    /// The hand that they prefer.
    pub handedness: Option<Handedness>,
    /// The cohort's values; `None` if no cohort was named.
    pub among: Option<&'w [CohortValue]>,
}

/// A session with its number, and whether it counts.
#[derive(Clone, Copy)]
pub struct NumberedSession<'p> {
    /// Its number among the trainee's sessions of the task, from 1.
    pub number: usize,
    /// True if it counts: it has a valid result and is not set aside.
    pub counts: bool,
    /// The session.
    pub session: &'p PracticeSession,
    /// The trainee's preferred hand, if known.
    pub preferred: Option<Handedness>,
}

impl NumberedSession<'_> {
    /// The session's result and its measurement of a feature.
    fn measurement(&self, of: &FeatureKey) -> Option<(&PracticeResult, &PracticeMeasurement)> {
        let result = self.session.result.as_ref()?;
        let of = of.in_session(&result.hands, self.preferred)?;
        let measurement = self.session.measured.iter().find(|measurement| measurement.of == of)?;
        Some((result, measurement))
    }

    /// The measurement in the form that a target judges.
    pub fn value_to_judge(&self, of: &FeatureKey) -> Option<ValueToJudge<'_>> {
        let (outcome, PracticeMeasurement { value, bar, is_lower_bound, .. }) = self.measurement(of)?;
        let (value, bar, is_lower_bound) = (*value, *bar, *is_lower_bound);
        Some(ValueToJudge { value, bar, is_lower_bound, pipeline: &outcome.pipeline, handedness: self.preferred })
    }
}

/// The complete answer for one feature.
pub fn feature_series(
    of: &FeatureKey,
    sessions: &[NumberedSession<'_>],
    standards: &TaskStandards,
    context: &TraineeContext<'_>,
    known: &ComputedCache,
) -> FeatureSeries {
    let target = standards.current().and_then(|version| version.definition.target(of));
    let points = points(of, sessions, standards);
    let (place, no_place) = match context.among.map(|among| cohort_rank(of, sessions, context, among)) {
        None => (None, None),
        Some(Ok(place)) => (Some(place), None),
        Some(Err(why)) => (None, Some(why)),
    };
    let learning = learning_answer(of, of.feature.direction, sessions, target, known);
    let (title, unit, better) = (of.feature.title, of.feature.unit, of.feature.direction.name());
    FeatureSeries { of: of.clone(), title, unit, better, target: target.cloned(), points, place, no_place, learning }
}

/// One point for each session that measured the feature, judged by the version of its day.
pub fn points(of: &FeatureKey, sessions: &[NumberedSession<'_>], standards: &TaskStandards) -> Vec<SeriesPoint> {
    sessions.iter().filter_map(|session| point(session, of, standards)).collect()
}

fn point(session: &NumberedSession<'_>, of: &FeatureKey, standards: &TaskStandards) -> Option<SeriesPoint> {
    let judged = session.value_to_judge(of)?;
    let target = standards.target_at(session.session.created_at_ms, of);
    let [low, high] = judged.bar.map_or([None; 2], |bar| bar.map(Some));
    let judgement = target.map(|target| target.judge(judged));
    let ValueToJudge { value, is_lower_bound, .. } = judged;
    Some(SeriesPoint { session: session.number, value, low, high, is_lower_bound, judgement })
}

/// Ranks the newest counted value in the cohort.
fn cohort_rank(
    of: &FeatureKey,
    sessions: &[NumberedSession<'_>],
    context: &TraineeContext<'_>,
    among: &[CohortValue],
) -> Result<CohortRank, Withheld> {
    let newest = sessions.iter().rev().filter(|session| session.counts).find_map(|session| {
        let (outcome, _) = session.measurement(of)?;
        let measured = session.value_to_judge(of)?.measured()?;
        Some((session.number, outcome, measured))
    });
    let (session, outcome, measured) =
        newest.ok_or(NoAnswer::TooFew { of: "measured sessions", found: 0, needed: 1 })?;
    if of.needs_same_preference() && context.handedness.is_none() {
        let detail = "the trainee's preferred hand is unknown, and a feature of one hand is compared among people who \
                      prefer the same hand";
        return Err(Withheld { reason: "hand_unknown".to_owned(), detail: detail.to_owned(), missing: None });
    }
    let like = ComparableWith {
        of,
        pipeline: &outcome.pipeline,
        calibration: outcome.calibration,
        handedness: context.handedness,
        without: Some(context.trainee),
    };
    let people = like.people(among)?;
    let place = cohort::percentile_in_cohort(measured, &people, of.feature.direction)?;
    Ok(CohortRank {
        session,
        percentile: IntervalEstimate::of(place.percentile, place.interval),
        better_than: place.better_than.map(|(value, interval)| IntervalEstimate::of(value, interval)),
        people: place.people,
        error_known: place.error_known,
    })
}

/// Learning over the counted sessions. For a feature along the camera's axes, only sessions with the newest calibration
/// count.
fn learning_answer(
    of: &FeatureKey,
    direction: Direction,
    sessions: &[NumberedSession<'_>],
    target: Option<&Target>,
    known: &ComputedCache,
) -> LearningAnswer {
    let value = |session: &NumberedSession<'_>| {
        let MeasuredValue { value, .. } = session.value_to_judge(of)?.measured()?;
        Some(NumberedValue { number: session.number as u32, value })
    };
    let camera = |session: &NumberedSession<'_>| session.measurement(of).map(|(outcome, _)| outcome.calibration);
    let newest = sessions.iter().rev().find(|session| session.counts && value(session).is_some()).and_then(camera);
    let is_comparable = |session: &&NumberedSession<'_>| !depends_on_camera(of) || camera(session) == newest;
    let counted = sessions.iter().filter(|session| session.counts).filter(is_comparable).filter_map(value);
    let counted: Vec<NumberedValue> = counted.collect();
    let in_state = |state| LearningAnswer { state, curve: None, forecast: None, withheld: None };
    let withheld = |why: NoAnswer| LearningAnswer { withheld: Some(why.into()), ..in_state(LearningState::Withheld) };
    let first = counted.first().map_or(1, |session| session.number);
    let found = match known.curve(counted, direction) {
        Ok(found) => found,
        Err(why) => return withheld(why),
    };
    match &*found {
        &curve::LearningFit::TooFew { found, needed } => withheld(NoAnswer::TooFew { of: "sessions", found, needed }),
        curve::LearningFit::NoCurve => in_state(LearningState::NoCurve),
        curve::LearningFit::StillStraight => in_state(LearningState::StillStraight),
        curve::LearningFit::Curve(curve) => LearningAnswer {
            forecast: target.map(|target| forecast_answer(curve, target.limit)),
            curve: Some(curve_answer(curve, first)),
            ..in_state(LearningState::Curve)
        },
    }
}

fn curve_answer(curve: &curve::LearningCurve, first: u32) -> LearningCurveAnswer {
    let span = curve.last - first;
    let steps = span.clamp(1, LINE_POINTS - 1);
    let at = |step: u32| {
        let session = first + (f64::from(span) * f64::from(step) / f64::from(steps)).round() as u32;
        CurvePoint { session, at: IntervalEstimate::of(curve.value_at(session), curve.band(session)) }
    };
    let fitted = |fitted: curve::FittedParameter| IntervalEstimate::of(fitted.value, fitted.interval);
    LearningCurveAnswer {
        plateau: fitted(curve.plateau),
        distance: fitted(curve.distance),
        tau_sessions: fitted(curve.tau_sessions),
        scatter: curve.scatter,
        sessions: curve.sessions,
        line: (0..=steps).map(at).collect(),
    }
}

fn forecast_answer(curve: &curve::LearningCurve, limit: f64) -> ForecastAnswer {
    let in_state = |state| ForecastAnswer { state, at: None, earliest: None, latest: None, withheld: None };
    let withheld = |why: NoAnswer| ForecastAnswer { withheld: Some(why.into()), ..in_state(ForecastState::Withheld) };
    match curve.forecast(limit) {
        Err(why) => withheld(why),
        Ok(curve::Forecast::TooFew { found, needed }) => withheld(NoAnswer::TooFew { of: "sessions", found, needed }),
        Ok(curve::Forecast::Reached { at }) => ForecastAnswer { at: Some(at), ..in_state(ForecastState::Reached) },
        Ok(curve::Forecast::Ahead { at, earliest, latest }) => {
            ForecastAnswer { at: Some(at), earliest: Some(earliest), latest, ..in_state(ForecastState::Ahead) }
        }
        Ok(curve::Forecast::NotWithThisCurve { earliest }) => {
            ForecastAnswer { earliest, ..in_state(ForecastState::NotWithThisCurve) }
        }
    }
}
