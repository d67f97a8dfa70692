//! Where the time goes: CPU and wall time of each stage of a run.

use std::io::{self, Write};
use std::time::Instant;

use rustix::time::ClockId;

/// What the main thread passes through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// Decodes, with the decoder's threads, what has marks on it.
    DecodingMarked,
    /// Reads marks and collects their pixels.
    Samples,
    /// Opens the recording and lets FFmpeg probe it.
    Opening,
    /// Builds the colour table.
    Preparing,
    /// Waits for the thread that decodes.
    Waiting,
    /// Looks at frames.
    Tracking,
    /// Fulcrum, filter and smoother over the whole recording.
    Finishing,
    /// Writes the path.
    Writing,
}

const STAGES: [(Stage, &str); 8] = [
    (Stage::DecodingMarked, "decode_marked_frames"),
    (Stage::Samples, "collect_samples"),
    (Stage::Opening, "open"),
    (Stage::Preparing, "prepare_tracker"),
    (Stage::Waiting, "wait_for_decoder"),
    (Stage::Tracking, "track"),
    (Stage::Finishing, "fulcrum_and_smoother"),
    (Stage::Writing, "write"),
];

/// CPU and wall time per stage.
///
/// All our own stages run on the thread that keeps this clock, and none of its time escapes the laps: what the process
/// used besides is the decoder's threads and the program's start. Unlike time on the wall, that is the same on a busy
/// machine. Wall times of the stages add up to the whole run's, as decoding beside the tracking shows only where it is
/// waited for.
pub(super) struct StageClock {
    began: Instant,
    last: Instant,
    last_cpu_ms: f64,
    spent: [Spent; STAGES.len()],
    /// CPU time of each look at a frame: single precision, for an hour has 90,000 of them.
    tracking_cpu_ms: Vec<f32>,
}

#[derive(Clone, Copy, Default)]
struct Spent {
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

    /// Puts the time since the last lap down to a stage.
    pub(super) fn lap_of(&mut self, stage: Stage) {
        let (now, now_cpu_ms) = (Instant::now(), cpu_ms(ClockId::ThreadCPUTime));
        let lap_cpu_ms = now_cpu_ms - self.last_cpu_ms;
        let spent = &mut self.spent[stage as usize];
        spent.cpu_ms += lap_cpu_ms;
        spent.wall_ms += (now - self.last).as_secs_f64() * 1e3;
        if stage == Stage::Tracking {
            self.tracking_cpu_ms.push(lap_cpu_ms as f32);
        }
        (self.last, self.last_cpu_ms) = (now, now_cpu_ms);
    }

    /// Every frame is to be looked at once more; what that took so far stays with its stage.
    pub(super) fn track_again(&mut self) {
        self.tracking_cpu_ms.clear();
    }

    pub(super) fn save(&self, mut out: impl Write) -> io::Result<()> {
        let frames = self.tracking_cpu_ms.len();
        let cpu = |stage: Stage| self.spent[stage as usize].cpu_ms;
        let own: f64 =
            self.spent.iter().map(|spent| spent.cpu_ms).sum::<f64>() - cpu(Stage::DecodingMarked) - cpu(Stage::Opening);
        let wall: serde_json::Map<String, serde_json::Value> =
            STAGES.iter().map(|(stage, name)| ((*name).into(), self.spent[*stage as usize].wall_ms.into())).collect();
        let text = serde_json::json!({
            "frames": frames,
            "own_cpu_ms_per_frame": own / frames.max(1) as f64,
            "track_cpu_ms_per_frame": summary(&self.tracking_cpu_ms),
            "once_cpu_ms": {
                "collect_samples": cpu(Stage::Samples),
                "prepare_tracker": cpu(Stage::Preparing),
                "fulcrum_and_smoother": cpu(Stage::Finishing),
                "write": cpu(Stage::Writing),
            },
            "decoding_and_start_cpu_ms": cpu_ms(ClockId::ProcessCPUTime) - own,
            "wall_ms": self.began.elapsed().as_secs_f64() * 1e3,
            "wall_ms_of": wall,
        });
        writeln!(out, "{text:#}")?;
        out.flush() // a full disk would go unnoticed when a buffer is dropped
    }
}

/// CPU time so far, ms.
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
