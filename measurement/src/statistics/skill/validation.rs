//! The outer round of the validation, on people who had no part in the training, and the baseline: the same with levels
//! shuffled between people.

use super::choice::TrainingPart;
use super::data::SkillDataset;
use super::folds::shuffle;
use super::model::{LevelModel, likeliest};
use super::report::{LevelReport, PermutationBaseline, ValidationReport, VerdictAccuracy, balanced, by_person, share};
use super::{MIN_PER_LEVEL, NoModel, PERMUTATIONS, PerLevel, SIGNIFICANCE, SkillLevel};
use crate::numbers::quantile::interpolated_quantile;
use crate::random::Dice;

/// Number of folds of the outer round: the minimum number of people per level, so that each fold leaves out one of each
/// level.
const FOLDS: usize = MIN_PER_LEVEL;

/// A model and its validation.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedModel {
    /// The model, trained on all people; without skill it gives no verdicts.
    pub model: LevelModel,
    /// How well models trained in the same way do on people left out.
    pub report: ValidationReport,
}

/// The result of a model of the other people for one session of a person left out.
#[derive(Clone, Debug)]
pub(super) struct Guess {
    pub person: usize,
    /// The person's level as used in this round (it may be shuffled).
    pub level: SkillLevel,
    /// The likeliest level.
    pub guessed: SkillLevel,
    /// The level that the model would have given; `None` if it abstained.
    pub verdict: Option<SkillLevel>,
}

/// Trains a model and measures how well it does on unseen people. The seed assigns folds and shuffles levels; derive it
/// from the data. `on_repetition` is called before each repetition with its number, from 0, and the total.
///
/// # Errors
/// [`NoModel::NothingFits`] if no learner can be fitted.
pub fn train(data: &SkillDataset, seed: u64, on_repetition: impl FnMut(usize, usize)) -> Result<TrainedModel, NoModel> {
    train_against(data, seed, PERMUTATIONS, on_repetition)
}

/// The same with a given number of repetitions.
pub(super) fn train_against(
    data: &SkillDataset,
    seed: u64,
    permutations: usize,
    mut on_repetition: impl FnMut(usize, usize),
) -> Result<TrainedModel, NoModel> {
    let (guesses, chosen) = leave_out(&whole_part(data, &data.levels), &mut Dice::new(seed, "outer folds"), true)?;
    let reached = balanced(&guesses);
    let mut shuffled = Vec::with_capacity(permutations);
    for n in 0..permutations {
        on_repetition(n, permutations);
        let mut dice = Dice::new(seed, &format!("shuffled levels {n}"));
        let mut levels = data.levels.clone();
        shuffle(&mut levels, &mut dice);
        shuffled.push(balanced(&leave_out(&whole_part(data, &levels), &mut dice, false)?.0));
    }
    let baseline = baseline(reached, shuffled);
    let report = report(data, &guesses, chosen, baseline)?;
    let mut dice = Dice::new(seed, "model");
    let model = whole_part(data, &data.levels).model(&mut dice).ok_or(NoModel::NothingFits)?;
    Ok(TrainedModel { model: LevelModel { has_skill: baseline.p <= SIGNIFICANCE, ..model }, report })
}

fn whole_part<'d>(data: &'d SkillDataset, levels: &'d [SkillLevel]) -> TrainingPart<'d> {
    TrainingPart { data, levels, people: (0..data.levels.len()).collect() }
}

/// The results for each person's sessions by models of the other people, and the name of each chosen learner.
fn leave_out(part: &TrainingPart, dice: &mut Dice, says: bool) -> Result<(Vec<Guess>, Vec<String>), NoModel> {
    let (mut guesses, mut chosen) = (Vec::new(), Vec::new());
    for (out, rest) in part.folds(FOLDS, dice) {
        let model = rest.model(dice).ok_or(NoModel::NothingFits)?;
        let index_of = |name: &String| part.data.features.iter().position(|feature| feature == name).unwrap_or(0);
        let indices: Vec<usize> = model.features.iter().map(index_of).collect();
        for row in part.data.rows.iter().filter(|row| out.contains(&row.person)) {
            let x = model.standardised(|feature| row.readings[indices[feature]].value);
            let reading = |name: &str| {
                model.features.iter().position(|own| own == name).map(|feature| row.readings[indices[feature]])
            };
            let said = if says { model.judge(reading).level.ok() } else { None };
            let guessed = likeliest(&model.probabilities(&x));
            guesses.push(Guess { person: row.person, level: part.levels[row.person], guessed, verdict: said });
        }
        chosen.push(model.learner);
    }
    Ok((guesses, chosen))
}

fn baseline(reached: f64, mut shuffled: Vec<f64>) -> PermutationBaseline {
    let as_good = shuffled.iter().filter(|balanced| **balanced >= reached - 1e-12).count();
    shuffled.sort_by(f64::total_cmp);
    let permutations = shuffled.len();
    PermutationBaseline {
        permutations,
        mean: shuffled.iter().sum::<f64>() / permutations as f64,
        high: interpolated_quantile(&shuffled, 0.95).unwrap_or(f64::NAN),
        p: (as_good + 1) as f64 / (permutations + 1) as f64,
    }
}

fn report(
    data: &SkillDataset,
    guesses: &[Guess],
    chosen: Vec<String>,
    baseline: PermutationBaseline,
) -> Result<ValidationReport, NoModel> {
    let right = by_person(guesses, |guess| Some(f64::from(guess.guessed == guess.level)));
    let of_level = |level: SkillLevel| share(&right, |of| of == level).map(|found| LevelReport { level, found });
    let [novice, intermediate, expert] = SkillLevel::ALL.map(of_level);
    let given = |row: SkillLevel, column: SkillLevel| -> f64 {
        let shares = by_person(guesses, |guess| Some(f64::from(guess.guessed == column)));
        shares.iter().filter(|(level, _)| *level == row).map(|(_, share)| share).sum()
    };
    let row = |row: SkillLevel| -> PerLevel { SkillLevel::ALL.map(|column| given(row, column)) };
    let spoken = by_person(guesses, |guess| Some(f64::from(guess.verdict.is_some())));
    let right_where_spoken = by_person(guesses, |guess| guess.verdict.map(|said| f64::from(said == guess.level)));
    let right_where_said = |level: SkillLevel| {
        let given = |guess: &Guess| guess.verdict.filter(|said| *said == level);
        share(&by_person(guesses, |guess| given(guess).map(|said| f64::from(said == guess.level))), |_| true).ok()
    };
    let mut learners: Vec<(String, usize)> = Vec::new();
    for name in chosen {
        match learners.iter_mut().find(|(known, _)| *known == name) {
            Some((_, times)) => *times += 1,
            None => learners.push((name, 1)),
        }
    }
    Ok(ValidationReport {
        people: data.people(),
        sessions: data.sessions(),
        left_out: data.left_out(),
        offered: data.features().len(),
        accuracy: share(&right, |_| true)?,
        balanced: balanced(guesses),
        levels: [novice?, intermediate?, expert?],
        confusion: SkillLevel::ALL.map(row),
        baseline,
        speaking: VerdictAccuracy {
            share: spoken.iter().map(|(_, share)| share).sum::<f64>() / spoken.len().max(1) as f64,
            right: share(&right_where_spoken, |_| true).ok(),
            of_level: SkillLevel::ALL.map(right_where_said),
        },
        chosen: learners,
    })
}
