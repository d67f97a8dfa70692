//! A cache for results that take long to compute and depend only on their input: charts by their design (20 ms),
//! learning curves by the values (13 ms for 500 sessions). They are reused when a page or its report is opened again.
//! The cache holds numbers without the people they belong to, and is lost when the process ends.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::domain::standard::ChartDesign;
use crate::motion::features::Direction;
use crate::statistics::NoAnswer;
use crate::statistics::curve::{self, LearningFit, NumberedValue};
use crate::statistics::lc_cusum::LcCusumMonitor;

/// Recently computed charts and learning curves.
#[derive(Debug)]
pub struct ComputedCache {
    charts: RecentAnswers<ChartDesign, LcCusumMonitor>,
    curves: RecentAnswers<(Vec<NumberedValue>, Direction), LearningFit>,
}

impl Default for ComputedCache {
    /// Holds the designs of 32 tasks (most tasks share one), and 256 curves of 10 KiB, mostly the draws of their
    /// intervals.
    fn default() -> Self {
        Self { charts: RecentAnswers::of(32), curves: RecentAnswers::of(256) }
    }
}

impl ComputedCache {
    /// The charts of a design.
    pub fn charts(&self, design: ChartDesign) -> Result<Arc<LcCusumMonitor>, NoAnswer> {
        self.charts.get_or_compute(design, |design| LcCusumMonitor::new((*design).into()))
    }

    /// The learning curve of these sessions.
    pub fn curve(&self, sessions: Vec<NumberedValue>, better: Direction) -> Result<Arc<LearningFit>, NoAnswer> {
        self.curves.get_or_compute((sessions, better), |(sessions, better)| curve::fit(sessions, *better))
    }
}

/// A least-recently-used cache: answers by question, with the most recently used at the end.
#[derive(Debug)]
struct RecentAnswers<Q, A> {
    kept: Mutex<VecDeque<(Q, Arc<A>)>>,
    capacity: usize,
}

impl<Q: PartialEq, A> RecentAnswers<Q, A> {
    fn of(capacity: usize) -> Self {
        Self { kept: Mutex::default(), capacity }
    }

    fn get_or_compute<E>(&self, question: Q, compute: impl FnOnce(&Q) -> Result<A, E>) -> Result<Arc<A>, E> {
        if let Some(known) = self.get(&question) {
            return Ok(known);
        }
        let made = Arc::new(compute(&question)?); // without the lock: two threads may compute the same answer
        let mut kept = self.lock();
        if kept.len() >= self.capacity {
            kept.pop_front();
        }
        kept.push_back((question, made.clone()));
        Ok(made)
    }

    fn get(&self, question: &Q) -> Option<Arc<A>> {
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
    fn an_answer_is_computed_once_and_the_least_recently_used_is_dropped() {
        let lately = RecentAnswers::of(2);
        let asked = |question: u32, computes: bool| {
            let mut computed = false;
            let answer = lately.get_or_compute(question, |of| Ok::<_, ()>((computed = true, of * 2).1));
            assert_eq!((*answer.unwrap(), computed), (question * 2, computes), "{question}");
        };
        for (question, computes) in [(1, true), (2, true), (1, false), (3, true), (1, false), (2, true), (3, true)] {
            asked(question, computes);
        }
        assert!(lately.get_or_compute(7, |_| Err(())).is_err());
        assert_eq!(lately.lock().len(), 2);
    }

    #[test]
    fn cached_charts_and_curves_equal_computed_ones() {
        let known = ComputedCache::default();
        let design = ChartDesign { declare_within: 20, alarm_within: 10, ..ChartDesign::default() };
        let first = known.charts(design).unwrap();
        assert!(Arc::ptr_eq(&first, &known.charts(design).unwrap()));
        assert_eq!(*first, LcCusumMonitor::new(design.into()).unwrap());
        assert!(known.charts(ChartDesign { adequate: 0.4, ..design }).is_err());

        let sessions = |level: f64| -> Vec<NumberedValue> {
            let value = |number: u32| level + 50.0 * (-f64::from(number) / 4.0).exp() + f64::from(number * 7 % 5);
            (1..=30).map(|number| NumberedValue { number, value: value(number) }).collect()
        };
        let [falls, other] = [40.0, 41.0].map(|level| known.curve(sessions(level), Direction::Lower).unwrap());
        assert_eq!(*falls, curve::fit(&sessions(40.0), Direction::Lower).unwrap());
        assert!(matches!(&*falls, LearningFit::Curve(_)) && falls != other);
        let rising = known.curve(sessions(40.0), Direction::Higher).unwrap();
        assert_eq!(*rising, LearningFit::NoCurve, "the direction is part of the question");
    }
}
