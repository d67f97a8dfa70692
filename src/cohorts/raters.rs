//! What ratings are worth: do raters agree, and with which features do their ratings go?
//!
//! Both are made of blind ratings that judged every item, and a person counts once. **Agreement:** of each person the newest
//! session that all of the same raters have rated; nothing is filled in. **Correlations:** of each person the mean over their
//! rated sessions, of the ratings and of the feature, over the same sessions; ranks, so that no shape of the relation is
//! assumed; and since many features are asked at once, chances are adjusted (Benjamini & Hochberg). Values of one version of
//! the program, and, where they lie along a camera's axes, of one camera, are compared; a tool's among people who prefer the
//! same hand: each time the one of which there is most. Both tell of those alone whom the asker sees.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{Estimate, Withheld};
use super::{Cohorts, CohortsError};
use crate::domain::feature::{FeatureKey, is_of_one_camera};
use crate::domain::rating::{Form, total};
use crate::domain::scope::Scope;
use crate::domain::trainee::Handedness;
use crate::ids::{PersonId, SessionId, TaskId, TraineeId};
use crate::pipeline::features;
use crate::pipeline::score::agreement::{self, Correlation, FEWEST_RATED, SameRaters, icc, same_raters, spearman};
use crate::pipeline::score::false_discovery::{adjusted, chance_of};
use crate::pipeline::score::{FEWEST_PEOPLE, NoAnswer};
use crate::store::{GivenRating, SessionValue};

/// Rated sessions whose features are read at most, the newest ones.
const MOST_SESSIONS: usize = 500;

/// A correlation whose adjusted chance is below this is called found.
const FOUND_BELOW: f64 = 0.05;

/// Do those who rate a task's sessions agree?
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Agreement {
    /// On which form.
    pub form: Form,
    /// Sessions with at least two blind and whole ratings.
    pub sessions: usize,
    /// How many of these were left out: their person has a newer one, or other raters share more.
    pub left_out: usize,
    /// People who were rated by the same raters: each counts once.
    pub people: usize,
    /// By how many raters.
    pub raters: usize,
    /// ICC(2,1): how well one rater's total stands for all raters'. `null` where `withheld` says why.
    pub single: Option<Estimate>,
    /// ICC(2,k): how well the mean of all of them does; `null` also where the interval of one rater's is too wide for it.
    pub mean: Option<Estimate>,
    /// Why they are not told.
    pub withheld: Option<Withheld>,
}

/// With which features do ratings of a task's sessions go?
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Correlations {
    /// On which form.
    pub form: Form,
    /// Version of the program whose values are compared; `null` while there is none.
    pub pipeline: Option<String>,
    /// Rated sessions with features of that version.
    pub sessions: usize,
    /// Whose they are: each counts once.
    pub people: usize,
    /// Chances are adjusted for so many features asked at once.
    pub asked: usize,
    /// A row for each feature, the strongest correlation first, then those of which none is told.
    pub items: Vec<CorrelationRow>,
    /// Why none is told.
    pub withheld: Option<Withheld>,
}

/// How one feature goes with the ratings.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct CorrelationRow {
    /// Which feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: String,
    /// What is better: `lower`, `higher` or `neither`. A feature of which less is better should fall as ratings rise.
    pub better: &'static str,
    /// How many people.
    pub people: usize,
    /// The hand that they prefer, where the feature is a tool's.
    pub handedness: Option<Handedness>,
    /// Spearman's ρ with its 95 % interval; `null` where `withheld` says why.
    pub rho: Option<Estimate>,
    /// The chance of such a correlation where there is none.
    pub chance: Option<f64>,
    /// The same among all features asked (Benjamini & Hochberg).
    pub adjusted: Option<f64>,
    /// Is it found: the adjusted chance below 5 %?
    pub found: bool,
    /// Why it is not told.
    pub withheld: Option<Withheld>,
}

impl Cohorts {
    /// Do those who rate a task's sessions on a form agree?
    pub async fn agreement(&self, scope: &Scope, task: TaskId, form: Form) -> Result<Agreement, CohortsError> {
        let given = self.store.ratings().given(scope, task, form).await?;
        self.calculate(move || agreement_of(form, &given)).await
    }

