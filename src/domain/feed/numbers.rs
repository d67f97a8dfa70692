//! Sets of frame numbers, stored as ranges: a recording without an outage is one range.

use super::MAX_RANGES;

/// A set of numbers, stored as ordered ranges that neither touch nor overlap.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameNumbers {
    ranges: Vec<[u64; 2]>,
}

/// A recording has more ranges of frame numbers than allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the frames are in more than {MAX_RANGES} pieces; send frames in order, and a gap for frames that are lost")]
pub struct TooManyRanges;

impl FrameNumbers {
    /// The ranges, each by its first and last number.
    pub fn ranges(&self) -> &[[u64; 2]] {
        &self.ranges
    }

    /// True if the set contains this number.
    pub fn contains(&self, number: u64) -> bool {
        let after = self.ranges.partition_point(|[first, _]| *first <= number);
        after > 0 && self.ranges[after - 1][1] >= number
    }

    /// True if the set contains all numbers from `first` to `last`.
    pub fn contains_all(&self, first: u64, last: u64) -> bool {
        let after = self.ranges.partition_point(|[start, _]| *start <= first);
        after > 0 && self.ranges[after - 1][1] >= last
    }

    /// The number after the largest; 0 for an empty set.
    pub fn end(&self) -> u64 {
        self.ranges.last().map_or(0, |[_, last]| last + 1)
    }

    /// Adds the numbers from `first` to `last`.
    ///
    /// # Errors
    /// The set would have too many ranges; it stays unchanged.
    pub fn add(&mut self, first: u64, last: u64) -> Result<(), TooManyRanges> {
        // Ranges that touch the new one are merged with it.
        let from = self.ranges.partition_point(|[_, end]| end.saturating_add(1) < first);
        let to = self.ranges.partition_point(|[start, _]| *start <= last.saturating_add(1));
        if from == to && self.ranges.len() == MAX_RANGES {
            return Err(TooManyRanges);
        }
        let touched = &self.ranges[from..to];
        let first = touched.first().map_or(first, |[start, _]| first.min(*start));
        let last = touched.last().map_or(last, |[_, end]| last.max(*end));
        self.ranges.splice(from..to, [[first, last]]);
        Ok(())
    }

    /// The ranges below `end` that the set does not contain.
    pub fn missing_below(&self, end: u64) -> Vec<[u64; 2]> {
        let firsts = std::iter::once(0).chain(self.ranges.iter().map(|[_, last]| last + 1));
        let ends = self.ranges.iter().map(|[first, _]| *first).chain(std::iter::once(end));
        let holes = firsts.zip(ends).map(|(first, until)| (first, until.min(end)));
        holes.filter(|(first, until)| first < until).map(|(first, until)| [first, until - 1]).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn it_holds_what_a_set_holds(spans in prop::collection::vec((0u64..60, 0u64..6), 0..30), end in 0u64..70) {
            let (mut numbers, mut set) = (FrameNumbers::default(), BTreeSet::new());
            for (first, more) in spans {
                numbers.add(first, first + more).unwrap();
                set.extend(first..=first + more);
            }
            for number in 0..70 {
                prop_assert_eq!(numbers.contains(number), set.contains(&number));
            }
            for first in 0..70 {
                let last = first + 3;
                prop_assert_eq!(numbers.contains_all(first, last), (first..=last).all(|n| set.contains(&n)));
            }
            prop_assert_eq!(numbers.end(), set.last().map_or(0, |last| last + 1));
            prop_assert!(numbers.ranges().windows(2).all(|pair| pair[0][1] + 1 < pair[1][0]), "{:?}", numbers);
            let missing: Vec<u64> = numbers.missing_below(end).iter().flat_map(|[a, b]| *a..=*b).collect();
            prop_assert_eq!(missing, (0..end).filter(|n| !set.contains(n)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn at_most_the_maximum_number_of_ranges_is_accepted() {
        let mut numbers = FrameNumbers::default();
        for i in 0..MAX_RANGES as u64 {
            numbers.add(2 * i, 2 * i).unwrap();
        }
        let before = numbers.clone();
        assert_eq!(numbers.add(1 << 40, 1 << 40), Err(TooManyRanges));
        assert_eq!(numbers, before);
        numbers.add(1, 1).unwrap(); // fills a hole
        assert_eq!(numbers.ranges().len(), MAX_RANGES - 1);
    }
}
