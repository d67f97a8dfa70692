//! Whether the camera moved during a recording.
//!
//! **In:** how the view is displaced, about once a second ([`ViewShift`]), and the depth of the tools. **Out:** the
//! farthest place where the view stayed, as a distance at that depth. **Method:** the median of five moments, for each
//! part of a displacement, leaves out a shake and a touch at the end: a displacement counts if it is there at three of
//! five moments, which are two seconds. A turn of the camera by an angle displaces points at a depth by angle times
//! depth; so does a shift of the camera, if the mat is at the depth of the tools. A mat behind them moves less in the
//! picture, so that the figure is too small rather than too large. **Gives up** (`None`) with fewer than five moments.

use crate::numbers::quantile::quantile;
use crate::vision::surroundings::ViewShift;
use crate::vision::trajectory::Trajectory;

/// Moments of a median.
const MOMENTS: usize = 5;

/// How far the camera moved during the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovedDuring {
    /// Largest lasting displacement of the picture since the recording's beginning, mm at the median depth of the tips.
    pub mm: f64,
    /// When it had moved half as far for the first time, s.
    pub at_s: f64,
}

impl MovedDuring {
    /// From the view's displacements in time order, and a path with the tools' depths. `None` if either says too
    /// little.
    pub(super) fn of(shifts: &[ViewShift], path: &Trajectory) -> Option<Self> {
        let observed = path.samples.iter().filter(|sample| sample.is_observed());
        let depth_mm = quantile(observed.map(|sample| sample.tip_mm.z).collect(), 0.5)?;
        let lasting: Vec<ViewShift> = shifts.windows(MOMENTS).filter_map(median).collect();
        let first = lasting.first()?.parts;
        let moved = |shift: &ViewShift| {
            let parts = shift.parts.iter().zip(first).map(|(part, first)| (part - first).powi(2));
            parts.sum::<f64>().sqrt()
        };
        let farthest = lasting.iter().map(moved).fold(0.0, f64::max);
        let at_s = lasting.iter().find(|shift| moved(shift) >= 0.5 * farthest)?.time_s;
        Some(Self { mm: depth_mm * farthest, at_s })
    }
}

/// The median of each part, at the time of the middle moment.
fn median(moments: &[ViewShift]) -> Option<ViewShift> {
    let time_s = moments.get(moments.len() / 2)?.time_s;
    let mut parts = [0.0; 4];
    for (index, part) in parts.iter_mut().enumerate() {
        *part = quantile(moments.iter().map(|shift| shift.parts[index]).collect(), 0.5)?;
    }
    Some(ViewShift { time_s, parts })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Point3};

    use super::*;
    use crate::vision::trajectory::{Sample, SampleState};

    /// A tool at a depth of 200 mm.
    fn path() -> Trajectory {
        let sample = Sample {
            frame: 0,
            time_s: 0.0,
            tool: 0,
            tip_mm: Point3::new(0.0, 0.0, 200.0),
            velocity_mm_s: None,
            axis: None,
            tip_px: Some(Point2::new(640.0, 360.0)),
            covariance_mm2: None,
            state: SampleState::Observed,
        };
        Trajectory { tools: vec!["orange".into()], samples: vec![sample], frame_times_s: Vec::new(), cuts: Vec::new() }
    }

    /// A moment a second. The view is shifted to the right by these angles.
    fn moved(angles: &[f64]) -> Option<MovedDuring> {
        let shift =
            |(second, angle): (usize, &f64)| ViewShift { time_s: 10.0 + second as f64, parts: [*angle, 0.0, 0.0, 0.0] };
        let shifts: Vec<ViewShift> = angles.iter().enumerate().map(shift).collect();
        MovedDuring::of(&shifts, &path())
    }

    #[test]
    fn a_view_that_stays_displaced_is_found_with_its_time() {
        let found = moved(&[0.0, 0.0, 0.0, 0.06, 0.06, 0.06, 0.06]).unwrap();
        assert!((found.mm - 12.0).abs() < 1e-9 && found.at_s == 13.0, "{found:?}");
        let returned = moved(&[0.0, 0.0, 0.0, 0.06, 0.06, 0.06, 0.0, 0.0, 0.0]).unwrap();
        assert!((returned.mm - 12.0).abs() < 1e-9, "it was there for two seconds: {returned:?}");
    }

    #[test]
    fn a_shake_that_returns_and_a_touch_at_the_end_are_no_movement() {
        let shaken = moved(&[0.0, 0.0, 0.0, 0.06, -0.04, 0.0, 0.0, 0.0, 0.06, 0.06]).unwrap();
        assert_eq!(shaken.mm, 0.0, "{shaken:?}");
    }

    #[test]
    fn parts_of_a_displacement_add_up_as_squares() {
        let at = |second: u32, parts| ViewShift { time_s: second.into(), parts };
        let shifts: Vec<ViewShift> =
            (0..9).map(|second| at(second, if second < 4 { [0.0; 4] } else { [0.03, 0.0, -0.04, 0.0] })).collect();
        let found = MovedDuring::of(&shifts, &path()).unwrap();
        assert!((found.mm - 10.0).abs() < 1e-9 && found.at_s == 4.0, "{found:?}");
    }

    #[test]
    fn too_few_moments_and_a_path_without_depth_say_nothing() {
        assert_eq!(moved(&[0.0, 0.06, 0.06, 0.06]), None);
        let shifts = [ViewShift { time_s: 0.0, parts: [0.0; 4] }; 9];
        assert_eq!(MovedDuring::of(&shifts, &Trajectory { samples: Vec::new(), ..path() }), None);
    }
}
