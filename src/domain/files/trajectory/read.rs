//! CSV → trajectory: our own files, and those of other trackers.
//!
//! An invalid row is an error with its line number, never a guess. The order of rows and columns is free, because
//! other programs write tool after tool or add columns of their own. The *content* must be consistent: each tool at
//! most once on a frame, one time per frame, and times that increase with the frame number.

use std::collections::HashMap;
use std::io::Read;

use csv::StringRecord;
use nalgebra::{Point2, Point3, Vector3};

use super::{COLUMNS, COVARIANCE_COLUMNS, REQUIRED_COLUMNS, shortened};
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

/// Largest accepted coordinate, mm: ten metres, far outside any box. It catches wrong units (micrometres instead of
/// millimetres) and keeps all numbers that are computed from a path finite.
pub const MAX_COORDINATE_MM: f64 = 10_000.0;

/// Latest accepted time, s: a week of recording.
pub const MAX_TIME_S: f64 = 604_800.0;

/// Largest accepted standard deviation, mm: its square is finite.
const MAX_SIGMA_MM: f64 = 1e7;

/// How far a standard deviation may be from the covariance, mm and as a share: numbers rounded to two digits.
const SIGMA_ROUNDING: f64 = 0.006;

/// Why a table cannot be read as a trajectory. Lines count from 1; the header is line 1.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum TrajectoryProblem {
    /// The file is empty.
    #[error("the file is empty; expected a header line with {}", required_columns())]
    Empty,
    /// A required column is missing.
    #[error("the header has no column `{0}`; needed are {columns}, separated by commas", columns = required_columns())]
    MissingColumn(&'static str),
    /// A known column appears twice.
    #[error("the header names column `{0}` twice")]
    RepeatedColumn(&'static str),
    /// Not CSV in UTF-8, a line with too few or too many fields, or an unreadable stream.
    #[error("not a CSV table: {0}")]
    Syntax(String),
    /// More rows than the reader accepts.
    #[error("more than {most} rows; send a shorter recording")]
    TooManyRows {
        /// Maximum number of rows.
        most: usize,
    },
    /// A field with an invalid value.
    #[error("line {line}: `{column}` is `{text}`; expected {expected}")]
    Field {
        /// Its line.
        line: u64,
        /// The column.
        column: &'static str,
        /// The text in the file.
        text: String,
        /// The expected value.
        expected: &'static str,
    },
    /// Some, but not all, numbers of a vector.
    #[error("line {line}: only some of {columns} are filled in; give all of them or none")]
    IncompleteVector {
        /// Its line.
        line: u64,
        /// The columns that belong together.
        columns: &'static str,
    },
    /// Two rows of one tool on one frame.
    #[error("line {line}: tool `{tool}` already has a row on frame {frame}, at line {earlier}")]
    RepeatedRow {
        /// Its line.
        line: u64,
        /// The tool.
        tool: String,
        /// The frame.
        frame: u64,
        /// Line of the earlier row.
        earlier: u64,
    },
    /// Times that do not increase with the frame number, or differ on one frame.
    #[error(
        "line {line}: frame {frame} at {time_s} s contradicts line {earlier}: frame {earlier_frame} at {earlier_s} s"
    )]
    Time {
        /// Its line.
        line: u64,
        /// Its frame.
        frame: u64,
        /// Its time, s.
        time_s: f64,
        /// Line of the row that it contradicts.
        earlier: u64,
        /// That row's frame.
        earlier_frame: u64,
        /// That row's time, s.
        earlier_s: f64,
    },
}

fn required_columns() -> String {
    COLUMNS[..REQUIRED_COLUMNS].join(",")
}

/// Samples with their line numbers, ordered by frame, then tool.
pub(super) type NumberedRows = Vec<(Sample, u64)>;

/// Reads a trajectory from a table. Tools are numbered in order of first appearance in the file; samples are returned
/// ordered by frame, then tool. Unknown columns are ignored; without a column `state` every row counts as observed.
/// Without covariances, errors in x, y and z are taken as independent; a row with only one sigma states no error.
///
/// A header without rows is a trajectory without samples. Frames without a tracked tool have no row in the table, so
/// `frame_times_s` stays empty.
pub fn read_csv(input: impl Read) -> Result<Trajectory, TrajectoryProblem> {
    let (tools, rows) = read_rows(input, usize::MAX)?;
    let samples = rows.into_iter().map(|(sample, _)| sample).collect();
    Ok(Trajectory { tools, samples, frame_times_s: Vec::new(), cuts: Vec::new() })
}

/// Reads the tools' names and the samples with their line numbers, from a table of at most `most` rows.
pub(super) fn read_rows(input: impl Read, most: usize) -> Result<(Vec<String>, NumberedRows), TrajectoryProblem> {
    let mut table = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(input);
    let columns = ColumnPositions::find(table.headers().map_err(syntax)?)?;
    let mut tools = ToolNumbers::default();
    let mut rows = Vec::new();
    for record in table.records() {
        if rows.len() == most {
            return Err(TrajectoryProblem::TooManyRows { most });
        }
        let record = record.map_err(syntax)?;
        let row =
            RowFields { record: &record, columns: &columns, line: record.position().map_or(0, csv::Position::line) };
        rows.push((row.sample(&mut tools)?, row.line));
    }
    rows.sort_by_key(|(sample, _)| (sample.frame, sample.tool));
    check_order(&rows, &tools.names)?;
    Ok((tools.names, rows))
}

