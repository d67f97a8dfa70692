//! What is in the watched folder: recordings, the list, and what cannot be taken. All of it blocks.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{Access, OFlags, access};

/// The folders that the service makes in the watched folder, and the list that people put there.
pub const TAKEN: &str = "taken";
pub const REFUSED: &str = "refused";
pub const LIST: &str = "people.csv";

/// Names of files that are taken for recordings. What they hold is found out before they are taken.
const EXTENSIONS: [&str; 18] = [
    "mp4", "m4v", "mov", "mkv", "webm", "avi", "ts", "mts", "m2ts", "mpg", "mpeg", "wmv", "asf", "flv", "3gp", "vob",
    "mxf", "ogv",
];
/// Folders inside each other that are read. More are a mistake, or a loop of mounts.
const MAX_DEPTH: usize = 8;
/// Recordings that are looked at in one round.
const MAX_FILES: usize = 10_000;

/// What makes a file the same as before: its length, its time of change and its number on the disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InboxStamp {
    pub bytes: u64,
    changed_ns: i128,
    number: u64,
}

/// A file of the folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InboxFile {
    /// Its path below the watched folder, with slashes.
    pub path: String,
    pub stamp: InboxStamp,
}

/// What a look into the folder found.
#[derive(Debug, Default)]
pub struct InboxScan {
    /// The recordings, by path.
    pub files: Vec<InboxFile>,
    /// The list, if there is one.
    pub list: Option<InboxFile>,
    /// What cannot be taken, each with what to do about it.
    pub obstacles: Vec<String>,
}

impl InboxStamp {
    pub fn of(facts: &fs::Metadata) -> Self {
        let changed_ns = i128::from(facts.mtime()) * 1_000_000_000 + i128::from(facts.mtime_nsec());
        Self { bytes: facts.len(), changed_ns, number: facts.ino() }
    }
}

/// Looks into the folder and its folders.
///
/// # Errors
/// The folder itself cannot be read.
pub fn scan(folder: &Path) -> io::Result<InboxScan> {
    let mut scan = InboxScan::default();
    let mut open = vec![(folder.to_owned(), String::new(), 0)];
    while let Some((place, path, depth)) = open.pop() {
        let entries = match fs::read_dir(&place) {
            Ok(entries) => entries,
            Err(error) if path.is_empty() => return Err(error),
            Err(error) => {
                scan.obstacles.push(format!(
                    "the folder `{path}` cannot be read ({error}): give the service's user the right to read it"
                ));
                continue;
            }
        };
        for entry in entries.flatten() {
            let Some(name) = entry.file_name().to_str().map(str::to_owned) else {
                scan.obstacles.push(format!("`{}` is not named in UTF-8: rename it", entry.path().display()));
                continue;
            };
            if name.starts_with('.') || path.is_empty() && (name == TAKEN || name == REFUSED) {
                continue;
            }
            let path = if path.is_empty() { name } else { format!("{path}/{name}") };
            if let Some(inner) = scan.note(&entry.path(), path, depth) {
                open.push((entry.path(), inner, depth + 1));
            }
        }
    }
    scan.files.sort_by(|one, other| one.path.cmp(&other.path));
    scan.files.truncate(MAX_FILES);
    Ok(scan)
}

impl InboxScan {
    /// Notes one entry; returns its path if it is a folder to be read.
    fn note(&mut self, place: &Path, path: String, depth: usize) -> Option<String> {
        let facts = fs::symlink_metadata(place).ok()?; // it may be gone already
        let kind = facts.file_type();
        if kind.is_dir() {
            if depth >= MAX_DEPTH {
                self.obstacles.push(format!("the folder `{path}` lies too deep: at most {MAX_DEPTH} folders are read"));
                return None;
            }
            return Some(path);
        }
        if path == LIST && kind.is_file() {
            self.list = Some(InboxFile { path, stamp: InboxStamp::of(&facts) });
        } else if !is_recording_name(&path) {
            // A list, a text, or a recording that another program still writes under another name.
        } else if kind.is_symlink() {
            self.obstacles.push(format!("`{path}` is a link, and links are not followed: put the file itself there"));
        } else if !kind.is_file() {
            self.obstacles.push(format!("`{path}` is no file, but a pipe, a socket or a device: remove it"));
        } else if facts.len() > 0 {
            self.files.push(InboxFile { path, stamp: InboxStamp::of(&facts) });
        }
        None
    }
}

fn is_recording_name(path: &str) -> bool {
    let extension = Path::new(path).extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    EXTENSIONS.contains(&extension.to_ascii_lowercase().as_str())
}

/// Opens a file for reading, without following a link or waiting for a pipe.
///
/// # Errors
/// It cannot be read, or is no file any more.
pub fn open_file(place: &Path) -> io::Result<(File, InboxStamp)> {
    let flags = i32::try_from((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits()).unwrap_or(0);
    let file = OpenOptions::new().read(true).custom_flags(flags).open(place)?;
    let facts = file.metadata()?;
    match facts.is_file() {
        true => Ok((file, InboxStamp::of(&facts))),
        false => Err(io::Error::other("it is no file")),
    }
}

/// True if files can be moved out of the folder of this file.
pub fn may_be_moved(place: &Path) -> bool {
    place.parent().is_some_and(|folder| access(folder, Access::WRITE_OK | Access::EXEC_OK).is_ok())
}

/// Moves a file below the folder `into`, under its own path; another name if that one is taken. Returns where it is.
///
/// # Errors
/// The file stays where it is.
pub fn move_into(folder: &Path, file: &InboxFile, into: &str) -> io::Result<Option<PathBuf>> {
    let from = folder.join(&file.path);
    if !is_unchanged(&from, file.stamp) {
        return Ok(None); // another file has its name now: it is looked at by itself
    }
    let wanted = folder.join(into).join(&file.path);
    let below = wanted.parent().unwrap_or(folder);
    fs::create_dir_all(below)?;
    let to = free_name(&wanted);
    fs::rename(&from, &to)?;
    sync_folder(below);
    from.parent().into_iter().for_each(sync_folder);
    Ok(Some(to))
}

/// Deletes a file that was taken, unless another has its name now.
///
/// # Errors
/// The file stays.
pub fn delete(folder: &Path, file: &InboxFile) -> io::Result<()> {
    let place = folder.join(&file.path);
    if is_unchanged(&place, file.stamp) { fs::remove_file(place) } else { Ok(()) }
}

fn is_unchanged(place: &Path, stamp: InboxStamp) -> bool {
    fs::symlink_metadata(place).is_ok_and(|facts| facts.is_file() && InboxStamp::of(&facts) == stamp)
}

/// The name itself, or the first of `name (2).mp4`, `name (3).mp4`, … that is free.
fn free_name(wanted: &Path) -> PathBuf {
    let stem = wanted.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let extension = wanted.extension().unwrap_or_default().to_string_lossy().into_owned();
    let numbered = (2_u32..).map(|number| wanted.with_file_name(format!("{stem} ({number}).{extension}")));
    let mut names = std::iter::once(wanted.to_owned()).chain(numbered);
    names.find(|name| fs::symlink_metadata(name).is_err()).unwrap_or_else(|| wanted.to_owned())
}

/// Best effort: some network shares cannot sync folders, and a lost move is repeated at the next start.
fn sync_folder(folder: &Path) {
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
}
