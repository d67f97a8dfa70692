//! Writes frames into the spool as they arrive, with numbers.

use std::time::Duration;

use tokio::task::{JoinHandle, block_in_place};
use tokio::time::{Instant, interval, sleep_until};

use super::Agent;
use super::source::{FrameSource, SourceEvent};
use crate::domain::feed::record::{FeedRecord, GapReason, RecordBody};
use crate::domain::feed::{MAX_DURATION_S, MAX_FRAMES, TimeBase};
use crate::media::CapturedFrame;
use crate::shutdown::Shutdown;

/// Interval between syncs of the spool. A power cut loses at most this much of what the server does not have, and what
/// arrived during a sync.
const SYNC_INTERVAL: Duration = Duration::from_millis(400);

/// Shortest time between the frames before and after an interruption of the source, s. A source opened again may
/// deliver what it had buffered faster than time passes.
const MIN_GAP_S: f64 = 0.5;

/// How long after the planned end the last frames may arrive, over a network for example. A source that delivers nothing
/// until then is away.
const END_PATIENCE: Duration = Duration::from_secs(1);

/// How long nothing may arrive after the end of a recording was requested, until all that was captured before is there.
const DRAIN_PATIENCE: Duration = Duration::from_millis(50);

/// How a recording is made.
#[derive(Clone, Copy, Debug)]
pub struct RecordingRules {
    /// True if frames are taken at the times that they carry, as a camera would deliver them.
    pub is_paced: bool,
    /// The recording ends after this many seconds.
    pub seconds: Option<f64>,
    /// Time base of the frames.
    pub time_base: TimeBase,
    /// When the first frame arrived, if it was kept from before the start.
    pub first_arrived: Option<Instant>,
    /// True if the camera's automatic controls are held again after each interruption.
    pub holds_controls: bool,
}

/// A recording that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EndedRecording {
    /// Its frames and gaps.
    pub frames: u64,
    /// Why it ended, if its source was lost.
    pub source_lost: Option<String>,
}

/// Appends frames to the live recording until the source ends or is lost, the time is over (even while the source
/// is away) or `ending` begins. Frames that were captured before `ending` began and wait for a slow disk are appended too.
pub async fn record(
    agent: &Agent,
    mut source: impl FrameSource,
    rules: RecordingRules,
    ending: &Shutdown,
) -> EndedRecording {
    let seconds = rules.seconds.unwrap_or(MAX_DURATION_S).min(MAX_DURATION_S);
    let planned = Duration::try_from_secs_f64(seconds).unwrap_or_default();
    let mut timeline = Timeline::new(rules.time_base, rules.first_arrived);
    let (mut number, mut frames, mut source_lost) = (0, 0, None);
    let mut sync = interval(SYNC_INTERVAL);
    let mut syncing = BackgroundSync::default();
    let mut drain: Option<Drain> = None;
    loop {
        // A file that is read slowly has its planned end by its own times.
        let ends_by_clock = timeline.has_begun && !source.info().has_end;
        let event = tokio::select! {
            biased;
            () = ending.begun(), if drain.is_none() => { drain = Some(Drain::begin()); continue; }
            _ = sync.tick() => { syncing.begin(agent); continue; }
            event = source.next() => event,
            () = sleep_until(drain.map_or(timeline.began, |drain| drain.until)), if drain.is_some() => break,
            () = sleep_until(timeline.began + planned + END_PATIENCE), if ends_by_clock => {
                tracing::warn!(seconds, number, "the recording has reached its length while the source was away");
                break;
            }
        };
        let (frame, is_resumed) = match event {
            SourceEvent::Frame(frame) => (timeline.place(frame), false),
            SourceEvent::Resumed(frame, arrived) => {
                timeline.resume(&frame, arrived);
                (timeline.place(frame), true)
            }
            SourceEvent::Ended => break,
            SourceEvent::Lost(why) => {
                tracing::error!(why, "the source is lost; the recording ends here");
                source_lost = Some(why);
                break;
            }
        };
        if drain.as_mut().is_some_and(|drain| !drain.takes(&frame, timeline.began)) {
            break;
        }
        if frame.due_s >= seconds || number + u64::from(is_resumed) >= MAX_FRAMES {
            tracing::info!(seconds, number, "the recording has reached its length");
            break;
        }
        if is_resumed {
            append_interruption(agent, number, source.info().is_camera && !rules.holds_controls);
            number += 1;
        }
        let due = timeline.began + Duration::from_secs_f64(frame.due_s.max(0.0));
        while rules.is_paced && Instant::now() < due && !ending.is_begun() {
            tokio::select! {
                () = ending.begun() => {}
                _ = sync.tick() => syncing.begin(agent),
                () = sleep_until(due) => {}
            }
        }
        append_frame(agent, number, &frame, rules.time_base);
        number += 1;
        frames += 1; // gaps have a number as well
        agent.status().captured = frames;
        agent.notify_changed();
    }
    drop(source);
    syncing.end().await;
    block_in_place(|| end_live(agent, source_lost.as_deref()));
    agent.sync().await;
    agent.notify_changed();
    EndedRecording { frames, source_lost }
}

