//! The plan: what happens to each file, and every problem, before anything is sent.

use std::collections::BTreeMap;

use jiff::Timestamp;
use jiff::tz::TimeZone;
use serde_json::Value;

use super::directory::Directory;
use super::files::FoundFile;
use crate::domain::blob::BlobHash;
use crate::intake::folder::{KnownThing, MapRow, MatchKind, RecordedAt, RecordingMap, UNKNOWN_TIME, find};
use crate::time::from_rfc3339;

/// Difference between two times of one recording that is worth a note, ms.
const NOTABLE_MS: i64 = 60_000;

/// Whose recording it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingTarget {
    pub trainee: KnownThing,
    pub task: KnownThing,
    pub in_box: KnownThing,
}

/// What happens to a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is sent.
    Send,
    /// The service has it: its session, and what differs there.
    There { session: String, but: Option<String> },
    /// It is the same recording as another file, which is sent.
    Copy(String),
}

/// A recording with its person, task, box and time.
#[derive(Clone, Debug)]
pub struct PlannedRecording {
    pub file: FoundFile,
    pub target: RecordingTarget,
    /// `None`: not known.
    pub recorded_at: Option<RecordedAt>,
    pub hash: BlobHash,
    pub fate: Fate,
}

/// A recording whose row was found, before its content is looked at.
#[derive(Clone, Debug)]
pub struct MappedFile {
    pub file: FoundFile,
    pub target: RecordingTarget,
    /// As the map or a name says; the file itself is asked last.
    pub recorded_at: WhenRecorded,
}

/// What is known of a recording's time without opening it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenRecorded {
    Known(RecordedAt),
    /// The map says that it is not known.
    Unknown,
    /// Only the file itself can say.
    AskFile,
}

/// The files as the map assigns them.
#[derive(Debug, Default)]
pub struct MappedFiles {
    pub files: Vec<MappedFile>,
    /// Files that are no recordings.
    pub left_out: Vec<String>,
    pub problems: Vec<String>,
}

/// Defaults of the command line for what the map does not say.
#[derive(Clone, Debug, Default)]
pub struct MapDefaults {
    pub task: Option<String>,
    pub in_box: Option<String>,
}

/// Assigns the files to the rows of the map.
pub fn assign(
    files: Vec<FoundFile>,
    map: &RecordingMap,
    directory: &Directory,
    defaults: &MapDefaults,
    zone: &TimeZone,
) -> MappedFiles {
    let mut mapped = MappedFiles::default();
    let targets: Vec<Option<RecordingTarget>> =
        map.rows.iter().map(|row| target(row, directory, defaults, &mut mapped.problems)).collect();
    let times: Vec<Option<Option<WhenRecorded>>> =
        map.rows.iter().map(|row| stated_time(row, zone, &mut mapped.problems)).collect();
    let mut is_used = vec![false; map.rows.len()];
    for file in files {
        let rows = map.rows_for(&file.path);
        rows.iter().for_each(|(index, _)| is_used[*index] = true);
        if !rows.iter().any(|(_, kind)| *kind == MatchKind::Exact) && !file.is_recording() {
            mapped.left_out.push(file.path);
            continue;
        }
        match rows[..] {
            [] => mapped.problems.push(format!("{}: no row of the map is for this recording", file.path)),
            [(index, _)] => {
                let (Some(target), Some(time)) = (&targets[index], times[index]) else { continue };
                let named = || RecordedAt::of_path(&file.path, zone).map_or(WhenRecorded::AskFile, WhenRecorded::Known);
                let recorded_at = time.unwrap_or_else(named);
                mapped.files.push(MappedFile { target: target.clone(), recorded_at, file });
            }
            _ => {
                let lines: Vec<String> = rows.iter().map(|(index, _)| map.rows[*index].line.to_string()).collect();
                mapped.problems.push(format!("{}: several rows are for it: lines {}", file.path, lines.join(", ")));
            }
        }
    }
    for (row, _) in map.rows.iter().zip(is_used).filter(|(_, is_used)| !is_used) {
        mapped.problems.push(format!("line {}: no file of the folder matches `{}`", row.line, row.file));
    }
    mapped
}

