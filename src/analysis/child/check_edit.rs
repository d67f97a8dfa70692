//! Checks a new edit against a session's stored path, and clips its span to the recording.

use serde::{Deserialize, Serialize};

use super::limits::{MAX_TEXT_CHARS, set_once};
use super::score::read_paths;
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::analysis::edits::check_edit;
use crate::domain::edit::{EditChange, EditsInForce};
use crate::domain::text::Invalid;
use crate::media::MediaLimits;

/// The fields of a request that a refusal may name.
const FIELDS: [&str; 3] = ["from_s", "to_s", "tools"];

/// The edit to check. Input: the stored path.
#[derive(Debug, Serialize, Deserialize)]
pub struct CheckEditWork {
    /// The edits in force.
    pub in_force: EditsInForce,
    /// The new edit.
    pub change: EditChange,
}

/// The outcome of the check.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub enum EditCheckRecord {
    /// The edit as it can be applied.
    Accepted(EditChange),
    /// Why it cannot be applied: the field of the request, and what is wrong with it.
    Refused {
        /// The field's name.
        field: String,
        /// The reason.
        why: String,
    },
}

/// What is kept of the check.
#[derive(Debug, Default)]
pub struct EditCheckOutput {
    /// False if the program version that tracked the session did not store the tracker's summary.
    pub has_summary: Option<bool>,
    /// The edit as it can be applied, or why it cannot.
    pub checked: Option<Result<EditChange, Invalid>>,
}

impl ChildTask for CheckEditWork {
    /// Whether the path has the tracker's summary, and the outcome.
    type Record = (bool, EditCheckRecord);
    type Output = EditCheckOutput;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let paths = read_paths(inputs.first()?)?;
        let outcome = match check_edit(&paths, &self.in_force, self.change) {
            Ok(change) => EditCheckRecord::Accepted(change),
            Err(Invalid { what, why }) => EditCheckRecord::Refused { field: what.to_owned(), why },
        };
        Ok(reporter.record(WorkRecord::CheckEdit((paths.tracking.is_some(), outcome)))?)
    }

    fn accept(
        &self,
        (has_summary, outcome): (bool, EditCheckRecord),
        output: &mut EditCheckOutput,
        _: MediaLimits,
    ) -> Result<ChildEvent, String> {
        let checked = match outcome {
            EditCheckRecord::Accepted(change) if is_part_of(&change, &self.change) => Ok(change),
            EditCheckRecord::Accepted(_) => return Err("another edit than the requested one".into()),
            EditCheckRecord::Refused { field, why } => {
                let field = FIELDS.into_iter().find(|known| *known == field).ok_or("a refusal of an unknown field")?;
                if why.chars().count() > MAX_TEXT_CHARS[2] || why.chars().any(char::is_control) {
                    return Err("an impossible reason of a refusal".into());
                }
                Err(Invalid::new(field, why))
            }
        };
        output.has_summary = Some(has_summary);
        set_once(&mut output.checked, checked, "check of an edit")?;
        Ok(ChildEvent::Nothing)
    }
}

/// True if the change is the requested one, or the part of its span that lies in the recording.
fn is_part_of(change: &EditChange, requested: &EditChange) -> bool {
    let is_within = |[from, to]: [f64; 2], [first, last]: [f64; 2]| first <= from && from <= to && to <= last;
    match (change, requested) {
        (EditChange::Trim(span), EditChange::Trim(whole)) => is_within(*span, *whole),
        (EditChange::Swap(tools, span), EditChange::Swap(named, whole)) => tools == named && is_within(*span, *whole),
        _ => change == requested,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::output_validator::validate_records;

    fn pair(names: [&str; 2]) -> [String; 2] {
        names.map(str::to_owned)
    }

    fn validate(change: EditChange, records: Vec<EditCheckRecord>) -> Result<EditCheckOutput, String> {
        let work = ChildWork::CheckEdit(CheckEditWork { in_force: EditsInForce::default(), change });
        let records = records.into_iter().map(|record| WorkRecord::CheckEdit((true, record))).collect();
        validate_records(&work, records).map(|output| output.edit_check)
    }

    #[test]
    fn only_the_requested_edit_or_a_part_of_its_span_is_accepted() {
        let swap = |names, span| EditChange::Swap(pair(names), span);
        let (trim, swapped) = (EditChange::Trim([1.0, 9.0]), swap(["a", "b"], [1.0, 9.0]));
        for (requested, honest) in
            [(&trim, trim.clone()), (&trim, EditChange::Trim([1.0, 4.0])), (&swapped, swap(["a", "b"], [2.0, 9.0]))]
        {
            let output = validate(requested.clone(), vec![EditCheckRecord::Accepted(honest.clone())]).unwrap();
            assert_eq!(output.checked, Some(Ok(honest)));
        }
        for (requested, forged) in [
            (&trim, EditChange::Trim([0.0, 9.0])),
            (&trim, EditChange::Trim([1.0, f64::NAN])),
            (&trim, EditChange::Trim([9.0, 1.0])),
            (&trim, EditChange::OtherBox),
            (&trim, swapped.clone()),
            (&swapped, swap(["b", "a"], [1.0, 9.0])),
            (&swapped, swap(["a", "b"], [1.0, 10.0])),
        ] {
            let said = format!("{forged:?}");
            assert!(validate(requested.clone(), vec![EditCheckRecord::Accepted(forged)]).is_err(), "{said}");
        }
    }

    #[test]
    fn a_refusal_names_a_field_of_the_request_and_comes_once() {
        let refused = |field: &str, why: String| EditCheckRecord::Refused { field: field.to_owned(), why };
        let trim = || EditChange::Trim([1.0, 9.0]);
        let honest = validate(trim(), vec![refused("to_s", "would leave too little".into())]).unwrap();
        assert_eq!(honest.checked, Some(Err(Invalid::new("to_s", "would leave too little"))));
        for records in [
            vec![refused("password", "is wrong".into())],
            vec![refused("to_s", "a\x1b[31m".into())],
            vec![refused("to_s", "x".repeat(5000))],
            vec![refused("to_s", "a".into()), refused("to_s", "a".into())],
        ] {
            let said = format!("{records:?}").chars().take(80).collect::<String>();
            assert!(validate(trim(), records).is_err(), "{said}");
        }
    }
}
