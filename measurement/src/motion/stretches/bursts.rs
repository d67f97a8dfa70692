//! Bursts: stretches of motion with power in a frequency band.

use super::{Additivity, ErrorEffect, StretchKind, StretchSearch, nodes_within};
use crate::motion::features::motion::{Interval, Motion};
use crate::motion::features::spectrum::BandSpeeds;

/// Stretches weighed by the speed of the tip within a frequency band, root mean square, mm/s.
pub(super) fn bursts_in_band<'a>(motions: &[&Motion], (low_hz, high_hz): (f64, f64)) -> StretchSearch<'a> {
    let own = motions[0];
    let bands = BandSpeeds::new(own.step_s);
    let steps = bands.length() as i64 - 1;
    let of_span = |span: Interval| {
        let starts =
            (0..).map(move |k| span.first + k * (steps + 1) / 2).take_while(move |from| from + steps <= span.last);
        starts.map(move |from| Interval { first: from, last: from + steps })
    };
    let proposed: Vec<Interval> = own.spans.iter().flat_map(|span| of_span(span.interval())).collect();
    let amount = move |motions: &[&Motion], interval: Interval| {
        Some(bands.rms_mm_s(nodes_within(motions.first()?, interval)?, low_hz, high_hz))
    };
    let squares: Vec<f64> = proposed.iter().filter_map(|at| amount(&[own], *at)).map(|rms| rms * rms).collect();
    let total: f64 = squares.iter().sum();
    StretchSearch {
        kind: StretchKind { name: "trembling", unit: "mm/s" },
        usual_amount: (total / squares.len().max(1) as f64).sqrt(),
        proposed: proposed.into_iter().map(|interval| (interval, None)).collect(),
        amount: Box::new(amount),
        less_is_worse: false,
        additivity: Additivity::SumOfSquares(total),
        error_effect: ErrorEffect::InSquares,
    }
}
