//! Checks a score that a child sent: its features are those of this program with possible numbers, and its texts are
//! short and safe to show.

use std::collections::HashSet;

use serde_json::Value;

use crate::analysis::child::limits::{MAX_TEXT_CHARS, is_plausible_number};
use crate::domain::evidence::{EvidenceRow, MAX_ROWS, StretchRow};
use crate::domain::feature::StoredFeatureKey;
use crate::domain::files::quality::stored_fulcrums;
use crate::domain::session::{FeatureError, FeatureRow, FeatureSpace};
use crate::motion::features;
use crate::motion::stretches::MAX_STRETCHES;
use crate::vision::pose::fulcrum::Fulcrum;

/// Longest quality document, bytes: a tool has about 2 KB, a reason 500 bytes.
const MAX_QUALITY_BYTES: usize = 256 << 10;

/// Longest text in a score, characters: a sentence or two.
const MAX_SENTENCE_CHARS: usize = 1000;

/// The verdicts of a quality document.
const VERDICTS: [&str; 3] = ["valid", "usable_with_care", REFUSED];

/// The verdict whose features have no values.
const REFUSED: &str = "refused";

/// Reads the quality document of a session with these tools.
pub(super) fn read_quality(json: &str, tools: &[String]) -> Result<Value, String> {
    if json.len() > MAX_QUALITY_BYTES {
        return Err(format!("a quality document of {} bytes", json.len()));
    }
    let quality: Value = serde_json::from_str(json).map_err(|error| format!("an unreadable quality: {error}"))?;
    let named: Option<Vec<&str>> = quality["tools"].as_array().and_then(|all| all.iter().map(tool_name).collect());
    let is_possible = quality.is_object()
        && quality["verdict"].as_str().is_some_and(|verdict| VERDICTS.contains(&verdict))
        && quality["reasons"].is_array()
        && quality["frames"].is_u64()
        && named.is_some_and(|named| named.into_iter().all(|name| tools.iter().any(|tool| tool == name)))
        && stored_fulcrums(&quality).iter().flat_map(Fulcrum::numbers).all(is_plausible_number)
        && has_safe_texts(&quality);
    if is_possible { Ok(quality) } else { Err("an impossible quality document".into()) }
}

fn tool_name(tool: &Value) -> Option<&str> {
    tool["tool"].as_str()
}

fn has_safe_texts(value: &Value) -> bool {
    match value {
        Value::Null | Value::Bool(_) | Value::Number(_) => true,
        Value::String(text) => is_sentence(text),
        Value::Array(items) => items.iter().all(has_safe_texts),
        Value::Object(fields) => fields.iter().all(|(name, value)| is_word(name) && has_safe_texts(value)),
    }
}

/// Checks the features of a session with these tools and this quality.
pub(super) fn check_features(rows: &[FeatureRow], tools: &[String], quality: &Value) -> Result<(), String> {
    if rows.len() > MAX_ROWS {
        return Err(format!("{} features", rows.len()));
    }
    let is_refused = quality["verdict"] == REFUSED;
    let mut seen = HashSet::new();
    for row in rows {
        let is_new = seen.insert((row.name.as_str(), row.tool.as_deref(), row.space));
        if !is_new || !is_possible_key(&row.into(), tools) || !is_possible_feature(row, is_refused) {
            return Err(format!("an impossible feature `{}`", row.name.escape_debug().take(40).collect::<String>()));
        }
    }
    Ok(())
}

fn is_possible_feature(row: &FeatureRow, is_refused: bool) -> bool {
    let Ok(feature) = features::find(&row.name) else { return false };
    let has_right_texts = row.title == feature.title && row.unit == feature.unit;
    has_right_texts
        && match (&row.value, &row.error) {
            (Ok(value), Some(error)) => !is_refused && value.is_finite() && is_possible_error(error),
            (Err(reason), None) => is_sentence(reason),
            _ => false,
        }
}

fn is_possible_error(error: &Result<FeatureError, String>) -> bool {
    match error {
        Ok(FeatureError { sigma, low, high, as_measured }) => {
            [sigma, low, high, as_measured].into_iter().all(|number| number.is_finite()) && *sigma >= 0.0 && low <= high
        }
        Err(reason) => is_sentence(reason),
    }
}

/// Reads the stretches of a session with these tools.
pub(super) fn read_evidence(json: &str, tools: &[String]) -> Result<Vec<EvidenceRow>, String> {
    let rows: Vec<EvidenceRow> =
        serde_json::from_str(json).map_err(|error| format!("unreadable stretches: {error}"))?;
    if rows.len() > MAX_ROWS {
        return Err(format!("the stretches of {} features", rows.len()));
    }
    match rows.iter().find(|row| !is_possible_evidence(row, tools)) {
        None => Ok(rows),
        Some(_) => Err("impossible stretches".into()),
    }
}

fn is_possible_evidence(row: &EvidenceRow, tools: &[String]) -> bool {
    let EvidenceRow { of, what, unit, stretches, none } = row;
    is_possible_key(of, tools)
        && what.iter().chain(unit).all(|text| is_word(text))
        && stretches.len() <= MAX_STRETCHES
        && stretches.iter().all(is_possible_stretch)
        && none.as_ref().is_none_or(|none| is_word(&none.reason) && is_sentence(&none.detail))
}

fn is_possible_stretch(stretch: &StretchRow) -> bool {
    let StretchRow { from_s, to_s, amount, share, cause: _ } = stretch;
    [*from_s, *to_s, *amount].into_iter().chain(*share).all(f64::is_finite) && from_s <= to_s
}

/// True for a feature of this program, of a known tool or of the session, in a space that it is measured in.
fn is_possible_key(key: &StoredFeatureKey, tools: &[String]) -> bool {
    features::find(&key.feature).is_ok_and(|feature| {
        feature.spaces.iter().any(|space| FeatureSpace::from(*space) == key.space)
            && key.tool.as_ref().is_none_or(|tool| tools.contains(tool))
    })
}

fn is_word(text: &str) -> bool {
    is_text(text, MAX_TEXT_CHARS[0])
}

fn is_sentence(text: &str) -> bool {
    is_text(text, MAX_SENTENCE_CHARS)
}

fn is_text(text: &str, most: usize) -> bool {
    text.chars().count() <= most && !text.chars().any(char::is_control)
}
