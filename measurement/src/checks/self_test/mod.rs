//! Tests whether a box still measures as it did when it was set up. It takes one minute with the printed checkerboard
//! and a taped rod.
//!
//! **In:** the recording's frames, for the board ([`BoardWatch`]), and the tracker's results for the same recording
//! ([`SelfTestEvidence`]). **Out:** [`SelfTestFindings`], in mm and pixels, and from them a [`Signal`] for each
//! [`SelfTestPart`] ([`verdict::judge`]). **Method:** the board's corners are known to the width of a printed line. A
//! rod's end that is held on a corner therefore shows the tracker's error in space. The corners alone give the board's
//! pose and show whether the lens still matches the calibration. Nothing here is fitted to the touches, so an error
//! that all touches share counts as an error.
//!
//! | file | what |
//! |---|---|
//! | [`board_watch`] | the frames that show the whole board, and its corners |
//! | [`placement`] | where and when the board lay still |
//! | [`hold`] | where a tool rested |
//! | [`colours`] | regions of the empty box that have a tape's colour today |
//! | [`contact`] | the point where a resting rod meets the board |
//! | [`touch`] | rests against corners: errors along and across the line of sight |
//! | [`limits`] | the limits between green, yellow and red, with their grounds |
//! | [`advice`] | what to do about a part that is not green |
//! | [`verdict`] | the traffic light, with advice |

pub mod advice;
pub mod board_watch;
pub mod colours;
pub mod contact;
pub mod hold;
pub mod limits;
pub mod placement;
pub mod touch;
pub mod verdict;

pub use advice::SelfTestAdvice;
pub use board_watch::BoardWatch;
pub use colours::{ColourWatch, FalseColour};
pub use contact::Rod;
pub use hold::Hold;
pub use placement::BoardPlacement;
pub use touch::{MeasuredTouch, Touch, TouchAccuracy, UnusableReason};
pub use verdict::{PartVerdict, SelfTestPart, SelfTestVerdict, Signal};

use crate::motion::quality::ports::Ports;
use crate::motion::quality::{self, Displacement, Figures};
use crate::vision::camera::board_pose::{FocalChange, focal_change};
use crate::vision::camera::checkerboard::BoardReason;
use crate::vision::camera::{Board, Camera};
use crate::vision::segmentation::palette::ColourSeparation;
use crate::vision::tracker::{Quality, ToolSpec};
use crate::vision::trajectory::Trajectory;

/// The input of a self-test: the tracker's results for the recording, and what is known about the box.
#[derive(Clone, Copy, Debug)]
pub struct SelfTestEvidence<'a> {
    /// The box's stored camera, used to track the recording.
    pub camera: Camera,
    /// The tools, in the tracker's order.
    pub tools: &'a [ToolSpec],
    /// Distance from the tape to each tool's point, mm; 0 if the tape ends at the rod's flat end.
    pub reach_mm: f64,
    /// Quality figures of the tracker.
    pub quality: &'a Quality,
    /// The tracker's smoothed path.
    pub smoothed: &'a Trajectory,
    /// Positions of the trocars in the box's sessions; empty if not known.
    pub ports: &'a Ports,
    /// Regions of the empty box that have the tapes' colours; empty if the box was never seen empty.
    pub false_colours: &'a [FalseColour],
}

