//! The markerless system of Zhou & Payandeh: dark in the red channel → regions → borders → Kalman filter of the
//! midline → planes as printed.
//!
//! The papers leave open how the threshold is chosen and how the filtered midline is used. Here Otsu's threshold
//! separates the red codes of the whole picture, because tissue is never black in red light. A region is a shaft if it
//! is at least [`MIN_ELONGATION`] times as long as wide. The filter's state is `[ρ θ ρ̇ θ̇]` of the midline in Hesse's
//! form. Both borders are moved with the midline onto its filtered position.

use super::association::{FollowedObject, ObjectTracks, PictureHalf, SeenObject};
use super::midline::{self, HesseBorders};
use super::pair_filter::PairNoise;
use super::planes_as_printed;
use super::rgb::RgbConversion;
use super::shaft_outline::{self, ShaftOutline};
use super::{MIN_REGION_SHARE, ReferencePose, ReferenceSystem, SHAFT_CLASS, hand_motion};
use crate::vision::blob::components::ComponentFinder;
use crate::vision::blob::moments::RegionRectangle;
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::region_of_interest::CellBox;

/// Minimum length of a shaft's region, in widths.
const MIN_ELONGATION: f64 = 2.0;

/// Standard deviation of a measured midline's distance from the principal point, pixels.
const OFFSET_SIGMA_PX: f64 = 1.0;

/// Standard deviation of its direction, radians: one pixel at the end of 100.
const ANGLE_SIGMA: f64 = 0.01;

/// Usual distance of a tip from its trocar, mm: turns its acceleration into that of its direction.
const LEVER_MM: f64 = 100.0;

/// Every how many pixels the histogram of the red codes uses one, in both directions.
const HISTOGRAM_STEP: usize = 2;

/// The largest red code of the darker pixels: Otsu's threshold, which maximises the variance between the two classes.
/// Of a range without pixels, its middle.
fn otsu_threshold(histogram: &[u64; 256]) -> u8 {
    let total: f64 = histogram.iter().map(|count| *count as f64).sum();
    let sum: f64 = histogram.iter().enumerate().map(|(code, count)| code as f64 * *count as f64).sum();
    let (mut dark, mut dark_sum) = (0.0, 0.0);
    let (mut best, mut first, mut last) = (0.0, 0, 0);
    for (code, count) in histogram.iter().enumerate() {
        dark += *count as f64;
        dark_sum += code as f64 * *count as f64;
        let bright = total - dark;
        if dark == 0.0 || bright == 0.0 {
            continue;
        }
        let between = dark * bright * (dark_sum / dark - (sum - dark_sum) / bright).powi(2);
        if between > best {
            (best, first, last) = (between, code, code);
        } else if between == best {
            last = code;
        }
    }
    ((first + last) / 2) as u8
}

/// Pixels that are dark in the red channel of one frame.
struct DarkRed {
    conversion: RgbConversion,
    /// The largest dark code.
    threshold: u8,
}

impl DarkRed {
    fn of(frame: &Frame<'_>) -> Self {
        let conversion = RgbConversion::new(frame.encoding);
        let mut histogram = [0u64; 256];
        for y in (0..frame.height()).step_by(HISTOGRAM_STEP) {
            for x in (0..frame.width()).step_by(HISTOGRAM_STEP) {
                histogram[usize::from(conversion.red_of(frame.yuv_at(x, y)))] += 1;
            }
        }
        Self { conversion, threshold: otsu_threshold(&histogram) }
    }
}

impl Segment for DarkRed {
    fn class_at(&self, frame: &Frame<'_>, x: usize, y: usize) -> u8 {
        if self.conversion.red_of(frame.yuv_at(x, y)) <= self.threshold { SHAFT_CLASS } else { 0 }
    }
}

/// The system and its state.
pub(super) struct EdgePlanes {
    camera: Camera,
    radii_mm: Vec<f64>,
    finder: ComponentFinder,
    tracks: ObjectTracks,
}

/// A region with the borders of a shaft.
struct ShaftRegion {
    outline: ShaftOutline,
    borders: HesseBorders,
    half: PictureHalf,
}

impl EdgePlanes {
    /// For tools of these radii; of two, the left one first.
    pub(super) fn new(camera: Camera, radii_mm: Vec<f64>) -> Self {
        let turning_density = hand_motion::ACCELERATION_DENSITY * (hand_motion::DEPTH_MM / LEVER_MM).powi(2);
        let noise = PairNoise {
            acceleration_density: [hand_motion::ACCELERATION_DENSITY, turning_density],
            sigma: [OFFSET_SIGMA_PX / camera.fx, ANGLE_SIGMA],
            first_speed: [hand_motion::FIRST_SPEED, hand_motion::FIRST_SPEED * hand_motion::DEPTH_MM / LEVER_MM],
        };
        let tracks = ObjectTracks::new(radii_mm.len(), noise, midline::nearest_form);
        Self { camera, radii_mm, finder: ComponentFinder::default(), tracks }
    }

