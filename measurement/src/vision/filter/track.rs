//! The track of one tool through time: which measurements belong to it, when it is lost, and when it restarts
//! elsewhere.
//!
//! A measurement outside the gate is rejected, but not for ever: rejected measurements that agree with each other for
//! [`TrackSettings::reacquire_s`] restart the track at their position. A tool unseen for longer than
//! [`TrackSettings::max_prediction_s`] is lost until it is seen again; a tool whose axis is measured meanwhile, after
//! [`TrackSettings::max_hidden_s`].
//!
//! A tool is not lost at random: motion blur hides a fast one, and a hand that starts moving carries the tip behind
//! something. So what is stated has more process noise in a gap than the measured frames beside it show
//! ([`GAP_LEVEL`]). The gate does not: after a gap, it would let in what lies tens of millimetres away.

use super::adaptive_noise::{AdaptiveNoise, Gate, PredictionStep, TimeStep};
use super::kalman::KalmanState;
use super::smoother::MeasuredPosition;
use crate::vision::pose::TubeEstimate;
use crate::vision::pose::axis_line::AxisLine;
use crate::vision::reason::MissReason;

/// Settings of a track: a part of the tracker's motion settings, in the same units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackSettings {
    /// Density of a steady hand's white acceleration, mm²/s³.
    pub noise_density: f64,
    /// Speed that a newly seen tool may have, mm/s.
    pub first_speed_mm_s: f64,
    /// Largest squared Mahalanobis distance of an accepted measurement.
    pub gate: f64,
    /// For how long rejected measurements must agree to be accepted, s.
    pub reacquire_s: f64,
    /// Longest gap that is bridged, s.
    pub max_prediction_s: f64,
    /// The same while the axis is measured, s.
    pub max_hidden_s: f64,
    /// Smallest and largest depth of a tip, mm.
    pub depth_mm: (f64, f64),
}

/// The track of one tool.
#[derive(Clone, Debug, Default)]
pub struct Track {
    current: Option<TrackState>,
    rival: Option<TrackState>,
}

#[derive(Clone, Copy, Debug)]
struct TrackState {
    /// The state that measurements are compared with.
    gating: KalmanState,
    /// The state that is stated.
    stated: KalmanState,
    time_s: f64,
    began_s: f64,
    last_seen_s: f64,
    /// When the axis was measured last, with the tip or without it.
    last_axis_s: f64,
    /// Number of measurements accepted so far.
    believed: u32,
    liveliness: AdaptiveNoise,
}

impl TrackState {
    fn start(time_s: f64, (tip, covariance): MeasuredPosition, settings: &TrackSettings) -> Self {
        let state = KalmanState::first_seen(tip, covariance, settings.first_speed_mm_s);
        Self {
            gating: state,
            stated: state,
            time_s,
            began_s: time_s,
            last_seen_s: time_s,
            last_axis_s: time_s,
            believed: 1,
            liveliness: AdaptiveNoise::default(),
        }
    }

    /// A step from the last frame to this time.
    fn step(&self, time_s: f64, settings: &TrackSettings) -> TimeStep {
        TimeStep { dt_s: time_s - self.time_s, usual_density: settings.noise_density }
    }

    fn predict(&self, time_s: f64, settings: &TrackSettings) -> PredictionStep {
        self.liveliness.predict(&self.gating, self.step(time_s, settings))
    }

    /// Predicts the state at a measurement's time; `None` if the measurement is outside the gate.
    fn predict_towards(
        &self,
        time_s: f64,
        measured: &MeasuredPosition,
        gate: Gate,
        settings: &TrackSettings,
    ) -> Option<PredictionStep> {
        self.liveliness.predict_towards(&self.gating, self.step(time_s, settings), measured, gate)
    }

    /// The same for a measured tip.
    fn predict_towards_tip(
        &self,
        time_s: f64,
        measured: &MeasuredPosition,
        settings: &TrackSettings,
    ) -> Option<PredictionStep> {
        self.predict_towards(time_s, measured, Gate::of_position(settings.gate), settings)
    }

    /// Advances to a frame and what moves the state there. Returns the acceleration density that is stated, mm²/s³.
    fn advance(
        &mut self,
        time_s: f64,
        step: &PredictionStep,
        measured: Option<MeasuredPosition>,
        settings: &TrackSettings,
    ) -> f64 {
        let is_gap = measured.is_none() || self.last_axis_s < self.time_s;
        let least = if is_gap { GAP_LEVEL * settings.noise_density } else { 0.0 };
        let density = step.noise_density.max(least);
        let stated = self.stated.predicted(time_s - self.time_s, density);
        let update = |state: KalmanState| measured.map_or(state, |(tip, covariance)| state.updated(tip, covariance));
        (self.gating, self.stated) = (update(step.state), update(stated));
        self.time_s = time_s;
        if measured.is_some() {
            self.last_axis_s = time_s;
        }
        density
    }

