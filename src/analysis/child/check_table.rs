//! Checks whether a table of another tracker can be imported.

use serde::{Deserialize, Serialize};

use super::limits::{MAX_TEXT_CHARS, set_once};
use super::score::{MAX_IMPORTED_TOOLS, read_whole};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::domain::files::trajectory::{ImportLimits, read_import};
use crate::media::MediaLimits;

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
    /// Why the table cannot be imported, if it cannot.
    type Record = Result<(), String>;
    type Output = Option<Result<(), String>>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let MediaLimits { duration_s, frames, .. } = inputs.limits;
        let limits = ImportLimits { rows: self.max_rows, tools: MAX_IMPORTED_TOOLS, frames, duration_s };
        let table = read_whole(inputs.first()?, self.max_bytes)?;
        let checked = read_import(&table, &self.known_tools, &limits);
        let checked = checked.map(drop).map_err(|problem| problem.to_string());
        Ok(reporter.record(WorkRecord::CheckTable(checked))?)
    }

    fn accept(
        &self,
        checked: Result<(), String>,
        output: &mut Option<Result<(), String>>,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::output_validator::validate_records;

    fn validate(records: Vec<Result<(), String>>) -> Result<Option<Result<(), String>>, String> {
        let work = ChildWork::CheckTable(CheckTableWork { known_tools: vec![], max_bytes: 100, max_rows: 10 });
        let records = records.into_iter().map(WorkRecord::CheckTable).collect();
        validate_records(&work, records).map(|output| output.table_check)
    }

    #[test]
    fn a_table_is_judged_once_and_with_a_text_that_is_safe_to_show() {
        assert_eq!(validate(vec![Ok(())]), Ok(Some(Ok(()))));
        assert_eq!(validate(vec![Err("line 2:\x1b[31m".into())]), Ok(Some(Err("line 2: [31m".into()))));
        assert!(validate(vec![Err("x".repeat(5000))]).is_err());
        assert!(validate(vec![Err("line 2".into()), Ok(())]).is_err());
    }
}
