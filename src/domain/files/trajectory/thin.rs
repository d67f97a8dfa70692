//! Thins a trajectory for plots, so that a page can show twenty minutes on a thousand pixels with the same curves.
//!
//! Each tool's rows are split into stretches of equal time. Each stretch keeps its first row and the rows with the
//! smallest and largest x, y, z and speed, so that no curve loses a spike. A gap in a tool's rows is kept if it is at
//! least half a stretch long; shorter gaps are below the plot's resolution.

use std::io;

use super::rows::{BoxedRows, RowSource};
use crate::vision::trajectory::{Cut, Sample, has_cut_between};

/// Maximum number of rows kept per stretch: the first, and two extremes of four numbers.
const MAX_ROWS_PER_STRETCH: usize = 9;

/// The numbers whose extremes are kept.
const NUMBERS: [fn(&Sample) -> Option<f64>; 4] = [
    |row| Some(row.tip_mm.x),
    |row| Some(row.tip_mm.y),
    |row| Some(row.tip_mm.z),
    |row| row.velocity_mm_s.map(|v| v.norm()),
];

/// Which rows of a table remain. It holds 8 bytes for each of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Thinning {
    /// In order.
    kept: Vec<KeptRow>,
    is_thinned: bool,
}

/// A row that remains.
#[derive(Clone, Copy, Debug, PartialEq)]
struct KeptRow {
    /// Rows before it in the whole table.
    index: u32,
    /// Whether its tool was absent, or a cut lies, between the tool's previous row and this one.
    is_after_gap: bool,
}

impl Thinning {
    /// Reduces each tool to about `rows_of_a_tool` rows. If no tool has more than that, all rows stay. `cuts` are those of
    /// these rows. The rows are read twice.
    ///
    /// # Errors
    /// The rows cannot be read.
    pub fn of(rows: &mut dyn RowSource, cuts: &[Cut], rows_of_a_tool: usize) -> io::Result<Self> {
        let extent = TableExtent::of(rows)?;
        let stretches = (rows_of_a_tool / MAX_ROWS_PER_STRETCH).max(1);
        let stretch_s = (extent.last.1 - extent.first.1) / stretches as f64;
        // If one tool has too many rows, all tools are thinned, so that their curves have the same resolution everywhere.
        let is_thinned = extent.rows_of_tools.iter().any(|rows| *rows > rows_of_a_tool);
        let min_gap = if is_thinned { (extent.frames() / stretches as u64 / 2).max(2) } else { 2 };
        let min_gap_s = if is_thinned { stretch_s / 2.0 } else { f64::INFINITY };
        let cuts_of = |tool: usize| cuts.iter().filter(|cut: &&Cut| cut.tool == tool).map(|cut| cut.time_s).collect();
        let mut tools: Vec<ToolStretches> =
            (0..extent.rows_of_tools.len()).map(|tool| ToolStretches::new(cuts_of(tool))).collect();
        let mut kept = Vec::new();
        rows.rewind();
        for index in 0.. {
            let Some(row) = rows.next_row()? else { break };
            let Some(of_tool) = tools.get_mut(row.tool) else { continue };
            let is_after_gap = of_tool.is_gap_before(&row, min_gap, min_gap_s);
            if is_thinned {
                let place = ((row.time_s - extent.first.1) / stretch_s) as usize;
                of_tool.add(&row, KeptRow { index, is_after_gap }, place, &mut kept);
            } else {
                kept.push(KeptRow { index, is_after_gap });
            }
        }
        tools.iter_mut().for_each(|of_tool| of_tool.end_stretch(true, &mut kept));
        kept.sort_unstable_by_key(|row| row.index);
        Ok(Self { kept, is_thinned })
    }

    /// For each row that remains: whether it follows a gap or a cut.
    pub fn after_gap(&self) -> impl Iterator<Item = bool> {
        self.kept.iter().map(|row| row.is_after_gap)
    }

    /// Whether any rows were removed.
    pub fn is_thinned(&self) -> bool {
        self.is_thinned
    }
}

/// Size of a table.
struct TableExtent {
    /// Number of rows of each tool.
    rows_of_tools: Vec<usize>,
    /// Frame and time of the first row, s.
    first: (u64, f64),
    /// The same of the last row.
    last: (u64, f64),
}

impl TableExtent {
    fn of(rows: &mut dyn RowSource) -> io::Result<Self> {
        let mut extent = Self { rows_of_tools: vec![0; rows.tools().len()], first: (0, 0.0), last: (0, 0.0) };
        let mut is_first = true;
        rows.rewind();
        while let Some(row) = rows.next_row()? {
            extent.last = (row.frame, row.time_s);
            if std::mem::take(&mut is_first) {
                extent.first = extent.last;
            }
            if let Some(count) = extent.rows_of_tools.get_mut(row.tool) {
                *count += 1;
            }
        }
        Ok(extent)
    }

