//! An exercise that trainees do in a box.

use serde::{Deserialize, Serialize};

use super::rating::RatingForm;
use super::text::{Code, Invalid, Name, Paragraphs};
use crate::ids::GroupId;

/// A task to be registered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTask {
    /// Name for people.
    pub name: Name,
    /// Short unique name; derived from `name` if absent.
    pub code: Option<Code>,
    /// Instructions for trainees.
    pub description: Option<Paragraphs>,
    /// The forms that its sessions are rated on. Absent or empty: all.
    #[serde(default)]
    pub rating_forms: Option<Vec<RatingForm>>,
    /// The groups whose instructors may change it. Absent: all groups of the instructor who registers it; for an
    /// administrator none, so that only administrators may change it.
    pub groups: Option<Vec<GroupId>>,
}

/// Changes to a task; absent fields stay as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TaskChange {
    /// New name.
    pub name: Option<Name>,
    /// New code.
    pub code: Option<Code>,
    /// New description.
    pub description: Option<Paragraphs>,
    /// The forms that its sessions are rated on from now on; empty: all. Ratings on other forms stay.
    #[serde(default)]
    pub rating_forms: Option<Vec<RatingForm>>,
    /// The groups whose instructors may change it. An instructor names own groups, at least one; other groups stay.
    pub groups: Option<Vec<GroupId>>,
}

/// The forms of a task as they are stored: each once, in the order of the list of forms; `None`: all.
pub fn chosen_forms(forms: &[RatingForm]) -> Option<Vec<RatingForm>> {
    let chosen: Vec<RatingForm> = RatingForm::ALL.iter().copied().filter(|form| forms.contains(form)).collect();
    (!chosen.is_empty() && chosen.len() < RatingForm::ALL.len()).then_some(chosen)
}

/// Refuses a form that the task does not use. `forms`: as they are stored.
///
/// # Errors
/// The form is not among the task's forms.
pub fn require_form(forms: Option<&[RatingForm]>, form: RatingForm) -> Result<(), Invalid> {
    let Some(forms) = forms.filter(|forms| !forms.contains(&form)) else { return Ok(()) };
    let names: Vec<&str> = forms.iter().map(|form| form.name()).collect();
    Err(Invalid::new("form", format!("is {form}; sessions of this task are rated on {}", names.join(", "))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_that_uses_all_forms_also_uses_those_of_later_versions() {
        assert_eq!((chosen_forms(&[]), chosen_forms(RatingForm::ALL)), (None, None));
        let chosen = chosen_forms(&[RatingForm::BoxTrainer, RatingForm::Goals, RatingForm::BoxTrainer]).unwrap();
        assert_eq!(chosen, [RatingForm::Goals, RatingForm::BoxTrainer]);
        assert!(require_form(None, RatingForm::Osats).is_ok());
        assert!(require_form(Some(&chosen), RatingForm::Goals).is_ok());
        assert_eq!(require_form(Some(&chosen), RatingForm::Osats).unwrap_err().what, "form");
    }
}
