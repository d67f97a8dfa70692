//! Reassigns the records of two tools of one colour at the end of a recording, where a tool was tracked under the
//! other's name.
//!
//! Input: both tools' records. They are split into segments at every gap, jump and meeting of the two tools. All poses
//! together give both trocars, and each segment is assigned to the tool whose trocar its axes pass through. This
//! changes the estimated trocars, so it is repeated until nothing changes. The left hand's tool is the one whose
//! trocar lies farther left in the picture. A segment that matches both trocars equally well gets the owner of its
//! neighbours in time; it is rejected if they disagree or there are none. A segment is also rejected if it was
//! measured with the sizes of a tool that is not its owner.

use std::ops::Range;

use nalgebra::Point3;

use super::blocks::Blocks;
use super::learn;
use super::motion::FrameInstant;
use super::origin::{self, DECISIVE_MARGIN, Origin};
use super::record::{FrameRecord, PackedRecords};
use super::tool::ToolTracker;
use crate::vision::pose::TubeEstimate;
use crate::vision::pose::adjustment::{self, Adjustment};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::reason::MissReason;

/// Reassigns the records of both tools, the left hand's first.
pub fn reassign(tools: [&mut ToolTracker; 2], instants: &[FrameInstant]) {
    let [left, right] = tools;
    let sizes = |tool: &ToolTracker| (tool.spec.diameter_mm, tool.spec.band_length_mm());
    let are_alike = sizes(left) == sizes(right);
    let records = [&mut left.records, &mut right.records].map(|packed| std::mem::take(packed).unpack());
    [left.records, right.records] = reassigned(records, instants, are_alike).map(PackedRecords::from_iter);
}

/// A segment that was tracked as one tool.
#[derive(Clone, Debug, PartialEq)]
struct TrackSegment {
    /// The tool that it was tracked as.
    as_tool: usize,
    /// Indices into the records.
    frames: Range<usize>,
    /// The tool that it belongs to; `None` if undecided.
    owner: Option<usize>,
}

impl TrackSegment {
    fn records<'a>(&self, all: &'a Records) -> impl Iterator<Item = &'a FrameRecord> + use<'a> {
        let own = &all[self.as_tool];
        self.frames.clone().map(move |frame| &own[frame])
    }
}

/// Both tools' records.
type Records = [Blocks<FrameRecord>; 2];

fn reassigned(records: Records, instants: &[FrameInstant], are_alike: bool) -> Records {
    const ROUNDS: usize = 6;
    let mut runs = split_into_segments(&records);
    let [Some(left), Some(right)] = estimate_origins(&records, &runs) else { return records }; // only one tool was seen
    let mut origins = [left, right];
    for _ in 0..ROUNDS {
        let before = runs.clone();
        assign_owners(&mut runs, &records, &origins);
        inherit_owners(&mut runs, instants);
        match self::estimate_origins(&records, &runs) {
            [Some(left), Some(right)] if runs != before => origins = [left, right],
            _ => break,
        }
    }
    if is_right_of(&origins[0], &origins[1]) {
        origins.swap(0, 1);
        runs.iter_mut().for_each(|run| run.owner = run.owner.map(|tool| 1 - tool));
    }
    apply_owners(records, &runs, &origins, are_alike)
}

/// Splits the records of both tools into segments, each free of any unseen exchange of the two.
fn split_into_segments(records: &Records) -> Vec<TrackSegment> {
    const MAX_FRAMES: usize = 25;
    const MEETING_MM: f64 = 15.0;
    const JUMP_MM: f64 = 10.0;
    let tip = |tool: usize, frame: usize| records[tool][frame].pose.map(|pose| pose.tube.tip);
    let apart =
        |one: Option<Point3<f64>>, other| one.zip(other).map(|(one, other): (_, Point3<f64>)| (one - other).norm());
    let meets = |frame: usize| apart(tip(0, frame), tip(1, frame)).is_some_and(|mm| mm < MEETING_MM);
    let mut runs: Vec<TrackSegment> = Vec::new();
    for (as_tool, own) in records.iter().enumerate() {
        for frame in (0..own.len()).filter(|frame| tip(as_tool, *frame).is_some()) {
            let goes_on = |run: &&mut TrackSegment| {
                run.as_tool == as_tool
                    && run.frames.end == frame
                    && run.frames.len() < MAX_FRAMES
                    && meets(frame) == meets(frame - 1)
                    && apart(tip(as_tool, frame - 1), tip(as_tool, frame)).is_some_and(|mm| mm < JUMP_MM)
            };
            match runs.last_mut().filter(goes_on) {
                Some(run) => run.frames.end = frame + 1,
                None => runs.push(TrackSegment { as_tool, frames: frame..frame + 1, owner: Some(as_tool) }),
            }
        }
    }
    runs
}

