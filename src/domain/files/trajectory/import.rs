//! CSV → trajectory of another tracker, to be stored and scored like our own. Stricter than [`read_csv`], which reads
//! tables that users score for themselves.
//!
//! Stored results are shown to others and used to judge trainees. A table must therefore be plausible: times from 0 on,
//! tools that the box has, at least two rows for each tool, and numbers of a plausible size. The error names the first
//! bad line and its column.
//!
//! [`read_csv`]: super::read_csv

use super::read::{NumberedRows, TrajectoryProblem, read_rows};
use super::shortened;
use crate::domain::files::{MAX_TOOL_NAME_LENGTH, is_tool_name, quoted_tool_name};
use crate::vision::trajectory::{Sample, Trajectory};

/// Largest accepted magnitude of velocities and pixels: no picture has that many pixels, and no tool moves
/// that fast in mm/s.
const MAX_MAGNITUDE: f64 = 1e7;

/// Tolerance for the length of a direction vector, which should be 1: the rounding error of parts with three decimals.
const UNIT_LENGTH_TOLERANCE: f64 = 0.005;

/// Limits of an imported table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImportLimits {
    /// Maximum number of rows.
    pub rows: usize,
    /// Maximum number of tools.
    pub tools: usize,
    /// Frame numbers must be below this.
    pub frames: u64,
    /// Latest time, s.
    pub duration_s: f64,
}

/// Why a table cannot be imported. Lines count from 1; the header is line 1.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ImportProblem {
    /// Not a trajectory.
    #[error(transparent)]
    Table(#[from] TrajectoryProblem),
    /// Not text.
    #[error("line {line}: not UTF-8; export the table as UTF-8")]
    NotUtf8 {
        /// The line.
        line: u64,
    },
    /// A tool with a single row.
    #[error("line {line}: `tool` is `{tool}`, which has one row only; a path needs at least two")]
    SingleRow {
        /// Line of the row.
        line: u64,
        /// The tool.
        tool: String,
    },
    /// A header without rows.
    #[error("the table has a header and no rows; a path needs at least two")]
    NoRows,
    /// A tool that the box does not have.
    #[error("line {line}: `tool` is `{tool}`, which the box does not have; its tools are {known}")]
    UnknownTool {
        /// Line of its first row.
        line: u64,
        /// Its name.
        tool: String,
        /// The names of the box's tools.
        known: String,
    },
    /// More tools than a session can have.
    #[error("line {line}: `tool` is `{tool}`, but a table may have at most {most} tools")]
    TooManyTools {
        /// Line of its first row.
        line: u64,
        /// Its name.
        tool: String,
        /// Maximum number of tools.
        most: usize,
    },
    /// A value outside the accepted range.
    #[error("line {line}: `{column}` is {value}; expected {expected}")]
    OutOfRange {
        /// The line.
        line: u64,
        /// The column.
        column: &'static str,
        /// The value.
        value: String,
        /// The expected value.
        expected: String,
    },
}

/// An accepted table.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedTable {
    /// Its trajectory.
    pub trajectory: Trajectory,
    /// Number of frames with a row of any tool.
    pub frames: u64,
    /// From the first row to the last, s.
    pub duration_s: f64,
}

/// Reads a table of another tracker. `known`: the names of the box's tools; while the box has none, it is empty and any
/// name is accepted.
pub fn read_import(bytes: &[u8], known: &[String], limits: &ImportLimits) -> Result<ImportedTable, ImportProblem> {
    if let Err(error) = std::str::from_utf8(bytes) {
        let before = &bytes[..error.valid_up_to()];
        return Err(ImportProblem::NotUtf8 { line: 1 + before.iter().filter(|byte| **byte == b'\n').count() as u64 });
    }
    let (tools, rows) = read_rows(bytes, limits.rows)?;
    check_tools(&tools, &rows, known, limits)?;
    rows.iter().try_for_each(|(sample, line)| check_numbers(sample, *line, limits))?;
    if rows.is_empty() {
        return Err(ImportProblem::NoRows);
    }
    let samples = rows.into_iter().map(|(sample, _)| sample).collect();
    Ok(ImportedTable::of(Trajectory { tools, samples, frame_times_s: Vec::new(), cuts: Vec::new() }))
}

impl ImportedTable {
    /// Derives the number of frames and the duration from the rows.
    pub fn of(trajectory: Trajectory) -> Self {
        let frames = trajectory.samples.chunk_by(|a, b| a.frame == b.frame).count() as u64;
        let ends = trajectory.samples.first().zip(trajectory.samples.last());
        let duration_s = ends.map_or(0.0, |(first, last)| last.time_s - first.time_s);
        Self { trajectory, frames, duration_s }
    }
}

