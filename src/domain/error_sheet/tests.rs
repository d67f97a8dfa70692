//! Laws of lists, sheets and formulas.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;

fn list(items: Value, earlier: &[ErrorItem]) -> Result<Vec<ErrorItem>, String> {
    let new: NewErrorList = serde_json::from_value(json!({"items": items})).map_err(|error| error.to_string())?;
    new.items(earlier).map_err(|refused| refused.to_string())
}

/// Drops (counted), a deviation in mm, and a slipping knot (yes or no).
fn three_items() -> Vec<ErrorItem> {
    let items = json!([{"name": "Drops", "kind": "count"}, {"name": "Deviation", "kind": "amount", "unit": "mm"},
                       {"name": "Knot slips", "kind": "yes_no"}]);
    list(items, &[]).unwrap()
}

/// Cut-off 300 s, 10 for each drop, 2 for each mm, 50 for the knot; not scaled.
fn formula(change: impl FnOnce(&mut Value)) -> ScoreFormula {
    let mut new = json!({"cut_off_s": 300, "time": "measured", "weights": [
        {"item": "drops", "weight": 10}, {"item": "deviation", "weight": 2}, {"item": "knot-slips", "weight": 50}]});
    change(&mut new);
    serde_json::from_value::<NewScoreFormula>(new).unwrap().checked(&three_items()).unwrap()
}

fn sheet(drops: usize, mm: Option<f64>, slips: bool, time_s: Option<f64>) -> SheetToScore {
    let marks = (0..drops)
        .map(|_| ("drops", None))
        .chain(mm.map(|mm| ("deviation", Some(mm))))
        .chain(slips.then_some(("knot-slips", None)));
    let items = three_items();
    SheetToScore { values: values_of(&items, marks), items, time_s }
}

/// 145.2 ± 0.4 s.
const TIME: Result<MeasuredTime, NoErrorScore> = Ok(MeasuredTime { value: 145.2, bar: Some([144.8, 145.6]) });

fn close(got: Option<f64>, want: f64) -> bool {
    got.is_some_and(|got| (got - want).abs() < 1e-9)
}

#[test]
fn one_sheet_gives_the_hand_computed_score_with_the_bar_of_the_time() {
    // 300 − 145.2 − 10 × 2 − 2 × 1.5 − 50 = 81.8; the bar is that of the time.
    let scored = formula(|_| {}).score(&[sheet(2, Some(1.5), true, None)], TIME).unwrap();
    assert!((scored.value - 81.8).abs() < 1e-9 && close(scored.low, 81.4) && close(scored.high, 82.2), "{scored:?}");
    assert_eq!((scored.sheets, scored.left_out, scored.parts.len()), (1, 0, 3));
    // Scaled by the cut-off: 81.8 / 300 × 100 = 27.2667, and the bar 27.1333 to 27.4.
    let scaled = formula(|new| new["scale"] = json!({"norm": 300, "maximum": 100, "not_above": true}));
    let scored = scaled.score(&[sheet(2, Some(1.5), true, None)], TIME).unwrap();
    assert!((scored.value - 27.266_666_667).abs() < 1e-6 && close(scored.high, 27.4), "{scored:?}");
}

#[test]
fn several_sheets_give_their_mean_and_a_bar_that_holds_each_of_them() {
    // Penalties 10 and 30: mean 20. Bar: 300 − 145.6 − 30 = 124.4 to 300 − 144.8 − 10 = 145.2.
    let sheets = [sheet(1, Some(0.0), false, None), sheet(3, Some(0.0), false, None)];
    let scored = formula(|_| {}).score(&sheets, TIME).unwrap();
    assert!((scored.value - 134.8).abs() < 1e-9 && close(scored.low, 124.4) && close(scored.high, 145.2), "{scored:?}");
    let drops = &scored.parts[0];
    assert_eq!((drops.mean, drops.lowest, drops.highest, scored.sheets), (2.0, 1.0, 3.0, 2));
    // Typed times belong to their sheets: 300 − 140 − 30 and 300 − 150 − 10, mean 135.
    let typed = formula(|new| new["time"] = json!("typed"));
    let sheets = [sheet(3, Some(0.0), false, Some(140.0)), sheet(1, Some(0.0), false, Some(150.0))];
    let scored = typed.score(&sheets, Err(NoErrorScore::NoDuration)).unwrap();
    assert!((scored.value - 135.0).abs() < 1e-9 && close(scored.low, 130.0) && close(scored.high, 140.0), "{scored:?}");
    let one = typed.score(&sheets[..1], Err(NoErrorScore::NoDuration)).unwrap();
    assert_eq!((one.value, one.low, one.time_high_s), (130.0, None, None), "the error of one clock is unknown");
}

