//! Figures of a recording while it arrives, with the definitions of the finished session.
//!
//! **In:** the tracker's report of each frame. **Out:** [`RunningFigures::figures`]: the [`ToolFigures`] so far, which
//! [`super::judge`] compares with the limits for finished sessions. So a live page calls a tool well seen by the rule
//! that the result is judged by. **Method:** counts, sums, and a histogram of stated errors; memory does not grow with
//! the recording. A measurement that the tracker withdraws later is no longer counted. **Differs** from the finished
//! session's figures because the causal filter bridges shorter gaps, and the fulcrum of the whole recording is not
//! known yet: docs/quality_gate.md states by how much. **Leaves out** what only the whole recording shows (noise
//! floor, sizes), jumps, and what does not depend on the recording (colours, calibration).

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use super::tool::PositionError;
use super::{Figures, SessionFigures, ToolFigures};
use crate::vision::reason::MissReason;
use crate::vision::segmentation::palette::ColourSeparation;
use crate::vision::tracker::{Absence, FrameReport, ToolReport, TrocarEvidence};
use crate::vision::trajectory::Sample;

/// Figures of all tools so far.
#[derive(Clone, Debug)]
pub struct RunningFigures {
    tools: Vec<RunningTool>,
    /// Frames so far.
    frames: u64,
    /// Frames from the first with a measurement of any tool to the last.
    measured_range: u64,
    /// Frames after the last measurement of any tool.
    since_measured: u64,
    /// Time of the first frame with a measurement, s.
    first_measured_s: Option<f64>,
    /// Time of the last frame with a measurement, s.
    last_measured_s: f64,
}

impl RunningFigures {
    /// Starts without any tool seen. For each tool: is it followed by its bare shaft?
    pub fn new(are_bare: impl IntoIterator<Item = bool>) -> Self {
        let tool = |is_bare: bool| RunningTool { is_bare, ..RunningTool::default() };
        Self {
            tools: are_bare.into_iter().map(tool).collect(),
            frames: 0,
            measured_range: 0,
            since_measured: 0,
            first_measured_s: None,
            last_measured_s: 0.0,
        }
    }

    /// Adds the next frame.
    pub fn add_frame(&mut self, report: &FrameReport) {
        let is_measured = |tool: &ToolReport| tool.filtered.is_some_and(|sample| sample.is_observed());
        let is_any_measured = report.tools.iter().any(is_measured);
        self.frames += 1;
        for (tool, seen) in self.tools.iter_mut().zip(&report.tools) {
            tool.add_frame(seen, report.time_s, self.measured_range > 0);
        }
        self.since_measured += u64::from(self.measured_range > 0);
        if is_any_measured {
            self.measured_range += std::mem::take(&mut self.since_measured).max(1);
            self.first_measured_s.get_or_insert(report.time_s);
            self.last_measured_s = report.time_s;
            self.tools.iter_mut().for_each(RunningTool::count_left_view);
        }
    }

    /// The figures so far; `names` and `trocars` have one entry per tool. Figures that are not known yet are `None`.
    pub fn figures(&self, names: &[String], trocars: &[TrocarEvidence]) -> Figures {
        let tools = self.tools.iter().zip(names).zip(trocars);
        let tools: Vec<ToolFigures> = tools.map(|((tool, name), trocar)| self.tool(tool, name, *trocar)).collect();
        let observed = tools.iter().map(|tool| tool.observed).sum();
        Figures { session: SessionFigures::of_counts(self.frames, observed), tools }
    }

    fn tool(&self, tool: &RunningTool, name: &str, trocar: TrocarEvidence) -> ToolFigures {
        let moved = tool.spread_across_mm().filter(|_| trocar != TrocarEvidence::Shown);
        let begin_s = self.first_measured_s;
        ToolFigures {
            tool: name.to_owned(),
            observed: tool.observed,
            coverage: share(tool.observed, self.measured_range),
            coverage_while_there: None,
            coverage_of_recording: share(tool.observed, self.frames),
            predicted_share: share(tool.predicted, tool.predicted + tool.observed),
            left_view_share: share(tool.left_view, self.measured_range),
            lost_share: share(tool.lost, self.frames.saturating_sub(tool.left_anywhere)),
            longest_lost: None,
            lost_frames: BTreeMap::new(),
            longest_gap_s: begin_s.map(|begin_s| tool.longest_gap_s(begin_s, self.last_measured_s)),
            border_residual_px: (tool.fitted > 0).then(|| (tool.residual_squares / tool.fitted as f64).sqrt()),
            trocar: Some(trocar),
            moved_without_trocar_mm: moved,
            effective_diameter: None,
            is_bare: tool.is_bare && tool.observed > 0,
            size_mismatch: None,
            rejected_share: share(tool.rejected, tool.rejected + tool.observed),
            fastest_step: None,
            sharpest_turn: None,
            noise_floor: None,
            error_bar: tool.errors.position_error(),
            colour: ColourSeparation::default(),
            fulcrum: None,
            port_shift: None,
            has_port_moved: false,
            never_in_picture: tool.observed == 0 && tool.lost == 0,
        }
    }
}

