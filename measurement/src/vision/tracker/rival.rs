//! Rivals: an object of the tape's colour may have been taken for the tool. While no trocar confirms the followed band,
//! every eighth frame is searched for another band, and both are compared: by the shaft behind the tape, and by motion.
//! Not for two tools of one colour.

use super::footprint::Footprint;
use super::frame_context::FrameContext;
use super::measurement::Measurement;
use super::predict::Prediction;
use super::tool::ToolTracker;
use crate::vision::pose::adjustment::Adjustment;

/// Frames from one search to the next: a search of the whole picture costs several times a followed frame.
const SEARCH_INTERVAL_FRAMES: u64 = 8;

/// How much likelier a rival must be: half of what a shaft behind the band adds.
const MIN_LEAD: f64 = 0.5;

/// A band that is this far from where it was first seen has moved, pixels: several times the error of a measured band.
const MOVED_PX: f64 = 6.0;

/// What the searches have shown of the followed band and of its rival.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rivalry {
    /// Time of the last search, s.
    searched_s: f64,
    followed: Option<Sighting>,
    rival: Option<Sighting>,
}

/// A band at successive searches.
#[derive(Clone, Copy, Debug)]
struct Sighting {
    first: Footprint,
    last: Footprint,
    has_moved: bool,
    /// It was in the same place at two searches at least.
    rests: bool,
    /// It was clearly a tool's band at one search at least: later, it may be half hidden.
    was_clear: bool,
}

impl Sighting {
    /// The sighting with the band at its next place, or a new one.
    fn continued(earlier: Option<Self>, at: Footprint, is_clear: bool) -> Self {
        match earlier {
            Some(Self { first, has_moved, was_clear, .. }) => {
                let has_moved = has_moved || first.distance_px(&at) > MOVED_PX;
                Self { first, last: at, has_moved, rests: !has_moved, was_clear: was_clear || is_clear }
            }
            None => Self { first: at, last: at, has_moved: false, rests: false, was_clear: is_clear },
        }
    }
}

impl Rivalry {
    /// The sighting of the followed band at its next place. A fast tool is far from its last one: while its track is
    /// unbroken, it is the same band.
    fn followed_at(&self, at: Footprint, is_clear: bool, is_unbroken: bool) -> Sighting {
        Sighting::continued(self.followed.filter(|_| is_unbroken), at, is_clear)
    }
}

impl ToolTracker {
    /// A band elsewhere in the picture that is the tool's, if the followed one is not. It is searched for as if the tool
    /// had never been seen.
    pub(super) fn find_rival(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        followed: &Measurement,
    ) -> Option<Measurement> {
        let is_confirmed = self.adjustment.as_ref().is_some_and(Adjustment::is_right_way_round);
        if is_confirmed || !scene.frame.index.is_multiple_of(SEARCH_INTERVAL_FRAMES) {
            return None;
        }
        let followed = self.with_continuation(scene, prediction, followed.clone());
        let at = Footprint::of(&followed, scene.camera())?;
        let is_unbroken =
            self.track.is_followed_since(self.rivalry.searched_s) && self.continues_track(scene, &followed);
        let of_followed = self.rivalry.followed_at(at, followed.is_clear(), is_unbroken);
        let rival_before = self.rivalry.rival;
        self.rivalry = Rivalry { searched_s: scene.frame.time_s, followed: Some(of_followed), rival: None };
        if followed.is_clear() && of_followed.has_moved {
            return None;
        }
        let rival = self.fresh().find_and_measure(scene, &Prediction::default(), Some(&at)).ok()?;
        let at = Footprint::of(&rival, scene.camera())?;
        let rival_before = rival_before.filter(|earlier| earlier.last.is_same_band(&at));
        let of_rival = Sighting::continued(rival_before, at, rival.is_clear());
        self.rivalry.rival = Some(of_rival);
        let is_likelier = !of_followed.was_clear && rival.likelihood() > followed.likelihood() + MIN_LEAD;
        let is_the_resting_one = of_rival.rests && of_followed.has_moved;
        let is_the_moving_one = of_followed.rests && of_rival.has_moved && rival.is_clear();
        ((is_likelier && !is_the_resting_one) || is_the_moving_one).then_some(rival)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;

    #[test]
    fn a_band_that_was_clear_once_stays_so_however_far_it_moves_until_its_track_breaks() {
        let [here, far] = [100.0, 300.0].map(|x| Footprint::lying_at(Point2::new(x, 100.0)));
        let rivalry = Rivalry { followed: Some(Sighting::continued(None, here, true)), ..Rivalry::default() };
        let unbroken = rivalry.followed_at(far, false, true);
        assert!(unbroken.was_clear && unbroken.has_moved, "{unbroken:?}");
        let broken = rivalry.followed_at(far, false, false);
        assert!(!broken.was_clear && !broken.has_moved, "{broken:?}");
    }
}
