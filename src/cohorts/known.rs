//! A cache for results that take long to compute and depend only on their input: charts by their design (20 ms),
//! learning curves by the values (13 ms for 500 sessions). They are reused when a page or its report is opened again.
//! The cache holds numbers without the people they belong to, and is lost when the process ends.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::domain::standard::ChartDesign;
use crate::pipeline::features::Direction;
use crate::pipeline::score::NoAnswer;
use crate::pipeline::score::curve::{self, Learning, Session};
use crate::pipeline::score::lc_cusum::Monitor;

/// Recently computed charts and learning curves.
#[derive(Debug)]
pub struct Known {
    charts: Lately<ChartDesign, Monitor>,
    curves: Lately<(Vec<Session>, Direction), Learning>,
}

impl Default for Known {
    /// Holds the designs of 32 tasks (most tasks share one), and 256 curves of 10 KiB, mostly the draws of their
    /// intervals.
    fn default() -> Self {
        Self { charts: Lately::of(32), curves: Lately::of(256) }
    }
}

impl Known {
    /// The charts of a design.
    pub fn charts(&self, design: ChartDesign) -> Result<Arc<Monitor>, NoAnswer> {
        self.charts.answer(design, |design| Monitor::new((*design).into()))
    }

    /// The learning curve of these sessions.
    pub fn curve(&self, sessions: Vec<Session>, better: Direction) -> Result<Arc<Learning>, NoAnswer> {
        self.curves.answer((sessions, better), |(sessions, better)| curve::fit(sessions, *better))
    }
}

/// A least-recently-used cache: answers by question, with the most recently used at the end.
#[derive(Debug)]
struct Lately<Q, A> {
    kept: Mutex<VecDeque<(Q, Arc<A>)>>,
    most: usize,
}

impl<Q: PartialEq, A> Lately<Q, A> {
    fn of(most: usize) -> Self {
        Self { kept: Mutex::default(), most }
    }

    fn answer<E>(&self, question: Q, compute: impl FnOnce(&Q) -> Result<A, E>) -> Result<Arc<A>, E> {
        if let Some(known) = self.recall(&question) {
            return Ok(known);
        }
        let made = Arc::new(compute(&question)?); // without the lock: two threads may compute the same answer
        let mut kept = self.lock();
        if kept.len() >= self.most {
            kept.pop_front();
        }
        kept.push_back((question, made.clone()));
        Ok(made)
    }

    fn recall(&self, question: &Q) -> Option<Arc<A>> {
        let mut kept = self.lock();
        let place = kept.iter().position(|(asked, _)| asked == question)?;
        let found = kept.remove(place)?;
        let answer = found.1.clone();
        kept.push_back(found);
        Some(answer)
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<(Q, Arc<A>)>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_computed_once_and_the_one_that_nobody_asked_for_longest_is_forgotten() {
        let lately = Lately::of(2);
        let asked = |question: u32, computes: bool| {
            let mut computed = false;
            let answer = lately.answer(question, |of| Ok::<_, ()>((computed = true, of * 2).1));
            assert_eq!((*answer.unwrap(), computed), (question * 2, computes), "{question}");
        };
        for (question, computes) in [(1, true), (2, true), (1, false), (3, true), (1, false), (2, true), (3, true)] {
            asked(question, computes);
        }
        assert!(lately.answer(7, |_| Err(())).is_err());
        assert_eq!(lately.lock().len(), 2);
    }

    #[test]
    fn charts_and_curves_are_those_that_their_makers_make() {
        let known = Known::default();
        let design = ChartDesign { declare_within: 20, alarm_within: 10, ..ChartDesign::default() };
        let first = known.charts(design).unwrap();
        assert!(Arc::ptr_eq(&first, &known.charts(design).unwrap()));
        assert_eq!(*first, Monitor::new(design.into()).unwrap());
        assert!(known.charts(ChartDesign { adequate: 0.4, ..design }).is_err());

        let sessions = |level: f64| -> Vec<Session> {
            let value = |number: u32| level + 50.0 * (-f64::from(number) / 4.0).exp() + f64::from(number * 7 % 5);
            (1..=30).map(|number| Session { number, value: value(number) }).collect()
        };
        let [falls, other] = [40.0, 41.0].map(|level| known.curve(sessions(level), Direction::Lower).unwrap());
        assert_eq!(*falls, curve::fit(&sessions(40.0), Direction::Lower).unwrap());
        assert!(matches!(&*falls, Learning::Curve(_)) && falls != other);
        let rising = known.curve(sessions(40.0), Direction::Higher).unwrap();
        assert_eq!(*rising, Learning::NoCurve, "the direction is part of the question");
    }
}
