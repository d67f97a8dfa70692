//! Tracks the tools: processes each frame, and turns a whole recording into paths and quality figures.
//!
//! On each frame every tool goes through the same stages, in the file of that name. Two tools of one colour go through
//! them together ([`pair`]).
//!
//! | stage | question | input → output |
//! |---|---|---|
//! | [`predict`] | where is the band expected, and how fast does it move? | track → expected band |
//! | [`find`] | which regions have the tape's colour? | frame → regions |
//! | [`measure`] | which tube explains the edges in the pixels? | expected band or region → measurement |
//! | [`accept`] | does the measurement agree with the tool's motion? | measurement → track |
//! | [`learn`] | what are edge shape, band length, fulcrum and hand side? | accepted measurement → next frames |
//!
//! The position in mm is computed by [`joint_fit::fit`](crate::vision::pose::joint_fit::fit), which [`measure`] reaches
//! through [`band_fit`] and [`refine`].
//!
//! A band that is measured at its expected place need not be found ([`search`]). Until the trocar is known, every eighth
//! frame is searched for another band ([`rival`]). After the last frame [`second_pass`] processes all measurements again.

mod accept;
mod assignment;
mod band_fit;
mod band_length_estimator;
mod blocks;
mod box_learner;
mod find;
mod footprint;
mod frame_context;
mod frame_report;
mod gaps;
mod hand_direction;
mod learn;
mod light;
mod measure;
mod measurement;
mod motion;
mod origin;
mod pair;
mod pair_reassignment;
mod predict;
mod probe_pass;
mod record;
mod refine;
mod report;
mod rival;
mod scene_samples;
mod search;
mod second_look;
mod second_pass;
mod settings;
mod shaft_fit;
mod shaft_line;
mod shaft_search;
mod starts;
mod tape_cover;
#[cfg(test)]
pub(crate) mod testing;
mod tool;
mod trace;
mod width_method;

pub use box_learner::BoxLearner;
pub use report::{
    Absence, DiameterBasis, EffectiveDiameter, FrameReport, Gap, LightSample, Observation, Quality, ToolQuality,
    ToolReport, Tracking, TrocarEvidence,
};
pub use scene_samples::{SCENE_FRAMES, SceneSamples};
pub use second_look::{FirstLook, SecondLook};
pub use settings::{
    CameraView, HandSide, Marker, MotionSettings, PoseMethod, SettingsProblem, ToolSpec, TrackerSettings,
};
pub use trace::{FitTrace, FrameTrace, ProbePassTrace, ToolTrace};

use crate::vision::edges::edge_model::{EdgeModel, Likeness};
use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::segmentation::colour_table::ColourTable;
use crate::vision::segmentation::knn::Knn;
use crate::vision::segmentation::palette::{self, ColourSeparation};
use crate::vision::strip::finder::{FrameStrips, SearchTurn, StripFinder};
use crate::vision::surroundings::ViewWatch;
use crate::vision::trajectory::Sample;
use crate::vision::tube::Outline;
use accept::ToolFrameResult;
use frame_context::FrameContext;
use light::LightWatch;
use motion::FrameInstant;
use record::PackedRecords;
use shaft_search::ShaftSearch;
use tool::ToolTracker;

/// Number of frames for [`Tracker::warm_up`]: enough edges to learn their appearance, and enough views to learn a
/// band's length.
pub const MAX_WARM_UP_FRAMES: usize = 12;

/// Frames of a feed between two searches for bare tools without a known trocar. A search takes 0.1 s, and no frame may
/// wait for two.
const FEED_SEARCH_FRAMES: usize = 8;

/// Follows the tools through a recording or a live feed, frame by frame.
pub struct Tracker {
    settings: TrackerSettings,
    table: ColourTable,
    encoding: ColourEncoding,
    /// Finds bare shafts, once the box is known.
    strips: Option<StripFinder>,
    /// Of a feed, the frames since its box is known.
    feed_frames: Option<usize>,
    tools: Vec<ToolTracker>,
    /// Pairs of tools that share a colour; the left hand's tool comes first.
    pairs: Vec<[usize; 2]>,
    instants: Vec<FrameInstant>,
    light: LightWatch,
    /// Of a recording: only its result states whether the camera moved.
    view: Option<ViewWatch>,
    /// The last known position of each tool.
    last_samples: Vec<Option<Sample>>,
}

