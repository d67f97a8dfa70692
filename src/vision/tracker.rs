//! Tracks the tools: processes each frame, and turns a whole recording into paths and quality figures.

mod assignment;
mod band_fit;
mod blocks;
mod footprint;
mod gaps;
mod hand_direction;
mod light;
mod measurement;
mod motion;
mod origin;
mod pair;
mod pair_reassignment;
mod probe_pass;
mod record;
mod report;
mod second_pass;
mod settings;
mod starts;
mod tool;
mod trace;

pub use motion::STATED_SIGMA_SHARE;
pub use report::{
    Absence, DiameterBasis, EffectiveDiameter, FrameReport, Gap, LightSample, Observation, Quality, ToolQuality,
    ToolReport, Tracking,
};
pub use settings::{CameraView, HandSide, MotionSettings, PoseMethod, SettingsProblem, ToolSpec, TrackerSettings};
pub use trace::{FitTrace, FrameTrace, ProbePassTrace, ToolTrace};

use crate::vision::edges::blur_domain;
use crate::vision::edges::edge_model::EdgeModel;
use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::segmentation::colour_table::ColourTable;
use crate::vision::segmentation::knn::Knn;
use crate::vision::segmentation::palette;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::trajectory::{Sample, SampleState};
use crate::vision::tube::Outline;
use gaps::FrameMargin;
use light::LightWatch;
use measurement::Measurement;
use motion::{FrameInstant, PastPose};
use record::PackedRecords;
use tool::{FrameContext, ToolFrameResult, ToolTracker};

/// Number of frames for [`Tracker::warm_up`]: enough edges to learn their appearance, and enough views to learn a
/// band's length.
pub const MAX_WARM_UP_FRAMES: usize = 12;

/// Follows the tools through a recording or a live feed, frame by frame.
pub struct Tracker {
    settings: TrackerSettings,
    table: ColourTable,
    tools: Vec<ToolTracker>,
    /// Pairs of tools that share a colour; the left hand's tool comes first.
    pairs: Vec<[usize; 2]>,
    instants: Vec<FrameInstant>,
    light: LightWatch,
    /// The last known position of each tool.
    last_samples: Vec<Option<Sample>>,
}

