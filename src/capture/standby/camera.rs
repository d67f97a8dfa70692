//! The camera of a box, kept open: its frames are read and dropped until a recording takes them. The frames since the last
//! key frame are kept, because a recording of H.264 must begin with one. While a recording waits for a movement, those of
//! the last seconds are kept, so that it shows the picture at rest before it.
//!
//! A camera that ends, fails or falls silent is opened again, for as long as the agent runs. A recording continues after a
//! gap if the camera is back in time with the same pictures; otherwise it ends there.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, sleep_until, timeout};

use super::Standby;
use crate::capture::source::{FrameSource, OpenSource, SourceEvent, read_on_thread};
use crate::domain::box_agent::state::{BoxCameraState, LightState};
use crate::domain::feed::FrameCodec;
use crate::media::{CapturedFrame, SourceError, SourceInfo};

/// Pause before a camera is opened again: one that was plugged in again is back within seconds.
const REOPEN_PAUSE: Duration = Duration::from_secs(1);
/// How long the opening may take.
const OPEN_TIMEOUT: Duration = Duration::from_secs(20);
/// Most frames and bytes that are kept from before a recording. A camera with rarer key frames begins at its next one.
const MAX_KEPT_FRAMES: usize = 300;
const MAX_KEPT_BYTES: usize = 32 << 20;
/// Frames that may wait for the recorder, besides those that were kept.
const MAX_WAITING: usize = MAX_KEPT_FRAMES + 64;
/// Frames that may wait for the one who watches them.
const MAX_WATCHED: usize = 32;
/// Time over which frames are counted.
const RATE_WINDOW: Duration = Duration::from_secs(3);

/// Keeps the camera open. Clones are the same camera.
#[derive(Clone)]
pub struct CameraKeeper(Arc<CameraParts>);

struct CameraParts {
    open: OpenSource,
    /// Silence after which the camera counts as missing.
    silence: Duration,
    /// Time after which a recording ends whose camera is missing.
    outage: Duration,
    /// True if the frames of a file are read as fast as they come: for tests.
    is_fast: bool,
    view: Mutex<KeptCamera>,
}

#[derive(Default)]
struct KeptCamera {
    info: Option<SourceInfo>,
    is_open: bool,
    opened: Option<Instant>,
    missing: Option<(Instant, String)>,
    arrivals: VecDeque<Instant>,
    kept: KeptFrames,
    recording: Option<mpsc::Sender<SourceEvent>>,
    /// Gets all frames while a recording waits for a movement.
    watcher: Option<mpsc::Sender<CapturedFrame>>,
    /// The last key frame, for its brightness.
    key_frame: Option<Vec<u8>>,
    light: Option<LightState>,
}

/// The frames since the last key frame, or of the last seconds.
#[derive(Default)]
struct KeptFrames {
    /// Each with its arrival. The first one is a key frame.
    frames: VecDeque<(Instant, CapturedFrame)>,
    bytes: usize,
    /// How long frames are kept at least, if there is room.
    time: Duration,
}

impl KeptFrames {
    /// None yet.
    fn none(time: Duration) -> Self {
        Self { time, ..Self::default() }
    }

    fn add(&mut self, frame: &CapturedFrame, arrived: Instant) {
        if self.frames.is_empty() && !frame.is_key {
            return;
        }
        self.bytes += frame.bytes.len();
        self.frames.push_back((arrived, frame.clone()));
        self.drop_old(arrived);
    }

    /// Keeps frames for this time from now on.
    fn keep(&mut self, time: Duration) {
        self.time = time;
        self.drop_old(Instant::now());
    }

    fn drop_old(&mut self, now: Instant) {
        let is_too_much = |kept: &Self| kept.frames.len() > MAX_KEPT_FRAMES || kept.bytes > MAX_KEPT_BYTES;
        while is_too_much(self) || self.is_long_enough_without_first(now) {
            self.drop_to_next_key();
        }
    }

    /// True if the frames from the second key frame on are enough.
    fn is_long_enough_without_first(&self, now: Instant) -> bool {
        let second = self.frames.iter().skip(1).find(|(_, frame)| frame.is_key);
        second.is_some_and(|(arrived, _)| now - *arrived >= self.time)
    }

    fn drop_to_next_key(&mut self) {
        let mut is_first = true;
        while self.frames.front().is_some_and(|(_, frame)| std::mem::take(&mut is_first) || !frame.is_key) {
            self.bytes -= self.frames.pop_front().map_or(0, |(_, frame)| frame.bytes.len());
        }
    }
}

