//! The rows of an imported table as they arrive from the child: each is checked, then kept in its stored form, which
//! takes half the memory of a [`Sample`].

use crate::analysis::child::limits::is_plausible_row;
use crate::analysis::paths::MAGIC;
use crate::analysis::protocol::encode;
use crate::domain::files::is_tool_name;
use crate::media::MediaLimits;
use crate::vision::trajectory::Sample;

/// Maximum number of tools in a table: two hands and two assisting tools.
pub const MAX_IMPORTED_TOOLS: usize = 4;

/// The rows of a table, encoded as the file of paths that a session stores.
#[derive(Debug)]
pub struct ImportedRows {
    tools: Vec<String>,
    /// Rows that have not arrived yet.
    missing: u64,
    frames: u64,
    first_s: Option<f64>,
    last: Option<Sample>,
    file: Vec<u8>,
}

impl ImportedRows {
    /// A table with these tools and this many rows. No row has arrived yet.
    pub(super) fn new(tools: Vec<String>, rows: u64, limits: MediaLimits) -> Result<Self, String> {
        let are_names = tools.iter().all(|tool| is_tool_name(tool));
        let is_repeated = tools.iter().enumerate().any(|(index, tool)| tools[..index].contains(tool));
        if tools.is_empty() || tools.len() > MAX_IMPORTED_TOOLS || !are_names || is_repeated {
            return Err("a table with impossible tools".into());
        }
        if rows == 0 || rows > limits.frames * tools.len() as u64 {
            return Err(format!("a table of {rows} rows"));
        }
        let none: [Vec<Sample>; 2] = Default::default();
        // The fields of `SessionPaths` up to the number of its smoothed rows.
        let opening = encode(&(&tools, Vec::<f64>::new(), &none[0], &none[1], rows)).map_err(|e| e.to_string())?;
        let file = [&MAGIC[..], &opening].concat();
        Ok(Self { tools, missing: rows, frames: 0, first_s: None, last: None, file })
    }

    /// Keeps rows if they continue those before.
    pub(super) fn accept(&mut self, rows: &[Sample], limits: MediaLimits) -> Result<(), String> {
        let left = self.missing.checked_sub(rows.len() as u64);
        self.missing = left.ok_or("more rows than the table has")?;
        for row in rows {
            let is_possible = row.tool < self.tools.len()
                && row.frame < limits.frames
                && (0.0..=limits.duration_s).contains(&row.time_s)
                && is_plausible_row(row);
            let is_new_frame = self.last.is_none_or(|last| last.frame < row.frame && last.time_s < row.time_s);
            let is_next_tool = self
                .last
                .is_some_and(|last| last.frame == row.frame && last.time_s == row.time_s && last.tool < row.tool);
            if !(is_possible && (is_new_frame || is_next_tool)) {
                return Err("an invalid row of a table".into());
            }
            self.frames += u64::from(is_new_frame);
            self.first_s.get_or_insert(row.time_s);
            self.last = Some(*row);
            self.file.extend(encode(row).map_err(|e| e.to_string())?);
        }
        Ok(())
    }

    /// True if all rows have arrived.
    pub(super) fn is_complete(&self) -> bool {
        self.missing == 0
    }

    /// Names of the tools.
    pub fn tools(&self) -> &[String] {
        &self.tools
    }

    /// Number of frames with a row of any tool.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Time from the first row to the last, s.
    pub fn duration_s(&self) -> f64 {
        self.first_s.zip(self.last).map_or(0.0, |(first_s, last)| last.time_s - first_s)
    }

    /// The file of paths, and the names of the tools.
    pub fn into_file(mut self) -> (Vec<u8>, Vec<String>) {
        self.file.push(0); // no tracker's summary
        (self.file, self.tools)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::analysis::paths::SessionPaths;
    use crate::vision::trajectory::SampleState;

    fn row(frame: u64, tool: usize) -> Sample {
        Sample {
            frame,
            time_s: frame as f64 / 25.0,
            tool,
            tip_mm: Point3::new(1.0, 2.0, 150.0),
            velocity_mm_s: Some(Vector3::new(0.1, 0.2, 0.3)),
            axis: None,
            tip_px: None,
            covariance_mm2: None,
            state: SampleState::Observed,
        }
    }

    fn tools() -> Vec<String> {
        vec!["left".into(), "right".into()]
    }

    fn read(rows: &[Sample]) -> Result<ImportedRows, String> {
        let mut read = ImportedRows::new(tools(), rows.len() as u64, MediaLimits::default())?;
        rows.chunks(2).try_for_each(|part| read.accept(part, MediaLimits::default()))?;
        Ok(read)
    }

    #[test]
    fn the_file_is_that_of_the_same_paths_encoded_at_once() {
        let rows = [row(0, 0), row(0, 1), row(3, 1), row(400, 0), row(401, 0)];
        let read = read(&rows).unwrap();
        assert_eq!((read.frames(), read.duration_s(), read.is_complete()), (4, 401.0 / 25.0, true));
        let none = || Vec::new();
        let paths = SessionPaths {
            tools: tools(),
            frame_times_s: Vec::new(),
            raw: none(),
            filtered: none(),
            smoothed: rows.to_vec(),
            tracking: None,
            cuts: Vec::new(),
        };
        assert_eq!(read.into_file(), (paths.to_bytes().unwrap(), tools()));
    }

    #[test]
    fn rows_and_tables_that_no_tracker_writes_are_refused() {
        let changed = |change: fn(&mut Sample)| {
            let mut rows = [row(0, 0), row(1, 0), row(2, 0)];
            change(&mut rows[1]);
            read(&rows)
        };
        assert!(changed(|_| ()).is_ok());
        let changes: [fn(&mut Sample); 8] = [
            |row| row.tool = 2,
            |row| row.frame = 0,
            |row| row.frame = u64::MAX,
            |row| row.time_s = 0.0,
            |row| row.time_s = f64::NAN,
            |row| row.time_s = 1e9,
            |row| row.tip_mm.x = f64::INFINITY,
            |row| row.velocity_mm_s = Some(Vector3::new(1e300, 0.0, 0.0)),
        ];
        for (index, change) in changes.into_iter().enumerate() {
            assert!(changed(change).is_err(), "change {index}");
        }
        let limits = MediaLimits::default();
        let too_many: Vec<String> = (0..=MAX_IMPORTED_TOOLS).map(|n| format!("tool {n}")).collect();
        for tools in [vec![], too_many, vec!["left".into(), "left".into()], vec!["=1".into()], vec!["a\n".into()]] {
            assert!(ImportedRows::new(tools.clone(), 1, limits).is_err(), "{tools:?}");
        }
        assert!(ImportedRows::new(tools(), u64::MAX, limits).is_err());
        let mut short = ImportedRows::new(tools(), 1, limits).unwrap();
        assert!(short.accept(&[row(0, 0), row(1, 0)], limits).is_err(), "more rows than announced");
    }
}
