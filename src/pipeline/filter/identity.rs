//! The track of one tool through time: which measurements belong to it, when it is lost, and when it restarts
//! elsewhere.
//!
//! A measurement outside the gate is rejected, but not for ever: rejected measurements that agree with each other for
//! [`TrackSettings::reacquire_s`] restart the track at their position. A tool unseen for longer than
//! [`TrackSettings::max_prediction_s`] is lost until it is seen again.

use super::kalman::State;
use super::liveliness::{Liveliness, Step};
use super::smoother::Position;
use crate::pipeline::pose::TubeEstimate;
use crate::pipeline::reason::Reason;

/// Settings of a track: a part of the tracker's motion settings, in the same units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadSettings {
    /// Density of a steady hand's white acceleration, mm²/s³.
    pub noise_density: f64,
    /// Speed that a newly seen tool may have, mm/s.
    pub first_speed_mm_s: f64,
    /// Largest squared Mahalanobis distance of an accepted measurement.
    pub gate: f64,
    /// For how long rejected measurements must agree to be accepted, s.
    pub reacquire_s: f64,
    /// Longest gap that is bridged, s.
    pub longest_prediction_s: f64,
    /// Smallest and largest depth of a tip, mm.
    pub depth_mm: (f64, f64),
}

/// The track of one tool.
#[derive(Clone, Debug, Default)]
pub struct Thread {
    current: Option<Followed>,
    rival: Option<Followed>,
}

#[derive(Clone, Copy, Debug)]
struct Followed {
    state: State,
    time_s: f64,
    began_s: f64,
    seen_s: f64,
    /// Number of measurements accepted so far.
    believed: u32,
    liveliness: Liveliness,
}

impl Followed {
    fn of(time_s: f64, (tip, covariance): Position, settings: &ThreadSettings) -> Self {
        let state = State::first_seen(tip, covariance, settings.first_speed_mm_s);
        Self { state, time_s, began_s: time_s, seen_s: time_s, believed: 1, liveliness: Liveliness::default() }
    }

    fn ahead(&self, time_s: f64, settings: &ThreadSettings) -> Step {
        self.liveliness.ahead(&self.state, time_s - self.time_s, settings.noise_density)
    }

    /// Predicts the state at a measurement's time; `None` if the measurement is outside the gate.
    fn towards(&self, time_s: f64, measured: &Position, settings: &ThreadSettings) -> Option<Step> {
        let dt_s = time_s - self.time_s;
        self.liveliness.towards(&self.state, dt_s, settings.noise_density, measured, settings.gate)
    }

    /// Updates the state with a measurement that [`Self::predict_towards`] accepted.
    fn see(&mut self, time_s: f64, step: &Step, (tip, covariance): Position) {
        self.liveliness.learn(step, time_s - self.time_s);
        self.state = step.state.updated(tip, covariance);
        (self.time_s, self.seen_s) = (time_s, time_s);
        self.believed += 1;
    }
}

/// A track with fewer measurements than this is no more credible than a measurement that contradicts it. If one of two
/// consecutive positions is false, it is unknown which one, and the speed between them is meaningless.
const YOUNG: u32 = 4;

/// Outcome of one frame for a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advance {
    /// The filter's state; `None` where the tool is not tracked.
    pub state: Option<State>,
    /// Acceleration density used for the prediction since the previous frame, mm²/s³; 0 if a new track starts.
    pub noise_density: f64,
    /// True if a new track starts with this state.
    pub begins: bool,
    /// True if the previous track was young and is contradicted: all of its frames are discarded.
    pub disowns: bool,
    /// True if the measurement was accepted.
    pub observed: bool,
    /// Why the measurement was rejected.
    pub refused: Option<Reason>,
}

impl Thread {
    /// The predicted state at a time; `None` if the tool is not being tracked.
    pub fn expected(&self, time_s: f64, settings: &ThreadSettings) -> Option<State> {
        Some(self.tracked(time_s, settings)?.ahead(time_s, settings).state)
    }

    /// Would this pose pass the gate?
    pub fn would_believe(&self, time_s: f64, pose: &TubeEstimate, settings: &ThreadSettings) -> bool {
        let measured = (pose.tube.tip, pose.tip_covariance());
        self.tracked(time_s, settings).is_some_and(|followed| followed.towards(time_s, &measured, settings).is_some())
    }

