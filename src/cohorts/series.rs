//! One feature over a trainee's sessions: its points, its rank in a cohort, its learning curve.

use super::answer::{
    Curve, Estimate, Forecast, ForecastState, Learning, LearningState, LinePoint, Place, Point, Series, Withheld,
};
use super::known::Known;
use super::people::Like;
use crate::domain::feature::{FeatureKey, is_of_one_camera};
use crate::domain::standard::{Definition, Target, ToJudge};
use crate::domain::trainee::Handedness;
use crate::ids::TraineeId;
use crate::pipeline::features::{Direction, Feature};
use crate::pipeline::score::curve::{self, Session};
use crate::pipeline::score::interval::Measured;
use crate::pipeline::score::{NoAnswer, cohort};
use crate::store::{CohortValue, Measurement, Outcome, Practised};

/// Number of points of a fitted curve. Charts draw straight lines between them.
const LINE_POINTS: u32 = 32;

/// The trainee, and the cohort to rank them in.
pub struct Whom<'w> {
    /// The trainee.
    pub trainee: TraineeId,
    /// The hand that they prefer.
    pub handedness: Option<Handedness>,
    /// The cohort's values; `None` if no cohort was named.
    pub among: Option<&'w [CohortValue]>,
}

/// A session with its number, and whether it counts.
#[derive(Clone, Copy)]
pub struct Numbered<'p> {
    /// Its number among the trainee's sessions of the task, from 1.
    pub number: usize,
    /// True if it counts: it has a valid result and is not set aside.
    pub counts: bool,
    /// The session.
    pub session: &'p Practised,
}

impl Numbered<'_> {
    /// The session's result and its measurement of a feature.
    fn measured(&self, of: &FeatureKey) -> Option<(&Outcome, &Measurement)> {
        let measurement = self.session.measured.iter().find(|measurement| measurement.of == *of)?;
        Some((self.session.result.as_ref()?, measurement))
    }

    /// The measurement in the form that a target judges.
    pub fn evidence(&self, of: &FeatureKey, handedness: Option<Handedness>) -> Option<ToJudge<'_>> {
        let (outcome, Measurement { value, bar, .. }) = self.measured(of)?;
        Some(ToJudge { value: *value, bar: *bar, pipeline: &outcome.pipeline, handedness })
    }
}

