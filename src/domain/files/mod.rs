//! Exchange formats that other programs rely on. Text in, values out, and back; where the text lies is not their matter.

pub mod annotations;
pub mod calibration;
pub mod camera;
pub mod features;
pub mod quality;
pub mod trajectory;
pub mod truth;

/// Longest name of a tool, characters.
pub const LONGEST_TOOL_NAME: usize = 64;

/// Can a tool be called so? Names go into tables, where `=…` is a formula to a spreadsheet.
pub fn is_tool_name(name: &str) -> bool {
    name.chars().next().is_some_and(char::is_alphanumeric)
        && name.chars().count() <= LONGEST_TOOL_NAME
        && !name.chars().any(char::is_control)
}
