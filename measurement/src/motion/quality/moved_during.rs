//! Whether the camera moved during a recording.
//!
//! **In:** how the view is displaced, about once a second ([`ViewShift`]), and the depth of the tools. **Out:** the
//! farthest place where the view stayed, as a distance at that depth. **Method:** the median of five moments, for each
//! part of a displacement, leaves out a shake and a touch at the end: a displacement counts if it is there at three of
//! five moments, which are two seconds. A turn of the camera by an angle displaces points at a depth by angle times
//! depth; so does a shift of the camera, if the mat is at the depth of the tools. A mat behind them moves less in the
//! picture, so that the figure is too small rather than too large. **Gives up** (`None`) with fewer than five moments,
//! and without a movement above the limit if the moments do not show the whole recording: hands may hide a movement,
//! and after one beyond the search the view is unknown.

use serde::{Deserialize, Serialize};

use super::limits::MAX_DISPLACEMENT_MM;
use crate::numbers::quantile::quantile;
use crate::vision::frame::Frame;
use crate::vision::surroundings::{ViewShift, ViewWatch};
use crate::vision::trajectory::Sample;

/// Moments of a median.
const MOMENTS: usize = 5;

/// The view counts as unmoved if it is unknown for no longer than this, s. Hands that place props or exchange an
/// instrument cover a box for some seconds. The live page, too, warns of displaced trocars only after 10 s.
const MAX_UNKNOWN_S: f64 = 10.0;

/// The same as a share of a recording that is shorter than 30 s: its beginning, its middle and its end must be shown.
const MAX_UNKNOWN_SHARE: f64 = 1.0 / 3.0;

/// How far the camera moved during the recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MovedDuring {
    /// Largest lasting displacement of the picture since the recording's beginning, mm at the median depth of the tips.
    pub mm: f64,
    /// When it had moved half as far for the first time, s.
    pub at_s: f64,
}

impl MovedDuring {
    /// From the view's displacements in time order, a path with the tools' depths, and the times of the recording's
    /// frames, s. `None` if they say too little. Without frame times, the recording lasts from the first displacement
    /// to the last.
    pub fn of(shifts: &[ViewShift], path: &[Sample], frame_times_s: &[f64]) -> Option<Self> {
        let observed = path.iter().filter(|sample| sample.is_observed());
        let depth_mm = quantile(observed.map(|sample| sample.tip_mm.z).collect(), 0.5)?;
        let lasting: Vec<ViewShift> = shifts.windows(MOMENTS).filter_map(median).collect();
        let first = lasting.first()?.parts;
        let moved = |shift: &ViewShift| distance(&shift.parts, &first);
        let farthest = lasting.iter().map(moved).fold(0.0, f64::max);
        let at_s = lasting.iter().find(|shift| moved(shift) >= 0.5 * farthest)?.time_s;
        let found = Self { mm: depth_mm * farthest, at_s };
        (found.is_movement() || show_whole(shifts, frame_times_s)).then_some(found)
    }

    /// Is it more than [`MAX_DISPLACEMENT_MM`]?
    pub fn is_movement(&self) -> bool {
        self.mm > MAX_DISPLACEMENT_MM
    }
}

/// Watches for a movement of the camera while a recording arrives, with the definition of the finished session. Only a
/// movement is stated: the moments so far do not show the whole recording. The depth is the median of one frame a second.
#[derive(Clone, Debug)]
pub struct MovementWatch {
    view: ViewWatch,
    depths_mm: Vec<f64>,
    /// The first lasting view.
    first: Option<[f64; 4]>,
    /// For each lasting view: its time, s, and how far it is from the first one, as the tangent of an angle.
    moved: Vec<(f64, f64)>,
    farthest: f64,
}

/// Displacements below this tangent are no movement at any depth of a box trainer, which ends before 1 m.
const MIN_TANGENT: f64 = MAX_DISPLACEMENT_MM / 1000.0;

impl MovementWatch {
    /// A watch for frames of a camera with this focal length, pixels.
    pub fn new(focal_px: f64) -> Self {
        let view = ViewWatch::new(focal_px);
        Self { view, depths_mm: Vec::new(), first: None, moved: Vec::new(), farthest: 0.0 }
    }

    /// Looks at a frame, if a second has passed since the last one.
    pub fn sample_frame(&mut self, frame: &Frame<'_>) {
        self.view.sample_frame(frame);
        self.add_shifts();
    }

    /// Adds the depth of a tool's tip, mm. Call it about once a second for each tool that is measured.
    pub fn add_depth(&mut self, depth_mm: f64) {
        self.depths_mm.push(depth_mm);
    }

    /// The movement so far; `None` if there was none, or if no depth is known yet.
    pub fn movement(&self) -> Option<MovedDuring> {
        if self.farthest < MIN_TANGENT {
            return None;
        }
        let depth_mm = quantile(self.depths_mm.clone(), 0.5)?;
        let at_s = self.moved.iter().find(|(_, moved)| *moved >= 0.5 * self.farthest)?.0;
        Some(MovedDuring { mm: depth_mm * self.farthest, at_s }).filter(MovedDuring::is_movement)
    }

    fn add_shifts(&mut self) {
        let known = self.moved.len();
        for moments in self.view.shifts().windows(MOMENTS).skip(known) {
            let Some(shift) = median(moments) else { return };
            let moved = distance(&shift.parts, self.first.get_or_insert(shift.parts));
            self.farthest = self.farthest.max(moved);
            self.moved.push((shift.time_s, moved));
        }
    }
}

/// How far a displacement is from another one.
fn distance(parts: &[f64; 4], other: &[f64; 4]) -> f64 {
    parts.iter().zip(other).map(|(part, other)| (part - other).powi(2)).sum::<f64>().sqrt()
}