/// The findings of a self-test.
#[derive(Clone, Debug, PartialEq)]
pub struct SelfTestFindings {
    /// The board.
    pub board: Board,
    /// Places where it lay still, in order of time.
    pub placements: Vec<BoardPlacement>,
    /// Number of frames searched for the board.
    pub searched: usize,
    /// Why the board was not seen whole on the last frame without it.
    pub board_reason: Option<BoardReason>,
    /// Estimated change of the focal length.
    pub focal_change: Option<FocalChange>,
    /// Every rest of a tool, in order of time.
    pub touches: Vec<Touch>,
    /// Accuracy over all touches that count; `None` with fewer than [`limits::MIN_TOUCHES`].
    pub accuracy: Option<TouchAccuracy>,
    /// Distance of the rod's trocar from its position in the box's sessions; with several tools, the largest distance
    /// that is certain. `None` if either position is not known, for example if the rod is held without a trocar.
    pub trocar_shift: Option<Displacement>,
    /// True if no tool has tape, so that there is no tape's colour to check.
    pub has_only_bare_tools: bool,
    /// Margin of each tool's colour against other colours.
    pub colours: Vec<(String, ColourSeparation)>,
    /// Largest region of today's empty box that has a tape's colour, with the colour's label, as a multiple of the
    /// tape's area as seen on the board. Empty if the box was never seen empty, or the board was never seen.
    pub false_regions: Vec<(String, f64)>,
    /// Largest change of the picture's brightness, as a share of its median.
    pub exposure_drift: Option<f64>,
    /// Largest change of the picture's white, codes of 224.
    pub white_drift_codes: Option<f64>,
}

/// Combines the findings about the board with those of the tracker.
pub fn measure(watch: BoardWatch, evidence: &SelfTestEvidence<'_>) -> SelfTestFindings {
    let (board, searched, board_reason) = (watch.board(), watch.searched(), watch.last_reason());
    let placements = placement::placements_of(watch.into_sightings(), &evidence.camera, board);
    let views: Vec<_> = placements.iter().map(|placement| placement.corners.clone()).collect();
    let focal_change = if views.is_empty() { None } else { focal_change(&evidence.camera, board, &views) };
    let holds = hold::holds_of_path(evidence.smoothed);
    let touches = touch::measure_holds(holds, &placements, board, evidence);
    let false_regions = placements.first().map_or_else(Vec::new, |on| false_regions(on, evidence));
    let path = quality::QualityInput::of_path(evidence.smoothed);
    let Figures { session, tools } =
        quality::measure(&quality::QualityInput { tracker: Some(evidence.quality), ..path });
    let fulcrums: Vec<_> = evidence.quality.tools.iter().map(|tool| tool.fulcrum).collect();
    let shifts = evidence.ports.compare(&fulcrums).tools.into_iter().flatten();
    SelfTestFindings {
        board,
        searched,
        board_reason,
        focal_change,
        accuracy: touch::accuracy(&touches, &evidence.camera),
        touches,
        placements,
        trocar_shift: shifts.max_by(|a, b| a.is_significant().cmp(&b.is_significant()).then(a.mm.total_cmp(&b.mm))),
        has_only_bare_tools: !evidence.tools.is_empty() && evidence.tools.iter().all(ToolSpec::is_bare),
        colours: tools.into_iter().map(|tool| (tool.tool, tool.colour)).collect(),
        false_regions,
        exposure_drift: session.exposure_drift,
        white_drift_codes: session.white_drift_codes,
    }
}

/// Sizes of the false regions relative to the tape; if several tools have the colour, to the smallest tape.
fn false_regions(
    on: &BoardPlacement,
    SelfTestEvidence { camera, tools, false_colours, .. }: &SelfTestEvidence<'_>,
) -> Vec<(String, f64)> {
    /// Assumed length of a tape without a stated length, as a multiple of the diameter: 26 mm for 5 mm.
    const USUAL_LENGTH: f64 = 5.0;
    let px_per_mm2 = camera.fx * camera.fy / on.camera_from_board.translation.z.powi(2);
    let tape_px = |tool: &ToolSpec| {
        px_per_mm2 * tool.diameter_mm * tool.band_length_mm().unwrap_or(USUAL_LENGTH * tool.diameter_mm)
    };
    let of_tapes = |FalseColour { colour, largest_px }: &FalseColour| {
        let tape_px = tools.iter().filter(|tool| tool.colour == *colour).map(tape_px).reduce(f64::min)?;
        Some((colour.clone(), largest_px / tape_px))
    };
    false_colours.iter().filter_map(of_tapes).collect()
}

#[cfg(test)]
mod tests;
