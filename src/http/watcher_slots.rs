//! Limits the streams and WebSockets that stay open while a user watches: in all, and per user, so that no single user
//! can occupy all of them.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::domain::scope::{Actor, Scope};

/// The slots for open streams; clones share them.
#[derive(Clone, Debug)]
pub struct WatcherSlots {
    max_total: usize,
    max_per_user: usize,
    taken: Arc<Mutex<HashMap<Actor, usize>>>,
}

/// One occupied slot, freed when dropped.
#[derive(Debug)]
pub struct WatcherSlot {
    owner: Actor,
    slots: WatcherSlots,
}

impl WatcherSlots {
    /// `most` slots in all and `most_of_one` per user. A user gets at most half of all slots, and at least one.
    pub fn new(max_total: usize, most_of_one: usize) -> Self {
        Self { max_total, max_per_user: most_of_one.min(max_total / 2).max(1), taken: Arc::default() }
    }

    /// Takes a slot; `None` if all are taken or this user has reached the limit.
    pub fn take(&self, scope: &Scope) -> Option<WatcherSlot> {
        let of = scope.actor();
        let mut taken = self.lock();
        let is_full = taken.values().sum::<usize>() >= self.max_total;
        if is_full || taken.get(&of).is_some_and(|mine| *mine >= self.max_per_user) {
            return None;
        }
        *taken.entry(of).or_default() += 1;
        Some(WatcherSlot { owner: of, slots: self.clone() })
    }

    /// Number of taken slots.
    pub fn taken(&self) -> usize {
        self.lock().values().sum()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Actor, usize>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner) // counts are whole at every moment
    }
}

impl Drop for WatcherSlot {
    fn drop(&mut self) {
        let mut taken = self.slots.lock();
        if let Some(mine) = taken.get_mut(&self.owner) {
            *mine -= 1;
            if *mine == 0 {
                taken.remove(&self.owner);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::PersonId;

    #[test]
    fn one_user_cannot_take_all_slots_and_freed_slots_can_be_taken_again() {
        let (ada, bob) = (Scope::instructor(PersonId::at(1)), Scope::instructor(PersonId::at(2)));
        for (most, of_one, expected) in [(256, 96, 96), (10, 96, 5), (1, 96, 1)] {
            let places = WatcherSlots::new(most, of_one);
            assert_eq!(std::iter::from_fn(|| places.take(&ada)).collect::<Vec<_>>().len(), expected);
        }
        let places = WatcherSlots::new(4, 3);
        let mut hers: Vec<WatcherSlot> = std::iter::from_fn(|| places.take(&ada)).collect();
        let his = [places.take(&bob).unwrap(), places.take(&bob).unwrap()];
        assert!(places.take(&Scope::instructor(PersonId::at(3))).is_none(), "all are taken");
        hers.pop();
        assert!(places.take(&Scope::instructor(PersonId::at(3))).is_some());
        drop((hers, his));
        assert_eq!(places.taken(), 0);
    }
}
