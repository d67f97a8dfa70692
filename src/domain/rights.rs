//! What instructors may do beyond their own groups. `docs/rights.md` has the table of all roles.

use serde::{Deserialize, Serialize};

/// The section `[rights]` of the settings file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RightsSettings {
    /// Instructors change the boxes, tasks, standards and course plans of all groups, not only those of their own.
    /// Suits a centre where all instructors share everything. Default false.
    pub instructors_edit_all: bool,
    /// Instructors erase trainees of their groups even if the trainee is in several groups. Default false: then only
    /// administrators erase them, because another group still trains them.
    pub instructors_erase_shared: bool,
}
