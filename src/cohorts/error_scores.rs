//! Error scores of sessions, and the agreement of raters on error items.
//!
//! **Score.** A session is scored by the highest version of its task's formula that is valid on the day on which the
//! session had arrived: the day that its sender claims would let a trainee choose the formula. **Agreement** uses blind
//! finished sheets. For each item a person counts once, with the newest session that all of the same raters have
//! judged. Counts and amounts have an intraclass correlation; counts and items of yes or no also have the share of
//! people who got the same value from all raters.

use std::collections::{BTreeMap, HashMap};

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{ErrorScorePoint, ErrorScoreSeries, IntervalEstimate, NoScore, Withheld};
use super::series::NumberedSession;
use super::{Cohorts, CohortsError};
use crate::domain::error_sheet::{
    ErrorItem, ErrorItemKind, ErrorScore, MeasuredTime, NoErrorScore, ScoreFormula, ScoreTime, SheetToScore, values_of,
};
use crate::domain::feature::FeatureKey;
use crate::domain::scope::Scope;
use crate::domain::session::{BoxQuestion, FeatureSpace};
use crate::ids::{PersonId, SessionId, TaskId, TraineeId};
use crate::motion::features::time::DURATION;
use crate::statistics::NoAnswer;
use crate::statistics::agreement::{IccForm, MIN_RATED, SameRaters, icc, same_raters};
use crate::statistics::interval::wilson;
use crate::store::{
    ErrorSheetRecord, GivenErrorSheet, PracticeSession, ScoreFormulaRecord, SessionRecord, SessionResult,
    VisibleErrorSheets,
};
use crate::time::Day;

/// The formula that scores a session, and the score or why there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorScoreAnswer {
    /// The version of the task's formula; `None` if none is valid, or if it was only tried.
    pub formula: Option<ScoreFormulaRecord>,
    /// The score.
    pub score: Result<ErrorScore, NoErrorScore>,
}

/// What decides a session's score beside its sheets and the formula.
struct SessionToScore {
    is_set_aside: bool,
    is_voided: bool,
    box_question: Option<BoxQuestion>,
    duration: Result<MeasuredTime, NoErrorScore>,
}

/// The versions of a task's formula, and the finished sheets of a trainee's sessions that the caller may see.
#[derive(Default)]
pub(super) struct PracticeScores {
    /// Newest first; empty if the task has no formula.
    pub versions: Vec<ScoreFormulaRecord>,
    /// By session; sessions without a finished sheet are left out.
    pub sheets: HashMap<SessionId, VisibleErrorSheets>,
}

/// Agreement of the raters of a task's sessions on the items of its error list.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ErrorAgreement {
    /// Sessions with at least two blind finished sheets.
    pub sessions: usize,
    /// A row for each item of the list in use.
    pub items: Vec<ItemAgreement>,
}

/// Agreement of raters on one item.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ItemAgreement {
    /// Short name of the item.
    pub item: String,
    /// Its name for people.
    pub name: String,
    /// How it is judged.
    pub kind: ErrorItemKind,
    /// Unit of an amount; `null` for other kinds.
    pub unit: Option<String>,
    /// People who were judged by the same raters; each counts once.
    pub people: usize,
    /// Number of these raters.
    pub raters: usize,
    /// Sessions with two sheets or more that were left out: their person has a newer one, or others judged them.
    pub left_out: usize,
    /// ICC(2,1): agreement of a single rater with others; `null` for yes or no, and if `withheld` says why.
    pub single: Option<IntervalEstimate>,
    /// Why there is no ICC.
    pub withheld: Option<Withheld>,
    /// Share of people who got the same value from all raters; `null` for amounts, and with too few people.
    pub same: Option<IntervalEstimate>,
}