impl Tracker {
    /// Creates a tracker for a recording with frames of this size and encoding.
    ///
    /// # Errors
    /// [`SettingsProblem`] if the settings cannot work.
    pub fn new(
        settings: TrackerSettings,
        width: u32,
        height: u32,
        encoding: ColourEncoding,
    ) -> Result<Self, SettingsProblem> {
        settings.check(width, height)?;
        let classes = settings.classes();
        let knn = Knn::new(&settings.samples, &classes).ok_or(SettingsProblem::NoBackground)?;
        let table = ColourTable::new(knn, encoding);
        let bare: Vec<usize> = (0..settings.tools.len()).filter(|i| settings.tools[*i].is_bare()).collect();
        let tools = settings.tools.iter().enumerate().map(|(i, spec)| {
            let tape = settings.samples.usual_colour(&spec.colour, encoding);
            let likeness = if spec.is_bare() { Likeness::AllPlanes } else { Likeness::Chroma };
            let place = bare.iter().position(|of| *of == i);
            let edges = EdgeModel::new(tape, likeness, encoding);
            ToolTracker::new(spec.clone(), settings.class_of(&spec.colour), place, edges)
        });
        let (tools, pairs) = (tools.collect(), settings.pairs());
        let last = vec![None; settings.tools.len()];
        let view = Some(ViewWatch::new(settings.camera.fx));
        Ok(Self {
            tools,
            pairs,
            table,
            encoding,
            strips: None,
            feed_frames: None,
            settings,
            instants: Vec::new(),
            light: LightWatch::default(),
            view,
            last_samples: last,
        })
    }

    /// Creates a tracker for a live feed: like [`Self::new`], but it does not watch for movements of the camera.
    ///
    /// # Errors
    /// [`SettingsProblem`] if the settings cannot work.
    pub fn for_feed(
        settings: TrackerSettings,
        width: u32,
        height: u32,
        encoding: ColourEncoding,
    ) -> Result<Self, SettingsProblem> {
        Ok(Self { view: None, ..Self::new(settings, width, height, encoding)? })
    }

    /// Learns the box without tools, and the trocars of bare tools, from frames spread over the recording. Needed to
    /// find tools without tape; call it before [`Tracker::warm_up`]. Nothing happens without such tools.
    pub fn learn_scene(&mut self, scene: &SceneSamples) {
        self.strips = self.box_learner().and_then(|learner| learner.learn_whole(scene));
    }

    /// Learns the box of a feed, which cannot show its future: pass the result to [`Self::know_feed_box`]. `None`
    /// without bare tools.
    pub fn box_learner(&self) -> Option<BoxLearner> {
        BoxLearner::new(&self.settings, self.encoding)
    }

    /// Takes what was learned of a feed's box so far, first or in place of what was known. Trocars that it lacks stay
    /// known. Tools that are followed remain followed, and the others are searched for at once.
    pub fn know_feed_box(&mut self, mut learned: StripFinder) {
        if let Some(known) = &self.strips {
            learned.keep_trocars_of(known);
        }
        self.strips = Some(learned);
        self.feed_frames.get_or_insert(0);
        self.tools.iter_mut().for_each(|tool| tool.shaft_search = ShaftSearch::default());
    }

    /// The bare tool without a known trocar that the next frame may be searched for.
    fn next_search_turn(&mut self) -> SearchTurn {
        let Some(frames) = &mut self.feed_frames else { return SearchTurn::All };
        let (number, bare) = (*frames, self.tools.iter().filter(|tool| tool.bare.is_some()).count());
        *frames += 1;
        let is_search = number.is_multiple_of(FEED_SEARCH_FRAMES);
        if is_search { SearchTurn::One(number / FEED_SEARCH_FRAMES % bare.max(1)) } else { SearchTurn::None }
    }

