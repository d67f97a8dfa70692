//! The file of a list: its lines, and until when it is complete.
//!
//! A line is an erasure ([`Erasure`]) or a [`ListMark`]. Lines are only appended: services may share a folder of backups.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::str::FromStr;

use crate::domain::erasure::{ErasedKind, Erasure};
use crate::domain::text::Invalid;
use crate::ids::InstallationId;
use crate::time::{from_rfc3339, to_rfc3339};
use crate::upkeep::{UpkeepError, UpkeepResult};

/// First word of a mark whose service keeps the list.
const COMPLETE: &str = "complete";
/// First word of a mark whose service does not keep the list any longer.
const ENDED: &str = "ended";

/// Says that a list holds all erasures of an installation until a time. As text, a line: `complete`, id and time, or
/// `ended`, id, time and the folder of the list that continues it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListMark {
    /// The installation.
    pub installation: InstallationId,
    /// Until when, epoch ms.
    pub at_ms: i64,
    /// Why the service does not keep the list any longer; `None` if it does.
    pub end: Option<ListEnd>,
}

/// The end of a list, since the settings named another folder for backups.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListEnd {
    /// The folder of the list that continues it; `None` if the settings named none.
    pub continued_in: Option<String>,
}

/// Until when the erasures of a list are known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KnownUntil {
    /// Until when, epoch ms.
    pub at_ms: i64,
    /// Why not longer; `None` if the list did not end.
    pub end: Option<ListEnd>,
}

/// A line of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ListLine {
    /// An erasure.
    Erasure(Erasure),
    /// A mark.
    Mark(ListMark),
}

impl fmt::Display for ListLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ListLine::Erasure(erasure) => erasure.fmt(f),
            ListLine::Mark(ListMark { installation, at_ms, end }) => {
                let word = if end.is_some() { ENDED } else { COMPLETE };
                write!(f, "{word} {installation} {}", to_rfc3339(*at_ms))?;
                match end.as_ref().and_then(|end| end.continued_in.as_ref()) {
                    Some(folder) => write!(f, " {}", folder.replace('\n', "?")),
                    None => Ok(()),
                }
            }
        }
    }
}

impl FromStr for ListLine {
    type Err = Invalid;

    fn from_str(line: &str) -> Result<Self, Invalid> {
        let mut parts = line.splitn(4, ' ');
        let (word, id, at, folder) = (parts.next(), parts.next(), parts.next(), parts.next());
        if !matches!((word, folder), (Some(COMPLETE), None) | (Some(ENDED), _)) {
            return line.parse().map(ListLine::Erasure);
        }
        let end = (word == Some(ENDED)).then(|| ListEnd { continued_in: folder.map(str::to_owned) });
        let mark = id.and_then(|id| id.parse().ok()).zip(at.and_then(from_rfc3339));
        let mark = mark.map(|(installation, at_ms)| ListLine::Mark(ListMark { installation, at_ms, end }));
        mark.ok_or_else(|| Invalid::new("mark of a list", "expected id and time"))
    }
}

/// The content of a list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ListContent {
    /// Its lines.
    pub lines: Vec<ListLine>,
    /// Number of the first line that cannot be read, from 1; `lines` lacks all of those.
    pub damaged: Option<usize>,
}

impl ListContent {
    /// Reads a list; an empty one if there is no such file.
    pub fn read(path: &Path) -> UpkeepResult<Self> {
        let bytes = match fs::read(path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(list_error(path)(error)),
        };
        // A power cut can leave a part of the last line. It was not acknowledged, and is written again.
        let whole = String::from_utf8_lossy(&bytes[..whole_lines(&bytes)]);
        let mut content = Self::default();
        for (index, line) in whole.lines().enumerate() {
            match line.parse() {
                Ok(line) => content.lines.push(line),
                Err(Invalid { .. }) => content.damaged = content.damaged.or(Some(index + 1)),
            }
        }
        Ok(content)
    }

    /// The erasures, in order.
    pub fn erasures(&self) -> impl Iterator<Item = &Erasure> {
        self.lines.iter().filter_map(|line| match line {
            ListLine::Erasure(erasure) => Some(erasure),
            ListLine::Mark(_) => None,
        })
    }

