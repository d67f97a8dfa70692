//! The direction to the hand that holds a tool. It decides which end of a band is the tip.
//!
//! A single frame may be wrong, for example if another tool's shaft or a dark shape lies beyond the tip. So each frame
//! votes, and the votes are added up. Once the axes show the trocar, voting stops: it lies behind the tip. A band
//! taken the wrong way round would be tracked just as smoothly, but one tape length off.

use nalgebra::Vector2;

/// Sum of the frames' votes: a vector in the picture from the band to the hand; its length is the certainty.
#[derive(Clone, Copy, Debug, Default)]
pub struct HandDirection {
    votes: Vector2<f64>,
    /// The axes have shown the direction: votes do not change it.
    is_shown_by_axes: bool,
}

/// Minimum contrast for a vote: below it, both ends look alike.
const MIN_CONTRAST: f64 = 0.15;

/// Factor on earlier votes with each new vote: a person may walk round the box.
const VOTE_DECAY: f64 = 0.98;

/// Sum of contrasts needed to use a direction, and to overrule the direction in use.
const DECISIVE_VOTES: f64 = 2.5;

impl HandDirection {
    /// Adds a frame's vote: `contrast` (−1 to 1) is how much more of a shaft there is beyond the end in direction
    /// `to_hand` than beyond the other.
    pub fn add_vote(&mut self, to_hand: Vector2<f64>, contrast: f64) {
        if let Some(direction) = to_hand.try_normalize(1e-9)
            && contrast.abs() >= MIN_CONTRAST
            && !self.is_shown_by_axes
        {
            self.votes = self.votes * VOTE_DECAY + direction * contrast;
        }
    }

    /// Sets the opposite direction, because the axes show that the hand is there. Votes no longer change it: open jaws
    /// can look like a shaft on all frames, and a shaft can look like the mat.
    pub fn set_opposite(&mut self, to_hand: Vector2<f64>) {
        let opposite = to_hand.try_normalize(1e-9).map(|direction| -direction * (2.0 * DECISIVE_VOTES));
        *self = Self { votes: opposite.unwrap_or_default(), is_shown_by_axes: opposite.is_some() };
    }

    /// Direction from the band to the hand, if many frames agree.
    pub fn direction(&self) -> Option<Vector2<f64>> {
        (self.votes.norm() >= DECISIVE_VOTES).then_some(self.votes)
    }

    /// Do the votes clearly contradict this direction?
    pub fn contradicts(&self, to_hand: Vector2<f64>) -> bool {
        to_hand.try_normalize(1e-9).is_some_and(|direction| self.votes.dot(&direction) < -DECISIVE_VOTES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_frame_does_not_turn_a_tool_and_many_right_ones_do() {
        let (left, right) = (-Vector2::x(), Vector2::x());
        let mut hand = HandDirection::default();
        assert!(hand.direction().is_none() && !hand.contradicts(left));
        hand.add_vote(right, 0.6); // a shaft that crosses beyond the tip
        assert!(hand.direction().is_none(), "one frame decides nothing");
        for _ in 0..3 {
            hand.add_vote(right, -0.6);
            assert!(!hand.contradicts(right));
        }
        for _ in 0..8 {
            hand.add_vote(right, -0.5);
        }
        assert!(hand.contradicts(right) && !hand.contradicts(left));
        assert!(hand.direction().unwrap().dot(&left) > 0.0);
    }

    #[test]
    fn frames_with_similar_ends_do_not_vote() {
        let mut hand = HandDirection::default();
        (0..100).for_each(|_| hand.add_vote(Vector2::x(), 0.1));
        assert!(hand.direction().is_none());
        hand.set_opposite(Vector2::x());
        assert!(hand.direction().unwrap().x < 0.0);
    }

    #[test]
    fn an_opposite_direction_holds_at_every_angle() {
        for degrees in 0..360 {
            let angle = f64::from(degrees).to_radians();
            let to_hand = Vector2::new(angle.cos(), angle.sin());
            let mut hand = HandDirection::default();
            hand.set_opposite(to_hand);
            assert!(hand.contradicts(to_hand), "{degrees}");
            (0..100).for_each(|_| hand.add_vote(to_hand, 0.6));
            assert!(hand.direction().is_some_and(|known| known.dot(&to_hand) < 0.0), "votes do not overrule axes");
        }
    }
}