impl Cohorts {
    /// The error score of a session from the sheets that the caller may see.
    pub async fn error_score(
        &self,
        scope: &Scope,
        session: &SessionRecord,
        sheets: &VisibleErrorSheets,
    ) -> Result<ErrorScoreAnswer, CohortsError> {
        let versions = self.store.score_formulas().list(scope, session.task_id).await?;
        let formula = match valid_formula(&versions, session.created_at_ms) {
            Ok(formula) => formula.clone(),
            Err(why) => return Ok(ErrorScoreAnswer { formula: None, score: Err(why) }),
        };
        let score = self.score_by(scope, session, sheets, &formula.definition).await?;
        Ok(ErrorScoreAnswer { formula: Some(formula), score })
    }

    /// The error score of a session by this formula.
    pub async fn score_by(
        &self,
        scope: &Scope,
        session: &SessionRecord,
        sheets: &VisibleErrorSheets,
        formula: &ScoreFormula,
    ) -> Result<Result<ErrorScore, NoErrorScore>, CohortsError> {
        let duration = match formula.time {
            ScoreTime::Typed => Err(NoErrorScore::NoDuration), // not read
            ScoreTime::Measured => {
                let result = self.store.sessions().result(scope, session.id).await?;
                result.as_ref().map_or(Err(NoErrorScore::NotScored), measured_time)
            }
        };
        let SessionRecord { is_set_aside, is_voided, box_question, .. } = *session;
        Ok(score_of(&SessionToScore { is_set_aside, is_voided, box_question, duration }, sheets, formula))
    }

    /// What the error scores of these sessions need, from the sheets that the caller may see. Sheets are read only if the
    /// task has a formula.
    pub(super) async fn practice_scores(
        &self,
        scope: &Scope,
        task: TaskId,
        sessions: &[PracticeSession],
    ) -> Result<PracticeScores, CohortsError> {
        let versions = self.store.score_formulas().list(scope, task).await?;
        if versions.is_empty() {
            return Ok(PracticeScores::default());
        }
        let ids: Vec<SessionId> = sessions.iter().map(|session| session.id).collect();
        Ok(PracticeScores { versions, sheets: self.store.error_sheets().finished_of(scope, &ids).await? })
    }

    /// Agreement of the raters of a task's sessions on its error items.
    pub async fn error_agreement(&self, scope: &Scope, task: TaskId) -> Result<ErrorAgreement, CohortsError> {
        let given = self.store.error_sheets().given(scope, task).await?;
        let items = self.store.error_lists().in_use(scope, task).await?.map(|list| list.items).unwrap_or_default();
        self.calculate(move || agreement_on(&items, &given)).await
    }
}

/// The version that scores a session which arrived then. `versions`: newest first.
fn valid_formula(versions: &[ScoreFormulaRecord], arrived_at_ms: i64) -> Result<&ScoreFormulaRecord, NoErrorScore> {
    let day = Day::of(arrived_at_ms);
    let found = versions.iter().find(|version| version.valid_from.is_none_or(|first| first <= day));
    found.ok_or(if versions.is_empty() { NoErrorScore::NoFormula } else { NoErrorScore::NotValidYet })
}

/// The score of a session from the sheets that a caller may see: the one rule for the session's page and for progress.
fn score_of(
    session: &SessionToScore,
    sheets: &VisibleErrorSheets,
    formula: &ScoreFormula,
) -> Result<ErrorScore, NoErrorScore> {
    if session.is_set_aside {
        return Err(NoErrorScore::SetAside);
    }
    if session.is_voided {
        return Err(NoErrorScore::Voided);
    }
    if session.box_question.is_some_and(|question| !BoxQuestion::counts(question)) {
        return Err(NoErrorScore::BoxAsked);
    }
    if sheets.hidden > 0 {
        return Err(NoErrorScore::Hidden);
    }
    let counting: Vec<SheetToScore> = sheets.finished.iter().filter(|sheet| sheet.counts).map(to_score).collect();
    formula.score(&counting, session.duration)
}

