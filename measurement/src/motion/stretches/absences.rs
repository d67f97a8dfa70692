//! Absences: where a tool was not seen, and the cause.

use super::{Additivity, ErrorEffect, StretchKind, StretchSearch, UnseenCause, length_s};
use crate::motion::features::FeatureSettings;
use crate::motion::features::motion::{Interval, Motion};
use crate::motion::features::view::absences;

/// The absences, of one cause or of all. Measurement errors do not affect them.
pub(super) fn absences_of_tool<'a>(
    motions: &[&Motion],
    settings: &FeatureSettings,
    wanted: Option<UnseenCause>,
    adds: Additivity,
) -> Option<StretchSearch<'a>> {
    let own = motions[0];
    let cause = |at: Interval| {
        let known = own.context.absences.as_ref()?;
        known.iter().find(|absent| absent.interval.intersection(at).is_some()).map(|absent| absent.cause)
    };
    let all = absences(own, settings).ok()?.map(|absence| (absence, cause(absence)));
    let proposed = all.filter(|(_, cause)| wanted.is_none() || *cause == wanted).collect();
    Some(StretchSearch {
        kind: StretchKind { name: "not_seen", unit: "s" },
        proposed,
        amount: Box::new(|motions, interval| Some(length_s(interval, motions.first()?))),
        usual_amount: 0.0,
        less_is_worse: false,
        additivity: adds,
        error_effect: ErrorEffect::NoEffect,
    })
}