fn check_tools(
    tools: &[String],
    rows: &NumberedRows,
    known: &[String],
    limits: &ImportLimits,
) -> Result<(), ImportProblem> {
    for (index, tool) in tools.iter().enumerate() {
        let mut lines = rows.iter().filter(|(sample, _)| sample.tool == index).map(|(_, line)| *line);
        let (line, second) = (lines.next().unwrap_or_default(), lines.next());
        let shown = shortened(tool);
        if index >= limits.tools {
            return Err(ImportProblem::TooManyTools { line, tool: shown, most: limits.tools });
        }
        if !known.is_empty() && !known.contains(tool) {
            let known = known.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
            return Err(ImportProblem::UnknownTool { line, tool: shown, known });
        }
        if !is_tool_name(tool) {
            let expected =
                format!("a name of at most {MAX_TOOL_NAME_LENGTH} characters that begins with a letter or a digit");
            let value = quoted_tool_name(tool);
            return Err(ImportProblem::OutOfRange { line, column: "tool", value, expected });
        }
        if second.is_none() {
            return Err(ImportProblem::SingleRow { line, tool: shown });
        }
    }
    Ok(())
}

fn check_numbers(sample: &Sample, line: u64, limits: &ImportLimits) -> Result<(), ImportProblem> {
    let beyond = |column, value: String, expected: String| ImportProblem::OutOfRange { line, column, value, expected };
    if sample.frame >= limits.frames {
        let expected = format!("a frame number below {}", limits.frames);
        return Err(beyond("frame", sample.frame.to_string(), expected));
    }
    if !(0.0..=limits.duration_s).contains(&sample.time_s) {
        let expected = format!("seconds from 0 to {}", limits.duration_s);
        return Err(beyond("time_s", sample.time_s.to_string(), expected));
    }
    if let Some(axis) = sample.axis.filter(|axis| (axis.norm() - 1.0).abs() > UNIT_LENGTH_TOLERANCE) {
        let value = format!("part of a vector of length {}", axis.norm());
        return Err(beyond("axis_x", value, "a vector of length 1".to_owned()));
    }
    let vector = |columns: [&'static str; 3], v: Option<nalgebra::Vector3<f64>>| {
        columns.into_iter().zip(v.into_iter().flat_map(|v| [v.x, v.y, v.z])).collect::<Vec<_>>()
    };
    let pixel = sample.tip_px.into_iter().flat_map(|p| [("tip_u_px", p.x), ("tip_v_px", p.y)]);
    let numbers = vector(["vx_mm_s", "vy_mm_s", "vz_mm_s"], sample.velocity_mm_s).into_iter();
    let numbers = numbers.chain(vector(["axis_x", "axis_y", "axis_z"], sample.axis)).chain(pixel);
    let too_large = numbers.into_iter().find(|(_, value)| value.abs() > MAX_MAGNITUDE);
    too_large.map_or(Ok(()), |(column, value)| {
        Err(beyond(column, value.to_string(), format!("a number within {MAX_MAGNITUDE} of 0")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: ImportLimits = ImportLimits { rows: 6, tools: 2, frames: 100, duration_s: 60.0 };
    const HEAD: &str = "frame,time_s,tool,x_mm,y_mm,z_mm\n";

    fn read(rows: &str) -> Result<ImportedTable, ImportProblem> {
        read_import(format!("{HEAD}{rows}").as_bytes(), &["left".to_owned(), "right".to_owned()], &LIMITS)
    }

    fn refused(rows: &str) -> String {
        read(rows).expect_err(rows).to_string()
    }

    #[test]
    fn a_table_of_two_tools_is_imported_with_frames_and_duration() {
        let table = read("0,0.5,left,1,2,150\n1,1,left,1,2,150\n1,1,right,1,2,150\n3,2.0,right,1,2,150\n").unwrap();
        assert_eq!((table.frames, table.duration_s), (3, 1.5));
        assert_eq!(table.trajectory.tools, ["left", "right"]);
        assert_eq!(table.trajectory.samples.len(), 4);
    }

    #[test]
    fn each_table_that_no_tracker_writes_is_refused_with_its_line_and_column() {
        let two = "0,0,left,1,2,150\n1,1,left,1,2,150\n";
        for (rows, words) in [
            ("", "no rows"),
            ("0,0,left,1,2,150\n", "line 2: `tool` is `left`, which has one row only"),
            (&format!("{two}1,1,right,1,2,150\n"), "line 4: `tool` is `right`, which has one row only"),
            ("0,0,left,NaN,2,150\n1,1,left,1,2,150\n", "line 2: `x_mm` is `NaN`"),
            ("0,0,left,1,2,150\n1,inf,left,1,2,150\n", "line 3: `time_s` is `inf`"),
            ("0,1,left,1,2,150\n1,0,left,1,2,150\n", "line 3: frame 1 at 0 s contradicts line 2"),
            ("0,0,left,1,2,150\n0,0,left,3,2,150\n", "line 3: tool `left` already has a row on frame 0"),
            ("0,0,green,1,2,150\n1,1,green,1,2,150\n", "line 2: `tool` is `green`, which the box does not have"),
            ("0,-1,left,1,2,150\n1,1,left,1,2,150\n", "line 2: `time_s` is -1; expected seconds from 0 to 60"),
            ("0,0,left,1,2,150\n1,61,left,1,2,150\n", "line 3: `time_s` is 61"),
            ("0,0,left,1,2,150\n100,1,left,1,2,150\n", "line 3: `frame` is 100; expected a frame number below 100"),
            ("0,0,left,1,2\n", "line: 2"),
            (&format!("{two}2,2,left,1,2,150\n").repeat(3), "more than 6 rows"),
        ] {
            let refused = refused(rows);
            assert!(refused.contains(words), "{rows}: {refused}");
        }
        let long = format!("{}frame", "x".repeat(9));
        assert!(read_import(long.as_bytes(), &[], &LIMITS).unwrap_err().to_string().contains("no column `frame`"));
        let odd = [HEAD.as_bytes(), b"0,0,l\xe9ft,1,2,150\n"].concat();
        assert_eq!(read_import(&odd, &[], &LIMITS), Err(ImportProblem::NotUtf8 { line: 2 }));
    }

    #[test]
    fn a_box_without_colours_takes_any_two_tools_and_no_more() {
        let rows = |tool: &str| format!("0,0,{tool},1,2,150\n1,1,{tool},1,2,150\n");
        let table = format!("{HEAD}{}{}", rows("a"), rows("b"));
        assert_eq!(read_import(table.as_bytes(), &[], &LIMITS).unwrap().trajectory.tools, ["a", "b"]);
        let refused = read_import((table + &rows("c")).as_bytes(), &[], &LIMITS).unwrap_err().to_string();
        assert!(refused.starts_with("line 6: `tool` is `c`, but a table may have at most 2 tools"), "{refused}");
    }

    #[test]
    fn a_direction_of_wrong_length_is_refused() {
        let table = "frame,time_s,tool,x_mm,y_mm,z_mm,axis_x,axis_y,axis_z\n0,0,a,1,2,150,0,0,1\n1,1,a,1,2,150,0,3,4\n";
        let refused = read_import(table.as_bytes(), &[], &LIMITS).unwrap_err().to_string();
        assert!(refused.starts_with("line 3: `axis_x` is part of a vector of length 5"), "{refused}");
    }

    #[test]
    fn an_implausibly_large_number_is_refused() {
        let table = "frame,time_s,tool,x_mm,y_mm,z_mm,sigma_z_mm\n0,0,a,1,2,150,1\n1,1,a,1,2,150,1e300\n";
        let refused = read_import(table.as_bytes(), &[], &LIMITS).unwrap_err().to_string();
        assert!(refused.starts_with("line 3: `sigma_z_mm` is"), "{refused}");
    }

    #[test]
    fn a_covariance_comes_whole_and_is_one_that_errors_can_have() {
        let import = |columns: &str, fields: &str| {
            let table =
                format!("frame,time_s,tool,x_mm,y_mm,z_mm,{columns}\n0,0,a,1,2,150,{fields}\n1,1,a,1,2,150,{fields}\n");
            read_import(table.as_bytes(), &[], &LIMITS)
        };
        const SIX: &str = "cov_xx_mm2,cov_xy_mm2,cov_xz_mm2,cov_yy_mm2,cov_yz_mm2,cov_zz_mm2";
        let accepted = import(SIX, "1,0,1.5,1,0,4").unwrap().trajectory.samples[1];
        assert_eq!(accepted.covariance_mm2.unwrap().upper(), [1.0, 0.0, 1.5, 1.0, 0.0, 4.0]);
        assert_eq!((accepted.sigma_xy_mm(), accepted.sigma_z_mm()), (Some(1.0), Some(2.0)));
        assert!(import(&format!("sigma_z_mm,{SIX}"), "2.00,1,0,1.5,1,0,4.01").is_ok(), "rounded");
        for (columns, fields, words) in [
            (SIX, "-1,0,0,1,0,4", "line 2: `cov_xx_mm2` is `-1`; expected a variance"),
            (SIX, "1,0,2.1,1,0,4", "line 2: `cov_xz_mm2` is `2.1`; expected a covariance that fits the other five"),
            (SIX, "1,0.9,0.9,1,-0.9,1", "line 2: `cov_xy_mm2` is `0.9`; expected a covariance that fits"),
            (SIX, "1,0,0,1,0,", "line 2: only some of cov_xx_mm2, cov_xy_mm2,"),
            ("cov_xx_mm2,cov_yy_mm2,cov_zz_mm2", "1,1,4", "line 2: only some of cov_xx_mm2, cov_xy_mm2,"),
            (&format!("sigma_z_mm,{SIX}"), "4,1,0,0,1,0,4", "line 2: `sigma_z_mm` is `4`; expected the square root of"),
            (&format!("sigma_xy_mm,{SIX}"), "2,1,0,0,1,0,4", "line 2: `sigma_xy_mm` is `2`; expected the square root"),
        ] {
            let refused = import(columns, fields).expect_err(fields).to_string();
            assert!(refused.contains(words), "{fields}: {refused}");
        }
    }
}