/// The error score over a trainee's sessions: a series for each version of the formula that scores one of them, the oldest
/// version first. Sessions that no version scores are in none.
pub(super) fn error_score_series(sessions: &[NumberedSession<'_>], scores: &PracticeScores) -> Vec<ErrorScoreSeries> {
    let mut series: BTreeMap<i64, ErrorScoreSeries> = BTreeMap::new();
    let no_sheets = VisibleErrorSheets::default();
    for NumberedSession { number, session, .. } in sessions {
        let Ok(formula) = valid_formula(&scores.versions, session.created_at_ms) else { continue };
        let sheets = scores.sheets.get(&session.id).unwrap_or(&no_sheets);
        let score = score_of(&practised(session), sheets, &formula.definition);
        let none = score.as_ref().err().copied().map(NoScore::from);
        let score = score.ok();
        let point = ErrorScorePoint {
            session: *number,
            value: score.as_ref().map(|score| score.value),
            low: score.as_ref().and_then(|score| score.low),
            high: score.as_ref().and_then(|score| score.high),
            sheets: score.as_ref().map_or(0, |score| score.sheets),
            none,
        };
        let (version, valid_from) = (formula.version, formula.valid_from);
        let new = || ErrorScoreSeries { formula: version, valid_from, points: Vec::new() };
        series.entry(version).or_insert_with(new).points.push(point);
    }
    series.into_values().collect()
}

/// As [`measured_time`] reads it from the whole result.
fn practised(session: &PracticeSession) -> SessionToScore {
    let of = FeatureKey::of_session(&DURATION, FeatureSpace::Space3d);
    let duration = match &session.result {
        None => Err(NoErrorScore::NotScored),
        Some(result) if result.refused => Err(NoErrorScore::Refused),
        Some(_) => match session.measured.iter().find(|measured| measured.of == of) {
            None => Err(NoErrorScore::NoDuration),
            Some(measured) if measured.is_lower_bound => Err(NoErrorScore::OnlyPart),
            Some(measured) => {
                let found = measured.value.map(|value| MeasuredTime { value, bar: measured.bar });
                found.ok_or(NoErrorScore::NoDuration)
            }
        },
    };
    let PracticeSession { is_set_aside, is_voided, box_question, .. } = *session;
    SessionToScore { is_set_aside, is_voided, box_question, duration }
}

fn to_score(sheet: &ErrorSheetRecord) -> SheetToScore {
    let marks = sheet.marks.iter().map(|mark| (mark.item.as_str(), mark.amount));
    SheetToScore { items: sheet.items.clone(), values: values_of(&sheet.items, marks), time_s: sheet.time_s }
}

/// The duration of a session, if it is promised.
fn measured_time(result: &SessionResult) -> Result<MeasuredTime, NoErrorScore> {
    if result.quality["verdict"] == "refused" {
        return Err(NoErrorScore::Refused);
    }
    let is_duration = |row: &&crate::domain::session::FeatureRow| {
        row.name == DURATION.name && row.tool.is_none() && row.space == FeatureSpace::Space3d
    };
    let row = result.features.iter().find(is_duration).ok_or(NoErrorScore::NoDuration)?;
    if row.is_lower_bound() {
        return Err(NoErrorScore::OnlyPart);
    }
    let value = *row.value.as_ref().map_err(|_| NoErrorScore::NoDuration)?;
    let bar = row.error.as_ref().and_then(|error| error.as_ref().ok()).map(|error| [error.low, error.high]);
    Ok(MeasuredTime { value, bar })
}

/// The values of one item by session and rater.
type ItemRows = Vec<(SessionId, BTreeMap<PersonId, f64>)>;

fn agreement_on(items: &[ErrorItem], given: &[GivenErrorSheet]) -> ErrorAgreement {
    let trainee_of: BTreeMap<SessionId, (TraineeId, i64)> =
        given.iter().map(|sheet| (sheet.session, (sheet.trainee, sheet.recorded_at_ms))).collect();
    let mut raters: BTreeMap<SessionId, usize> = BTreeMap::new();
    given.iter().for_each(|sheet| *raters.entry(sheet.session).or_default() += 1);
    let sessions = raters.values().filter(|raters| **raters >= 2).count();
    let items = items.iter().map(|item| item_agreement(item, rows_of(item, given), &trainee_of)).collect();
    ErrorAgreement { sessions, items }
}

/// Sheets whose list lacks the item, or whose amount was not typed, are left out.
fn rows_of(item: &ErrorItem, given: &[GivenErrorSheet]) -> ItemRows {
    let mut rows: BTreeMap<SessionId, BTreeMap<PersonId, f64>> = BTreeMap::new();
    for sheet in given {
        let marks = sheet.marks.iter().map(|(item, amount)| (item.as_str(), *amount));
        let values = values_of(&sheet.items, marks);
        if let Some(value) = values.iter().find(|value| value.item == item.item).and_then(|value| value.value) {
            rows.entry(sheet.session).or_default().insert(sheet.rater, value);
        }
    }
    rows.into_iter().collect()
}

fn item_agreement(
    item: &ErrorItem,
    rows: ItemRows,
    trainee_of: &BTreeMap<SessionId, (TraineeId, i64)>,
) -> ItemAgreement {
    let ErrorItem { item, name, kind, unit, .. } = item.clone();
    let by_two = rows.iter().filter(|(_, raters)| raters.len() >= 2).count();
    let of = "people judged by the same two raters or more";
    let chosen = same_raters(&rows, |session| trainee_of.get(session).map(|(trainee, _)| *trainee));
    let (raters, people) = chosen
        .map_or((0, Vec::new()), |SameRaters { raters, rows, .. }| (raters.len(), newest_of_each(rows, trainee_of)));
    let left_out = by_two - people.len();
    let answer = ItemAgreement {
        item,
        name,
        kind,
        unit,
        people: people.len(),
        raters,
        left_out,
        single: None,
        withheld: None,
        same: None,
    };
    if people.len() < MIN_RATED {
        let why = NoAnswer::TooFew { of, found: people.len(), needed: MIN_RATED };
        return ItemAgreement { withheld: Some(why.into()), ..answer };
    }
    let alike = people.iter().filter(|(_, values)| values.windows(2).all(|pair| pair[0] == pair[1])).count();
    let share = alike as f64 / people.len() as f64;
    let same = wilson(share, people.len()).ok().filter(|_| kind != ErrorItemKind::Amount);
    let same = same.map(|interval| IntervalEstimate::of(share, interval));
    if kind == ErrorItemKind::YesNo {
        return ItemAgreement { same, ..answer };
    }
    match icc(&people, IccForm::Agreement) {
        Ok(found) => ItemAgreement { single: Some(IntervalEstimate::of(found.value, found.interval)), same, ..answer },
        Err(why) => ItemAgreement { withheld: Some(why.into()), same, ..answer },
    }
}

/// Each person once, with the newest session.
fn newest_of_each(
    rows: Vec<(SessionId, Vec<f64>)>,
    trainee_of: &BTreeMap<SessionId, (TraineeId, i64)>,
) -> Vec<(TraineeId, Vec<f64>)> {
    let mut newest: BTreeMap<TraineeId, (i64, SessionId, Vec<f64>)> = BTreeMap::new();
    for (session, values) in rows {
        let Some(&(trainee, at_ms)) = trainee_of.get(&session) else { continue };
        if newest.get(&trainee).is_none_or(|(before_ms, before, _)| (*before_ms, *before) < (at_ms, session)) {
            newest.insert(trainee, (at_ms, session, values));
        }
    }
    newest.into_iter().map(|(trainee, (_, _, values))| (trainee, values)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(kind: ErrorItemKind) -> ErrorItem {
        let unit = (kind == ErrorItemKind::Amount).then(|| "mm".to_owned());
        ErrorItem { item: "drops".to_owned(), name: "Drops".to_owned(), kind, unit, hint: None }
    }

    /// Sheets of two raters: for each person the values of both; a person's second row is an older session.
    fn sheets(kind: ErrorItemKind, values: &[(i64, [Option<f64>; 2])]) -> Vec<GivenErrorSheet> {
        let raters = [PersonId::at(1), PersonId::at(2)];
        let people: BTreeMap<i64, TraineeId> =
            values.iter().map(|(person, _)| (*person, TraineeId::at(*person))).collect();
        let mut given = Vec::new();
        for (number, (person, of_raters)) in values.iter().enumerate() {
            let session = SessionId::at(number as i64);
            for (rater, value) in raters.iter().zip(of_raters) {
                let marks = match (kind, value) {
                    (ErrorItemKind::Amount, value) => {
                        value.map(|value| ("drops".to_owned(), Some(value))).into_iter().collect()
                    }
                    (_, value) => vec![("drops".to_owned(), None); value.unwrap_or_default() as usize],
                };
                given.push(GivenErrorSheet {
                    session,
                    recorded_at_ms: -(number as i64),
                    trainee: people[person],
                    rater: *rater,
                    items: vec![item(kind)],
                    marks,
                });
            }
        }
        given
    }

    fn both(values: &[[f64; 2]]) -> Vec<(i64, [Option<f64>; 2])> {
        values.iter().enumerate().map(|(person, pair)| (person as i64, pair.map(Some))).collect()
    }

    fn agreement(kind: ErrorItemKind, values: &[(i64, [Option<f64>; 2])]) -> ItemAgreement {
        agreement_on(&[item(kind)], &sheets(kind, values)).items.remove(0)
    }

    /// The first two raters of Shrout and Fleiss's six people (1979, table 2).
    const PUBLISHED: [[f64; 2]; 6] = [[9.0, 2.0], [6.0, 1.0], [8.0, 4.0], [7.0, 1.0], [10.0, 5.0], [6.0, 2.0]];

    #[test]
    fn counts_have_the_intraclass_correlation_of_their_table_and_the_share_of_equal_ones() {
        let rows: Vec<(usize, Vec<f64>)> = PUBLISHED.iter().map(|pair| pair.to_vec()).enumerate().collect();
        let want = icc(&rows, IccForm::Agreement).unwrap();
        let got = agreement(ErrorItemKind::Count, &both(&PUBLISHED));
        assert_eq!((got.people, got.raters, got.left_out), (6, 2, 0));
        assert_eq!(got.single, Some(IntervalEstimate::of(want.value, want.interval)));
        assert_eq!(got.same.unwrap().value, 0.0);
        let amounts = agreement(ErrorItemKind::Amount, &both(&PUBLISHED));
        assert_eq!((amounts.single, amounts.same), (got.single, None));
    }

    #[test]
    fn raters_who_always_agree_have_a_share_of_one_with_an_interval_and_no_icc() {
        let counts = agreement(ErrorItemKind::Count, &both(&[0.0, 1.0, 2.0, 0.0, 1.0, 3.0].map(|value| [value; 2])));
        let same = counts.same.unwrap();
        assert!(same.value == 1.0 && same.low > 0.6 && same.low < 0.62 && same.high == 1.0, "{same:?}");
        assert_eq!((counts.single, counts.withheld.unwrap().reason.as_str()), (None, "perfect"));
        let yes = agreement(
            ErrorItemKind::YesNo,
            &both(&[[1.0, 1.0], [0.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        );
        assert!((yes.same.unwrap().value - 5.0 / 6.0).abs() < 1e-12 && yes.single.is_none() && yes.withheld.is_none());
    }

    #[test]
    fn too_few_people_is_the_answer_and_a_person_counts_once() {
        let mut five_people = both(&PUBLISHED[..5]);
        five_people.push((0, [Some(9.0), Some(9.0)]));
        let few = agreement(ErrorItemKind::Count, &five_people);
        assert_eq!((few.people, few.left_out, few.single, few.same), (5, 1, None, None));
        assert_eq!(few.withheld.unwrap().missing, Some(1));
        let none = agreement(ErrorItemKind::Count, &[]);
        assert_eq!((none.people, none.raters, none.withheld.unwrap().reason.as_str()), (0, 0, "too_few"));
        // An amount that one rater did not type is no zero.
        let mut gap = both(&PUBLISHED);
        gap[2].1[1] = None;
        assert_eq!(agreement(ErrorItemKind::Amount, &gap).people, 5);
    }
}