/// The end of a recording was requested: what was captured before is still appended.
#[derive(Clone, Copy)]
struct Drain {
    requested: Instant,
    /// From when on nothing more is expected.
    until: Instant,
}

impl Drain {
    fn begin() -> Self {
        let now = Instant::now();
        Self { requested: now, until: now + DRAIN_PATIENCE }
    }

    /// True if the frame was captured before the end was requested.
    fn takes(&mut self, frame: &CapturedFrame, began: Instant) -> bool {
        self.until = Instant::now() + DRAIN_PATIENCE;
        frame.due_s <= self.requested.saturating_duration_since(began).as_secs_f64()
    }
}

fn end_live(agent: &Agent, source_lost: Option<&str>) {
    let mut spool = agent.spool();
    if let Some(why) = source_lost
        && let Err(error) = spool.note_source_lost(why)
    {
        tracing::warn!(%error, "the spool cannot be written: after a restart the server does not hear of the lost source");
    }
    spool.end_live();
}

/// The times of a recording, over the interruptions of its source. A source that is opened again counts from 0 again.
struct Timeline {
    time_base: TimeBase,
    /// When the first frame arrived.
    began: Instant,
    has_begun: bool,
    /// Added to the times of the source, ticks and s.
    offset: (i64, f64),
    /// Latest time so far, ticks.
    latest: i64,
}

impl Timeline {
    fn new(time_base: TimeBase, first_arrived: Option<Instant>) -> Self {
        let (began, has_begun) = (first_arrived.unwrap_or_else(Instant::now), first_arrived.is_some());
        Self { time_base, began, has_begun, offset: (0, 0.0), latest: 0 }
    }

    /// The frame at its time in the recording.
    fn place(&mut self, frame: CapturedFrame) -> CapturedFrame {
        if !self.has_begun {
            (self.began, self.has_begun) = (Instant::now(), true);
        }
        let time = frame.time.saturating_add(self.offset.0);
        self.latest = self.latest.max(time);
        CapturedFrame { time, due_s: frame.due_s + self.offset.1, ..frame }
    }

    /// The source is back with this frame: it was captured as long after the first frame as it arrived after it. On a slow
    /// disk it may have waited since.
    fn resume(&mut self, frame: &CapturedFrame, arrived: Instant) {
        let (num, den) = self.time_base.fraction();
        let ticks_per_s = f64::from(den) / f64::from(num);
        let passed_s = arrived.saturating_duration_since(self.began).as_secs_f64();
        let resumed_s = passed_s.max(self.time_base.seconds(self.latest) + MIN_GAP_S);
        self.offset = ((resumed_s * ticks_per_s).round() as i64 - frame.time, resumed_s - frame.due_s);
    }
}

/// A sync that runs beside the recording, one at a time: a slow disk must not delay the camera.
#[derive(Default)]
struct BackgroundSync(Option<JoinHandle<()>>);

impl BackgroundSync {
    /// Starts a sync, unless one is running.
    fn begin(&mut self, agent: &Agent) {
        if self.0.as_ref().is_none_or(JoinHandle::is_finished) {
            let agent = agent.clone();
            self.0 = Some(tokio::spawn(async move { agent.sync().await }));
        }
    }

    /// Waits for the running sync.
    async fn end(&mut self) {
        if let Some(running) = self.0.take() {
            let _ = running.await; // a panic is logged where it happened
        }
    }
}

/// Appends the gap of an interruption.
fn append_interruption(agent: &Agent, number: u64, may_be_automatic: bool) {
    tracing::info!(number, "the source is back; the recording continues after a gap");
    if may_be_automatic {
        tracing::warn!("a camera that was unplugged may have its automatic exposure and white balance on again");
    }
    let body = RecordBody::Gap { last: number, reason: GapReason::Camera };
    append(agent, &FeedRecord { epoch: 0, number, body });
}

/// Appends a frame; a frame that cannot be sent becomes a gap.
fn append_frame(agent: &Agent, number: u64, frame: &CapturedFrame, time_base: TimeBase) {
    let body = frame.body(number, time_base);
    if let RecordBody::Gap { .. } = body {
        let (time_s, bytes) = (time_base.seconds(frame.time), frame.bytes.len());
        tracing::warn!(number, time_s, bytes, "frame replaced by a gap: damaged, too large or out of order");
    }
    append(agent, &FeedRecord { epoch: 0, number, body });
}

