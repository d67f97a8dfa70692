//! Edits of a scored session: trim its ends, swap two tools' names, correct its times, or set it aside so that it does
//! not count, or answer whether it shows its box. Measured data are never changed: the session is scored again from
//! what remains, or tracked again with other times, and each edit can be undone.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::clock::TimeCorrection;
use super::files::quoted_tool_name;
use super::named;
use super::text::{Invalid, Remark};
use crate::motion::quality::BoxAnswer;

/// Latest accepted second: no recording is longer than a day.
const MAX_TIME_S: f64 = 86_400.0;

named! {
    /// Kind of edit.
    EditKind: "kind" {
        /// Only a stretch counts; the recording before and after it is ignored.
        Trim = "trim",
        /// Two tools exchange names over a stretch.
        Swap = "swap",
        /// All times are scaled, so that the recording has its true frame rate or its true duration.
        Retime = "retime",
        /// The session is excluded from progress, cohorts, standards, models and correlations.
        SetAside = "set_aside",
        /// The answer to the question for the box: the recording shows the box that it is filed under, so it counts.
        ThisBox = "this_box",
        /// The answer to the question for the box: the recording shows another box, so it counts nowhere and its values
        /// are withheld.
        OtherBox = "other_box",
    }
}

impl EditKind {
    /// Is it an answer to the question for the box?
    pub fn is_box_answer(self) -> bool {
        matches!(self, EditKind::ThisBox | EditKind::OtherBox)
    }
}

named! {
    /// Whether the score reflects the session's edits.
    ScoreState: "state" {
        /// It was computed with the edits that are in force.
        Current = "current",
        /// It predates the last edit; the new score waits in the queue.
        Waiting = "waiting",
        /// The new score is being computed.
        Working = "working",
        /// The new score could not be computed; the problem says why.
        Failed = "failed",
    }
}

/// An edit as requested.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewEdit {
    /// Kind of edit.
    pub kind: EditKind,
    /// First second of the stretch: the part that counts (`trim`) or that has the names exchanged (`swap`). Absent for
    /// all other kinds.
    #[serde(default)]
    pub from_s: Option<f64>,
    /// Last second of the stretch.
    #[serde(default)]
    pub to_s: Option<f64>,
    /// For `swap`: the names of the two tools.
    #[serde(default)]
    pub tools: Option<[String; 2]>,
    /// For `retime`: the true frame rate, Hz. Give this or `true_duration_s`.
    #[serde(default)]
    pub true_frame_rate_hz: Option<f64>,
    /// For `retime`: the true time from the first frame to the last, s.
    #[serde(default)]
    pub true_duration_s: Option<f64>,
    /// The reason, for later readers: 1 to 2000 characters.
    #[schema(value_type = String)]
    pub why: Remark,
    /// `revision` of the list that the decision is based on. If another user has edited the session since, the edit is
    /// refused. Absent: edits before this request do not matter. An edit is always refused if the session is edited or
    /// tracked again while the edit is checked.
    #[serde(default)]
    pub revision: Option<u64>,
}

/// An edit after all checks that do not need the session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum EditChange {
    /// Only this span counts, s.
    Trim([f64; 2]),
    /// These two tools exchange names within the span, s.
    Swap([String; 2], [f64; 2]),
    /// The recording has another frame rate or duration than its stamps say.
    Retime(TimeCorrection),
    /// The session does not count.
    SetAside,
    /// The recording shows its box.
    ThisBox,
    /// The recording shows another box.
    OtherBox,
}

impl EditChange {
    /// Its kind.
    pub fn kind(&self) -> EditKind {
        match self {
            EditChange::Trim(_) => EditKind::Trim,
            EditChange::Swap(..) => EditKind::Swap,
            EditChange::Retime(_) => EditKind::Retime,
            EditChange::SetAside => EditKind::SetAside,
            EditChange::ThisBox => EditKind::ThisBox,
            EditChange::OtherBox => EditKind::OtherBox,
        }
    }

