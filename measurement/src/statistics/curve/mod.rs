//! The learning curve y(n) = A + B·exp(−(n − n₁)/τ) of a trainee's sessions at one task, and a forecast from it
//! (METHOD 7.3).
//!
//! n is the session's number and n₁ that of the first session with a value. A is the level that practice leads to and B
//! the distance of the first session from it. That distance shrinks to 37 % within τ sessions. For a given τ the best A
//! and B are those of a straight line, so only τ is searched for (variable projection, Golub & Pereyra 1973). There is
//! a curve only if the values follow the session number better than 95 of 100 random orders of them do, and if they
//! bend: a series that is still straight shows no level. Intervals: the fit is repeated on 400 series with resampled
//! residuals (Efron & Tibshirani 1993, 9.4), seeded by the data. They are widened by the ratio of Student's to the
//! normal distribution, because the scatter is known only from these few sessions. Sessions without a value are left
//! out and keep their number.
//!
//! Cost: 13 ms of processor time for 500 sessions (`make progress-load`, sampled), most of it for the shapes that are
//! tried.

mod forecast;

pub use forecast::{Forecast, MIN_SESSIONS_FOR_FORECAST};

use super::interval::{ConfidenceInterval, interval_of_resamples};
use super::no_answer::NoAnswer;
use super::resampler::Resampler;
use super::standard::sign;
use crate::motion::features::Direction;
use crate::numbers::distribution::{Z_95, student_quantile};

/// Minimum number of sessions for a curve: twice its three parameters.
pub const MIN_SESSIONS: usize = 6;

/// Number of series with resampled residuals.
const RESAMPLES: usize = 400;

/// Number of random orders that a curve is compared with.
const RANDOM_ORDERS: usize = 400;
/// Share of the random orders that may follow the session number as well.
const SIGNIFICANCE: f64 = 0.05;

/// Smallest τ: the fastest learning that sessions can show. After one session five per cent of the distance remain.
const MIN_TAU: f64 = 1.0 / 3.0;

/// Number of values of τ that are tried before the best is refined.
const TAU_STEPS: usize = 48;

/// One session's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberedValue {
    /// Number of the session among this trainee's sessions at this task, from 1.
    pub number: u32,
    /// The feature's value.
    pub value: f64,
}

/// A fitted parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedParameter {
    /// The fitted value.
    pub value: f64,
    /// 95 % interval; an end of τ may lie at the limit of the search.
    pub interval: ConfidenceInterval,
}

/// The result of fitting a learning curve.
#[derive(Clone, Debug, PartialEq)]
pub enum LearningFit {
    /// The values follow a curve.
    Curve(LearningCurve),
    /// The values do not improve with the session number, or not more than by chance.
    NoCurve,
    /// The values improve but do not bend towards a level yet.
    StillStraight,
    /// There are too few sessions.
    TooFew {
        /// Number of sessions with a value.
        found: usize,
        /// Number of sessions needed.
        needed: usize,
    },
}

/// A fitted learning curve.
#[derive(Clone, Debug, PartialEq)]
pub struct LearningCurve {
    /// The level that practice leads to, A, in the feature's unit.
    pub plateau: FittedParameter,
    /// Distance of the first session with a value from that level, B, in the feature's unit: positive if lower is
    /// better.
    pub distance: FittedParameter,
    /// Number of sessions until the distance has shrunk to 37 %, τ.
    pub tau_sessions: FittedParameter,
    /// Standard deviation of a session around the curve, in the feature's unit.
    pub scatter: f64,
    /// Number of sessions with a value.
    pub sessions: usize,
    /// Number of the first of them; the curve says nothing about earlier sessions.
    pub first: u32,
    /// Number of the last of them.
    pub last: u32,
    sign: f64,
    best: CurveParameters,
    resampled: Vec<CurveParameters>,
}

/// A, B and τ.
#[derive(Clone, Copy, Debug, PartialEq)]
struct CurveParameters {
    plateau: f64,
    distance: f64,
    tau: f64,
}

impl CurveParameters {
    /// The curve's value `behind` sessions after the first.
    fn value_after(self, behind: f64) -> f64 {
        self.plateau + self.distance * remaining_distance(behind, self.tau)
    }
}

impl LearningCurve {
    /// The curve's value at a session of this number.
    pub fn value_at(&self, number: u32) -> f64 {
        self.best.value_after(self.behind(number))
    }