fn share(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// What is known of one tool so far.
#[derive(Clone, Debug, Default)]
struct RunningTool {
    is_bare: bool,
    observed: u64,
    predicted: u64,
    rejected: u64,
    /// Frames without a position in the whole recording, by cause.
    left_anywhere: u64,
    lost: u64,
    /// Frames out of view between the first and the last measurement of any tool, and those since the last.
    left_view: u64,
    left_since_measured: u64,
    last_seen_s: Option<f64>,
    longest_gap_s: f64,
    first_seen_s: Option<f64>,
    fitted: u64,
    residual_squares: f64,
    tips: Vector3<f64>,
    squares: Matrix3<f64>,
    axes: Vector3<f64>,
    errors: ErrorHistogram,
}

impl RunningTool {
    fn add_frame(&mut self, report: &ToolReport, time_s: f64, has_begun: bool) {
        if report.has_withdrawn {
            let lost = self.lost + self.observed + self.predicted;
            let (left_view, left_anywhere, is_bare) = (self.left_view, self.left_anywhere, self.is_bare);
            *self = Self { is_bare, lost, left_view, left_anywhere, ..Self::default() };
        }
        if let Ok(measured) = &report.outcome {
            self.fitted += 1;
            self.residual_squares += measured.border_residual_px * measured.border_residual_px;
        }
        self.rejected += u64::from(report.outcome.as_ref().err() == Some(&MissReason::GateRejected));
        match (&report.filtered, report.absence) {
            (Some(sample), _) if sample.is_observed() => self.add_measurement(sample, time_s),
            (Some(_), _) => self.predicted += 1,
            (None, Some(Absence::LeftView)) => {
                self.left_anywhere += 1;
                self.left_since_measured += u64::from(has_begun);
            }
            (None, _) => self.lost += 1,
        }
    }

    fn add_measurement(&mut self, sample: &Sample, time_s: f64) {
        self.observed += 1;
        let gap_s = self.last_seen_s.map_or(0.0, |last_s| time_s - last_s);
        self.longest_gap_s = self.longest_gap_s.max(gap_s);
        self.first_seen_s.get_or_insert(time_s);
        self.last_seen_s = Some(time_s);
        self.tips += sample.tip_mm.coords;
        self.squares += sample.tip_mm.coords * sample.tip_mm.coords.transpose();
        self.axes += sample.axis.unwrap_or_default();
        if let Some(stated) = sample.covariance_mm2 {
            self.errors.add(stated.matrix().trace().sqrt());
        }
    }

    fn count_left_view(&mut self) {
        self.left_view += std::mem::take(&mut self.left_since_measured);
    }

    /// Longest time without a measurement between two times, s.
    fn longest_gap_s(&self, begin_s: f64, end_s: f64) -> f64 {
        let Some((first_s, last_s)) = self.first_seen_s.zip(self.last_seen_s) else { return end_s - begin_s };
        self.longest_gap_s.max(first_s - begin_s).max(end_s - last_s)
    }

    /// Distance of the positions from their mean across the mean axis, root mean square, mm.
    fn spread_across_mm(&self) -> Option<f64> {
        let count = self.observed as f64;
        let mean = self.tips / count;
        let spread = self.squares / count - mean * mean.transpose();
        let along = self.axes.try_normalize(1e-9).unwrap_or_default();
        (self.observed > 0).then(|| (spread.trace() - along.dot(&(spread * along))).max(0.0).sqrt())
    }
}

/// Number of positions by their stated standard deviation, in steps of a tenth of its size.
#[derive(Clone, Debug)]
struct ErrorHistogram([u64; Self::BINS]);

impl ErrorHistogram {
    const BINS: usize = 96;
    /// Upper end of the first bin, mm.
    const FIRST_MM: f64 = 0.02;
    /// Ratio of the ends of adjacent bins. The last bin begins at 170 mm.
    const RATIO: f64 = 1.1;

    fn add(&mut self, sigma_mm: f64) {
        let bin = ((sigma_mm / Self::FIRST_MM).ln() / Self::RATIO.ln()).ceil();
        self.0[(bin.max(0.0) as usize).min(Self::BINS - 1)] += 1;
    }

    fn position_error(&self) -> Option<PositionError> {
        Some(PositionError { median_mm: self.quantile_mm(0.5)?, p95_mm: self.quantile_mm(0.95)? })
    }

    /// The middle of the bin that holds the quantile.
    fn quantile_mm(&self, share: f64) -> Option<f64> {
        let rank = share * self.0.iter().sum::<u64>() as f64;
        let mut below = 0;
        let bin = self.0.iter().position(|count| {
            below += count;
            below > 0 && below as f64 >= rank
        })?;
        Some(Self::FIRST_MM * Self::RATIO.powf(bin as f64 - 0.5))
    }
}

impl Default for ErrorHistogram {
    fn default() -> Self {
        Self([0; Self::BINS])
    }
}

#[cfg(test)]
mod tests;
