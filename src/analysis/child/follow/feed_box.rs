//! Learns the box of bare tools while its feed is tracked.
//!
//! **In** the frames of the feed, and the picture of the empty box if there is one. **Out** what is known of the box so
//! far, for [`Tracker::know_feed_box`]. **Method** With a picture of the empty box, the first frame is enough to know
//! the box, without trocars. Lessons follow, each from frames that are spread over the feed so far. A lesson takes
//! seconds, so it has a thread of its own, and the feed's frames do not wait for it. Memory does not grow with the
//! feed.
//!
//! [`Tracker::know_feed_box`]: crate::vision::tracker::Tracker::know_feed_box

use std::panic::resume_unwind;
use std::thread::{Builder, JoinHandle};

use crate::vision::frame::Frame;
use crate::vision::strip::finder::StripFinder;
use crate::vision::tracker::{BoxLearner, SceneSamples};

/// Interval between the frames that are kept, s: those before the first lesson are then about as many as it searches
/// for trocars. Of a longer feed fewer are kept, see [`SceneSamples::add`].
const SAMPLE_INTERVAL_S: f64 = 0.1;

/// Time of the first lesson since the first frame, s.
const FIRST_LESSON_S: f64 = 2.0;

/// Each further lesson is this many times as late as the one before: after 8, 32 and 128 s, and so on. Hands move more
/// in a longer time, and a tool may enter late.
const LESSON_RATIO: f64 = 4.0;

/// What is known of a feed's box, and the lesson that is being learned.
pub(super) struct FeedBox {
    learner: BoxLearner,
    scene: SceneSamples,
    has_empty_picture: bool,
    begins_s: Option<f64>,
    /// Times since the first frame of the next kept frame and of the next lesson, s.
    next_sample_s: f64,
    next_lesson_s: f64,
    lesson: Option<JoinHandle<Option<StripFinder>>>,
    has_learned: bool,
}

impl FeedBox {
    /// Of a feed that begins. `scene` has no frame, and the picture of the empty box if there is one.
    pub(super) fn new(learner: BoxLearner, scene: SceneSamples) -> Self {
        Self {
            learner,
            has_empty_picture: scene.has_empty(),
            scene,
            begins_s: None,
            next_sample_s: 0.0,
            next_lesson_s: FIRST_LESSON_S,
            lesson: None,
            has_learned: false,
        }
    }

    /// Takes the next frame; returns what is known of the box if that changes on it.
    pub(super) fn add_frame(&mut self, frame: &Frame<'_>) -> Option<StripFinder> {
        let is_first = self.begins_s.is_none();
        let time_s = frame.time_s - *self.begins_s.get_or_insert(frame.time_s);
        if time_s >= self.next_sample_s {
            self.next_sample_s = time_s + SAMPLE_INTERVAL_S;
            self.scene.add(frame);
        }
        if is_first && self.has_empty_picture {
            return self.learner.learn_box(&self.scene);
        }
        if let Some(lesson) = self.lesson.take_if(|lesson| lesson.is_finished()) {
            return self.end_lesson(lesson);
        }
        if self.lesson.is_none() && time_s >= self.next_lesson_s {
            while time_s >= self.next_lesson_s {
                self.next_lesson_s *= LESSON_RATIO;
            }
            self.begin_lesson();
        }
        None
    }

    /// Is the box still being learned? Until then, bare tools may be found late.
    pub(super) fn is_learning(&self) -> bool {
        !self.has_learned
    }

    /// Begins a lesson. Without memory for a thread it is left out, and the next one is tried.
    fn begin_lesson(&mut self) {
        let (learner, scene) = (self.learner.clone(), self.scene.clone());
        let thread = Builder::new().name("box lesson".into());
        self.lesson = thread.spawn(move || learner.learn_so_far(&scene)).ok();
    }

    fn end_lesson(&mut self, lesson: JoinHandle<Option<StripFinder>>) -> Option<StripFinder> {
        let learned = lesson.join().unwrap_or_else(|panic| resume_unwind(panic));
        self.has_learned |= learned.is_some();
        learned
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::small_box::{ENCODING, EvenPicture, SIZE, two_bare_tools};
    use crate::vision::tracker::Tracker;

    fn feed_box(scene: SceneSamples) -> FeedBox {
        let tracker = Tracker::new(two_bare_tools(), SIZE.0, SIZE.1, ENCODING).unwrap();
        FeedBox::new(tracker.box_learner().unwrap(), scene)
    }

    fn wait_for_lesson(of: &FeedBox) {
        while !of.lesson.as_ref().unwrap().is_finished() {
            std::thread::yield_now();
        }
    }

    #[test]
    fn lessons_are_learned_beside_the_feed_and_ever_later() {
        const BEGINS_S: f64 = 5.0;
        let picture = EvenPicture::of_box();
        let mut feed_box = feed_box(SceneSamples::default());
        for frame in 0..50 {
            let time_s = BEGINS_S + 0.04 * f64::from(frame);
            assert!(feed_box.add_frame(&picture.frame(time_s)).is_none() && feed_box.lesson.is_none(), "{time_s} s");
        }
        assert!(feed_box.add_frame(&picture.frame(BEGINS_S + 2.0)).is_none(), "the frame does not wait");
        assert!(feed_box.is_learning());
        wait_for_lesson(&feed_box);
        assert!(feed_box.add_frame(&picture.frame(BEGINS_S + 2.04)).is_some());
        assert_eq!((feed_box.is_learning(), feed_box.next_lesson_s), (false, 8.0));
        assert!(feed_box.add_frame(&picture.frame(BEGINS_S + 100.0)).is_none(), "the first frame after an outage");
        assert!(feed_box.lesson.is_some());
        assert_eq!(feed_box.next_lesson_s, 128.0);
    }

    #[test]
    fn a_picture_of_the_empty_box_is_used_on_the_first_frame() {
        let picture = EvenPicture::of_box();
        let mut scene = SceneSamples::default();
        scene.set_empty(&picture.frame(0.0), ENCODING);
        let mut feed_box = feed_box(scene);
        assert!(feed_box.add_frame(&picture.frame(0.0)).is_some());
        assert!(feed_box.add_frame(&picture.frame(0.04)).is_none());
        assert!(feed_box.is_learning(), "trocars are not known");
    }
}
