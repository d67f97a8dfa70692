//! When an attempt begins and ends.
//!
//! **In:** one tool's motion over the whole recording, why it was not seen where it was not seen, and when the
//! recording begins and ends. **Out:** [`TaskAttempt`]: both ends on the time grid, how much earlier or later the truth
//! may lie because the tool was out of sight, and whether the recording cut the attempt off.
//!
//! **Definition.** An attempt begins when the first tool starts to move or comes into the picture. It ends when the
//! last tool has stopped or has left the picture. **Method:** a tool starts with its first movement
//! ([`super::movement`]) that takes the tip at least [`MIN_TRAVEL_MM`] away; a tremor or an error of the path starts
//! nothing. The end is found by the same rule on the reversed path. Following the speed further back, to 3 or 5 mm/s,
//! began 0.05 to 0.1 s too early, because filter and fit spread a start over the time before it. **Assumes** that a
//! tool which comes into the picture, or leaves it, moves.
//!
//! An end is known to a frame or two where the tool was in sight. Where it already moved as it was first seen, it may
//! have started at any moment while it was out of sight, and that time is stated. A tool that moves as the recording
//! begins started before it: the true time is longer than the measured one by an unknown amount.

use nalgebra::Point3;

use super::FeatureSettings;
use super::motion::{Interval, Motion};
use super::movement::{is_fast, movements};
use super::view::{ExplainedAbsence, UnseenCause};

/// Distance that a movement must take the tip away, mm, to begin or end an attempt. Errors and tremor move a resting
/// tip by a few tenths, and corrections at a target are 2 to 5 mm long.
pub const MIN_TRAVEL_MM: f64 = 2.0;

/// A tool that is seen within this time of the recording's beginning was there from the beginning, s.
const PRESENT_S: f64 = 0.2;

/// In a longer time out of sight a tool can move and come to rest again, s.
const HIDDEN_MOVEMENT_S: f64 = 1.0;

/// When the recording begins and ends, in instants of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordingEnds {
    /// From its first frame to its last.
    pub interval: Interval,
    /// For beginning and end: true if a person trimmed the recording there, and so chose where the attempt begins or
    /// ends.
    pub is_trimmed: [bool; 2],
}

/// One end of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AttemptEnd {
    /// Instant of the grid.
    pub at: i64,
    /// By how many steps the attempt may be longer at this end, because the tool was out of sight.
    pub unseen_steps: i64,
    /// True if a tool moved as the recording began or ended: the attempt is longer by an unknown time.
    pub is_cut_off: bool,
}

/// An attempt of one tool, or of all tools together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskAttempt {
    /// Its beginning.
    pub begin: AttemptEnd,
    /// Its end.
    pub end: AttemptEnd,
}

impl TaskAttempt {
    /// The attempt of one tool; `None` if it did not move. `absences` are the times when it was not seen, with their
    /// causes, if the tracker states them.
    pub fn of_tool(
        motion: &Motion,
        absences: Option<&[ExplainedAbsence]>,
        recording: RecordingEnds,
        settings: &FeatureSettings,
    ) -> Option<Self> {
        let end = |direction| TimeView::new(motion, absences, recording, direction, settings).first_end();
        let (begin, end) = (end(TimeDirection::Forwards)?, end(TimeDirection::Backwards)?);
        let end = AttemptEnd { at: -end.at, ..end };
        (begin.at < end.at).then_some(Self { begin, end })
    }

    /// The attempt of both: from the earlier beginning to the later end.
    pub fn hull(self, other: Self) -> Self {
        let reversed = |end: AttemptEnd| AttemptEnd { at: -end.at, ..end };
        Self {
            begin: first_of(self.begin, other.begin),
            end: reversed(first_of(reversed(self.end), reversed(other.end))),
        }
    }

    /// From its beginning to its end.
    pub fn interval(self) -> Interval {
        Interval { first: self.begin.at, last: self.end.at }
    }

    /// True if the recording shows only a part of it.
    pub fn is_cut_off(self) -> bool {
        self.begin.is_cut_off || self.end.is_cut_off
    }

    /// By how many steps it may be longer than seen.
    pub fn unseen_steps(self) -> i64 {
        self.begin.unseen_steps + self.end.unseen_steps
    }
}

/// The beginning of an attempt of two tools.
fn first_of(one: AttemptEnd, other: AttemptEnd) -> AttemptEnd {
    let at = one.at.min(other.at);
    let earliest = (one.at - one.unseen_steps).min(other.at - other.unseen_steps);
    AttemptEnd { at, unseen_steps: at - earliest, is_cut_off: one.is_cut_off || other.is_cut_off }
}

/// The direction of reading a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TimeDirection {
    Forwards,
    Backwards,
}

impl TimeDirection {
    /// An interval in this direction's time; it runs from `first` to `last` again.
    fn turn(self, interval: Interval) -> Interval {
        match self {
            TimeDirection::Forwards => interval,
            TimeDirection::Backwards => Interval { first: -interval.last, last: -interval.first },
        }
    }

    /// Items in this direction's order.
    fn order<T>(self, mut items: Vec<T>) -> Vec<T> {
        if self == TimeDirection::Backwards {
            items.reverse();
        }
        items
    }
}

/// A stretch that shows the tool, in the order of the direction.
struct SeenStretch {
    interval: Interval,
    tips: Vec<Point3<f64>>,
    speeds_mm_s: Vec<f64>,
}