    /// Advances to a measured tip that [`Self::predict_towards_tip`] accepted.
    fn advance_to_tip(
        &mut self,
        time_s: f64,
        step: &PredictionStep,
        measured: MeasuredPosition,
        settings: &TrackSettings,
    ) -> f64 {
        self.liveliness.learn(step, time_s - self.time_s);
        (self.last_seen_s, self.believed) = (time_s, self.believed + 1);
        self.advance(time_s, step, Some(measured), settings)
    }
}

/// Least factor on the acceleration density that is stated for a step to or from a frame where nothing was measured. In
/// 23 gaps of even ray-traced recordings of bare tools, hands had a mean density of 60 000 mm²/s³, 7.6 times the usual
/// one, and on the measured frames 11 000; in 32 gaps of odd ones 45 000 and 4000.
const GAP_LEVEL: f64 = 8.0;

/// A track with fewer measurements than this is no more credible than a measurement that contradicts it. If one of two
/// consecutive positions is false, it is unknown which one, and the speed between them is meaningless.
const MIN_CREDIBLE_MEASUREMENTS: u32 = 4;

/// Outcome of one frame for a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advance {
    /// The filter's state as it is stated; `None` where the tool is not tracked.
    pub state: Option<KalmanState>,
    /// Acceleration density of that state's prediction since the previous frame, mm²/s³; 0 if a new track starts.
    pub noise_density: f64,
    /// True if a new track starts with this state.
    pub starts_track: bool,
    /// True if the previous track was young and is contradicted: all of its frames are discarded.
    pub discards_previous: bool,
    /// True if the measurement was accepted.
    pub observed: bool,
    /// Why the measurement was rejected.
    pub refused: Option<MissReason>,
}

impl Track {
    /// The predicted state at a time, to compare measurements with; `None` if the tool is not being tracked.
    pub fn expected(&self, time_s: f64, settings: &TrackSettings) -> Option<KalmanState> {
        Some(self.current_if_recent(time_s, settings)?.predict(time_s, settings).state)
    }

    /// Has it been followed since this time, s?
    pub fn is_followed_since(&self, time_s: f64) -> bool {
        self.current.as_ref().is_some_and(|current| current.began_s <= time_s)
    }

    /// Would this pose pass the gate?
    pub fn would_accept(&self, time_s: f64, pose: &TubeEstimate, settings: &TrackSettings) -> bool {
        let measured = (pose.tube.tip, pose.changing_tip_covariance());
        self.current_if_recent(time_s, settings)
            .is_some_and(|followed| followed.predict_towards_tip(time_s, &measured, settings).is_some())
    }

    /// Advances the track by one frame, with its measurement if there is one.
    pub fn advance(&mut self, time_s: f64, measured: Option<MeasuredPosition>, settings: &TrackSettings) -> Advance {
        let out_of_bounds =
            measured.is_some_and(|(tip, _)| !(settings.depth_mm.0..=settings.depth_mm.1).contains(&tip.z));
        let mut refused = out_of_bounds.then_some(MissReason::OutOfBounds);
        let measured = measured.filter(|_| !out_of_bounds);
        let Some(mut followed) = self.current_if_recent(time_s, settings) else {
            *self = Self::default();
            return match measured {
                Some(position) => self.start_track(TrackState::start(time_s, position, settings)),
                None => {
                    let (state, noise_density) = (None, 0.0);
                    Advance {
                        state,
                        noise_density,
                        starts_track: false,
                        discards_previous: false,
                        observed: false,
                        refused,
                    }
                }
            };
        };
        if let Some((position, step)) =
            measured.and_then(|at| Some((at, followed.predict_towards_tip(time_s, &at, settings)?)))
        {
            let density = followed.advance_to_tip(time_s, &step, position, settings);
            *self = Self { current: Some(followed), rival: None };
            return Advance::along(&followed, density, true, None);
        }
        if let Some(position) = measured {
            refused = Some(MissReason::GateRejected);
            if followed.believed < MIN_CREDIBLE_MEASUREMENTS {
                return Advance {
                    discards_previous: true,
                    ..self.start_track(TrackState::start(time_s, position, settings))
                };
            }
            if let Some(rival) = self.advance_rival(time_s, position, settings) {
                return self.start_track(rival);
            }
        }
        let step = followed.predict(time_s, settings);
        let density = followed.advance(time_s, &step, None, settings);
        self.current = Some(followed);
        Advance::along(&followed, density, false, refused)
    }

