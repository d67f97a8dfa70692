//! Makes the texts of a child's problem safe to show.

use crate::analysis::child::MAX_TEXT_CHARS;
use crate::domain::problem::Problem;

/// Returns the problem with texts of limited length and without control characters.
pub(super) fn presentable(problem: Problem) -> Result<Problem, String> {
    let Problem { slug, title, detail } = problem;
    let is_slug = !slug.is_empty() && slug.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-');
    if !is_slug || slug.len() > MAX_TEXT_CHARS[0] {
        return Err("a problem without a valid slug".into());
    }
    let clean = |text: String, most: usize| -> String {
        text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(most).collect()
    };
    Ok(Problem { slug, title: clean(title, MAX_TEXT_CHARS[1]), detail: clean(detail, MAX_TEXT_CHARS[2]) })
}
