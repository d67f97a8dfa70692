//! Enrolling many trainees at once: the rows of a list are each checked on their own, so that all problems are reported
//! together.

use std::collections::HashMap;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::text::{Code, Invalid, Login, Name};
use super::trainee::{Handedness, Level};

/// Maximum number of rows in one list.
pub const MAX_ROWS: usize = 500;

/// A row of a list as sent. Empty text counts as absent.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EnrolmentRow {
    /// The trainee's name.
    pub name: String,
    /// Short unique name; derived from the name if empty.
    pub code: Option<String>,
    /// `novice`, `intermediate` or `expert`.
    pub level: Option<String>,
    /// `left`, `right` or `both`.
    pub handedness: Option<String>,
    /// The name of the group to join.
    pub group: Option<String>,
    /// The login of the account, if one is made; derived from the code if empty.
    pub login: Option<String>,
}

/// A trainee to enrol, as read from a row.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedEnrolment {
    /// The trainee's name.
    pub name: Name,
    /// The code, if the row has one.
    pub code: Option<Code>,
    /// Experience.
    pub level: Option<Level>,
    /// Preferred hand.
    pub handedness: Option<Handedness>,
    /// The name of the group.
    pub group: Option<String>,
    /// The login, if the row has one.
    pub login: Option<Login>,
}

/// A problem with a field of a row.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct RowProblem {
    /// Row number, from 1.
    pub row: usize,
    /// The field.
    pub field: &'static str,
    /// What is wrong, and what is expected.
    pub message: String,
}

/// What can be read of a row. Its code and its group are looked up even if another field is wrong: all problems of a list
/// are reported at once.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadRow {
    /// The code, if it is given and can be used.
    pub code: Option<Code>,
    /// The name of the group, if it is given.
    pub group: Option<String>,
    /// The login, if it is given and can be used.
    pub login: Option<Login>,
    /// The trainee; `None` if a field cannot be used.
    pub trainee: Option<CheckedEnrolment>,
}

/// The rows of a list as read, with the problems that they show by themselves.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadRows {
    /// The rows, in their order.
    pub rows: Vec<ReadRow>,
    /// The problems, by row.
    pub problems: Vec<RowProblem>,
}

/// Reads the rows of a list.
pub fn parse_rows(rows: &[EnrolmentRow]) -> ReadRows {
    let mut problems = Vec::new();
    let read: Vec<ReadRow> =
        rows.iter().enumerate().map(|(index, row)| parse_row(index + 1, row, &mut problems)).collect();
    problems.extend(repeated(&read, "code", |row| row.code.as_ref().map(Code::as_str)));
    problems.extend(repeated(&read, "login", |row| row.login.as_ref().map(Login::as_str)));
    problems.sort_by_key(|problem| problem.row);
    ReadRows { rows: read, problems }
}

/// The rows whose value another row has already.
fn repeated(rows: &[ReadRow], field: &'static str, value_of: fn(&ReadRow) -> Option<&str>) -> Vec<RowProblem> {
    let (mut met, mut problems) = (HashMap::new(), Vec::new());
    for (index, row) in rows.iter().enumerate() {
        let Some(value) = value_of(row) else { continue };
        if let Some(first) = met.insert(value, index + 1) {
            let why = format!("`{value}` is already used in row {first}; give each trainee a {field} of their own");
            problems.push(row_problem(index + 1, field, why));
        }
    }
    problems
}

/// Creates the problem of a row.
pub fn row_problem(row: usize, field: &'static str, message: impl Into<String>) -> RowProblem {
    RowProblem { row, field, message: message.into() }
}