fn syntax(error: csv::Error) -> TrajectoryProblem {
    TrajectoryProblem::Syntax(error.to_string())
}

/// Adjacent rows, once sorted, must agree: another tool at the same time, or a later frame at a later time.
fn check_order(rows: &[(Sample, u64)], tools: &[String]) -> Result<(), TrajectoryProblem> {
    for pair in rows.windows(2) {
        let [(before, earlier), (after, line)] = pair else { continue };
        if before.frame == after.frame && before.tool == after.tool {
            let tool = shortened(&tools[after.tool]);
            let (earlier, line) = (*earlier.min(line), *earlier.max(line));
            return Err(TrajectoryProblem::RepeatedRow { line, tool, frame: after.frame, earlier });
        }
        let agrees =
            if before.frame == after.frame { before.time_s == after.time_s } else { before.time_s < after.time_s };
        if !agrees {
            return Err(TrajectoryProblem::Time {
                line: *line,
                frame: after.frame,
                time_s: after.time_s,
                earlier: *earlier,
                earlier_frame: before.frame,
                earlier_s: before.time_s,
            });
        }
    }
    Ok(())
}

/// Position of each known column in the file.
struct ColumnPositions([Option<usize>; COLUMNS.len()]);

impl ColumnPositions {
    fn find(header: &StringRecord) -> Result<Self, TrajectoryProblem> {
        if header.iter().all(str::is_empty) {
            return Err(TrajectoryProblem::Empty);
        }
        let mut positions = [None; COLUMNS.len()];
        for (index, name) in header.iter().enumerate() {
            let name = name.trim_start_matches('\u{feff}'); // spreadsheets put a byte-order mark before the first name
            if let Some(column) = COLUMNS.iter().position(|known| *known == name)
                && positions[column].replace(index).is_some()
            {
                return Err(TrajectoryProblem::RepeatedColumn(COLUMNS[column]));
            }
        }
        match (0..REQUIRED_COLUMNS).find(|&column| positions[column].is_none()) {
            Some(missing) => Err(TrajectoryProblem::MissingColumn(COLUMNS[missing])),
            None => Ok(Self(positions)),
        }
    }

    fn of(&self, name: &str) -> Option<usize> {
        COLUMNS.iter().position(|known| *known == name).and_then(|column| self.0[column])
    }
}

/// The tools seen so far, numbered in order of appearance.
#[derive(Default)]
struct ToolNumbers {
    names: Vec<String>,
    numbers: HashMap<String, usize>,
}

impl ToolNumbers {
    fn number(&mut self, name: &str) -> usize {
        if let Some(&number) = self.numbers.get(name) {
            return number;
        }
        self.names.push(name.to_owned());
        self.numbers.insert(name.to_owned(), self.names.len() - 1);
        self.names.len() - 1
    }
}

/// One line of the file.
struct RowFields<'a> {
    record: &'a StringRecord,
    columns: &'a ColumnPositions,
    line: u64,
}

