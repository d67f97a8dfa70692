//! Recordings without a name: made when no trainee is checked in, and sent as files once they have ended. On the server
//! they wait until staff say whose they are.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::sleep;

use super::Standby;
use super::recording::SpoolOutcome;
use crate::capture::recording_file::{FileBytes, RecordingFile, RecordingFileError};
use crate::ids::FeedId;
use crate::time::from_rfc3339;

/// Longest recording without a name, s: one that was started by mistake must not fill the disk.
pub(super) const MAX_SECONDS: f64 = 30.0 * 60.0;
/// First and longest pause before a recording is sent again; each pause is twice the one before.
const MIN_PAUSE: Duration = Duration::from_millis(500);
const MAX_PAUSE: Duration = Duration::from_secs(15);
/// Failed attempts after which the other recordings come first. Without a connection they could not be sent either.
const MAX_FAILURES: u32 = 3;

/// Begins to make the bytes of a file; each call begins anew.
pub type OpenFile = Arc<dyn Fn() -> FileBytes + Send + Sync>;

/// The file of a recording without a name, made while it is sent.
#[derive(Clone)]
pub struct UnnamedFile {
    /// The recording.
    pub recording: FeedId,
    /// Its length.
    pub bytes: u64,
    /// Its bytes.
    pub open: OpenFile,
    /// Its name, for people.
    pub filename: String,
    /// When the recording began, RFC 3339; `None`: not known.
    pub recorded_at: Option<String>,
    /// Id of the task, if it is known.
    pub task: Option<String>,
}

/// The result of sending a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileOutcome {
    /// The server has it.
    Received,
    /// The server was not reached, or is busy: why. Try again.
    Retry(String),
    /// It failed in another way that may pass: why.
    Failed(String),
    /// The server refuses it: why, and what to do.
    Refused(String),
}

/// Sends a file to the server.
pub type SendFile = Arc<dyn Fn(UnnamedFile) -> Pin<Box<dyn Future<Output = FileOutcome> + Send>> + Send + Sync>;

/// What became of the last recording without a name, for the box's screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum UnnamedState {
    /// It is kept here until the server can be reached.
    Kept,
    /// It waits for a name on the server.
    Waits,
}

impl Standby {
    /// Sends a recording without a name that has ended.
    pub(super) async fn send_unnamed(&self, id: FeedId) -> SpoolOutcome {
        if let Some(why) = self.parts().server.why_not_of_this_box(&self.parts().agent, id) {
            return SpoolOutcome::Refused(why);
        }
        let (mut pause, mut failures) = (MIN_PAUSE, 0);
        let mut known: Option<RecordingFile> = None;
        loop {
            let agent = self.parts().agent.clone();
            // All frames are read for it: once, and not at each attempt of a long outage.
            let made = match known.take().filter(RecordingFile::is_whole) {
                Some(file) => Ok(Ok(Some(file))),
                None => tokio::task::spawn_blocking(move || RecordingFile::of(&agent, id)).await,
            };
            known = made.as_ref().ok().and_then(|made| made.as_ref().ok()?.clone());
            let outcome = match made {
                Ok(Ok(Some(file))) => match self.unnamed_file(id, file) {
                    Some(file) => (self.parts().send_file)(file).await,
                    None => return self.postponed(id, RecordingFileError::Dropped.to_string()),
                },
                Ok(Ok(None)) => {
                    self.remove_sent(id);
                    return SpoolOutcome::Empty;
                }
                Ok(Err(error @ RecordingFileError::Mux(_))) => FileOutcome::Refused(error.to_string()),
                Ok(Err(error @ (RecordingFileError::Dropped | RecordingFileError::Changed))) => {
                    return self.postponed(id, error.to_string());
                }
                Err(panic) => FileOutcome::Refused(panic.to_string()),
            };
            let why = match outcome {
                FileOutcome::Received => {
                    self.remove_sent(id);
                    let mut facts = self.facts();
                    facts.last_unnamed =
                        facts.last_unnamed.filter(|last| last.0 == id).map(|_| (id, UnnamedState::Waits));
                    return SpoolOutcome::Sent;
                }
                FileOutcome::Refused(why) => {
                    let kept = self.parts().agent.spool().path(id);
                    tracing::error!(recording = %id, why, "a recording without a name is refused; it stays in the spool");
                    return SpoolOutcome::Refused(format!("{why}. The recording stays in {}", kept.display()));
                }
                FileOutcome::Retry(why) => {
                    // A network that breaks for this file only must not keep the others from being sent.
                    failures += u32::from(self.facts().is_connected);
                    why
                }
                FileOutcome::Failed(why) => {
                    failures += 1;
                    why
                }
            };
            if failures >= MAX_FAILURES {
                return self.postponed(id, why);
            }
            tracing::warn!(recording = %id, why, "recording without a name not sent; next attempt after a pause");
            sleep(pause).await;
            pause = (2 * pause).min(MAX_PAUSE);
        }
    }

    fn postponed(&self, id: FeedId, why: String) -> SpoolOutcome {
        tracing::warn!(recording = %id, why, "recording without a name not sent; others come first");
        SpoolOutcome::Postponed(why)
    }

    fn unnamed_file(&self, id: FeedId, file: RecordingFile) -> Option<UnnamedFile> {
        let spool = self.parts().agent.spool();
        let recording = spool.get(id)?;
        let hello = &recording.hello;
        // The clock was not compared with the server before the computer was started again, or it was ahead: no time is
        // better than a wrong one.
        let is_past = from_rfc3339(&hello.began_at).is_some_and(|began_ms| began_ms <= self.corrected_now_ms());
        let recorded_at = Some(hello.began_at.clone()).filter(|_| is_past && recording.uncorrected_start.is_none());
        let in_box = recording.in_box.as_deref().unwrap_or_default();
        let of_time = recorded_at.as_ref().map(|at| format!(" {}", at.replace(':', "-"))).unwrap_or_default();
        Some(UnnamedFile {
            recording: id,
            bytes: file.bytes(),
            open: Arc::new(move || file.open()),
            filename: format!("{in_box}{of_time}.mp4"),
            recorded_at,
            task: Some(hello.task.clone()).filter(|task| !task.is_empty()),
        })
    }

    fn remove_sent(&self, id: FeedId) {
        if let Err(error) = self.parts().agent.spool().remove(id) {
            tracing::warn!(recording = %id, %error, "a recording that the server has cannot be removed from the spool");
        }
    }
}
