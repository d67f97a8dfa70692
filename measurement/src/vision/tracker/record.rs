//! What is kept of each frame for the end of the recording.

use super::blocks::Blocks;
use super::measurement::{Grade, Measurement};
use crate::vision::pose::axis_line::AxisLine;
use crate::vision::pose::packed::PackedPoses;
use crate::vision::pose::{StoredPose, TubeEstimate};
use crate::vision::reason::MissReason;

/// What is kept of one frame for one tool.
#[derive(Clone, Copy, Debug)]
pub struct FrameRecord {
    /// The measurement, before it was steadied.
    pub pose: Option<StoredPose>,
    /// The fit is good enough to be used in the adjustment.
    pub is_good: bool,
    /// Why there is no measurement, or why it was rejected.
    pub reason: Option<MissReason>,
}

impl FrameRecord {
    /// The record of a frame's measurement.
    pub fn new(measured: &Result<Measurement, MissReason>) -> Self {
        match measured {
            Ok(m) => {
                let is_good = m.grade() == Grade::Good;
                Self { pose: Some(StoredPose::from(&m.estimate)), is_good, reason: None }
            }
            Err(reason) => Self::missed(*reason),
        }
    }

    /// The record of a frame without a measurement.
    pub fn missed(reason: MissReason) -> Self {
        Self { pose: None, is_good: false, reason: Some(reason) }
    }

    /// The measurement, with its covariance.
    pub fn estimate(&self) -> Option<TubeEstimate> {
        self.pose.as_ref().and_then(StoredPose::estimate)
    }
}

/// The place of a frame in its recording, and the axis that was measured on it.
pub type PlacedAxis = (usize, AxisLine);

/// The records of a recording in progress, packed.
#[derive(Default)]
pub struct PackedRecords {
    poses: PackedPoses,
    /// The axes, with their frames' places.
    axes: Vec<PlacedAxis>,
    /// Per frame: is there a pose, is it good, and the reason.
    others: Blocks<(bool, bool, Option<MissReason>)>,
}

impl PackedRecords {
    /// Takes the next record, and the axis of a bare tool whose tip is hidden.
    pub fn push(&mut self, FrameRecord { pose, is_good, reason }: FrameRecord, axis: Option<AxisLine>) {
        self.axes.extend(axis.map(|axis| (self.others.len(), axis)));
        pose.iter().for_each(|pose| self.poses.push(pose));
        self.others.push((pose.is_some(), is_good, reason));
    }

    /// The axes of a bare tool whose tip was hidden, with their frames' places. They are few, so that they are not in the
    /// frames' records.
    pub fn take_axes(&mut self) -> Vec<PlacedAxis> {
        std::mem::take(&mut self.axes)
    }

    /// The same frames with all measurements withdrawn.
    pub fn without_poses(self, reason: MissReason) -> Self {
        let taken_back = |record: FrameRecord| FrameRecord::missed(record.reason.unwrap_or(reason));
        self.unpack().into_iter().map(taken_back).collect()
    }

    /// Unpacks the records, and frees the packed memory on the way.
    pub fn unpack(self) -> Blocks<FrameRecord> {
        let mut poses = self.poses.unpack();
        let record = |(has_pose, is_good, reason): (bool, bool, _)| FrameRecord {
            pose: if has_pose { poses.next() } else { None },
            is_good,
            reason,
        };
        self.others.into_iter().map(record).collect()
    }
}

impl FromIterator<FrameRecord> for PackedRecords {
    fn from_iter<I: IntoIterator<Item = FrameRecord>>(records: I) -> Self {
        let mut all = Self::default();
        records.into_iter().for_each(|record| all.push(record, None));
        all
    }
}
