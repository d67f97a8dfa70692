//! Counts wrong PINs: of each trainee, since a PIN is short, and at each box, so that no one tries the PINs of many
//! trainees. After some wrong ones the next attempt has to wait, and the wait doubles with each further one.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::ids::BoxId;
use crate::time::{SharedClock, millis};

/// Wrong PINs of a trainee without a wait.
const FREE_OF_TRAINEE: u32 = 5;
/// Wrong PINs at a box without a wait: a class of ten mistypes once each.
const FREE_OF_BOX: u32 = 10;
/// The first wait, and the longest: four attempts an hour find one PIN of 10,000 in some weeks, in front of everyone.
const FIRST_WAIT: Duration = Duration::from_secs(60);
const LONGEST_WAIT: Duration = Duration::from_secs(15 * 60);
/// Wrong PINs are forgotten this long after the last one.
const MEMORY: Duration = Duration::from_secs(24 * 60 * 60);
/// Trainees' codes and boxes that are remembered; at the limit the oldest is forgotten. A code that does not exist counts
/// as well, so that the answers do not show which codes exist.
const MAX_REMEMBERED: usize = 4096;

/// What wrong PINs are counted for.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Counted {
    Trainee(String),
    Box(BoxId),
}

impl Counted {
    fn free(&self) -> u32 {
        match self {
            Self::Trainee(_) => FREE_OF_TRAINEE,
            Self::Box(_) => FREE_OF_BOX,
        }
    }
}

/// Number of wrong PINs, and when the last one was, ms.
#[derive(Clone, Copy, Debug)]
struct WrongPins {
    count: u32,
    last_ms: i64,
    /// When the one before was, ms; a right PIN restores it.
    before_ms: i64,
}

/// The counters.
#[derive(Debug)]
pub struct PinAttempts {
    clock: SharedClock,
    wrong: Mutex<HashMap<Counted, WrongPins>>,
}

impl PinAttempts {
    /// No wrong PIN yet.
    pub fn new(clock: SharedClock) -> Self {
        Self { clock, wrong: Mutex::default() }
    }

    /// Counts an attempt before the PIN is checked, so that attempts at the same time gain nothing.
    ///
    /// # Errors
    /// How long to wait; then nothing was counted.
    pub fn attempt(&self, at: BoxId, trainee: &str) -> Result<(), Duration> {
        let now_ms = self.clock.monotonic_ms();
        let mut wrong = self.wrong.lock().unwrap_or_else(PoisonError::into_inner); // counts are whole at every moment
        wrong.retain(|_, of| now_ms - of.last_ms < millis(MEMORY));
        let counted = counted(at, trainee);
        let wait = |of: &Counted| wrong.get(of).map_or(Duration::ZERO, |known| known.wait(of.free(), now_ms));
        let wait = counted.iter().map(wait).max().unwrap_or_default();
        if !wait.is_zero() {
            return Err(wait);
        }
        for of in counted {
            if wrong.len() >= MAX_REMEMBERED && !wrong.contains_key(&of) {
                let oldest = wrong.iter().min_by_key(|(_, known)| known.last_ms).map(|(of, _)| of.clone());
                oldest.map(|of| wrong.remove(&of));
            }
            let known = wrong.entry(of).or_insert(WrongPins { count: 0, last_ms: now_ms, before_ms: now_ms });
            *known = WrongPins { count: known.count + 1, last_ms: now_ms, before_ms: known.last_ms };
        }
        Ok(())
    }

    /// The PIN was right: the attempts of the trainee are forgotten, and this one at the box.
    pub fn succeeded(&self, at: BoxId, trainee: &str) {
        let mut wrong = self.wrong.lock().unwrap_or_else(PoisonError::into_inner);
        let [of_trainee, of_box] = counted(at, trainee);
        wrong.remove(&of_trainee);
        if let Some(known) = wrong.get_mut(&of_box) {
            *known = WrongPins { count: known.count.saturating_sub(1), last_ms: known.before_ms, ..*known };
        }
    }
}

fn counted(at: BoxId, trainee: &str) -> [Counted; 2] {
    [Counted::Trainee(trainee.to_owned()), Counted::Box(at)]
}

impl WrongPins {
    /// How long the next attempt has to wait.
    fn wait(self, free: u32, now_ms: i64) -> Duration {
        let Some(over) = self.count.checked_sub(free) else { return Duration::ZERO };
        let wait = FIRST_WAIT.saturating_mul(1 << over.min(10)).min(LONGEST_WAIT);
        let passed = Duration::from_millis(u64::try_from(now_ms - self.last_ms).unwrap_or_default());
        wait.saturating_sub(passed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::ManualClock;

    #[test]
    fn wrong_pins_of_a_trainee_wait_longer_each_time_at_every_box() {
        let clock = ManualClock::at(0);
        let attempts = PinAttempts::new(clock.clone());
        for at in 0..i64::from(FREE_OF_TRAINEE) {
            assert_eq!(attempts.attempt(BoxId::at(at), "ada"), Ok(()));
        }
        assert_eq!(attempts.attempt(BoxId::at(99), "ada"), Err(FIRST_WAIT));
        clock.advance(FIRST_WAIT);
        assert_eq!(attempts.attempt(BoxId::at(99), "ada"), Ok(()));
        assert_eq!(attempts.attempt(BoxId::at(99), "ada"), Err(2 * FIRST_WAIT));
        assert_eq!(attempts.attempt(BoxId::at(99), "ben"), Ok(()), "others are free");
        for _ in 0..20 {
            clock.advance(LONGEST_WAIT);
            assert_eq!(attempts.attempt(BoxId::at(7), "ada"), Ok(()));
        }
        assert_eq!(attempts.attempt(BoxId::at(7), "ada"), Err(LONGEST_WAIT));
        clock.advance(MEMORY);
        assert_eq!(attempts.attempt(BoxId::at(7), "ada"), Ok(()));
    }

    #[test]
    fn one_box_cannot_try_the_pins_of_many_trainees_and_right_ones_do_not_count() {
        let attempts = PinAttempts::new(ManualClock::at(0));
        let at = BoxId::at(1);
        for trainee in 0..50 {
            attempts.attempt(at, &trainee.to_string()).unwrap();
            attempts.succeeded(at, &trainee.to_string());
        }
        let tried = (0..50).take_while(|trainee| attempts.attempt(at, &format!("t{trainee}")).is_ok()).count();
        assert_eq!(tried, FREE_OF_BOX as usize);
    }
}
