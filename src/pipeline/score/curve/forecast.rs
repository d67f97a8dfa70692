//! How many more sessions a learning curve asks for.

use super::{Curve, Parameters};
use crate::pipeline::score::interval::of_resamples;
use crate::pipeline::score::no_answer::NoAnswer;

/// Fewest sessions of which a forecast is made; with those of a curve alone its interval spans everything.
pub const FEWEST_FOR_FORECAST: usize = 8;

/// When a curve keeps a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Forecast {
    /// It already does.
    Reached {
        /// From the session of this number on.
        at: u32,
    },
    /// It will, if practice goes on like this.
    Ahead {
        /// The number of the session.
        at: u32,
        /// The earliest number with 95 %.
        earliest: u32,
        /// The latest with 95 %; `None` if it may never be: the interval of the level then covers the limit.
        latest: Option<u32>,
    },
    /// Not with this curve: the level that it leads to does not keep the limit.
    NotWithThisCurve {
        /// The earliest number with 95 %, if the level's interval covers the limit.
        earliest: Option<u32>,
    },
    /// Too few sessions.
    TooFew {
        /// Sessions with a value.
        found: usize,
        /// Sessions that it takes.
        needed: usize,
    },
}

impl Curve {
    /// From which session on the curve itself keeps the limit: half of the sessions about it do not yet.
    pub fn forecast(&self, limit: f64) -> Result<Forecast, NoAnswer> {
        NoAnswer::finite(&[limit])?;
        if self.sessions < FEWEST_FOR_FORECAST {
            return Ok(Forecast::TooFew { found: self.sessions, needed: FEWEST_FOR_FORECAST });
        }
        let keeps_from = |parameters: &Parameters| {
            keeps_after(*parameters, limit, self.sign).map_or(f64::INFINITY, |behind| f64::from(self.first) + behind)
        };
        let interval = of_resamples(self.resampled.iter().map(keeps_from).collect());
        let earliest = number(interval.low);
        Ok(match number(keeps_from(&self.best)) {
            None => Forecast::NotWithThisCurve { earliest },
            Some(at) if at <= self.last => Forecast::Reached { at },
            Some(at) => Forecast::Ahead {
                at,
                earliest: earliest.unwrap_or(at).min(at),
                latest: number(interval.high).map(|latest| latest.max(at)),
            },
        })
    }
}

/// How many sessions behind the first a curve keeps the limit from; `None` if it never does.
fn keeps_after(curve: Parameters, limit: f64, sign: f64) -> Option<f64> {
    let from_level = limit - curve.plateau;
    if sign * from_level >= 0.0 {
        return None;
    }
    // What may be left of the distance; the whole of it is left at the first session.
    let left = from_level / curve.distance;
    let after_first = (-curve.tau * left.ln()).max(0.0);
    // A crossing right at a session must not become the next one by rounding.
    Some((after_first - 1e-9).ceil().max(0.0))
}

/// A session's number, if it is one that anybody could reach.
fn number(number: f64) -> Option<u32> {
    (number <= f64::from(u32::MAX)).then_some(number as u32)
}
