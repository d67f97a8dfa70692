//! The outer round of the validation, on people who had no part in the training, and the baseline: the same with levels
//! shuffled between people.

use super::choice::Part;
use super::data::Dataset;
use super::folds::shuffle;
use super::model::{Model, likeliest};
use super::report::{Baseline, LevelReport, Report, Speaking, balanced, by_person, share};
use super::{FEWEST_PER_LEVEL, Level, NoModel, PERMUTATIONS, PerLevel, SIGNIFICANT};
use crate::pipeline::score::people::quantile;
use crate::random::Dice;

/// Number of folds of the outer round: the minimum number of people per level, so that each fold leaves out one of each
/// level.
const FOLDS: usize = FEWEST_PER_LEVEL;

/// A model and its validation.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// The model, trained on all people; without skill it gives no verdicts.
    pub model: Model,
    /// How well models trained in the same way do on people left out.
    pub report: Report,
}

/// The result of a model of the other people for one session of a person left out.
#[derive(Clone, Debug)]
pub(super) struct Guess {
    pub person: usize,
    /// The person's level as used in this round (it may be shuffled).
    pub level: Level,
    /// The likeliest level.
    pub guessed: Level,
    /// The level that the model would have given; `None` if it abstained.
    pub said: Option<Level>,
}

/// Trains a model and measures how well it does on unseen people. The seed assigns folds and shuffles levels; derive it
/// from the data. `on_repetition` is called before each repetition with its number, from 0, and the total.
///
/// # Errors
/// [`NoModel::NothingFits`] if no learner can be fitted.
pub fn train(data: &Dataset, seed: u64, on_repetition: impl FnMut(usize, usize)) -> Result<Trained, NoModel> {
    train_against(data, seed, PERMUTATIONS, on_repetition)
}

/// The same with a given number of repetitions.
pub(super) fn train_against(
    data: &Dataset,
    seed: u64,
    permutations: usize,
    mut on_repetition: impl FnMut(usize, usize),
) -> Result<Trained, NoModel> {
    let (guesses, chosen) = leave_out(&all(data, &data.levels), &mut Dice::new(seed, "outer folds"), true)?;
    let reached = balanced(&guesses);
    let mut shuffled = Vec::with_capacity(permutations);
    for n in 0..permutations {
        on_repetition(n, permutations);
        let mut dice = Dice::new(seed, &format!("shuffled levels {n}"));
        let mut levels = data.levels.clone();
        shuffle(&mut levels, &mut dice);
        shuffled.push(balanced(&leave_out(&all(data, &levels), &mut dice, false)?.0));
    }
    let baseline = baseline(reached, shuffled);
    let report = report(data, &guesses, chosen, baseline)?;
    let mut dice = Dice::new(seed, "model");
    let model = all(data, &data.levels).model(&mut dice).ok_or(NoModel::NothingFits)?;
    Ok(Trained { model: Model { knows: baseline.p <= SIGNIFICANT, ..model }, report })
}

fn all<'d>(data: &'d Dataset, levels: &'d [Level]) -> Part<'d> {
    Part { data, levels, people: (0..data.levels.len()).collect() }
}

/// The results for each person's sessions by models of the other people, and the name of each chosen learner.
fn leave_out(part: &Part, dice: &mut Dice, says: bool) -> Result<(Vec<Guess>, Vec<String>), NoModel> {
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
            guesses.push(Guess { person: row.person, level: part.levels[row.person], guessed, said });
        }
        chosen.push(model.learner);
    }
    Ok((guesses, chosen))
}

fn baseline(reached: f64, mut shuffled: Vec<f64>) -> Baseline {
    let as_good = shuffled.iter().filter(|balanced| **balanced >= reached - 1e-12).count();
    shuffled.sort_by(f64::total_cmp);
    let permutations = shuffled.len();
    Baseline {
        permutations,
        mean: shuffled.iter().sum::<f64>() / permutations as f64,
        high: quantile(&shuffled, 0.95),
        p: (as_good + 1) as f64 / (permutations + 1) as f64,
    }
}

fn report(data: &Dataset, guesses: &[Guess], chosen: Vec<String>, baseline: Baseline) -> Result<Report, NoModel> {
    let right = by_person(guesses, |guess| Some(f64::from(guess.guessed == guess.level)));
    let of_level = |level: Level| share(&right, |of| of == level).map(|found| LevelReport { level, found });
    let [novice, intermediate, expert] = Level::ALL.map(of_level);
    let given = |row: Level, column: Level| -> f64 {
        let shares = by_person(guesses, |guess| Some(f64::from(guess.guessed == column)));
        shares.iter().filter(|(level, _)| *level == row).map(|(_, share)| share).sum()
    };
    let row = |row: Level| -> PerLevel { Level::ALL.map(|column| given(row, column)) };
    let spoken = by_person(guesses, |guess| Some(f64::from(guess.said.is_some())));
    let right_where_spoken = by_person(guesses, |guess| guess.said.map(|said| f64::from(said == guess.level)));
    let right_where_said = |level: Level| {
        let given = |guess: &Guess| guess.said.filter(|said| *said == level);
        share(&by_person(guesses, |guess| given(guess).map(|said| f64::from(said == guess.level))), |_| true).ok()
    };
    let mut learners: Vec<(String, usize)> = Vec::new();
    for name in chosen {
        match learners.iter_mut().find(|(known, _)| *known == name) {
            Some((_, times)) => *times += 1,
            None => learners.push((name, 1)),
        }
    }
    Ok(Report {
        people: data.people(),
        sessions: data.sessions(),
        left_out: data.left_out(),
        offered: data.features().len(),
        accuracy: share(&right, |_| true)?,
        balanced: balanced(guesses),
        levels: [novice?, intermediate?, expert?],
        confusion: Level::ALL.map(row),
        baseline,
        speaking: Speaking {
            share: spoken.iter().map(|(_, share)| share).sum::<f64>() / spoken.len().max(1) as f64,
            right: share(&right_where_spoken, |_| true).ok(),
            of_level: Level::ALL.map(right_where_said),
        },
        chosen: learners,
    })
}