    /// The last mark of each installation.
    pub fn marks(&self) -> BTreeMap<InstallationId, &ListMark> {
        let marks = self.lines.iter().filter_map(|line| match line {
            ListLine::Mark(mark) => Some((mark.installation, mark)),
            ListLine::Erasure(_) => None,
        });
        marks.collect()
    }

    /// Until when the list is complete for the backups of an installation. If that is unknown, all installations count.
    /// A list without marks, from an earlier version, is known until its last erasure. `None`: the list says nothing.
    pub fn known_until(&self, of: Option<InstallationId>) -> Option<KnownUntil> {
        let marks = self.marks();
        if marks.is_empty() {
            let past = self.erasures().filter(|erasure| erasure.kind != ErasedKind::Pending);
            return past.map(|erasure| KnownUntil { at_ms: erasure.at_ms, end: None }).max_by_key(|known| known.at_ms);
        }
        let earliest = || marks.values().min_by_key(|mark| mark.at_ms);
        let mark = of.map_or_else(earliest, |own| marks.get(&own));
        mark.map(|mark| KnownUntil { at_ms: mark.at_ms, end: mark.end.clone() })
    }
}

/// Appends lines; durable when this returns.
pub fn append(path: &Path, lines: &[ListLine]) -> UpkeepResult<()> {
    let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
    let write = || {
        cut_part_of_line(path)?;
        let mut file = OpenOptions::new().append(true).create(true).mode(0o600).open(path)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        File::open(path.parent().unwrap_or(path))?.sync_all()
    };
    write().map_err(list_error(path))
}

/// Cuts off the part of a line that a power cut left.
fn cut_part_of_line(path: &Path) -> io::Result<()> {
    let bytes = match fs::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
    };
    let whole = whole_lines(&bytes);
    if whole < bytes.len() { OpenOptions::new().write(true).open(path)?.set_len(whole as u64) } else { Ok(()) }
}

/// Length of the lines that have an end, bytes.
fn whole_lines(bytes: &[u8]) -> usize {
    bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1)
}

/// A failure of this list.
pub fn list_error(path: &Path) -> impl Fn(io::Error) -> UpkeepError {
    let path = path.to_owned();
    move |error| UpkeepError::List { path: path.clone(), why: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_survive_their_text() {
        let id = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
        for line in [
            format!("trainee {id} 2026-11-28T02:30:00Z"),
            format!("complete {id} 2026-11-28T02:30:00Z"),
            format!("ended {id} 2026-11-28T02:30:00Z"),
            format!("ended {id} 2026-11-28T02:30:00Z /a folder/of backups"),
        ] {
            assert_eq!(line.parse::<ListLine>().unwrap().to_string(), line);
        }
        for damaged in ["complete", "complete x 2026-11-28T02:30:00Z", "ended", "\0\0\0", ""] {
            assert!(damaged.parse::<ListLine>().is_err(), "{damaged:?}");
        }
    }

    #[test]
    fn a_list_is_known_until_the_last_mark_of_the_installation() {
        let [own, other] = ["0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44", "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45"];
        let list = |lines: &[String]| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("erasures");
            fs::write(&path, lines.join("\n") + "\n").unwrap();
            ListContent::read(&path).unwrap()
        };
        let at_ms = |list: &ListContent, of: Option<&str>| {
            list.known_until(of.map(|id| id.parse().unwrap())).map(|known| to_rfc3339(known.at_ms))
        };
        let earlier = vec![
            format!("trainee {other} 2026-11-21T00:00:00Z"),
            format!("pending {other} 2026-11-29T00:00:00Z"), // the time when it is due
        ];
        assert_eq!(at_ms(&list(&earlier), Some(own)).unwrap(), "2026-11-21T00:00:00Z");
        assert_eq!(at_ms(&list(&[]), Some(own)), None);
        let shared = vec![
            format!("complete {own} 2026-11-22T00:00:00Z"),
            format!("complete {other} 2026-11-23T00:00:00Z"),
            format!("complete {own} 2026-11-24T00:00:00Z"),
        ];
        assert_eq!(at_ms(&list(&shared), Some(own)).unwrap(), "2026-11-24T00:00:00Z");
        assert_eq!(at_ms(&list(&shared), None).unwrap(), "2026-11-23T00:00:00Z", "the backup may be of either");
        assert_eq!(at_ms(&list(&shared[1..2]), Some(own)), None, "the list of another installation");
    }
}
