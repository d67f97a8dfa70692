//! People dealt into folds, level by level, so that each fold's rest knows every level; and levels shuffled between people.

use super::Level;
use crate::random::Dice;

/// The fold of each person.
pub(super) fn deal(people: &[usize], levels: &[Level], folds: usize, dice: &mut Dice) -> Vec<(usize, usize)> {
    let mut dealt = Vec::with_capacity(people.len());
    for level in Level::ALL {
        let mut group: Vec<usize> = people.iter().copied().filter(|person| levels[*person] == level).collect();
        shuffle(&mut group, dice);
        dealt.extend(group);
    }
    dealt.into_iter().enumerate().map(|(place, person)| (person, place % folds)).collect()
}

/// Puts things into a random order (Fisher and Yates).
pub(super) fn shuffle<T>(things: &mut [T], dice: &mut Dice) {
    for last in (1..things.len()).rev() {
        things.swap(last, dice.pick(last + 1));
    }
}
