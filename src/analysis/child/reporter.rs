//! Sends the child's replies as records on standard output.

use std::io::{self, BufWriter, Write};

use super::WorkRecord;
use crate::analysis::protocol::{self, ChildReply};
use crate::sandbox::write_record;

/// Standard output as a pipe. Rust's own is line-buffered: it splits the output at the last newline and writes both
/// parts separately, and each write would wake the parent.
struct StdoutPipe;

impl Write for StdoutPipe {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(rustix::io::write(io::stdout(), bytes)?)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Sends replies to the parent.
pub struct Reporter {
    out: BufWriter<StdoutPipe>,
}

impl Reporter {
    pub(super) fn new() -> Self {
        Self { out: BufWriter::new(StdoutPipe) }
    }

    pub(super) fn send(&mut self, answer: &ChildReply) -> io::Result<()> {
        let bytes = protocol::encode(answer).map_err(io::Error::other)?;
        write_record(&mut self.out, &bytes)
    }

    /// Sends a record of the work.
    pub(super) fn record(&mut self, record: WorkRecord) -> io::Result<()> {
        self.send(&ChildReply::Record(record))
    }

    /// A sign of life: this many pictures are done, of all, if their number is known.
    pub(super) fn alive(&mut self, done: u64, of: Option<u64>) -> io::Result<()> {
        self.send(&ChildReply::Alive { done, of })
    }
}
