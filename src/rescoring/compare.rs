//! The differences between two results of a session. Pure; used for both the report's counts and its rows.

use crate::domain::feature::StoredFeatureKey;
use crate::domain::rescoring::{FeatureChange, FeatureChangeKind, ValueWithError};
use crate::domain::session::FeatureRow;

/// Relative differences below this are rounding: sums of a million terms in double precision agree to about 1e-10.
pub const ROUNDING: f64 = 1e-9;

/// The features that changed: those whose error bars do not overlap first, then in the order of display.
pub fn changes(old: &[FeatureRow], new: &[FeatureRow]) -> Vec<FeatureChange> {
    let find = |rows: &[FeatureRow], of: &StoredFeatureKey| {
        rows.iter().find(|row| StoredFeatureKey::from(*row) == *of).and_then(value_with_error)
    };
    let only_old =
        old.iter().filter(|row| !new.iter().any(|other| StoredFeatureKey::from(other) == StoredFeatureKey::from(*row)));
    let change = |row: &FeatureRow| {
        let of = StoredFeatureKey::from(row);
        let (old, new) = (find(old, &of), find(new, &of));
        let change = between(old, new)?;
        Some(FeatureChange { of, title: row.title.clone(), unit: row.unit.clone(), change, old, new })
    };
    let mut changes: Vec<FeatureChange> = new.iter().chain(only_old).filter_map(change).collect();
    // The sort is stable: otherwise the order of display remains.
    changes.sort_by_key(|change| change.change != FeatureChangeKind::Apart);
    changes
}

fn between(old: Option<ValueWithError>, new: Option<ValueWithError>) -> Option<FeatureChangeKind> {
    match (old, new) {
        (None, None) => None,
        (Some(_), None) => Some(FeatureChangeKind::Lost),
        (None, Some(_)) => Some(FeatureChangeKind::Gained),
        (Some(old), Some(new)) if are_apart(&old, &new) => Some(FeatureChangeKind::Apart),
        (Some(old), Some(new)) => {
            let largest = old.value.abs().max(new.value.abs());
            ((old.value - new.value).abs() > ROUNDING * largest).then_some(FeatureChangeKind::WithinError)
        }
    }
}

fn are_apart(old: &ValueWithError, new: &ValueWithError) -> bool {
    match (old.low.zip(old.high), new.low.zip(new.high)) {
        (Some((old_low, old_high)), Some((new_low, new_high))) => old_high < new_low || new_high < old_low,
        _ => false,
    }
}

fn value_with_error(row: &FeatureRow) -> Option<ValueWithError> {
    let bar = row.error.as_ref().and_then(|error| error.as_ref().ok());
    let value = *row.value.as_ref().ok()?;
    Some(ValueWithError { value, low: bar.map(|bar| bar.low), high: bar.map(|bar| bar.high) })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::domain::session::{FeatureError, FeatureSpace};

    fn row(name: &str, value: Option<f64>, half: Option<f64>) -> FeatureRow {
        let bar = |value: f64| {
            half.map(|half| FeatureError { sigma: half, low: value - half, high: value + half, as_measured: value })
        };
        FeatureRow {
            name: name.to_owned(),
            title: name.to_owned(),
            unit: "s".to_owned(),
            tool: None,
            space: FeatureSpace::Space3d,
            value: value.ok_or_else(|| "too few".to_owned()),
            error: value.map(|value| bar(value).ok_or_else(|| "not stated".to_owned())),
        }
    }

    fn change(old: Option<f64>, new: Option<f64>, half: Option<f64>) -> Option<FeatureChangeKind> {
        changes(&[row("a", old, half)], &[row("a", new, half)]).first().map(|change| change.change)
    }

    #[test]
    fn a_change_is_apart_only_where_no_value_lies_in_both_bars() {
        assert_eq!(change(Some(10.0), Some(12.1), Some(1.0)), Some(FeatureChangeKind::Apart));
        assert_eq!(change(Some(10.0), Some(12.0), Some(1.0)), Some(FeatureChangeKind::WithinError), "they touch");
        assert_eq!(change(Some(10.0), Some(99.0), None), Some(FeatureChangeKind::WithinError), "its error is unknown");
        assert_eq!(
            change(Some(10.0), Some(10.0 * (1.0 + 1e-12)), Some(0.0)),
            Some(FeatureChangeKind::Apart),
            "bars without width"
        );
        assert_eq!(change(Some(10.0), Some(10.0 * (1.0 + 1e-12)), Some(1.0)), None, "rounding");
        assert_eq!(change(Some(10.0), None, Some(1.0)), Some(FeatureChangeKind::Lost));
        assert_eq!(change(None, Some(10.0), Some(1.0)), Some(FeatureChangeKind::Gained));
        assert_eq!(change(None, None, None), None);
    }

    #[test]
    fn features_of_only_one_result_are_listed_and_clear_changes_come_first() {
        let old = [row("gone", Some(1.0), None), row("b", Some(1.0), Some(0.5)), row("c", Some(1.0), Some(0.5))];
        let new = [row("b", Some(1.1), Some(0.5)), row("c", Some(3.0), Some(0.5)), row("new", Some(1.0), None)];
        let changed: Vec<_> =
            changes(&old, &new).into_iter().map(|change| (change.of.feature, change.change)).collect();
        let expected = [
            ("c", FeatureChangeKind::Apart),
            ("b", FeatureChangeKind::WithinError),
            ("new", FeatureChangeKind::Gained),
            ("gone", FeatureChangeKind::Lost),
        ];
        assert_eq!(changed, expected.map(|(name, change)| (name.to_owned(), change)));
    }

    proptest! {
        #[test]
        fn the_same_values_never_change_and_an_order_back_changes_as_much(
            old in prop::collection::vec((-1e6..1e6f64, 0.0..1e3f64), 1..8), shift in -1e3..1e3f64,
        ) {
            let rows = |shift: f64| -> Vec<FeatureRow> {
                let values = old.iter().enumerate();
                values.map(|(n, (value, half))| row(&n.to_string(), Some(value + shift), Some(*half))).collect()
            };
            prop_assert_eq!(changes(&rows(0.0), &rows(0.0)), vec![]);
            let is_apart = |change: &&FeatureChange| change.change == FeatureChangeKind::Apart;
            let count = |changes: &[FeatureChange]| changes.iter().filter(is_apart).count();
            let (there, back) = (changes(&rows(0.0), &rows(shift)), changes(&rows(shift), &rows(0.0)));
            prop_assert_eq!((there.len(), count(&there)), (back.len(), count(&back)));
        }
    }
}