/// The trainee, task and box that a row names; problems are added.
fn target(
    row: &MapRow,
    directory: &Directory,
    defaults: &MapDefaults,
    problems: &mut Vec<String>,
) -> Option<RecordingTarget> {
    let mut look_up = |list: &[KnownThing], noun: &str, text: Option<&String>, way: &str| {
        let found = match text {
            Some(text) => find(list, noun, text),
            None => Err(format!("`{noun}` is empty{way}")),
        };
        found.cloned().map_err(|why| problems.push(format!("line {}: {why}", row.line))).ok()
    };
    let trainee = look_up(&directory.trainees, "trainee", row.trainee.as_ref(), "");
    let task = row.task.as_ref().or(defaults.task.as_ref());
    let task = look_up(&directory.tasks, "task", task, "; fill it in, or give --task for all rows without one");
    let in_box = row.in_box.as_ref().or(defaults.in_box.as_ref());
    let in_box = look_up(&directory.boxes, "box", in_box, "; fill it in, or give --box for all rows without one");
    Some(RecordingTarget { trainee: trainee?, task: task?, in_box: in_box? })
}

/// The time that a row states: `Some(None)` if it states none, `None` if it cannot be read.
fn stated_time(row: &MapRow, zone: &TimeZone, problems: &mut Vec<String>) -> Option<Option<WhenRecorded>> {
    match row.recorded_at.as_deref() {
        None => Some(None),
        Some(UNKNOWN_TIME) => Some(Some(WhenRecorded::Unknown)),
        Some(text) => match RecordedAt::of_map(text, zone) {
            Some(found) => Some(Some(WhenRecorded::Known(found))),
            None => {
                problems.push(format!(
                    "line {}: `recorded_at` is `{text}`; expected 2024-03-11, 2024-03-11 14:05, \
                     2024-03-11T14:05:00Z or `{UNKNOWN_TIME}`",
                    row.line
                ));
                None
            }
        },
    }
}

/// Finds files with the same content: copies for the same target are left out, others are problems.
pub fn mark_copies(recordings: &mut [PlannedRecording], problems: &mut Vec<String>) {
    let mut first: BTreeMap<BlobHash, usize> = BTreeMap::new();
    for index in 0..recordings.len() {
        let Some(&before) = first.get(&recordings[index].hash) else {
            first.insert(recordings[index].hash, index);
            continue;
        };
        let (one, other) = (recordings[before].file.path.clone(), recordings[index].file.path.clone());
        if recordings[before].target == recordings[index].target {
            recordings[index].fate = Fate::Copy(one);
        } else {
            problems.push(format!(
                "{other}: it is the same recording as {one}, but the map gives it another trainee, task or box"
            ));
        }
    }
}

/// Marks a recording that the service has. `sessions`: its sessions with this content.
pub fn mark_there(recording: &mut PlannedRecording, sessions: &[Value], problems: &mut Vec<String>) {
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let target = &recording.target;
    let Some(first) = sessions.first() else { return };
    let Some(own) = sessions.iter().find(|session| session["trainee"]["id"] == target.trainee.id.as_str()) else {
        problems.push(format!(
            "{}: the service has this recording under {} (session {}); if that is wrong, move the session there",
            recording.file.path,
            text(&first["trainee"]["name"]),
            text(&first["id"])
        ));
        return;
    };
    let mut differences = Vec::new();
    for (noun, key, wanted) in [("task", "task", &target.task), ("box", "box", &target.in_box)] {
        if own[key]["id"] != wanted.id.as_str() {
            differences.push(format!("{noun} {}", text(&own[key]["name"])));
        }
    }
    let there_ms = own["recorded_at"].as_str().and_then(from_rfc3339);
    if let (Some(there_ms), Some(planned)) = (there_ms, recording.recorded_at)
        && (there_ms - planned.at_ms).abs() > NOTABLE_MS
    {
        differences.push(format!("recorded {}", shown_time(there_ms, &TimeZone::UTC)));
    }
    let but = (!differences.is_empty()).then(|| differences.join(", "));
    recording.fate = Fate::There { session: text(&own["id"]), but };
}

/// A time for people.
pub fn shown_time(at_ms: i64, zone: &TimeZone) -> String {
    let at = Timestamp::from_millisecond(at_ms).unwrap_or(Timestamp::UNIX_EPOCH);
    at.to_zoned(zone.clone()).strftime("%Y-%m-%d %H:%M").to_string()
}