    /// Tracks the first frames of a recording only to learn how edges look and how long the bands are. The first
    /// second is then measured as well as the rest. Call it before [`Tracker::observe`], with [`MAX_WARM_UP_FRAMES`]
    /// frames if the recording has that many.
    pub fn warm_up(&mut self, frames: &[Frame<'_>]) {
        const ROUNDS: u32 = 2; // round 2 learns lengths with the edge appearance from round 1
        for _ in 0..ROUNDS {
            for frame in frames {
                self.observe(frame);
            }
            self.instants.clear();
            self.light = LightWatch::default();
            self.view = self.view.take().map(|_| ViewWatch::new(self.settings.camera.fx));
            self.last_samples.fill(None);
            self.tools.iter_mut().for_each(ToolTracker::start_over);
        }
    }

    /// Drops everything that only [`Self::finish`] needs, so that a live feed of many hours needs no more memory than
    /// one of minutes. Reports of later frames do not change, but [`Self::finish`] then covers only the frames after
    /// this call.
    pub fn forget_past(&mut self) {
        self.instants.clear();
        self.light.forget_past();
        self.tools.iter_mut().for_each(|tool| tool.records = PackedRecords::default());
    }

    /// The latest sample of the scene's light.
    pub fn light(&self) -> Option<LightSample> {
        self.light.last()
    }

    /// The fulcrum of each tool; `None` while it is not known well.
    pub fn fulcrums(&self) -> Vec<Option<Fulcrum>> {
        self.tools.iter().map(|tool| tool.adjustment.as_ref()?.well_known_fulcrum()).collect()
    }

    /// What the axes of each tool say of its trocar so far. Before there are poses enough to say anything, it may have
    /// one.
    pub fn trocars(&self) -> Vec<TrocarEvidence> {
        self.tools.iter().map(ToolTracker::trocar).collect()
    }

    /// Tracks the next frame: predict → find → measure → accept → learn, for each tool, and each pair of one colour.
    pub fn observe(&mut self, frame: &Frame<'_>) -> FrameReport {
        self.instants.push((frame.index, frame.time_s));
        self.light.sample_frame(frame);
        if let Some(view) = &mut self.view {
            view.sample_frame(frame);
        }
        let mut outlines = self.expected_outlines(frame.time_s);
        let mut results: Vec<(usize, ToolFrameResult)> = Vec::with_capacity(self.tools.len());
        let (finder, turn) = (self.strips.take(), self.next_search_turn());
        let strips = finder.as_ref().map(|finder| FrameStrips::new(finder, frame, turn));
        for tool in self.nearest_first(&outlines) {
            results.push((tool, self.observe_alone(tool, frame, strips.as_ref(), &mut outlines)));
        }
        self.strips = finder;
        for pair in 0..self.pairs.len() {
            results.extend(self.observe_pair(self.pairs[pair], frame, &outlines));
        }
        learn::share_chroma_siting(frame, &mut self.tools);
        learn::share_exposure(&mut self.tools);
        self.frame_report(frame, results)
    }

    /// Tracks a tool that shares its colour with no other. Its measured outline, no longer the expected one, then shows
    /// what it may hide.
    fn observe_alone(
        &mut self,
        i: usize,
        frame: &Frame<'_>,
        strips: Option<&FrameStrips<'_>>,
        outlines: &mut [Option<Outline>],
    ) -> ToolFrameResult {
        let (table, settings) = (&self.table, &self.settings);
        let obstacles = outlines_of_others(outlines, i);
        let tool = &mut self.tools[i];
        let scene = FrameContext { frame, segment: table, table, settings, strips, obstacles: &obstacles };
        let result = tool.observe(&scene);
        if result.advance.observed {
            outlines[i] = tool.last_outline();
        }
        result
    }

    /// Tracks two tools of one colour.
    fn observe_pair(
        &mut self,
        pair: [usize; 2],
        frame: &Frame<'_>,
        outlines: &[Option<Outline>],
    ) -> Vec<(usize, ToolFrameResult)> {
        let (table, settings) = (&self.table, &self.settings);
        let obstacles = pair.map(|i| outlines_of_others(outlines, i));
        let scenes = [0, 1].map(|of| FrameContext {
            frame,
            segment: table,
            table,
            settings,
            strips: None,
            obstacles: &obstacles[of],
        });
        match self.tools.get_disjoint_mut(pair) {
            Ok(tools) => pair.into_iter().zip(pair::observe(tools, scenes)).collect(),
            Err(_) => Vec::new(),
        }
    }

    /// Like [`Self::observe`], and also records each step of the search, to find out why a frame failed. Classifying
    /// every cell of the frame takes several times as long as tracking it.
    pub fn observe_traced(&mut self, frame: &Frame<'_>) -> (FrameReport, FrameTrace) {
        self.tools.iter_mut().for_each(|tool| tool.trace.start());
        let report = self.observe(frame);
        let tools = self.tools.iter_mut().map(|tool| tool.trace.finish()).collect();
        let (classes, columns) = trace::classify_cells(frame, &self.table);
        (report, FrameTrace { classes, columns, tools })
    }

    /// Ends the recording: processes all measurements again, now with knowledge of the whole recording.
    pub fn finish(mut self) -> Tracking {
        self.conclude()
    }

    /// The result of all frames so far. Their records are consumed, and the view is no longer watched: a second look at
    /// the same frames would see the same.
    fn conclude(&mut self) -> Tracking {
        for pair in &self.pairs {
            if let Ok(tools) = self.tools.get_disjoint_mut(*pair) {
                pair_reassignment::reassign(tools, &self.instants);
            }
        }
        let tapes: Vec<String> = self.settings.tools.iter().map(|t| t.colour.clone()).collect();
        let colours = palette::colour_separations(&self.settings.samples, &tapes);
        let mut quality = Quality {
            frames: self.instants.len() as u64,
            tools: Vec::new(),
            light: std::mem::take(&mut self.light).into_samples(),
            view_shifts: self.view.take().map(ViewWatch::into_shifts).unwrap_or_default(),
        };
        let mut motions = Vec::with_capacity(self.tools.len());
        for ((i, tool), colour) in self.tools.iter_mut().enumerate().zip(colours) {
            let TrackerSettings { camera, motion, .. } = &self.settings;
            let mut records = std::mem::take(&mut tool.records);
            let axes = records.take_axes();
            let (motion, reworked) = second_pass::run(
                (records.unpack(), axes),
                &tool.seen_shaft,
                &tool.spec,
                i,
                &self.instants,
                camera,
                motion,
            );
            // A shaft has no colour of its own: its colour says nothing of how well it can be followed.
            let colour = if tool.spec.is_bare() { ColourSeparation::default() } else { colour };
            quality.tools.push(ToolQuality { colour, ..reworked });
            motions.push(motion);
        }
        let frame_times_s = self.instants.iter().map(|instant| instant.1).collect();
        Tracking { quality, motions, frame_times_s }
    }
}

/// The outlines of all other tools: they may hide this tool.
fn outlines_of_others(outlines: &[Option<Outline>], tool: usize) -> Vec<Outline> {
    outlines.iter().enumerate().filter(|(other, _)| *other != tool).filter_map(|(_, outline)| *outline).collect()
}

#[cfg(test)]
mod tests {
    use super::testing::{ENCODING, SIZE, two_bare_tools};
    use super::*;

    #[test]
    fn only_recordings_are_watched_for_a_moved_camera() {
        let is_watched = |tracker: Result<Tracker, SettingsProblem>| tracker.unwrap().view.is_some();
        assert!(is_watched(Tracker::new(two_bare_tools(), SIZE.0, SIZE.1, ENCODING)));
        assert!(!is_watched(Tracker::for_feed(two_bare_tools(), SIZE.0, SIZE.1, ENCODING)));
    }
}
