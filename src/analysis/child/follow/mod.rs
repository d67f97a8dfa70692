//! Tracks a live recording: reads each record of the log that the parent names, decodes it, tracks its frames and
//! replies at once.
//!
//! Frames are taken in the order of their numbers. A late frame, sent after the live ones because of an outage, is
//! skipped; the job that tracks the whole recording covers it.

mod feed_box;
mod messages;
mod validation;

use std::fs::File;
use std::os::unix::fs::FileExt;

use feed_box::FeedBox;
pub use messages::{
    FollowReply, FollowWork, FollowedFrame, FollowedTool, LiveConcern, LogPosition, RunningRow, SeenSoFar,
    live_features,
};
pub use validation::FollowOutput;

use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::analysis::empty_box::read_empty_box;
use crate::domain::feed::FrameCodec;
use crate::domain::feed::record::{FeedRecord, MAX_RECORD_BYTES, RecordBody};
use crate::media::{FeedDecoder, JpegMaker, JpegStyle, MediaLimits, Picture};
use crate::motion::features::FeatureSettings;
use crate::motion::features::running::RunningFeatures;
use crate::motion::quality::ports::watch::{self, PlacementWatch};
use crate::motion::quality::running::RunningFigures;
use crate::motion::quality::{MovementWatch, Ports};
use crate::vision::frame::Frame;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::tracker::{MAX_WARM_UP_FRAMES, SceneSamples, ToolSpec, Tracker, TrackerSettings};

/// Interval between replies with features and light, s of the recording.
const FEATURES_INTERVAL_S: f64 = 1.0;

/// Frames between two calls of [`Tracker::forget_past`].
const FORGET_INTERVAL_FRAMES: u64 = 1024;

impl ChildTask for FollowWork {
    type Record = FollowReply;
    type Output = FollowOutput;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let limits = inputs.limits;
        let ([log, mut places], empty_box) = inputs.first_two_and_third()?;
        let mut follower = LiveTracker::new(self, empty_box, limits)?;
        let mut bytes = Vec::new();
        while let Some(place) = LogPosition::read(&mut places).map_err(StopReason::ParentGone)? {
            let LogPosition::Record { offset, bytes: length, wants_picture } = place else {
                reporter.alive(0, None)?;
                continue;
            };
            bytes.resize((length as usize).min(MAX_RECORD_BYTES), 0);
            let record = log.read_exact_at(&mut bytes, offset).ok().and_then(|()| FeedRecord::read(&bytes).ok());
            if let Some(record) = record {
                follower.take_record(&record)?;
            }
            let picture = if wants_picture { follower.still() } else { None };
            reporter.record(WorkRecord::Follow(FollowReply { picture, ..follower.take_reply() }))?;
        }
        follower.finish()?;
        Ok(reporter.record(WorkRecord::Follow(follower.take_reply()))?)
    }

    fn accept(&self, reply: FollowReply, output: &mut FollowOutput, limits: MediaLimits) -> Result<ChildEvent, String> {
        validation::accept(self, reply, output, limits)
    }
}

struct LiveTracker {
    codec: FrameCodec,
    decoder: FeedDecoder,
    stage: FollowStage,
    ports: Ports,
    placement: PlacementWatch,
    movement: MovementWatch,
    /// Last reliable position of each tool's trocar.
    fulcrums: Vec<Option<Fulcrum>>,
    size: (u32, u32),
    /// The number that continues what was decoded.
    next: Option<u64>,
    running: RunningFeatures,
    figures: RunningFigures,
    /// Names of the tools.
    names: Vec<String>,
    features_at_s: f64,
    /// Time of the last features, s.
    last_features_s: f64,
    frames_since_forget: u64,
    stills: JpegMaker,
    reply: FollowReply,
}

