//! The versions of a task's standard, and which of them judges which session.
//!
//! A version judges the sessions that arrive from its day on, until a later version does. So a new version does not
//! change the judgement of earlier sessions, and what was earned under an earlier version stays. The day is that of the
//! arrival by the service's clock: the time of a recording is stated by its sender, who could choose the easier version.

use std::sync::Arc;

use super::cache::ComputedCache;
use crate::domain::feature::FeatureKey;
use crate::domain::standard::{StandardDefinition, Target};
use crate::statistics::lc_cusum::LcCusumMonitor;
use crate::store::StandardRecord;

/// One version with its charts.
#[derive(Clone, Debug)]
pub struct StandardVersion {
    /// 1, 2, … within the task.
    pub version: i64,
    /// Its limits, pass rule and charts, without fingerprints.
    pub definition: StandardDefinition,
    /// Its charts.
    pub monitor: Arc<LcCusumMonitor>,
    /// Sessions that arrived from this time on are judged by it, epoch ms.
    from_ms: i64,
    /// When the next version took over, epoch ms; `i64::MAX` if none has. A session counts for this version if it
    /// arrived before.
    until_ms: i64,
}

/// The versions of a task's standard.
#[derive(Clone, Debug, Default)]
pub struct TaskStandards {
    /// By version, rising.
    versions: Vec<StandardVersion>,
    now_ms: i64,
}

impl TaskStandards {
    /// From a task's versions in any order. Versions whose charts cannot be computed are left out.
    pub fn of(mut records: Vec<StandardRecord>, known: &ComputedCache, now_ms: i64) -> Self {
        records.sort_by_key(|record| record.version);
        let taken_over = |record: &StandardRecord| {
            let later = records.iter().filter(|other| other.version > record.version);
            later.map(|other| other.valid_from_ms.max(other.created_at_ms)).min().unwrap_or(i64::MAX)
        };
        let version = |record: &StandardRecord| {
            let monitor = known.charts(record.definition.charts).ok()?;
            let definition = record.definition.clone().without_fingerprints();
            let (version, from_ms) = (record.version, record.valid_from_ms);
            Some(StandardVersion { version, definition, monitor, from_ms, until_ms: taken_over(record) })
        };
        Self { versions: records.iter().filter_map(version).collect(), now_ms }
    }

    /// The version that judges a session that arrived at this time.
    pub fn at(&self, arrived_ms: i64) -> Option<&StandardVersion> {
        self.versions.iter().rev().find(|version| version.from_ms <= arrived_ms)
    }

    /// The version that judges the sessions that arrive now.
    pub fn current(&self) -> Option<&StandardVersion> {
        self.at(self.now_ms)
    }

    /// All versions, newest first.
    pub fn newest_first(&self) -> impl Iterator<Item = &StandardVersion> {
        self.versions.iter().rev()
    }

    /// The features that any version limits.
    pub fn limited_features(&self) -> Vec<FeatureKey> {
        let targets = self.versions.iter().flat_map(|version| &version.definition.targets);
        targets.map(|target| target.of.clone()).collect()
    }

    /// The limit for a feature of a session that arrived at this time.
    pub fn target_at(&self, arrived_ms: i64, of: &FeatureKey) -> Option<&Target> {
        self.at(arrived_ms)?.definition.target(of)
    }
}

impl StandardVersion {
    /// True if a session that arrived at this time counts for passing this version.
    pub fn counts(&self, arrived_ms: i64) -> bool {
        (self.from_ms..self.until_ms).contains(&arrived_ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::standard::ChartDesign;
    use crate::ids::{StandardId, TaskId};

    const DAY_MS: i64 = 86_400_000;

    fn record(version: i64, created_day: i64, valid_day: i64) -> StandardRecord {
        let definition = StandardDefinition { targets: Vec::new(), rule: None, charts: ChartDesign::default() };
        let (id, task_id) = (StandardId::at(version), TaskId::at(1));
        let (created_at_ms, valid_from_ms) = (created_day * DAY_MS, valid_day * DAY_MS);
        StandardRecord { id, task_id, version, definition, who: None, created_at_ms, valid_from_ms }
    }

    fn judges(records: &[StandardRecord], day: i64) -> (Option<i64>, Vec<i64>) {
        let known = ComputedCache::default();
        let standards = TaskStandards::of(records.to_vec(), &known, 100 * DAY_MS);
        let counted = standards.newest_first().filter(|version| version.counts(day * DAY_MS));
        (standards.at(day * DAY_MS).map(|version| version.version), counted.map(|version| version.version).collect())
    }

    #[test]
    fn each_session_is_judged_by_the_version_of_its_day() {
        let records = [record(2, 20, 20), record(1, 10, 0)];
        assert_eq!(judges(&records, 1), (Some(1), vec![1]), "before it was set, if it is valid from the beginning");
        assert_eq!(judges(&records, 19), (Some(1), vec![1]));
        assert_eq!(judges(&records, 20), (Some(2), vec![2]));
        assert_eq!(judges(&[record(1, 10, 10)], 9), (None, vec![]), "no version was valid yet");
    }

    #[test]
    fn a_version_that_is_valid_from_an_earlier_day_takes_nothing_from_the_one_before() {
        let records = [record(1, 10, 10), record(2, 20, 5)];
        assert_eq!(judges(&records, 12), (Some(2), vec![2, 1]), "it still counts for the version of that day");
        assert_eq!(judges(&records, 25), (Some(2), vec![2]));
    }

    #[test]
    fn a_version_that_begins_later_leaves_the_one_before_until_then() {
        let records = [record(1, 10, 0), record(2, 20, 30)];
        assert_eq!(judges(&records, 25), (Some(1), vec![1]));
        assert_eq!(judges(&records, 30), (Some(2), vec![2]));
    }
}
