//! Thins a trajectory for plots, so that a page can show twenty minutes on a thousand pixels with the same curves.
//!
//! Each tool's rows are split into stretches of equal time. Each stretch keeps its first row and the rows with the
//! smallest and largest x, y, z and speed, so that no curve loses a spike. A gap in a tool's rows is kept if it is at
//! least half a stretch long; shorter gaps are below the plot's resolution.

use crate::vision::trajectory::{Sample, Trajectory, has_cut_between};

/// Maximum number of rows kept per stretch: the first, and two extremes of four numbers.
const MAX_ROWS_PER_STRETCH: usize = 9;

/// A thinned trajectory, with a mark on each row that follows a gap.
#[derive(Clone, Debug, PartialEq)]
pub struct ThinnedTrajectory {
    /// The remaining rows.
    pub trajectory: Trajectory,
    /// For each row: whether its tool was absent, or a cut lies, between the tool's previous row and this one.
    pub after_gap: Vec<bool>,
    /// Whether any rows were removed.
    pub is_thinned: bool,
}

/// Reduces each tool to about `rows_of_a_tool` rows. If no tool has more than that, all rows stay.
pub fn thin_trajectory(trajectory: &Trajectory, rows_of_a_tool: usize) -> ThinnedTrajectory {
    let stretches = (rows_of_a_tool / MAX_ROWS_PER_STRETCH).max(1);
    let ends = trajectory.samples.first().zip(trajectory.samples.last());
    let [begin_s, end_s] = ends.map_or([0.0; 2], |(first, last)| [first.time_s, last.time_s]);
    let stretch_s = (end_s - begin_s) / stretches as f64;
    let frames = ends.map_or(0, |(first, last)| last.frame - first.frame + 1);
    // If one tool has too many rows, all tools are thinned, so that their curves have the same resolution everywhere.
    let is_thinned = (0..trajectory.tools.len()).any(|tool| trajectory.of_tool(tool).count() > rows_of_a_tool);
    let min_gap = if is_thinned { (frames / stretches as u64 / 2).max(2) } else { 2 };
    let min_gap_s = if is_thinned { stretch_s / 2.0 } else { f64::INFINITY };
    let mut left: Vec<(Sample, bool)> = Vec::new();
    for tool in 0..trajectory.tools.len() {
        let rows: Vec<&Sample> = trajectory.of_tool(tool).collect();
        let cuts_s = trajectory.cuts_of(tool);
        let mut before: Option<&Sample> = None;
        let gap = |before: Option<&Sample>, row: &Sample| {
            before.is_none_or(|b| {
                row.frame - b.frame >= min_gap
                    || row.time_s - b.time_s >= min_gap_s
                    || has_cut_between(&cuts_s, [b.time_s, row.time_s])
            })
        };
        let gaps: Vec<bool> = rows.iter().map(|row| gap(before.replace(row), row)).collect();
        let place = |row: &Sample| if is_thinned { ((row.time_s - begin_s) / stretch_s) as usize } else { 0 };
        let mut first = 0;
        while first < rows.len() {
            // A stretch ends where the next one begins, or at a gap.
            let mut last = first;
            while last + 1 < rows.len() && !gaps[last + 1] && place(rows[last + 1]) == place(rows[first]) {
                last += 1;
            }
            let ends_here = gaps.get(last + 1).is_none_or(|is_gap| *is_gap);
            let keep =
                if is_thinned { rows_to_keep(&rows[first..=last], ends_here) } else { (0..=last - first).collect() };
            left.extend(keep.into_iter().map(|index| (*rows[first + index], gaps[first + index])));
            first = last + 1;
        }
    }
    left.sort_by_key(|(row, _)| (row.frame, row.tool));
    let (samples, after_gap) = left.into_iter().unzip();
    let (tools, frame_times_s) = (trajectory.tools.clone(), trajectory.frame_times_s.clone());
    let cuts = trajectory.cuts.clone();
    ThinnedTrajectory { trajectory: Trajectory { tools, samples, frame_times_s, cuts }, after_gap, is_thinned }
}

