//! What all stages need of one frame.

use nalgebra::Point3;

use super::settings::{MotionSettings, TrackerSettings};
use crate::vision::camera::Camera;
use crate::vision::filter::track::TrackSettings;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::colour_table::ColourTable;
use crate::vision::space::Pixel;
use crate::vision::strip::finder::FrameStrips;
use crate::vision::tube::Outline;

/// A frame, and what is known about it before a tool is looked for.
pub struct FrameContext<'a> {
    /// The frame.
    pub frame: &'a Frame<'a>,
    /// The class of every place.
    pub segment: &'a dyn Segment,
    /// The class of every colour.
    pub table: &'a ColourTable,
    /// Camera and tracking methods.
    pub settings: &'a TrackerSettings,
    /// The strips that may be bare shafts; `None` without bare tools, or while the box is not known.
    pub strips: Option<&'a FrameStrips<'a>>,
    /// Expected outlines of the other tools, which may hide this one.
    pub obstacles: &'a [Outline],
}

impl FrameContext<'_> {
    pub(super) fn camera(&self) -> &Camera {
        &self.settings.camera
    }

    pub(super) fn track_settings(&self) -> TrackSettings {
        self.settings.motion.track_settings()
    }

    /// Class of the frame's pixel in this column and row.
    pub(super) fn class_at(&self, column: f64, row: f64) -> u8 {
        self.segment.class_at(self.frame, column as usize, row as usize)
    }

    /// Codes (Y, U, V) of the frame's pixel in this column and row.
    pub(super) fn codes_at(&self, column: f64, row: f64) -> [u8; 3] {
        self.frame.yuv_at(column as usize, row as usize)
    }

    /// Is a point of the outline inside the frame, and in front of all other tools?
    pub(super) fn is_visible(&self, place: Point3<f64>, at: Pixel) -> bool {
        const RIM_PX: f64 = 3.0;
        let (width, height) = (self.frame.width() as f64, self.frame.height() as f64);
        let in_frame = at.u() > RIM_PX && at.v() > RIM_PX && at.u() < width - RIM_PX && at.v() < height - RIM_PX;
        let clear = self.clear();
        in_frame && !self.obstacles.iter().any(|other| other.hides(place.coords, place.z, clear))
    }

    /// The other tools that may hide a part of an outline, between two distances behind the tip (mm).
    pub(super) fn obstacles_before(&self, outline: &Outline, backs_mm: [f64; 2]) -> Vec<Outline> {
        let hull = outline.hull(backs_mm);
        self.obstacles.iter().filter(|other| other.may_hide(&hull, self.clear())).copied().collect()
    }

    /// How far beside a tool nothing is hidden by it, radians.
    fn clear(&self) -> f64 {
        const CLEAR_PX: f64 = 4.0;
        CLEAR_PX / self.camera().fx
    }
}

impl MotionSettings {
    /// The settings of one track.
    pub(super) fn track_settings(&self) -> TrackSettings {
        TrackSettings {
            noise_density: self.noise_density(),
            first_speed_mm_s: self.first_speed_mm_s,
            gate: self.gate,
            reacquire_s: self.reacquire_s,
            max_prediction_s: self.max_prediction_s,
            max_hidden_s: self.max_hidden_s,
            depth_mm: (self.nearest_mm, self.farthest_mm),
        }
    }
}