    /// With which features do ratings of a task's sessions on a form go?
    pub async fn correlations(&self, scope: &Scope, task: TaskId, form: Form) -> Result<Correlations, CohortsError> {
        let given = self.store.ratings().given(scope, task, form).await?;
        let totals = totals(&given);
        let mut sessions: Vec<SessionId> = Vec::new();
        for rating in &given {
            if totals.contains_key(&rating.session)
                && !sessions.contains(&rating.session)
                && sessions.len() < MOST_SESSIONS
            {
                sessions.push(rating.session);
            }
        }
        let values = self.store.ratings().values(scope, &sessions).await?;
        self.calculate(move || correlations_of(form, &given, &totals, values)).await
    }
}

/// Each session's totals by rater, of whole ratings.
fn totals(given: &[GivenRating]) -> BTreeMap<SessionId, BTreeMap<PersonId, f64>> {
    let mut totals: BTreeMap<SessionId, BTreeMap<PersonId, f64>> = BTreeMap::new();
    for rating in given {
        if let Some(total) = total(&rating.items) {
            totals.entry(rating.session).or_default().insert(rating.rater, f64::from(total));
        }
    }
    totals
}

fn agreement_of(form: Form, given: &[GivenRating]) -> Agreement {
    let totals = totals(given);
    let sessions = totals.values().filter(|raters| raters.len() >= 2).count();
    let whose: BTreeMap<SessionId, (TraineeId, i64)> =
        given.iter().map(|rating| (rating.session, (rating.trainee, rating.recorded_at_ms))).collect();
    let rows: Vec<(SessionId, BTreeMap<PersonId, f64>)> = totals.into_iter().collect();
    let told = Agreement {
        form,
        sessions,
        left_out: sessions,
        people: 0,
        raters: 0,
        single: None,
        mean: None,
        withheld: None,
    };
    let too_few =
        |found| NoAnswer::TooFew { of: "people rated by the same two raters or more", found, needed: FEWEST_RATED };
    let Some(SameRaters { raters, rows, .. }) =
        same_raters(&rows, |session| whose.get(session).map(|(trainee, _)| *trainee))
    else {
        return Agreement { withheld: Some(too_few(0).into()), ..told };
    };
    let mut newest: BTreeMap<TraineeId, (i64, SessionId, Vec<f64>)> = BTreeMap::new();
    for (session, marks) in rows {
        let Some(&(trainee, at_ms)) = whose.get(&session) else { continue };
        if newest.get(&trainee).is_none_or(|(before_ms, before, _)| (*before_ms, *before) < (at_ms, session)) {
            newest.insert(trainee, (at_ms, session, marks));
        }
    }
    let people: Vec<(TraineeId, Vec<f64>)> = newest.into_iter().map(|(who, (_, _, marks))| (who, marks)).collect();
    let told = Agreement { left_out: sessions - people.len(), people: people.len(), raters: raters.len(), ..told };
    let estimate = |form| icc(&people, form).map(|found| Estimate::of(found.value, found.interval));
    match (people.len(), estimate(agreement::Form::Agreement)) {
        (found, _) if found < FEWEST_RATED => Agreement { withheld: Some(too_few(found).into()), ..told },
        (_, Err(why)) => Agreement { withheld: Some(why.into()), ..told },
        (_, Ok(single)) => {
            Agreement { single: Some(single), mean: estimate(agreement::Form::AgreementMean).ok(), ..told }
        }
    }
}

/// One person's rated sessions with a feature: the sum of ratings, the sum of values, how many.
type Sums = BTreeMap<TraineeId, (f64, f64, usize)>;

