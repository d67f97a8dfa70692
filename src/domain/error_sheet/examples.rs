//! Lists and formulas to start from: our own, in the manner of the tasks of the Fundamentals of Laparoscopic Surgery
//! (FLS) and of MISTELS before it. They are not official. FLS does not publish its formulas, so weights and scales are
//! ours, to be set by the centre.
//!
//! Cut-off times are the published ones: Derossis AM et al., "Development of a model for training and evaluation of
//! laparoscopic skills", Am J Surg 1998;175:482–487; Peters JH et al., Surgery 2004;135:21–27. For pegs and circle the
//! written instructions of FLS state the same 300 s as the maximum time. MISTELS subtracts the percentage of pegs that
//! were lost, and the percentage of the area that was cut wrongly.

use serde::Serialize;
use utoipa::ToSchema;

use super::{ErrorItem, ErrorItemKind, ItemWeight, ScoreFormula, ScoreScale, ScoreTime};

/// A list of error items with a formula, to start from.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ErrorExample {
    /// Stable name.
    pub example: &'static str,
    /// Title for people.
    pub title: &'static str,
    /// The published source of the cut-off time. Items, weights and scale are ours.
    pub source: &'static str,
    /// The items.
    pub items: Vec<ErrorItem>,
    /// The formula.
    pub formula: ScoreFormula,
}

/// The source of all cut-off times.
const SOURCE: &str = "Derossis et al., Am J Surg 1998;175:482–487; Peters et al., Surgery 2004;135:21–27";

/// The note of each formula.
const NOTE: &str = "Ours, in the manner of FLS; not official. Cut-off time: Derossis 1998, Peters 2004.";

/// An item: short name, name, unit of an amount, weight, hint.
type Row = (&'static str, &'static str, ErrorItemKind, Option<&'static str>, f64, &'static str);

const OUTSIDE: Row = (
    "dropped-outside",
    "Object dropped outside the field",
    ErrorItemKind::Count,
    None,
    17.0,
    "An object that can no longer be reached; one that is picked up again is none.",
);
const AREA_OFF: Row = (
    "area-off-line",
    "Area cut beside the line",
    ErrorItemKind::Amount,
    Some("%"),
    1.0,
    "Area between the cut and the drawn circle, as a share of the circle.",
);
const LOOP_OFF: Row = (
    "loop-off-mark",
    "Distance of the loop from the mark",
    ErrorItemKind::Amount,
    Some("mm"),
    10.0,
    "Largest distance of the loop from the drawn line.",
);
const STITCH_OFF: Row = (
    "stitch-off-marks",
    "Deviation of the stitch from the marks",
    ErrorItemKind::Amount,
    Some("mm"),
    10.0,
    "Sum of the distances of both bites from their marks.",
);
const GAP: Row =
    ("gap", "Gap of the slit", ErrorItemKind::Amount, Some("mm"), 10.0, "Largest gap that the knot leaves open.");
const AVULSED: Row = (
    "model-torn-off",
    "Model torn off its block",
    ErrorItemKind::YesNo,
    None,
    50.0,
    "The drain or appendage comes off.",
);

/// An insecure knot costs some points, one that comes apart the most.
const fn knot(slips: f64, apart: f64) -> [Row; 2] {
    [
        (
            "knot-slips",
            "Knot slips",
            ErrorItemKind::YesNo,
            None,
            slips,
            "The knot gives way when it is pulled, but holds.",
        ),
        ("knot-apart", "Knot comes apart", ErrorItemKind::YesNo, None, apart, "The knot opens when it is pulled."),
    ]
}

/// Without an end, no points remain.
const fn unfinished(cut_off_s: f64) -> Row {
    let hint = "The task was given up, or its time was over.";
    ("not-finished", "Task not finished", ErrorItemKind::YesNo, None, cut_off_s, hint)
}

impl ErrorExample {
    /// All examples.
    pub fn all() -> Vec<Self> {
        let [slips, apart] = knot(10.0, 20.0);
        let [loop_slips, loop_apart] = knot(25.0, 50.0);
        vec![
            example("peg_transfer", "Peg transfer", 300.0, &[OUTSIDE]),
            example("circle_cut", "Circle cutting", 300.0, &[AREA_OFF]),
            example("loop", "Ligating loop", 180.0, &[LOOP_OFF, loop_slips, loop_apart]),
            example(
                "extracorporeal_knot",
                "Suture with extracorporeal knot",
                420.0,
                &[STITCH_OFF, GAP, slips, apart, AVULSED],
            ),
            example(
                "intracorporeal_knot",
                "Suture with intracorporeal knot",
                600.0,
                &[STITCH_OFF, GAP, slips, apart, AVULSED],
            ),
        ]
    }
}

fn example(example: &'static str, title: &'static str, cut_off_s: f64, rows: &[Row]) -> ErrorExample {
    let rows: Vec<Row> = rows.iter().copied().chain([unfinished(cut_off_s)]).collect();
    let item = |(item, name, kind, unit, _, hint): &Row| ErrorItem {
        item: (*item).to_owned(),
        name: (*name).to_owned(),
        kind: *kind,
        unit: unit.map(str::to_owned),
        hint: Some((*hint).to_owned()),
    };
    let formula = ScoreFormula {
        cut_off_s,
        time: ScoreTime::Measured,
        weights: rows.iter().map(|row| ItemWeight { item: row.0.to_owned(), weight: row.4 }).collect(),
        scale: Some(ScoreScale { norm: cut_off_s, maximum: 100.0, not_above: true }),
        not_below_zero: true,
        note: Some(NOTE.to_owned()),
    };
    ErrorExample { example, title, source: SOURCE, items: rows.iter().map(item).collect(), formula }
}