/// What happens with the pictures.
///
/// ```text
///            enough pictures, or the end
/// Collecting ───────────────────────────▶ Tracking
///      └──────── the end, no picture ───▶ Empty
/// ```
enum FollowStage {
    /// The first pictures are collected for the warm-up; the first of them shows the colour encoding. There may be a
    /// picture of the empty box, too.
    Collecting { settings: Box<TrackerSettings>, first: Vec<Picture>, empty_box: Option<Picture> },
    /// Each picture is tracked, and shows the box of bare tools if there are any. The last one is kept for the still.
    Tracking { tracker: Box<Tracker>, feed_box: Option<Box<FeedBox>>, last: Option<Picture> },
    /// The recording ended without a picture.
    Empty,
}

impl LiveTracker {
    fn new(work: FollowWork, empty_box: Option<File>, limits: MediaLimits) -> Result<Self, StopReason> {
        let FollowWork { track, codec, size, time_base, ports } = work;
        // Read before the first frame arrives: a picture that cannot be used is refused at once.
        let empty_box = empty_box.map(|file| read_empty_box(file, [size.0 as usize, size.1 as usize], limits));
        let empty_box = empty_box.transpose()?;
        Ok(Self {
            codec,
            decoder: FeedDecoder::new(codec, size, time_base, limits)?,
            running: RunningFeatures::new(track.tools.len(), FeatureSettings::default()),
            figures: RunningFigures::new(track.tools.iter().map(ToolSpec::is_bare)),
            placement: PlacementWatch::new(track.tools.len()),
            movement: MovementWatch::new(track.camera.fx),
            names: track.tools.iter().map(|tool| tool.name.clone()).collect(),
            fulcrums: vec![None; track.tools.len()],
            stage: FollowStage::Collecting { settings: Box::new(track), first: Vec::new(), empty_box },
            ports,
            size,
            next: None,
            features_at_s: 0.0,
            last_features_s: 0.0,
            frames_since_forget: 0,
            stills: JpegMaker::new(JpegStyle::SMALL),
            reply: FollowReply::default(),
        })
    }

    fn take_record(&mut self, record: &FeedRecord<'_>) -> Result<(), StopReason> {
        let RecordBody::Frame { time, is_key, payload } = record.body else { return Ok(()) };
        let number = record.number;
        if self.next.is_some_and(|next| number < next) {
            return Ok(()); // late
        }
        let continues = self.next == Some(number);
        if self.codec == FrameCodec::H264 && !continues {
            if !is_key {
                return Ok(()); // undecodable until the next key frame
            }
            self.decoder.reset();
        }
        self.next = Some(number + 1);
        self.decoder.send_frame(number, time, payload)?;
        self.track_ready_pictures()
    }

    /// Tracks all pictures that the decoder has ready.
    fn track_ready_pictures(&mut self) -> Result<(), StopReason> {
        while let Some(picture) = self.decoder.next_picture()? {
            if let FollowStage::Collecting { first, .. } = &mut self.stage {
                first.push(picture.copied());
                self.decoder.recycle(picture);
                if first.len() >= MAX_WARM_UP_FRAMES {
                    self.warm_up()?;
                }
            } else {
                self.track(&picture)?;
                self.keep_for_still(picture);
            }
        }
        Ok(())
    }

    /// Passes the first pictures twice, unless that is done: once to learn how edges look, then to track them like all
    /// others.
    fn warm_up(&mut self) -> Result<(), StopReason> {
        let (settings, first, empty_box) = match std::mem::replace(&mut self.stage, FollowStage::Empty) {
            FollowStage::Collecting { settings, first, empty_box } => (settings, first, empty_box),
            other => {
                self.stage = other;
                return Ok(());
            }
        };
        let frames: Vec<Frame<'_>> = first.iter().map(Picture::frame).collect();
        let Some(frame) = frames.first() else { return Ok(()) };
        let mut tracker = Box::new(Tracker::for_feed(*settings, self.size.0, self.size.1, frame.encoding)?);
        tracker.warm_up(&frames);
        // Bare tools have no warm-up: until their trocars are known, each search for them takes longer than a frame.
        let mut scene = SceneSamples::default();
        if let Some(picture) = empty_box {
            scene.set_empty(&picture.frame(), frame.encoding);
        }
        let feed_box = tracker.box_learner().map(|learner| Box::new(FeedBox::new(learner, scene)));
        self.stage = FollowStage::Tracking { tracker, feed_box, last: None };
        first.iter().try_for_each(|picture| self.track(picture))
    }

