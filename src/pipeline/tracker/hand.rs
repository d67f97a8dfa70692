//! Which way the hand is that holds a tool: what decides which end of a band is its tip.
//!
//! One frame may be wrong about it, where another tool's shaft or a dark shape lies beyond the tip: frame after frame is
//! asked, and what they say is added up. A tool that turns shows its trocar, which lies behind the tip; then nobody is asked
//! any more. Taken the wrong way round a band would be followed as well as the right one, one length of tape off.

use nalgebra::Vector2;

/// What frames have said so far: the direction in the picture from band to hand, as long as what was said is sure.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hand {
    towards: Vector2<f64>,
}

/// Least contrast of one frame that says anything: below it, what lies beyond both ends is alike.
const LEAST_CONTRAST: f64 = 0.15;

/// What is left of what was said a frame ago: a hand may walk round the box.
const KEPT: f64 = 0.98;

/// Contrasts that are enough to begin with, and to be believed against what was begun with.
const ENOUGH: f64 = 0.5;
const DECISIVE: f64 = 2.5;

impl Hand {
    /// A frame says by how much it is darker on the hand's side of a band, −1 to 1, if that lies in this direction.
    pub fn hear(&mut self, to_hand: Vector2<f64>, contrast: f64) {
        if let Some(direction) = to_hand.try_normalize(1e-9)
            && contrast.abs() >= LEAST_CONTRAST
        {
            self.towards = self.towards * KEPT + direction * contrast;
        }
    }

    /// It is on the other side, for a better reason.
    pub fn is_opposite(&mut self, to_hand: Vector2<f64>) {
        self.towards = to_hand.try_normalize(1e-9).map_or(Vector2::zeros(), |direction| -direction * DECISIVE);
    }

    /// From the band to the hand, where that is known.
    pub fn direction(&self) -> Option<Vector2<f64>> {
        (self.towards.norm() >= ENOUGH).then_some(self.towards)
    }

    /// Have frames said decidedly that it is not in this direction?
    pub fn contradicts(&self, to_hand: Vector2<f64>) -> bool {
        to_hand.try_normalize(1e-9).is_some_and(|direction| self.towards.dot(&direction) < -DECISIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_frame_does_not_turn_a_tool_and_many_right_ones_do() {
        let (left, right) = (-Vector2::x(), Vector2::x());
        let mut hand = Hand::default();
        assert!(hand.direction().is_none() && !hand.contradicts(left));
        hand.hear(right, 0.6); // a shaft that crosses beyond the tip
        assert!(hand.direction().unwrap().dot(&right) > 0.0);
        for _ in 0..3 {
            hand.hear(right, -0.6);
            assert!(!hand.contradicts(right));
        }
        for _ in 0..8 {
            hand.hear(right, -0.5);
        }
        assert!(hand.contradicts(right) && !hand.contradicts(left));
        assert!(hand.direction().unwrap().dot(&left) > 0.0);
    }

    #[test]
    fn frames_on_which_both_ends_look_alike_say_nothing() {
        let mut hand = Hand::default();
        (0..100).for_each(|_| hand.hear(Vector2::x(), 0.1));
        assert!(hand.direction().is_none());
        hand.is_opposite(Vector2::x());
        assert!(hand.direction().unwrap().x < 0.0);
    }
}
