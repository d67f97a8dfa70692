//! Takes one file of the watched folder.

use std::fs::File;
use std::ops::ControlFlow;

use jiff::tz::TimeZone;
use tokio::io::AsyncReadExt;

use super::Inbox;
use super::list::{Listed, PeopleList};
use super::scan::{InboxFile, REFUSED, TAKEN, delete, may_be_moved, move_into, open_file};
use crate::analysis::QuickAnalysisError;
use crate::analysis::protocol::Thumbnail;
use crate::domain::scope::Scope;
use crate::domain::session::NewSession;
use crate::domain::text::FileName;
use crate::domain::waiting_recording::RecordingSource;
use crate::ids::{BoxId, TaskId, TraineeId};
use crate::intake::finish::media_type_of;
use crate::intake::folder::RecordedAt;
use crate::intake::{IntakeError, IntakeResult};
use crate::store::{ArrivedRecording, NewWaitingRecording, StoreError};
use crate::vault::{PinnedBlob, VaultError};

/// Bytes that are read at a time.
const BLOCK: usize = 1 << 20;
/// Space that a recording from the folder leaves free on the disk, bytes: recordings can wait in the folder, and other
/// work cannot.
const KEEP_FREE: u64 = 256 << 20;
/// A time that is later than this after now is a mistake, ms.
const MAX_AHEAD_MS: i64 = 24 * 3_600_000;

/// What becomes of a file.
enum Outcome {
    /// The recording is stored, or was before.
    Taken,
    /// It cannot be used, for this reason.
    Refused(String),
    /// It is looked at again later: it has changed, or cannot be read now.
    Later(Option<String>),
    /// The service lacks something that all files need.
    Stop(String),
}

/// A recording with all that is needed for a session.
struct CompleteTarget {
    trainee: TraineeId,
    task: TaskId,
    in_box: BoxId,
}

