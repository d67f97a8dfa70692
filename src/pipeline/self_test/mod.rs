//! Does a box still measure what it measured when it was set up? One minute with the printed checkerboard and a taped rod.
//!
//! **In:** the recording's frames, for the board ([`BoardWatch`]), and the tracker's word on the same recording
//! ([`Evidence`]). **Out:** [`Findings`], in mm and pixels, and of them a [`Signal`] for each [`Part`]
//! ([`verdict::judge`]). **Method:** the board's corners are known to the width of a printed line, so that where a rod's end
//! is held on one, the tracker's error is seen in space; where the board lies, and whether the lens is still the one that was
//! calibrated, the corners tell themselves. Nothing here is fitted to the touches: an error that all share is an error.
//!
//! | file | what |
//! |---|---|
//! | [`looks`] | which frames show the whole board, and where |
//! | [`placement`] | where it lay still, from when to when |
//! | [`hold`] | where a tool rested |
//! | [`colours`] | what of the empty box has a tape's colour today |
//! | [`contact`] | the point in which a resting rod meets the board |
//! | [`touch`] | rests against corners: errors along and across the line of sight |
//! | [`limits`] | from which figure on a light changes, and why from there |
//! | [`verdict`] | the traffic light, with what to do |

pub mod colours;
pub mod contact;
pub mod hold;
pub mod limits;
pub mod looks;
pub mod placement;
pub mod touch;
pub mod verdict;

pub use colours::{ColourWatch, FalseColour};
pub use contact::Rod;
pub use hold::Hold;
pub use looks::BoardWatch;
pub use placement::Placement;
pub use touch::{Accuracy, Measured, Touch, Unusable};
pub use verdict::{Part, PartVerdict, Signal, Verdict};

use super::camera::checkerboard::BoardReason;
use super::camera::placed::{FocalChange, focal_change};
use super::camera::{Board, Camera};
use super::quality::ports::Ports;
use super::quality::{self, Figures, Shift};
use super::segmentation::palette::Apart;
use super::tracker::{Quality, ToolSpec};
use super::trajectory::Trajectory;

/// What is known of the recording when it is judged.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// The box's stored camera, with which the recording was tracked.
    pub camera: Camera,
    /// The tools, in the tracker's order.
    pub tools: &'a [ToolSpec],
    /// How far beyond the tape each tool's point lies, mm; 0 where the tape ends at the rod's flat end.
    pub reach_mm: f64,
    /// How the tracker fared.
    pub quality: &'a Quality,
    /// Its smoothed path.
    pub smoothed: &'a Trajectory,
    /// Where trocars were in the box's sessions; none where that is not known.
    pub ports: &'a Ports,
    /// What of the empty box has the tapes' colours; none where it was never seen empty.
    pub false_colours: &'a [FalseColour],
}

/// What a self-test found.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    /// The board.
    pub board: Board,
    /// Where it lay still, in order of time.
    pub placements: Vec<Placement>,
    /// Frames that were searched for it.
    pub searched: usize,
    /// Why it was not seen whole on the last frame that did not show it.
    pub board_reason: Option<BoardReason>,
    /// By how much the lens's focal length seems to have changed.
    pub focal_change: Option<FocalChange>,
    /// Every rest of a tool, in order of time.
    pub touches: Vec<Touch>,
    /// Over all touches that count; `None` with fewer than [`limits::FEWEST_TOUCHES`].
    pub accuracy: Option<Accuracy>,
    /// How far from where the box's sessions had it the rod's trocar lies: the farthest that is sure, if tools were several. `None` where
    /// either is not known, as of a rod that is held freely.
    pub trocar_shift: Option<Shift>,
    /// How far each tool's colour stands apart.
    pub colours: Vec<(String, Apart)>,
    /// Largest region of today's empty box that has a tape's colour, by that colour's label, as a multiple of the tape as it
    /// would look on the board. None where the box was never seen empty, or no board.
    pub false_regions: Vec<(String, f64)>,
    /// Largest change of the picture's brightness, as a share of its median.
    pub exposure_drift: Option<f64>,
    /// Largest change of the picture's white, codes of 224.
    pub white_drift_codes: Option<f64>,
}

/// Puts together what the board and the tracker tell.
pub fn measure(watch: BoardWatch, evidence: &Evidence<'_>) -> Findings {
    let (board, searched, board_reason) = (watch.board(), watch.searched(), watch.last_reason());
    let placements = placement::of_looks(watch.into_looks(), &evidence.camera, board);
    let views: Vec<_> = placements.iter().map(|placement| placement.corners.clone()).collect();
    let focal_change = if views.is_empty() { None } else { focal_change(&evidence.camera, board, &views) };
    let holds = hold::of_path(evidence.smoothed);
    let touches = touch::of_holds(holds, &placements, board, evidence);
    let false_regions = placements.first().map_or_else(Vec::new, |on| false_regions(on, evidence));
    let path = quality::Evidence::of_path(evidence.smoothed);
    let Figures { session, tools } = quality::measure(&quality::Evidence { tracker: Some(evidence.quality), ..path });
    let fulcrums: Vec<_> = evidence.quality.tools.iter().map(|tool| tool.fulcrum).collect();
    let shifts = evidence.ports.place(&fulcrums).tools.into_iter().flatten();
    Findings {
        board,
        searched,
        board_reason,
        focal_change,
        accuracy: touch::accuracy(&touches, &evidence.camera),
        touches,
        placements,
        trocar_shift: shifts.max_by(|a, b| a.is_sure().cmp(&b.is_sure()).then(a.mm.total_cmp(&b.mm))),
        colours: tools.into_iter().map(|tool| (tool.tool, tool.colour)).collect(),
        false_regions,
        exposure_drift: session.exposure_drift,
        white_drift_codes: session.white_drift_codes,
    }
}

/// False colours against the tapes that have them, the smallest of each colour.
fn false_regions(on: &Placement, Evidence { camera, tools, false_colours, .. }: &Evidence<'_>) -> Vec<(String, f64)> {
    /// Length of a tape that nobody stated, as a multiple of the diameter: 26 mm of 5.
    const USUAL_LENGTH: f64 = 5.0;
    let px_per_mm2 = camera.fx * camera.fy / on.camera_from_board.translation.z.powi(2);
    let tape_px = |tool: &ToolSpec| {
        px_per_mm2 * tool.diameter_mm * tool.band_length_mm.unwrap_or(USUAL_LENGTH * tool.diameter_mm)
    };
    let of_tapes = |FalseColour { colour, largest_px }: &FalseColour| {
        let tape_px = tools.iter().filter(|tool| tool.colour == *colour).map(tape_px).reduce(f64::min)?;
        Some((colour.clone(), largest_px / tape_px))
    };
    false_colours.iter().filter_map(of_tapes).collect()
}

#[cfg(test)]
mod tests;