impl Tracker {
    /// Creates a tracker for frames of this size and encoding.
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
        let tools = settings.tools.iter().map(|spec| {
            let tape = settings.samples.mean_codes(&spec.colour, encoding);
            ToolTracker::new(spec.clone(), settings.class_of(&spec.colour), EdgeModel::new(tape, encoding))
        });
        let (tools, pairs) = (tools.collect(), settings.pairs());
        let last = vec![None; settings.tools.len()];
        Ok(Self {
            tools,
            pairs,
            table,
            settings,
            instants: Vec::new(),
            light: LightWatch::default(),
            last_samples: last,
        })
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
        self.tools.iter().map(|tool| tool.fulcrum()?.stated(STATED_SIGMA_SHARE)).collect()
    }

    /// Tracks the next frame.
    pub fn observe(&mut self, frame: &Frame<'_>) -> FrameReport {
        self.instants.push((frame.index, frame.time_s));
        self.light.sample_frame(frame);
        let mut outlines = self.expected_outlines(frame.time_s);
        let (table, settings) = (&self.table, &self.settings);
        let mut seen: Vec<(usize, ToolFrameResult)> = Vec::with_capacity(self.tools.len());
        for i in self.nearest_first(&outlines) {
            let scene = FrameContext { frame, table, settings, obstacles: &outlines_of_others(&outlines, i) };
            let tool = &mut self.tools[i];
            let result = tool.observe(&scene);
            if result.advance.observed {
                // It hides others by its measured position, no longer by the expected one.
                outlines[i] = tool.last_outline();
            }
            seen.push((i, result));
        }
        for pair in &self.pairs {
            let obstacles = pair.map(|i| outlines_of_others(&outlines, i));
            let scenes = [0, 1].map(|of| FrameContext { frame, table, settings, obstacles: &obstacles[of] });
            if let Ok(tools) = self.tools.get_disjoint_mut(*pair) {
                seen.extend(pair.iter().copied().zip(pair::observe(tools, scenes)));
            }
        }
        self.share_blur_domain();
        seen.sort_by_key(|(i, _)| *i);
        let instant = (frame.index, frame.time_s);
        let tools: Vec<ToolReport> = seen.into_iter().map(|(i, seen)| self.tool_report(i, instant, seen)).collect();
        FrameReport { frame: frame.index, time_s: frame.time_s, tools }
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

    /// Ends the recording: processes all frames again, now with knowledge of the whole recording.
    pub fn finish(mut self) -> Tracking {
        for pair in &self.pairs {
            if let Ok(tools) = self.tools.get_disjoint_mut(*pair) {
                pair_reassignment::reassign(tools, &self.instants);
            }
        }
        let tapes: Vec<String> = self.settings.tools.iter().map(|t| t.colour.clone()).collect();
        let colours = palette::colour_separations(&self.settings.samples, &tapes);
        let mut quality =
            Quality { frames: self.instants.len() as u64, tools: Vec::new(), light: self.light.into_samples() };
        let mut motions = Vec::with_capacity(self.tools.len());
        for ((i, tool), colour) in self.tools.into_iter().enumerate().zip(colours) {
            let TrackerSettings { camera, motion, .. } = &self.settings;
            let (motion, reworked) =
                second_pass::run(tool.records.unpack(), &tool.spec, i, &self.instants, camera, motion);
            quality.tools.push(ToolQuality { colour, ..reworked });
            motions.push(motion);
        }
        let frame_times_s = self.instants.iter().map(|instant| instant.1).collect();
        Tracking { quality, motions, frame_times_s }
    }

    /// Decides from all tools together whether blur mixed light or codes: one camera recorded them all.
    fn share_blur_domain(&mut self) {
        let mixing = blur_domain::decide(self.tools.iter().filter_map(|tool| tool.edges.chroma_shift_px()));
        self.tools.iter_mut().for_each(|tool| tool.edges.set_blur_domain(mixing));
    }

    /// The expected outline of each tool, so that the other tools know what may hide them.
    fn expected_outlines(&self, time_s: f64) -> Vec<Option<Outline>> {
        let motion = self.settings.motion.track_settings();
        self.tools.iter().map(|tool| tool.expected_tube(time_s, &motion).and_then(|(tube, _)| tube.outline())).collect()
    }

    /// The tools that share no colour with another, the nearest to the camera first because it may hide the others.
    fn nearest_first(&self, outlines: &[Option<Outline>]) -> Vec<usize> {
        let is_alone = |tool: &usize| !self.pairs.iter().flatten().any(|paired| paired == tool);
        let depth_mm = |tool: &usize| outlines[*tool].map_or(f64::INFINITY, |outline| outline.rim(0.0, 0.0).z);
        let mut alone: Vec<usize> = (0..self.tools.len()).filter(is_alone).collect();
        alone.sort_by(|one, other| depth_mm(one).total_cmp(&depth_mm(other)));
        alone
    }

    fn tool_report(&mut self, tool: usize, instant: FrameInstant, seen: ToolFrameResult) -> ToolReport {
        let camera = &self.settings.camera;
        let pose = self.tools[tool].last_pose.as_ref().map(PastPose::from);
        let state = if seen.advance.observed { SampleState::Observed } else { SampleState::Predicted };
        let filtered = seen
            .advance
            .state
            .map(|filtered| motion::state_sample(&filtered, pose.as_ref(), tool, instant, state, camera, None))
            .map(motion::with_live_sigma);
        let refused = seen.outcome.as_ref().err().copied();
        let absence = refused.filter(|_| filtered.is_none()).map(|reason| {
            let rim = FrameMargin::new(camera, self.settings.tools[tool].band_length_mm);
            gaps::absence_now(self.last_samples[tool].as_ref(), reason, &rim)
        });
        let drawn = seen.outcome.as_ref().ok().and_then(|m| self.drawing(m));
        let outcome =
            seen.outcome.and_then(|m| self.observation(&m).ok_or(crate::vision::reason::MissReason::ImpossiblePose));
        self.last_samples[tool] = filtered.or(self.last_samples[tool]);
        ToolReport {
            tool,
            outcome,
            filtered,
            absence,
            borders_px: drawn.map(|(borders, _)| borders),
            band_end_px: drawn.map(|(_, end)| end),
        }
    }

    fn observation(&self, measurement: &Measurement) -> Option<Observation> {
        let estimate = &measurement.estimate;
        Some(Observation {
            tip_mm: estimate.tube.tip,
            axis: estimate.tube.axis,
            covariance_mm2: estimate.tip_covariance(),
            tip_px: self.settings.camera.project(CameraPoint(estimate.tube.tip))?,
            border_residual_px: estimate.residual_px,
        })
    }

    /// Both borders and the distal end, as drawn over the frame.
    fn drawing(&self, measurement: &Measurement) -> Option<([[Pixel; 2]; 2], Pixel)> {
        let outline = measurement.estimate.tube.outline()?;
        let pixel = |point| self.settings.camera.project(CameraPoint(point));
        let border =
            |side| Some([pixel(outline.border(side, 0.0))?, pixel(outline.border(side, measurement.length_mm))?]);
        Some(([border(0)?, border(1)?], pixel(outline.rim(0.0, 0.0))?))
    }
}

/// The outlines of all other tools: they may hide this tool.
fn outlines_of_others(outlines: &[Option<Outline>], tool: usize) -> Vec<Outline> {
    outlines.iter().enumerate().filter(|(other, _)| *other != tool).filter_map(|(_, outline)| *outline).collect()
}