    /// 95 % interval of the curve itself at this number; single sessions scatter around it.
    pub fn band(&self, number: u32) -> ConfidenceInterval {
        interval_of_resamples(
            self.resampled.iter().map(|parameters| parameters.value_after(self.behind(number))).collect(),
        )
    }

    fn behind(&self, number: u32) -> f64 {
        f64::from(number) - f64::from(self.first)
    }
}

/// Fits a curve to sessions in ascending order of their numbers.
///
/// # Errors
/// [`NoAnswer`] for unusable values, numbers out of order, or a feature where neither direction is better.
pub fn fit(sessions: &[NumberedValue], direction: Direction) -> Result<LearningFit, NoAnswer> {
    let sign = sign(direction)?;
    let first = sessions.first().map_or(1, |session| session.number);
    let behind: Vec<f64> = sessions.iter().map(|session| f64::from(session.number) - f64::from(first)).collect();
    let values: Vec<f64> = sessions.iter().map(|session| session.value).collect();
    NoAnswer::finite(&values)?;
    if first < 1 || behind.windows(2).any(|pair| pair[0] >= pair[1]) {
        return Err(NoAnswer::NotInOrder);
    }
    if sessions.len() < MIN_SESSIONS {
        return Ok(LearningFit::TooFew { found: sessions.len(), needed: MIN_SESSIONS });
    }
    Ok(fit_series(&TauSearch::over(behind), first, &values, sign))
}

fn fit_series(search: &TauSearch, first: u32, values: &[f64], sign: f64) -> LearningFit {
    let mut chance = Resampler::of(values.iter().copied());
    let Some(best) = search.best(values, sign).filter(|_| search.is_beyond_chance(values, sign, &mut chance)) else {
        return LearningFit::NoCurve;
    };
    if best.tau >= 0.999 * search.max_tau() {
        return LearningFit::StillStraight;
    }
    let fitted: Vec<f64> = search.behind.iter().map(|behind| best.value_after(*behind)).collect();
    let residuals: Vec<f64> = values.iter().zip(&fitted).map(|(value, fitted)| value - fitted).collect();
    let freedom = (values.len() - 3) as f64;
    let scatter = (residuals.iter().map(|residual| residual * residual).sum::<f64>() / freedom).sqrt();
    // The three fitted parameters absorb some of the scatter, so the residuals are scaled up to its true size.
    let inflation = (values.len() as f64 / freedom).sqrt() * student_quantile(0.975, freedom) / Z_95;
    let mut again = || {
        let drawn = chance.resample(&residuals);
        let series: Vec<f64> = fitted.iter().zip(drawn).map(|(fitted, drawn)| fitted + inflation * drawn).collect();
        search.best(&series, sign)
    };
    let resampled: Vec<CurveParameters> = (0..RESAMPLES).filter_map(|_| again()).collect();
    if (resampled.len() as f64) < (1.0 - SIGNIFICANCE) * RESAMPLES as f64 {
        return LearningFit::NoCurve;
    }
    let of = |part: fn(&CurveParameters) -> f64| FittedParameter {
        value: part(&best),
        interval: interval_of_resamples(resampled.iter().map(part).collect()),
    };
    LearningFit::Curve(LearningCurve {
        plateau: of(|parameters| parameters.plateau),
        distance: of(|parameters| parameters.distance),
        tau_sessions: of(|parameters| parameters.tau),
        scatter,
        sessions: values.len(),
        first,
        last: search.behind.last().map_or(first, |last| first + *last as u32),
        sign,
        best,
        resampled,
    })
}

/// The share of the distance that remains `behind` sessions after the first.
fn remaining_distance(behind: f64, tau: f64) -> f64 {
    (-behind / tau).exp()
}

/// The same for sessions in ascending order, each from the one before: a multiplication instead of an exponential.
fn remaining_distances(behind: &[f64], tau: f64) -> impl Iterator<Item = f64> {
    let (step, mut last, mut left) = ((-1.0 / tau).exp(), 0.0, 1.0);
    behind.iter().map(move |number| {
        let gap = number - last;
        left *= if gap == 1.0 { step } else { remaining_distance(gap, tau) };
        last = *number;
        left
    })
}

