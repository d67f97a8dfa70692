//! Applies users' edits to a recording's paths: trims both ends and exchanges two tools' names over a span. The stored
//! paths stay unchanged; scores are computed from the edited ones.
//!
//! **In:** [`SessionPaths`], the edits in force, and why each tool was not measured on each frame ([`Unmeasured`]).
//! **Out:** the paths and the tracker's summary as if only the remaining part had been recorded, under the new names.
//! Frames keep their numbers and times. Counts, gaps, light and shifts of the view cover the remaining part only.
//! Figures for the whole recording stay: residuals of borders and depth, position of the trocar, separation of the
//! colours. If the camera moved during the recording and a part of it is cut off, the position of the trocar is left
//! out: it was fitted to poses from both places of the camera. A bare shaft then no longer shows its trocar, but may
//! have one ([`ToolQuality::trocar`]); the evidence of a tape stays. Counts of frames that are interlaced or missing in
//! the container are scaled by the share of frames that remain.

mod rows;

use std::collections::BTreeMap;

use serde::Deserialize;

pub use rows::EditedRows;

use super::paths::SessionPaths;
use super::protocol::{QualitySummary, SeenRow};
use crate::domain::edit::{EditChange, EditsInForce, kept_span};
use crate::domain::files::quoted_tool_name;
use crate::domain::text::Invalid;
use crate::motion::quality::MovedDuring;
use crate::vision::reason::MissReason;
use crate::vision::tracker::{Absence, Gap, ToolQuality};
use crate::vision::trajectory::{Cut, Sample};

/// Shortest recording that trimming may leave, s: a shorter one is no practice, and no feature could be measured.
pub const MIN_KEPT_S: f64 = 1.0;

/// The span kept where nothing is trimmed, s.
const WHOLE_RECORDING: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Frame and tool of each measurement that failed, and why.
pub type Unmeasured = Vec<(u64, u32, MissReason)>;

/// The unmeasured frames in a child's output.
pub fn unmeasured(seen: &[SeenRow]) -> Unmeasured {
    seen.iter().filter_map(|row| Some((row.frame, row.tool, row.reason?))).collect()
}

/// The unmeasured frames in stored diagnostics; empty if the file cannot be read.
pub fn unmeasured_of_diagnostics(json: &[u8]) -> Unmeasured {
    #[derive(Deserialize)]
    struct ReasonDocument {
        columns: ReasonColumns,
    }
    #[derive(Deserialize)]
    struct ReasonColumns {
        frame: Vec<u64>,
        tool: Vec<u32>,
        reason: Vec<Option<String>>,
    }
    let named = |name: &str| MissReason::ALL.into_iter().find(|reason| reason.name() == name);
    let Ok(ReasonDocument { columns }) = serde_json::from_slice(json) else { return Vec::new() };
    let rows = columns.frame.into_iter().zip(columns.tool).zip(columns.reason);
    rows.filter_map(|((frame, tool), reason)| Some((frame, tool, named(&reason?)?))).collect()
}

/// The paths with these edits applied. Without edits they are unchanged.
pub fn apply_edits(
    paths: &SessionPaths,
    changes: &[EditChange],
    unmeasured: &[(u64, u32, MissReason)],
) -> SessionPaths {
    if changes.is_empty() {
        return paths.clone();
    }
    let span = kept_span(changes).unwrap_or(WHOLE_RECORDING);
    let swaps = Swaps::of(&paths.tools, changes);
    let rows = |rows: &[Sample]| {
        let mut rows: Vec<Sample> = rows.iter().filter(|row| is_within(row.time_s, span)).copied().collect();
        rows.iter_mut().for_each(|row| row.tool = swaps.name_at(row.tool as u32, row.time_s) as usize);
        rows.sort_by_key(|row| (row.frame, row.tool));
        rows
    };
    let mut edited = SessionPaths {
        tools: paths.tools.clone(),
        frame_times_s: paths.frame_times_s.iter().copied().filter(|time_s| is_within(*time_s, span)).collect(),
        raw: rows(&paths.raw),
        filtered: rows(&paths.filtered),
        smoothed: rows(&paths.smoothed),
        tracking: paths.tracking.clone(),
        cuts: swaps.cuts(
            paths
                .smoothed
                .iter()
                .map(|row| (row.tool as u32, row.time_s))
                .filter(|(_, time_s)| is_within(*time_s, span)),
        ),
    };
    if let Some(tracking) = &mut edited.tracking {
        let whole = tracking.quality.frames;
        tracking.quality = remaining_summary(&tracking.quality, (paths, &edited.smoothed), (span, &swaps), unmeasured);
        tracking.frames_expected = tracking.frames_expected.map(|n| scale_count(n, tracking.quality.frames, whole));
    }
    edited
}

