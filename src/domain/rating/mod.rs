//! Ratings: an instructor's marks for a session on a form.
//!
//! A rating names every item of its form, with a mark or explicitly as not judged; only a rating with a mark for every
//! item has a total. A rating never changes: the same rater's next rating replaces it, and the older one is kept.
//! **Blind:** a rater sees the marks and comments of others only after submitting their own; agreement and correlations
//! use only ratings that were given blind.

mod forms;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use forms::{FormInfo, ItemInfo};

use super::named;
use super::text::Invalid;

/// Lowest and highest mark of an item.
pub const MARK_RANGE: (u8, u8) = (1, 5);

named! {
    /// A form for ratings.
    RatingForm: "form" {
        /// Objective Structured Assessment of Technical Skills: the global rating scale.
        Osats = "osats",
        /// Global Operative Assessment of Laparoscopic Skills.
        Goals = "goals",
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
}

/// One item's mark.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ItemMark {
    /// Name of the item.
    pub item: String,
    /// 1 to 5; `null`: not judged.
    pub mark: Option<u8>,
}

impl NewRating {
    /// The marks in the form's order.
    ///
    /// # Errors
    /// Another wording than the present one, a missing or unknown item, a mark out of range, or no item judged.
    pub fn marks(&self) -> Result<Vec<ItemMark>, Invalid> {
        let form = FormInfo::of(self.form);
        if let Some(version) = self.version.filter(|version| *version != form.version) {
            let why =
                format!("is {version}; {} is at version {}: read GET /api/v1/rating-forms", form.form, form.version);
            return Err(Invalid::new("version", why));
        }
        if let Some(other) = self.items.keys().find(|name| form.items.iter().all(|item| item.name != name.as_str())) {
            let shown: String = other.chars().take(40).collect();
            return Err(Invalid::new("items", format!("`{shown}` is not an item of {}", form.form)));
        }
        let mark = |item: &ItemInfo| match self.items.get(item.name) {
            None => Err(Invalid::new("items", format!("`{}` is missing; send null if it was not judged", item.name))),
            Some(Some(mark)) if !(MARK_RANGE.0..=MARK_RANGE.1).contains(mark) => Err(Invalid::new(
                "items",
                format!("`{}` is {mark}; expected {} to {} or null", item.name, MARK_RANGE.0, MARK_RANGE.1),
            )),
            Some(mark) => Ok(ItemMark { item: item.name.to_owned(), mark: *mark }),
        };
        let marks = form.items.iter().map(mark).collect::<Result<Vec<ItemMark>, Invalid>>()?;
        if marks.iter().all(|mark| mark.mark.is_none()) {
            return Err(Invalid::new("items", "no item is judged; judge at least one"));
        }
        Ok(marks)
    }
}

/// The sum of all marks; `None` where an item was not judged, because sums over different items cannot be compared.
pub fn total(marks: &[ItemMark]) -> Option<u32> {
    marks.iter().map(|mark| mark.mark.map(u32::from)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(form: RatingForm, mark: Option<u8>) -> NewRating {
        let items = FormInfo::of(form).items.iter().map(|item| (item.name.to_owned(), mark)).collect();
        NewRating { form, version: None, items }
    }

    #[test]
    fn forms_have_the_published_number_of_items_each_with_three_anchors() {
        let counts: Vec<usize> = RatingForm::ALL.iter().map(|form| FormInfo::of(*form).items.len()).collect();
        assert_eq!(counts, [7, 5]);
        for form in FormInfo::all() {
            for item in form.items {
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
