//! The quality verdict on a session, as text for people.

use crate::motion::quality::QualityVerdict;

/// The verdict, and one line per reason: the finding and what to do about it.
pub fn text(verdict: &QualityVerdict) -> String {
    let head = match verdict {
        QualityVerdict::Refused(_) => "verdict: refused; the features of this session are not reliable\n".to_owned(),
        _ => format!("verdict: {}\n", verdict.title()),
    };
    let reasons = verdict.concerns().iter().map(|concern| format!("  – {}: {}\n", concern.finding(), concern.advice()));
    head + &reasons.collect::<String>()
}
