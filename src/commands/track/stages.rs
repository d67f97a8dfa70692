//! CPU and wall time of each stage of a run.

use std::io::{self, Write};
use std::time::Instant;

use rustix::time::ClockId;

/// Stages of the main thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TrackStage {
    /// Decodes the frames with marks, with the decoder's threads.
    DecodingMarked,
    /// Reads marks and collects their pixels.
    Samples,
    /// Decodes frames that show the box, for tools without tape, with the decoder's threads.
    DecodingScene,
    /// Opens the recording and lets FFmpeg probe it.
    Opening,
    /// Builds the colour table, and learns the box for tools without tape.
    Preparing,
    /// Waits for the thread that decodes.
    Waiting,
    /// Tracks frames.
    Tracking,
    /// Runs fulcrum, filter and smoother over the whole recording.
    Finishing,
    /// Writes the path.
    Writing,
}

const STAGES: [(TrackStage, &str); 9] = [
    (TrackStage::DecodingMarked, "decode_marked_frames"),
    (TrackStage::Samples, "collect_samples"),
    (TrackStage::DecodingScene, "decode_scene_frames"),
    (TrackStage::Opening, "open"),
    (TrackStage::Preparing, "prepare_tracker"),
    (TrackStage::Waiting, "wait_for_decoder"),
    (TrackStage::Tracking, "track"),
    (TrackStage::Finishing, "fulcrum_and_smoother"),
    (TrackStage::Writing, "write"),
];

/// CPU and wall time per stage.
///
/// All stages except decoding run on the thread that owns this clock, and every moment of it belongs to a lap. The
/// remaining CPU time of the process is that of the decoder's threads and of the program's start. Unlike wall time, CPU
/// time does not depend on other load of the machine. The wall times of the stages add up to that of the run: decoding
/// in parallel appears only as [`TrackStage::Waiting`].
pub(super) struct StageClock {
    began: Instant,
    last: Instant,
    last_cpu_ms: f64,
    spent: [StageTime; STAGES.len()],
    /// CPU time of tracking each frame. Single precision, because an hour has 90,000 frames.
    tracking_cpu_ms: Vec<f32>,
}

#[derive(Clone, Copy, Default)]
struct StageTime {
    cpu_ms: f64,
    wall_ms: f64,
}

impl StageClock {
    pub(super) fn start() -> Self {
        let now = Instant::now();
        Self {
            began: now,
            last: now,
            last_cpu_ms: cpu_ms(ClockId::ThreadCPUTime),
            spent: Default::default(),
            tracking_cpu_ms: Vec::new(),
        }
    }

    /// Adds the time since the last lap to a stage.
    pub(super) fn add_lap(&mut self, stage: TrackStage) {
        let (now, now_cpu_ms) = (Instant::now(), cpu_ms(ClockId::ThreadCPUTime));
        let lap_cpu_ms = now_cpu_ms - self.last_cpu_ms;
        let spent = &mut self.spent[stage as usize];
        spent.cpu_ms += lap_cpu_ms;
        spent.wall_ms += (now - self.last).as_secs_f64() * 1e3;
        if stage == TrackStage::Tracking {
            self.tracking_cpu_ms.push(lap_cpu_ms as f32);
        }
        (self.last, self.last_cpu_ms) = (now, now_cpu_ms);
    }

    /// Clears the times per frame before all frames are tracked again. The time spent so far stays with its stage.
    pub(super) fn restart_tracking(&mut self) {
        self.tracking_cpu_ms.clear();
    }

    pub(super) fn save(&self, mut out: impl Write) -> io::Result<()> {
        let frames = self.tracking_cpu_ms.len();
        let cpu = |stage: TrackStage| self.spent[stage as usize].cpu_ms;
        let own: f64 = self.spent.iter().map(|spent| spent.cpu_ms).sum::<f64>()
            - cpu(TrackStage::DecodingMarked)
            - cpu(TrackStage::DecodingScene)
            - cpu(TrackStage::Opening);
        let wall: serde_json::Map<String, serde_json::Value> =
            STAGES.iter().map(|(stage, name)| ((*name).into(), self.spent[*stage as usize].wall_ms.into())).collect();
        let text = serde_json::json!({
            "frames": frames,
            "own_cpu_ms_per_frame": own / frames.max(1) as f64,
            "track_cpu_ms_per_frame": summary(&self.tracking_cpu_ms),
            "once_cpu_ms": {
                "collect_samples": cpu(TrackStage::Samples),
                "prepare_tracker": cpu(TrackStage::Preparing),
                "fulcrum_and_smoother": cpu(TrackStage::Finishing),
                "write": cpu(TrackStage::Writing),
            },
            "decoding_and_start_cpu_ms": cpu_ms(ClockId::ProcessCPUTime) - own,
            "wall_ms": self.began.elapsed().as_secs_f64() * 1e3,
            "wall_ms_of": wall,
        });
        writeln!(out, "{text:#}")?;
        out.flush() // dropping the buffer would hide the error of a full disk
    }
}

/// CPU time used so far, ms.
fn cpu_ms(clock: ClockId) -> f64 {
    let time = rustix::time::clock_gettime(clock);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

/// Median, 95th percentile and mean.
fn summary(laps: &[f32]) -> serde_json::Value {
    let mut sorted = laps.to_vec();
    sorted.sort_by(f32::total_cmp);
    let at = |share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0);
    let mean = laps.iter().copied().map(f64::from).sum::<f64>() / laps.len().max(1) as f64;
    serde_json::json!({ "median": at(0.5), "p95": at(0.95), "mean": mean })
}
