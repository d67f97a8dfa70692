//! A session's verdict, in lines for people.

use crate::pipeline::quality::Verdict;

/// The verdict, and under it a line per reason: what was found, and what to do about it.
pub fn text(verdict: &Verdict) -> String {
    let head = match verdict {
        Verdict::Refused(_) => "verdict: refused; no feature of this session is to be believed\n".to_owned(),
        _ => format!("verdict: {}\n", verdict.title()),
    };
    let reasons = verdict.concerns().iter().map(|concern| format!("  – {}: {}\n", concern.finding(), concern.advice()));
    head + &reasons.collect::<String>()
}
