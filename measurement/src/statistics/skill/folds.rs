//! Divides people into folds, level by level, so that the rest of each fold contains every level; and shuffles levels
//! between people.

use super::SkillLevel;
use crate::random::Dice;

/// The fold of each person.
pub(super) fn assign_folds(
    people: &[usize],
    levels: &[SkillLevel],
    folds: usize,
    dice: &mut Dice,
) -> Vec<(usize, usize)> {
    let mut dealt = Vec::with_capacity(people.len());
    for level in SkillLevel::ALL {
        let mut group: Vec<usize> = people.iter().copied().filter(|person| levels[*person] == level).collect();
        shuffle(&mut group, dice);
        dealt.extend(group);
    }
    dealt.into_iter().enumerate().map(|(index, person)| (person, index % folds)).collect()
}

/// Puts items into a random order (Fisher and Yates).
pub(super) fn shuffle<T>(things: &mut [T], dice: &mut Dice) {
    for last in (1..things.len()).rev() {
        things.swap(last, dice.pick(last + 1));
    }
}
