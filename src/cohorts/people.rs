//! The comparable people of a cohort, with one value each.
//!
//! To be fair to left-handers, a feature of a tool, or of the left or right hand, is compared only among people who
//! prefer the same hand: that tool is in the preferred hand of some people and in the other hand of others. A feature of
//! the dominant or the other hand is compared among all whose preferred hand is known, and one of the whole session
//! among all. A feature along the camera's axes is compared only within one calibration. Pipeline versions
//! are not mixed.

use sha2::{Digest, Sha256};

use crate::domain::feature::{FeatureKey, depends_on_camera};
use crate::domain::trainee::Handedness;
use crate::ids::{CalibrationId, TraineeId};
use crate::statistics::{NoAnswer, PersonValues};
use crate::store::CohortValue;

/// Number of last sessions per person that count. Their median is the person's value: current skill, not that of the
/// start.
pub const LAST_SESSIONS: u32 = 5;

/// The conditions that make a cohort's value comparable.
#[derive(Clone, Copy, Debug)]
pub struct ComparableWith<'l> {
    /// The feature.
    pub of: &'l FeatureKey,
    /// The pipeline version.
    pub pipeline: &'l str,
    /// The calibration, for features that depend on the camera's axes; `None` matches none of these.
    pub calibration: Option<CalibrationId>,
    /// The preferred hand, for a feature of a tool or of the left or right hand.
    pub handedness: Option<Handedness>,
    /// A person to leave out, because they are compared with the others.
    pub without: Option<TraineeId>,
}

impl ComparableWith<'_> {
    /// Trainee and value of the comparable rows.
    pub fn rows(&self, values: &[CohortValue]) -> Vec<(TraineeId, f64)> {
        let comparable = |row: &&CohortValue| {
            row.of == *self.of
                && row.pipeline == self.pipeline
                && (!depends_on_camera(self.of) || self.calibration == Some(row.calibration))
                && (!self.of.needs_same_preference()
                    || (self.handedness.is_some() && row.handedness == self.handedness))
                && self.without != Some(row.trainee)
        };
        values.iter().filter(comparable).map(|row| (row.trainee, row.value)).collect()
    }

    /// The people with the median of their comparable rows.
    pub fn people(&self, values: &[CohortValue]) -> Result<PersonValues, NoAnswer> {
        PersonValues::of_sessions(&self.rows(values))
    }
}

/// SHA-256 of the groups' values in rising order. It is the same for the same values, and does not identify the people.
pub fn fingerprint(groups: &[&PersonValues]) -> String {
    let mut hash = Sha256::new();
    for group in groups {
        hash.update((group.count() as u64).to_le_bytes());
        group.values().iter().for_each(|value| hash.update(value.to_bits().to_le_bytes()));
    }
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::session::FeatureSpace;
    use crate::motion::features::find;

    fn key(feature: &str, tool: Option<&str>, space: FeatureSpace) -> FeatureKey {
        FeatureKey::of_tool(find(feature).unwrap(), tool.map(str::to_owned), space)
    }

    fn value(of: &FeatureKey, at: i64, handedness: Option<Handedness>, value: f64) -> CohortValue {
        let (trainee, calibration) = (TraineeId::at(at), CalibrationId::at(1));
        CohortValue { trainee, handedness, calibration, pipeline: "7".to_owned(), of: of.clone(), value }
    }

    #[test]
    fn a_tools_feature_is_compared_among_people_of_one_hand_and_a_sessions_among_all() {
        let (left, right) = (Some(Handedness::Left), Some(Handedness::Right));
        let (tool, whole) =
            (key("path_length", Some("orange"), FeatureSpace::Space3d), key("duration", None, FeatureSpace::Space3d));
        let of = |key: &FeatureKey| vec![value(key, 1, left, 1.0), value(key, 2, right, 2.0), value(key, 3, None, 3.0)];
        let among = |of: &FeatureKey, handedness, values: &[CohortValue]| {
            let like = ComparableWith { of, pipeline: "7", calibration: None, handedness, without: None };
            like.people(values).unwrap().values().to_vec()
        };
        assert_eq!(among(&tool, left, &of(&tool)), [1.0]);
        assert_eq!(among(&tool, right, &of(&tool)), [2.0]);
        assert!(among(&tool, None, &of(&tool)).is_empty(), "a person with unknown hand is not compared");
        assert_eq!(among(&whole, left, &of(&whole)), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn the_person_other_versions_and_other_cameras_are_left_out() {
        let (space, image) =
            (key("path_length", None, FeatureSpace::Space3d), key("path_length", None, FeatureSpace::Image));
        let one = value(&space, 1, None, 1.0);
        let rows = [one.clone(), value(&space, 2, None, 2.0), CohortValue { pipeline: "6".to_owned(), ..one }];
        let like = ComparableWith {
            of: &space,
            pipeline: "7",
            calibration: None,
            handedness: None,
            without: Some(rows[0].trainee),
        };
        assert_eq!(like.people(&rows).unwrap().values(), [2.0]);
        let rows = [value(&image, 1, None, 1.0)];
        let in_picture =
            |calibration| ComparableWith { of: &image, calibration, without: None, ..like }.rows(&rows).len();
        assert_eq!([Some(CalibrationId::at(1)), None].map(in_picture), [0, 0], "another id, and none");
        assert_eq!(in_picture(Some(rows[0].calibration)), 1);
    }

    #[test]
    fn a_fingerprint_depends_on_values_and_groups_and_not_on_people() {
        let people = |values: &[f64]| {
            PersonValues::of_sessions(&values.iter().copied().enumerate().collect::<Vec<_>>()).unwrap()
        };
        let print = |groups: &[&[f64]]| {
            let groups: Vec<PersonValues> = groups.iter().map(|values| people(values)).collect();
            fingerprint(&groups.iter().collect::<Vec<_>>())
        };
        assert_eq!(print(&[&[1.0, 2.0]]), print(&[&[2.0, 1.0]]));
        assert_ne!(print(&[&[1.0, 2.0]]), print(&[&[1.0, 2.5]]));
        assert_ne!(print(&[&[1.0], &[2.0]]), print(&[&[1.0, 2.0]]));
        assert_eq!(print(&[&[1.0]]).len(), 64);
    }
}