/// Indices of a stretch's first row and of its extremes; also of its last row if a gap follows.
fn rows_to_keep(rows: &[&Sample], ends_here: bool) -> Vec<usize> {
    let numbers: [fn(&Sample) -> Option<f64>; 4] = [
        |row| Some(row.tip_mm.x),
        |row| Some(row.tip_mm.y),
        |row| Some(row.tip_mm.z),
        |row| row.velocity_mm_s.map(|v| v.norm()),
    ];
    let mut keep = vec![0];
    for number in numbers {
        let values = || rows.iter().enumerate().filter_map(|(index, row)| Some((index, number(row)?)));
        keep.extend(values().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index));
        keep.extend(values().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index));
    }
    keep.extend(ends_here.then_some(rows.len() - 1));
    keep.sort_unstable();
    keep.dedup();
    keep
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::vision::trajectory::SampleState;

    fn sample(frame: u64, tool: usize, x: f64) -> Sample {
        Sample {
            frame,
            time_s: frame as f64 * 0.04,
            tool,
            tip_mm: Point3::new(x, -x, 150.0 + x / 2.0),
            velocity_mm_s: Some(Vector3::new(x, 0.0, 0.0)),
            axis: None,
            tip_px: None,
            covariance_mm2: None,
            state: SampleState::Observed,
        }
    }

    fn path(frames: u64, x: impl Fn(u64) -> Option<f64>) -> Trajectory {
        let samples = (0..frames).filter_map(|frame| Some(sample(frame, 0, x(frame)?))).collect();
        Trajectory { tools: vec!["orange".to_owned()], samples, frame_times_s: Vec::new(), cuts: Vec::new() }
    }

    #[test]
    fn a_short_path_stays_unchanged_and_its_gaps_are_marked() {
        let all = path(100, |frame| (frame != 40).then_some(frame as f64));
        let left = thin_trajectory(&all, 99);
        assert_eq!((&left.trajectory, left.is_thinned), (&all, false));
        let gaps: Vec<u64> =
            all.samples.iter().zip(&left.after_gap).filter(|(_, gap)| **gap).map(|(s, _)| s.frame).collect();
        assert_eq!(gaps, [0, 41]);
        assert!(thin_trajectory(&path(0, |_| None), 100).trajectory.samples.is_empty());
    }

    #[test]
    fn twenty_minutes_are_thinned_to_the_limit_and_an_outlier_stays() {
        let all = path(30_000, |frame| Some(if frame == 17_003 { 900.0 } else { (frame as f64 / 40.0).sin() }));
        let left = thin_trajectory(&all, 2_000);
        let count = left.trajectory.samples.len();
        assert!(left.is_thinned && (500..=2_010).contains(&count), "{count}");
        assert!(left.trajectory.samples.iter().any(|row| row.frame == 17_003));
        assert_eq!(left.after_gap.iter().filter(|gap| **gap).count(), 1, "the beginning");
    }

    #[test]
    fn an_absence_is_kept_and_flicker_adds_no_rows() {
        let away = path(30_000, |frame| (!(9_000..12_000).contains(&frame)).then_some(1.0));
        let left = thin_trajectory(&away, 2_000);
        let after: Vec<u64> = left
            .trajectory
            .samples
            .iter()
            .zip(&left.after_gap)
            .filter(|(_, gap)| **gap)
            .map(|(s, _)| s.frame)
            .collect();
        assert_eq!(after, [0, 12_000]);
        assert!(left.trajectory.samples.iter().any(|row| row.frame == 8_999), "the last sight");
        let flickers = path(30_000, |frame| (frame % 3 != 0).then_some((frame as f64).sin()));
        assert!(thin_trajectory(&flickers, 2_000).trajectory.samples.len() <= 2_010);
    }

    proptest! {
        #[test]
        fn thinned_rows_keep_the_extremes_everywhere(seed in 0u64..1000, at in 0.0..0.7f64) {
            let x = |frame: u64| ((frame * (2 * seed + 1)) % 977) as f64;
            let all = path(9_000, |frame| Some(x(frame)));
            let left = thin_trajectory(&all, 900);
            // 600 frames of the recording, and a stretch of 90 frames more on either side.
            let from = 100 + (at * 8_000.0) as u64;
            let extent = |rows: &[Sample], from: u64, to: u64| {
                let within = rows.iter().filter(|row| (from..to).contains(&row.frame)).map(|row| row.tip_mm.x);
                within.fold([f64::MAX, f64::MIN], |[low, high], x| [low.min(x), high.max(x)])
            };
            let (all_extent, left_extent) =
                (extent(&all.samples, from, from + 600), extent(&left.trajectory.samples, from - 91, from + 691));
            let is_within = left_extent[0] <= all_extent[0] && left_extent[1] >= all_extent[1];
            prop_assert!(is_within, "{left_extent:?} {all_extent:?}");
            prop_assert!(left.trajectory.samples.iter().all(|row| all.samples.contains(row)), "nothing is made up");
        }
    }
}
