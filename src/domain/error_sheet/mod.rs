//! Errors that a rater counts while watching a session: a task's list of error items, and a rater's sheet.
//!
//! A list is versioned like a standard: a changed list is the next version, and a sheet keeps the version that it was
//! begun with. An item keeps its short name, kind and unit for ever, so sheets of different versions can be compared.
//! Zero is a statement: only a **finished** sheet says that no error was seen. An amount that was not typed is unknown,
//! never zero.

mod examples;
mod formula;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use examples::ErrorExample;
pub use formula::{
    ErrorScore, ItemWeight, MAX_CUT_OFF_S, MeasuredTime, NewScoreFormula, NoErrorScore, ScoreFormula, ScorePart,
    ScoreScale, ScoreTime, SheetToScore,
};

use super::named;
use super::text::{Code, Invalid, Name, UnitName};

/// Maximum number of items in a list: a rater who watches cannot keep more in mind.
pub const MAX_ITEMS: usize = 12;

/// Maximum number of marks on one sheet.
pub const MAX_MARKS: i64 = 500;

/// Largest amount of an item, in its unit.
const MAX_AMOUNT: f64 = 1e6;

/// Latest accepted second: no recording is longer than a day.
const MAX_TIME_S: f64 = 86_400.0;

named! {
    /// How an error item is judged.
    ErrorItemKind: "kind" {
        /// Each event is counted.
        Count = "count",
        /// An amount is measured, in the item's unit.
        Amount = "amount",
        /// It happened, or it did not.
        YesNo = "yes_no",
    }
}

/// An item of a task's error list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ErrorItem {
    /// Short name, unique within the task. It keeps its kind and unit in all versions.
    pub item: String,
    /// Name for people.
    pub name: String,
    /// How it is judged.
    pub kind: ErrorItemKind,
    /// Unit of an amount; `null` for other kinds.
    pub unit: Option<String>,
    /// What counts as this error; `null` if nothing more needs to be said.
    pub hint: Option<String>,
}

/// An item of a list to be set.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewErrorItem {
    /// Short name of an item of an earlier version that is kept; absent: derived from the name.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub item: Option<Code>,
    /// Name for people.
    #[schema(value_type = String)]
    pub name: Name,
    /// How it is judged.
    pub kind: ErrorItemKind,
    /// Unit of an amount, such as `mm`: 1 to 12 characters. Absent for other kinds.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub unit: Option<UnitName>,
    /// What counts as this error: at most 120 characters.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub hint: Option<Name>,
}

/// A list to be set as the task's next version.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewErrorList {
    /// The items in their order, 0 to 12. Without items, no further sheets are begun.
    pub items: Vec<NewErrorItem>,
}

/// An error to be marked on the caller's open sheet.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewErrorMark {
    /// Short name of an item that is counted, or that is yes or no.
    pub item: String,
    /// Second of the recording at which it happened; absent: not at one moment.
    #[serde(default)]
    pub at_s: Option<f64>,
}

/// The typed values of the caller's open sheet.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewSheetValues {
    /// Amounts by the items' short names, at least 0. An absent amount is unknown, not zero.
    #[serde(default)]
    pub amounts: BTreeMap<String, f64>,
    /// Time of the task that the rater measured, s; absent: none.
    #[serde(default)]
    pub time_s: Option<f64>,
}

/// What a sheet says of one item.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ItemValue {
    /// Short name of the item.
    pub item: String,
    /// Number of events; amount in the item's unit; 1 for yes and 0 for no. `null`: the amount was not typed.
    pub value: Option<f64>,
}

impl NewErrorList {
    /// The list's items. `earlier` has the items of the earlier versions, the newest version first.
    ///
    /// # Errors
    /// Too many items, two of one name, a missing or needless unit, or an item of another kind than before.
    pub fn items(self, earlier: &[ErrorItem]) -> Result<Vec<ErrorItem>, Invalid> {
        if self.items.len() > MAX_ITEMS {
            return Err(Invalid::new("items", format!("are {}; expected at most {MAX_ITEMS}", self.items.len())));
        }
        let mut items: Vec<ErrorItem> = Vec::with_capacity(self.items.len());
        let named: Vec<String> = self.items.iter().filter_map(|new| new.item.as_ref().map(Code::to_string)).collect();
        for new in self.items {
            if items.iter().any(|item| item.name.eq_ignore_ascii_case(new.name.as_str())) {
                return Err(Invalid::new("items", format!("two items have the name `{}`", new.name)));
            }
            let item = new.item_after(&items, &named, earlier)?;
            if items.iter().any(|other| other.item == item.item) {
                return Err(Invalid::new("items", format!("two items have the short name `{}`", item.item)));
            }
            items.push(item);
        }
        Ok(items)
    }
}

