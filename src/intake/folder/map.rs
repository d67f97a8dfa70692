//! The map: a CSV table that says for each recording the trainee, the task, the box and the time.

use std::collections::BTreeMap;

use crate::domain::text::count_of;

/// The columns that a map may have.
const COLUMNS: [&str; 5] = ["file", "trainee", "task", "box", "recorded_at"];

/// A map as read.
#[derive(Debug, Default)]
pub struct RecordingMap {
    /// The rows, in their order.
    pub rows: Vec<MapRow>,
}

/// A row of the map. Empty cells are `None`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapRow {
    /// Its line in the file, from 1.
    pub line: u64,
    /// Which recordings it is for: a path, a name, a folder, or a pattern with `*` and `?`.
    pub file: String,
    /// Whose they are, by code or name.
    pub trainee: Option<String>,
    /// The task, by code or name.
    pub task: Option<String>,
    /// The box, by code or name.
    pub in_box: Option<String>,
    /// When they were recorded, or `unknown`.
    pub recorded_at: Option<String>,
}

/// How a row names a recording, the most exact way first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MatchKind {
    /// The path, or the name alone.
    Exact,
    /// A pattern.
    Pattern,
    /// A folder.
    Folder,
}

impl RecordingMap {
    /// Reads a map. Columns are separated by commas, semicolons or tabs, as in the head.
    ///
    /// # Errors
    /// All problems, each with its line.
    pub fn read(bytes: &[u8]) -> Result<Self, Vec<String>> {
        let text = std::str::from_utf8(bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)).map_err(|_| {
            vec!["it is not text in UTF-8: save it as “CSV UTF-8”, not as a workbook or plain “CSV”".to_owned()]
        })?;
        let head = text.lines().next().unwrap_or_default();
        let separator = [b',', b';', b'\t'].into_iter().max_by_key(|s| head.bytes().filter(|byte| byte == s).count());
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(separator.unwrap_or(b','))
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let head: Vec<String> = match reader.headers() {
            Ok(head) => head.iter().map(|name| name.to_lowercase().replace([' ', '-'], "_")).collect(),
            Err(error) => return Err(vec![error.to_string()]),
        };
        let mut problems = head_problems(&head);
        let mut rows = Vec::new();
        for record in reader.records() {
            match record {
                Ok(record) => match row_of(&head, &record, line_of(text, &record)) {
                    Ok(row) => rows.extend(row),
                    Err(why) => problems.push(why),
                },
                Err(error) => problems.push(error.to_string()),
            }
        }
        if rows.is_empty() && problems.is_empty() {
            problems.push("it has no rows: give each recording, or each folder, a row".to_owned());
        }
        if problems.is_empty() { Ok(Self { rows }) } else { Err(problems) }
    }

    /// The rows that are for a recording: those that name it in the most exact way. More than one is a mistake.
    pub fn rows_for(&self, path: &str) -> Vec<(usize, MatchKind)> {
        let all: Vec<(usize, MatchKind)> =
            self.rows.iter().enumerate().filter_map(|(index, row)| Some((index, row.matches(path)?))).collect();
        match all.iter().map(|(_, kind)| *kind).min() {
            Some(MatchKind::Exact) => all.into_iter().filter(|(_, kind)| *kind == MatchKind::Exact).collect(),
            _ => all,
        }
    }
}

fn head_problems(head: &[String]) -> Vec<String> {
    let expected = "expected the columns file, trainee, task, box, and optionally recorded_at";
    let mut problems = Vec::new();
    let mut met = BTreeMap::new();
    for name in head {
        if !COLUMNS.contains(&name.as_str()) {
            problems.push(format!("line 1: the column `{name}` is not known; {expected}"));
        }
        if met.insert(name, ()).is_some() {
            problems.push(format!("line 1: the column `{name}` is there twice"));
        }
    }
    for needed in ["file", "trainee"] {
        if !head.iter().any(|name| name == needed) {
            problems.push(format!("line 1: there is no column `{needed}`; {expected}"));
        }
    }
    problems
}

/// The line that a record begins on, from 1. The reader's own count is one too small after an end of line of two
/// characters.
fn line_of(text: &str, record: &csv::StringRecord) -> u64 {
    let begins = record.position().map_or(0, |position| position.byte()) as usize;
    let (before, rest) = text.as_bytes().split_at(begins.min(text.len()));
    let skipped = rest.iter().take_while(|byte| b"\r\n".contains(byte));
    1 + before.iter().chain(skipped).filter(|byte| **byte == b'\n').count() as u64
}

/// A row of the table; `None` for an empty line.
fn row_of(head: &[String], record: &csv::StringRecord, line: u64) -> Result<Option<MapRow>, String> {
    if record.iter().all(str::is_empty) {
        return Ok(None);
    }
    if record.len() > head.len() {
        let cells = count_of(record.len() as u64, "cell");
        let columns = count_of(head.len() as u64, "column");
        return Err(format!("line {line} has {cells}, but the head has {columns}"));
    }
    let cell = |name: &str| {
        let index = head.iter().position(|column| column == name)?;
        record.get(index).filter(|cell| !cell.is_empty()).map(str::to_owned)
    };
    let Some(file) = cell("file") else {
        return Err(format!("line {line}: `file` is empty; give the path of a recording, a folder or a pattern"));
    };
    let file = file.replace('\\', "/");
    let file = file.strip_prefix("./").unwrap_or(&file).to_owned();
    let row = MapRow {
        line,
        file,
        trainee: cell("trainee"),
        task: cell("task"),
        in_box: cell("box"),
        recorded_at: cell("recorded_at"),
    };
    Ok(Some(row))
}

