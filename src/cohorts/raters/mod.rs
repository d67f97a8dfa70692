//! The quality of ratings: whether raters agree, and how ratings correlate with features.
//!
//! Both use only blind ratings with a mark for every item that applies, and a person counts once. **Only ratings of the
//! same items are compared:** those of the item set with the most people. ICC(2,1) and ICC(2,k) (Shrout & Fleiss, Psychol
//! Bull 1979;86:420–428) model a mark as the sum of person, rater and error, with one variance for each; a sum of fewer
//! items has another mean and another variance, and a scaled sum has a larger error, so mixing item sets would put the
//! difference of the forms into the raters. **Agreement** uses of each person
//! the newest session that all of the same raters have rated; missing ratings are not filled in. **Correlations** use
//! each person's mean rating and mean feature value over the same rated sessions. They are rank correlations, so they
//! assume no shape of the relation. Because many features are tested, the p-values are adjusted (Benjamini & Hochberg).
//! Values are compared only within one pipeline version, a feature along the camera's axes only within one calibration,
//! and a tool's feature only among people who prefer the same hand; the version, calibration and hand with the most
//! people are chosen. Both results include only people in the caller's scope.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{IntervalEstimate, Withheld};
use super::{Cohorts, CohortsError};
use crate::domain::feature::{FeatureKey, depends_on_camera};
use crate::domain::rating::{ItemMark, RatingForm, applicable_total};
use crate::domain::scope::Scope;
use crate::domain::trainee::Handedness;
use crate::ids::{PersonId, SessionId, TaskId, TraineeId};
use crate::motion::features;
use crate::statistics::agreement::{self, Correlation, MIN_RATED, SameRaters, icc, same_raters, spearman};
use crate::statistics::false_discovery::{adjusted_p_values, correlation_p_value};
use crate::statistics::{MIN_PEOPLE, NoAnswer};
use crate::store::{GivenRating, SessionValue};

/// Limit of rated sessions whose features are read; the newest ones are used.
const MAX_SESSIONS: usize = 500;

/// A correlation counts as found if its adjusted p-value is below this.
const FOUND_BELOW: f64 = 0.05;

/// Agreement of the raters of a task's sessions.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Agreement {
    /// The rating form.
    pub form: RatingForm,
    /// The items that the compared ratings judged, in the form's order; empty while none are compared.
    pub items: Vec<String>,
    /// Number of blind and complete ratings that judged other items. They are not compared with these.
    pub other_items: usize,
    /// Sessions with at least two blind and complete ratings of these items.
    pub sessions: usize,
    /// Number of these sessions that were left out: their person has a newer one, or was not rated by the chosen
    /// raters.
    pub left_out: usize,
    /// People who were rated by the same raters; each counts once.
    pub people: usize,
    /// Number of these raters.
    pub raters: usize,
    /// ICC(2,1): agreement of a single rater's total with those of other raters. `null` if `withheld` says why.
    pub single: Option<IntervalEstimate>,
    /// ICC(2,k): the same for the mean of all raters; `null` also if the interval of a single rater is too wide for it.
    pub mean: Option<IntervalEstimate>,
    /// Why both are withheld.
    pub withheld: Option<Withheld>,
}

/// Correlations of features with the ratings of a task's sessions.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Correlations {
    /// The rating form.
    pub form: RatingForm,
    /// The items that the used ratings judged, in the form's order; empty while there are none.
    pub rated_items: Vec<String>,
    /// Number of blind and complete ratings that judged other items. They are not used.
    pub other_items: usize,
    /// Pipeline version of the compared values; `null` while there are none.
    pub pipeline: Option<String>,
    /// Rated sessions with features of that version.
    pub sessions: usize,
    /// People of these sessions; each counts once.
    pub people: usize,
    /// Number of features that the p-values are adjusted for.
    pub asked: usize,
    /// A row per feature: the strongest correlation first, features without a correlation last.
    pub items: Vec<CorrelationRow>,
    /// Why all correlations are withheld.
    pub withheld: Option<Withheld>,
}

