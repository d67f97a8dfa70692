//! From which figure on a session is to be used with care, or refused, and why from there.
//!
//! A figure is refused where the features would describe something else than the hand, however plausible they look. It
//! asks for care where they are still the hand's, but a reader who does not know of it would read too much into them.

use super::{Cause, Severity};
use crate::pipeline::features::{FeatureSettings, MOVEMENT_END_RATIO};
use crate::pipeline::segmentation::palette::verdict::MARGIN_STEPS;

/// Which way a figure is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// The larger the better.
    More,
    /// The smaller the better.
    Less,
}

/// The limits of one figure; a figure that equals its limit keeps it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Which way it is better.
    pub better: Better,
    /// Beyond it: with care.
    pub care: Option<f64>,
    /// Beyond it: refused.
    pub refuse: Option<f64>,
}

/// By how much a trocar may lie elsewhere than in earlier sessions of its box, mm. Half of a peg's size (10 mm), and of what
/// separates the targets of a task: paths that are off by more are of another place. A tube plays by a tenth of that
/// in its trocar. A camera 250 mm away has turned by 1.1° then.
pub const MOVED_MM: f64 = 5.0;

/// With care beyond the first, refused beyond the second.
pub const fn at_most(care: f64, refuse: f64) -> Limits {
    Limits { better: Better::Less, care: Some(care), refuse: Some(refuse) }
}

impl Limits {
    /// What a figure does, and the limit that it breaks; one that is no number keeps none.
    pub fn breach(&self, figure: f64) -> Option<(Severity, f64)> {
        let keeps = |limit: f64| match self.better {
            Better::More => figure >= limit,
            Better::Less => figure <= limit,
        };
        let broken = |limit: Option<f64>, severity| limit.filter(|limit| !keeps(*limit)).map(|limit| (severity, limit));
        broken(self.refuse, Severity::Refuse).or_else(|| broken(self.care, Severity::Care))
    }
}

const fn at_least(care: f64, refuse: f64) -> Limits {
    Limits { better: Better::More, care: Some(care), refuse: Some(refuse) }
}

/// Never refused.
const fn care_at_least(care: f64) -> Limits {
    Limits { better: Better::More, care: Some(care), refuse: None }
}

/// Never refused.
const fn care_at_most(care: f64) -> Limits {
    Limits { better: Better::Less, care: Some(care), refuse: None }
}

impl Cause {
    /// Its limits, in its unit.
    pub fn limits(self) -> Limits {
        match self {
            Cause::NothingSeen => Limits { better: Better::More, care: None, refuse: Some(1.0) },
            // A box's colours may name a tool that a task for one hand does not use: it has no features that could mislead.
            Cause::NeverInPicture => care_at_least(1.0),
            // What is taken for the tape is followed as smoothly as the tape, 148 mm beside it: no other figure shows it.
            Cause::ColourBackground => at_least(MARGIN_STEPS[0], MARGIN_STEPS[1]),
            // Two tools of one colour are told apart by where they come from and how they move.
            Cause::ColourPair => care_at_least(MARGIN_STEPS[0]),
            // Below one half, sums describe what the camera saw more than what the hand did (as `min_seen_share`); a tenth
            // that is missing takes about a tenth from every sum, as much as practice gains in a few repetitions.
            Cause::Coverage => at_least(0.9, 0.5),
            Cause::LeftView => at_most(0.1, 0.5),
            // A tracker loses tools when they are quick, far or hidden, not by chance: what is left is biased, so that half
            // as much of it does the same harm.
            Cause::Lost => at_most(0.05, 0.25),
            // Bridged positions are as smooth as the motion model: they flatter.
            Cause::Predicted => at_most(0.1, 0.4),
            // A movement lasts one to two seconds; what a longer gap hides, no bridge can guess.
            Cause::LongGap => care_at_most(2.0),
            // The gate passes 99.9 % of good measurements: twenty times as many refused, and the stated errors are wrong or a
            // second thing of the tape's colour is in the picture. At a fifth it is anyone's guess which of them is the tool.
            Cause::Rejected => at_most(0.02, 0.2),
            // Whole-pixel masks err by 0.5 to 1.2 px a side, and 1 px of width moves depth by 4.5 mm at 150 mm. Clean tape
            // leaves 0.1 to 0.4; a residual of 1 means that edges were not found to better than their pixel, of 2 that they
            // are not the tube's.
            Cause::BorderResidual => at_most(1.0, 2.0),
            // Tools move at 10 to 30 mm/s, and count as thinking below 5. Noise adds in squares: 2.5 makes 3 % of 10 mm/s,
            // and a rest stays below 5 for 95 % of its time. At 7, where movements end, no movement ends any more.
            Cause::NoiseFloor => at_most(2.5, movement_end_mm_s()),
            // 5 mm is the best published figure of a single camera, 12 the thesis's repeatability from the side: a path that
            // is not surer than that shows no detour of a peg's size (10 mm).
            Cause::ErrorBar => at_most(5.0, 12.0),
            // The thesis's photos gave 2.63 px with three bent boards and 0.92 without.
            Cause::Calibration => at_most(1.0, 2.5),
            // As coverage: what is not in the file was not seen.
            Cause::CutFile => at_most(0.05, 0.5),
            // Half of the lines are made up: borders that lie across the picture are known half as well. Single frames do no
            // harm.
            Cause::Interlaced => care_at_most(0.05),
            // Hands move below 5 Hz: 10 frames a second are the least that show it, and filters need more. A little less than
            // 15 and 10, because cameras do not keep their rates to the digit.
            Cause::FrameRate => at_least(14.0, 9.0),
            // Times are the frames' own, so single drops cost little; every third one makes 25 frames a second 17 uneven ones.
            Cause::DroppedFrames => at_most(0.05, 0.33),
            // Longer than any bridge; beyond ten seconds the duration is the interruption's.
            Cause::Break => at_most(1.0, 10.0),
            // Faster than what counts as movement: the task was not over, or had begun.
            Cause::BeginsInMotion | Cause::EndsInMotion => care_at_most(FeatureSettings::default().movement_speed_mm_s),
            // Colours are known under 0.6 to 1.6 times their light; edges shift with it long before they are lost.
            Cause::Exposure => care_at_most(0.15),
            // A colour is nobody's from 8 codes beyond its samples on: half of that.
            Cause::WhiteBalance => care_at_most(4.0),
            Cause::CameraMoved | Cause::PortMoved => care_at_most(MOVED_MM),
        }
    }
}

/// Speed below which a movement has ended, mm/s.
fn movement_end_mm_s() -> f64 {
    FeatureSettings::default().movement_speed_mm_s * MOVEMENT_END_RATIO
}