    fn track(&mut self, picture: &Picture) -> Result<(), StopReason> {
        let FollowStage::Tracking { tracker, feed_box, .. } = &mut self.stage else { return Ok(()) };
        let frame = picture.frame();
        if let Some(learned) = feed_box.as_mut().and_then(|feed_box| feed_box.add_frame(&frame)) {
            tracker.know_feed_box(learned);
        }
        let report = tracker.observe(&frame);
        self.movement.sample_frame(&frame);
        report
            .tools
            .iter()
            .filter_map(|tool| tool.filtered.as_ref())
            .for_each(|sample| self.running.add_sample(sample));
        self.running.advance_to(frame.time_s);
        self.figures.add_frame(&report);
        let tools = report.tools.iter().map(|tool| FollowedTool::new(frame.index, tool)).collect();
        self.reply.frames.push(FollowedFrame { frame: frame.index, time_s: frame.time_s, tools });
        self.frames_since_forget += 1;
        if self.frames_since_forget == FORGET_INTERVAL_FRAMES {
            self.frames_since_forget = 0;
            tracker.forget_past();
        }
        if frame.time_s >= self.features_at_s {
            self.features_at_s = frame.time_s + FEATURES_INTERVAL_S;
            let seen = report.tools.iter().filter_map(|tool| tool.filtered).filter(|sample| sample.is_observed());
            seen.for_each(|sample| self.movement.add_depth(sample.tip_mm.z));
            self.add_features(frame.time_s);
        }
        Ok(())
    }

    /// Adds the features so far, and what else is sent with them, at this time, s.
    fn add_features(&mut self, time_s: f64) {
        self.reply.running = Some(self.running.values().iter().filter_map(RunningRow::new).collect());
        if let FollowStage::Tracking { tracker, feed_box, .. } = &self.stage {
            self.reply.is_learning_box = feed_box.as_ref().is_some_and(|feed_box| feed_box.is_learning());
            for (known, now) in self.fulcrums.iter_mut().zip(tracker.fulcrums()) {
                *known = now.or(*known);
            }
            self.reply.light = tracker.light();
            let figures = self.figures.figures(&self.names, &tracker.trocars());
            self.reply.seen = Some(SeenSoFar::of_tools(&figures));
        }
        self.last_features_s = time_s;
        self.reply.moved_during = self.movement.movement();
        let fulcrums: Vec<_> = self.fulcrums.iter().map(|fulcrum| fulcrum.map(watch::with_early_error)).collect();
        self.reply.placement = self.placement.update(time_s, &self.ports.compare(&fulcrums));
    }

    /// Keeps a picture for the still; returns the previous one to the decoder.
    fn keep_for_still(&mut self, picture: Picture) {
        if let FollowStage::Tracking { last, .. } = &mut self.stage
            && let Some(before) = last.replace(picture)
        {
            self.decoder.recycle(before);
        }
    }

    /// The last picture as a small JPEG. If encoding fails, the page only lacks the picture.
    fn still(&mut self) -> Option<(u64, Vec<u8>)> {
        let picture = match &self.stage {
            FollowStage::Collecting { first, .. } => first.last(),
            FollowStage::Tracking { last, .. } => last.as_ref(),
            FollowStage::Empty => None,
        };
        let frame = picture?.frame();
        self.stills.code(&frame).ok().map(|jpeg| (frame.index, jpeg))
    }

    /// The reply collected since the last one.
    fn take_reply(&mut self) -> FollowReply {
        std::mem::take(&mut self.reply)
    }

    fn finish(&mut self) -> Result<(), StopReason> {
        self.decoder.finish_input();
        self.track_ready_pictures()?;
        self.warm_up()?;
        self.running.finish();
        self.add_features(self.last_features_s);
        Ok(())
    }
}
