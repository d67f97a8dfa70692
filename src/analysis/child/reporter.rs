//! Sends the child's replies as records on standard output.

use std::io::{self, BufWriter, Write};

use crate::analysis::protocol::{self, ChildReply, SeenRow};
use crate::media::RecordingInfo;
use crate::sandbox::write_record;

/// Frames per record: few enough to show progress, many enough to cost little.
const FRAMES_PER_RECORD: usize = 32;

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

/// Sends replies, and collects frames into fewer, larger ones.
pub(super) struct Reporter {
    out: BufWriter<StdoutPipe>,
    times_s: Vec<f64>,
    seen: Vec<SeenRow>,
}

impl Reporter {
    pub(super) fn new() -> Self {
        Self { out: BufWriter::new(StdoutPipe), times_s: Vec::new(), seen: Vec::new() }
    }

    pub(super) fn send(&mut self, answer: &ChildReply) -> io::Result<()> {
        let bytes = protocol::encode(answer).map_err(io::Error::other)?;
        write_record(&mut self.out, &bytes)
    }

    pub(super) fn recording(&mut self, info: RecordingInfo) -> io::Result<()> {
        let RecordingInfo { width, height, frames_expected, .. } = info;
        self.send(&ChildReply::Recording { width, height, frames_expected })
    }

    pub(super) fn frame(&mut self, time_s: f64, seen: impl Iterator<Item = SeenRow>) -> io::Result<()> {
        self.times_s.push(time_s);
        self.seen.extend(seen);
        if self.times_s.len() < FRAMES_PER_RECORD { Ok(()) } else { self.flush_frames() }
    }

    pub(super) fn flush_frames(&mut self) -> io::Result<()> {
        let (times_s, seen) = (std::mem::take(&mut self.times_s), std::mem::take(&mut self.seen));
        if times_s.is_empty() { Ok(()) } else { self.send(&ChildReply::Frames { times_s, seen }) }
    }
}