impl CameraKeeper {
    /// A camera that `open` opens.
    pub fn new(open: OpenSource, silence: Duration, outage: Duration, is_fast: bool) -> Self {
        Self(Arc::new(CameraParts { open, silence, outage, is_fast, view: Mutex::default() }))
    }

    /// The state of the camera.
    pub fn state(&self) -> BoxCameraState {
        let view = self.view();
        let size = view.info.as_ref().map(|info| info.size);
        let recent = view.arrivals.iter().filter(|arrived| arrived.elapsed() < RATE_WINDOW).count();
        let known_s = view.opened.map_or(0.0, |opened| opened.elapsed().min(RATE_WINDOW).as_secs_f64());
        BoxCameraState {
            is_open: view.is_open,
            width: size.map(|size| size.0),
            height: size.map(|size| size.1),
            frame_rate_hz: (view.is_open && known_s >= 1.0).then(|| (10.0 * recent as f64 / known_s).round() / 10.0),
            missing_s: view.missing.as_ref().map(|(since, _)| since.elapsed().as_secs_f64()),
            why: view.missing.as_ref().map(|(_, why)| why.clone()),
            is_exposure_held: None,
        }
    }

    /// The light.
    pub fn light(&self) -> Option<LightState> {
        let view = self.view();
        view.light.filter(|_| view.is_open)
    }

    pub(super) fn set_light(&self, light: LightState) {
        self.view().light = Some(light);
    }

    /// The last key frame, once, with the properties of its source.
    pub(super) fn take_key_frame(&self) -> Option<(SourceInfo, Vec<u8>)> {
        let mut view = self.view();
        let info = view.info.clone()?;
        view.key_frame.take().map(|frame| (info, frame))
    }

    /// How long the camera has been open.
    pub(super) fn open_for(&self) -> Duration {
        self.view().opened.map_or(Duration::ZERO, |opened| opened.elapsed())
    }

    /// Begins to pass on the frames, from the first one on that is kept. `None` if the camera is missing.
    pub(super) fn begin(&self) -> Option<RecordedCamera> {
        let mut view = self.view();
        if !view.is_open {
            return None;
        }
        let info = view.info.clone()?;
        let (sender, frames) = mpsc::channel(MAX_WAITING);
        for (_, frame) in &view.kept.frames {
            let _ = sender.try_send(SourceEvent::Frame(frame.clone())); // there is room for all of them
        }
        let first_arrived = view.kept.frames.front().map(|(arrived, _)| *arrived);
        let needs_key = first_arrived.is_none();
        view.recording = Some(sender);
        Some(RecordedCamera { info, frames, first: None, needs_key, first_arrived })
    }

    /// Passes on no more frames.
    pub(super) fn end(&self) {
        self.view().recording = None;
    }

    /// Keeps the frames of this time, and passes on all frames until [`CameraKeeper::unwatch`], or until the camera is
    /// interrupted. One who watches too slowly misses frames of JPEG, and begins again with H.264. `None` if the camera is
    /// missing.
    pub(super) fn watch(&self, kept: Duration) -> Option<(SourceInfo, mpsc::Receiver<CapturedFrame>)> {
        let mut view = self.view();
        let info = view.info.clone().filter(|_| view.is_open)?;
        let (sender, frames) = mpsc::channel(MAX_WATCHED);
        view.watcher = Some(sender);
        view.kept.keep(kept);
        Some((info, frames))
    }

    /// Ends [`CameraKeeper::watch`].
    pub(super) fn unwatch(&self) {
        let mut view = self.view();
        view.watcher = None;
        view.kept.keep(Duration::ZERO);
    }

    /// Keeps the camera open until it is dropped.
    pub(super) async fn keep_open(self, standby: Standby) {
        loop {
            let stop = Arc::new(AtomicBool::new(false));
            let (open, flag) = (self.0.open.clone(), stop.clone());
            let opening = tokio::task::spawn_blocking(move || open(flag));
            let why = match timeout(OPEN_TIMEOUT, opening).await {
                Ok(Ok(Ok(source))) => {
                    let info = source.info().clone();
                    self.opened(info.clone()).await;
                    standby.hold_controls_again();
                    standby.note_change();
                    let is_paced = info.is_file && !self.0.is_fast;
                    self.read(read_on_thread(source), is_paced).await
                }
                Ok(Ok(Err(error))) => error.to_string(),
                Ok(Err(panic)) => panic.to_string(),
                Err(_) => format!("the camera cannot be opened (no answer within {OPEN_TIMEOUT:?})"),
            };
            stop.store(true, Ordering::Relaxed);
            if self.missing(why) {
                standby.note_change();
            }
            self.end_lost_recording().await;
            sleep(REOPEN_PAUSE).await;
        }
    }