/// The sum of products, as four parallel sums, which a processor adds at the same time.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (fours, others) = (a.chunks_exact(4).zip(b.chunks_exact(4)), a.len() - a.len() % 4);
    for (a, b) in fours {
        for lane in 0..4 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a[others..].iter().zip(&b[others..]).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// The shape of a curve around its mean, ready to be compared with any series of values of the same sessions.
struct CurveShape {
    tau: f64,
    mean: f64,
    centred: Vec<f64>,
    square: f64,
}

impl CurveShape {
    fn of(behind: &[f64], tau: f64) -> Self {
        let raw: Vec<f64> = remaining_distances(behind, tau).collect();
        let mean = raw.iter().sum::<f64>() / raw.len() as f64;
        let centred: Vec<f64> = raw.iter().map(|value| value - mean).collect();
        let square = centred.iter().map(|value| value * value).sum();
        Self { tau, mean, centred, square }
    }

    /// The part of the values' sum of squares that the best curve of this shape explains; negative if that curve gets
    /// worse.
    fn gain(&self, values: &[f64], sign: f64) -> f64 {
        let product = dot(&self.centred, values);
        // Earlier sessions are worse than the final level: above it if lower is better.
        -sign * product * product.abs() / self.square
    }

    fn parameters(&self, values: &[f64]) -> CurveParameters {
        let distance = dot(&self.centred, values) / self.square;
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        CurveParameters { plateau: mean - distance * self.mean, distance, tau: self.tau }
    }
}

/// The search for τ over sessions at these distances from the first.
struct TauSearch {
    behind: Vec<f64>,
    shapes: Vec<CurveShape>,
}

impl TauSearch {
    fn over(behind: Vec<f64>) -> Self {
        let span = behind[behind.len() - 1];
        // With a τ above 1.5 times the span, the sessions show less than half of the way, and a line fits as well.
        let ratio = (1.5 * span / MIN_TAU).powf(1.0 / (TAU_STEPS - 1) as f64);
        let shapes = (0..TAU_STEPS).map(|i| CurveShape::of(&behind, MIN_TAU * ratio.powi(i as i32)));
        let shapes = shapes.filter(|shape| shape.square > 1e-200).collect();
        Self { behind, shapes }
    }

    fn max_tau(&self) -> f64 {
        self.shapes.last().map_or(0.0, |shape| shape.tau)
    }

    fn best_of_grid(&self, values: &[f64], sign: f64) -> Option<(usize, f64)> {
        let gains = self.shapes.iter().map(|shape| shape.gain(values, sign)).enumerate();
        gains.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, gain)| *gain > 0.0)
    }

    /// The best curve that improves; `None` if none does.
    fn best(&self, values: &[f64], sign: f64) -> Option<CurveParameters> {
        let (index, _) = self.best_of_grid(values, sign)?;
        let tau = |index: usize| self.shapes[index.min(self.shapes.len() - 1)].tau.ln();
        let bracket = (tau(index.saturating_sub(1)), tau(index + 1));
        let log_tau =
            position_of_maximum(bracket, |log_tau| CurveShape::of(&self.behind, log_tau.exp()).gain(values, sign));
        Some(CurveShape::of(&self.behind, log_tau.exp()).parameters(values))
    }

    /// True if the values follow the session numbers better than 95 of 100 random orders of them.
    fn is_beyond_chance(&self, values: &[f64], sign: f64, chance: &mut Resampler) -> bool {
        let gain = |values: &[f64]| self.best_of_grid(values, sign).map_or(0.0, |(_, gain)| gain);
        let own = gain(values);
        let mut order = values.to_vec();
        let as_good = (0..RANDOM_ORDERS).filter(|_| {
            chance.shuffle(&mut order);
            gain(&order) >= own
        });
        let allowed = (SIGNIFICANCE * (1 + RANDOM_ORDERS) as f64) as usize - 1;
        as_good.take(allowed + 1).count() <= allowed // stops as soon as one more is found
    }
}

/// The position of the maximum of a function with a single maximum in an interval.
fn position_of_maximum((mut low, mut high): (f64, f64), of: impl Fn(f64) -> f64) -> f64 {
    // Golden section; ten steps shrink the bracket to 0.8 %.
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (mut left, mut right) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut at_left, mut at_right) = (of(left), of(right));
    for _ in 0..10 {
        if at_left > at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - GOLDEN * (high - low);
            at_left = of(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + GOLDEN * (high - low);
            at_right = of(right);
        }
    }
    // This close to its maximum the function is a parabola; at an end of the interval there is no maximum.
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let (at_low, at_middle, at_high) = (of(low), of(middle), of(high));
    let bend = at_low - 2.0 * at_middle + at_high;
    let vertex = middle + 0.5 * half * (at_low - at_high) / bend;
    if bend < 0.0 && (low..=high).contains(&vertex) { vertex } else { middle }
}

#[cfg(test)]
mod tests;
