//! The differences between a beginner's hands and a surgeon's, as named numbers.
//!
//! The figures are chosen, not measured. They keep the order that the literature reports (novices are slower, less
//! direct and less steady, with longer pauses and one idle hand: T 4.4, T 7.2), with gaps between the levels.

use crate::random::Dice;

/// Spread of each figure among people of one level, as the standard deviation of its logarithm. Neighbouring levels
/// overlap, as in every centre. Chosen, not measured.
const PERSON_SPREAD: f64 = 0.25;

/// A way of moving.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skill {
    /// Name on the command line.
    pub name: &'static str,
    /// Mean speed of a reach, mm/s.
    pub reach_speed_mm_s: f64,
    /// Mean rest at a target, s.
    pub pause_s: f64,
    /// Physiological tremor, 5–11 Hz, RMS per coordinate, mm.
    pub tremor_mm: f64,
    /// Slow unsteadiness, 0.4–1.3 Hz, RMS per coordinate, mm.
    pub wander_mm: f64,
    /// Sideways deviation of a reach, as a share of its length (standard deviation).
    pub detour: f64,
    /// First miss of a reach's target, as a share of the reach's length (standard deviation).
    pub miss: f64,
    /// Corrective movements after a reach that missed.
    pub corrections: usize,
    /// Share of a reach's time that overlaps with the next reach, where the task allows it.
    pub fluency: f64,
    /// Share of two-handed steps that the dominant hand does alone.
    pub one_handedness: f64,
}

impl Skill {
    /// First week on the trainer.
    pub const NOVICE: Skill = Skill {
        name: "novice",
        reach_speed_mm_s: 34.0,
        pause_s: 0.75,
        tremor_mm: 0.34,
        wander_mm: 1.1,
        detour: 0.24,
        miss: 0.15,
        corrections: 3,
        fluency: 0.0,
        one_handedness: 0.65,
    };

    /// Some months of practice.
    pub const INTERMEDIATE: Skill = Skill {
        name: "intermediate",
        reach_speed_mm_s: 58.0,
        pause_s: 0.4,
        tremor_mm: 0.2,
        wander_mm: 0.5,
        detour: 0.12,
        miss: 0.07,
        corrections: 1,
        fluency: 0.12,
        one_handedness: 0.3,
    };

    /// Operates daily.
    pub const EXPERT: Skill = Skill {
        name: "expert",
        reach_speed_mm_s: 92.0,
        pause_s: 0.16,
        tremor_mm: 0.1,
        wander_mm: 0.18,
        detour: 0.04,
        miss: 0.025,
        corrections: 1,
        fluency: 0.3,
        one_handedness: 0.0,
    };

    /// Every level, from least to most practised.
    pub const ALL: [Skill; 3] = [Skill::NOVICE, Skill::INTERMEDIATE, Skill::EXPERT];

    /// A person of this level; the same number gives the same person in every task.
    pub fn of_person(self, person: u64) -> Skill {
        let mut dice = Dice::new(person, "person");
        let mut own = |figure: f64| figure * (PERSON_SPREAD * dice.gauss()).exp();
        Skill {
            reach_speed_mm_s: own(self.reach_speed_mm_s),
            pause_s: own(self.pause_s),
            tremor_mm: own(self.tremor_mm),
            wander_mm: own(self.wander_mm),
            detour: own(self.detour),
            miss: own(self.miss),
            fluency: own(self.fluency).min(0.5),
            one_handedness: own(self.one_handedness).min(1.0),
            ..self
        }
    }

    /// The level of this name.
    pub fn named(name: &str) -> Option<Skill> {
        Self::ALL.into_iter().find(|s| s.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_of_one_level_differ_and_stay_themselves() {
        let people: Vec<Skill> = (0..200).map(|person| Skill::NOVICE.of_person(person)).collect();
        assert_eq!(people[7], Skill::NOVICE.of_person(7));
        assert_ne!(people[7].pause_s, people[8].pause_s);
        let logs: Vec<f64> = people.iter().map(|own| (own.pause_s / Skill::NOVICE.pause_s).ln()).collect();
        let mean = logs.iter().sum::<f64>() / 200.0;
        let deviation = (logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>() / 199.0).sqrt();
        assert!(mean.abs() < 0.06 && (0.2..0.3).contains(&deviation), "{mean} {deviation}");
    }
}
