//! What people change about a scored session: cut off its ends, exchange two tools' names, let it not count. Nothing that was measured
//! is touched; scores are made anew of what is left, and each change can be undone.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::named;
use super::text::{Invalid, Remark};

/// Latest second that can be meant: no recording is longer than a day.
const LATEST_S: f64 = 86_400.0;

named! {
    /// What kind of change.
    EditKind: "kind" {
        /// What lies before and after a stretch counts no more.
        Trim = "trim",
        /// Two tools change names over a stretch.
        Swap = "swap",
        /// The session counts in nothing: no progress, cohort, standard, model or correlation.
        SetAside = "set_aside",
    }
}

named! {
    /// How the score stands to a session's edits.
    ScoreState: "state" {
        /// It is made with the edits that are in force.
        Current = "current",
        /// It is of before the last edit; the new one waits for its turn.
        Waiting = "waiting",
        /// The new one is being made.
        Working = "working",
        /// The new one could not be made; the problem says why.
        Failed = "failed",
    }
}

/// A change to be made.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewEdit {
    /// What is changed.
    pub kind: EditKind,
    /// `trim`: from which second of the recording it counts; `swap`: from which the names are exchanged. Not of `set_aside`.
    #[serde(default)]
    pub from_s: Option<f64>,
    /// To which second.
    #[serde(default)]
    pub to_s: Option<f64>,
    /// `swap`: the names of the two tools.
    #[serde(default)]
    pub tools: Option<[String; 2]>,
    /// Why, for who reads it later: 1 to 2000 characters.
    #[schema(value_type = String)]
    pub why: Remark,
    /// `revision` of the list that it was decided by. If somebody else has edited the session since, nothing is done; without it, the
    /// edit is made all the same.
    #[serde(default)]
    pub revision: Option<u64>,
}

/// A change, checked as far as it can be without the session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Change {
    /// Only what lies within counts, s.
    Trim([f64; 2]),
    /// These two change names within, s.
    Swap([String; 2], [f64; 2]),
    /// The session counts in nothing.
    SetAside,
}

impl Change {
    /// Its kind.
    pub fn kind(&self) -> EditKind {
        match self {
            Change::Trim(_) => EditKind::Trim,
            Change::Swap(..) => EditKind::Swap,
            Change::SetAside => EditKind::SetAside,
        }
    }

    /// From when to when, s; `None` of what is about the whole session.
    pub fn span(&self) -> Option<[f64; 2]> {
        match self {
            Change::Trim(span) | Change::Swap(_, span) => Some(*span),
            Change::SetAside => None,
        }
    }
}

impl NewEdit {
    /// What is to be changed.
    ///
    /// # Errors
    /// Seconds that no recording has, or fields that do not go with the kind.
    pub fn change(&self) -> Result<Change, Invalid> {
        match (self.kind, self.tools.clone()) {
            (EditKind::Swap, None) => Err(Invalid::new("tools", "is missing: say which two tools change names")),
            (EditKind::Swap, Some([one, other])) if one == other => {
                Err(Invalid::new("tools", format!("names `{one}` twice; expected two tools")))
            }
            (EditKind::Swap, Some(tools)) => Ok(Change::Swap(tools, self.within()?)),
            (_, Some(_)) => Err(Invalid::new("tools", "is only of a `swap`")),
            (EditKind::Trim, None) => Ok(Change::Trim(self.within()?)),
            (EditKind::SetAside, None) if self.from_s.or(self.to_s).is_some() => {
                Err(Invalid::new("from_s", "and `to_s` are not of `set_aside`, which is about the whole session"))
            }
            (EditKind::SetAside, None) => Ok(Change::SetAside),
        }
    }

    fn within(&self) -> Result<[f64; 2], Invalid> {
        let second = |field: &'static str, value: Option<f64>| {
            let value = value.ok_or_else(|| Invalid::new(field, "is missing: say from which second to which"))?;
            if (0.0..=LATEST_S).contains(&value) {
                return Ok(value);
            }
            Err(Invalid::new(field, format!("is {value}; expected a second of the recording")))
        };
        let (from_s, to_s) = (second("from_s", self.from_s)?, second("to_s", self.to_s)?);
        if from_s < to_s {
            return Ok([from_s, to_s]);
        }
        Err(Invalid::new("to_s", format!("is {to_s}; expected a second after `from_s`")))
    }
}

/// The trims and swaps that are in force, in the order in which they were made, and which state of the session's edits that is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EditsInForce {
    /// Trims and swaps made and undone so far.
    pub revision: u64,
    /// Those that are in force.
    pub changes: Vec<Change>,
}

/// What is left of a recording by these changes: what lies within all of its trims, s. `None`: all of it.
pub fn kept(changes: &[Change]) -> Option<[f64; 2]> {
    let trims = changes.iter().filter_map(|change| match change {
        Change::Trim(span) => Some(*span),
        _ => None,
    });
    trims.reduce(|[from, to], [later, sooner]| [from.max(later), to.min(sooner)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(kind: EditKind, span: [Option<f64>; 2], tools: Option<[&str; 2]>) -> Result<Change, Invalid> {
        let tools = tools.map(|tools| tools.map(str::to_owned));
        let why = "It began late.".parse().unwrap();
        NewEdit { kind, from_s: span[0], to_s: span[1], tools, why, revision: None }.change()
    }

    #[test]
    fn an_edit_has_what_its_kind_needs_and_nothing_else() {
        let (span, pair) = ([Some(2.0), Some(9.0)], Some(["orange", "cyan"]));
        assert_eq!(new(EditKind::Trim, span, None), Ok(Change::Trim([2.0, 9.0])));
        assert!(matches!(new(EditKind::Swap, span, pair), Ok(Change::Swap(..))));
        assert_eq!(new(EditKind::SetAside, [None; 2], None), Ok(Change::SetAside));
        for (kind, span, tools) in [
            (EditKind::Trim, [None; 2], None),
            (EditKind::Trim, [Some(2.0), None], None),
            (EditKind::Trim, span, pair),
            (EditKind::Swap, span, None),
            (EditKind::Swap, span, Some(["cyan", "cyan"])),
            (EditKind::Swap, [None; 2], pair),
            (EditKind::SetAside, span, None),
            (EditKind::SetAside, [None; 2], pair),
        ] {
            assert!(new(kind, span, tools).is_err(), "{kind} {span:?} {tools:?}");
        }
    }

    #[test]
    fn seconds_that_no_recording_has_are_refused() {
        for [from, to] in [[-1.0, 5.0], [f64::NAN, 5.0], [1.0, f64::NAN], [1.0, f64::INFINITY], [5.0, 5.0], [5.0, 4.0]]
        {
            assert!(new(EditKind::Trim, [Some(from), Some(to)], None).is_err(), "{from} {to}");
        }
    }

    #[test]
    fn what_lies_within_all_trims_is_kept_in_whatever_order_they_were_made() {
        let trims = [Change::Trim([2.0, 9.0]), Change::SetAside, Change::Trim([4.0, 20.0])];
        assert_eq!(kept(&trims), Some([4.0, 9.0]));
        assert_eq!(kept(&[trims[2].clone(), trims[0].clone()]), Some([4.0, 9.0]));
        assert_eq!(kept(&[Change::SetAside]), None);
    }
}
