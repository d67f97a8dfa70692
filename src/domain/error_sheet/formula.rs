//! A task's score formula: cut-off time − time − Σ weight × errors, scaled. It is built from named parts, so that no
//! program has to be written or trusted to compute it.
//!
//! **In:** the finished sheets of a session, and its measured duration with the error bar. **Out:** the score with its
//! bar and all of its parts, or the reason why there is none. **Method:** errors, and typed times, are the mean over the
//! sheets; scaling and limits come last. The bar reaches from the sheet with the fewest points at the upper end of the
//! time to the sheet with the most at its lower end: with one sheet it is the bar of the time alone. **Assumes** weights
//! of at least 0, so more errors never raise the score. **Gives up** rather than assume a zero that no rater stated.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ErrorItem, ErrorItemKind, ItemValue, MAX_ITEMS};
use crate::domain::named;
use crate::domain::text::{Invalid, Name};
use crate::time::Day;

/// Largest cut-off time, s: a day.
pub const MAX_CUT_OFF_S: f64 = 86_400.0;

/// Largest distance of a formula's first day from today, days: ten years.
const MAX_DAYS: u32 = 3650;

/// Largest weight, norm and maximum.
const MAX_NUMBER: f64 = 1e6;

named! {
    /// The time in a score.
    ScoreTime: "time" {
        /// The session's measured duration, with its error bar.
        Measured = "measured",
        /// The time that the rater typed.
        Typed = "typed",
    }
}

named! {
    /// Why a session has no error score.
    NoErrorScore: "reason" {
        /// The task has no formula.
        NoFormula = "no_formula",
        /// The task's formula is not valid on the session's day.
        NotValidYet = "not_valid_yet",
        /// The session was set aside, and counts nowhere.
        SetAside = "set_aside",
        /// The session is an attempt of an exam that was declared void, and counts nowhere.
        Voided = "voided",
        /// The session may show another box.
        BoxAsked = "box_asked",
        /// No rater has finished a sheet: the errors are unknown, not zero.
        NoSheet = "no_sheet",
        /// The sheets of others are hidden until the caller has finished one.
        Hidden = "hidden",
        /// No finished sheet has all items of the formula.
        ItemMissing = "item_missing",
        /// No finished sheet has all amounts of the formula.
        AmountMissing = "amount_missing",
        /// No finished sheet has a typed time.
        TimeMissing = "time_missing",
        /// The session is not scored yet, or could not be.
        NotScored = "not_scored",
        /// The quality gate refused the session.
        Refused = "refused",
        /// The recording shows only a part of the attempt.
        OnlyPart = "only_part",
        /// The duration could not be measured.
        NoDuration = "no_duration",
    }
}

impl NoErrorScore {
    /// The reason for people.
    pub fn detail(self) -> &'static str {
        match self {
            Self::NoFormula => "The task has no score formula.",
            Self::NotValidYet => "No version of the task's score formula is valid on the day of this session.",
            Self::SetAside => "The session was set aside, so it counts nowhere.",
            Self::Voided => "The session is an attempt of an exam that was declared void, so it counts nowhere.",
            Self::BoxAsked => "The session may show another box: staff have to say whether it does.",
            Self::NoSheet => "Not rated: no error sheet is finished. That is not the same as no errors.",
            Self::Hidden => "The sheets of others are shown after you have finished your own.",
            Self::ItemMissing => "The finished sheets lack an item of the formula: they are of another version.",
            Self::AmountMissing => "An amount that the formula needs was not typed on any finished sheet.",
            Self::TimeMissing => "The formula needs a typed time, and no finished sheet has one.",
            Self::NotScored => "The session has no measured duration yet.",
            Self::Refused => "The quality check refused the session, so its duration is not promised.",
            Self::OnlyPart => {
                "The recording shows only a part of the attempt, so its duration is longer than measured."
            }
            Self::NoDuration => "The duration of the session could not be measured.",
        }
    }
}