/// Correlation of one feature with the ratings.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct CorrelationRow {
    /// The feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: String,
    /// What is better: `lower`, `higher` or `neither`. A feature with `lower` should fall as ratings rise.
    pub better: &'static str,
    /// Number of people.
    pub people: usize,
    /// For a tool's feature: the hand that they prefer.
    pub handedness: Option<Handedness>,
    /// Spearman's ρ with its 95 % interval; `null` if `withheld` says why.
    pub rho: Option<IntervalEstimate>,
    /// The p-value: the chance of such a correlation if there is none.
    pub chance: Option<f64>,
    /// The p-value adjusted for all tested features (Benjamini & Hochberg).
    pub adjusted: Option<f64>,
    /// True if the adjusted p-value is below 5 %.
    pub found: bool,
    /// Why the correlation is withheld.
    pub withheld: Option<Withheld>,
}

impl Cohorts {
    /// Agreement of the raters of a task's sessions on a form.
    pub async fn agreement(&self, scope: &Scope, task: TaskId, form: RatingForm) -> Result<Agreement, CohortsError> {
        let given = self.store.ratings().given(scope, task, form).await?;
        self.calculate(move || agreement_of(form, &given)).await
    }

    /// Correlations of features with the ratings of a task's sessions on a form.
    pub async fn correlations(
        &self,
        scope: &Scope,
        task: TaskId,
        form: RatingForm,
    ) -> Result<Correlations, CohortsError> {
        let (compared, given) = most_people(&self.store.ratings().given(scope, task, form).await?, people_rated);
        let totals = totals(&given);
        let mut sessions: Vec<SessionId> = Vec::new();
        for rating in &given {
            if totals.contains_key(&rating.session)
                && !sessions.contains(&rating.session)
                && sessions.len() < MAX_SESSIONS
            {
                sessions.push(rating.session);
            }
        }
        let values = self.store.ratings().values(scope, &sessions).await?;
        let calculation = move || {
            let answer = correlations_of(form, &given, &totals, values);
            Correlations { rated_items: compared.items, other_items: compared.other_items, ..answer }
        };
        self.calculate(calculation).await
    }
}

/// Which ratings are compared.
#[derive(Debug, Default, PartialEq)]
struct ComparedItems {
    /// Their items, in the form's order.
    items: Vec<String>,
    /// Number of complete ratings of other items.
    other_items: usize,
}

/// The items that a complete rating judged; `None` if one that applies was not judged.
fn judged_items(marks: &[ItemMark]) -> Option<Vec<String>> {
    applicable_total(marks)?;
    Some(marks.iter().filter(|mark| !mark.does_not_apply).map(|mark| mark.item.clone()).collect())
}

/// The complete ratings of the item set for which `people` counts the most; among equals, of the set with more items.
fn most_people(given: &[GivenRating], people: fn(&[GivenRating]) -> usize) -> (ComparedItems, Vec<GivenRating>) {
    let mut by_items: BTreeMap<Vec<String>, Vec<GivenRating>> = BTreeMap::new();
    for rating in given {
        if let Some(items) = judged_items(&rating.items) {
            by_items.entry(items).or_default().push(rating.clone());
        }
    }
    let complete: usize = by_items.values().map(Vec::len).sum();
    let best = by_items.into_iter().max_by_key(|(items, ratings)| (people(ratings), items.len(), ratings.len()));
    let (items, ratings) = best.unwrap_or_default();
    (ComparedItems { items, other_items: complete - ratings.len() }, ratings)
}

fn people_rated(given: &[GivenRating]) -> usize {
    given.iter().map(|rating| rating.trainee).collect::<BTreeSet<_>>().len()
}

/// Number of people with a session that the same raters have rated; those raters are chosen who rated the most people.
fn people_compared(given: &[GivenRating]) -> usize {
    let trainee_of: BTreeMap<SessionId, TraineeId> =
        given.iter().map(|rating| (rating.session, rating.trainee)).collect();
    let rows: Vec<(SessionId, BTreeMap<PersonId, f64>)> = totals(given).into_iter().collect();
    let Some(SameRaters { rows, .. }) = same_raters(&rows, |session| trainee_of.get(session).copied()) else {
        return 0;
    };
    rows.iter().filter_map(|(session, _)| trainee_of.get(session)).collect::<BTreeSet<_>>().len()
}

/// Each session's totals by rater, of complete ratings. All judge the same items.
fn totals(given: &[GivenRating]) -> BTreeMap<SessionId, BTreeMap<PersonId, f64>> {
    let mut totals: BTreeMap<SessionId, BTreeMap<PersonId, f64>> = BTreeMap::new();
    for rating in given {
        if let Some(total) = applicable_total(&rating.items) {
            totals.entry(rating.session).or_default().insert(rating.rater, f64::from(total.sum));
        }
    }
    totals
}

