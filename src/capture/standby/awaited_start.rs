//! A recording that begins by itself with the first movement in the picture.
//!
//! While it is awaited, the frames of the last two seconds are kept in memory, and the recording begins with them. So it
//! shows the picture at rest before the movement, as the beginning of an attempt is measured (`docs/method.md`, 6.1): the time
//! at rest is no part of it. Nothing is stored before.

use std::time::Duration;

use tokio::sync::mpsc::Receiver;
use tokio::time::{Instant, sleep, sleep_until};

use super::Standby;
use super::movement::{MovementDetector, PictureMotion};
use super::refusal::BoxRefusal;
use crate::domain::box_agent::messages::{CheckedIn, NamedTask, NamedTrainee};
use crate::domain::box_agent::state::AwaitedStartState;
use crate::ids::{FeedId, TraineeId};
use crate::media::{CapturedFrame, FeedDecoder, MediaError, MediaLimits, SourceInfo, block_means};

/// Time before the movement that the recording shows: a second at rest, and what a slow start takes until it is seen.
const KEPT: Duration = Duration::from_secs(2);
/// Pause before a camera is watched again that was interrupted.
const PAUSE: Duration = Duration::from_millis(200);

/// The recording that is awaited.
#[derive(Clone, Debug)]
pub(super) struct AwaitedStart {
    number: u64,
    pub(super) trainee: NamedTrainee,
    task: NamedTask,
    since: Instant,
    is_picture_still: bool,
}

/// Why watching the camera has ended.
enum Watched {
    /// Something moves.
    Moved,
    /// The camera was interrupted, or nothing is awaited any more.
    Ended,
    /// The pictures cannot be decoded.
    Failed(MediaError),
}

impl Standby {
    /// Starts a recording of this trainee with the first movement in the picture. It replaces another one that is awaited.
    ///
    /// # Errors
    /// Why not.
    pub(super) fn await_movement(&self, trainee: NamedTrainee, task: NamedTask) -> Result<(), BoxRefusal> {
        let running = self.running();
        if running.is_some() {
            return Err(BoxRefusal::Running);
        }
        let number = {
            let mut facts = self.facts();
            let other = facts.checked_in.as_ref().filter(|checked_in| checked_in.trainee.id != trainee.id);
            if other.is_some() {
                return Err(BoxRefusal::CheckedIn);
            }
            facts.last_awaited += 1;
            let number = facts.last_awaited;
            facts.start_failed = None;
            facts.awaited =
                Some(AwaitedStart { number, trainee, task, since: Instant::now(), is_picture_still: false });
            number
        };
        drop(running);
        self.parts().camera.unwatch(); // the one before
        tokio::spawn(self.clone().watch_for_movement(number));
        self.note_change();
        Ok(())
    }

    /// Awaits the first movement for the trainee who is checked in, on a box that starts by itself.
    pub(super) fn await_movement_if_automatic(&self) {
        let checked_in = self.facts().checked_in.clone();
        if let Some(CheckedIn { trainee, task: Some(task), .. }) = checked_in
            && self.parts().starts_on_movement
        {
            let _ = self.await_movement(trainee, task); // while a recording runs, nothing is awaited
        }
    }

    /// A trainee chose this task at the box: the recording that is awaited is one of it, and on a box that starts by itself
    /// one is awaited.
    pub(super) fn await_other_task(&self, task: NamedTask) {
        let awaited = self.facts().awaited.clone();
        match awaited {
            Some(AwaitedStart { trainee, .. }) => drop(self.await_movement(trainee, task)), // refused while a recording runs
            None => self.await_movement_if_automatic(),
        }
    }

    /// Awaits no movement any more. True if one was awaited.
    pub(super) fn end_awaited_start(&self) -> bool {
        self.end_awaited_start_if(|_| true)
    }

    /// The same, only for the movement of this trainee.
    pub(super) fn end_awaited_start_of(&self, trainee: TraineeId) -> bool {
        self.end_awaited_start_if(|awaited| awaited.trainee.id == trainee)
    }

    fn end_awaited_start_if(&self, is_it: impl Fn(&AwaitedStart) -> bool) -> bool {
        let has_ended = self.facts().awaited.take_if(|awaited| is_it(awaited)).is_some();
        if has_ended {
            self.parts().camera.unwatch();
            self.note_change();
        }
        has_ended
    }

    /// Starts the recording that is awaited at once. `None`: none is awaited.
    pub(super) fn start_awaited_now(&self) -> Option<Result<(), BoxRefusal>> {
        let AwaitedStart { trainee, task, .. } = self.facts().awaited.clone()?;
        self.end_awaited_start(); // nothing from before is shown
        Some(self.start(FeedId::at(self.corrected_now_ms()), Some(trainee), Some(task)))
    }

    /// Awaits no movement any more, unless it is that of the trainee who is checked in.
    pub(super) fn end_awaited_start_of_another(&self) {
        let trainee = self.facts().checked_in.as_ref().map(|checked_in| checked_in.trainee.id);
        self.end_awaited_start_if(|awaited| Some(awaited.trainee.id) != trainee);
    }

