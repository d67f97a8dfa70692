//! Absences: where a tool was not seen, and the cause.

use super::{Adds, Cause, Errors, Question, What, seconds_of};
use crate::pipeline::features::FeatureSettings;
use crate::pipeline::features::motion::{Interval, Motion};
use crate::pipeline::features::view::absences;

/// The absences, of one cause or of all. Measurement errors do not affect them.
pub(super) fn of_tool<'a>(
    motions: &[&Motion],
    settings: &FeatureSettings,
    wanted: Option<Cause>,
    adds: Adds,
) -> Option<Question<'a>> {
    let own = motions[0];
    let cause = |at: Interval| {
        let known = own.known.absent.as_ref()?;
        known.iter().find(|absent| absent.interval.common(at).is_some()).map(|absent| absent.cause)
    };
    let all = absences(own, settings).ok()?.map(|absence| (absence, cause(absence)));
    let proposed = all.filter(|(_, cause)| wanted.is_none() || *cause == wanted).collect();
    Some(Question {
        what: What { name: "not_seen", unit: "s" },
        proposed,
        amount: Box::new(|motions, interval| Some(seconds_of(interval, motions.first()?))),
        usual: 0.0,
        less_is_worse: false,
        adds,
        errors: Errors::Not,
    })
}
