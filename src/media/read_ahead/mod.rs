//! Decodes on a separate thread, a few pictures ahead of the caller, so that decoding and processing run in parallel.
//!
//! Pictures circulate: the decoder thread fills a returned picture, the queue holds at most [`MAX_WAITING`], and the
//! caller holds one. A full queue blocks the decoder, an empty queue blocks the caller. Order, times and errors are
//! those of [`VideoFile::next_picture`], at any speed of the threads.

use std::collections::VecDeque;
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::{Builder, JoinHandle};

use super::{MediaError, Picture, VideoFile, WholeRecording};
use crate::heap;

/// Maximum of decoded pictures in the queue. They even out frames that are slow to decode or to process; each takes 3
/// MB at 1080p.
const MAX_WAITING: usize = 3;

/// Memory for pictures kept at a recording's beginning, bytes; the last picture may exceed it.
const MAX_KEPT_BYTES: usize = 40 << 20;

/// A recording that is decoded ahead.
pub struct ReadAhead {
    current: Option<Picture>,
    /// Pictures returned by [`Self::first_pictures`]; they are returned again by [`Self::next_picture`].
    kept: VecDeque<Picture>,
    /// Error to return after the kept pictures.
    failed: Option<MediaError>,
    whole: WholeRecording,
    // `None` once the decoder's thread has been joined.
    decoder: Option<Decoder>,
}

struct Decoder {
    /// Returns [`VideoFile::whole`] at the recording's end.
    thread: JoinHandle<WholeRecording>,
    pictures: Receiver<Result<Picture, MediaError>>,
    returned: Sender<Picture>,
}

impl ReadAhead {
    /// Begins to decode.
    ///
    /// # Errors
    /// [`MediaError::Memory`] if there is no room for a thread.
    pub fn new(video: VideoFile) -> Result<Self, MediaError> {
        let (made, pictures) = sync_channel(MAX_WAITING);
        let (done_with, back) = channel();
        let thread = Builder::new()
            .name("decoder".into())
            .spawn(move || decode(video, &made, &back))
            .map_err(|_| MediaError::Memory)?;
        Ok(Self {
            current: None,
            kept: VecDeque::new(),
            failed: None,
            whole: WholeRecording::default(),
            decoder: Some(Decoder { thread, pictures, returned: done_with }),
        })
    }

    /// The first pictures, at most `most` and as many as [`MAX_KEPT_BYTES`] hold. [`Self::next_picture`] still returns
    /// them; call this before it. They are copies, and their memory is freed once [`Self::next_picture`] has returned
    /// them. To hold back the decoder's own pictures would make it allocate more for good.
    ///
    /// # Errors
    /// Those of [`VideoFile::next_picture`], if there is not even one picture.
    pub fn first_pictures(&mut self, most: usize) -> Result<&[Picture], MediaError> {
        let mut bytes = 0;
        while self.kept.len() < most && bytes <= MAX_KEPT_BYTES {
            match self.receive() {
                Ok(Some(picture)) => {
                    bytes += picture.memory_bytes();
                    self.kept.push_back(picture.copied());
                    self.recycle(picture);
                }
                Ok(None) => break,
                Err(error) if self.kept.is_empty() => return Err(error),
                Err(error) => {
                    self.failed = Some(error);
                    break;
                }
            }
        }
        Ok(self.kept.make_contiguous())
    }

    /// The next picture in presentation order, lent until the one after it; `None` at the end and after an error.
    ///
    /// # Errors
    /// Those of [`VideoFile::next_picture`], after the pictures before them.
    pub fn next_picture(&mut self) -> Result<Option<&Picture>, MediaError> {
        if let Some(seen) = self.current.take() {
            self.recycle(seen);
        }
        let next = match (self.kept.pop_front(), self.failed.take()) {
            (Some(kept), failed) => {
                self.failed = failed;
                Some(kept)
            }
            (None, Some(error)) => return Err(error),
            (None, None) => self.receive()?,
        };
        self.current = next;
        Ok(self.current.as_ref())
    }

    /// See [`VideoFile::whole`]; empty before [`Self::next_picture`] has returned the end.
    pub fn whole(&self) -> WholeRecording {
        self.whole
    }

    fn recycle(&self, picture: Picture) {
        if let Some(decoder) = &self.decoder {
            // Refused at the recording's end, when the picture is no longer needed.
            let _ = decoder.returned.send(picture);
        }
    }

    fn receive(&mut self) -> Result<Option<Picture>, MediaError> {
        let Some(decoder) = &self.decoder else { return Ok(None) };
        match decoder.pictures.recv() {
            Ok(Ok(picture)) => Ok(Some(picture)),
            Ok(Err(error)) => {
                self.stop();
                Err(error)
            }
            Err(_) => {
                self.stop();
                Ok(None)
            }
        }
    }

    /// Ends the decoder's thread and waits for it, so that its memory is freed; passes on its panic.
    fn stop(&mut self) {
        let Some(Decoder { thread, pictures, returned: done_with }) = self.decoder.take() else { return };
        drop((pictures, done_with)); // its next picture is refused
        match thread.join() {
            Ok(whole) => self.whole = whole,
            Err(panic) if !std::thread::panicking() => resume_unwind(panic),
            Err(_) => {}
        }
        heap::release_free_memory();
    }
}

impl Drop for ReadAhead {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Sends the pictures, and returns what is then known of the file; empty unless all were sent.
fn decode(
    mut video: VideoFile,
    made: &SyncSender<Result<Picture, MediaError>>,
    back: &Receiver<Picture>,
) -> WholeRecording {
    while let Some(next) = video.next_picture().transpose() {
        let is_last = next.is_err();
        if made.send(next).is_err() || is_last {
            return WholeRecording::default();
        }
        back.try_iter().for_each(|picture| video.recycle(picture));
    }
    video.whole()
}

#[cfg(test)]
mod tests;