fn agreement_of(form: RatingForm, given: &[GivenRating]) -> Agreement {
    let (compared, given) = most_people(given, people_compared);
    let totals = totals(&given);
    let sessions = totals.values().filter(|raters| raters.len() >= 2).count();
    let trainee_of: BTreeMap<SessionId, (TraineeId, i64)> =
        given.iter().map(|rating| (rating.session, (rating.trainee, rating.recorded_at_ms))).collect();
    let rows: Vec<(SessionId, BTreeMap<PersonId, f64>)> = totals.into_iter().collect();
    let answer = Agreement {
        form,
        items: compared.items,
        other_items: compared.other_items,
        sessions,
        left_out: sessions,
        people: 0,
        raters: 0,
        single: None,
        mean: None,
        withheld: None,
    };
    let too_few =
        |found| NoAnswer::TooFew { of: "people rated by the same two raters or more", found, needed: MIN_RATED };
    let Some(SameRaters { raters, rows, .. }) =
        same_raters(&rows, |session| trainee_of.get(session).map(|(trainee, _)| *trainee))
    else {
        return Agreement { withheld: Some(too_few(0).into()), ..answer };
    };
    let mut newest: BTreeMap<TraineeId, (i64, SessionId, Vec<f64>)> = BTreeMap::new();
    for (session, marks) in rows {
        let Some(&(trainee, at_ms)) = trainee_of.get(&session) else { continue };
        if newest.get(&trainee).is_none_or(|(before_ms, before, _)| (*before_ms, *before) < (at_ms, session)) {
            newest.insert(trainee, (at_ms, session, marks));
        }
    }
    let people: Vec<(TraineeId, Vec<f64>)> = newest.into_iter().map(|(id, (_, _, marks))| (id, marks)).collect();
    let answer = Agreement { left_out: sessions - people.len(), people: people.len(), raters: raters.len(), ..answer };
    let estimate = |form| icc(&people, form).map(|found| IntervalEstimate::of(found.value, found.interval));
    match (people.len(), estimate(agreement::IccForm::Agreement)) {
        (found, _) if found < MIN_RATED => Agreement { withheld: Some(too_few(found).into()), ..answer },
        (_, Err(why)) => Agreement { withheld: Some(why.into()), ..answer },
        (_, Ok(single)) => {
            Agreement { single: Some(single), mean: estimate(agreement::IccForm::AgreementMean).ok(), ..answer }
        }
    }
}

/// For each person: the sum of ratings, the sum of feature values, and the number of rated sessions.
type RatingSums = BTreeMap<TraineeId, (f64, f64, usize)>;

fn correlations_of(
    form: RatingForm,
    given: &[GivenRating],
    totals: &BTreeMap<SessionId, BTreeMap<PersonId, f64>>,
    mut values: Vec<SessionValue>,
) -> Correlations {
    let trainee_of: BTreeMap<SessionId, (i64, TraineeId)> =
        given.iter().map(|rating| (rating.session, (rating.recorded_at_ms, rating.trainee))).collect();
    let mut rated: BTreeMap<&str, BTreeSet<TraineeId>> = BTreeMap::new();
    for value in &values {
        rated.entry(&value.pipeline).or_default().extend(trainee_of.get(&value.session).map(|(_, trainee)| *trainee));
    }
    let pipeline = rated.into_iter().max_by_key(|(_, people)| people.len()).map(|(pipeline, _)| pipeline.to_owned());
    values.retain(|value| Some(&value.pipeline) == pipeline.as_ref());
    let sessions: BTreeSet<SessionId> = values.iter().map(|value| value.session).collect();
    let people: BTreeSet<TraineeId> =
        sessions.iter().filter_map(|id| trainee_of.get(id)).map(|(_, trainee)| *trainee).collect();
    let mut answer = Correlations {
        form,
        rated_items: Vec::new(),
        other_items: 0,
        pipeline,
        sessions: sessions.len(),
        people: people.len(),
        asked: 0,
        items: Vec::new(),
        withheld: None,
    };
    if people.len() < MIN_PEOPLE {
        let why = NoAnswer::TooFew { of: "people with rated sessions", found: people.len(), needed: MIN_PEOPLE };
        return Correlations { withheld: Some(why.into()), ..answer };
    }
    let mut by_feature: BTreeMap<_, Vec<&SessionValue>> = BTreeMap::new();
    for value in &values {
        let place = features::FEATURES.iter().position(|feature| *feature == value.of.feature);
        by_feature.entry((place, value.of.tool.clone(), value.of.space.name())).or_default().push(value);
    }
    let rating_of = |session: &SessionId| {
        let of_session = totals.get(session)?;
        Some(of_session.values().sum::<f64>() / of_session.len() as f64)
    };
    let row = |of: Vec<&SessionValue>| correlate(comparable(of, &trainee_of), &trainee_of, rating_of);
    answer.items = by_feature.into_values().filter_map(row).collect();
    adjust(&mut answer);
    answer
}