impl Inbox {
    /// Takes a file; breaks if the service lacks something that all files need, such as space.
    pub(super) async fn take(&mut self, file: InboxFile, list: &PeopleList) -> ControlFlow<()> {
        let place = self.folder.join(&file.path);
        if !may_be_moved(&place) {
            self.report(format!(
                "`{}` is not taken, because the service may not move it away: give its user the right to write there",
                file.path
            ));
            return ControlFlow::Continue(());
        }
        match self.take_content(&file, list).await.unwrap_or_else(outcome_of_error) {
            Outcome::Taken => {
                tracing::info!(file = file.path, "recording of the watched folder taken");
                self.put_away(file, None).await;
            }
            Outcome::Refused(why) => {
                self.report(format!("`{}` was refused and moved to `{REFUSED}`: {why}", file.path));
                self.put_away(file, Some(why)).await;
            }
            Outcome::Later(why) => why.into_iter().for_each(|why| self.report(format!("`{}` {why}", file.path))),
            Outcome::Stop(why) => {
                self.report(format!("recordings wait in the folder: {why}"));
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    }

    async fn take_content(&self, file: &InboxFile, list: &PeopleList) -> IntakeResult<Outcome> {
        let most = self.intake.settings.max_bytes;
        if file.stamp.bytes > most {
            let (bytes, most) = (file.stamp.bytes >> 20, most >> 20);
            return Ok(Outcome::Refused(format!(
                "The file has {bytes} MiB; a recording may have {most} MiB. Cut it into attempts, or ask an administrator \
                 to raise `max_bytes` under [uploads] in the settings."
            )));
        }
        let place = self.folder.join(&file.path);
        let opened = match open_file(&place) {
            Ok(opened) => opened,
            Err(error) => {
                let why = format!("cannot be read ({error}): give the service's user the right to read it");
                return Ok(Outcome::Later(Some(why)));
            }
        };
        let (opened, stamp) = opened;
        if stamp != file.stamp {
            return Ok(Outcome::Later(None));
        }
        self.intake.vault.require_space(stamp.bytes + KEEP_FREE).await?;
        let Some(video) = self.copy(opened, file).await? else { return Ok(Outcome::Later(None)) };
        let known = self.intake.store.waiting_recordings().proposable(&Scope::service()).await?;
        let listed = list.look_up(&file.path, &known);
        match self.intake.store.waiting_recordings().known(video.blob().hash).await? {
            Some(there) => self.known_outcome(there, listed).await,
            None => self.store(file, video, listed.unwrap_or_default()).await,
        }
    }

    /// Copies the file into the vault; `None` if it changed meanwhile.
    async fn copy(&self, opened: File, file: &InboxFile) -> IntakeResult<Option<PinnedBlob>> {
        let mut incoming = self.intake.vault.incoming(self.intake.settings.max_bytes).await?;
        let mut reader = tokio::fs::File::from_std(opened);
        let mut block = vec![0; BLOCK];
        loop {
            if self.intake.shutdown.is_begun() {
                return Err(IntakeError::EndingUnsaved);
            }
            let read = reader.read(&mut block).await.map_err(|error| IntakeError::ConnectionLost(error.into()))?;
            if read == 0 {
                break;
            }
            incoming.write(&block[..read]).await?;
        }
        match open_file(&self.folder.join(&file.path)) {
            Ok((_, after)) if after == file.stamp => Ok(Some(incoming.finish().await?)),
            _ => Ok(None),
        }
    }

    /// The service has the recording. A list that gives it to another person is a mistake that a person has to mend.
    async fn known_outcome(&self, there: ArrivedRecording, listed: Option<Listed>) -> IntakeResult<Outcome> {
        let (ArrivedRecording::Session(session), Some(trainee)) = (there, listed.and_then(|listed| listed.trainee))
        else {
            return Ok(Outcome::Taken);
        };
        let session = self.intake.store.sessions().get(&Scope::service(), session).await?;
        if session.trainee_id == trainee {
            return Ok(Outcome::Taken);
        }
        Ok(Outcome::Refused(format!(
            "The service has this recording as session {} of another person than people.csv says. If that is wrong, move \
             the session on its page.",
            session.id
        )))
    }

    async fn store(&self, file: &InboxFile, video: PinnedBlob, listed: Listed) -> IntakeResult<Outcome> {
        let (picture, unreadable) = match self.pictures.thumbnail(video.blob().hash).await {
            Ok(picture) => (Some(picture), None),
            Err(QuickAnalysisError::Problem(problem)) => {
                return Ok(Outcome::Refused(format!("{}: {}.", problem.title, problem.detail.trim_end_matches('.'))));
            }
            Err(QuickAnalysisError::Crashed(why)) => (None, Some(why)),
            Err(QuickAnalysisError::TimedOut(_)) => (None, Some("took too long".to_owned())),
            Err(error) => return Ok(Outcome::Stop(format!("no process can look at them ({error}); tried again soon"))),
        };
        if let Some(why) = unreadable {
            tracing::warn!(file = file.path, why, "no picture of a recording could be made; taken without one");
        }
        let media_type = media_type_of(&self.intake.vault, video.blob().hash).await?.to_owned();
        let recorded_at_ms = self.recorded_at_ms(file, &listed, picture.as_ref());
        let filename = file.path.parse::<FileName>();
        let filename = filename.map_err(|invalid| IntakeError::Invalid { field: "filename", why: invalid.why })?;
        let mut remark = listed.remark.clone();
        if let (Some(trainee), Some(task), Some(in_box), None) = (listed.trainee, listed.task, listed.in_box, &remark) {
            let target = CompleteTarget { trainee, task, in_box };
            match self.make_session(target, (filename.clone(), &video, media_type.clone()), recorded_at_ms).await {
                Ok(()) => return Ok(Outcome::Taken),
                Err(IntakeError::Store(error @ (StoreError::ConsentMissing { .. } | StoreError::Refused { .. }))) => {
                    remark = Some(format!("Not assigned as people.csv says: {error}."));
                }
                Err(error) => return Err(error),
            }
        }
        let preview = match picture.filter(|picture| !picture.jpeg.is_empty()) {
            Some(picture) => Some(self.intake.vault.put(&picture.jpeg).await?),
            None => None,
        };
        let new = NewWaitingRecording {
            video: video.blob(),
            media_type,
            filename,
            folder: folder_of(&file.path),
            source: RecordingSource::Inbox,
            in_box: listed.in_box,
            task: listed.task,
            trainee: listed.trainee,
            remark: remark.map(|remark| remark.chars().take(2_000).collect()),
            recorded_at_ms,
            time: None,
            preview: preview.as_ref().map(PinnedBlob::blob),
        };
        let most = self.intake.settings.max_waiting;
        self.intake.store.waiting_recordings().add(&Scope::service(), new, most).await?;
        Ok(Outcome::Taken)
    }

    /// Makes a session as the list says.
    async fn make_session(
        &self,
        to: CompleteTarget,
        (filename, video, media_type): (FileName, &PinnedBlob, String),
        recorded_at_ms: Option<i64>,
    ) -> IntakeResult<()> {
        let CompleteTarget { trainee, task, in_box } = to;
        let video = video.blob();
        let new = NewSession { trainee, task, in_box, filename, recorded_at_ms, video, media_type, time: None };
        let session = self.intake.store.sessions().create(&Scope::service(), new).await?;
        self.intake.announce_session(&session);
        Ok(())
    }

    /// When it was recorded: as the list says, else as a name says, else as the file says.
    fn recorded_at_ms(&self, file: &InboxFile, listed: &Listed, picture: Option<&Thumbnail>) -> Option<i64> {
        let named = || RecordedAt::of_path(&file.path, &TimeZone::system()).map(|found| found.at_ms);
        let stated = || picture.and_then(|picture| picture.created_at_ms);
        let at_ms = listed.recorded_at_ms.unwrap_or_else(|| named().or_else(stated));
        at_ms.filter(|at_ms| (0..=self.clock.now_ms() + MAX_AHEAD_MS).contains(at_ms))
    }

    /// Moves a file that is done out of the way, with the reason beside it if it was refused.
    async fn put_away(&mut self, file: InboxFile, refused: Option<String>) {
        let (folder, done, is_deleted) = (self.folder.clone(), file.clone(), self.settings.delete_taken);
        let moved = tokio::task::spawn_blocking(move || match refused {
            None if is_deleted => delete(&folder, &done),
            None => move_into(&folder, &done, TAKEN).map(drop),
            Some(why) => match move_into(&folder, &done, REFUSED)? {
                Some(place) => {
                    let name = place.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    std::fs::write(place.with_file_name(format!("{name}.why.txt")), format!("{why}\n"))
                }
                None => Ok(()),
            },
        });
        if let Ok(Err(error)) = moved.await {
            self.report(format!("`{}` is done, but cannot be moved away ({error}): remove it", file.path));
            self.stuck.insert((file.path, file.stamp));
        }
    }
}

fn folder_of(path: &str) -> Option<String> {
    let (folder, _) = path.rsplit_once('/')?;
    let parts = folder.split('/').map(|part| part.parse::<FileName>().map_or_else(|_| "_".to_owned(), String::from));
    Some(parts.collect::<Vec<_>>().join("/").chars().take(1_000).collect())
}

fn outcome_of_error(error: IntakeError) -> Outcome {
    match error {
        IntakeError::Vault(VaultError::DiskFull) | IntakeError::Store(StoreError::DiskFull) => {
            Outcome::Stop("the disk is full; they are taken once there is space".to_owned())
        }
        IntakeError::Store(StoreError::LimitReached { why, .. }) => Outcome::Stop(why),
        IntakeError::EndingUnsaved | IntakeError::Vault(VaultError::ShuttingDown) => Outcome::Later(None),
        IntakeError::ConnectionLost(error) => Outcome::Later(Some(format!("could not be read to its end ({error})"))),
        error => Outcome::Stop(format!("storing one failed ({error}); tried again soon")),
    }
}
