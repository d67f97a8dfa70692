//! Trajectories as files: one table, as CSV, as JSON columns and as Parquet.
//!
//! One row per frame and tool tracked on it, with the columns of [`COLUMNS`] in that order. `frame` counts
//! decoded frames from 0, `time_s` is the frame's presentation time; millimetres and seconds. Numbers are written in
//! the shortest form that reads back to the same number, so a stored trajectory gives the same score again.
//!
//! All three formats are written piece by piece from a [`RowSource`], so that a table of any length needs little
//! memory. Only CSV is read, because other programs deliver trajectories as CSV.

mod columns;
mod import;
mod json;
mod parquet;
mod read;
mod rows;
mod thin;
mod write;

pub use import::{ImportLimits, ImportProblem, ImportedTable, read_import};
pub use json::JsonPieces;
pub use parquet::{ParquetPieces, ParquetProblem};
pub use read::{TrajectoryProblem, read_csv};
pub use rows::{BoxedRows, HeldRows, MAX_HELD_ROWS, RowSource};
pub use thin::{ThinnedRows, Thinning};
pub use write::{CsvPieces, write_csv};

use crate::vision::trajectory::SampleState;

/// The table's columns, in order. Readers need the first [`REQUIRED_COLUMNS`] of them; the others may be absent or
/// empty.
pub const COLUMNS: [&str; 23] = [
    "frame",
    "time_s",
    "tool",
    "x_mm",
    "y_mm",
    "z_mm",
    "vx_mm_s",
    "vy_mm_s",
    "vz_mm_s",
    "axis_x",
    "axis_y",
    "axis_z",
    "tip_u_px",
    "tip_v_px",
    "sigma_xy_mm",
    "sigma_z_mm",
    "state",
    "cov_xx_mm2",
    "cov_xy_mm2",
    "cov_xz_mm2",
    "cov_yy_mm2",
    "cov_yz_mm2",
    "cov_zz_mm2",
];

/// The columns of the position's covariance: the last ones of [`COLUMNS`].
const COVARIANCE_COLUMNS: [&str; 6] = *COLUMNS.last_chunk().expect("more than six columns");

/// Number of required columns: the first ones of [`COLUMNS`].
pub const REQUIRED_COLUMNS: usize = 6;

/// Approximate size of a piece of text, bytes.
const PIECE_BYTES: usize = 64 * 1024;

/// Rows of a piece of CSV, which has about [`PIECE_BYTES`].
const ROWS_PER_PIECE: usize = 256;

/// Text from a file, shortened for a message: a field may be megabytes long.
fn shortened(text: &str) -> String {
    const MAX_CHARACTERS: usize = 60;
    match text.char_indices().nth(MAX_CHARACTERS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// The value for a state in the column `state`.
fn state_name(state: SampleState) -> &'static str {
    match state {
        SampleState::Observed => "observed",
        SampleState::Predicted => "predicted",
    }
}

#[cfg(test)]
mod tests;
