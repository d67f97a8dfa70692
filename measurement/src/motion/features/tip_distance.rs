//! Features of the distance between the two tips.

use super::motion::Motion;
use super::two_hands::common_nodes;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, MeasureFn, NotEnough, StretchSource};
use crate::numbers::quantile::quantile;

/// Mean distance.
pub static TIP_DISTANCE: Feature = Feature {
    name: "tip_distance",
    title: "Distance between the tips",
    family: Family::TwoHands,
    unit: "mm",
    direction: Direction::Neither,
    description: "Mean distance between the two tips while both are seen.",
    source: "SurgTrac",
    range: (0.0, 20_000.0),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::WholeTask,
    habit: None,
    measures: &[MeasureFn::Pair(tip_distance)],
};

/// How much the distance varies.
pub static TIP_DISTANCE_SPREAD: Feature = Feature {
    name: "tip_distance_spread",
    title: "Spread of the tips' distance",
    description: "Standard deviation of the distance between the two tips while both are seen.",
    windowed: false,
    stretches: StretchSource::UnusualTipDistance,
    measures: &[MeasureFn::Pair(tip_distance_spread)],
    ..TIP_DISTANCE
};

/// The shortest distance without outliers: the 5 % quantile.
pub static TIP_DISTANCE_LOW: Feature = Feature {
    name: "tip_distance_low",
    title: "Distance between the tips (5 %)",
    description: "The tips are closer than this in 5 % of the time in which both are seen.",
    windowed: false,
    stretches: StretchSource::ShortTipDistance,
    measures: &[MeasureFn::Pair(|a, b, settings| tip_distance_quantile(a, b, settings, 0.05))],
    ..TIP_DISTANCE
};

/// The largest distance without outliers: the 95 % quantile.
pub static TIP_DISTANCE_HIGH: Feature = Feature {
    name: "tip_distance_high",
    title: "Distance between the tips (95 %)",
    description: "The tips are farther apart than this in 5 % of the time in which both are seen.",
    windowed: false,
    stretches: StretchSource::LongTipDistance,
    measures: &[MeasureFn::Pair(|a, b, settings| tip_distance_quantile(a, b, settings, 0.95))],
    ..TIP_DISTANCE
};

fn tip_distance(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    Ok(mean(&distances(a, b, settings)?))
}

fn tip_distance_spread(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let distances = distances(a, b, settings)?;
    let middle = mean(&distances);
    let squares: Vec<f64> = distances.iter().map(|distance| (distance - middle).powi(2)).collect();
    Ok(mean(&squares).sqrt())
}

fn tip_distance_quantile(a: &Motion, b: &Motion, settings: &FeatureSettings, share: f64) -> Result<f64, NotEnough> {
    Ok(quantile(distances(a, b, settings)?, share).unwrap_or(f64::NAN))
}

fn distances(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<Vec<f64>, NotEnough> {
    Ok(common_nodes(a, b, settings)?.iter().map(|(a, b)| (a.position - b.position).norm()).collect())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