/// A task's score formula as stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScoreFormula {
    /// Cut-off time, s: the points at the start.
    pub cut_off_s: f64,
    /// The time that is subtracted.
    pub time: ScoreTime,
    /// The errors that are subtracted, with their weights.
    pub weights: Vec<ItemWeight>,
    /// How the points are scaled; `null`: not at all.
    pub scale: Option<ScoreScale>,
    /// True if a negative score becomes 0.
    pub not_below_zero: bool,
    /// What people should know of it, such as its source; `null`: nothing.
    pub note: Option<String>,
}

/// The weight of an error item.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ItemWeight {
    /// Short name of the item.
    pub item: String,
    /// Points for each event, for each unit of the amount, or for a yes; more than 0.
    pub weight: f64,
}

/// The scale of a score: points / `norm` × `maximum`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ScoreScale {
    /// The points that give `maximum`.
    pub norm: f64,
    /// The score for `norm` points, usually 100.
    pub maximum: f64,
    /// True if a higher score becomes `maximum`.
    pub not_above: bool,
}

/// A formula to be set as the task's next version, or to be tried.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewScoreFormula {
    /// Cut-off time, s: more than 0, at most a day.
    pub cut_off_s: f64,
    /// The time that is subtracted.
    pub time: ScoreTime,
    /// The errors that are subtracted, with their weights; each item at most once.
    #[serde(default)]
    pub weights: Vec<ItemWeight>,
    /// How the points are scaled; absent: not at all.
    #[serde(default)]
    pub scale: Option<ScoreScale>,
    /// True if a negative score becomes 0.
    #[serde(default)]
    pub not_below_zero: bool,
    /// What people should know of it, such as its source: at most 120 characters.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub note: Option<Name>,
    /// The first day of the sessions that it scores, such as `2026-11-21`. Sessions that arrived earlier keep the version
    /// before. Absent: today, and for the task's first version all sessions.
    #[serde(default)]
    pub valid_from: Option<Day>,
}

/// The duration of a session.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredTime {
    /// Its value, s.
    pub value: f64,
    /// Its 95 % error bar, s; `None` if the error is unknown.
    pub bar: Option<[f64; 2]>,
}

/// What a finished sheet contributes to a score.
#[derive(Clone, Debug, PartialEq)]
pub struct SheetToScore {
    /// The items of its list.
    pub items: Vec<ErrorItem>,
    /// What it says of each item.
    pub values: Vec<ItemValue>,
    /// The typed time, s.
    pub time_s: Option<f64>,
}

/// One subtracted error of a score.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ScorePart {
    /// Short name of the item.
    pub item: String,
    /// Its name for people, by the newest sheet.
    pub name: String,
    /// How it is judged.
    pub kind: ErrorItemKind,
    /// Unit of an amount; `null` for other kinds.
    pub unit: Option<String>,
    /// Points for each event, unit or yes.
    pub weight: f64,
    /// Mean over the sheets: events, amount, or share of yes.
    pub mean: f64,
    /// The lowest value on a sheet.
    pub lowest: f64,
    /// The highest value on a sheet.
    pub highest: f64,
}

/// A session's score with all of its parts.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ErrorScore {
    /// The score.
    pub value: f64,
    /// Lower end of its error bar: the sheet with the fewest points at the upper end of the time's 95 % bar. `null` if
    /// the error of the time is unknown.
    pub low: Option<f64>,
    /// Upper end of its error bar.
    pub high: Option<f64>,
    /// The points before scale and limits.
    pub points: f64,
    /// Cut-off time, s.
    pub cut_off_s: f64,
    /// The subtracted time, s: measured, or the mean of the typed ones.
    pub time_s: f64,
    /// Lower end of the time's bar: 95 % for a measured time, the lowest for typed ones. `null` if it is unknown.
    pub time_low_s: Option<f64>,
    /// Upper end of the time's bar.
    pub time_high_s: Option<f64>,
    /// The subtracted errors.
    pub parts: Vec<ScorePart>,
    /// Number of finished sheets in it.
    pub sheets: usize,
    /// Number of finished sheets that were left out, since they lack an item, an amount or a time.
    pub left_out: usize,
}

