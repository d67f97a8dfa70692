//! Learns the box that bare tools are found against: of a recording at once, or of a feed from its frames so far.

use super::scene_samples::SceneSamples;
use super::settings::{ToolSpec, TrackerSettings};
use crate::vision::camera::Camera;
use crate::vision::frame::ColourEncoding;
use crate::vision::segmentation::shaft_colour::ShaftColour;
use crate::vision::strip::finder::{BareTool, StripFinder};

/// A tool must have turned about its trocar by this sine, root mean square, before a part of a feed shows the
/// trocar: twice the error of a strip's direction. Otherwise the point could be where a tool at rest crosses another
/// line. Tools of simulated tasks turn by 0.02 to 0.1 in 8 s.
const MIN_TURN: f64 = 0.02;

/// Learns a box for the bare tools of a tracker. A copy can learn on another thread while the tracker follows the
/// tools.
#[derive(Clone)]
pub struct BoxLearner {
    camera: Camera,
    shaft: ShaftColour,
    tools: Vec<BareTool>,
}

impl BoxLearner {
    /// For frames of this encoding; `None` without bare tools.
    pub(super) fn new(settings: &TrackerSettings, encoding: ColourEncoding) -> Option<Self> {
        let bare: Vec<&ToolSpec> = settings.tools.iter().filter(|tool| tool.is_bare()).collect();
        let is_bare = |label: &&String| bare.iter().any(|tool| tool.colour == **label);
        let labels = settings.samples.labels.iter().filter(is_bare);
        let pixels: Vec<[u8; 3]> = labels.flat_map(|label| settings.samples.codes_of_label(label, encoding)).collect();
        let tools = bare.iter().map(|tool| BareTool { side: tool.side, diameter_mm: tool.diameter_mm }).collect();
        Some(Self { camera: settings.camera, shaft: ShaftColour::new(&pixels)?, tools })
    }

    /// The box alone, without trocars; `None` without frames. Takes no longer than a frame or two.
    pub fn learn_box(&self, scene: &SceneSamples) -> Option<StripFinder> {
        let SceneSamples { frames, empty, .. } = scene;
        StripFinder::learn(&self.camera, self.shaft.clone(), &self.tools, frames, empty.as_ref())
    }

    /// The box and the trocars that its frames so far show; `None` without frames. Takes seconds.
    pub fn learn_so_far(&self, scene: &SceneSamples) -> Option<StripFinder> {
        self.learn_with_trocars(scene, MIN_TURN)
    }

    /// The box and the trocars that a whole recording shows.
    pub(super) fn learn_whole(&self, scene: &SceneSamples) -> Option<StripFinder> {
        self.learn_with_trocars(scene, 0.0)
    }

    fn learn_with_trocars(&self, scene: &SceneSamples, min_turn: f64) -> Option<StripFinder> {
        let mut finder = self.learn_box(scene)?;
        finder.find_trocars(&scene.frames, min_turn);
        Some(finder)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{ENCODING, EvenPicture, SIZE, two_bare_tools};
    use super::super::{Marker, Tracker};
    use super::*;
    use crate::vision::strip::finder::SearchTurn;

    fn tracker(settings: TrackerSettings) -> Tracker {
        Tracker::new(settings, SIZE.0, SIZE.1, ENCODING).unwrap()
    }

    #[test]
    fn a_box_is_learned_from_frames_and_only_for_bare_tools() {
        let learner = tracker(two_bare_tools()).box_learner().unwrap();
        let mut scene = SceneSamples::default();
        assert!(learner.learn_box(&scene).is_none(), "without a frame");
        scene.add(&EvenPicture::of_box().frame(0.0));
        assert!(learner.learn_box(&scene).is_some() && learner.learn_so_far(&scene).is_some());
        let mut taped = two_bare_tools();
        taped.tools.truncate(1);
        taped.tools[0].marker = Marker::Band { length_mm: None };
        assert!(tracker(taped).box_learner().is_none());
    }

    #[test]
    fn tools_of_a_feed_take_turns_until_their_trocars_are_known() {
        let mut tracker = tracker(two_bare_tools());
        assert_eq!(tracker.next_search_turn(), SearchTurn::All, "a recording waits");
        let mut scene = SceneSamples::default();
        scene.add(&EvenPicture::of_box().frame(0.0));
        let learned = tracker.box_learner().unwrap().learn_box(&scene).unwrap();
        tracker.know_feed_box(learned.clone());
        let turns: Vec<SearchTurn> = (0..17).map(|_| tracker.next_search_turn()).collect();
        assert_eq!([turns[0], turns[8], turns[16]], [SearchTurn::One(0), SearchTurn::One(1), SearchTurn::One(0)]);
        assert_eq!(turns.iter().filter(|turn| **turn == SearchTurn::None).count(), 14);
        tracker.know_feed_box(learned);
        assert_eq!(tracker.next_search_turn(), SearchTurn::None, "the turns do not start over");
    }
}