    fn frames(&self) -> u64 {
        self.last.0.saturating_sub(self.first.0) + 1
    }
}

/// The stretches of one tool, while its rows are read.
struct ToolStretches {
    cuts_s: Vec<f64>,
    /// Frame and time of the previous row.
    before: Option<(u64, f64)>,
    open: Option<ThinnedStretch>,
}

/// The rows of a stretch that will be kept.
struct ThinnedStretch {
    place: usize,
    first: KeptRow,
    /// Smallest and largest value of each number, with the row's index.
    extremes: [[Option<(f64, u32)>; 2]; NUMBERS.len()],
    last: u32,
}

impl ToolStretches {
    fn new(cuts_s: Vec<f64>) -> Self {
        Self { cuts_s, before: None, open: None }
    }

    fn is_gap_before(&mut self, row: &Sample, min_gap: u64, min_gap_s: f64) -> bool {
        self.before.replace((row.frame, row.time_s)).is_none_or(|(frame, time_s)| {
            row.frame - frame >= min_gap
                || row.time_s - time_s >= min_gap_s
                || has_cut_between(&self.cuts_s, [time_s, row.time_s])
        })
    }

    /// Adds a row to the open stretch. A stretch ends where the next one begins, or at a gap.
    fn add(&mut self, row: &Sample, kept: KeptRow, place: usize, into: &mut Vec<KeptRow>) {
        if kept.is_after_gap || self.open.as_ref().is_none_or(|open| open.place != place) {
            self.end_stretch(kept.is_after_gap, into);
        }
        let new = || ThinnedStretch { place, first: kept, extremes: Default::default(), last: kept.index };
        self.open.get_or_insert_with(new).add(row, kept.index);
    }

    /// Keeps the first row of the stretch and its extremes; also the last row if a gap follows.
    fn end_stretch(&mut self, has_gap_after: bool, into: &mut Vec<KeptRow>) {
        let Some(ThinnedStretch { first, extremes, last, .. }) = self.open.take() else { return };
        let mut indices: Vec<u32> = extremes.into_iter().flatten().flatten().map(|(_, index)| index).collect();
        indices.extend(has_gap_after.then_some(last));
        indices.sort_unstable();
        indices.dedup();
        into.push(first);
        let others = indices.into_iter().filter(|index| *index != first.index);
        into.extend(others.map(|index| KeptRow { index, is_after_gap: false }));
    }
}

impl ThinnedStretch {
    fn add(&mut self, row: &Sample, index: u32) {
        self.last = index;
        for (number, [smallest, largest]) in NUMBERS.iter().zip(&mut self.extremes) {
            let Some(value) = number(row) else { continue };
            if smallest.is_none_or(|(least, _)| value.total_cmp(&least).is_lt()) {
                *smallest = Some((value, index));
            }
            if largest.is_none_or(|(most, _)| value.total_cmp(&most).is_ge()) {
                *largest = Some((value, index));
            }
        }
    }
}

/// The rows that a thinning leaves.
pub struct ThinnedRows {
    rows: BoxedRows,
    kept: Vec<KeptRow>,
    /// Position in `kept` of the next row.
    next: usize,
    /// Rows of the source that were read.
    read: u32,
}

impl ThinnedRows {
    /// The rows that remain of this source. The thinning must be that of the source.
    pub fn new(mut rows: BoxedRows, Thinning { kept, .. }: Thinning) -> Self {
        rows.rewind();
        Self { rows, kept, next: 0, read: 0 }
    }
}

impl RowSource for ThinnedRows {
    fn tools(&self) -> &[String] {
        self.rows.tools()
    }

    fn next_row(&mut self) -> io::Result<Option<Sample>> {
        let Some(KeptRow { index, .. }) = self.kept.get(self.next) else { return Ok(None) };
        loop {
            let row = self.rows.next_row()?;
            self.read += 1;
            if row.is_none() || self.read > *index {
                self.next += 1;
                return Ok(row);
            }
        }
    }

