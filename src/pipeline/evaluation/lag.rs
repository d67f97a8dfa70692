//! By how much a track comes late: the shift in time at which it differs least from the truth.
//!
//! The track minus the truth τ earlier, each tool's mean taken out (a bias is no delay), is least in squares at the
//! lag τ: Gauss–Newton steps from zero. How sure it is comes from sums over half seconds rather than from single rows,
//! because a filter's errors hang together from row to row (cluster-robust sandwich, Cameron & Miller 2015).

use std::collections::HashMap;

use nalgebra::Vector3;

use super::judged::Judged;
use super::motion::Motion;

/// Fewest rows from which a lag is estimated.
const FEWEST_ROWS: usize = 20;

/// Fewest clusters of rows from which its standard error is.
const FEWEST_CLUSTERS: usize = 5;

/// Rows within this time count as one, s.
const CLUSTER_S: f64 = 0.5;

/// A standard error above this says nothing about a filter, s: a quarter of a frame at 25 Hz.
const LEAST_SURE_S: f64 = 0.01;

/// Slowest motion, RMS about its mean, mm/s: below that nothing moves.
const SLOWEST_MM_S: f64 = 1.0;

/// Longest lag that is looked for, s.
const LONGEST_S: f64 = 0.5;

const STEPS: usize = 12;

/// The delay of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lag {
    /// What it is.
    Measured {
        /// Above zero: the track comes late, s.
        lag_s: f64,
        /// Its standard error, s.
        sigma_s: f64,
    },
    /// So little moves that no delay could be told, or for too short a time.
    TooLittleMotion,
}

/// The lag of these rows, grouped by tool.
pub(super) fn lag(rows: &[&Judged], motions: &HashMap<&str, Motion>) -> Lag {
    let mut lag_s = 0.0;
    for _ in 0..STEPS {
        let Some(step) = Step::from(rows, motions, lag_s) else { return Lag::TooLittleMotion };
        lag_s += step.by_s;
        if lag_s.abs() > LONGEST_S {
            return Lag::TooLittleMotion;
        }
        if step.by_s.abs() < 1e-6 {
            return step.settled(lag_s);
        }
    }
    Lag::TooLittleMotion // no least in reach
}

/// One Gauss–Newton step, and what it was made of.
struct Step {
    by_s: f64,
    /// Sums of the derivative's terms over each cluster, mm²/s, at the end of the step.
    clusters: Vec<f64>,
    /// Sum of the squared speeds about their mean, mm²/s².
    motion: f64,
}

impl Step {
    fn from(rows: &[&Judged], motions: &HashMap<&str, Motion>, lag_s: f64) -> Option<Step> {
        let pairs = centred(rows, motions, lag_s);
        let (n, motion) = (pairs.len(), pairs.iter().map(|p| p.velocity.norm_squared()).sum::<f64>());
        let by_s = -pairs.iter().map(|p| p.error.dot(&p.velocity)).sum::<f64>() / motion;
        let mut clusters: HashMap<(&str, i64), f64> = HashMap::new();
        for pair in &pairs {
            *clusters.entry(pair.cluster).or_default() += (pair.error + pair.velocity * by_s).dot(&pair.velocity);
        }
        let enough = n >= FEWEST_ROWS && motion / n as f64 > SLOWEST_MM_S * SLOWEST_MM_S;
        enough.then(|| Step { by_s, clusters: clusters.into_values().collect(), motion })
    }

    fn settled(&self, lag_s: f64) -> Lag {
        let n = self.clusters.len() as f64;
        let square = self.clusters.iter().map(|sum| sum * sum).sum::<f64>() * n / (n - 1.0).max(1.0);
        let sigma_s = square.sqrt() / self.motion;
        let told = self.clusters.len() >= FEWEST_CLUSTERS && sigma_s <= LEAST_SURE_S;
        if told { Lag::Measured { lag_s, sigma_s } } else { Lag::TooLittleMotion }
    }
}

/// A row's error against the truth `lag_s` earlier and the velocity there, both about their tool's means.
struct Pair<'a> {
    error: Vector3<f64>,
    velocity: Vector3<f64>,
    cluster: (&'a str, i64),
}

fn centred<'a>(rows: &[&Judged<'a>], motions: &HashMap<&str, Motion>, lag_s: f64) -> Vec<Pair<'a>> {
    let mut of_tool: HashMap<&str, Vec<Pair>> = HashMap::new();
    for row in rows {
        let Some((tip, velocity)) = motions.get(row.tool).and_then(|m| m.at(row.time_s - lag_s)) else { continue };
        let cluster = (row.tool, (row.time_s / CLUSTER_S).floor() as i64);
        of_tool.entry(row.tool).or_default().push(Pair { error: row.sample.tip_mm - tip, velocity, cluster });
    }
    for pairs in of_tool.values_mut() {
        let mean = |of: fn(&Pair) -> Vector3<f64>| pairs.iter().map(of).sum::<Vector3<f64>>() / pairs.len() as f64;
        let (error, velocity) = (mean(|p| p.error), mean(|p| p.velocity));
        for pair in pairs {
            pair.error -= error;
            pair.velocity -= velocity;
        }
    }
    of_tool.into_values().flatten().collect()
}