impl NewScoreFormula {
    /// The formula. `items` are those of the task's present list.
    ///
    /// # Errors
    /// A number out of range, an item twice, or an item that the list lacks.
    pub fn checked(self, items: &[ErrorItem]) -> Result<ScoreFormula, Invalid> {
        let is_positive = |value: f64, most: f64| value > 0.0 && value <= most;
        if !is_positive(self.cut_off_s, MAX_CUT_OFF_S) {
            let why = format!("is {}; expected more than 0 and at most {MAX_CUT_OFF_S} s", self.cut_off_s);
            return Err(Invalid::new("cut_off_s", why));
        }
        if self.weights.len() > MAX_ITEMS {
            return Err(Invalid::new("weights", format!("are {}; expected at most {MAX_ITEMS}", self.weights.len())));
        }
        for (number, ItemWeight { item, weight }) in self.weights.iter().enumerate() {
            let shown: String = item.chars().take(40).collect();
            if items.iter().all(|known| known.item != *item) {
                return Err(Invalid::new("weights", format!("`{shown}` is not an item of the task's error list")));
            }
            if self.weights[..number].iter().any(|before| before.item == *item) {
                return Err(Invalid::new("weights", format!("`{shown}` is there twice")));
            }
            if !is_positive(*weight, MAX_NUMBER) {
                let why = format!("`{shown}` has {weight}; expected more than 0 and at most {MAX_NUMBER}");
                return Err(Invalid::new("weights", why));
            }
        }
        if let Some(ScoreScale { norm, maximum, .. }) = self.scale
            && !(is_positive(norm, MAX_NUMBER) && is_positive(maximum, MAX_NUMBER))
        {
            return Err(Invalid::new("scale", format!("needs numbers of more than 0 and at most {MAX_NUMBER}")));
        }
        let Self { cut_off_s, time, weights, scale, not_below_zero, note, .. } = self;
        Ok(ScoreFormula { cut_off_s, time, weights, scale, not_below_zero, note: note.map(String::from) })
    }
}

impl NewScoreFormula {
    /// The first day of the sessions that it scores; `None`: it scores all.
    ///
    /// # Errors
    /// A day that is not within ten years of today: it is mistyped.
    pub fn first_day(&self, today: Day, is_first_version: bool) -> Result<Option<Day>, Invalid> {
        let Some(day) = self.valid_from.or((!is_first_version).then_some(today)) else { return Ok(None) };
        match day <= today.plus_days(MAX_DAYS) && today <= day.plus_days(MAX_DAYS) {
            true => Ok(Some(day)),
            false => Err(Invalid::new("valid_from", format!("is {day}; expected a day within ten years of {today}"))),
        }
    }
}

/// A sheet's points without the measured time.
struct SheetPoints {
    values: Vec<f64>,
    penalty: f64,
    time_s: Option<f64>,
}