    /// The same edit after all times were multiplied by `ratio`.
    pub fn scaled(&self, ratio: f64) -> Self {
        let scaled = |span: &[f64; 2]| span.map(|time_s| time_s * ratio);
        match self {
            EditChange::Trim(span) => EditChange::Trim(scaled(span)),
            EditChange::Swap(tools, span) => EditChange::Swap(tools.clone(), scaled(span)),
            _ => self.clone(),
        }
    }

    /// The answer to the question for the box, if it is one.
    pub fn box_answer(&self) -> Option<BoxAnswer> {
        match self {
            EditChange::ThisBox => Some(BoxAnswer::ThisBox),
            EditChange::OtherBox => Some(BoxAnswer::OtherBox),
            _ => None,
        }
    }

    /// Start and end, s; `None` for an edit of the whole session.
    pub fn span(&self) -> Option<[f64; 2]> {
        match self {
            EditChange::Trim(span) | EditChange::Swap(_, span) => Some(*span),
            _ => None,
        }
    }
}

impl NewEdit {
    /// Checks the request and returns the edit.
    ///
    /// # Errors
    /// Seconds outside any recording, or fields that do not belong to the kind.
    pub fn change(&self) -> Result<EditChange, Invalid> {
        let time = TimeCorrection::new(self.true_frame_rate_hz, self.true_duration_s)?;
        if time.is_some() && self.kind != EditKind::Retime {
            return Err(Invalid::new("true_frame_rate_hz", "and `true_duration_s` belong only to a `retime`"));
        }
        let has_span = self.from_s.or(self.to_s).is_some();
        match (self.kind, self.tools.clone()) {
            (EditKind::Swap, None) => Err(Invalid::new("tools", "is missing: name the two tools to swap")),
            (EditKind::Swap, Some([one, other])) if one == other => {
                Err(Invalid::new("tools", format!("names {} twice; expected two tools", quoted_tool_name(&one))))
            }
            (EditKind::Swap, Some(tools)) => Ok(EditChange::Swap(tools, self.checked_span()?)),
            (_, Some(_)) => Err(Invalid::new("tools", "belongs only to a `swap`")),
            (EditKind::Trim, None) => Ok(EditChange::Trim(self.checked_span()?)),
            (_, None) if has_span => {
                let why = format!("and `to_s` do not belong to `{}`, which covers the whole session", self.kind);
                Err(Invalid::new("from_s", why))
            }
            (EditKind::Retime, None) => {
                let why = "is missing: give the true frame rate, or `true_duration_s`";
                time.map(EditChange::Retime).ok_or_else(|| Invalid::new("true_frame_rate_hz", why))
            }
            (EditKind::SetAside, None) => Ok(EditChange::SetAside),
            (EditKind::ThisBox, None) => Ok(EditChange::ThisBox),
            (EditKind::OtherBox, None) => Ok(EditChange::OtherBox),
        }
    }

