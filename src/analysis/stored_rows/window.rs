//! Reads a file through a window of fixed size.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::Arc;

/// Size of the window, and so the memory of a reader, bytes.
pub(super) const WINDOW_BYTES: usize = 64 * 1024;

/// A position in a file, with the bytes that follow it. Readers of one file share its descriptor.
#[derive(Debug)]
pub(super) struct WindowReader {
    file: Arc<File>,
    /// Place in the file of the next byte that is read into the window.
    next: u64,
    window: Vec<u8>,
    /// Bytes of the window before the position.
    used: usize,
}

impl WindowReader {
    pub(super) fn new(file: Arc<File>) -> Self {
        Self { file, next: 0, window: Vec::new(), used: 0 }
    }

    /// The position, bytes from the file's start.
    pub(super) fn position(&self) -> u64 {
        self.next - (self.window.len() - self.used) as u64
    }

    /// Moves to this position.
    pub(super) fn seek(&mut self, to: u64) {
        let window_start = self.next - self.window.len() as u64;
        if (window_start..=self.next).contains(&to) {
            self.used = (to - window_start) as usize;
        } else {
            self.window.clear();
            (self.used, self.next) = (0, to);
        }
    }

    /// The bytes from the position on: at least `least` of them, unless the file ends before. `least` is at most
    /// [`WINDOW_BYTES`].
    pub(super) fn peek(&mut self, least: usize) -> io::Result<&[u8]> {
        if self.window.len() - self.used < least {
            self.window.drain(..self.used);
            self.used = 0;
            let mut held = self.window.len();
            self.window.resize(WINDOW_BYTES, 0);
            while held < least {
                let read = match self.file.read_at(&mut self.window[held..], self.next) {
                    Ok(0) => break,
                    Ok(read) => read,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                    Err(error) => {
                        self.window.truncate(held);
                        return Err(error);
                    }
                };
                held += read;
                self.next += read as u64;
            }
            self.window.truncate(held);
        }
        Ok(&self.window[self.used..])
    }

    /// Moves past bytes that [`WindowReader::peek`] returned.
    pub(super) fn skip(&mut self, bytes: usize) {
        self.used = (self.used + bytes).min(self.window.len());
    }

    /// The first `count` of the `bytes` that were skipped last.
    pub(super) fn before(&self, bytes: usize, count: usize) -> &[u8] {
        &self.window[self.used - bytes..][..count]
    }
}