/// For the recording's beginning and end: true if these edits cut it off.
pub fn trimmed_ends(paths: &SessionPaths, changes: &[EditChange]) -> [bool; 2] {
    let kept = kept_span(changes).zip(recorded_span(paths));
    kept.map_or([false; 2], |([from, to], [first, last])| [from > first, to < last])
}

/// Number of frames left of an imported path: the frames that have a row of any tool.
pub fn count_remaining_frames(paths: &SessionPaths, frames: u64, changes: &[EditChange]) -> u64 {
    if kept_span(changes).is_none() {
        return frames;
    }
    let mut seen: Vec<u64> = paths.smoothed.iter().map(|row| row.frame).collect();
    seen.dedup();
    seen.len() as u64
}

/// Checks a new edit against these paths and the edits in force, and clips its span to the recording.
///
/// # Errors
/// The edit names an unknown tool, lies outside the recording, changes nothing, or leaves nothing.
pub fn check_edit(paths: &SessionPaths, in_force: &EditsInForce, new: EditChange) -> Result<EditChange, Invalid> {
    let Some([first, last]) = recorded_span(paths) else {
        return Err(Invalid::new("from_s", "cannot be met: the recording has no path"));
    };
    let within = |[from, to]: [f64; 2]| {
        if from < last && to > first {
            return Ok([from.max(first), to.min(last)]);
        }
        Err(Invalid::new(
            "from_s",
            format!("and `to_s` lie outside the recording, which is from {first:.2} to {last:.2} s"),
        ))
    };
    match new {
        EditChange::Retime(_) | EditChange::SetAside | EditChange::ThisBox | EditChange::OtherBox => Ok(new),
        EditChange::Swap(tools, span) => {
            if let Some(unknown) = tools.iter().find(|tool| !paths.tools.contains(tool)) {
                let (unknown, known) = (quoted_tool_name(unknown), paths.tools.join("`, `"));
                return Err(Invalid::new("tools", format!("names {unknown}; the session's tools are `{known}`")));
            }
            let span = within(span)?;
            let has_rows = paths.smoothed.iter().any(|row| is_within(row.time_s, span));
            if has_rows {
                Ok(EditChange::Swap(tools, span))
            } else {
                Err(Invalid::new("from_s", "and `to_s` have no path between them"))
            }
        }
        EditChange::Trim(span) => {
            let span = within(span)?;
            if span == [first, last] {
                return Err(Invalid::new("from_s", "and `to_s` are the whole recording: nothing would be cut off"));
            }
            let all: Vec<EditChange> = in_force.changes.iter().cloned().chain([EditChange::Trim(span)]).collect();
            let [from, to] = kept_span(&all).unwrap_or(span);
            let has_rows = paths.smoothed.iter().any(|row| row.is_observed() && is_within(row.time_s, [from, to]));
            if to - from >= MIN_KEPT_S && has_rows {
                return Ok(EditChange::Trim(span));
            }
            let why = format!(
                "would leave too little: keep at least {MIN_KEPT_S} s of what other edits keep, with a tool in it"
            );
            Err(Invalid::new("to_s", why))
        }
    }
}

/// First and last time of a recording, s.
fn recorded_span(paths: &SessionPaths) -> Option<[f64; 2]> {
    let ends = |first: Option<f64>, last: Option<f64>| Some([first?, last?]);
    let rows = &paths.smoothed;
    ends(paths.frame_times_s.first().copied(), paths.frame_times_s.last().copied())
        .or_else(|| ends(rows.first().map(|row| row.time_s), rows.last().map(|row| row.time_s)))
}

fn is_within(time_s: f64, [from, to]: [f64; 2]) -> bool {
    (from..=to).contains(&time_s)
}

fn scale_count(number: u64, part: u64, whole: u64) -> u64 {
    if whole == 0 { number } else { (number as f64 * part as f64 / whole as f64).round() as u64 }
}

/// Which tools exchange names, and over which spans.
#[derive(Clone, Debug)]
pub struct Swaps(Vec<([u32; 2], [f64; 2])>);

impl Swaps {
    /// The swaps among these edits of a session with these tools.
    pub fn of(tools: &[String], changes: &[EditChange]) -> Self {
        let index = |name: &String| tools.iter().position(|tool| tool == name).map(|index| index as u32);
        let swap = |change: &EditChange| match change {
            EditChange::Swap([one, other], span) => Some(([index(one)?, index(other)?], *span)),
            _ => None,
        };
        Self(changes.iter().filter_map(swap).collect())
    }