impl ScoreFormula {
    /// The score of a session. `measured` is read only if the formula needs it.
    ///
    /// # Errors
    /// No complete sheet, or no duration.
    pub fn score(
        &self,
        sheets: &[SheetToScore],
        measured: Result<MeasuredTime, NoErrorScore>,
    ) -> Result<ErrorScore, NoErrorScore> {
        let newest = sheets.last().ok_or(NoErrorScore::NoSheet)?;
        let points: Vec<Result<SheetPoints, NoErrorScore>> = sheets.iter().map(|sheet| self.points(sheet)).collect();
        let left_out = points.iter().filter(|points| points.is_err()).count();
        let first_gap = points.iter().find_map(|points| points.as_ref().err().copied());
        let complete: Vec<SheetPoints> = points.into_iter().filter_map(Result::ok).collect();
        if complete.is_empty() {
            return Err(first_gap.unwrap_or(NoErrorScore::NoSheet));
        }
        let (time_s, bar) = self.time(&complete, measured)?;
        let penalty = mean(complete.iter().map(|sheet| sheet.penalty));
        let raw = self.cut_off_s - time_s - penalty;
        let [low, high] = match bar {
            None => [None, None],
            Some([early, late]) => {
                // A typed time belongs to its sheet; a measured one is the same for all.
                let worst = complete.iter().map(|sheet| sheet.time_s.unwrap_or(late) + sheet.penalty);
                let best = complete.iter().map(|sheet| sheet.time_s.unwrap_or(early) + sheet.penalty);
                let [worst, best] = [worst.fold(f64::MIN, f64::max), best.fold(f64::MAX, f64::min)];
                [Some(self.finish(self.cut_off_s - worst)), Some(self.finish(self.cut_off_s - best))]
            }
        };
        let [time_low_s, time_high_s] = [bar.map(|bar| bar[0]), bar.map(|bar| bar[1])];
        let parts = self.parts(newest, &complete);
        let (cut_off_s, sheets) = (self.cut_off_s, complete.len());
        let value = self.finish(raw);
        Ok(ErrorScore {
            value,
            low,
            high,
            points: raw,
            cut_off_s,
            time_s,
            time_low_s,
            time_high_s,
            parts,
            sheets,
            left_out,
        })
    }

    fn points(&self, sheet: &SheetToScore) -> Result<SheetPoints, NoErrorScore> {
        let value = |weight: &ItemWeight| {
            let found = sheet.values.iter().find(|value| value.item == weight.item).ok_or(NoErrorScore::ItemMissing)?;
            found.value.ok_or(NoErrorScore::AmountMissing)
        };
        let values = self.weights.iter().map(value).collect::<Result<Vec<f64>, NoErrorScore>>()?;
        let time_s = match self.time {
            ScoreTime::Measured => None,
            ScoreTime::Typed => Some(sheet.time_s.ok_or(NoErrorScore::TimeMissing)?),
        };
        let penalty = self.weights.iter().zip(&values).map(|(weight, value)| weight.weight * value).sum();
        Ok(SheetPoints { values, penalty, time_s })
    }

    /// The subtracted time with its bar. One typed time has none: how far a rater's clock is off is unknown.
    fn time(
        &self,
        sheets: &[SheetPoints],
        measured: Result<MeasuredTime, NoErrorScore>,
    ) -> Result<(f64, Option<[f64; 2]>), NoErrorScore> {
        if self.time == ScoreTime::Measured {
            return measured.map(|measured| (measured.value, measured.bar));
        }
        let typed: Vec<f64> = sheets.iter().filter_map(|sheet| sheet.time_s).collect();
        let ends = [typed.iter().copied().fold(f64::MAX, f64::min), typed.iter().copied().fold(f64::MIN, f64::max)];
        Ok((mean(typed.iter().copied()), (typed.len() > 1).then_some(ends)))
    }

    fn parts(&self, newest: &SheetToScore, sheets: &[SheetPoints]) -> Vec<ScorePart> {
        let part = |(at, ItemWeight { item, weight }): (usize, &ItemWeight)| {
            let known = newest.items.iter().find(|known| known.item == *item);
            let values = || sheets.iter().map(|sheet| sheet.values[at]);
            ScorePart {
                item: item.clone(),
                name: known.map_or_else(|| item.clone(), |known| known.name.clone()),
                kind: known.map_or(ErrorItemKind::Count, |known| known.kind),
                unit: known.and_then(|known| known.unit.clone()),
                weight: *weight,
                mean: mean(values()),
                lowest: values().fold(f64::MAX, f64::min),
                highest: values().fold(f64::MIN, f64::max),
            }
        };
        self.weights.iter().enumerate().map(part).collect()
    }

    /// Scales points and keeps the limits. It never falls as points rise.
    fn finish(&self, points: f64) -> f64 {
        let floor = if self.not_below_zero { 0.0 } else { f64::MIN };
        match self.scale {
            None => points.max(floor),
            Some(ScoreScale { norm, maximum, not_above }) => {
                let score = (points / norm * maximum).max(floor);
                if not_above { score.min(maximum) } else { score }
            }
        }
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
    sum / n
}