#[test]
fn limits_hold_at_both_ends_and_only_where_they_were_chosen() {
    let slow = Ok(MeasuredTime { value: 400.0, bar: None });
    let clean = [sheet(0, Some(0.0), false, None)];
    assert_eq!(formula(|_| {}).score(&clean, slow).unwrap().value, -100.0);
    let floored = formula(|new| new["not_below_zero"] = json!(true)).score(&clean, slow).unwrap();
    assert_eq!((floored.value, floored.points, floored.low), (0.0, -100.0, None));
    let scale =
        |not_above: bool| formula(|new| new["scale"] = json!({"norm": 100, "maximum": 50, "not_above": not_above}));
    let fast = Ok(MeasuredTime { value: 100.0, bar: None });
    assert_eq!(scale(false).score(&clean, fast).unwrap().value, 100.0);
    assert_eq!(scale(true).score(&clean, fast).unwrap().value, 50.0);
}

#[test]
fn nothing_unknown_counts_as_zero() {
    let of = |sheets: &[SheetToScore]| formula(|_| {}).score(sheets, TIME);
    assert_eq!(of(&[]), Err(NoErrorScore::NoSheet));
    assert_eq!(of(&[sheet(0, None, false, None)]), Err(NoErrorScore::AmountMissing));
    let mut older = sheet(0, Some(0.0), false, None);
    older.values.retain(|value| value.item != "knot-slips");
    assert_eq!(of(&[older.clone()]), Err(NoErrorScore::ItemMissing));
    // An incomplete sheet is left out, and said to be.
    let some = of(&[sheet(0, None, false, None), older, sheet(1, Some(0.0), false, None)]).unwrap();
    assert_eq!((some.sheets, some.left_out, some.parts[0].mean), (1, 2, 1.0));
    let sheets = [sheet(0, Some(0.0), false, None)];
    let typed = formula(|new| new["time"] = json!("typed"));
    assert_eq!(typed.score(&sheets, TIME), Err(NoErrorScore::TimeMissing));
    assert_eq!(formula(|_| {}).score(&sheets, Err(NoErrorScore::Refused)), Err(NoErrorScore::Refused));
    let zero = of(&sheets).unwrap();
    assert!((zero.value - 154.8).abs() < 1e-9, "a finished sheet without marks says zero: {zero:?}");
}