fn correlations_of(
    form: Form,
    given: &[GivenRating],
    totals: &BTreeMap<SessionId, BTreeMap<PersonId, f64>>,
    mut values: Vec<SessionValue>,
) -> Correlations {
    let whose: BTreeMap<SessionId, (i64, TraineeId)> =
        given.iter().map(|rating| (rating.session, (rating.recorded_at_ms, rating.trainee))).collect();
    let mut rated: BTreeMap<&str, BTreeSet<TraineeId>> = BTreeMap::new();
    for value in &values {
        rated.entry(&value.pipeline).or_default().extend(whose.get(&value.session).map(|(_, trainee)| *trainee));
    }
    let pipeline = rated.into_iter().max_by_key(|(_, people)| people.len()).map(|(pipeline, _)| pipeline.to_owned());
    values.retain(|value| Some(&value.pipeline) == pipeline.as_ref());
    let sessions: BTreeSet<SessionId> = values.iter().map(|value| value.session).collect();
    let people: BTreeSet<TraineeId> = sessions.iter().filter_map(|id| whose.get(id)).map(|(_, who)| *who).collect();
    let mut told = Correlations {
        form,
        pipeline,
        sessions: sessions.len(),
        people: people.len(),
        asked: 0,
        items: Vec::new(),
        withheld: None,
    };
    if people.len() < FEWEST_PEOPLE {
        let why = NoAnswer::TooFew { of: "people with rated sessions", found: people.len(), needed: FEWEST_PEOPLE };
        return Correlations { withheld: Some(why.into()), ..told };
    }
    let mut by_feature: BTreeMap<(usize, Option<String>, &'static str), Vec<&SessionValue>> = BTreeMap::new();
    for value in &values {
        // What is measured no more is asked no more.
        let Some(place) = features::FEATURES.iter().position(|feature| feature.name == value.of.feature) else {
            continue;
        };
        by_feature.entry((place, value.of.tool.clone(), value.of.space.name())).or_default().push(value);
    }
    let rating_of = |session: &SessionId| {
        let of_session = totals.get(session)?;
        Some(of_session.values().sum::<f64>() / of_session.len() as f64)
    };
    let row = |of: Vec<&SessionValue>| correlate(comparable(of, &whose), &whose, rating_of);
    told.items = by_feature.into_values().filter_map(row).collect();
    adjust(&mut told);
    told
}

/// The values that may be compared with each other, where that takes one camera, or one preferred hand: those of most people.
fn comparable<'v>(
    mut values: Vec<&'v SessionValue>,
    whose: &BTreeMap<SessionId, (i64, TraineeId)>,
) -> Vec<&'v SessionValue> {
    let who = |value: &SessionValue| whose.get(&value.session).map(|(_, who)| *who);
    let Some(of) = values.first().map(|value| value.of.clone()) else { return values };
    if is_of_one_camera(&of) {
        let most = of_most_people(values.iter().map(|value| (value.calibration, who(value))));
        values.retain(|value| Some(value.calibration) == most);
    }
    if of.tool.is_some() {
        let hands = values.iter().filter_map(|value| Some((value.handedness.map(Handedness::name)?, who(value))));
        let most = of_most_people(hands);
        values.retain(|value| value.handedness.is_some() && value.handedness.map(Handedness::name) == most);
    }
    values
}

fn of_most_people<T: Ord>(of: impl Iterator<Item = (T, Option<TraineeId>)>) -> Option<T> {
    let mut people: BTreeMap<T, BTreeSet<TraineeId>> = BTreeMap::new();
    of.for_each(|(value, who)| people.entry(value).or_default().extend(who));
    people.into_iter().max_by_key(|(_, people)| people.len()).map(|(value, _)| value)
}

fn correlate(
    values: Vec<&SessionValue>,
    whose: &BTreeMap<SessionId, (i64, TraineeId)>,
    rating_of: impl Fn(&SessionId) -> Option<f64>,
) -> Option<CorrelationRow> {
    let first = *values.first()?;
    let feature = features::find(&first.of.feature)?;
    let mut sums = Sums::new();
    for value in &values {
        let (Some(&(_, who)), Some(rating)) = (whose.get(&value.session), rating_of(&value.session)) else { continue };
        let sum = sums.entry(who).or_insert((0.0, 0.0, 0));
        *sum = (sum.0 + rating, sum.1 + value.value, sum.2 + 1);
    }
    let mean =
        |(who, (ratings, values, n)): (TraineeId, (f64, f64, usize))| (who, ratings / n as f64, values / n as f64);
    let rows: Vec<(TraineeId, f64, f64)> = sums.into_iter().map(mean).collect();
    let (people, found) = (rows.len(), spearman(&rows));
    let estimate = |found: Correlation| Estimate::of(found.value, found.interval);
    Some(CorrelationRow {
        of: first.of.clone(),
        title: feature.title.to_owned(),
        better: feature.direction.name(),
        people,
        handedness: first.handedness.filter(|_| first.of.tool.is_some()),
        rho: found.ok().map(estimate),
        chance: found.ok().map(|found| chance_of(found.value, people)),
        adjusted: None,
        found: false,
        withheld: found.err().map(Withheld::from),
    })
}

/// Chances among all that were asked, and the strongest first.
fn adjust(told: &mut Correlations) {
    let chances: Vec<f64> = told.items.iter().filter_map(|row| row.chance).collect();
    told.asked = chances.len();
    let asked = told.items.iter_mut().filter(|row| row.chance.is_some());
    for (row, chance) in asked.zip(adjusted(&chances)) {
        (row.adjusted, row.found) = (Some(chance), chance < FOUND_BELOW);
    }
    let strength = |row: &CorrelationRow| row.rho.map_or(-1.0, |rho| rho.value.abs());
    told.items.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
}

#[cfg(test)]
mod tests;