    /// The recording that is awaited, for readers.
    pub(super) fn awaited_start_state(&self) -> Option<AwaitedStartState> {
        let facts = self.facts();
        let AwaitedStart { trainee, task, is_picture_still, .. } = facts.awaited.as_ref()?;
        Some(AwaitedStartState { trainee: trainee.id, task: task.id, is_picture_still: *is_picture_still })
    }

    async fn watch_for_movement(self, number: u64) {
        loop {
            let Some(awaited) = self.awaited(number) else { return };
            let deadline = awaited.since + self.parts().movement_patience;
            let Some((info, frames)) = self.parts().camera.watch(KEPT) else {
                if Instant::now() >= deadline {
                    return self.end_awaited(number);
                }
                sleep(PAUSE).await;
                continue;
            };
            if self.awaited(number).is_none() {
                return self.parts().camera.unwatch(); // it was ended just before
            }
            let watching = self.clone();
            let watching = tokio::task::spawn_blocking(move || watching.watch_camera(number, &info, frames));
            let watched = tokio::select! {
                watched = watching => watched,
                () = sleep_until(deadline) => return self.end_awaited(number),
            };
            match watched {
                Ok(Watched::Moved) => {
                    self.start_awaited(number);
                    return;
                }
                Ok(Watched::Ended) => {
                    self.note_still(number, false);
                    sleep(PAUSE).await;
                }
                Ok(Watched::Failed(error)) => {
                    self.fail_awaited(number, BoxRefusal::Pictures(error.to_string()));
                    return;
                }
                Err(panic) => {
                    self.fail_awaited(number, BoxRefusal::Pictures(panic.to_string()));
                    return;
                }
            }
        }
    }

    /// Looks at the frames of the camera, in a thread of its own: a picture takes some milliseconds to decode.
    fn watch_camera(&self, number: u64, info: &SourceInfo, mut frames: Receiver<CapturedFrame>) -> Watched {
        let decoder = FeedDecoder::new(info.codec, info.size, info.time_base, MediaLimits::default());
        let mut decoder = match decoder {
            Ok(decoder) => decoder,
            Err(error) => return Watched::Failed(error),
        };
        let mut detector = MovementDetector::default();
        let (mut sent, mut has_key) = (0, false);
        while let Some(frame) = frames.blocking_recv() {
            has_key |= frame.is_key;
            if !has_key {
                continue;
            }
            if let Err(error) = decoder.send_frame(sent, frame.time, &frame.bytes) {
                return Watched::Failed(error);
            }
            sent += 1;
            loop {
                let picture = match decoder.next_picture() {
                    Ok(Some(picture)) => picture,
                    Ok(None) => break,
                    Err(error) => return Watched::Failed(error),
                };
                let seen = block_means(&picture).map(|blocks| detector.add(picture.frame().time_s, blocks));
                decoder.recycle(picture);
                match seen {
                    Some(PictureMotion::Moves) => return Watched::Moved,
                    Some(motion) => self.note_still(number, motion == PictureMotion::Still),
                    None => {}
                }
            }
        }
        Watched::Ended
    }

    fn note_still(&self, number: u64, is_still: bool) {
        let has_changed = {
            let mut facts = self.facts();
            let Some(awaited) = facts.awaited.as_mut().filter(|awaited| awaited.number == number) else { return };
            std::mem::replace(&mut awaited.is_picture_still, is_still) != is_still
        };
        if has_changed {
            self.note_change();
        }
    }

    /// The recording with this number, if it is still awaited.
    fn awaited(&self, number: u64) -> Option<AwaitedStart> {
        self.facts().awaited.clone().filter(|awaited| awaited.number == number)
    }

    /// Starts the recording that is awaited. A wait that is ended before starts nothing: both take the same lock.
    fn start_awaited(&self, number: u64) {
        let started = {
            let mut running = self.running();
            let Some(AwaitedStart { trainee, task, .. }) = self.take_awaited(number) else { return };
            let id = FeedId::at(self.corrected_now_ms());
            tracing::info!(recording = %id, "movement in the picture");
            self.start_locked(&mut running, id, Some(trainee), Some(task))
        };
        if let Err(why) = started {
            self.parts().camera.unwatch();
            self.note_start_failed(why);
        }
    }

    fn take_awaited(&self, number: u64) -> Option<AwaitedStart> {
        self.facts().awaited.take_if(|awaited| awaited.number == number)
    }

    /// Ends this wait, unless another one has begun since.
    fn end_awaited(&self, number: u64) {
        self.end_awaited_start_if(|awaited| awaited.number == number);
    }

    fn fail_awaited(&self, number: u64, why: BoxRefusal) {
        if self.take_awaited(number).is_some() {
            self.parts().camera.unwatch();
            self.note_start_failed(why);
        }
    }

    fn note_start_failed(&self, why: BoxRefusal) {
        tracing::warn!(%why, "the recording did not start with the movement");
        self.facts().start_failed = Some(why);
        self.note_change();
    }
}