/// The values that may be compared: of the calibration and the preferred hand with the most people, if the feature
/// depends on them.
fn comparable<'v>(
    mut values: Vec<&'v SessionValue>,
    trainee_of: &BTreeMap<SessionId, (i64, TraineeId)>,
) -> Vec<&'v SessionValue> {
    let trainee = |value: &SessionValue| trainee_of.get(&value.session).map(|(_, trainee)| *trainee);
    let Some(of) = values.first().map(|value| value.of.clone()) else { return values };
    if depends_on_camera(&of) {
        let most = of_most_people(values.iter().map(|value| (value.calibration, trainee(value))));
        values.retain(|value| Some(value.calibration) == most);
    }
    if of.tool.is_some() {
        let hands = values.iter().filter_map(|value| Some((value.handedness.map(Handedness::name)?, trainee(value))));
        let most = of_most_people(hands);
        values.retain(|value| value.handedness.is_some() && value.handedness.map(Handedness::name) == most);
    }
    values
}

fn of_most_people<T: Ord>(of: impl Iterator<Item = (T, Option<TraineeId>)>) -> Option<T> {
    let mut people: BTreeMap<T, BTreeSet<TraineeId>> = BTreeMap::new();
    of.for_each(|(value, trainee)| people.entry(value).or_default().extend(trainee));
    people.into_iter().max_by_key(|(_, people)| people.len()).map(|(value, _)| value)
}

fn correlate(
    values: Vec<&SessionValue>,
    trainee_of: &BTreeMap<SessionId, (i64, TraineeId)>,
    rating_of: impl Fn(&SessionId) -> Option<f64>,
) -> Option<CorrelationRow> {
    let first = *values.first()?;
    let mut sums = RatingSums::new();
    for value in &values {
        let (Some(&(_, trainee)), Some(rating)) = (trainee_of.get(&value.session), rating_of(&value.session)) else {
            continue;
        };
        let sum = sums.entry(trainee).or_insert((0.0, 0.0, 0));
        *sum = (sum.0 + rating, sum.1 + value.value, sum.2 + 1);
    }
    let mean = |(trainee, (ratings, values, n)): (TraineeId, (f64, f64, usize))| {
        (trainee, ratings / n as f64, values / n as f64)
    };
    let rows: Vec<(TraineeId, f64, f64)> = sums.into_iter().map(mean).collect();
    let (people, found) = (rows.len(), spearman(&rows));
    let estimate = |found: Correlation| IntervalEstimate::of(found.value, found.interval);
    Some(CorrelationRow {
        of: first.of.clone(),
        title: first.of.feature.title.to_owned(),
        better: first.of.feature.direction.name(),
        people,
        handedness: first.handedness.filter(|_| first.of.tool.is_some()),
        rho: found.ok().map(estimate),
        chance: found.ok().map(|found| correlation_p_value(found.value, people)),
        adjusted: None,
        found: false,
        withheld: found.err().map(Withheld::from),
    })
}

/// Adjusts the p-values, and sorts the rows by the strength of the correlation.
fn adjust(answer: &mut Correlations) {
    let chances: Vec<f64> = answer.items.iter().filter_map(|row| row.chance).collect();
    answer.asked = chances.len();
    let asked = answer.items.iter_mut().filter(|row| row.chance.is_some());
    for (row, chance) in asked.zip(adjusted_p_values(&chances)) {
        (row.adjusted, row.found) = (Some(chance), chance < FOUND_BELOW);
    }
    let strength = |row: &CorrelationRow| row.rho.map_or(-1.0, |rho| rho.value.abs());
    answer.items.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
}

#[cfg(test)]
mod tests;
