//! The figures as JSON for programs: every level and every state; `null` if there are too few data for a figure.

use serde_json::{Value, json};

use crate::checks::evaluation::{
    Accuracy, ErrorSpread, ErrorSummary, Lag, Repeatability, RestNoise, SigmaCheck, SigmaCoverage, ToolAccuracy,
    VisibilityLevel,
};

pub(super) fn accuracy(accuracy: &Accuracy) -> Value {
    json!({
        "tools": accuracy.tools.iter().map(tool).collect::<Vec<_>>(),
        "all": tool(&accuracy.all),
        "unjudged_rows": accuracy.rows_without_truth,
        "largest_time_difference_s": accuracy.largest_time_difference_s,
    })
}

fn tool(tool: &ToolAccuracy) -> Value {
    json!({
        "tool": tool.tool,
        "rows": tool.rows,
        "false_tracks": tool.false_tracks,
        "at_rest": tool.rest_noise.map(at_rest),
        "levels": tool.levels.iter().map(level).collect::<Vec<_>>(),
    })
}

fn at_rest(floor: RestNoise) -> Value {
    json!({ "rows": floor.rows, "rms_mm_s": floor.rms_mm_s, "median_mm_s": floor.median_mm_s })
}

fn level(level: &VisibilityLevel) -> Value {
    let (lag_s, sigma_s) = match level.lag {
        Lag::Measured { lag_s, sigma_s } => (Some(lag_s), Some(sigma_s)),
        Lag::TooLittleMotion => (None, None),
    };
    json!({
        "visible_from": level.visible_from,
        "frames": level.frames,
        "found": level.found,
        "observed": level.observed,
        "coverage": (level.frames > 0).then(|| level.found as f64 / level.frames as f64),
        "swaps": level.swaps,
        "lag_s": lag_s,
        "lag_sigma_s": sigma_s,
        "errors_mm": level.errors.as_ref().map(errors),
        "observed_errors_mm": level.observed_errors.as_ref().map(errors),
        "predicted_errors_mm": level.predicted_errors.as_ref().map(errors),
        "inside_95": level.sigma_check.map(honesty),
    })
}

fn errors(errors: &ErrorSummary) -> Value {
    let spread = |s: &ErrorSpread| json!({ "rms": s.rms, "median": s.median, "p95": s.p95, "max": s.max });
    json!({
        "rows": errors.rows,
        "lateral": spread(&errors.lateral),
        "depth": spread(&errors.depth),
        "3d": spread(&errors.three_d),
        "bias_xyz": errors.bias_mm.as_slice(),
        "deviation_xyz": errors.deviation_mm.as_slice(),
    })
}

fn honesty(honesty: SigmaCheck) -> Value {
    let SigmaCheck { lateral, depth, three_d, .. } = &honesty;
    let by = |of: fn(&SigmaCoverage) -> Value| json!({ "lateral": of(lateral), "depth": of(depth), "3d": of(three_d) });
    let mut value = by(|share| json!(share.inside));
    value["rows"] = json!(honesty.rows);
    value["interval"] = by(|share| json!(share.interval));
    value["mean_square"] = by(|share| json!(share.mean_square));
    value
}

pub(super) fn repeatability(result: &Repeatability) -> Value {
    json!({
        "paths": result.lines.len(),
        "others_mm": result.others_mm,
        "own_mm": result.own_mm,
        "mean_distance_mm": result.mean_distance_mm,
    })
}