    /// True if no names are exchanged.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The index under which a tool appears at this time.
    pub fn name_at(&self, tool: u32, time_s: f64) -> u32 {
        let in_time = self.0.iter().filter(|(_, span)| is_within(time_s, *span));
        in_time.fold(tool, |tool, ([one, other], _)| match tool {
            t if t == *one => *other,
            t if t == *other => *one,
            t => t,
        })
    }

    /// Times at which a name passes from one tracked tool to another. `rows` are tracked indices with times, in order
    /// of time.
    fn cuts(&self, rows: impl Iterator<Item = (u32, f64)>) -> Vec<Cut> {
        let mut tracked_as = BTreeMap::new();
        let cut = |(tool, time_s): (u32, f64)| {
            let name = self.name_at(tool, time_s);
            let before = tracked_as.insert(name, tool);
            before.is_some_and(|before| before != tool).then_some(Cut { tool: name as usize, time_s })
        };
        rows.filter_map(cut).collect()
    }
}

/// The tracker's summary of the remaining part.
fn remaining_summary(
    whole: &QualitySummary,
    (paths, smoothed): (&SessionPaths, &[Sample]),
    (span, swaps): ([f64; 2], &Swaps),
    unmeasured: &[(u64, u32, MissReason)],
) -> QualitySummary {
    // Frames are numbered from 0, and each has a time.
    let times = &paths.frame_times_s;
    let is_kept = |frame: u64| times.get(frame as usize).is_some_and(|time_s| is_within(*time_s, span));
    let frames = times.iter().filter(|time_s| is_within(**time_s, span)).count() as u64;
    let name_at = |tool: u32, frame: u64| times.get(frame as usize).map_or(tool, |time_s| swaps.name_at(tool, *time_s));
    let mut counts = vec![[0u64; 2]; whole.tools.len()];
    for row in smoothed {
        if let Some(count) = counts.get_mut(row.tool) {
            count[usize::from(!row.is_observed())] += 1;
        }
    }
    let mut reasons = vec![BTreeMap::<MissReason, u64>::new(); whole.tools.len()];
    for (frame, tool, reason) in unmeasured.iter().filter(|(frame, ..)| is_kept(*frame)) {
        if let Some(of_tool) = reasons.get_mut(name_at(*tool, *frame) as usize) {
            *of_tool.entry(*reason).or_default() += 1;
        }
    }
    let mut gaps = vec![Vec::new(); whole.tools.len()];
    for (index, tool) in whole.tools.iter().enumerate() {
        for &Gap { first, last, absence } in &tool.gaps {
            let frames = (first..=last).filter(|frame| is_kept(*frame));
            frames.for_each(|frame| add_to_gaps(&mut gaps, name_at(index as u32, frame), (frame, absence)));
        }
    }
    gaps.iter_mut().for_each(|of_tool| of_tool.sort_by_key(|gap| gap.first));
    let has_moved = || MovedDuring::of(&whole.view_shifts, &paths.smoothed, times).is_some_and(|of| of.is_movement());
    let is_of_two_places = frames < whole.frames && has_moved();
    let tool = |(index, tool): (usize, &ToolQuality)| {
        let [observed, predicted] = counts[index];
        ToolQuality {
            observed,
            predicted,
            missing: frames.saturating_sub(observed + predicted),
            reasons: std::mem::take(&mut reasons[index]),
            gaps: std::mem::take(&mut gaps[index]),
            fulcrum: tool.fulcrum.filter(|_| !is_of_two_places),
            ..tool.clone()
        }
    };
    QualitySummary {
        frames,
        frames_interlaced: scale_count(whole.frames_interlaced, frames, whole.frames),
        tools: whole.tools.iter().enumerate().map(tool).collect(),
        light: whole.light.iter().copied().filter(|light| is_within(light.time_s, span)).collect(),
        view_shifts: whole.view_shifts.iter().copied().filter(|shift| is_within(shift.time_s, span)).collect(),
    }
}

/// Adds a frame to a tool's gaps: extends the last gap, or starts a new one.
fn add_to_gaps(gaps: &mut [Vec<Gap>], tool: u32, (frame, absence): (u64, Absence)) {
    let Some(gaps) = gaps.get_mut(tool as usize) else { return };
    match gaps.last_mut() {
        Some(last) if last.last + 1 == frame && last.absence == absence => last.last = frame,
        _ => gaps.push(Gap { first: frame, last: frame, absence }),
    }
}

#[cfg(test)]
mod tests;
