//! Forecast of the session at which a learning curve reaches a limit.

use super::{CurveParameters, LearningCurve};
use crate::statistics::interval::interval_of_resamples;
use crate::statistics::no_answer::NoAnswer;

/// Minimum number of sessions for a forecast; with only the sessions of a curve its interval would span everything.
pub const MIN_SESSIONS_FOR_FORECAST: usize = 8;

/// When a curve reaches a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Forecast {
    /// It already has.
    Reached {
        /// Number of the first session at which it has.
        at: u32,
    },
    /// It will, if practice continues like this.
    Ahead {
        /// Number of that session.
        at: u32,
        /// Lower end of its 95 % interval.
        earliest: u32,
        /// Upper end of its 95 % interval; `None` if it may never happen, because the interval of the level covers the
        /// limit.
        latest: Option<u32>,
    },
    /// This curve will not: the level that it leads to does not meet the limit.
    NotWithThisCurve {
        /// Lower end of the 95 % interval, if the interval of the level covers the limit.
        earliest: Option<u32>,
    },
    /// Too few sessions.
    TooFew {
        /// Number of sessions with a value.
        found: usize,
        /// Number of sessions needed.
        needed: usize,
    },
}

impl LearningCurve {
    /// Forecasts the session at which the curve itself starts to meet the limit. Half of the single sessions around it
    /// do not yet.
    ///
    /// # Errors
    /// [`NoAnswer::NotFinite`] for a limit that is not finite.
    pub fn forecast(&self, limit: f64) -> Result<Forecast, NoAnswer> {
        NoAnswer::finite(&[limit])?;
        if self.sessions < MIN_SESSIONS_FOR_FORECAST {
            return Ok(Forecast::TooFew { found: self.sessions, needed: MIN_SESSIONS_FOR_FORECAST });
        }
        let keeps_from = |parameters: &CurveParameters| {
            sessions_to_limit(*parameters, limit, self.sign)
                .map_or(f64::INFINITY, |behind| f64::from(self.first) + behind)
        };
        let interval = interval_of_resamples(self.resampled.iter().map(keeps_from).collect());
        let earliest = session_number(interval.low);
        Ok(match session_number(keeps_from(&self.best)) {
            None => Forecast::NotWithThisCurve { earliest },
            Some(at) if at <= self.last => Forecast::Reached { at },
            Some(at) => Forecast::Ahead {
                at,
                earliest: earliest.unwrap_or(at).min(at),
                latest: session_number(interval.high).map(|latest| latest.max(at)),
            },
        })
    }
}

/// Number of sessions after the first until a curve meets the limit; `None` if it never does.
fn sessions_to_limit(curve: CurveParameters, limit: f64, sign: f64) -> Option<f64> {
    let from_level = limit - curve.plateau;
    if sign * from_level >= 0.0 {
        return None;
    }
    // The share of the distance that may remain; at the first session all of it remains.
    let left = from_level / curve.distance;
    let after_first = (-curve.tau * left.ln()).max(0.0);
    // Rounding must not move a crossing at a session to the next session.
    Some((after_first - 1e-9).ceil().max(0.0))
}

/// The session number, if it is a possible one.
fn session_number(number: f64) -> Option<u32> {
    (number <= f64::from(u32::MAX)).then_some(number as u32)
}
