//! Selects and formats the figures that people see, for the terminal and for the page.

use crate::checks::evaluation::{Accuracy, ErrorSummary, Lag, RestNoise, SigmaCoverage, ToolAccuracy, VisibilityLevel};

/// Text of a missing figure.
pub(super) const NO_VALUE: &str = "–";

/// The tools and levels worth a row: all tools together only if there are several, a stricter visibility only if it
/// drops frames.
pub(super) fn rows(accuracy: &Accuracy) -> Vec<(&ToolAccuracy, &VisibilityLevel)> {
    let of_tool = |tool: &'_ ToolAccuracy| {
        let repeats = |at: usize| at > 0 && tool.levels[at].frames == tool.levels[at - 1].frames;
        (0..tool.levels.len()).filter(|at| !repeats(*at)).collect::<Vec<_>>()
    };
    tools(accuracy)
        .into_iter()
        .flat_map(|tool| of_tool(tool).into_iter().map(move |at| (tool, &tool.levels[at])))
        .collect()
}

/// Each tool, and all tools together if there are several.
pub(super) fn tools(accuracy: &Accuracy) -> Vec<&ToolAccuracy> {
    let together = Some(&accuracy.all).filter(|_| accuracy.tools.len() > 1);
    accuracy.tools.iter().chain(together).collect()
}

/// Errors of all rows; if some rows are predicted, also the errors of each state.
pub(super) fn states(level: &VisibilityLevel) -> Vec<(&'static str, &ErrorSummary)> {
    let apart = level.predicted_errors.is_some();
    let kinds = [
        ("all", &level.errors),
        ("observed", if apart { &level.observed_errors } else { &None }),
        ("predicted", &level.predicted_errors),
    ];
    kinds.into_iter().filter_map(|(state, errors)| Some((state, errors.as_ref()?))).collect()
}

pub(super) fn name(tool: &ToolAccuracy) -> &str {
    tool.tool.as_deref().unwrap_or("all")
}

pub(super) fn found(level: &VisibilityLevel) -> String {
    if level.frames == 0 { NO_VALUE.to_owned() } else { percent(level.found as f64 / level.frames as f64) }
}

pub(super) fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

/// Milliseconds ± twice the standard error (95 %).
pub(super) fn lag(lag: Lag) -> String {
    match lag {
        Lag::Measured { lag_s, sigma_s } => format!("{:.1} ± {:.1}", 1000.0 * lag_s, 2000.0 * sigma_s),
        Lag::TooLittleMotion => "too little motion".to_owned(),
    }
}

/// Per cent inside the region, with the 95 % interval of the true share.
pub(super) fn share(share: &SigmaCoverage) -> String {
    let [low, high] = share.interval.map(|end| 100.0 * end);
    format!("{} ({low:.0}–{high:.0})", percent(share.inside))
}

/// Number of rows, median and RMS of the speed at rest, mm/s.
pub(super) fn at_rest(floor: &RestNoise) -> [String; 3] {
    [floor.rows.to_string(), format!("{:.2}", floor.median_mm_s), format!("{:.2}", floor.rms_mm_s)]
}