    /// Advances the track by one frame, with its measurement if there is one.
    pub fn advance(&mut self, time_s: f64, measured: Option<Position>, settings: &ThreadSettings) -> Advance {
        let out_of_bounds =
            measured.is_some_and(|(tip, _)| !(settings.depth_mm.0..=settings.depth_mm.1).contains(&tip.z));
        let mut refused = out_of_bounds.then_some(Reason::OutOfBounds);
        let measured = measured.filter(|_| !out_of_bounds);
        let Some(mut followed) = self.tracked(time_s, settings) else {
            *self = Self::default();
            return match measured {
                Some(position) => self.begin(Followed::of(time_s, position, settings)),
                None => {
                    let (state, noise_density) = (None, 0.0);
                    Advance { state, noise_density, begins: false, disowns: false, observed: false, refused }
                }
            };
        };
        if let Some((position, step)) = measured.and_then(|at| Some((at, followed.towards(time_s, &at, settings)?))) {
            followed.see(time_s, &step, position);
            *self = Self { current: Some(followed), rival: None };
            return Advance::along(&step, followed.state, true, None);
        }
        if let Some(position) = measured {
            refused = Some(Reason::GateRejected);
            if followed.believed < YOUNG {
                return Advance { disowns: true, ..self.begin(Followed::of(time_s, position, settings)) };
            }
            if let Some(rival) = self.believe_rival(time_s, position, settings) {
                return self.begin(rival);
            }
        }
        let step = followed.ahead(time_s, settings);
        self.current = Some(Followed { state: step.state, time_s, ..followed });
        Advance::along(&step, step.state, false, refused)
    }

    /// The current track, if it was measured recently enough.
    fn tracked(&self, time_s: f64, settings: &ThreadSettings) -> Option<Followed> {
        self.current.filter(|followed| time_s - followed.seen_s <= settings.longest_prediction_s)
    }

    fn begin(&mut self, followed: Followed) -> Advance {
        *self = Self { current: Some(Followed { began_s: followed.time_s, believed: 1, ..followed }), rival: None };
        let (state, noise_density) = (Some(followed.state), 0.0);
        Advance { state, noise_density, begins: true, disowns: false, observed: true, refused: None }
    }

    /// Tracks the rejected measurements as a rival. Returns the rival once its measurements have agreed for long
    /// enough.
    fn believe_rival(&mut self, time_s: f64, measured: Position, settings: &ThreadSettings) -> Option<Followed> {
        let agreeing = self.rival.and_then(|mut rival| {
            let step = rival.towards(time_s, &measured, settings)?;
            rival.see(time_s, &step, measured);
            Some(rival)
        });
        let rival = agreeing.unwrap_or_else(|| Followed::of(time_s, measured, settings));
        self.rival = Some(rival);
        (time_s - rival.began_s >= settings.reacquire_s).then_some(rival)
    }
}

impl Advance {
    fn along(step: &Step, state: State, observed: bool, refused: Option<Reason>) -> Self {
        let (state, noise_density) = (Some(state), step.noise_density);
        Self { state, noise_density, begins: false, disowns: false, observed, refused }
    }
}

#[cfg(test)]
pub(super) mod testing {
    use super::ThreadSettings;

    /// The tracker's default settings.
    pub const SETTINGS: ThreadSettings = ThreadSettings {
        noise_density: 8000.0,
        first_speed_mm_s: 150.0,
        gate: 16.3,
        reacquire_s: 0.15,
        longest_prediction_s: 0.2,
        depth_mm: (20.0, 1000.0),
    };
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::testing::SETTINGS;
    use super::*;

    fn at(x: f64) -> Option<(Point3<f64>, Matrix3<f64>)> {
        Some((Point3::new(x, 0.0, 150.0), Matrix3::identity() * 0.05))
    }

    fn settled() -> Thread {
        let mut track = Thread::default();
        for k in 0..10 {
            assert!(track.advance(f64::from(k) * 0.04, at(0.0), &SETTINGS).observed);
        }
        track
    }

    #[test]
    fn one_wild_measurement_is_refused_and_the_thread_goes_on() {
        let mut track = settled();
        let wild = track.advance(0.40, at(60.0), &SETTINGS);
        assert_eq!((wild.observed, wild.refused), (false, Some(Reason::GateRejected)));
        assert!(track.advance(0.44, at(0.0), &SETTINGS).observed);
    }

    #[test]
    fn a_false_first_place_does_not_set_the_speed() {
        let mut track = Thread::default();
        track.advance(0.0, at(14.0), &SETTINGS);
        let followed: Vec<Advance> = (1..8).map(|k| track.advance(f64::from(k) * 0.04, at(0.0), &SETTINGS)).collect();
        assert!(followed.iter().any(|a| a.disowns), "the false start is given up");
        let last = followed.last().and_then(|a| a.state).unwrap();
        assert!((last.tip().x).abs() < 0.5 && last.velocity().norm() < 20.0, "{:?}", last.mean);
    }

    #[test]
    fn measurements_that_agree_elsewhere_are_not_refused_for_ever() {
        let mut track = settled();
        let taken =
            (0..6).map(|k| track.advance(0.40 + f64::from(k) * 0.04, at(60.0), &SETTINGS)).position(|a| a.begins);
        assert!(taken.is_some_and(|k| k >= 3), "{taken:?}");
    }

    #[test]
    fn a_gap_is_bridged_up_to_its_limit_and_not_beyond() {
        let mut track = settled();
        let bridged = (1..=10).filter(|k| track.advance(0.36 + f64::from(*k) * 0.03, None, &SETTINGS).state.is_some());
        assert_eq!(bridged.count(), 6);
        assert!(track.advance(0.80, at(90.0), &SETTINGS).begins);
    }
}