/// The complete answer for one feature.
pub fn series(
    of: &FeatureKey,
    feature: &'static Feature,
    sessions: &[Numbered<'_>],
    standard: Option<&Definition>,
    context: &Whom<'_>,
    known: &Known,
) -> Series {
    let target = standard.and_then(|standard| standard.target(of));
    let points = points(of, sessions, target, context.handedness);
    let (place, no_place) = match context.among.map(|among| place(of, feature, sessions, context, among)) {
        None => (None, None),
        Some(Ok(place)) => (Some(place), None),
        Some(Err(why)) => (None, Some(why)),
    };
    let learning = learning(of, feature.direction, sessions, target, known);
    let (title, unit, better) = (feature.title, feature.unit, feature.direction.name());
    Series { of: of.clone(), title, unit, better, target: target.cloned(), points, place, no_place, learning }
}

/// One point for each session that measured the feature.
pub fn points(
    of: &FeatureKey,
    sessions: &[Numbered<'_>],
    target: Option<&Target>,
    handedness: Option<Handedness>,
) -> Vec<Point> {
    sessions.iter().filter_map(|session| point(session, of, target, handedness)).collect()
}

fn point(
    session: &Numbered<'_>,
    of: &FeatureKey,
    target: Option<&Target>,
    handedness: Option<Handedness>,
) -> Option<Point> {
    let judged = session.evidence(of, handedness)?;
    let [low, high] = judged.bar.map_or([None; 2], |bar| bar.map(Some));
    let judgement = target.map(|target| target.judge(judged));
    Some(Point { session: session.number, value: judged.value, low, high, judgement })
}

/// Ranks the newest counted value in the cohort.
fn place(
    of: &FeatureKey,
    feature: &Feature,
    sessions: &[Numbered<'_>],
    context: &Whom<'_>,
    among: &[CohortValue],
) -> Result<Place, Withheld> {
    let newest = sessions.iter().rev().filter(|session| session.counts).find_map(|session| {
        let (outcome, _) = session.measured(of)?;
        let measured = session.evidence(of, None)?.measured()?;
        Some((session.number, outcome, measured))
    });
    let (session, outcome, measured) =
        newest.ok_or(NoAnswer::TooFew { of: "measured sessions", found: 0, needed: 1 })?;
    if of.tool.is_some() && context.handedness.is_none() {
        let detail =
            "the trainee's preferred hand is unknown, and a tool's feature is compared among people of the same hand";
        return Err(Withheld { reason: "hand_unknown".to_owned(), detail: detail.to_owned(), missing: None });
    }
    let like = Like {
        of,
        pipeline: &outcome.pipeline,
        calibration: outcome.calibration,
        handedness: context.handedness,
        without: Some(context.trainee),
    };
    let people = like.people(among)?;
    let place = cohort::place(measured, &people, feature.direction)?;
    Ok(Place {
        session,
        percentile: Estimate::of(place.percentile, place.interval),
        better_than: place.better_than.map(|(value, interval)| Estimate::of(value, interval)),
        people: place.people,
        error_known: place.error_known,
    })
}

/// Learning over the counted sessions. For a feature along the camera's axes, only sessions with the newest calibration
/// count.
fn learning(
    of: &FeatureKey,
    direction: Direction,
    sessions: &[Numbered<'_>],
    target: Option<&Target>,
    known: &Known,
) -> Learning {
    let value = |session: &Numbered<'_>| {
        let Measured { value, .. } = session.evidence(of, None)?.measured()?;
        Some(Session { number: session.number as u32, value })
    };
    let camera = |session: &Numbered<'_>| session.measured(of).map(|(outcome, _)| outcome.calibration);
    let newest = sessions.iter().rev().find(|session| session.counts && value(session).is_some()).and_then(camera);
    let is_comparable = |session: &&Numbered<'_>| !is_of_one_camera(of) || camera(session) == newest;
    let counted = sessions.iter().filter(|session| session.counts).filter(is_comparable).filter_map(value);
    let counted: Vec<Session> = counted.collect();
    let in_state = |state| Learning { state, curve: None, forecast: None, withheld: None };
    let withheld = |why: NoAnswer| Learning { withheld: Some(why.into()), ..in_state(LearningState::Withheld) };
    let first = counted.first().map_or(1, |session| session.number);
    let found = match known.curve(counted, direction) {
        Ok(found) => found,
        Err(why) => return withheld(why),
    };
    match &*found {
        &curve::Learning::TooFew { found, needed } => withheld(NoAnswer::TooFew { of: "sessions", found, needed }),
        curve::Learning::NoCurve => in_state(LearningState::NoCurve),
        curve::Learning::StillStraight => in_state(LearningState::StillStraight),
        curve::Learning::Curve(curve) => Learning {
            forecast: target.map(|target| forecast(curve, target.limit)),
            curve: Some(shown(curve, first)),
            ..in_state(LearningState::Curve)
        },
    }
}

fn shown(curve: &curve::Curve, first: u32) -> Curve {
    let span = curve.last - first;
    let steps = span.clamp(1, LINE_POINTS - 1);
    let at = |step: u32| {
        let session = first + (f64::from(span) * f64::from(step) / f64::from(steps)).round() as u32;
        LinePoint { session, at: Estimate::of(curve.at(session), curve.band(session)) }
    };
    let fitted = |fitted: curve::Fitted| Estimate::of(fitted.value, fitted.interval);
    Curve {
        plateau: fitted(curve.plateau),
        distance: fitted(curve.distance),
        tau_sessions: fitted(curve.tau_sessions),
        scatter: curve.scatter,
        sessions: curve.sessions,
        line: (0..=steps).map(at).collect(),
    }
}

fn forecast(curve: &curve::Curve, limit: f64) -> Forecast {
    let in_state = |state| Forecast { state, at: None, earliest: None, latest: None, withheld: None };
    let withheld = |why: NoAnswer| Forecast { withheld: Some(why.into()), ..in_state(ForecastState::Withheld) };
    match curve.forecast(limit) {
        Err(why) => withheld(why),
        Ok(curve::Forecast::TooFew { found, needed }) => withheld(NoAnswer::TooFew { of: "sessions", found, needed }),
        Ok(curve::Forecast::Reached { at }) => Forecast { at: Some(at), ..in_state(ForecastState::Reached) },
        Ok(curve::Forecast::Ahead { at, earliest, latest }) => {
            Forecast { at: Some(at), earliest: Some(earliest), latest, ..in_state(ForecastState::Ahead) }
        }
        Ok(curve::Forecast::NotWithThisCurve { earliest }) => {
            Forecast { earliest, ..in_state(ForecastState::NotWithThisCurve) }
        }
    }
}
