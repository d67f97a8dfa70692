//! The limits of every figure: where a session is to be used with care, where it is refused, and why there.
//!
//! A figure refuses the session where the features would no longer describe the hand, even if they look plausible. It
//! asks for care where they still describe the hand, but a reader who does not know the figure would read too much into
//! them. A changed limit raises `PIPELINE_VERSION`. docs/method.md 6.6 lists the limits, and pages repeat some of them
//! (`static/parts/live/seen_level.js`; a test compares them).

use super::box_match::{MAX_NUDGE_MM, MIN_CORRELATION, MIN_SHIFT};
use super::{QualityCause, Severity};
use crate::motion::features::motion::MAX_HAND_SPEED_MM_S;
use crate::motion::features::{FeatureSettings, MOVEMENT_END_RATIO};
use crate::vision::segmentation::palette::verdict::MARGIN_STEPS;

/// The better direction of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BetterDirection {
    /// Larger is better.
    More,
    /// Smaller is better.
    Less,
}

/// The limits of one figure. A figure equal to its limit does not break it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityLimits {
    /// Its better direction.
    pub better: BetterDirection,
    /// Beyond it, the session is to be used with care.
    pub care: Option<f64>,
    /// Beyond it, the session is refused.
    pub refuse: Option<f64>,
}

/// Maximum distance of a trocar from its position in earlier sessions of the box, and of the view from its place at the
/// recording's beginning, mm. It is half the size of a peg (10 mm) and half the distance between the targets of a task:
/// with a larger error a path belongs to another target. A tube moves in its trocar by a tenth of that. A camera 250 mm
/// away has turned by 1.1° at this limit.
pub const MAX_DISPLACEMENT_MM: f64 = 5.0;

/// Median of the positions' stated standard deviations above which a session is refused, mm.
pub(super) const MAX_POSITION_ERROR_MM: f64 = 12.0;

/// Accelerations above which a row that a tool reaches and leaves again asks for care, and refuses the session, m/s². A
/// hand shakes an instrument at less than 10 Hz; 25 mm to either side at 10 Hz is the second value, ten times gravity.
/// From half of that on, a wrong row is likelier than a hand. At 30 frames a second, the limits are a row 31 and 59 mm
/// beside its neighbours, or two rows 59 and 114 mm beside theirs.
const SPIKE_M_S2: [f64; 2] = [50.0, 100.0];

/// Care above the first value, refused above the second.
pub const fn at_most(care: f64, refuse: f64) -> QualityLimits {
    QualityLimits { better: BetterDirection::Less, care: Some(care), refuse: Some(refuse) }
}

impl QualityLimits {
    /// The effect of a figure and the limit that it breaks. A figure that is not a number breaks every limit.
    pub fn breach(&self, figure: f64) -> Option<(Severity, f64)> {
        let keeps = |limit: f64| match self.better {
            BetterDirection::More => figure >= limit,
            BetterDirection::Less => figure <= limit,
        };
        let broken = |limit: Option<f64>, severity| limit.filter(|limit| !keeps(*limit)).map(|limit| (severity, limit));
        broken(self.refuse, Severity::Refuse).or_else(|| broken(self.care, Severity::Care))
    }
}

/// Care below the first value, refused below the second.
const fn at_least(care: f64, refuse: f64) -> QualityLimits {
    QualityLimits { better: BetterDirection::More, care: Some(care), refuse: Some(refuse) }
}

/// Care below the value, never refused.
const fn care_at_least(care: f64) -> QualityLimits {
    QualityLimits { better: BetterDirection::More, care: Some(care), refuse: None }
}

/// Care above the value, never refused.
const fn care_at_most(care: f64) -> QualityLimits {
    QualityLimits { better: BetterDirection::Less, care: Some(care), refuse: None }
}

/// Refused above the value, never only care.
const fn refuse_above(refuse: f64) -> QualityLimits {
    QualityLimits { better: BetterDirection::Less, care: None, refuse: Some(refuse) }
}