/// Is the view known all the time, except for short times?
fn show_whole(shifts: &[ViewShift], frame_times_s: &[f64]) -> bool {
    let [begin_s, end_s] = [frame_times_s.first(), frame_times_s.last()].map(|time_s| time_s.copied().into_iter());
    let times_s: Vec<f64> = begin_s.chain(shifts.iter().map(|shift| shift.time_s)).chain(end_s).collect();
    let recorded_s = times_s.first().zip(times_s.last()).map_or(0.0, |(begin_s, end_s)| end_s - begin_s);
    let max_unknown_s = MAX_UNKNOWN_S.min(MAX_UNKNOWN_SHARE * recorded_s);
    times_s.windows(2).all(|pair| pair[1] - pair[0] <= max_unknown_s)
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
    use crate::vision::trajectory::SampleState;

    /// A tool at a depth of 200 mm.
    fn path() -> [Sample; 1] {
        [Sample {
            frame: 0,
            time_s: 0.0,
            tool: 0,
            tip_mm: Point3::new(0.0, 0.0, 200.0),
            velocity_mm_s: None,
            axis: None,
            tip_px: Some(Point2::new(640.0, 360.0)),
            covariance_mm2: None,
            state: SampleState::Observed,
        }]
    }

    /// A moment a second. The view is shifted to the right by these angles.
    fn moved(angles: &[f64]) -> Option<MovedDuring> {
        let shift =
            |(second, angle): (usize, &f64)| ViewShift { time_s: 10.0 + second as f64, parts: [*angle, 0.0, 0.0, 0.0] };
        let shifts: Vec<ViewShift> = angles.iter().enumerate().map(shift).collect();
        MovedDuring::of(&shifts, &path(), &[])
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
        let found = MovedDuring::of(&shifts, &path(), &[]).unwrap();
        assert!((found.mm - 10.0).abs() < 1e-9 && found.at_s == 4.0, "{found:?}");
    }

    /// What the watch says once a second while the same moments arrive, with a tool at 200 mm.
    fn moved_live(angles: &[f64]) -> Vec<Option<MovedDuring>> {
        let mut watch = MovementWatch::new(1.0);
        let mut said = Vec::new();
        for (second, angle) in angles.iter().enumerate() {
            watch.view.push_shift(ViewShift { time_s: 10.0 + second as f64, parts: [*angle, 0.0, 0.0, 0.0] });
            watch.add_shifts();
            watch.add_depth(200.0);
            said.push(watch.movement());
        }
        said
    }

    #[test]
    fn while_the_recording_arrives_a_movement_is_the_one_of_the_finished_session() {
        for angles in [
            &[0.0, 0.0, 0.0, 0.06, 0.06, 0.06, 0.06][..],
            &[0.0, 0.0, 0.0, 0.06, 0.06, 0.06, 0.0, 0.0, 0.0],
            &[0.0, 0.0, 0.0, 0.06, -0.04, 0.0, 0.0, 0.0, 0.06, 0.06],
            &[0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.06, 0.06],
            &[0.0; 20],
        ] {
            let finished = moved(angles).filter(MovedDuring::is_movement);
            assert_eq!(*moved_live(angles).last().unwrap(), finished, "{angles:?}");
        }
        let said = moved_live(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.06, 0.06, 0.06, 0.06]);
        assert_eq!(said.iter().position(Option::is_some), Some(7), "it has lasted for two seconds");
    }

    #[test]
    fn too_few_moments_and_a_path_without_depth_say_nothing() {
        assert_eq!(moved(&[0.0, 0.06, 0.06, 0.06]), None);
        let shifts = [ViewShift { time_s: 0.0, parts: [0.0; 4] }; 9];
        assert_eq!(MovedDuring::of(&shifts, &[], &[]), None);
    }

    #[test]
    fn moments_that_do_not_show_the_whole_recording_prove_a_movement_but_no_rest() {
        let seconds = |from: u32, to: u32, hidden: std::ops::Range<u32>| {
            (from..to).filter(|second| !hidden.contains(second)).collect::<Vec<u32>>()
        };
        // The view is known at these seconds, of a recording of this length. It is shifted from second 15 on.
        let of = |known: &[u32], length_s: f64, angle: f64| {
            let right = |second: u32| if second < 15 { 0.0 } else { angle };
            let shift = |second: &u32| ViewShift { time_s: (*second).into(), parts: [right(*second), 0.0, 0.0, 0.0] };
            let shifts: Vec<ViewShift> = known.iter().map(shift).collect();
            MovedDuring::of(&shifts, &path(), &[0.0, length_s]).map(|found| found.mm)
        };
        for (known, length_s) in [
            (seconds(0, 30, 0..0), 60.0),
            (seconds(0, 10, 0..0), 50.0),
            (seconds(15, 60, 0..0), 60.0),
            (seconds(0, 60, 20..35), 60.0),
            (seconds(0, 6, 0..0), 9.0),
        ] {
            assert_eq!(of(&known, length_s, 0.0), None, "{known:?} of {length_s} s");
        }
        for (known, length_s) in
            [(seconds(0, 60, 0..0), 60.0), (seconds(0, 52, 20..29), 60.0), (seconds(0, 6, 0..0), 7.0)]
        {
            assert_eq!(of(&known, length_s, 0.0), Some(0.0), "{known:?} of {length_s} s");
        }
        assert_eq!(of(&seconds(0, 30, 0..0), 60.0, 0.02), None, "4 mm");
        let moved_mm = of(&seconds(0, 30, 0..0), 60.0, 0.06).unwrap();
        assert!((moved_mm - 12.0).abs() < 1e-9, "{moved_mm} mm");
    }
}