    /// The camera is open; it counts as there with its first frame. A recording cannot go on with other pictures.
    async fn opened(&self, info: SourceInfo) {
        let lost = {
            let mut view = self.view();
            let is_other = view.info.as_ref().is_some_and(|before| *before != info);
            *view = KeptCamera {
                info: Some(info),
                opened: Some(Instant::now()),
                missing: view.missing.take(),
                recording: view.recording.take(),
                light: view.light,
                kept: KeptFrames::none(view.kept.time),
                ..KeptCamera::default()
            };
            if is_other { view.recording.take() } else { None }
        };
        if let Some(recording) = lost {
            let why = "the camera has another picture size or coding now; start a new recording";
            let _ = recording.send(SourceEvent::Lost(why.to_owned())).await; // the recording may have ended
        }
    }

    /// Reads frames until the camera is interrupted. Returns why it was.
    async fn read(&self, mut frames: mpsc::Receiver<Result<CapturedFrame, SourceError>>, is_paced: bool) -> String {
        let began = Instant::now();
        let mut is_first = true;
        loop {
            let frame = match timeout(self.0.silence, frames.recv()).await {
                Ok(Some(Ok(frame))) => frame,
                Ok(Some(Err(error))) => return error.to_string(),
                Ok(None) => return "the source ended".to_owned(),
                Err(_) => return format!("the camera sent nothing for {:?}", self.0.silence),
            };
            if is_paced {
                sleep_until(began + Duration::from_secs_f64(frame.due_s.clamp(0.0, 1e6))).await;
            }
            self.take(frame, std::mem::take(&mut is_first)).await;
        }
    }

    async fn take(&self, frame: CapturedFrame, is_first: bool) {
        let now = Instant::now();
        let recording = {
            let mut view = self.view();
            (view.is_open, view.missing) = (true, None);
            view.arrivals.push_back(now);
            while view.arrivals.front().is_some_and(|arrived| now - *arrived > RATE_WINDOW) {
                view.arrivals.pop_front();
            }
            if frame.is_key {
                view.key_frame = Some(frame.bytes.clone());
            }
            view.kept.add(&frame, now);
            let has_missed = view.watcher.as_ref().is_some_and(|watcher| watcher.try_send(frame.clone()).is_err());
            if has_missed && view.info.as_ref().is_some_and(|info| info.codec == FrameCodec::H264) {
                view.watcher = None; // its pictures are damaged until the next key frame
            }
            view.recording.clone()
        };
        let Some(recording) = recording else { return };
        let event = if is_first { SourceEvent::Resumed(frame, now) } else { SourceEvent::Frame(frame) };
        // A disk that is slower than the camera slows the reader down.
        if recording.send(event).await.is_err() {
            self.end();
        }
    }

    /// Notes that the camera is missing. Returns true if it was there.
    fn missing(&self, why: String) -> bool {
        let mut view = self.view();
        let was_open = std::mem::take(&mut view.is_open);
        if was_open || view.missing.is_none() {
            tracing::warn!(why, "the camera is missing; opened again after a pause");
        }
        let since = view.missing.take().map_or_else(Instant::now, |(since, _)| since);
        view.missing = Some((since, why));
        (view.opened, view.watcher, view.kept) = (None, None, KeptFrames::none(view.kept.time));
        was_open
    }

    /// Ends a recording whose camera has been missing for too long.
    async fn end_lost_recording(&self) {
        let lost = {
            let mut view = self.view();
            let is_lost = view.missing.as_ref().is_some_and(|(since, _)| since.elapsed() >= self.0.outage);
            let why = view.missing.as_ref().map(|(_, why)| why.clone()).unwrap_or_default();
            view.recording.take_if(|_| is_lost).map(|recording| (recording, why))
        };
        if let Some((recording, why)) = lost {
            let why = format!("{why} and was not back after {:?}", self.0.outage);
            let _ = recording.send(SourceEvent::Lost(why)).await; // the recording may have ended
        }
    }

    fn view(&self) -> MutexGuard<'_, KeptCamera> {
        self.0.view.lock().unwrap_or_else(PoisonError::into_inner) // every change is whole
    }
}

/// The frames of a camera from the start of a recording on. The first one has the time 0.
pub(super) struct RecordedCamera {
    info: SourceInfo,
    frames: mpsc::Receiver<SourceEvent>,
    /// Time of the first frame: ticks and s.
    first: Option<(i64, f64)>,
    /// True until the first key frame, if none was kept.
    needs_key: bool,
    /// When the first frame arrived, if it was kept from before.
    pub(super) first_arrived: Option<Instant>,
}