fn parse_row(row: usize, of: &EnrolmentRow, problems: &mut Vec<RowProblem>) -> ReadRow {
    let before = problems.len();
    let name = parse_field::<Name>(row, "name", Some(of.name.trim()), problems);
    let code: Option<Code> = parse_field(row, "code", non_empty(&of.code), problems);
    let level = parse_field(row, "level", non_empty(&of.level).map(str::to_lowercase).as_deref(), problems);
    let handedness =
        parse_field(row, "handedness", non_empty(&of.handedness).map(str::to_lowercase).as_deref(), problems);
    let group = non_empty(&of.group).map(str::to_owned);
    let login: Option<Login> = parse_field(row, "login", non_empty(&of.login), problems);
    let name = name.filter(|_| problems.len() == before);
    let trainee = name.map(|name| {
        let (code, group, login) = (code.clone(), group.clone(), login.clone());
        CheckedEnrolment { name, code, level, handedness, group, login }
    });
    ReadRow { code, group, login, trainee }
}

fn non_empty(text: &Option<String>) -> Option<&str> {
    text.as_deref().map(str::trim).filter(|text| !text.is_empty())
}

fn parse_field<T: FromStr<Err = Invalid>>(
    row: usize,
    field: &'static str,
    text: Option<&str>,
    problems: &mut Vec<RowProblem>,
) -> Option<T> {
    match text.map(str::parse::<T>) {
        Some(Err(invalid)) => {
            problems.push(row_problem(row, field, invalid.why));
            None
        }
        Some(Ok(value)) => Some(value),
        None => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(fields: [&str; 5]) -> EnrolmentRow {
        let [name, code, level, handedness, group] = fields.map(str::to_owned);
        let (code, level, handedness, group) = (Some(code), Some(level), Some(handedness), Some(group));
        EnrolmentRow { name, code, level, handedness, group, login: None }
    }

    /// All trainees, or all problems.
    fn read(rows: &[EnrolmentRow]) -> Result<Vec<CheckedEnrolment>, Vec<RowProblem>> {
        let ReadRows { rows, problems } = parse_rows(rows);
        if problems.is_empty() { Ok(rows.into_iter().filter_map(|row| row.trainee).collect()) } else { Err(problems) }
    }

    #[test]
    fn a_row_is_trimmed_and_read_without_regard_to_case() {
        let read = read(&[row([" Ana Lopez ", "", "Novice", "LEFT", " Group one "]), row(["Ben", "b-1", "", "", ""])]);
        let [ana, ben] = <[CheckedEnrolment; 2]>::try_from(read.unwrap()).unwrap();
        assert_eq!((ana.name.as_str(), ana.code, ana.level), ("Ana Lopez", None, Some(Level::Novice)));
        assert_eq!((ana.handedness, ana.group.as_deref()), (Some(Handedness::Left), Some("Group one")));
        assert_eq!((ben.code.unwrap().as_str(), ben.level, ben.group), ("b-1", None, None));
    }

    #[test]
    fn all_problems_are_reported_together_by_row() {
        let rows = [
            row(["", "a b", "beginner", "", ""]),
            row(["Ana", "ana", "", "", ""]),
            row(["Ann", "ana", "", "third", ""]),
        ];
        let problems = read(&rows).unwrap_err();
        let found: Vec<(usize, &str)> = problems.iter().map(|problem| (problem.row, problem.field)).collect();
        assert_eq!(found, [(1, "name"), (1, "code"), (1, "level"), (3, "handedness"), (3, "code")]);
        let twice = read(&[row(["Ana", "ana", "", "", ""]), row(["Ann", "ana", "", "", ""])]).unwrap_err();
        assert_eq!((twice.len(), twice[0].row, twice[0].field), (1, 2, "code"));
        assert!(twice[0].message.contains("row 1"), "{twice:?}");
    }

    #[test]
    fn a_login_is_read_as_at_sign_in_and_belongs_to_one_row() {
        let of = |login: &str| EnrolmentRow { login: Some(login.to_owned()), ..row(["Ana", "", "", "", ""]) };
        let known = read(&[of(" Ana@Clinic.example ")]).unwrap();
        assert_eq!(known[0].login.as_ref().unwrap().as_str(), "ana@clinic.example");
        let problems = read(&[of("ana"), of("a na"), of("ANA")]).unwrap_err();
        let found: Vec<(usize, &str)> = problems.iter().map(|problem| (problem.row, problem.field)).collect();
        assert_eq!(found, [(2, "login"), (3, "login")]);
    }
}