    /// Advances the track by one frame on which only the tool's axis was measured: the tip moves with it, and stays
    /// unseen. Returns also the position that the state was updated with; `None` if the axis is outside the gate, or
    /// without a track.
    pub fn advance_along_axis(
        &mut self,
        time_s: f64,
        line: &AxisLine,
        settings: &TrackSettings,
    ) -> (Advance, Option<MeasuredPosition>) {
        let Some(mut followed) = self.current_if_recent(time_s, settings) else {
            return (self.advance(time_s, None, settings), None);
        };
        let (tip, covariance) = line.position_near(followed.predict(time_s, settings).state.tip());
        let is_in_bounds = (settings.depth_mm.0..=settings.depth_mm.1).contains(&tip.z);
        let gate = Gate::of_line(settings.gate);
        let step = followed.predict_towards(time_s, &(tip, covariance), gate, settings).filter(|_| is_in_bounds);
        let Some(step) = step else { return (self.advance(time_s, None, settings), None) };
        followed.liveliness.learn_from_line(&step, time_s - followed.time_s);
        let density = followed.advance(time_s, &step, Some((tip, covariance)), settings);
        self.current = Some(followed);
        (Advance::along(&followed, density, false, None), Some((tip, covariance)))
    }

    /// The current track, if it was measured recently enough.
    fn current_if_recent(&self, time_s: f64, settings: &TrackSettings) -> Option<TrackState> {
        self.current.filter(|followed| {
            time_s - followed.last_axis_s <= settings.max_prediction_s
                && (time_s - followed.last_seen_s <= settings.max_prediction_s.max(settings.max_hidden_s))
        })
    }

    fn start_track(&mut self, followed: TrackState) -> Advance {
        *self = Self { current: Some(TrackState { began_s: followed.time_s, believed: 1, ..followed }), rival: None };
        let (state, noise_density) = (Some(followed.stated), 0.0);
        Advance { state, noise_density, starts_track: true, discards_previous: false, observed: true, refused: None }
    }

    /// Tracks the rejected measurements as a rival. Returns the rival once its measurements have agreed for long
    /// enough.
    fn advance_rival(
        &mut self,
        time_s: f64,
        measured: MeasuredPosition,
        settings: &TrackSettings,
    ) -> Option<TrackState> {
        let agreeing = self.rival.and_then(|mut rival| {
            let step = rival.predict_towards_tip(time_s, &measured, settings)?;
            rival.advance_to_tip(time_s, &step, measured, settings);
            Some(rival)
        });
        let rival = agreeing.unwrap_or_else(|| TrackState::start(time_s, measured, settings));
        self.rival = Some(rival);
        (time_s - rival.began_s >= settings.reacquire_s).then_some(rival)
    }
}

impl Advance {
    fn along(followed: &TrackState, noise_density: f64, observed: bool, refused: Option<MissReason>) -> Self {
        let state = Some(followed.stated);
        Self { state, noise_density, starts_track: false, discards_previous: false, observed, refused }
    }
}

#[cfg(test)]
pub(super) mod testing {
    use super::TrackSettings;