#[test]
fn a_list_keeps_short_names_and_an_item_never_changes_its_kind() {
    let first = three_items();
    assert_eq!(first.iter().map(|item| item.item.as_str()).collect::<Vec<_>>(), ["drops", "deviation", "knot-slips"]);
    let renamed = list(json!([{"item": "drops", "name": "Objects lost", "kind": "count"}]), &first).unwrap();
    assert_eq!((renamed[0].item.as_str(), renamed[0].name.as_str()), ("drops", "Objects lost"));
    let again = list(json!([{"name": "Drops", "kind": "count"}]), &first).unwrap();
    assert_eq!(again[0].item, "drops", "the same error, listed again, goes on");
    let other = list(json!([{"name": "Drops", "kind": "yes_no"}]), &first).unwrap();
    assert_eq!(other[0].item, "drops-2", "another kind is another item");
    for (items, why) in [
        (json!([{"item": "drops", "name": "Drops", "kind": "yes_no"}]), "cannot change"),
        (json!([{"name": "A", "kind": "amount"}]), "needs a unit"),
        (json!([{"name": "A", "kind": "count", "unit": "mm"}]), "takes no unit"),
        (json!([{"name": "A", "kind": "count"}, {"name": "a", "kind": "count"}]), "two items"),
        (
            json!([{"item": "a", "name": "A", "kind": "count"}, {"item": "a", "name": "B", "kind": "count"}]),
            "two items",
        ),
        (json!([{"name": "A", "kind": "wish"}]), "unknown variant"),
        (json!(vec![json!({"name": "A", "kind": "count"}); 13]), "at most 12"),
        (json!([{"name": "A", "kind": "amount", "unit": "a unit of length"}]), "unit"),
    ] {
        let error = list(items.clone(), &first).unwrap_err();
        assert!(error.contains(why), "{items}: {error}");
    }
}

#[test]
fn marks_and_typed_values_fit_the_kind_of_their_item() {
    let items = three_items();
    let mark = |item: &str, at_s| NewErrorMark { item: item.to_owned(), at_s }.check(&items);
    assert!(mark("drops", Some(3.5)).is_ok() && mark("knot-slips", None).is_ok());
    assert!(mark("deviation", None).is_err() && mark("charm", None).is_err());
    for at_s in [-1.0, f64::NAN, 1e9] {
        assert_eq!(mark("drops", Some(at_s)).unwrap_err().what, "at_s");
    }
    let values = |amounts: Value, time_s: Option<f64>| {
        NewSheetValues { amounts: serde_json::from_value(amounts).unwrap(), time_s }.check(&items)
    };
    assert!(values(json!({"deviation": 0}), Some(145.0)).is_ok() && values(json!({}), None).is_ok());
    for amounts in [json!({"deviation": -1}), json!({"deviation": 1e7}), json!({"drops": 1}), json!({"charm": 1})] {
        assert_eq!(values(amounts, None).unwrap_err().what, "amounts");
    }
    assert_eq!(values(json!({}), Some(0.0)).unwrap_err().what, "time_s");
}

#[test]
fn a_formula_that_cannot_be_meant_is_refused() {
    let refused = |change: fn(&mut Value)| {
        let mut new = json!({"cut_off_s": 300, "time": "measured", "weights": [{"item": "drops", "weight": 10}]});
        change(&mut new);
        serde_json::from_value::<NewScoreFormula>(new).unwrap().checked(&three_items()).unwrap_err().what
    };
    assert_eq!(refused(|new| new["cut_off_s"] = json!(0)), "cut_off_s");
    assert_eq!(refused(|new| new["cut_off_s"] = json!(86_401)), "cut_off_s");
    assert_eq!(refused(|new| new["weights"][0]["weight"] = json!(0)), "weights");
    assert_eq!(refused(|new| new["weights"][0]["weight"] = json!(-1)), "weights");
    assert_eq!(refused(|new| new["weights"][0]["item"] = json!("charm")), "weights");
    let twice = |new: &mut Value| new["weights"] = json!(vec![json!({"item": "drops", "weight": 1}); 2]);
    assert_eq!(refused(twice), "weights");
    assert_eq!(refused(|new| new["scale"] = json!({"norm": 0, "maximum": 100, "not_above": true})), "scale");
}

