//! LC-CUSUM: detects when a trainee becomes proficient, and whether they have relapsed since (Biau & Porcher 2010, doi
//! 10.1002/sim.3947; METHOD 7.3).
//!
//! At first the trainee is assumed inadequate, and passes count towards proficiency: a pass adds ln((1 − p1)/(1 − p0)),
//! a miss ln(p1/p0), with p0 the inadequate and p1 the adequate share of misses. After the declaration, a CUSUM with
//! inverted ratios watches for a relapse; after a relapse learning starts again. Both limits keep stated error rates
//! exactly ([`CusumChart`]). Trials with unknown outcome move neither chart and do not count.

use super::cusum::{CusumChart, CusumState, MAX_TRIALS, first_trial_reaching};
use super::no_answer::NoAnswer;
use super::trial::TrialOutcome;

/// Which performance is adequate, and how often the charts may be wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LcCusumDesign {
    /// Share of trials that an inadequate trainee misses, p0. Usual: 0.3.
    pub inadequate: f64,
    /// Share of trials that an adequate trainee misses, p1, below p0. Usual: 0.1; a value closer to p0 takes more
    /// trials.
    pub adequate: f64,
    /// Maximum share of inadequate trainees that are declared proficient within [`Self::declare_within`] trials.
    pub false_declaration: f64,
    /// Number of judged trials for [`Self::false_declaration`].
    pub declare_within: usize,
    /// Maximum share of adequate trainees that get an alarm within [`Self::alarm_within`] trials after their
    /// declaration.
    pub false_alarm: f64,
    /// Number of judged trials for [`Self::false_alarm`].
    pub alarm_within: usize,
}

impl Default for LcCusumDesign {
    /// Nine of ten adequate trainees are declared proficient within 50 trials, and half of the relapses are found
    /// within 24.
    fn default() -> Self {
        Self {
            inadequate: 0.3,
            adequate: 0.1,
            false_declaration: 0.05,
            declare_within: 50,
            false_alarm: 0.05,
            alarm_within: 100,
        }
    }
}

/// The two charts of a design, with their known error rates.
#[derive(Clone, Debug, PartialEq)]
pub struct LcCusumMonitor {
    learning: CusumChart,
    keeping: CusumChart,
    /// By judged trial, from the first: share of inadequate trainees declared proficient by then.
    pub declared_wrongly: Vec<f64>,
    /// By judged trial, from the first: share of adequate trainees declared proficient by then.
    pub declared_rightly: Vec<f64>,
    /// Number of judged trials after a relapse to p0 until half of the relapses are found; `None` beyond
    /// [`MAX_TRIALS`].
    pub relapse_found_median: Option<usize>,
    /// The same for nine of ten.
    pub relapse_found_90: Option<usize>,
}

/// An event in a trainee's history.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CompetenceEvent {
    /// Declared proficient.
    Declared {
        /// At which trial, from 1, all trials counted.
        at: usize,
        /// Number of judged trials until then.
        judged: usize,
        /// Share of inadequate trainees who would also have been declared proficient by then; `None` beyond
        /// [`MAX_TRIALS`].
        wrong_by_then: Option<f64>,
    },
    /// Relapsed; learning starts again.
    Relapsed {
        /// At which trial, from 1, all trials counted.
        at: usize,
        /// Number of judged trials since the declaration.
        judged: usize,
    },
}

/// The present standing of a trainee.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Not yet proficient: the trials so far do not show it. They need not show the opposite.
    NotYet,
    /// Proficient.
    Proficient,
    /// Was proficient, relapsed, and is not proficient again yet.
    Relapsed,
}

/// The score after a trial on one of the charts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LcCusumPoint {
    /// True on the learning chart, false on the chart that watches for a relapse.
    pub learning: bool,
    /// The score, from 0 to the chart's limit or just above it.
    pub score: f64,
}

/// The result of following a trainee's trials.
#[derive(Clone, Debug, PartialEq)]
pub struct CompetenceHistory {
    /// Declarations and relapses in alternation.
    pub events: Vec<CompetenceEvent>,
    /// The trainee's standing after the last trial.
    pub standing: Standing,
    /// Number of judged trials since the last event.
    pub judged: usize,
    /// One point per trial; `None` if its outcome is unknown.
    pub path: Vec<Option<LcCusumPoint>>,
}

impl LcCusumMonitor {
    /// Computes the limits of a design. Cost: 20 ms; reuse it for all trainees.
    ///
    /// # Errors
    /// [`NoAnswer::UnusableSetting`] for a design with unusable rates.
    pub fn new(design: LcCusumDesign) -> Result<Self, NoAnswer> {
        let LcCusumDesign { inadequate, adequate, .. } = design;
        let learning =
            CusumChart::designed(1.0 - inadequate, 1.0 - adequate, design.false_declaration, design.declare_within)?;
        let keeping = CusumChart::designed(adequate, inadequate, design.false_alarm, design.alarm_within)?;
        let found = keeping.reached_by(inadequate, MAX_TRIALS);
        Ok(Self {
            learning,
            keeping,
            declared_wrongly: learning.reached_by(1.0 - inadequate, MAX_TRIALS),
            declared_rightly: learning.reached_by(1.0 - adequate, MAX_TRIALS),
            relapse_found_median: first_trial_reaching(&found, 0.5),
            relapse_found_90: first_trial_reaching(&found, 0.9),
        })
    }

    /// The scores at which proficiency is declared and at which a relapse is reported.
    pub fn limits(&self) -> (f64, f64) {
        (self.learning.limit(), self.keeping.limit())
    }

    /// Follows the trials in their order on the two charts.
    pub fn follow(&self, trials: &[TrialOutcome]) -> CompetenceHistory {
        let mut career =
            CompetenceHistory { events: Vec::new(), standing: Standing::NotYet, judged: 0, path: Vec::new() };
        let mut walk = CusumState::default();
        for (index, trial) in trials.iter().enumerate() {
            let learning = career.standing != Standing::Proficient;
            let chart = if learning { self.learning } else { self.keeping };
            if *trial == TrialOutcome::Unknown {
                career.path.push(None);
                continue;
            }
            walk = chart.step(walk, learning == (*trial == TrialOutcome::Passed));
            career.judged += 1;
            career.path.push(Some(LcCusumPoint { learning, score: chart.score(walk) }));
            if chart.has_reached_limit(walk) {
                career.events.push(self.event(learning, index + 1, career.judged));
                career.standing = if learning { Standing::Proficient } else { Standing::Relapsed };
                (walk, career.judged) = (CusumState::default(), 0);
            }
        }
        career
    }

    fn event(&self, learning: bool, at: usize, judged: usize) -> CompetenceEvent {
        match learning {
            true => {
                CompetenceEvent::Declared { at, judged, wrong_by_then: self.declared_wrongly.get(judged - 1).copied() }
            }
            false => CompetenceEvent::Relapsed { at, judged },
        }
    }
}

#[cfg(test)]
mod tests;