fn append(agent: &Agent, record: &FeedRecord<'_>) {
    if let Err(error) = block_in_place(|| agent.spool().append(record)) {
        tracing::error!(number = record.number, %error, "frame lost: the spool cannot be written");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::spool::testing;
    use crate::media::SourceInfo;

    fn frame(time: i64) -> CapturedFrame {
        CapturedFrame { time, due_s: time as f64 / 1000.0, is_key: true, bytes: vec![1] }
    }

    /// A camera whose frames wait in a queue.
    struct QueuedCamera(SourceInfo, tokio::sync::mpsc::Receiver<SourceEvent>);

    impl FrameSource for QueuedCamera {
        fn info(&self) -> &SourceInfo {
            &self.0
        }

        async fn next(&mut self) -> SourceEvent {
            self.1.recv().await.unwrap_or(SourceEvent::Ended)
        }
    }

    /// Records what waits in a queue; the first event arrived 12 s ago, and the end of the recording is requested now.
    async fn drained(agent: &Agent, events: Vec<SourceEvent>) -> EndedRecording {
        let info = SourceInfo {
            codec: crate::domain::feed::FrameCodec::Jpeg,
            size: (64, 48),
            time_base: [1, 1000].try_into().unwrap(),
            coded_from: None,
            has_end: false,
            is_file: false,
            is_camera: true,
        };
        let (queue, frames) = tokio::sync::mpsc::channel(events.len());
        for event in events {
            queue.send(event).await.unwrap();
        }
        let first_arrived = Instant::now().checked_sub(Duration::from_secs(12));
        let rules = RecordingRules {
            is_paced: false,
            seconds: None,
            time_base: info.time_base,
            first_arrived,
            holds_controls: true,
        };
        let ending = Shutdown::new();
        ending.begin();
        let ended = record(agent, QueuedCamera(info, frames), rules, &ending).await;
        drop(queue);
        ended
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn frames_that_were_captured_before_the_stop_are_recorded_and_later_ones_are_not() {
        let (_folder, spool, id) = testing::spool(1 << 20);
        let agent = Agent::new(spool);
        let queued = (0..320).map(|number| SourceEvent::Frame(frame(40 * number))); // 12.8 s at 25 Hz
        let ended = drained(&agent, queued.collect()).await;
        assert!((300..=302).contains(&ended.frames), "12 s at 25 Hz: {}", ended.frames);
        assert_eq!(agent.spool().get(id).unwrap().end, ended.frames);
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn frames_after_a_replug_that_wait_for_the_disk_are_recorded_at_the_time_of_their_arrival() {
        let (_folder, spool, id) = testing::spool(1 << 20);
        let agent = Agent::new(spool);
        let mut queued: Vec<SourceEvent> = (0..10).map(|number| SourceEvent::Frame(frame(40 * number))).collect();
        let replugged = Instant::now().checked_sub(Duration::from_secs(4)).unwrap(); // 8 s after the first frame
        queued.push(SourceEvent::Resumed(frame(7000), replugged));
        queued.extend((1..125).map(|number| SourceEvent::Frame(frame(7000 + 40 * number)))); // 5 s at 25 Hz
        let ended = drained(&agent, queued).await;
        assert!((110..=113).contains(&ended.frames), "10, a gap, and 4 s at 25 Hz: {}", ended.frames);
        let mut spool = agent.spool();
        let mut record_at = |number: u64| {
            let entry = spool.get(id).unwrap().at_or_after(number).unwrap();
            spool.read(id, entry).unwrap()
        };
        let gap = record_at(10);
        assert!(matches!(FeedRecord::read(&gap).unwrap().body, RecordBody::Gap { reason: GapReason::Camera, .. }));
        let resumed = record_at(11);
        let RecordBody::Frame { time, .. } = FeedRecord::read(&resumed).unwrap().body else { panic!("no frame") };
        assert!((7_990..8_200).contains(&time), "{time} ms");
    }

    #[test]
    fn times_continue_after_each_interruption_of_the_source() {
        let mut timeline = Timeline::new([1, 1000].try_into().unwrap(), None);
        let mut times: Vec<i64> = [0, 40, 80].map(|time| timeline.place(frame(time)).time).into();
        for first in [0, 5000] {
            timeline.resume(&frame(first), Instant::now());
            times.extend([first, first + 40].map(|time| timeline.place(frame(time)).time));
        }
        assert_eq!(times[..3], [0, 40, 80]);
        assert_eq!(times[4] - times[3], 40, "{times:?}");
        for pair in [[times[2], times[3]], [times[4], times[5]]] {
            assert!((500..5000).contains(&(pair[1] - pair[0])), "{times:?}");
        }
        let last = timeline.place(frame(5080));
        assert!((last.due_s - last.time as f64 / 1000.0).abs() < 0.001, "{last:?}");
    }
}
