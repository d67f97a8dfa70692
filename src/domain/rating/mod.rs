//! Ratings: an instructor's marks for a session on a form.
//!
//! A rating names every item of its form: with a mark, as not judged, or as one that does not apply, such as the use of
//! assistants in a peg transfer. It has a total if each item that applies has a mark: the sum of these marks and the sum
//! that would be possible. Totals of different items are never compared: an item that is left out is not known to be as
//! good as the mean of the others, and a mean of fewer items varies more. A rating never changes: the same rater's next rating replaces it, and the older one is kept.
//! **Blind:** a rater sees the marks and comments of others only after submitting their own; agreement and correlations
//! use only ratings that were given blind.

mod forms;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use forms::{FormInfo, ItemInfo};

use super::named;
use super::text::{Invalid, Remark};

/// Lowest and highest mark of an item.
pub const MARK_RANGE: (u8, u8) = (1, 5);

named! {
    /// A form for ratings.
    RatingForm: "form" {
        /// Objective Structured Assessment of Technical Skills: the global rating scale.
        Osats = "osats",
        /// Global Operative Assessment of Laparoscopic Skills.
        Goals = "goals",
        /// The service's own form for box trainers: those items of the two that can be judged in a box.
        BoxTrainer = "box_trainer",
    }
}

/// A rating to be stored.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewRating {
    /// The form.
    pub form: RatingForm,
    /// Version of the form's wording; absent: the present one.
    #[serde(default)]
    pub version: Option<i64>,
    /// A mark from 1 to 5 for each item of the form, by the item's name; `null`: not judged.
    pub items: BTreeMap<String, Option<u8>>,
    /// Names of the items that do not apply to this session. They have no mark: `items` has `null` for them, or lacks them.
    #[serde(default)]
    pub does_not_apply: Vec<String>,
    /// A remark on the whole session: 1 to 2000 characters; line breaks are allowed.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub remark: Option<Remark>,
}

/// A rating that fits its form.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedRating {
    /// The form.
    pub form: RatingForm,
    /// Version of the form's wording.
    pub version: i64,
    /// The marks, in the form's order.
    pub items: Vec<ItemMark>,
    /// The remark on the whole session.
    pub remark: Option<Remark>,
}

/// One item's mark.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ItemMark {
    /// Name of the item.
    pub item: String,
    /// 1 to 5; `null`: not judged, or it does not apply.
    pub mark: Option<u8>,
    /// True if the item does not apply to the session. Ratings of earlier versions have no such items.
    #[serde(default)]
    pub does_not_apply: bool,
}

/// The total of the items that apply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct ApplicableTotal {
    /// Sum of the marks.
    pub sum: u32,
    /// The highest possible sum of these items.
    pub out_of: u32,
    /// Number of items that apply; all of them were judged.
    pub items: usize,
}

impl NewRating {
    /// The rating, with its marks in the form's order.
    ///
    /// # Errors
    /// What [`NewRating::marks`] refuses.
    pub fn check(self) -> Result<CheckedRating, Invalid> {
        let items = self.marks()?;
        Ok(CheckedRating { form: self.form, version: FormInfo::of(self.form).version, items, remark: self.remark })
    }

    /// The marks in the form's order.
    ///
    /// # Errors
    /// Another wording than the present one, a missing or unknown item, a mark out of range or of an item that does not
    /// apply, or no item judged.
    fn marks(&self) -> Result<Vec<ItemMark>, Invalid> {
        let form = FormInfo::of(self.form);
        if let Some(version) = self.version.filter(|version| *version != form.version) {
            let why =
                format!("is {version}; {} is at version {}: read GET /api/v1/rating-forms", form.form, form.version);
            return Err(Invalid::new("version", why));
        }
        let is_unknown = |name: &&String| form.items.iter().all(|item| item.name != name.as_str());
        for (field, unknown) in [
            ("items", self.items.keys().find(is_unknown)),
            ("does_not_apply", self.does_not_apply.iter().find(is_unknown)),
        ] {
            if let Some(unknown) = unknown {
                let shown: String = unknown.chars().take(40).collect();
                return Err(Invalid::new(field, format!("`{shown}` is not an item of {}", form.form)));
            }
        }
        let does_not_apply = |item: &ItemInfo| self.does_not_apply.iter().any(|name| name == item.name);
        let mark = |item: &ItemInfo| match self.items.get(item.name) {
            Some(Some(_)) if does_not_apply(item) => Err(Invalid::new(
                "does_not_apply",
                format!("`{}` has a mark; send null for an item that does not apply", item.name),
            )),
            Some(None) | None if does_not_apply(item) => {
                Ok(ItemMark { item: item.name.to_owned(), mark: None, does_not_apply: true })
            }
            None => Err(Invalid::new("items", format!("`{}` is missing; send null if it was not judged", item.name))),
            Some(Some(mark)) if !(MARK_RANGE.0..=MARK_RANGE.1).contains(mark) => Err(Invalid::new(
                "items",
                format!("`{}` is {mark}; expected {} to {} or null", item.name, MARK_RANGE.0, MARK_RANGE.1),
            )),
            Some(mark) => Ok(ItemMark { item: item.name.to_owned(), mark: *mark, does_not_apply: false }),
        };
        let marks = form.items.iter().map(mark).collect::<Result<Vec<ItemMark>, Invalid>>()?;
        if marks.iter().all(|mark| mark.mark.is_none()) {
            return Err(Invalid::new("items", "no item is judged; judge at least one"));
        }
        Ok(marks)
    }
}

