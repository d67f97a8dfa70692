//! The given sessions, and the features and people that a model can be trained on.

use std::collections::BTreeMap;
use std::fmt::Display;

use super::{LEVELS, MAX_FEATURES, MAX_PER_LEVEL, MAX_SESSIONS_EACH, MIN_PER_LEVEL, NoModel, SkillLevel};
use crate::statistics::interval::MeasuredValue;

/// Minimum share of the sessions that have every feature of a model. A feature that would exclude more sessions is left
/// out.
const SHARE_WITH_ALL: f64 = 0.9;

/// One session of a person with a declared level.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelledSession<P> {
    /// The person.
    pub person: P,
    /// The person's level.
    pub level: SkillLevel,
    /// One value per feature; `None` if it was not measured. A value without a bar counts as not measured.
    pub values: Vec<Option<MeasuredValue>>,
}

/// The training data of a model: sessions with all of the features, grouped by person. The people's identities are not
/// kept.
#[derive(Clone, Debug, PartialEq)]
pub struct SkillDataset {
    pub(super) features: Vec<String>,
    pub(super) rows: Vec<TrainingRow>,
    pub(super) levels: Vec<SkillLevel>,
    left_out: usize,
}

/// One session of the training data.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TrainingRow {
    /// The person, as an index into the people.
    pub person: usize,
    /// The values of all features.
    pub readings: Vec<MeasuredValue>,
}

impl SkillDataset {
    /// Selects the features that enough sessions have, the most frequent first, and the sessions that have all of
    /// these. Neither the order of the sessions nor the people's names change the result.
    ///
    /// # Errors
    /// [`NoModel`] if the data are unusable, too few or too many.
    pub fn of<P: Ord>(features: &[impl Display], samples: &[LabelledSession<P>]) -> Result<Self, NoModel> {
        let at_most = |of, found, most| if found > most { Err(NoModel::TooMany { of, found, most }) } else { Ok(()) };
        at_most("features", features.len(), MAX_FEATURES)?;
        at_most("sessions", samples.len(), LEVELS * MAX_PER_LEVEL * MAX_SESSIONS_EACH)?;
        for sample in samples {
            if sample.values.len() != features.len() {
                return Err(NoModel::Ragged);
            }
            let usable = |value: &Option<MeasuredValue>| value.is_none_or(|value| value.checked().is_ok());
            if !sample.values.iter().all(usable) {
                return Err(NoModel::NotFinite);
            }
        }
        let chosen = measured_in_most(features.len(), samples);
        let people = by_person(&chosen, samples)?;
        let found = SkillLevel::ALL.map(|level| people.iter().filter(|(of, _)| *of == level).count());
        if found.iter().any(|found| *found < MIN_PER_LEVEL) {
            return Err(NoModel::TooFewPeople { found });
        }
        if chosen.is_empty() {
            return Err(NoModel::NoFeatures);
        }
        at_most("people of a level", found.into_iter().max().unwrap_or(0), MAX_PER_LEVEL)?;
        at_most(
            "sessions of one person",
            people.iter().map(|(_, own)| own.len()).max().unwrap_or(0),
            MAX_SESSIONS_EACH,
        )?;
        let levels = people.iter().map(|(level, _)| *level).collect();
        let rows: Vec<TrainingRow> = (people.into_iter().enumerate())
            .flat_map(|(person, (_, own))| own.into_iter().map(move |readings| TrainingRow { person, readings }))
            .collect();
        let left_out = samples.len() - rows.len();
        Ok(Self { features: chosen.iter().map(|f| features[*f].to_string()).collect(), rows, levels, left_out })
    }

    /// Names of the features offered to the learners.
    pub fn features(&self) -> &[String] {
        &self.features
    }

    /// Number of people of each level.
    pub fn people(&self) -> [usize; LEVELS] {
        SkillLevel::ALL.map(|level| self.levels.iter().filter(|of| **of == level).count())
    }

    /// Number of sessions of each level.
    pub fn sessions(&self) -> [usize; LEVELS] {
        SkillLevel::ALL.map(|level| self.rows.iter().filter(|row| self.levels[row.person] == level).count())
    }

    /// Number of sessions that lacked a feature and were left out.
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// Everything that the model depends on, as numbers in a fixed order: levels, people, values and bars.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        self.rows.iter().flat_map(|row| {
            let head = [self.levels[row.person] as usize as f64, row.person as f64];
            head.into_iter().chain(row.readings.iter().flat_map(|of| [of.value, low(of), high(of)]))
        })
    }
}

/// Lower end of a reading's bar.
pub(super) fn low(reading: &MeasuredValue) -> f64 {
    reading.bar.map_or(reading.value, |bar| bar.low)
}

/// Upper end of a reading's bar.
pub(super) fn high(reading: &MeasuredValue) -> f64 {
    reading.bar.map_or(reading.value, |bar| bar.high)
}

fn has_value_with_bar<P>(sample: &LabelledSession<P>, feature: usize) -> bool {
    sample.values[feature].is_some_and(|value| value.bar.is_some())
}

/// The features, in their original order, that together keep [`SHARE_WITH_ALL`] of the sessions.
fn measured_in_most<P>(features: usize, samples: &[LabelledSession<P>]) -> Vec<usize> {
    let mut order: Vec<(usize, usize)> =
        (0..features).map(|f| (samples.iter().filter(|sample| has_value_with_bar(sample, f)).count(), f)).collect();
    order.sort_by_key(|(sessions, f)| (std::cmp::Reverse(*sessions), *f));
    let enough = (SHARE_WITH_ALL * samples.len() as f64).ceil() as usize;
    let mut with_all: Vec<&LabelledSession<P>> = samples.iter().collect();
    let mut chosen = Vec::new();
    for (_, feature) in order {
        let mut left = with_all.clone();
        left.retain(|sample| has_value_with_bar(sample, feature));
        if left.len() >= enough && !left.is_empty() {
            with_all = left;
            chosen.push(feature);
        }
    }
    chosen.sort_unstable();
    chosen
}

type PersonSessions = (SkillLevel, Vec<Vec<MeasuredValue>>);

/// The people who have a session with all features, in an order that depends only on their values.
fn by_person<P: Ord>(chosen: &[usize], samples: &[LabelledSession<P>]) -> Result<Vec<PersonSessions>, NoModel> {
    let mut people: BTreeMap<&P, PersonSessions> = BTreeMap::new();
    for sample in samples {
        let (level, sessions) = people.entry(&sample.person).or_insert((sample.level, Vec::new()));
        if *level != sample.level {
            return Err(NoModel::TwoLevels);
        }
        if chosen.iter().all(|f| has_value_with_bar(sample, *f)) {
            sessions.push(chosen.iter().filter_map(|f| sample.values[*f]).collect());
        }
    }
    let mut people: Vec<PersonSessions> = people.into_values().filter(|(_, sessions)| !sessions.is_empty()).collect();
    let bits = |sessions: &[MeasuredValue]| -> Vec<u64> {
        sessions.iter().flat_map(|of| [of.value, low(of), high(of)].map(f64::to_bits)).collect()
    };
    people.iter_mut().for_each(|(_, sessions)| sessions.sort_by_cached_key(|session| bits(session)));
    people
        .sort_by_cached_key(|(level, sessions)| (*level, sessions.iter().flat_map(|of| bits(of)).collect::<Vec<_>>()));
    Ok(people)
}