/// A tool's motion, read in one direction of time. Read backwards, its end is its beginning.
struct TimeView<'a> {
    seen: Vec<SeenStretch>,
    movements: Vec<Interval>,
    out_of_picture: Vec<Interval>,
    recording_begin: i64,
    is_trimmed: bool,
    settings: &'a FeatureSettings,
}

impl<'a> TimeView<'a> {
    fn new(
        motion: &Motion,
        absences: Option<&[ExplainedAbsence]>,
        recording: RecordingEnds,
        direction: TimeDirection,
        settings: &'a FeatureSettings,
    ) -> Self {
        let stretch = |span: &super::motion::Span| SeenStretch {
            interval: direction.turn(span.interval()),
            tips: direction.order(span.nodes.iter().map(|node| node.position).collect()),
            speeds_mm_s: direction.order(span.speeds()),
        };
        let moving = movements(motion, settings).iter().map(|movement| direction.turn(movement.interval()));
        let left = absences.into_iter().flatten().filter(|absent| absent.cause == UnseenCause::LeftView);
        Self {
            seen: direction.order(motion.spans.iter().map(stretch).collect()),
            movements: direction.order(moving.collect()),
            out_of_picture: left.map(|absent| direction.turn(absent.interval)).collect(),
            recording_begin: direction.turn(recording.interval).first,
            is_trimmed: recording.is_trimmed[usize::from(direction == TimeDirection::Backwards)],
            settings,
        }
    }

    /// The beginning of the attempt; `None` if the tool did not move.
    fn first_end(&self) -> Option<AttemptEnd> {
        let (number, start) = self.first_start()?;
        let stretch = &self.seen[number];
        let moves_at_first_sight = start == stretch.interval.first && self.moves_at(stretch, start);
        let unseen_from = self.unseen_from(number);
        match () {
            _ if number == 0 && self.enters(stretch) => Some(known(stretch.interval.first)),
            _ if unseen_from.is_none() => {
                Some(AttemptEnd { is_cut_off: moves_at_first_sight && !self.is_trimmed, ..known(start) })
            }
            _ if moves_at_first_sight || self.can_hide_movement(number) => {
                let unseen_steps = start - unseen_from.unwrap_or(start);
                Some(AttemptEnd { unseen_steps, ..known(start) })
            }
            _ => Some(known(start)),
        }
    }

    /// The number of the first stretch with a movement of the tool, and the instant of its start. A tool that is found
    /// elsewhere after a time out of sight has moved.
    fn first_start(&self) -> Option<(usize, i64)> {
        let moving = self.movements.iter().find_map(|movement| {
            let number = self.seen.iter().position(|seen| seen.interval.last >= movement.last)?;
            self.leads_away(&self.seen[number], *movement).then_some((number, *movement))
        });
        let jumped = self.seen.windows(2).position(|pair| is_elsewhere(&pair[0], &pair[1])).map(|before| before + 1);
        match (moving, jumped) {
            (moving, Some(jumped)) if moving.is_none_or(|(number, _)| number >= jumped) => {
                Some((jumped, self.seen[jumped].interval.first))
            }
            (Some((number, movement)), _) => Some((number, movement.first)),
            (None, _) => None,
        }
    }

    /// True if the movement takes the tip far enough away.
    fn leads_away(&self, seen: &SeenStretch, movement: Interval) -> bool {
        let tips = &seen.tips[index(seen, movement.first)..=index(seen, movement.last)];
        tips.iter().any(|tip| (tip - tips[0]).norm() >= MIN_TRAVEL_MM)
    }

    fn moves_at(&self, seen: &SeenStretch, instant: i64) -> bool {
        is_fast(seen.speeds_mm_s[index(seen, instant)], self.settings)
    }

    /// True if the tool was out of the picture as the recording began, and came into it with this stretch.
    fn enters(&self, seen: &SeenStretch) -> bool {
        let before = seen.interval.first - 1;
        self.is_late(seen) && self.out_of_picture.iter().any(|gone| (gone.first..=gone.last).contains(&before))
    }

    fn is_late(&self, seen: &SeenStretch) -> bool {
        (seen.interval.first - self.recording_begin) as f64 * self.settings.step_s > PRESENT_S
    }

    /// When the time out of sight before a stretch began; `None` if the recording begins with the stretch.
    fn unseen_from(&self, number: usize) -> Option<i64> {
        match number.checked_sub(1) {
            Some(before) => Some(self.seen[before].interval.last),
            None => self.is_late(&self.seen[0]).then_some(self.recording_begin),
        }
    }

    /// True if the tool may have moved and rested again before it was first seen.
    fn can_hide_movement(&self, number: usize) -> bool {
        let unseen = self.seen[0].interval.first - self.recording_begin;
        number == 0 && unseen as f64 * self.settings.step_s > HIDDEN_MOVEMENT_S
            || number > 0 && is_elsewhere(&self.seen[number - 1], &self.seen[number])
    }
}

/// An end that was in sight.
fn known(at: i64) -> AttemptEnd {
    AttemptEnd { at, unseen_steps: 0, is_cut_off: false }
}

/// True if a tool has another position after a time out of sight.
fn is_elsewhere(before: &SeenStretch, after: &SeenStretch) -> bool {
    let ends = before.tips.last().zip(after.tips.first());
    ends.is_some_and(|(from, to)| (to - from).norm() >= 2.0 * MIN_TRAVEL_MM)
}

fn index(seen: &SeenStretch, instant: i64) -> usize {
    usize::try_from(instant - seen.interval.first).unwrap_or(0).min(seen.tips.len() - 1)
}
