//! The limits between green, yellow and red, with their grounds.
//!
//! Green means that today's sessions can be compared with those from the day when the box was set up. Yellow means that
//! they can be compared with caution. Red means that they cannot be compared.

use crate::motion::quality::QualityCause;
use crate::motion::quality::limits::{BetterDirection, MAX_DISPLACEMENT_MM, QualityLimits, at_most};
use crate::vision::segmentation::palette::verdict::FALSE_REGION;

/// Minimum of touches for a figure: three define a plane and cannot disagree with it. Six are requested, so two may
/// fail.
pub const MIN_TOUCHES: usize = 4;

/// RMS error of touches, mm. Simulated boxes give 0.3 to 0.9 with a 5 mm rod at 200 mm in 1280×720, and a hand places a
/// rod to half a millimetre: together below 1. (640×360 gives 1.5: yellow, because it is half as sharp.) Beyond 2.5 a
/// detour of the size of a peg's radius no longer shows. Faults that were tried: a tape that is 4 mm shorter than
/// stated gives 3 to 4, a rod of 5 mm that is entered as 6 mm gives 40.
pub const TOUCH_RMS_MM: QualityLimits = at_most(1.0, 2.5);

/// The same where most touches lie inside the error bars that the tracker states. The error is then no larger than
/// every session states, so sessions can be compared with caution: never red.
pub const STATED_TOUCH_RMS_MM: QualityLimits = QualityLimits { refuse: None, ..TOUCH_RMS_MM };

/// RMS reprojection error of the board, px, for a camera with this RMS error on its own photos. Frames of a compressed
/// recording are noisier than photos: simulated boxes give 0.03 where their calibration gave 0.02, and real sensors
/// some tenths. A zoom of 3 % gives 0.3, and a principal point that is 15 px off gives 0.2, because a tilt of the flat
/// board can hide most of it. So this limit finds coarse faults; [`FOCAL_CHANGE`] finds finer ones.
pub fn board_rms_px(calibration_rms_px: Option<f64>) -> QualityLimits {
    /// Usual RMS error of a calibration, for a camera.json without one.
    const USUAL_PX: f64 = 0.3;
    let own_px = calibration_rms_px.unwrap_or(USUAL_PX);
    at_most(1.5 * own_px + 0.2, 3.0 * own_px + 1.0)
}

/// Change of the focal length, share. Every depth changes by the same share: at 1 % a movement 50 mm deep is measured
/// half a millimetre wrong, and the box's depth of 200 mm by two; at 2 % by twice that, more than all other errors. The
/// touches do not show it, since board and rod shift alike (3 %: 0.6 to 1.0 mm). In simulated boxes it is known to 0.03
/// %.
pub const FOCAL_CHANGE: QualityLimits = at_most(0.01, 0.02);

/// Maximum standard deviation of a change of the focal length that is judged; a board that always faced the camera does
/// not show the change.
pub const MAX_FOCAL_SIGMA: f64 = 0.005;

/// Distance of the rod's trocar from its position in the box's sessions, mm: as for a session
/// ([`MAX_DISPLACEMENT_MM`]). Never red: a moved camera still measures correctly, only in another place.
pub const TROCAR_MM: QualityLimits =
    QualityLimits { better: BetterDirection::Less, care: Some(MAX_DISPLACEMENT_MM), refuse: None };

/// Largest region of the empty box that has a tape's colour, as a multiple of the tape: the same limits as for the
/// frames that were marked ([`FALSE_REGION`]).
pub const FALSE_TAPE: QualityLimits = at_most(FALSE_REGION[0], FALSE_REGION[1]);

/// Change of brightness, share. Yellow as for a session; red where colours are no longer recognised (outside 0.6 to 1.6
/// times the light of the samples).
pub fn exposure() -> QualityLimits {
    QualityLimits { refuse: Some(0.4), ..QualityCause::Exposure.limits() }
}

/// Change of white, codes. Yellow as for a session; red where a colour no longer matches any label.
pub fn white() -> QualityLimits {
    QualityLimits { refuse: Some(8.0), ..QualityCause::WhiteBalance.limits() }
}
