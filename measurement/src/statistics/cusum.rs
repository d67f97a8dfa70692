//! One-sided Bernoulli CUSUM: a score that rises on one outcome, falls on the other, never goes below zero, and signals
//! when it reaches its limit (Page 1954). The rate of chance signals is computed exactly, so a limit keeps a stated
//! error rate. No limit is copied from elsewhere: the often copied 1.25 calls 99.9 % of incompetent trainees proficient
//! within 100 trials.

use super::no_answer::NoAnswer;

/// Maximum number of trials for which error rates are computed and stated.
pub const MAX_TRIALS: usize = 200;

/// Scores closer than this are equal; the difference is rounding.
const ROUNDING: f64 = 1e-9;

/// A chart for one of two outcomes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CusumChart {
    rise: f64,
    fall: f64,
    limit: f64,
}

/// The state of a chart: outcomes since it was last at zero. It holds counts rather than their sum, so that every path
/// to a score gives exactly the same score.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CusumState {
    rises: usize,
    falls: usize,
}

impl CusumChart {
    /// Designs the chart that detects an outcome with chance `sought` where the chance was `usual` before (Wald's
    /// log-likelihood ratios). Its limit is the lowest one that is reached by chance alone within `trials` in at most
    /// `share` of the cases.
    ///
    /// Chances lie between 0 and 1 with `usual < sought`; `trials` is at most [`MAX_TRIALS`].
    ///
    /// # Errors
    /// [`NoAnswer::UnusableSetting`] for an argument out of range, or if no limit keeps the error rate.
    pub fn designed(usual: f64, sought: f64, share: f64, trials: usize) -> Result<Self, NoAnswer> {
        if !(0.0 < usual && usual < sought && sought < 1.0) {
            return Err(NoAnswer::UnusableSetting("chances"));
        }
        if !(0.0 < share && share < 1.0) {
            return Err(NoAnswer::UnusableSetting("share"));
        }
        if !(1..=MAX_TRIALS).contains(&trials) {
            return Err(NoAnswer::UnusableSetting("trials"));
        }
        let rise = (sought / usual).ln();
        let fall = ((1.0 - usual) / (1.0 - sought)).ln();
        let limits = possible_scores(rise, fall, trials);
        let by_chance = |limit: f64| Self { rise, fall, limit }.reached_by(usual, trials)[trials - 1];
        // A higher limit is reached less often.
        let lowest = limits.partition_point(|limit| by_chance(*limit) > share);
        let limit = *limits.get(lowest).ok_or(NoAnswer::UnusableSetting("trials"))?;
        Ok(Self { rise, fall, limit })
    }

    /// The score at which the chart signals.
    pub fn limit(self) -> f64 {
        self.limit
    }

    /// The score of a state, from 0.
    pub fn score(self, walk: CusumState) -> f64 {
        self.rise * walk.rises as f64 - self.fall * walk.falls as f64
    }

    /// True if the state has reached the limit.
    pub fn has_reached_limit(self, walk: CusumState) -> bool {
        self.score(walk) >= self.limit - ROUNDING
    }

    /// The state after one more trial; `rises` is the outcome of the trial.
    pub fn step(self, walk: CusumState, rises: bool) -> CusumState {
        let next = CusumState { rises: walk.rises + usize::from(rises), falls: walk.falls + usize::from(!rises) };
        if self.score(next) > ROUNDING { next } else { CusumState::default() }
    }

    /// For each trial from the first to the last: the share of charts that have reached the limit by then, if each
    /// trial rises with this chance. Exact: it follows all states at once, weighted by their shares. Cost: trials³ / 2
    /// steps, 0.5 ms for 100.
    pub fn reached_by(self, chance: f64, trials: usize) -> Vec<f64> {
        let at = |walk: CusumState| walk.rises * (trials + 1) + walk.falls;
        let mut shares = vec![0.0; (trials + 1) * (trials + 1)];
        shares[0] = 1.0;
        let mut reached = Vec::with_capacity(trials);
        let mut signalled = 0.0;
        for trial in 0..trials {
            let mut next = vec![0.0; shares.len()];
            for rises in 0..=trial {
                for falls in 0..=trial - rises {
                    let walk = CusumState { rises, falls };
                    let share = shares[at(walk)];
                    if share == 0.0 {
                        continue;
                    }
                    for (outcome, weight) in [(true, chance), (false, 1.0 - chance)] {
                        let then = self.step(walk, outcome);
                        if self.has_reached_limit(then) {
                            signalled += share * weight
                        } else {
                            next[at(then)] += share * weight
                        }
                    }
                }
            }
            shares = next;
            reached.push(signalled);
        }
        reached
    }
}

