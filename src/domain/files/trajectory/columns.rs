//! The columns of the table: what a row has in each of them.

use super::state_name;
use crate::vision::trajectory::Sample;

/// One value of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum TableCell {
    /// In the column `frame`.
    Frame(u64),
    /// In the column `tool`: an index into the list of tools.
    Tool(usize),
    /// In the column `state`.
    State(&'static str),
    /// In all others; `None` where nothing was measured.
    Number(Option<f64>),
}

/// A row's value in the column with this position in [`COLUMNS`](super::COLUMNS).
pub(super) fn cell(row: &Sample, column: usize) -> TableCell {
    match column {
        0 => TableCell::Frame(row.frame),
        1 => TableCell::Number(Some(row.time_s)),
        2 => TableCell::Tool(row.tool),
        16 => TableCell::State(state_name(row.state)),
        _ => TableCell::Number(number(row, column)),
    }
}

/// A row's value in a column of numbers; `None` where nothing was measured, and in the other columns.
pub(super) fn number(row: &Sample, column: usize) -> Option<f64> {
    match column {
        1 => Some(row.time_s),
        3..6 => Some(row.tip_mm[column - 3]),
        6..9 => row.velocity_mm_s.map(|velocity| velocity[column - 6]),
        9..12 => row.axis.map(|axis| axis[column - 9]),
        12..14 => row.tip_px.map(|pixel| pixel[column - 12]),
        14 => row.sigma_xy_mm(),
        15 => row.sigma_z_mm(),
        17..23 => row.covariance_mm2.map(|of| of.upper()[column - 17]),
        _ => None,
    }
}
