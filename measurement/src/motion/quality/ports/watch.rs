//! Whether camera or trocars have moved, while the recording still arrives.
//!
//! **In:** each second, the placement of the trocars as known so far. **Out:** [`ConfirmedPlacement`]: the
//! displacements that were found without a break for [`MIN_HOLD_S`]. **Method:** the trocar's position is computed
//! again each time the number of usable poses has doubled. An early estimate comes from a tool that has turned little,
//! and its stated error is too small for what all its poses share. A displacement that later estimates do not repeat is
//! such an error; a trocar that has really moved stays where it is. Errors are taken wider than stated
//! ([`with_early_error`]).

use serde::{Deserialize, Serialize};

use super::{Displacement, PortPlacement};
use crate::vision::pose::fulcrum::Fulcrum;

/// Time for which a displacement must be found without a break before it is reported, s.
pub const MIN_HOLD_S: f64 = 10.0;

/// True error of a trocar's position early in a recording, in multiples of the stated one. On 20 simulated recordings,
/// early estimates were off by up to 6.3 stated standard deviations; 3.76 is the limit of chance.
const EARLY_SIGMA_RATIO: f64 = 1.7;

/// The trocar of a recording that still arrives, with the error that it really has.
pub fn with_early_error(fulcrum: Fulcrum) -> Fulcrum {
    Fulcrum { covariance: fulcrum.covariance * (EARLY_SIGMA_RATIO * EARLY_SIGMA_RATIO), ..fulcrum }
}

/// The displacements that have lasted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConfirmedPlacement {
    /// The displacement of the camera; `None` if it has not moved.
    pub camera: Option<Displacement>,
    /// For each tool: the displacement of its trocar alone; `None` if it has not moved.
    pub ports: Vec<Option<Displacement>>,
}

/// Watches the placement during a recording.
#[derive(Clone, Debug)]
pub struct PlacementWatch {
    camera_since_s: Option<f64>,
    ports_since_s: Vec<Option<f64>>,
}

impl PlacementWatch {
    /// Starts with this many tools.
    pub fn new(tools: usize) -> Self {
        Self { camera_since_s: None, ports_since_s: vec![None; tools] }
    }

    /// Takes the placement at a time, s; returns what is confirmed, or `None` while no trocar is known.
    pub fn update(&mut self, time_s: f64, placement: &PortPlacement) -> Option<ConfirmedPlacement> {
        let camera = held(&mut self.camera_since_s, placement.camera, time_s);
        let ports = self.ports_since_s.iter_mut().enumerate();
        let ports = ports.map(|(tool, since_s)| held(since_s, placement.port(tool), time_s)).collect();
        placement.tools.iter().any(Option::is_some).then_some(ConfirmedPlacement { camera, ports })
    }
}

/// The displacement, if there has been one for long enough.
fn held(since_s: &mut Option<f64>, now: Option<Displacement>, time_s: f64) -> Option<Displacement> {
    *since_s = now.map(|_| since_s.unwrap_or(time_s));
    now.filter(|_| since_s.is_some_and(|since_s| time_s - since_s >= MIN_HOLD_S))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::*;

    fn placement(mm: f64) -> PortPlacement {
        PortPlacement { camera: None, tools: vec![Some(Displacement { mm, sigma_mm: 1.0 }), None] }
    }

    /// What is confirmed for the first tool, second by second.
    fn confirmed(mm: impl Fn(u32) -> f64, seconds: u32) -> Vec<bool> {
        let mut watch = PlacementWatch::new(2);
        let at = |second: u32| watch.update(f64::from(second), &placement(mm(second))).unwrap().ports[0].is_some();
        (0..seconds).map(at).collect()
    }

    #[test]
    fn a_displacement_that_comes_and_goes_is_not_reported() {
        let wavers = |second: u32| if second % 8 == 4 || second >= 40 { 8.0 } else { 3.0 };
        assert!(confirmed(wavers, 48).iter().all(|moved| !moved));
    }

    #[test]
    fn a_displacement_that_stays_is_reported_after_its_hold() {
        let reported = confirmed(|second| if second >= 4 { 8.0 } else { 3.0 }, 30);
        assert_eq!(reported.iter().position(|moved| *moved), Some(14));
        assert!(reported[14..].iter().all(|moved| *moved));
    }

    #[test]
    fn a_moved_camera_is_held_against_the_same_time() {
        let mut watch = PlacementWatch::new(1);
        let shift = Some(Displacement { mm: 20.0, sigma_mm: 1.0 });
        let moved = PortPlacement { camera: shift, tools: vec![shift] };
        let at = |second: u32| watch.update(f64::from(second), &moved).unwrap();
        let all: Vec<ConfirmedPlacement> = (0..12).map(at).collect();
        assert!(all[9].camera.is_none() && all[10].camera == shift, "{all:?}");
        assert_eq!(all[11].ports, [None], "one thing has moved, not two");
    }

    #[test]
    fn an_early_error_is_wider_than_stated() {
        let stated = Fulcrum { at: Point3::new(1.0, 2.0, 3.0), covariance: Matrix3::identity() };
        let shift = |fulcrum: Fulcrum| Displacement { mm: 6.3, sigma_mm: fulcrum.covariance[(0, 0)].sqrt() };
        assert!(shift(stated).is_significant() && !shift(with_early_error(stated)).is_significant());
    }

    #[test]
    fn nothing_is_known_without_a_trocar() {
        let unknown = PortPlacement { camera: None, tools: vec![None] };
        assert_eq!(PlacementWatch::new(1).update(0.0, &unknown), None);
    }
}
