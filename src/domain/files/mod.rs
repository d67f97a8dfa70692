//! Exchange formats that other programs rely on. These modules convert text to values and back; they do no file access.

pub mod annotations;
pub mod calibration;
pub mod camera;
pub mod features;
mod parquet_sink;
pub mod quality;
pub mod trajectory;
pub mod truth;

/// Maximum length of a tool's name, characters.
pub const MAX_TOOL_NAME_LENGTH: usize = 64;

/// True if a tool may have this name. Names are written into tables, where a spreadsheet would read `=…` as a formula.
pub fn is_tool_name(name: &str) -> bool {
    name.chars().next().is_some_and(char::is_alphanumeric)
        && name.chars().count() <= MAX_TOOL_NAME_LENGTH
        && !name.chars().any(char::is_control)
}

/// A tool's name as a message quotes it: without control characters, and at most [`MAX_TOOL_NAME_LENGTH`] characters of
/// it, since a name that is refused may have any text.
pub fn quoted_tool_name(name: &str) -> String {
    let mut characters = name.escape_debug();
    let shown: String = characters.by_ref().take(MAX_TOOL_NAME_LENGTH).collect();
    let rest = if characters.next().is_some() { "…" } else { "" };
    format!("`{shown}{rest}`")
}