/// The sum of all marks of the form; `None` if an item was not judged or does not apply.
pub fn total(marks: &[ItemMark]) -> Option<u32> {
    marks.iter().map(|mark| mark.mark.map(u32::from)).sum()
}

/// The total of the items that apply; `None` if one of them was not judged, or if none applies.
pub fn applicable_total(marks: &[ItemMark]) -> Option<ApplicableTotal> {
    let applicable: Vec<Option<u8>> = marks.iter().filter(|mark| !mark.does_not_apply).map(|mark| mark.mark).collect();
    let sum: u32 = applicable.iter().map(|mark| mark.map(u32::from)).sum::<Option<u32>>()?;
    let items = applicable.len();
    (items > 0).then_some(ApplicableTotal { sum, out_of: items as u32 * u32::from(MARK_RANGE.1), items })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(form: RatingForm, mark: Option<u8>) -> NewRating {
        let items = FormInfo::of(form).items.iter().map(|item| (item.name.to_owned(), mark)).collect();
        NewRating { form, version: None, items, does_not_apply: Vec::new(), remark: None }
    }

    #[test]
    fn forms_have_the_published_number_of_items_each_with_three_anchors() {
        let counts: Vec<usize> = RatingForm::ALL.iter().map(|form| FormInfo::of(*form).items.len()).collect();
        assert_eq!(counts, [7, 5, 6]);
        for form in FormInfo::all() {
            for item in form.items {
                assert_eq!(item.source.is_some(), !form.is_published, "only our own form needs a source for each item");
                let marks: Vec<u8> = item.anchors.iter().map(|anchor| anchor.mark).collect();
                assert_eq!(marks, [1, 3, 5], "{}", item.name);
            }
        }
    }

    #[test]
    fn a_rating_names_every_item_and_only_a_whole_one_has_a_total() {
        let whole = new(RatingForm::Osats, Some(4)).marks().unwrap();
        assert_eq!((whole.len(), total(&whole)), (7, Some(28)));
        assert_eq!(whole[0].item, "respect_for_tissue", "in the form's order, not the alphabet's");
        let mut partly = new(RatingForm::Osats, Some(4));
        partly.items.insert("flow".to_owned(), None);
        assert_eq!(total(&partly.marks().unwrap()), None);
        partly.items.remove("flow");
        assert!(partly.marks().unwrap_err().to_string().contains("flow"));
    }

    #[test]
    fn items_that_do_not_apply_leave_a_total_of_the_others_and_no_full_total() {
        let mut peg_transfer = new(RatingForm::Osats, Some(4));
        peg_transfer.items.insert("use_of_assistants".to_owned(), None);
        peg_transfer.items.remove("respect_for_tissue");
        peg_transfer.does_not_apply = vec!["use_of_assistants".to_owned(), "respect_for_tissue".to_owned()];
        let marks = peg_transfer.marks().unwrap();
        assert_eq!(
            (applicable_total(&marks), total(&marks)),
            (Some(ApplicableTotal { sum: 20, out_of: 25, items: 5 }), None)
        );
        assert!(marks[0].does_not_apply && marks[0].mark.is_none() && !marks[1].does_not_apply);
        peg_transfer.items.insert("flow".to_owned(), None);
        assert_eq!(applicable_total(&peg_transfer.marks().unwrap()), None, "an item that applies was not judged");
        peg_transfer.items.insert("use_of_assistants".to_owned(), Some(3));
        assert_eq!(peg_transfer.marks().unwrap_err().what, "does_not_apply");
        let mut none = new(RatingForm::Goals, None);
        none.does_not_apply = none.items.keys().cloned().collect();
        assert_eq!(none.marks().unwrap_err().what, "items", "a rating without any mark");
        let mut other = new(RatingForm::Goals, Some(3));
        other.does_not_apply = vec!["charm".to_owned()];
        assert_eq!(other.marks().unwrap_err().what, "does_not_apply");
    }

    #[test]
    fn marks_of_earlier_versions_have_only_items_that_apply() {
        let stored: Vec<ItemMark> =
            serde_json::from_str(r#"[{"item":"flow","mark":4},{"item":"autonomy","mark":null}]"#).unwrap();
        assert!(stored.iter().all(|mark| !mark.does_not_apply));
        assert_eq!(applicable_total(&stored), None);
        assert_eq!(applicable_total(&stored[..1]), Some(ApplicableTotal { sum: 4, out_of: 5, items: 1 }));
    }

    #[test]
    fn an_invalid_rating_is_refused_with_the_reason() {
        let with = |item: &str, mark| {
            let mut rating = new(RatingForm::Goals, Some(3));
            rating.items.insert(item.to_owned(), mark);
            rating.marks()
        };
        for mark in [0, 6, 255] {
            assert!(with("autonomy", Some(mark)).is_err(), "{mark}");
        }
        assert!(with("charm", Some(5)).unwrap_err().to_string().contains("charm"));
        assert!(new(RatingForm::Goals, None).marks().is_err());
        assert!(NewRating { version: Some(99), ..new(RatingForm::Goals, Some(3)) }.marks().is_err());
        assert!(serde_json::from_str::<NewRating>(r#"{"form":"goals","items":{"autonomy":2.5}}"#).is_err());
    }
}