    /// The shafts of a frame, largest first.
    fn shafts(&mut self, frame: &Frame<'_>) -> Vec<ShaftRegion> {
        let red = DarkRed::of(frame);
        let whole = CellBox::whole(frame);
        let min_cells = (MIN_REGION_SHARE * (whole.width() * whole.height()) as f64) as usize;
        let regions = self.finder.find(frame, &red, SHAFT_CLASS, whole, min_cells);
        let shaft = |region: RegionRectangle| {
            if region.length_px < MIN_ELONGATION * region.width_px {
                return None;
            }
            let outline = shaft_outline::measure(frame, &red, &self.camera, &region)?;
            let borders = HesseBorders::between(outline.borders);
            Some(ShaftRegion { outline, borders, half: PictureHalf::of(region.centre.x, frame) })
        };
        regions.iter().filter_map(|region| shaft(region.moments.rectangle())).collect()
    }
}

/// The pose of a shaft whose midline is at its filtered position.
fn pose(shaft: &ShaftRegion, followed: &FollowedObject, radius_mm: f64) -> Option<ReferencePose> {
    let borders = shaft.borders.moved_to(followed.pair).lines();
    let [distal, proximal] =
        [shaft.outline.distal, shaft.outline.proximal].map(|end| midline::projected(end, followed.pair));
    let tube = planes_as_printed::locate(borders, distal, proximal, radius_mm)?;
    Some(ReferencePose { tip: tube.tip, axis: tube.axis })
}

impl ReferenceSystem for EdgePlanes {
    fn observe(&mut self, frame: &Frame<'_>) -> Vec<Option<ReferencePose>> {
        let shafts = self.shafts(frame);
        let objects: Vec<SeenObject> =
            shafts.iter().map(|shaft| SeenObject { pair: shaft.borders.midline, half: shaft.half }).collect();
        let followed = self.tracks.advance(frame.time_s, &objects);
        let poses = followed.iter().zip(&self.radii_mm).map(|(followed, radius_mm)| {
            let followed = followed.as_ref()?;
            pose(&shafts[followed.object], followed, *radius_mm)
        });
        poses.collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::vision::reference::testing::{CAMERA, DARK, FRAME_S, GreyPicture};
    use crate::vision::tube::Tube;

    const RADIUS_MM: f64 = 5.0;

    #[test]
    fn otsu_separates_two_groups_in_the_middle_of_the_gap() {
        let mut histogram = [0; 256];
        histogram[20] = 300;
        histogram[200] = 5000;
        assert_eq!(otsu_threshold(&histogram), 109);
        (18..=40).for_each(|code| histogram[code] += 10);
        assert!((40..200).contains(&otsu_threshold(&histogram)));
    }

    /// Tools from the left and from the right, which have moved down by this much.
    fn tubes(down_mm: f64) -> [Tube; 2] {
        let left = Vector3::new(0.95, 0.1, 0.3).normalize();
        let right = Vector3::new(-0.93, 0.2, -0.3).normalize();
        [(-10.0, -20.0, left), (12.0, 15.0, right)].map(|(x, y, axis)| Tube {
            tip: Point3::new(x, y + down_mm, 130.0),
            axis,
            radius: RADIUS_MM,
        })
    }

    #[test]
    fn dark_shafts_are_found_with_the_error_of_the_printed_formula() {
        let mut system = EdgePlanes::new(CAMERA, vec![RADIUS_MM; 2]);
        for frame in 0..20u32 {
            let tubes = tubes(0.3 * f64::from(frame));
            let picture = GreyPicture::of(&tubes.map(|tube| (tube, DARK)));
            let found = system.observe(&picture.frame(u64::from(frame), f64::from(frame) * FRAME_S));
            assert!(found.iter().all(|pose| pose.is_some() == (frame >= 3)), "frame {frame}: {found:?}");
            for (pose, tube) in found.iter().flatten().zip(tubes) {
                let too_far =
                    RADIUS_MM * tube.tip.coords.dot(&tube.axis) / (tube.nearest_to_camera().norm() - RADIUS_MM);
                let miss = pose.tip - tube.tip - tube.axis * too_far;
                assert!(miss.xy().norm() < 4.0 && miss.z.abs() < 14.0, "frame {frame}: {miss}");
                assert!(pose.axis.dot(&tube.axis) > 0.95, "frame {frame}: {}", pose.axis);
            }
        }
    }

    #[test]
    fn a_resting_shaft_stays_found() {
        let mut system = EdgePlanes::new(CAMERA, vec![RADIUS_MM]);
        let still = GreyPicture::of(&[(tubes(0.0)[0], DARK)]);
        let found = (0..60).map(|frame| system.observe(&still.frame(frame, frame as f64 * FRAME_S))[0].is_some());
        assert_eq!(found.filter(|found| *found).count(), 57);
    }
}
