//! Checks whether a table of another tracker can be imported, and hashes its path.

use serde::{Deserialize, Serialize};

use super::limits::{MAX_TEXT_CHARS, set_once};
use super::score::{MAX_IMPORTED_TOOLS, read_whole};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::analysis::scoring::{ScoringError, paths_of_table};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::files::trajectory::{ImportLimits, read_import};
use crate::media::MediaLimits;
use crate::vision::trajectory::Trajectory;

/// The limits of a table. Input: the table.
#[derive(Debug, Serialize, Deserialize)]
pub struct CheckTableWork {
    /// Names of the box's tools; empty if they are unknown.
    pub known_tools: Vec<String>,
    /// Maximum length, bytes.
    pub max_bytes: u64,
    /// Maximum number of rows.
    pub max_rows: usize,
}

impl ChildTask for CheckTableWork {
    /// The hash of the path ([`hash_of_path`]), or why the table cannot be imported.
    type Record = Result<BlobHash, String>;
    type Output = Option<Result<BlobHash, String>>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let MediaLimits { duration_s, frames, .. } = inputs.limits;
        let limits = ImportLimits { rows: self.max_rows, tools: MAX_IMPORTED_TOOLS, frames, duration_s };
        let table = read_whole(inputs.first()?, self.max_bytes)?;
        let checked = match read_import(&table, &self.known_tools, &limits) {
            Ok(read) => Ok(hash_of_path(read.trajectory)?),
            Err(problem) => Err(problem.to_string()),
        };
        Ok(reporter.record(WorkRecord::CheckTable(checked))?)
    }

    fn accept(
        &self,
        checked: Result<BlobHash, String>,
        output: &mut Option<Result<BlobHash, String>>,
        _: MediaLimits,
    ) -> Result<ChildEvent, String> {
        let is_possible = |why: &String| why.chars().count() <= MAX_TEXT_CHARS[2];
        if !checked.as_ref().err().is_none_or(is_possible) {
            return Err("an impossible reason of a refusal".into());
        }
        // A refusal quotes the table, which may contain control characters.
        let shown = checked.map_err(|why| why.chars().map(|c| if c.is_control() { ' ' } else { c }).collect());
        set_once(output, shown, "check of a table")?;
        Ok(ChildEvent::Nothing)
    }
}

/// The hash of the file of paths that a session of this path stores. Tools are in alphabetical order, so tables with the
/// same rows in another order have the same hash.
fn hash_of_path(mut path: Trajectory) -> Result<BlobHash, ScoringError> {
    let mut order: Vec<usize> = (0..path.tools.len()).collect();
    order.sort_by_key(|&tool| &path.tools[tool]);
    let mut places = vec![0; order.len()];
    for (place, tool) in order.into_iter().enumerate() {
        places[tool] = place;
    }
    for row in &mut path.samples {
        row.tool = places[row.tool];
    }
    path.samples.sort_by_key(|row| (row.frame, row.tool));
    path.tools.sort_unstable();
    Ok(Blob::of(&paths_of_table(path).to_bytes()?).hash)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::output_validator::validate_records;

    type Checked = Result<BlobHash, String>;

    fn validate(records: Vec<Checked>) -> Result<Option<Checked>, String> {
        let work = ChildWork::CheckTable(CheckTableWork { known_tools: vec![], max_bytes: 100, max_rows: 10 });
        let records = records.into_iter().map(WorkRecord::CheckTable).collect();
        validate_records(&work, records).map(|output| output.table_check)
    }

    #[test]
    fn a_table_is_judged_once_and_with_a_text_that_is_safe_to_show() {
        let hash = BlobHash([7; 32]);
        assert_eq!(validate(vec![Ok(hash)]), Ok(Some(Ok(hash))));
        assert_eq!(validate(vec![Err("line 2:\x1b[31m".into())]), Ok(Some(Err("line 2: [31m".into()))));
        assert!(validate(vec![Err("x".repeat(5000))]).is_err());
        assert!(validate(vec![Err("line 2".into()), Ok(hash)]).is_err());
    }

    #[test]
    fn the_hash_is_of_the_path_and_not_of_the_tables_bytes() {
        let head = "frame,time_s,tool,x_mm,y_mm,z_mm";
        let rows = ["0,0,left,1,2,150", "0,0,right,3,4,150", "1,0.5,left,1,2,150", "1,0.5,right,3,4,150"];
        let limits = ImportLimits { rows: 10, tools: 2, frames: 10, duration_s: 10.0 };
        let read = |table: String| read_import(table.as_bytes(), &[], &limits).unwrap().trajectory;
        let hash = |table: String| hash_of_path(read(table)).unwrap();
        let plain = format!("{head}\n{}\n", rows.join("\n"));
        let stored = Blob::of(&paths_of_table(read(plain.clone())).to_bytes().unwrap()).hash;
        assert_eq!(hash(plain.clone()), stored, "the file that the session stores");
        let reversed: Vec<&str> = rows.into_iter().rev().collect();
        for same in [
            plain.replace('\n', "\r\n"),
            format!("{head}\n{}\n", reversed.join("\n")),
            plain.replace("0.5", "0.50"),
            plain.replace('\n', " \n"),
        ] {
            assert_eq!(hash(same.clone()), stored, "{same}");
        }
        for other in [plain.replace("3,4", "3,4.001"), plain.replace("right", "third"), plain.replace("0.5", "0.6")] {
            assert_ne!(hash(other.clone()), stored, "{other}");
        }
    }
}
