//! The journal of an upload, a file beside the map: the hashes of the files, and the uploads that were begun. With it, a
//! run that was ended continues where it stopped, and does not read all files again.
//!
//! A line is a JSON object, appended and synced; the last line of a path counts, and a torn last line is left out. Losing
//! the journal costs time only: the service knows which recordings it has.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::files::FoundFile;
use crate::domain::blob::BlobHash;

/// What is known of a file since an earlier run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JournalEntry {
    /// The path in the folder.
    path: String,
    bytes: u64,
    modified_ms: i64,
    sha256: BlobHash,
    /// The upload that was begun, if one was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    upload: Option<BegunUpload>,
}

/// An upload that was begun.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BegunUpload {
    /// Its address.
    pub address: String,
    /// What the service was sent about the recording: an upload with other metadata is not continued.
    pub metadata: String,
    /// The service.
    pub service: String,
}

/// An open journal.
pub struct Journal {
    path: PathBuf,
    known: BTreeMap<String, JournalEntry>,
    file: Option<File>,
}

impl Journal {
    /// Reads a journal, if there is one.
    ///
    /// # Errors
    /// It exists, and cannot be read.
    pub fn open(path: &Path) -> io::Result<Self> {
        let mut text = Vec::new();
        match File::open(path) {
            Ok(mut file) => {
                file.read_to_end(&mut text)?;
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
        let lines = text.split(|byte| *byte == b'\n');
        let entries = lines.filter_map(|line| serde_json::from_slice::<JournalEntry>(line).ok());
        let known = entries.map(|entry| (entry.path.clone(), entry)).collect();
        Ok(Self { path: path.to_owned(), known, file: None })
    }

    /// The hash of a file that has not changed since it was read.
    pub fn hash_of(&self, file: &FoundFile) -> Option<BlobHash> {
        self.entry(file).map(|entry| entry.sha256)
    }

    /// The upload that was begun for a file that has not changed since.
    pub fn upload_of(&self, file: &FoundFile) -> Option<&BegunUpload> {
        self.entry(file)?.upload.as_ref()
    }

    fn entry(&self, file: &FoundFile) -> Option<&JournalEntry> {
        let is_same = |entry: &&JournalEntry| (entry.bytes, entry.modified_ms) == (file.bytes, file.modified_ms);
        self.known.get(&file.path).filter(is_same)
    }

    /// Notes what is known of a file, and returns when it is on the disk.
    ///
    /// # Errors
    /// The journal cannot be written.
    pub fn note(&mut self, file: &FoundFile, sha256: BlobHash, upload: Option<BegunUpload>) -> io::Result<()> {
        let (path, bytes, modified_ms) = (file.path.clone(), file.bytes, file.modified_ms);
        let entry = JournalEntry { path: path.clone(), bytes, modified_ms, sha256, upload };
        // A line of its own also after one that was torn.
        let line = format!("\n{}\n", serde_json::to_string(&entry).map_err(io::Error::other)?);
        let file = match &mut self.file {
            Some(file) => file,
            None => self.file.insert(OpenOptions::new().create(true).append(true).open(&self.path)?),
        };
        file.write_all(line.as_bytes())?;
        if entry.upload.is_some() {
            file.sync_data()?;
        }
        self.known.insert(path, entry);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::blob::Blob;

    fn file(bytes: u64) -> FoundFile {
        FoundFile { path: "a/1.mp4".to_owned(), place: "a/1.mp4".into(), bytes, modified_ms: 5 }
    }

    #[test]
    fn the_last_whole_line_counts_and_a_changed_file_is_not_known() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.csv.progress");
        let (hash, other) = (Blob::of(b"x").hash, Blob::of(b"y").hash);
        let upload = |number: u32| BegunUpload {
            address: format!("/api/v1/uploads/{number}"),
            metadata: "trainee YQ==".to_owned(),
            service: "http://127.0.0.1:1".to_owned(),
        };
        let mut journal = Journal::open(&path).unwrap();
        assert_eq!(journal.hash_of(&file(1)), None);
        journal.note(&file(1), hash, None).unwrap();
        journal.note(&file(1), hash, Some(upload(1))).unwrap();
        std::fs::OpenOptions::new()
            .append(true)
            .open(&path)
            .unwrap()
            .write_all(b"{\"path\":\"a/1.mp4\",\"byt")
            .unwrap();
        let mut again = Journal::open(&path).unwrap();
        assert_eq!((again.hash_of(&file(1)), again.upload_of(&file(1))), (Some(hash), Some(&upload(1))));
        assert_eq!((again.hash_of(&file(2)), again.upload_of(&file(2))), (None, None));
        again.note(&file(1), other, Some(upload(2))).unwrap();
        assert_eq!(Journal::open(&path).unwrap().upload_of(&file(1)), Some(&upload(2)), "after the torn line");
    }
}
