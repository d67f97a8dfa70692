//! Figures of the recording itself: its frame times, whether it is complete, whether its light changed.

use super::QualityInput;
use super::box_match::BoxMatch;
use super::moved_during::MovedDuring;
use super::ports::{Displacement, PortPlacement};
use crate::numbers::quantile::quantile;
use crate::vision::tracker::LightSample;
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

/// A longer interval between two frames is an interruption rather than dropped frames, s.
const BREAK_S: f64 = 1.0;

/// A median brightness below this share of the brightest moment is that of a black picture: a change relative to it would
/// be large without meaning anything.
const BLACK_SHARE: f64 = 0.1;

/// Length of the beginning and of the end, s. A tool that moves there was recorded in mid-motion.
const EDGE_S: f64 = 0.5;

/// A tool seen within this time of the recording's beginning or end was present there, s.
const PRESENT_S: f64 = 0.2;

/// The recording itself. `None` if the input does not contain the figure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SessionFigures {
    /// Number of frames.
    pub frames: u64,
    /// Number of measurements of all tools.
    pub observed: u64,
    /// Frames a second, from the median interval.
    pub frame_rate_hz: Option<f64>,
    /// Share of the frames that are missing in intervals of up to a second.
    pub dropped_share: Option<f64>,
    /// Longest interval between two frames, s.
    pub longest_interval_s: Option<f64>,
    /// Share of the frames that the file states but that could not be decoded; `None` if it states no number.
    pub cut_share: Option<f64>,
    /// Share of the frames that were recorded interlaced.
    pub interlaced_share: Option<f64>,
    /// Mean speed of the fastest tool as the recording begins, mm/s; `None` if no tool is present.
    pub first_speed_mm_s: Option<f64>,
    /// The same as the recording ends.
    pub last_speed_mm_s: Option<f64>,
    /// Largest deviation of the picture's brightness from its median over the session, as a share of the median.
    pub exposure_drift: Option<f64>,
    /// When the light was switched on or off, s; `None` if it was not, or changed slowly.
    pub light_step_s: Option<f64>,
    /// Largest deviation of the picture's white from its median over the session, in codes of 224.
    pub white_drift_codes: Option<f64>,
    /// RMS reprojection error of the camera's calibration, pixels.
    pub calibration_rms_px: Option<f64>,
    /// How far the camera has moved since earlier sessions; `None` if it has not moved or this is unknown.
    pub camera_shift: Option<Displacement>,
    /// How far the camera moved during the recording; `None` if its surroundings do not show this.
    pub moved_during: Option<MovedDuring>,
    /// Whether the recording shows its box; `None` for a recording that belongs to no box.
    pub box_match: Option<BoxMatch>,
}

impl SessionFigures {
    /// Figures while only the numbers of frames and of measurements are known.
    pub(super) fn of_counts(frames: u64, observed: u64) -> Self {
        Self {
            frames,
            observed,
            frame_rate_hz: None,
            dropped_share: None,
            longest_interval_s: None,
            cut_share: None,
            interlaced_share: None,
            first_speed_mm_s: None,
            last_speed_mm_s: None,
            exposure_drift: None,
            light_step_s: None,
            white_drift_codes: None,
            calibration_rms_px: None,
            camera_shift: None,
            moved_during: None,
            box_match: None,
        }
    }
}

pub(super) fn measure(
    evidence: &QualityInput<'_>,
    placement: &PortPlacement,
    box_match: Option<BoxMatch>,
) -> SessionFigures {
    let path = evidence.smoothed;
    let frames = evidence.tracker.map_or_else(|| frame_span(path), |quality| quality.frames);
    let intervals = intervals(path);
    let median_s = quantile(intervals.clone(), 0.5).filter(|median_s| *median_s > 0.0);
    let light: &[LightSample] = evidence.tracker.map_or(&[], |quality| &quality.light);
    let recorded = path.frame_times_s.first().zip(path.frame_times_s.last());
    let [first_speed_mm_s, last_speed_mm_s] =
        recorded.map_or([None, None], |(begin, end)| [(*begin, 1.0), (*end, -1.0)].map(|edge| edge_speed(path, edge)));
    SessionFigures {
        frames,
        observed: path.samples.iter().filter(|s| s.state == SampleState::Observed).count() as u64,
        frame_rate_hz: median_s.map(|median_s| 1.0 / median_s),
        dropped_share: median_s.map(|median_s| dropped_share(&intervals, median_s)),
        longest_interval_s: (!intervals.is_empty()).then(|| intervals.iter().copied().fold(0.0, f64::max)),
        cut_share: evidence.frames_expected.filter(|&n| n > 0).map(|n| 1.0 - frames.min(n) as f64 / n as f64),
        interlaced_share: evidence.frames_interlaced.filter(|_| frames > 0).map(|n| n as f64 / frames as f64),
        first_speed_mm_s,
        last_speed_mm_s,
        exposure_drift: exposure_drift(light),
        light_step_s: light_step_s(light),
        white_drift_codes: white_drift_codes(light),
        calibration_rms_px: evidence.calibration_rms_px,
        camera_shift: placement.camera,
        moved_during: evidence
            .tracker
            .and_then(|quality| MovedDuring::of(&quality.view_shifts, &path.samples, &path.frame_times_s)),
        box_match,
    }
}

