//! From which figure on a light turns yellow, or red, and why from there.
//!
//! Green says that sessions of today may be compared with those of the day when the box was set up; yellow that they may,
//! by a reader who knows of it; red that they may not.

use crate::pipeline::quality::Cause;
use crate::pipeline::quality::limits::{Better, Limits, MOVED_MM, at_most};
use crate::pipeline::segmentation::palette::verdict::FALSE_REGION;

/// Fewest touches that make a figure: three define a plane and cannot disagree with it; six are asked for, two may fail.
pub const FEWEST_TOUCHES: usize = 4;

/// RMS error of touches, mm. Simulated boxes give 0.3 to 0.9 with a 5 mm rod at 200 mm in 1280×720, and a hand places a rod
/// to half a millimetre: together below 1 (640×360 gives 1.5: yellow, as it is indeed half as sharp). Beyond 2.5 a detour
/// of the size of a peg's radius no longer shows. Seeded faults: a tape that is 4 mm shorter than stated gives 3 to 4, a rod of
/// 5 mm that is called 6 gives 40.
pub const TOUCH_RMS_MM: Limits = at_most(1.0, 2.5);

/// RMS reprojection error of the board, px, under a camera whose own photos left so much. Frames of a compressed recording
/// are noisier than photos: simulated boxes leave 0.03 where their calibration left 0.02, and real sensors some tenths. A
/// zoom of 3 % leaves 0.3 and a principal point that is 15 px off 0.2, since a flat board can lean to hide most of it: this
/// finds coarse faults, [`FOCAL_CHANGE`] the finer one.
pub fn board_rms_px(calibration_rms_px: Option<f64>) -> Limits {
    /// What a calibration usually leaves, where its camera.json does not say.
    const USUAL_PX: f64 = 0.3;
    let own_px = calibration_rms_px.unwrap_or(USUAL_PX);
    at_most(1.5 * own_px + 0.2, 3.0 * own_px + 1.0)
}

/// Change of the focal length, share. Every depth changes by the same share: at 1 % a movement 50 mm deep is measured
/// half a millimetre wrong, and the box's depth of 200 mm by two; at 2 % by twice that, more than all other errors. The
/// touches do not show it, since board and rod shift alike (3 %: 0.6 to 1.0 mm). Simulated boxes tell it to 0.03 %.
pub const FOCAL_CHANGE: Limits = at_most(0.01, 0.02);

/// A change of the focal length that is not known to this standard deviation is not judged: a board that was only seen
/// squarely does not tell.
pub const FOCAL_SIGMA: f64 = 0.005;

/// Distance of the rod's trocar from where the box's sessions had it, mm: as for a session ([`MOVED_MM`]). Never red: what a moved
/// camera measures is right as ever, only elsewhere.
pub const TROCAR_MM: Limits = Limits { better: Better::Less, care: Some(MOVED_MM), refuse: None };

/// Largest region of the empty box that has a tape's colour, as a multiple of the tape: as on the frames on which it was marked
/// ([`FALSE_REGION`]).
pub const FALSE_TAPE: Limits = at_most(FALSE_REGION[0], FALSE_REGION[1]);

/// Change of brightness, share. Yellow as for a session; red where colours are no longer known (0.6 to 1.6 times their
/// light).
pub fn exposure() -> Limits {
    Limits { refuse: Some(0.4), ..Cause::Exposure.limits() }
}

/// Change of white, codes. Yellow as for a session; red where a colour is nobody's.
pub fn white() -> Limits {
    Limits { refuse: Some(8.0), ..Cause::WhiteBalance.limits() }
}