/// The origin of each tool, estimated from its segments; `None` for a tool without any.
fn estimate_origins(records: &Records, runs: &[TrackSegment]) -> [Option<Origin>; 2] {
    const MAX_POSES: usize = 256; // more poses are no more precise
    /// The axes of two tools meet among the tips, ahead of some of them.
    const MIN_BEHIND: f64 = 0.9;
    [0, 1].map(|tool| {
        let own = runs.iter().filter(|run| run.owner == Some(tool));
        let seen: Vec<&FrameRecord> = own.flat_map(|run| run.records(records)).collect();
        let step = seen.len().div_ceil(MAX_POSES).max(1);
        let poses = |good: bool| -> Vec<TubeEstimate> {
            seen.iter().step_by(step).filter(|r| r.is_good || !good).filter_map(|r| r.estimate()).collect()
        };
        let good = poses(true);
        let is_of_one_tool =
            |adjusted: &Adjustment| adjusted.is_right_way_round() && adjusted.share_behind(&good) >= MIN_BEHIND;
        let known = adjustment::estimate(&good).filter(learn::is_fulcrum_known).filter(is_of_one_tool);
        let trocar = known.map(|adjusted| adjusted.fulcrum);
        trocar.or_else(|| median_assumed_trocar(&poses(false))).map(Origin::Fulcrum)
    })
}

/// The assumed trocar: the median over all poses.
fn median_assumed_trocar(poses: &[TubeEstimate]) -> Option<Fulcrum> {
    let hands: Vec<Fulcrum> = poses.iter().map(origin::assumed_trocar).collect();
    let at = [0, 1, 2].map(|axis| median(hands.iter().map(|hand| hand.at[axis]).collect()));
    hands.first().map(|hand| Fulcrum { at: Point3::from(at), ..*hand })
}

/// Assigns each segment to the tool whose origin explains it, if one clearly does.
fn assign_owners(runs: &mut [TrackSegment], records: &Records, origins: &[Origin; 2]) {
    for run in runs {
        let poses = run.records(records).filter_map(FrameRecord::estimate);
        let for_left =
            median(poses.map(|pose| origins[1].mismatch_squared(&pose) - origins[0].mismatch_squared(&pose)).collect());
        run.owner = match for_left {
            by if by > DECISIVE_MARGIN => Some(0),
            by if by < -DECISIVE_MARGIN => Some(1),
            _ => None,
        };
    }
}

/// An undecided segment gets the owner of the nearest decided segments before and after it that were tracked as the
/// same tool.
fn inherit_owners(runs: &mut [TrackSegment], instants: &[FrameInstant]) {
    const MAX_GAP_S: f64 = 0.5;
    let decided: Vec<TrackSegment> = runs.iter().filter(|run| run.owner.is_some()).cloned().collect();
    let between_s = |one: &Range<usize>, next: &Range<usize>| instants[next.start].1 - instants[one.end - 1].1;
    for run in runs.iter_mut().filter(|run| run.owner.is_none()) {
        let same = || decided.iter().filter(|other| other.as_tool == run.as_tool);
        let before = same().rfind(|other| other.frames.end <= run.frames.start);
        let after = same().find(|other| other.frames.start >= run.frames.end);
        let before = before.filter(|other| between_s(&other.frames, &run.frames) < MAX_GAP_S);
        let after = after.filter(|other| between_s(&run.frames, &other.frames) < MAX_GAP_S);
        let owners: Vec<Option<usize>> = [before, after].into_iter().flatten().map(|other| other.owner).collect();
        run.owner = match owners[..] {
            [owner] => owner,
            [one, other] if one == other => one,
            _ => None,
        };
    }
}

/// Does the first origin lie clearly farther right in the picture?
fn is_right_of(first: &Origin, second: &Origin) -> bool {
    const CLEARLY_MM: f64 = 10.0;
    first.position().zip(second.position()).is_some_and(|(first, second)| first.x - second.x > CLEARLY_MM)
}

/// The records of each tool after every segment was given to its owner.
fn apply_owners(mut records: Records, runs: &[TrackSegment], origins: &[Origin; 2], are_alike: bool) -> Records {
    let mut owners = [0, 1].map(|tool| vec![None; records[tool].len()]);
    for run in runs {
        owners[run.as_tool][run.frames.clone()].fill(run.owner);
    }
    for frame in 0..records[0].len() {
        let (seen, owner) = ([0, 1].map(|tool| records[tool][frame]), [0, 1].map(|tool| owners[tool][frame]));
        let given = [0, 1].map(|tool| record_for_owner(tool, &seen, &owner, origins, are_alike));
        for (own, given) in records.iter_mut().zip(given) {
            own[frame] = given;
        }
    }
    records
}

/// One tool's record of a frame, from the records of both tools and their owners.
fn record_for_owner(
    tool: usize,
    seen: &[FrameRecord; 2],
    owners: &[Option<usize>; 2],
    origins: &[Origin; 2],
    are_alike: bool,
) -> FrameRecord {
    let has = |as_tool: &usize| seen[*as_tool].pose.is_some();
    let against = |as_tool: &usize| seen[*as_tool].estimate().map_or(0.0, |e| origins[tool].mismatch_squared(&e));
    let given = [tool, 1 - tool].into_iter().filter(has).filter(|s| owners[*s] == Some(tool));
    match given.min_by(|a, b| against(a).total_cmp(&against(b))) {
        Some(as_tool) if as_tool == tool || are_alike => seen[as_tool],
        Some(_) => FrameRecord::missed(MissReason::EitherTool),
        None if !has(&tool) => seen[tool],
        None if owners[tool].is_some() && !has(&(1 - tool)) => seen[1 - tool],
        None => FrameRecord::missed(MissReason::EitherTool),
    }
}

/// The median; 0 if there are no values.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