impl MapRow {
    /// How the row names this recording, if it does. `path` is relative to the folder of the recordings.
    pub fn matches(&self, path: &str) -> Option<MatchKind> {
        let wanted = self.file.trim_end_matches('/');
        let name = path.rsplit('/').next().unwrap_or(path);
        let compared = if wanted.contains('/') { path } else { name };
        if !self.file.ends_with('/') && compared == wanted {
            return Some(MatchKind::Exact);
        }
        if wanted.contains(['*', '?']) {
            return matches_pattern(wanted.as_bytes(), compared.as_bytes()).then_some(MatchKind::Pattern);
        }
        let is_inside = path.strip_prefix(wanted).is_some_and(|rest| rest.starts_with('/'));
        (is_inside || wanted == ".").then_some(MatchKind::Folder)
    }
}

/// `*` matches any characters of one name, `**` also slashes, `?` one character.
fn matches_pattern(pattern: &[u8], text: &[u8]) -> bool {
    match (pattern, text) {
        ([], []) => true,
        ([b'*', b'*', rest @ ..], _) => (0..=text.len()).any(|skipped| matches_pattern(rest, &text[skipped..])),
        ([b'*', rest @ ..], _) => {
            let own = text.iter().position(|byte| *byte == b'/').unwrap_or(text.len());
            (0..=own).any(|skipped| matches_pattern(rest, &text[skipped..]))
        }
        ([b'?', rest @ ..], [first, after @ ..]) if *first != b'/' => matches_pattern(rest, after),
        ([wanted, rest @ ..], [first, after @ ..]) if wanted == first => matches_pattern(rest, after),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(file: &str) -> MapRow {
        MapRow { file: file.to_owned(), ..MapRow::default() }
    }

    #[test]
    fn a_table_of_a_spreadsheet_is_read_with_any_separator() {
        for text in [
            "file,trainee,task,box,recorded_at\nada/,ada,peg,box-1,\n\"b, c.mp4\",Bob Ray,,,2024-03-11\n",
            "\u{feff}File;Trainee;Task;Box;Recorded at\r\n.\\ada\\;ada;peg;box-1;\r\nb, c.mp4;Bob Ray;;;2024-03-11\r\n;;;;\r\n",
        ] {
            let rows = RecordingMap::read(text.as_bytes()).unwrap().rows;
            assert_eq!((rows.len(), rows[0].file.as_str(), rows[0].trainee.as_deref()), (2, "ada/", Some("ada")));
            assert_eq!((rows[1].file.as_str(), rows[1].line, rows[1].task.as_deref()), ("b, c.mp4", 3, None));
            assert_eq!(rows[1].recorded_at.as_deref(), Some("2024-03-11"));
        }
    }

    #[test]
    fn all_problems_of_a_table_are_reported_with_their_lines() {
        let problems = RecordingMap::read(b"file,person,file\n,ada,\nx,y,z,more\n").unwrap_err();
        let expected = [
            "`person` is not known",
            "`file` is there twice",
            "no column `trainee`",
            "line 2: `file`",
            "line 3 has 4 cells",
        ];
        assert_eq!(problems.len(), expected.len(), "{problems:#?}");
        for (problem, part) in problems.iter().zip(expected) {
            assert!(problem.contains(part), "{problem}");
        }
        assert!(RecordingMap::read(b"file,trainee\n").unwrap_err()[0].contains("no rows"));
        assert!(RecordingMap::read(b"PK\x03\x04\xff\xfe").unwrap_err()[0].contains("UTF-8"));
    }

    #[test]
    fn a_row_names_a_path_a_name_a_folder_or_a_pattern() {
        for (file, path, kind) in [
            ("ada/1.mp4", "ada/1.mp4", Some(MatchKind::Exact)),
            ("1.mp4", "ada/1.mp4", Some(MatchKind::Exact)),
            ("ada", "ada/2024/1.mp4", Some(MatchKind::Folder)),
            ("ada/", "ada/1.mp4", Some(MatchKind::Folder)),
            (".", "1.mp4", Some(MatchKind::Folder)),
            ("ad", "ada/1.mp4", None),
            ("2024", "ada/2024/1.mp4", None),
            ("ada_*.mp4", "x/ada_1.mp4", Some(MatchKind::Pattern)),
            ("ada/*.mp4", "ada/x/1.mp4", None),
            ("ada/**.mp4", "ada/x/1.mp4", Some(MatchKind::Pattern)),
            ("ada/?.mp4", "ada/1.mp4", Some(MatchKind::Pattern)),
            ("ada/?.mp4", "ada/12.mp4", None),
        ] {
            assert_eq!(row(file).matches(path), kind, "{file} {path}");
        }
    }

    #[test]
    fn an_exact_row_takes_a_recording_out_of_its_folder() {
        let map = RecordingMap { rows: vec![row("ada/"), row("ada/2.mp4"), row("*.mp4")] };
        assert_eq!(map.rows_for("ada/2.mp4"), [(1, MatchKind::Exact)]);
        assert_eq!(map.rows_for("ada/1.mp4").len(), 2, "a folder and a pattern: a person has to say which");
        assert_eq!(map.rows_for("bob/1.mkv"), []);
    }
}
