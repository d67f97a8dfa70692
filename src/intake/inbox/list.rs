//! The list `people.csv` in the watched folder: whose recordings are whose.

use std::fs;
use std::path::Path;

use jiff::tz::TimeZone;

use crate::ids::{BoxId, TaskId, TraineeId};
use crate::intake::folder::{KnownThing, MapRow, RecordedAt, RecordingMap, UNKNOWN_TIME, find};
use crate::store::{ProposableThing, ProposableThings};

/// Largest list that is read, bytes: about 50,000 rows.
const MAX_BYTES: u64 = 4 << 20;

/// The list, or why it cannot be used.
pub enum PeopleList {
    /// There is none.
    None,
    /// It is not used for any recording.
    Unusable(String),
    /// Its rows.
    Rows(RecordingMap),
}

/// What the list says about a recording.
#[derive(Debug, Default)]
pub struct Listed {
    /// Whose it is.
    pub trainee: Option<TraineeId>,
    pub task: Option<TaskId>,
    pub in_box: Option<BoxId>,
    /// When it was recorded; the inner `None`: the list says that it is not known.
    pub recorded_at_ms: Option<Option<i64>>,
    /// Why the recording cannot be assigned as the list says.
    pub remark: Option<String>,
}

impl PeopleList {
    /// Reads the list. Blocks.
    pub fn read(place: &Path, bytes: u64) -> Self {
        if bytes > MAX_BYTES {
            return Self::Unusable(format!("it has more than {} MiB", MAX_BYTES >> 20));
        }
        match fs::read(place) {
            Ok(bytes) => match RecordingMap::read(&bytes) {
                Ok(map) => Self::Rows(map),
                Err(problems) => Self::Unusable(problems.into_iter().take(3).collect::<Vec<_>>().join("; ")),
            },
            Err(error) => Self::Unusable(format!("it cannot be read ({error})")),
        }
    }

    /// What it says about the recording with this path. `None`: nothing.
    pub fn look_up(&self, path: &str, known: &ProposableThings) -> Option<Listed> {
        let remark = |why: String| Some(Listed { remark: Some(why), ..Listed::default() });
        let map = match self {
            Self::None => return None,
            Self::Unusable(why) => return remark(format!("The list people.csv cannot be used: {why}.")),
            Self::Rows(map) => map,
        };
        let rows: Vec<&MapRow> = map.rows_for(path).into_iter().map(|(index, _)| &map.rows[index]).collect();
        match rows[..] {
            [] => None,
            [row] => Some(resolve(row, known)),
            _ => {
                let lines: Vec<String> = rows.iter().map(|row| row.line.to_string()).collect();
                remark(format!("Several rows of people.csv are for this recording: lines {}.", lines.join(", ")))
            }
        }
    }
}

fn resolve(row: &MapRow, known: &ProposableThings) -> Listed {
    let mut problems = Vec::new();
    let mut look_up = |list: &[ProposableThing], noun: &str, text: Option<&String>| {
        let Some(text) = text else {
            problems.push(format!("`{noun}` is empty"));
            return None;
        };
        let list: Vec<KnownThing> = list
            .iter()
            .map(|one| KnownThing { id: one.id.clone(), code: one.code.clone(), name: one.name.clone() })
            .collect();
        let found = find(&list, noun, text).map(|found| found.id.clone());
        found.map_err(|why| problems.push(why)).ok()
    };
    let trainee = look_up(&known.trainees, "trainee", row.trainee.as_ref()).and_then(|id| id.parse().ok());
    let task = look_up(&known.tasks, "task", row.task.as_ref()).and_then(|id| id.parse().ok());
    let in_box = look_up(&known.boxes, "box", row.in_box.as_ref()).and_then(|id| id.parse().ok());
    let recorded_at_ms = match row.recorded_at.as_deref() {
        None => None,
        Some(UNKNOWN_TIME) => Some(None),
        Some(text) => match RecordedAt::of_map(text, &TimeZone::system()) {
            Some(found) => Some(Some(found.at_ms)),
            None => {
                problems.push(format!("`recorded_at` is `{text}`; expected 2024-03-11, 2024-03-11 14:05 or `unknown`"));
                None
            }
        },
    };
    let remark = (!problems.is_empty()).then(|| format!("Line {} of people.csv: {}.", row.line, problems.join("; ")));
    Listed { trainee, task, in_box, recorded_at_ms, remark }
}