    fn rewind(&mut self) {
        self.rows.rewind();
        (self.next, self.read) = (0, 0);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::domain::files::trajectory::HeldRows;
    use crate::vision::trajectory::SampleState;

    /// The rows that remain, which of them follow a gap, and whether rows were removed.
    struct Thinned {
        rows: Vec<Sample>,
        after_gap: Vec<bool>,
        is_thinned: bool,
    }

    fn thin(all: &[Sample], rows_of_a_tool: usize) -> Thinned {
        let rows = || HeldRows::new(vec!["orange".to_owned()], all.to_vec());
        let thinning = Thinning::of(&mut rows(), &[], rows_of_a_tool).unwrap();
        let (after_gap, is_thinned) = (thinning.after_gap().collect(), thinning.is_thinned());
        let mut left = ThinnedRows::new(Box::new(rows()), thinning);
        let mut read = || std::iter::from_fn(|| left.next_row().unwrap()).collect::<Vec<_>>();
        let rows = read();
        assert!(read().is_empty(), "it has ended");
        left.rewind();
        assert_eq!(std::iter::from_fn(|| left.next_row().unwrap()).collect::<Vec<_>>(), rows);
        Thinned { rows, after_gap, is_thinned }
    }

    /// Frames of the rows that follow a gap.
    fn after_gaps(left: &Thinned) -> Vec<u64> {
        left.rows.iter().zip(&left.after_gap).filter(|(_, gap)| **gap).map(|(row, _)| row.frame).collect()
    }

    fn sample(frame: u64, x: f64) -> Sample {
        Sample {
            frame,
            time_s: frame as f64 * 0.04,
            tool: 0,
            tip_mm: Point3::new(x, -x, 150.0 + x / 2.0),
            velocity_mm_s: Some(Vector3::new(x, 0.0, 0.0)),
            axis: None,
            tip_px: None,
            covariance_mm2: None,
            state: SampleState::Observed,
        }
    }

    fn path(frames: u64, x: impl Fn(u64) -> Option<f64>) -> Vec<Sample> {
        (0..frames).filter_map(|frame| Some(sample(frame, x(frame)?))).collect()
    }

    #[test]
    fn a_short_path_stays_unchanged_and_its_gaps_are_marked() {
        let all = path(100, |frame| (frame != 40).then_some(frame as f64));
        let left = thin(&all, 99);
        assert_eq!((&left.rows, left.is_thinned), (&all, false));
        assert_eq!(after_gaps(&left), [0, 41]);
        assert!(thin(&path(0, |_| None), 100).rows.is_empty());
    }

    #[test]
    fn twenty_minutes_are_thinned_to_the_limit_and_an_outlier_stays() {
        let all = path(30_000, |frame| Some(if frame == 17_003 { 900.0 } else { (frame as f64 / 40.0).sin() }));
        let left = thin(&all, 2_000);
        let count = left.rows.len();
        assert!(left.is_thinned && (500..=2_010).contains(&count), "{count}");
        assert!(left.rows.iter().any(|row| row.frame == 17_003));
        assert_eq!(left.after_gap.iter().filter(|gap| **gap).count(), 1, "the beginning");
    }

    #[test]
    fn an_absence_is_kept_and_flicker_adds_no_rows() {
        let away = path(30_000, |frame| (!(9_000..12_000).contains(&frame)).then_some(1.0));
        let left = thin(&away, 2_000);
        assert_eq!(after_gaps(&left), [0, 12_000]);
        assert!(left.rows.iter().any(|row| row.frame == 8_999), "the last sight");
        let flickers = path(30_000, |frame| (frame % 3 != 0).then_some((frame as f64).sin()));
        assert!(thin(&flickers, 2_000).rows.len() <= 2_010);
    }

    proptest! {
        #[test]
        fn thinned_rows_keep_the_extremes_everywhere(seed in 0u64..1000, at in 0.0..0.7f64) {
            let x = |frame: u64| ((frame * (2 * seed + 1)) % 977) as f64;
            let all = path(9_000, |frame| Some(x(frame)));
            let left = thin(&all, 900);
            // 600 frames of the recording, and a stretch of 90 frames more on either side.
            let from = 100 + (at * 8_000.0) as u64;
            let extent = |rows: &[Sample], from: u64, to: u64| {
                let within = rows.iter().filter(|row| (from..to).contains(&row.frame)).map(|row| row.tip_mm.x);
                within.fold([f64::MAX, f64::MIN], |[low, high], x| [low.min(x), high.max(x)])
            };
            let (all_extent, left_extent) =
                (extent(&all, from, from + 600), extent(&left.rows, from - 91, from + 691));
            let is_within = left_extent[0] <= all_extent[0] && left_extent[1] >= all_extent[1];
            prop_assert!(is_within, "{left_extent:?} {all_extent:?}");
            prop_assert!(left.rows.iter().all(|row| all.contains(row)), "nothing is made up");
        }
    }
}
