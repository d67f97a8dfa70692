//! The lag of a track: the time shift that minimises its difference from the truth.
//!
//! The lag τ minimises the squared difference between the track and the truth τ earlier, with each tool's mean removed
//! (a bias is no delay). It is found by Gauss–Newton steps from zero. The standard error uses sums over half seconds
//! rather than single rows, because a filter's errors are correlated from row to row (cluster-robust sandwich, Cameron
//! & Miller 2015).

use std::collections::HashMap;

use nalgebra::Vector3;

use super::judged::JudgedRow;
use super::motion::TrueMotion;

/// Minimum of rows for an estimate.
const MIN_ROWS: usize = 20;

/// Minimum of clusters of rows for a standard error.
const MIN_CLUSTERS: usize = 5;

/// Rows within this time form one cluster, s.
const CLUSTER_S: f64 = 0.5;

/// Maximum standard error of a lag that says anything about a filter, s: a quarter of a frame at 25 Hz.
const MAX_SIGMA_S: f64 = 0.01;

/// Minimum speed, RMS about its mean, mm/s; below it nothing moves.
const MIN_SPEED_MM_S: f64 = 1.0;

/// Maximum lag that is searched, s.
const MAX_LAG_S: f64 = 0.5;

const MAX_STEPS: usize = 12;

/// The lag of a track behind the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lag {
    /// The lag could be measured.
    Measured {
        /// Lag, s; positive if the track is late.
        lag_s: f64,
        /// Its standard error, s.
        sigma_s: f64,
    },
    /// The tools move too little, or for too short a time, to measure a lag.
    TooLittleMotion,
}

/// The lag of these rows, grouped by tool.
pub(super) fn estimate_lag(rows: &[&JudgedRow], motions: &HashMap<&str, TrueMotion>) -> Lag {
    let mut lag_s = 0.0;
    for _ in 0..MAX_STEPS {
        let Some(step) = LagStep::from(rows, motions, lag_s) else { return Lag::TooLittleMotion };
        lag_s += step.by_s;
        if lag_s.abs() > MAX_LAG_S {
            return Lag::TooLittleMotion;
        }
        if step.by_s.abs() < 1e-6 {
            return step.to_lag(lag_s);
        }
    }
    Lag::TooLittleMotion // no minimum within the steps allowed
}

/// One Gauss–Newton step, with the sums for its standard error.
struct LagStep {
    by_s: f64,
    /// Sums of the derivative's terms over each cluster, mm²/s, at the end of the step.
    clusters: Vec<f64>,
    /// Sum of the squared speeds about their mean, mm²/s².
    motion: f64,
}

impl LagStep {
    fn from(rows: &[&JudgedRow], motions: &HashMap<&str, TrueMotion>, lag_s: f64) -> Option<LagStep> {
        let pairs = centred(rows, motions, lag_s);
        let (n, motion) = (pairs.len(), pairs.iter().map(|p| p.velocity.norm_squared()).sum::<f64>());
        let by_s = -pairs.iter().map(|p| p.error.dot(&p.velocity)).sum::<f64>() / motion;
        let mut clusters: HashMap<(&str, i64), f64> = HashMap::new();
        for pair in &pairs {
            *clusters.entry(pair.cluster).or_default() += (pair.error + pair.velocity * by_s).dot(&pair.velocity);
        }
        let enough = n >= MIN_ROWS && motion / n as f64 > MIN_SPEED_MM_S * MIN_SPEED_MM_S;
        enough.then(|| LagStep { by_s, clusters: clusters.into_values().collect(), motion })
    }

    fn to_lag(&self, lag_s: f64) -> Lag {
        let n = self.clusters.len() as f64;
        let square = self.clusters.iter().map(|sum| sum * sum).sum::<f64>() * n / (n - 1.0).max(1.0);
        let sigma_s = square.sqrt() / self.motion;
        let is_sure = self.clusters.len() >= MIN_CLUSTERS && sigma_s <= MAX_SIGMA_S;
        if is_sure { Lag::Measured { lag_s, sigma_s } } else { Lag::TooLittleMotion }
    }
}

/// A row's error against the truth `lag_s` earlier and the velocity there, both about their tool's means.
struct LagPair<'a> {
    error: Vector3<f64>,
    velocity: Vector3<f64>,
    cluster: (&'a str, i64),
}

fn centred<'a>(rows: &[&JudgedRow<'a>], motions: &HashMap<&str, TrueMotion>, lag_s: f64) -> Vec<LagPair<'a>> {
    let mut of_tool: HashMap<&str, Vec<LagPair>> = HashMap::new();
    for row in rows {
        let Some((tip, velocity)) = motions.get(row.tool).and_then(|m| m.at(row.time_s - lag_s)) else { continue };
        let cluster = (row.tool, (row.time_s / CLUSTER_S).floor() as i64);
        of_tool.entry(row.tool).or_default().push(LagPair { error: row.sample.tip_mm - tip, velocity, cluster });
    }
    for pairs in of_tool.values_mut() {
        let mean = |of: fn(&LagPair) -> Vector3<f64>| pairs.iter().map(of).sum::<Vector3<f64>>() / pairs.len() as f64;
        let (error, velocity) = (mean(|p| p.error), mean(|p| p.velocity));
        for pair in pairs {
            pair.error -= error;
            pair.velocity -= velocity;
        }
    }
    of_tool.into_values().flatten().collect()
}