    /// The tracker's default settings.
    pub const SETTINGS: TrackSettings = TrackSettings {
        noise_density: 8000.0,
        first_speed_mm_s: 150.0,
        gate: 16.3,
        reacquire_s: 0.15,
        max_prediction_s: 0.2,
        max_hidden_s: 0.5,
        depth_mm: (20.0, 1000.0),
    };
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3, Vector3};

    use super::testing::SETTINGS;
    use super::*;

    fn at(x: f64) -> Option<(Point3<f64>, Matrix3<f64>)> {
        Some((Point3::new(x, 0.0, 150.0), Matrix3::identity() * 0.05))
    }

    fn settled() -> Track {
        let mut track = Track::default();
        for k in 0..10 {
            assert!(track.advance(f64::from(k) * 0.04, at(0.0), &SETTINGS).observed);
        }
        track
    }

    #[test]
    fn one_wild_measurement_is_rejected_and_the_track_continues() {
        let mut track = settled();
        let wild = track.advance(0.40, at(60.0), &SETTINGS);
        assert_eq!((wild.observed, wild.refused), (false, Some(MissReason::GateRejected)));
        assert!(track.advance(0.44, at(0.0), &SETTINGS).observed);
    }

    #[test]
    fn a_false_first_place_does_not_set_the_speed() {
        let mut track = Track::default();
        track.advance(0.0, at(14.0), &SETTINGS);
        let followed: Vec<Advance> = (1..8).map(|k| track.advance(f64::from(k) * 0.04, at(0.0), &SETTINGS)).collect();
        assert!(followed.iter().any(|a| a.discards_previous), "the false start is given up");
        let last = followed.last().and_then(|a| a.state).unwrap();
        assert!((last.tip().x).abs() < 0.5 && last.velocity().norm() < 20.0, "{:?}", last.mean);
    }

    #[test]
    fn measurements_that_agree_elsewhere_are_not_refused_for_ever() {
        let mut track = settled();
        let taken =
            (0..6).map(|k| track.advance(0.40 + f64::from(k) * 0.04, at(60.0), &SETTINGS)).position(|a| a.starts_track);
        assert!(taken.is_some_and(|k| k >= 3), "{taken:?}");
    }

    #[test]
    fn a_gap_is_bridged_up_to_its_limit_and_not_beyond() {
        let mut track = settled();
        let bridged = (1..=10).filter(|k| track.advance(0.36 + f64::from(*k) * 0.03, None, &SETTINGS).state.is_some());
        assert_eq!(bridged.count(), 6);
        assert!(track.advance(0.80, at(90.0), &SETTINGS).starts_track);
    }

    /// An axis upwards in the picture.
    fn line_at(x: f64) -> AxisLine {
        AxisLine { point: Point3::new(x, 20.0, 150.0), direction: Vector3::y(), across_mm: 0.1, depth_mm: 1.0 }
    }

    #[test]
    fn a_measured_axis_moves_a_hidden_tip_across_it_and_keeps_the_track_for_longer() {
        let mut track = settled();
        // The axis moves away at 30 mm/s after the tip was at rest.
        let place = |k: u32| 0.6 * f64::from(k);
        let hidden = (1..=14).filter_map(|k| {
            let (x, time_s) = (place(k), 0.36 + f64::from(k) * 0.04);
            let (advance, _) = track.advance_along_axis(time_s, &line_at(x), &SETTINGS);
            assert!(!advance.observed);
            Some((x, advance.state?))
        });
        let followed: Vec<(f64, KalmanState)> = hidden.collect();
        assert_eq!(followed.len(), 12, "half a second");
        for (x, state) in &followed[2..] {
            assert!((state.tip().x - x).abs() < 0.4, "{} mm, not {x}", state.tip().x);
        }
        let spread = followed[11].1.tip_covariance().diagonal();
        assert!(spread.x.sqrt() < 0.3 && spread.y.sqrt() > 2.0, "known across the axis only: {spread}");
    }

    #[test]
    fn an_axis_far_from_the_expected_tip_is_not_believed() {
        let mut track = settled();
        let (advance, used) = track.advance_along_axis(0.40, &line_at(60.0), &SETTINGS);
        assert!(used.is_none() && advance.state.is_some_and(|state| state.tip().x.abs() < 1.0));
    }

    #[test]
    fn an_axis_is_explained_as_a_line_is() {
        // A squared distance of 7: usual for a position (95 % are below 7.8), unusual for a line (6.0).
        let mut track = settled();
        let expected = track.expected(0.40, &SETTINGS).unwrap();
        let across_mm2 = expected.tip_covariance()[(0, 0)] + 0.1 * 0.1;
        let (advance, used) = track.advance_along_axis(0.40, &line_at((7.0 * across_mm2).sqrt()), &SETTINGS);
        assert!(used.is_some() && advance.noise_density > 1.5 * SETTINGS.noise_density, "{}", advance.noise_density);
    }

    #[test]
    fn an_axis_at_rest_does_not_make_a_lively_hand_steady() {
        let zigzag = |k: u32| at(if k.is_multiple_of(2) { 0.0 } else { 2.5 });
        let mut track = Track::default();
        for k in 0..25 {
            assert!(track.advance(f64::from(k) * 0.04, zigzag(k), &SETTINGS).observed);
        }
        let mut hidden = track.clone();
        let tip_x = |track: &Track, time_s: f64| track.expected(time_s, &SETTINGS).unwrap().tip().x;
        for k in 25..35 {
            let time_s = f64::from(k) * 0.04;
            let line = line_at(tip_x(&hidden, time_s));
            assert!(hidden.advance_along_axis(time_s, &line, &SETTINGS).1.is_some());
        }
        let [before, after] = [(&mut track, 25), (&mut hidden, 35)]
            .map(|(track, k)| track.advance(f64::from(k) * 0.04, None, &SETTINGS).noise_density);
        assert!(before > 10.0 * SETTINGS.noise_density, "{before}: livelier than any gap");
        assert!((after - before).abs() < 1e-6 * before, "{before} before the axis alone was seen, then {after}");
    }
}