impl NewErrorItem {
    /// The item with its short name. `before` are the items above it, `named` the short names that the list states.
    fn item_after(self, before: &[ErrorItem], named: &[String], earlier: &[ErrorItem]) -> Result<ErrorItem, Invalid> {
        match (self.kind, &self.unit) {
            (ErrorItemKind::Amount, None) => {
                return Err(Invalid::new(
                    "items",
                    format!("`{}` is an amount and needs a unit, such as mm", self.name),
                ));
            }
            (ErrorItemKind::Count | ErrorItemKind::YesNo, Some(_)) => {
                return Err(Invalid::new("items", format!("`{}` is no amount and takes no unit", self.name)));
            }
            _ => {}
        }
        let unit = self.unit.map(String::from);
        let same = |item: &ErrorItem| (item.kind, &item.unit) == (self.kind, &unit);
        let is_free = |code: &str| {
            let is_taken = named.iter().any(|name| name == code) || before.iter().any(|item| item.item == code);
            !is_taken && earlier.iter().filter(|item| item.item == code).all(same)
        };
        let item = match self.item {
            Some(given) => {
                let changed = earlier.iter().find(|item| item.item == given.as_str() && !same(item));
                if let Some(other) = changed {
                    let was = other.unit.as_deref().unwrap_or(other.kind.name());
                    let why = format!(
                        "`{given}` was {was} in an earlier version and cannot change: leave out `item`, so that it becomes a new one"
                    );
                    return Err(Invalid::new("items", why));
                }
                given.to_string()
            }
            None => {
                let code = Code::from_name(&self.name, "error");
                let numbered = (2..1000).map(|number| code.numbered(number));
                let mut codes = std::iter::once(code.clone()).chain(numbered).map(|code| code.to_string());
                codes.find(|code| is_free(code)).ok_or_else(|| Invalid::new("items", "have no short name left"))?
            }
        };
        Ok(ErrorItem { item, name: self.name.into(), kind: self.kind, unit, hint: self.hint.map(String::from) })
    }
}

impl NewErrorMark {
    /// Checks the mark against the items of its sheet.
    ///
    /// # Errors
    /// An unknown item, one whose amount is typed, or a second outside any recording.
    pub fn check(&self, items: &[ErrorItem]) -> Result<(), Invalid> {
        match find(items, &self.item)?.kind {
            ErrorItemKind::Amount => Err(Invalid::new("item", "is an amount: type it, with PUT …/error-sheet")),
            ErrorItemKind::Count | ErrorItemKind::YesNo => match self.at_s {
                Some(at) if !(0.0..=MAX_TIME_S).contains(&at) => {
                    Err(Invalid::new("at_s", format!("is {at}; expected a second of the recording")))
                }
                _ => Ok(()),
            },
        }
    }
}

impl NewSheetValues {
    /// Checks the values against the items of their sheet.
    ///
    /// # Errors
    /// An amount of an unknown item or of another kind, a negative or huge one, or an impossible time.
    pub fn check(&self, items: &[ErrorItem]) -> Result<(), Invalid> {
        for (name, amount) in &self.amounts {
            let item = find(items, name).map_err(|unknown| Invalid::new("amounts", unknown.why))?;
            if item.kind != ErrorItemKind::Amount {
                return Err(Invalid::new("amounts", format!("`{}` is marked, not typed", item.name)));
            }
            if !(0.0..=MAX_AMOUNT).contains(amount) {
                return Err(Invalid::new(
                    "amounts",
                    format!("`{}` is {amount}; expected 0 to {MAX_AMOUNT}", item.name),
                ));
            }
        }
        match self.time_s {
            Some(time) if !(time > 0.0 && time <= MAX_TIME_S) => {
                Err(Invalid::new("time_s", format!("is {time}; expected a time in seconds, more than 0")))
            }
            _ => Ok(()),
        }
    }
}

/// What a sheet says of each of its items. `marks` are items with their amounts.
pub fn values_of<'m>(
    items: &[ErrorItem],
    marks: impl Iterator<Item = (&'m str, Option<f64>)> + Clone,
) -> Vec<ItemValue> {
    let value = |item: &ErrorItem| {
        let mut own = marks.clone().filter(|(of, _)| *of == item.item);
        let value = match item.kind {
            ErrorItemKind::Count => Some(own.count() as f64),
            ErrorItemKind::YesNo => Some(f64::from(u8::from(own.next().is_some()))),
            ErrorItemKind::Amount => own.next().and_then(|(_, amount)| amount),
        };
        ItemValue { item: item.item.clone(), value }
    };
    items.iter().map(value).collect()
}

/// The item with this short name.
fn find<'i>(items: &'i [ErrorItem], name: &str) -> Result<&'i ErrorItem, Invalid> {
    items.iter().find(|item| item.item == name).ok_or_else(|| {
        let shown: String = name.chars().take(40).collect();
        Invalid::new("item", format!("`{shown}` is not an item of this sheet"))
    })
}

#[cfg(test)]
mod tests;