impl QualityCause {
    /// Its limits, in its unit.
    pub fn limits(self) -> QualityLimits {
        match self {
            // The figure is 0: none of the recording shows this box.
            QualityCause::OtherBox | QualityCause::NothingSeen => {
                QualityLimits { better: BetterDirection::More, care: None, refuse: Some(1.0) }
            }
            // A person decides: until then the numbers are shown, because they are right if it is this box.
            QualityCause::BoxSurroundings => care_at_least(MIN_CORRELATION),
            QualityCause::BoxTrocars => care_at_most(MAX_NUDGE_MM),
            // A box's colours may include a tool that a one-handed task does not use. It has no misleading features.
            QualityCause::NeverInPicture => care_at_least(1.0),
            // An object mistaken for the tape is followed as smoothly, 148 mm beside it. Only a trocar that the axes
            // show excludes it; then the session is usable with care.
            QualityCause::ColourBackground => at_least(MARGIN_STEPS[0], MARGIN_STEPS[1]),
            QualityCause::ColourPair => care_at_least(MARGIN_STEPS[0]), // origin and motion distinguish the two
            // Below one half, sums describe the camera's view more than the hand's motion (as `min_seen_share`). A
            // missing tenth takes about a tenth off every sum, as much as practice gains in a few repetitions.
            QualityCause::Coverage => at_least(0.9, 0.5),
            QualityCause::LeftView => at_most(0.1, 0.5),
            // A tracker does not lose tools by chance but when they are quick, far or hidden. The rest is biased, so
            // half as much of it does the same harm.
            QualityCause::Lost => at_most(0.05, 0.25),
            // Without a trocar, nothing confirms which way the band points, nor its depth: the poses are false. This
            // held for nine tools of 102 ray-traced recordings that were followed wrongly, and for seven that were
            // refused anyway. If the axes may meet there but do not show it clearly, the session is usable with care.
            QualityCause::NoTrocar => at_most(0.0, 0.0),
            // Tape gives less. A reader who compares the two must know the difference.
            QualityCause::BareTool => care_at_most(1.0),
            // One tool in a hundred with the right sizes is beyond the first limit on either side, one in a thousand
            // beyond the second. A band stated 1.5 times as long as it is breaks it, and its positions are 10 mm off.
            QualityCause::BandTooLong | QualityCause::BandTooShort => at_most(2.58, 3.29),
            // Bridged positions are as smooth as the motion model, so they flatter the hand.
            QualityCause::Predicted => at_most(0.1, 0.4),
            // A movement lasts one to two seconds; no bridge can guess what a longer gap hides.
            QualityCause::LongGap => care_at_most(2.0),
            // The filter's Mahalanobis gate passes 99.9 % of good measurements. If it rejects twenty times as many as
            // that, the stated errors are wrong or a second object of the tape's colour is in the picture. At a fifth,
            // it is uncertain which of the two is the tool.
            QualityCause::Rejected => at_most(0.02, 0.2),
            QualityCause::Jump => refuse_above(MAX_HAND_SPEED_MM_S / 1e3),
            QualityCause::Spike => at_most(SPIKE_M_S2[0], SPIKE_M_S2[1]),
            // Whole-pixel masks are off by 0.5 to 1.2 px a side, and 1 px of width moves depth by 4.5 mm at 150 mm.
            // Clean tape leaves a residual of 0.1 to 0.4. A residual of 1 means that edges were found no better than to
            // a pixel; of 2, that they are not the tube's edges.
            QualityCause::BorderResidual => at_most(1.0, 2.0),
            // Tools move at 10 to 30 mm/s and count as thinking below 5. Noise adds in squares: 2.5 adds 3 % to 10
            // mm/s, and a resting tool stays below 5 for 95 % of the time. At 7, the speed at which movements end, no
            // movement would end any more.
            QualityCause::NoiseFloor => at_most(2.5, movement_end_mm_s()),
            // 5 mm is the best published figure of a single camera, and 12 mm the thesis's repeatability from the side.
            // A path with a larger error shows no detour of a peg's size (10 mm).
            QualityCause::ErrorBar => at_most(5.0, MAX_POSITION_ERROR_MM),
            // The thesis's photos gave 2.63 px with three bent boards and 0.92 without.
            QualityCause::Calibration => at_most(1.0, 2.5),
            // As for coverage: frames missing from the file were not seen.
            QualityCause::CutFile => at_most(0.05, 0.5),
            // Half of the lines are interpolated: borders across them are half as well known. Single frames do no harm.
            QualityCause::Interlaced => care_at_most(0.05),
            // Hands move below 5 Hz: 10 frames a second are the minimum to show that, and filters need more. The limits
            // are slightly below 15 and 10, because cameras do not keep their rates exactly.
            QualityCause::FrameRate => at_least(14.0, 9.0),
            // Times are the frames' own: single drops cost little. Of 25 frames a second, two thirds are 17 uneven ones.
            QualityCause::DroppedFrames => at_most(0.05, 0.33),
            // 1 s is longer than any bridge; beyond 10 s the duration is mostly that of the interruption.
            QualityCause::Break => at_most(1.0, 10.0),
            // Faster than the movement speed: the task had already begun, or was not over.
            QualityCause::BeginsInMotion | QualityCause::EndsInMotion => {
                care_at_most(FeatureSettings::default().movement_speed_mm_s)
            }
            // Colours are known from 0.6 to 1.6 times their light; edges shift with it long before they are lost.
            QualityCause::Exposure => care_at_most(0.15),
            // A colour 8 codes beyond its samples belongs to no label; the limit is half of that.
            QualityCause::WhiteBalance => care_at_most(4.0),
            // From the moment of the movement on, positions are displaced by this much, and the path has a jump. Noise
            // of the figure is 0.2 mm; an automatic focus that changes the scale by 5 % stays below the limit.
            QualityCause::CameraMovedDuring => care_at_most(MAX_DISPLACEMENT_MM),
            QualityCause::ViewShifted => care_at_most(MIN_SHIFT), // the search for the shift is right to a third of it
            QualityCause::CameraMoved | QualityCause::PortMoved => care_at_most(MAX_DISPLACEMENT_MM),
        }
    }
}

/// Speed below which a movement has ended, mm/s.
fn movement_end_mm_s() -> f64 {
    FeatureSettings::default().movement_speed_mm_s * MOVEMENT_END_RATIO
}