impl RecordedCamera {
    fn shifted(&mut self, frame: CapturedFrame) -> CapturedFrame {
        let (ticks, seconds) = *self.first.get_or_insert((frame.time, frame.due_s));
        CapturedFrame { time: frame.time.saturating_sub(ticks), due_s: frame.due_s - seconds, ..frame }
    }
}

impl FrameSource for RecordedCamera {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    async fn next(&mut self) -> SourceEvent {
        loop {
            match self.frames.recv().await {
                Some(SourceEvent::Frame(frame) | SourceEvent::Resumed(frame, _)) if self.needs_key && !frame.is_key => {
                }
                Some(SourceEvent::Frame(frame)) => {
                    self.needs_key = false;
                    return SourceEvent::Frame(self.shifted(frame));
                }
                // Before the first frame there is nothing to resume.
                Some(SourceEvent::Resumed(frame, _)) if self.first.is_none() => {
                    self.needs_key = false;
                    return SourceEvent::Frame(self.shifted(frame));
                }
                Some(SourceEvent::Resumed(frame, arrived)) => {
                    return SourceEvent::Resumed(self.shifted(frame), arrived);
                }
                Some(other) => return other,
                None => return SourceEvent::Ended,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(time: i64, is_key: bool) -> CapturedFrame {
        CapturedFrame { time, due_s: time as f64 / 1000.0, is_key, bytes: vec![1; 10] }
    }

    /// The times of the frames that are kept.
    fn times(kept: &KeptFrames) -> Vec<i64> {
        kept.frames.iter().map(|(_, frame)| frame.time).collect()
    }

    #[test]
    fn the_frames_since_the_last_key_frame_are_kept_and_no_more_than_fit() {
        let now = Instant::now();
        let mut kept = KeptFrames::default();
        kept.add(&frame(0, false), now);
        assert!(kept.frames.is_empty(), "no key frame yet");
        for time in 1..=5 {
            kept.add(&frame(time, time == 1 || time == 4), now);
        }
        assert_eq!(times(&kept), [4, 5]);
        kept.add(&frame(6, true), now);
        (0..MAX_KEPT_FRAMES as i64).for_each(|time| kept.add(&frame(7 + time, false), now));
        assert!(kept.frames.is_empty() && kept.bytes == 0, "too rare key frames");
    }

    #[test]
    fn the_frames_of_the_last_seconds_are_kept_from_a_key_frame_on() {
        let began = Instant::now();
        let after = |time: i64| began + Duration::from_millis(time as u64);
        for (keys_every, first) in [(1, 3000), (10, 3000), (25, 2500), (40, 0), (1000, 0)] {
            let mut kept = KeptFrames::none(Duration::from_secs(2));
            (0..=50).for_each(|i| kept.add(&frame(100 * i, i % keys_every == 0), after(100 * i)));
            assert_eq!(times(&kept).first(), Some(&first), "{keys_every}");
            assert_eq!(times(&kept).last(), Some(&5000));
        }
        let mut kept = KeptFrames::none(Duration::from_secs(2));
        (0..9 * MAX_KEPT_FRAMES as i64).for_each(|time| kept.add(&frame(time, true), after(time)));
        assert_eq!(kept.frames.len(), MAX_KEPT_FRAMES, "the oldest ones are dropped");
    }

    #[tokio::test]
    async fn a_recording_begins_at_zero_with_a_key_frame() {
        let info = SourceInfo {
            codec: crate::domain::feed::FrameCodec::H264,
            size: (64, 48),
            time_base: [1, 1000].try_into().unwrap(),
            coded_from: None,
            has_end: false,
            is_file: false,
            is_camera: true,
        };
        let (sender, frames) = mpsc::channel(9);
        let mut camera = RecordedCamera { info, frames, first: None, needs_key: true, first_arrived: None };
        for (time, is_key) in [(7000, false), (7040, true), (7080, false)] {
            sender.send(SourceEvent::Frame(frame(time, is_key))).await.unwrap();
        }
        sender.send(SourceEvent::Resumed(frame(5, true), Instant::now())).await.unwrap();
        drop(sender);
        let mut times = Vec::new();
        while let SourceEvent::Frame(frame) | SourceEvent::Resumed(frame, _) = camera.next().await {
            times.push(frame.time);
        }
        assert_eq!(times, [0, 40, 5 - 7040], "the recorder places the resumed one");
    }
}