/// Number of frames from the first row to the last.
fn frame_span(path: &Trajectory) -> u64 {
    path.samples.first().zip(path.samples.last()).map_or(0, |(first, last)| last.frame - first.frame + 1)
}

/// Intervals between adjacent frames, s: of all frames if their times are known, otherwise of those with rows.
fn intervals(path: &Trajectory) -> Vec<f64> {
    if path.frame_times_s.is_empty() {
        let neighbours = path.samples.windows(2).filter(|pair| pair[1].frame == pair[0].frame + 1);
        return neighbours.map(|pair| pair[1].time_s - pair[0].time_s).collect();
    }
    path.frame_times_s.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

fn dropped_share(intervals: &[f64], median_s: f64) -> f64 {
    let lost = |interval: &f64| (interval / median_s).round() - 1.0;
    let dropped = intervals.iter().filter(|i| **i < BREAK_S && **i > 1.5 * median_s).map(lost).fold(0.0, |a, b| a + b);
    dropped / (dropped + intervals.len() as f64 + 1.0)
}

/// Mean speed of the fastest tool near one end of the recording, given the time of the end, s, and the direction
/// inwards.
fn edge_speed(path: &Trajectory, (edge_s, inwards): (f64, f64)) -> Option<f64> {
    let depth_s = |sample: &Sample| (sample.time_s - edge_s) * inwards;
    let speed = |tool: usize| {
        let near: Vec<&Sample> = path.of_tool(tool).filter(|s| depth_s(s) <= EDGE_S).collect();
        let still_there = near.iter().any(|s| depth_s(s) <= PRESENT_S);
        let speeds: Vec<f64> = near.iter().filter_map(|s| s.velocity_mm_s).map(|v| v.norm()).collect();
        (still_there && !speeds.is_empty()).then(|| speeds.iter().sum::<f64>() / speeds.len() as f64)
    };
    (0..path.tools.len()).filter_map(speed).reduce(f64::max)
}

/// The largest deviation from the median, and the median.
fn drift(values: impl Iterator<Item = f64> + Clone) -> Option<(f64, f64)> {
    let median = quantile(values.clone().collect(), 0.5)?;
    Some((values.map(|value| (value - median).abs()).fold(0.0, f64::max), median))
}

/// The largest change of brightness, relative to the median; in a picture that is black for most of the time, that of the
/// median relative to the brightest moment.
fn exposure_drift(light: &[LightSample]) -> Option<f64> {
    let ratios = light.iter().map(|sample| sample.luma_ratio);
    let (drift, median) = drift(ratios.clone())?;
    let brightest = ratios.fold(0.0, f64::max);
    match median {
        median if median > BLACK_SHARE * brightest => Some(drift / median),
        median => (brightest > 0.0).then(|| (brightest - median) / brightest),
    }
}

/// When the light was switched on or off, s: the first step between two samples of at least half of the whole range.
/// `None` if the light changes slowly.
fn light_step_s(light: &[LightSample]) -> Option<f64> {
    let ratios = light.iter().map(|sample| sample.luma_ratio);
    let range = ratios.clone().fold(0.0, f64::max) - ratios.fold(f64::INFINITY, f64::min);
    let is_step = |pair: &&[LightSample]| (pair[1].luma_ratio - pair[0].luma_ratio).abs() >= 0.5 * range;
    light.windows(2).filter(|_| range > 0.0).find(is_step).map(|pair| pair[1].time_s)
}

fn white_drift_codes(light: &[LightSample]) -> Option<f64> {
    const CODES: f64 = 224.0;
    let of = |axis: usize| drift(light.iter().map(move |l| l.chroma_shift[axis])).map(|(drift, _)| drift);
    Some(CODES * of(0)?.hypot(of(1)?))
}