    fn checked_span(&self) -> Result<[f64; 2], Invalid> {
        let second = |field: &'static str, value: Option<f64>| {
            let value = value.ok_or_else(|| Invalid::new(field, "is missing: give the first and last second"))?;
            if (0.0..=MAX_TIME_S).contains(&value) {
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

/// The edits in force that the score depends on, in the order they were made, with the revision of the session's edits.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EditsInForce {
    /// Number of trims, swaps, time corrections and answers made and undone so far.
    pub revision: u64,
    /// The edits in force that change the path.
    pub changes: Vec<EditChange>,
    /// A person's answer whether the recording shows its box.
    pub box_answer: Option<BoxAnswer>,
}

impl EditsInForce {
    /// The same edits after all times were multiplied by `ratio`.
    pub fn scaled(&self, ratio: f64) -> Self {
        Self { changes: self.changes.iter().map(|change| change.scaled(ratio)).collect(), ..*self }
    }
}

/// The span of a recording that remains after these edits: the intersection of its trims, s. `None`: all of it.
pub fn kept_span(changes: &[EditChange]) -> Option<[f64; 2]> {
    let trims = changes.iter().filter_map(|change| match change {
        EditChange::Trim(span) => Some(*span),
        _ => None,
    });
    trims.reduce(|[from, to], [later, sooner]| [from.max(later), to.min(sooner)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(kind: EditKind, span: [Option<f64>; 2], tools: Option<[&str; 2]>) -> Result<EditChange, Invalid> {
        let tools = tools.map(|tools| tools.map(str::to_owned));
        let why = "It began late.".parse().unwrap();
        let (true_frame_rate_hz, true_duration_s, revision) = (None, None, None);
        NewEdit { kind, from_s: span[0], to_s: span[1], tools, true_frame_rate_hz, true_duration_s, why, revision }
            .change()
    }

    #[test]
    fn a_retime_gives_one_number_and_covers_the_whole_session() {
        let new = |kind, [rate, duration, from_s]: [Option<f64>; 3]| {
            let why = "The clock in the picture says so.".parse().unwrap();
            let (to_s, true_frame_rate_hz, true_duration_s) = (from_s.map(|from| from + 1.0), rate, duration);
            let new =
                NewEdit { kind, from_s, to_s, tools: None, true_frame_rate_hz, true_duration_s, why, revision: None };
            new.change()
        };
        let right = new(EditKind::Retime, [Some(16.4), None, None]);
        assert_eq!(right, Ok(EditChange::Retime(TimeCorrection::FrameRate(16.4))));
        let right = new(EditKind::Retime, [None, Some(60.0), None]);
        assert_eq!(right, Ok(EditChange::Retime(TimeCorrection::Duration(60.0))));
        for (kind, given) in [
            (EditKind::Retime, [None; 3]),
            (EditKind::Retime, [Some(16.4), Some(60.0), None]),
            (EditKind::Retime, [Some(16.4), None, Some(1.0)]),
            (EditKind::Retime, [Some(0.0), None, None]),
            (EditKind::Trim, [Some(16.4), None, Some(1.0)]),
            (EditKind::SetAside, [Some(16.4), None, None]),
        ] {
            assert!(new(kind, given).is_err(), "{kind} {given:?}");
        }
    }

    #[test]
    fn seconds_follow_a_correction_of_the_times() {
        let pair = || ["orange".to_owned(), "cyan".to_owned()];
        let changes = vec![EditChange::Trim([2.0, 9.0]), EditChange::Swap(pair(), [4.0, 8.0]), EditChange::SetAside];
        let scaled = EditsInForce { revision: 3, changes, box_answer: Some(BoxAnswer::ThisBox) }.scaled(0.5);
        let expected = vec![EditChange::Trim([1.0, 4.5]), EditChange::Swap(pair(), [2.0, 4.0]), EditChange::SetAside];
        assert_eq!(scaled, EditsInForce { revision: 3, changes: expected, box_answer: Some(BoxAnswer::ThisBox) });
    }

    #[test]
    fn an_edit_has_what_its_kind_needs_and_nothing_else() {
        let (span, pair) = ([Some(2.0), Some(9.0)], Some(["orange", "cyan"]));
        assert_eq!(new(EditKind::Trim, span, None), Ok(EditChange::Trim([2.0, 9.0])));
        assert!(matches!(new(EditKind::Swap, span, pair), Ok(EditChange::Swap(..))));
        assert_eq!(new(EditKind::SetAside, [None; 2], None), Ok(EditChange::SetAside));
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
    fn the_intersection_of_all_trims_is_kept_in_any_order() {
        let trims = [EditChange::Trim([2.0, 9.0]), EditChange::SetAside, EditChange::Trim([4.0, 20.0])];
        assert_eq!(kept_span(&trims), Some([4.0, 9.0]));
        assert_eq!(kept_span(&[trims[2].clone(), trims[0].clone()]), Some([4.0, 9.0]));
        assert_eq!(kept_span(&[EditChange::SetAside]), None);
    }
}
