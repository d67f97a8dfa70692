//! The files of the folder: which are recordings, their hashes, and what they say of their time.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use anyhow::Context;
use sha2::{Digest, Sha256};

use crate::domain::blob::BlobHash;
use crate::intake::container::{HEAD_BYTES, media_type};
use crate::media::{MediaLimits, VideoFile};
use crate::time::millis;

/// The media type of what is no recording.
const UNKNOWN: &str = "application/octet-stream";

/// A file of the folder.
#[derive(Clone, Debug)]
pub struct FoundFile {
    /// Its path in the folder, with slashes.
    pub path: String,
    /// Where it is.
    pub place: PathBuf,
    /// Its length, bytes.
    pub bytes: u64,
    /// When it was last changed, epoch ms.
    pub modified_ms: i64,
}

/// What a recording says of itself.
pub struct FileFacts {
    /// When it was recorded, epoch ms, if the file says so.
    pub created_at_ms: Option<i64>,
}

/// All files of a folder and of its folders, by path. Names that begin with a dot are left out: they belong to the system.
///
/// # Errors
/// A folder cannot be read, or a name is not text.
pub fn find_files(folder: &Path) -> anyhow::Result<Vec<FoundFile>> {
    let (mut found, mut open) = (Vec::new(), vec![(folder.to_owned(), String::new())]);
    while let Some((place, path)) = open.pop() {
        let entries = fs::read_dir(&place).with_context(|| format!("reading the folder {}", place.display()))?;
        for entry in entries {
            let entry = entry.with_context(|| format!("reading the folder {}", place.display()))?;
            let name = entry.file_name();
            let name = name.to_str().with_context(|| format!("{} is not named in UTF-8", entry.path().display()))?;
            if name.starts_with('.') {
                continue;
            }
            let path = if path.is_empty() { name.to_owned() } else { format!("{path}/{name}") };
            let facts = fs::metadata(entry.path()).with_context(|| format!("reading {}", entry.path().display()))?;
            if facts.is_dir() {
                if !entry.file_type().is_ok_and(|kind| kind.is_symlink()) {
                    open.push((entry.path(), path)); // a link could lead back here
                }
            } else if facts.is_file() {
                let changed = facts.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
                let modified_ms = changed.map_or(0, millis);
                found.push(FoundFile { path, place: entry.path(), bytes: facts.len(), modified_ms });
            }
        }
    }
    found.sort_by(|one, other| one.path.cmp(&other.path));
    Ok(found)
}

impl FoundFile {
    /// True if its first bytes are those of a recording.
    pub fn is_recording(&self) -> bool {
        let mut head = Vec::new();
        let read = File::open(&self.place).and_then(|file| file.take(HEAD_BYTES as u64).read_to_end(&mut head));
        read.is_err() || media_type(&head) != UNKNOWN // a file that cannot be read is reported later
    }

    /// What the recording says of itself, or why it cannot be used. Decodes no picture.
    pub fn facts(&self) -> Result<FileFacts, String> {
        let file = File::open(&self.place).map_err(|error| format!("cannot be read: {error}"))?;
        let video = VideoFile::open(file, MediaLimits::default()).map_err(|error| error.to_string())?;
        Ok(FileFacts { created_at_ms: video.info().created_at_ms })
    }

    /// The hash of its content.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn hash(&self) -> io::Result<BlobHash> {
        let (mut file, mut sum) = (File::open(&self.place)?, Sha256::new());
        let mut piece = vec![0; 1 << 20];
        loop {
            match file.read(&mut piece)? {
                0 => return Ok(BlobHash(sum.finalize().into())),
                read => sum.update(&piece[..read]),
            }
        }
    }
}