/// All scores above zero that are possible within some trials, in ascending order.
fn possible_scores(rise: f64, fall: f64, trials: usize) -> Vec<f64> {
    let of = |rises: usize| (0..=trials - rises).map(move |falls| rise * rises as f64 - fall * falls as f64);
    let mut scores: Vec<f64> = (1..=trials).flat_map(of).filter(|score| *score > ROUNDING).collect();
    scores.sort_by(f64::total_cmp);
    scores.dedup_by(|a, b| (*a - *b).abs() < ROUNDING);
    scores
}

/// The first trial, from 1, at which this share has been reached; `None` if it never is.
pub fn first_trial_reaching(reached: &[f64], share: f64) -> Option<usize> {
    reached.iter().position(|so_far| *so_far >= share).map(|index| index + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_rises_falls_and_stops_at_zero() {
        let chart = CusumChart { rise: 2.0, fall: 3.0, limit: 4.0 };
        let walk =
            |outcomes: &[bool]| outcomes.iter().fold(CusumState::default(), |walk, rises| chart.step(walk, *rises));
        assert_eq!(chart.score(walk(&[true])), 2.0);
        assert_eq!(chart.score(walk(&[true, false])), 0.0);
        assert_eq!(chart.score(walk(&[true, false, false, true])), 2.0);
        assert!(chart.has_reached_limit(walk(&[true, true])) && !chart.has_reached_limit(walk(&[true])));
    }

    #[test]
    fn shares_are_those_of_every_sequence_counted_one_by_one() {
        let (chart, chance, trials) = (CusumChart { rise: 0.7, fall: 0.45, limit: 1.3 }, 0.35f64, 10);
        let mut counted = 0.0;
        for sequence in 0..1u32 << trials {
            let mut walk = CusumState::default();
            let tells = (0..trials).any(|trial| {
                walk = chart.step(walk, (sequence >> trial) & 1 == 1);
                chart.has_reached_limit(walk)
            });
            let rises = sequence.count_ones() as i32;
            let weight = chance.powi(rises) * (1.0 - chance).powi(trials - rises);
            counted += if tells { weight } else { 0.0 };
        }
        let got = chart.reached_by(chance, trials as usize);
        assert!((got[9] - counted).abs() < 1e-12, "{got:?}, counted {counted}");
        assert!(got.is_sorted() && got[0] == 0.0, "{got:?}");
        assert_eq!(
            (first_trial_reaching(&[0.0, 0.2, 0.2, 0.6], 0.2), first_trial_reaching(&[0.0, 0.2], 0.3)),
            (Some(2), None)
        );
    }

    #[test]
    fn a_limit_keeps_its_error_rate_and_the_next_lower_one_does_not() {
        let chart = CusumChart::designed(0.7, 0.9, 0.05, 50).unwrap();
        let share = |chart: CusumChart| chart.reached_by(0.7, 50)[49];
        assert!(share(chart) <= 0.05, "{}", share(chart));
        let lower = possible_scores(chart.rise, chart.fall, 50)
            .into_iter()
            .rfind(|score| *score < chart.limit - ROUNDING)
            .unwrap();
        assert!(share(CusumChart { limit: lower, ..chart }) > 0.05);
    }

    #[test]
    fn a_copied_limit_declares_nearly_every_incompetent_trainee() {
        let copied = CusumChart { limit: 1.25, ..CusumChart::designed(0.7, 0.9, 0.05, 50).unwrap() };
        assert!(copied.reached_by(0.7, 100)[99] > 0.999);
    }

    #[test]
    fn chances_shares_and_trials_that_say_nothing_are_refused() {
        let of = |usual, sought, share, trials| CusumChart::designed(usual, sought, share, trials).map(drop);
        for (usual, sought) in [(0.9, 0.7), (0.5, 0.5), (0.0, 0.5), (0.5, 1.0), (f64::NAN, 0.5), (0.5, f64::NAN)] {
            assert_eq!(of(usual, sought, 0.05, 50), Err(NoAnswer::UnusableSetting("chances")));
        }
        assert_eq!(of(0.7, 0.9, 0.0, 50), Err(NoAnswer::UnusableSetting("share")));
        assert_eq!(of(0.7, 0.9, f64::NAN, 50), Err(NoAnswer::UnusableSetting("share")));
        for trials in [0, MAX_TRIALS + 1] {
            assert_eq!(of(0.7, 0.9, 0.05, trials), Err(NoAnswer::UnusableSetting("trials")));
        }
        // Three passes in a row come by chance in a third of the cases: no limit within three trials keeps 5 %.
        assert_eq!(of(0.7, 0.9, 0.05, 3), Err(NoAnswer::UnusableSetting("trials")));
    }
}