impl RowFields<'_> {
    fn sample(&self, tools: &mut ToolNumbers) -> Result<Sample, TrajectoryProblem> {
        Ok(Sample {
            frame: self.frame()?,
            time_s: self.bounded("time_s", MAX_TIME_S, "seconds, at most a week")?,
            tool: tools.number(self.tool()?),
            tip_mm: Point3::new(self.millimetres("x_mm")?, self.millimetres("y_mm")?, self.millimetres("z_mm")?),
            velocity_mm_s: self.vector(["vx_mm_s", "vy_mm_s", "vz_mm_s"], "vx_mm_s, vy_mm_s, vz_mm_s")?,
            axis: self.vector(["axis_x", "axis_y", "axis_z"], "axis_x, axis_y, axis_z")?,
            tip_px: self.pixel()?,
            covariance_mm2: self.covariance()?,
            state: self.state()?,
        })
    }

    fn text(&self, column: &'static str) -> &str {
        self.columns.of(column).and_then(|index| self.record.get(index)).unwrap_or("")
    }

    fn field_error(&self, column: &'static str, expected: &'static str) -> TrajectoryProblem {
        TrajectoryProblem::Field { line: self.line, column, text: shortened(self.text(column)), expected }
    }

    fn frame(&self) -> Result<u64, TrajectoryProblem> {
        self.text("frame").parse().map_err(|_| self.field_error("frame", "a whole number from 0"))
    }

    fn tool(&self) -> Result<&str, TrajectoryProblem> {
        let name = self.text("tool");
        if name.is_empty() { Err(self.field_error("tool", "the tool's name")) } else { Ok(name) }
    }

    fn state(&self) -> Result<SampleState, TrajectoryProblem> {
        match self.text("state") {
            "" | "observed" => Ok(SampleState::Observed),
            "predicted" => Ok(SampleState::Predicted),
            _ => Err(self.field_error("state", "observed or predicted")),
        }
    }

    fn bounded(&self, column: &'static str, limit: f64, expected: &'static str) -> Result<f64, TrajectoryProblem> {
        let value = self.text(column).parse::<f64>().ok().filter(|v| v.abs() <= limit); // NaN is not below anything
        value.ok_or_else(|| self.field_error(column, expected))
    }

    fn millimetres(&self, column: &'static str) -> Result<f64, TrajectoryProblem> {
        self.bounded(column, MAX_COORDINATE_MM, "millimetres with a decimal dot, within ten metres")
    }

    fn optional(&self, column: &'static str) -> Result<Option<f64>, TrajectoryProblem> {
        match self.text(column) {
            "" => Ok(None),
            text => {
                let value = text.parse::<f64>().ok().filter(|v| v.is_finite());
                value
                    .map(Some)
                    .ok_or_else(|| self.field_error(column, "a finite number with a decimal dot, or nothing"))
            }
        }
    }

    fn vector(
        &self,
        [x, y, z]: [&'static str; 3],
        columns: &'static str,
    ) -> Result<Option<Vector3<f64>>, TrajectoryProblem> {
        match (self.optional(x)?, self.optional(y)?, self.optional(z)?) {
            (Some(x), Some(y), Some(z)) => Ok(Some(Vector3::new(x, y, z))),
            (None, None, None) => Ok(None),
            _ => Err(TrajectoryProblem::IncompleteVector { line: self.line, columns }),
        }
    }

    fn pixel(&self) -> Result<Option<Point2<f64>>, TrajectoryProblem> {
        match (self.optional("tip_u_px")?, self.optional("tip_v_px")?) {
            (Some(u), Some(v)) => Ok(Some(Point2::new(u, v))),
            (None, None) => Ok(None),
            _ => Err(TrajectoryProblem::IncompleteVector { line: self.line, columns: "tip_u_px, tip_v_px" }),
        }
    }

    fn sigma(&self, column: &'static str) -> Result<Option<f64>, TrajectoryProblem> {
        let value = self.optional(column)?;
        if value.is_some_and(|v| !(0.0..=MAX_SIGMA_MM).contains(&v)) {
            Err(self.field_error(column, "a standard deviation in mm, from 0 to 10 000 000"))
        } else {
            Ok(value)
        }
    }

    /// The covariance of the position, from its six columns or, without them, from the two standard deviations.
    fn covariance(&self) -> Result<Option<PositionCovariance>, TrajectoryProblem> {
        let (across, depth) = (self.sigma("sigma_xy_mm")?, self.sigma("sigma_z_mm")?);
        let mut entries = [None; COVARIANCE_COLUMNS.len()];
        for (entry, column) in entries.iter_mut().zip(COVARIANCE_COLUMNS) {
            *entry = self.optional(column)?;
        }
        if entries == [None; COVARIANCE_COLUMNS.len()] {
            return Ok(across.zip(depth).map(|(across, depth)| PositionCovariance::from_sigmas(across, depth)));
        }
        let [Some(xx), Some(xy), Some(xz), Some(yy), Some(yz), Some(zz)] = entries else {
            let columns = "cov_xx_mm2, cov_xy_mm2, cov_xz_mm2, cov_yy_mm2, cov_yz_mm2, cov_zz_mm2";
            return Err(TrajectoryProblem::IncompleteVector { line: self.line, columns });
        };
        let stated = PositionCovariance { xx, xy, xz, yy, yz, zz };
        for (column, variance) in [("cov_xx_mm2", xx), ("cov_yy_mm2", yy), ("cov_zz_mm2", zz)] {
            if !(0.0..=MAX_SIGMA_MM * MAX_SIGMA_MM).contains(&variance) {
                return Err(self.field_error(column, "a variance in mm², from 0 to 100 000 000 000 000"));
            }
        }
        if !stated.is_valid() {
            let pairs = [("cov_xy_mm2", xy, xx * yy), ("cov_xz_mm2", xz, xx * zz), ("cov_yz_mm2", yz, yy * zz)];
            let too_large = pairs.iter().find(|(_, covariance, limit)| covariance * covariance > *limit);
            let column = too_large.map_or("cov_xy_mm2", |(column, ..)| column);
            let expected = "a covariance that fits the other five: the matrix has to be positive semi-definite";
            return Err(self.field_error(column, expected));
        }
        let agrees = |sigma: Option<f64>, own: f64| {
            sigma.is_none_or(|s| (s - own).abs() <= SIGMA_ROUNDING * own + SIGMA_ROUNDING)
        };
        if !agrees(across, stated.sigma_xy_mm()) {
            return Err(self.field_error("sigma_xy_mm", "the square root of (cov_xx_mm2 + cov_yy_mm2) / 2"));
        }
        if !agrees(depth, stated.sigma_z_mm()) {
            return Err(self.field_error("sigma_z_mm", "the square root of cov_zz_mm2"));
        }
        Ok(Some(stated))
    }
}
