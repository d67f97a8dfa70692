//! Limits the streams, WebSockets and exports that stay open: in all, and per user, so that no single user can occupy all of them.
//! Some can be kept for the agents of boxes.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::domain::scope::{Actor, Scope};

/// The slots for open connections; clones share them.
#[derive(Clone, Debug)]
pub struct ConnectionSlots {
    max_total: usize,
    /// All but those that are kept for agents.
    max_of_people: usize,
    max_per_user: usize,
    taken: Arc<Mutex<HashMap<Actor, usize>>>,
}

/// One occupied slot, freed when dropped.
#[derive(Debug)]
pub struct ConnectionSlot {
    owner: Actor,
    slots: ConnectionSlots,
}

impl ConnectionSlots {
    /// `most` slots in all and `most_of_one` per user. A user gets at most half of all slots, and at least one.
    pub fn new(max_total: usize, most_of_one: usize) -> Self {
        Self {
            max_total,
            max_of_people: max_total,
            max_per_user: most_of_one.min(max_total / 2).max(1),
            taken: Arc::default(),
        }
    }

    /// The same slots, with the last `kept` of them for agents only.
    pub fn keep_for_agents(self, kept: usize) -> Self {
        Self { max_of_people: self.max_total.saturating_sub(kept).max(1), ..self }
    }

    /// Takes a slot; `None` if all are taken or this user has reached the limit.
    pub fn take(&self, scope: &Scope) -> Option<ConnectionSlot> {
        let of = scope.actor();
        let mut taken = self.lock();
        let is_agent = matches!(of, Actor::Agent(_));
        let by_people: usize =
            taken.iter().filter(|(of, _)| !matches!(of, Actor::Agent(_))).map(|(_, count)| count).sum();
        let is_full = taken.values().sum::<usize>() >= self.max_total || !is_agent && by_people >= self.max_of_people;
        if is_full || taken.get(&of).is_some_and(|mine| *mine >= self.max_per_user) {
            return None;
        }
        *taken.entry(of).or_default() += 1;
        Some(ConnectionSlot { owner: of, slots: self.clone() })
    }

    /// True if this user has reached the limit of one user.
    pub fn is_full_for(&self, scope: &Scope) -> bool {
        self.lock().get(&scope.actor()).is_some_and(|mine| *mine >= self.max_per_user)
    }

    /// Number of taken slots.
    pub fn taken(&self) -> usize {
        self.lock().values().sum()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Actor, usize>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner) // counts are whole at every moment
    }
}

impl Drop for ConnectionSlot {
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
    use crate::ids::{BoxId, PersonId};

    #[test]
    fn one_user_cannot_take_all_slots_and_freed_slots_can_be_taken_again() {
        let (ada, bob) = (Scope::instructor(PersonId::at(1)), Scope::instructor(PersonId::at(2)));
        for (most, of_one, expected) in [(256, 96, 96), (10, 96, 5), (1, 96, 1)] {
            let places = ConnectionSlots::new(most, of_one);
            assert_eq!(std::iter::from_fn(|| places.take(&ada)).collect::<Vec<_>>().len(), expected);
        }
        let places = ConnectionSlots::new(4, 3);
        let mut hers: Vec<ConnectionSlot> = std::iter::from_fn(|| places.take(&ada)).collect();
        let his = [places.take(&bob).unwrap(), places.take(&bob).unwrap()];
        assert!(places.take(&Scope::instructor(PersonId::at(3))).is_none(), "all are taken");
        hers.pop();
        assert!(places.take(&Scope::instructor(PersonId::at(3))).is_some());
        drop((hers, his));
        assert_eq!(places.taken(), 0);
    }

    #[test]
    fn people_leave_the_slots_that_are_kept_for_agents() {
        let places = ConnectionSlots::new(8, 4).keep_for_agents(2);
        let people: Vec<_> = (1..=3).map(|person| Scope::instructor(PersonId::at(person))).collect();
        let by_people: Vec<ConnectionSlot> =
            people.iter().flat_map(|person| std::iter::from_fn(|| places.take(person))).collect();
        assert_eq!(by_people.len(), 6);
        let agents: Vec<_> = (1..=3).map(|of| places.take(&Scope::agent(BoxId::at(of)))).collect();
        assert_eq!(agents.iter().flatten().count(), 2);
    }
}
