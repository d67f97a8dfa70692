//! Which object of a frame is which tool: tracks of objects in the picture, each with a Kalman filter.
//!
//! An object of a frame continues the track whose prediction it agrees with best, or starts a new one. A track is
//! believed after [`MIN_CONFIRMATIONS`] frames have confirmed it without interruption. It then gets the name of a tool
//! by the half of the picture where it was seen first, and keeps it until the track ends. A tool that was lost is named
//! anew in the same way: the systems know nothing else of it.

use super::pair_filter::{CoordinatePair, PairNoise, PairState};
use crate::vision::frame::Frame;

/// Frames that have to confirm a new track.
const MIN_CONFIRMATIONS: u32 = 3;

/// Largest squared Mahalanobis distance of an object from the prediction of its track: two degrees of freedom, 99.9 %.
const GATE: f64 = 13.8;

/// A track ends if its object is not seen for longer than this, s.
const MAX_UNSEEN_S: f64 = 0.2;

/// Maximum number of objects of one frame; the largest ones are used.
const MAX_OBJECTS: usize = 16;

/// A half of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PictureHalf {
    Left,
    Right,
}

impl PictureHalf {
    /// The half that this column is in.
    pub(super) fn of(column_px: f64, frame: &Frame<'_>) -> Self {
        if column_px < 0.5 * frame.width() as f64 { Self::Left } else { Self::Right }
    }
}

/// One object of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenObject {
    /// Its measured coordinates.
    pub(super) pair: CoordinatePair,
    /// The half of the picture that its middle is in.
    pub(super) half: PictureHalf,
}

/// The object that a tool is on a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FollowedObject {
    /// Position in the frame's list of objects.
    pub(super) object: usize,
    /// Its filtered coordinates.
    pub(super) pair: CoordinatePair,
}

#[derive(Clone, Copy, Debug)]
struct ObjectTrack {
    state: PairState,
    last_seen_s: f64,
    /// Frames that confirmed it.
    confirmations: u32,
    /// The half of the picture where it was seen first.
    first_half: PictureHalf,
    tool: Option<usize>,
    /// Its object on the current frame.
    object: Option<usize>,
}

/// All objects that are followed.
pub(super) struct ObjectTracks {
    noise: PairNoise,
    /// The representation of a measured pair that is nearest to a predicted one. A line has two.
    nearest_form: fn(CoordinatePair, CoordinatePair) -> CoordinatePair,
    tools: usize,
    tracks: Vec<ObjectTrack>,
    time_s: f64,
}

impl ObjectTracks {
    /// For this number of tools. Of two, the first is the one on the left.
    pub(super) fn new(
        tools: usize,
        noise: PairNoise,
        nearest_form: fn(CoordinatePair, CoordinatePair) -> CoordinatePair,
    ) -> Self {
        Self { noise, nearest_form, tools, tracks: Vec::new(), time_s: 0.0 }
    }

    /// Follows the objects of the next frame, which are in descending order of size. Returns the object of each tool.
    pub(super) fn advance(&mut self, time_s: f64, objects: &[SeenObject]) -> Vec<Option<FollowedObject>> {
        let objects = &objects[..objects.len().min(MAX_OBJECTS)];
        let dt_s = (time_s - self.time_s).max(0.0);
        self.time_s = time_s;
        for track in &mut self.tracks {
            track.state = track.state.predicted(dt_s, &self.noise);
            track.object = None;
        }
        let unused = self.assign(objects);
        self.tracks.retain(|track| {
            let is_believed = track.confirmations >= MIN_CONFIRMATIONS;
            track.object.is_some() || is_believed && time_s - track.last_seen_s <= MAX_UNSEEN_S
        });
        self.name_tracks();
        self.tracks.extend(unused.into_iter().map(|object| ObjectTrack {
            state: PairState::first_seen(objects[object].pair, &self.noise),
            last_seen_s: time_s,
            confirmations: 0,
            first_half: objects[object].half,
            tool: None,
            object: Some(object),
        }));
        (0..self.tools).map(|tool| self.object_of(tool)).collect()
    }