#[test]
fn the_examples_are_lists_and_formulas_that_can_be_set() {
    let examples = ErrorExample::all();
    assert_eq!(
        examples.iter().map(|one| one.formula.cut_off_s).collect::<Vec<_>>(),
        [300.0, 300.0, 180.0, 420.0, 600.0]
    );
    for ErrorExample { example, items, formula, .. } in examples {
        assert!(
            formula.note.as_ref().is_some_and(|note| note.contains("not official") && note.len() <= 120),
            "{example}"
        );
        let new = json!(items);
        assert_eq!(list(new, &[]).unwrap(), items, "{example}");
        let ScoreFormula { cut_off_s, time, weights, scale, not_below_zero, note } = formula.clone();
        let note = note.map(|note| note.parse().unwrap());
        let new = NewScoreFormula { cut_off_s, time, weights, scale, not_below_zero, note, valid_from: None };
        assert_eq!(new.checked(&items).unwrap(), formula, "{example}");
        // A perfect attempt in no time has 100, one that is not finished has 0.
        let attempt = |unfinished: bool| {
            let marks = items.iter().filter_map(|item| match (item.kind, item.item.as_str()) {
                (ErrorItemKind::Amount, name) => Some((name, Some(0.0))),
                (_, "not-finished") if unfinished => Some(("not-finished", None)),
                _ => None,
            });
            let sheet = SheetToScore { values: values_of(&items, marks), items: items.clone(), time_s: None };
            formula.score(&[sheet], Ok(MeasuredTime { value: 0.0, bar: None })).unwrap().value
        };
        assert_eq!((attempt(false), attempt(true)), (100.0, 0.0), "{example}");
    }
}

fn any_formula() -> impl Strategy<Value = ScoreFormula> {
    let weight = 0.001..1000.0;
    let scale = proptest::option::of((0.1..1000.0, 0.1..1000.0, any::<bool>()));
    (1.0..1000.0, [weight.clone(), weight.clone(), weight], scale, any::<bool>()).prop_map(
        |(cut_off_s, weights, scale, floor)| {
            formula(|new| {
                new["cut_off_s"] = json!(cut_off_s);
                (0..3).for_each(|at| new["weights"][at]["weight"] = json!(weights[at]));
                new["not_below_zero"] = json!(floor);
                if let Some((norm, maximum, not_above)) = scale {
                    new["scale"] = json!({"norm": norm, "maximum": maximum, "not_above": not_above});
                }
            })
        },
    )
}

proptest! {
    #[test]
    fn more_errors_and_more_time_never_raise_a_score(
        formula in any_formula(),
        sheets in proptest::collection::vec((0_usize..20, 0.0..100.0, any::<bool>()), 1..5),
        time in 0.0..1000.0,
        half in 0.0..10.0,
        which in 0_usize..3,
    ) {
        let of = |sheets: &[(usize, f64, bool)], time: f64| {
            let sheets: Vec<SheetToScore> =
                sheets.iter().map(|(drops, mm, slips)| sheet(*drops, Some(*mm), *slips, None)).collect();
            formula.score(&sheets, Ok(MeasuredTime { value: time, bar: Some([time - half, time + half]) })).unwrap()
        };
        let before = of(&sheets, time);
        let mut worse = sheets.clone();
        match which {
            0 => worse[0].0 += 1,
            1 => worse[0].1 += 0.5,
            _ => worse[0].2 = true,
        }
        let tolerance = 1e-9 * (1.0 + before.value.abs());
        for after in [of(&worse, time), of(&sheets, time + 1.0)] {
            prop_assert!(after.value <= before.value + tolerance);
            prop_assert!(after.low.unwrap() <= before.low.unwrap() + tolerance);
            prop_assert!(after.high.unwrap() <= before.high.unwrap() + tolerance);
        }
        prop_assert!(before.low.unwrap() <= before.value + tolerance && before.value <= before.high.unwrap() + tolerance);
    }

    #[test]
    fn the_order_of_the_sheets_does_not_matter(drops in proptest::collection::vec(0_usize..20, 1..5)) {
        let of = |drops: &[usize]| {
            let sheets: Vec<SheetToScore> = drops.iter().map(|n| sheet(*n, Some(0.0), false, None)).collect();
            formula(|_| {}).score(&sheets, TIME).unwrap()
        };
        let mut reversed = drops.clone();
        reversed.reverse();
        let (one, other) = (of(&drops), of(&reversed));
        prop_assert!((one.value - other.value).abs() < 1e-9 && one.low == other.low && one.high == other.high);
    }
}
