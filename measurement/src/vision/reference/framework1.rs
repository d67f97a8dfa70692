//! Framework 1 of the thesis, "motion and darkness" (T 5.1): mask → regions → Kalman filter → borders → width →
//! position.

use super::association::{ObjectTracks, PictureHalf, SeenObject};
use super::mixture::{MotionMixture, darkness_threshold};
use super::pair_filter::PairNoise;
use super::shaft_outline;
use super::{MIN_REGION_SHARE, ReferencePose, ReferenceSystem, SHAFT_CLASS, hand_motion};
use crate::vision::blob::components::{Component, ComponentFinder};
use crate::vision::blob::moments::RegionRectangle;
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::pose::pinhole_width;
use crate::vision::segmentation::region_of_interest::CellBox;
use crate::vision::segmentation::samples::ColourSamples;

/// Standard deviation of the centre of a region, pixels: its visible part changes from frame to frame.
const CENTRE_SIGMA_PX: f64 = 6.0;

/// The system and its state.
pub(super) struct MotionAndDarkness {
    camera: Camera,
    radii_mm: Vec<f64>,
    mixture: MotionMixture,
    finder: ComponentFinder,
    tracks: ObjectTracks,
}

impl MotionAndDarkness {
    /// For tools of these radii; of two, the left one first.
    pub(super) fn new(camera: Camera, radii_mm: Vec<f64>, samples: &ColourSamples) -> Self {
        let noise = PairNoise {
            acceleration_density: [hand_motion::ACCELERATION_DENSITY * camera.fx * camera.fx; 2],
            sigma: [CENTRE_SIGMA_PX; 2],
            first_speed: [hand_motion::FIRST_SPEED * camera.fx; 2],
        };
        Self {
            camera,
            tracks: ObjectTracks::new(radii_mm.len(), noise, |seen, _| seen),
            radii_mm,
            mixture: MotionMixture::new(darkness_threshold(samples)),
            finder: ComponentFinder::default(),
        }
    }

    fn pose(&self, frame: &Frame<'_>, region: &RegionRectangle, radius_mm: f64) -> Option<ReferencePose> {
        let outline = shaft_outline::measure(frame, &self.mixture, &self.camera, region)?;
        let tube = pinhole_width::locate(outline.borders, outline.distal, outline.proximal, radius_mm)?;
        Some(ReferencePose { tip: tube.tip, axis: tube.axis })
    }
}

impl ReferenceSystem for MotionAndDarkness {
    fn observe(&mut self, frame: &Frame<'_>) -> Vec<Option<ReferencePose>> {
        self.mixture.observe(frame);
        let whole = CellBox::whole(frame);
        let min_cells = (MIN_REGION_SHARE * (whole.width() * whole.height()) as f64) as usize;
        let regions = self.finder.find(frame, &self.mixture, SHAFT_CLASS, whole, min_cells);
        let object = |region: &Component| {
            let pair = region.moments.centroid();
            SeenObject { pair, half: PictureHalf::of(pair[0], frame) }
        };
        let objects: Vec<SeenObject> = regions.iter().map(object).collect();
        let followed = self.tracks.advance(frame.time_s, &objects);
        let poses = followed.into_iter().zip(&self.radii_mm).map(|(followed, radius_mm)| {
            let region = regions[followed?.object].moments.rectangle();
            self.pose(frame, &region, *radius_mm)
        });
        poses.collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::vision::reference::testing::{CAMERA, DARK, FRAME_S, GreyPicture, no_samples};
    use crate::vision::tube::Tube;

    const RADIUS_MM: f64 = 5.0;

    /// A tool from the left whose tip is at this height.
    fn from_left(y_mm: f64) -> Tube {
        Tube { tip: Point3::new(-12.0, y_mm, 130.0), axis: Vector3::x(), radius: RADIUS_MM }
    }

    fn from_right(y_mm: f64) -> Tube {
        Tube { tip: Point3::new(12.0, y_mm, 130.0), axis: -Vector3::x(), radius: RADIUS_MM }
    }

    /// Shows pictures one after the other, and keeps their number.
    struct Show {
        system: MotionAndDarkness,
        shown: u64,
    }

    impl Show {
        /// A system that has seen the empty box for a second.
        fn of_empty_box(tools: usize) -> Self {
            let system = MotionAndDarkness::new(CAMERA, vec![RADIUS_MM; tools], &no_samples());
            let mut show = Self { system, shown: 0 };
            for _ in 0..25 {
                assert!(show.next(&GreyPicture::of(&[])).iter().all(Option::is_none), "the box is empty");
            }
            show
        }

        fn next(&mut self, picture: &GreyPicture) -> Vec<Option<ReferencePose>> {
            self.shown += 1;
            self.system.observe(&picture.frame(self.shown, self.shown as f64 * FRAME_S))
        }
    }

    /// Height of a tip that moves at 1.5 pixels a frame: each place is covered for half a second.
    fn height_mm(frame: u32) -> f64 {
        -25.0 + 0.75 * f64::from(frame)
    }

    #[test]
    fn a_moving_dark_shaft_is_found_after_three_confirmations() {
        let mut show = Show::of_empty_box(1);
        for frame in 0..50 {
            let tube = from_left(height_mm(frame));
            let found = show.next(&GreyPicture::of(&[(tube, DARK)]))[0];
            assert_eq!(found.is_some(), frame >= 3, "frame {frame}");
            let Some(found) = found else { continue };
            let miss = found.tip - tube.tip;
            assert!(miss.xy().norm() < 5.0 && miss.z.abs() < 18.0, "frame {frame}: {miss}");
            assert!((found.axis - tube.axis).norm() < 0.05, "frame {frame}: {}", found.axis);
        }
    }

    #[test]
    fn two_moving_shafts_are_named_by_their_sides() {
        let mut show = Show::of_empty_box(2);
        for frame in 0..20 {
            let tubes = [from_left(height_mm(frame)), from_right(-height_mm(frame))];
            let found = show.next(&GreyPicture::of(&tubes.map(|tube| (tube, DARK))));
            assert!(found.iter().all(|pose| pose.is_some() == (frame >= 3)), "frame {frame}");
            for (pose, tube) in found.iter().flatten().zip(tubes) {
                assert!(pose.axis.dot(&tube.axis) > 0.9, "frame {frame}: {}", pose.axis);
            }
        }
    }

    #[test]
    fn a_resting_shaft_is_lost_within_36_frames() {
        let mut show = Show::of_empty_box(1);
        let still = GreyPicture::of(&[(from_left(0.0), DARK)]);
        let found: Vec<bool> = (0..45).map(|_| show.next(&still)[0].is_some()).collect();
        assert!(found[5] && found[10], "new for a while");
        assert!(!found[36..].contains(&true), "then background");
    }

    #[test]
    fn a_moving_bright_object_and_a_shaft_there_from_the_start_are_not_found() {
        let mut show = Show::of_empty_box(1);
        for frame in 0..20 {
            assert_eq!(show.next(&GreyPicture::of(&[(from_left(height_mm(frame)), 150)])), [None]);
        }
        let system = MotionAndDarkness::new(CAMERA, vec![RADIUS_MM], &no_samples());
        let (mut show, still) = (Show { system, shown: 0 }, GreyPicture::of(&[(from_left(0.0), DARK)]));
        assert!((0..20).all(|_| show.next(&still) == [None]));
    }
}