    /// Assigns objects to tracks, the pair that agrees best first. Returns the objects that continue no track.
    fn assign(&mut self, objects: &[SeenObject]) -> Vec<usize> {
        let mut possible: Vec<(f64, usize, usize, CoordinatePair)> = Vec::new();
        for (of, track) in self.tracks.iter().enumerate() {
            for (object, seen) in objects.iter().enumerate() {
                let pair = (self.nearest_form)(seen.pair, track.state.pair());
                let squared = track.state.distance_squared(pair, &self.noise);
                if squared <= GATE {
                    possible.push((squared, of, object, pair));
                }
            }
        }
        possible.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut is_used = vec![false; objects.len()];
        for (_, of, object, pair) in possible {
            let track = &mut self.tracks[of];
            if track.object.is_none() && !is_used[object] {
                is_used[object] = true;
                track.state = track.state.updated(pair, &self.noise);
                track.object = Some(object);
                track.last_seen_s = self.time_s;
                track.confirmations += 1;
            }
        }
        (0..objects.len()).filter(|object| !is_used[*object]).collect()
    }

    /// Gives names to the believed tracks that have none, the largest object first.
    fn name_tracks(&mut self) {
        let is_new = |track: &ObjectTrack| track.tool.is_none() && track.confirmations >= MIN_CONFIRMATIONS;
        let unnamed = self.tracks.iter().enumerate().filter(|(_, track)| is_new(track));
        let mut unnamed: Vec<(usize, usize)> =
            unnamed.filter_map(|(of, track)| track.object.map(|object| (object, of))).collect();
        unnamed.sort_unstable();
        for (_, of) in unnamed {
            let is_second = self.tools > 1 && self.tracks[of].first_half == PictureHalf::Right;
            let tool = usize::from(is_second);
            let is_taken = self.tracks.iter().any(|track| track.tool == Some(tool));
            self.tracks[of].tool = Some(tool).filter(|_| !is_taken);
        }
    }

    fn object_of(&self, tool: usize) -> Option<FollowedObject> {
        let track = self.tracks.iter().find(|track| track.tool == Some(tool))?;
        Some(FollowedObject { object: track.object?, pair: track.state.pair() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: PairNoise = PairNoise { acceleration_density: [100.0; 2], sigma: [3.0; 2], first_speed: [150.0; 2] };
    const FRAME_S: f64 = 0.04;

    fn tracks(tools: usize) -> ObjectTracks {
        ObjectTracks::new(tools, NOISE, |seen, _| seen)
    }

    fn seen(u: f64, v: f64) -> SeenObject {
        let half = if u < 160.0 { PictureHalf::Left } else { PictureHalf::Right };
        SeenObject { pair: [u, v], half }
    }

    fn objects(followed: &[Option<FollowedObject>]) -> Vec<Option<usize>> {
        followed.iter().map(|of| of.map(|of| of.object)).collect()
    }

    #[test]
    fn an_object_is_believed_when_three_frames_have_confirmed_it() {
        let mut tracks = tracks(1);
        let at = |frame: u32| seen(50.0 + f64::from(frame), 80.0);
        let found: Vec<bool> =
            (0..5).map(|frame| tracks.advance(f64::from(frame) * FRAME_S, &[at(frame)])[0].is_some()).collect();
        assert_eq!(found, [false, false, false, true, true]);
        assert_eq!(objects(&tracks.advance(0.2, &[])), [None], "not seen, not reported");
        assert_eq!(objects(&tracks.advance(0.24, &[at(6)])), [Some(0)], "and known again");
    }

    #[test]
    fn a_flash_of_one_frame_is_never_a_tool() {
        let mut tracks = tracks(1);
        for frame in 0..40 {
            let flash = [seen(100.0, 80.0)];
            let found = tracks.advance(f64::from(frame) * FRAME_S, if frame % 2 == 0 { &flash } else { &[] });
            assert_eq!(objects(&found), [None]);
        }
    }

    #[test]
    fn two_tools_keep_their_names_while_they_cross() {
        let mut tracks = tracks(2);
        for frame in 0..60 {
            let moved = 4.0 * f64::from(frame);
            let [left, right] = [seen(40.0 + moved, 90.0), seen(280.0 - moved, 120.0)];
            let is_swapped = frame % 3 == 0; // the order of the objects says nothing
            let objects_seen = if is_swapped { [right, left] } else { [left, right] };
            let found = objects(&tracks.advance(f64::from(frame) * FRAME_S, &objects_seen));
            let expected = if is_swapped { [Some(1), Some(0)] } else { [Some(0), Some(1)] };
            assert_eq!(found, if frame < 3 { [None; 2] } else { expected }, "frame {frame}");
        }
    }

    #[test]
    fn a_second_object_on_the_same_side_has_no_name() {
        let mut tracks = tracks(2);
        let both = [seen(40.0, 40.0), seen(60.0, 200.0)];
        let found: Vec<_> = (0..6).map(|frame| objects(&tracks.advance(f64::from(frame) * FRAME_S, &both))).collect();
        assert_eq!(found[5], [Some(0), None]);
    }
}
