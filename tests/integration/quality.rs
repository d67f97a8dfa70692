//! Pictures with known faults through the tracker and the quality gate: each fault is named, and good recordings pass.

use trocar::motion::quality::{
    Figures, NoiseFloorBasis, QualityCause, QualityInput, QualityVerdict, Severity, judge, measure,
};
use trocar::random::Dice;
use trocar::simulation::render::{Rendered, Renderer};
use trocar::simulation::{Scenario, Setup, Skill, World, marks, truth};
use trocar::vision::camera::Camera;
use trocar::vision::frame::{Frame, Plane};
use trocar::vision::segmentation::samples::{ColourSamples, MarkedRectangle};
use trocar::vision::space::CameraPoint;
use trocar::vision::tracker::{DiameterBasis, Marker, MotionSettings, ToolSpec, Tracker, TrackerSettings, Tracking};
use trocar::vision::trajectory::PathKind;

const FRAME_S: f64 = 0.04;

/// Width of the part of a picture that the tracker gets, pixels.
const WINDOW: usize = 480;

/// A tool at rest, and pictures of it that differ only in the sensor's noise.
struct RestingTool {
    world: World,
    pictures: Vec<Rendered>,
}

impl RestingTool {
    fn of(pictures: usize) -> Self {
        let world = World::new(&Setup::new(Scenario::Rest, Skill::INTERMEDIATE, 21));
        let renderer = Renderer::new(&world);
        let pictures = (0..pictures).map(|i| renderer.render(i as f64 * FRAME_S)).collect();
        Self { world, pictures }
    }

    fn samples(&self) -> ColourSamples {
        let first = self.pictures[0].frame(0, 0.0);
        let mut samples = ColourSamples::new(first.encoding);
        for mark in marks::mark_recording(&self.world, &[0.0]) {
            let [x, y, w, h] = [mark.x, mark.y, mark.w, mark.h].map(|n| n as usize);
            samples.collect_stroke(&first, &[MarkedRectangle { label: mark.label.to_owned(), x, y, w, h }]);
        }
        samples
    }

    fn settings(&self, camera: Camera) -> TrackerSettings {
        let design = &self.world.tools[0].design;
        let band = design.band.unwrap();
        let spec = ToolSpec {
            name: band.tape.name.to_owned(),
            colour: band.tape.name.to_owned(),
            side: None,
            diameter_mm: design.diameter_mm,
            marker: Marker::Band { length_mm: Some(band.length_mm) },
        };
        TrackerSettings::new(camera, vec![spec], self.samples())
    }

    fn track(&self) -> Tracking {
        self.track_with(self.settings(self.world.rig.camera))
    }

    /// Tracks it as if its sizes were `times` the true ones: its diameter, its band's length.
    fn track_with_sizes(&self, times: [f64; 2]) -> Tracking {
        let mut settings = self.settings(self.world.rig.camera);
        let tool = &mut settings.tools[0];
        tool.diameter_mm *= times[0];
        tool.marker = Marker::Band { length_mm: tool.band_length_mm().map(|length_mm| length_mm * times[1]) };
        self.track_with(settings)
    }

    fn track_with(&self, settings: TrackerSettings) -> Tracking {
        let mut tracker = self.tracker(settings);
        for (index, picture) in self.pictures.iter().enumerate() {
            tracker.observe(&picture.frame(index as u64, index as f64 * FRAME_S));
        }
        tracker.finish()
    }

    fn tracker(&self, settings: TrackerSettings) -> Tracker {
        let (width, height) = (settings.camera.width, settings.camera.height);
        Tracker::new(settings, width, height, self.pictures[0].frame(0, 0.0).encoding).unwrap()
    }

    /// Tracks the first picture through a window that begins `left_of(frame)` pixels from the picture's left edge.
    fn track_through_a_window(&self, frames: u64, left_of: impl Fn(u64) -> usize) -> Tracking {
        let whole = self.pictures[0].frame(0, 0.0);
        let width = WINDOW;
        let camera = Camera { width: width as u32, ..self.world.rig.camera };
        let mut tracker = self.tracker(self.settings(camera));
        for index in 0..frames {
            let left = left_of(index) / 2 * 2;
            let luma = window(whole.y, left, width);
            let [u, v] = [whole.u, whole.v].map(|plane| window(plane, left / 2, width / 2));
            tracker.observe(&Frame { index, time_s: index as f64 * FRAME_S, y: luma, u, v, ..whole });
        }
        tracker.finish()
    }
}

fn window(plane: Plane<'_>, left: usize, width: usize) -> Plane<'_> {
    Plane { data: &plane.data[left..], width, ..plane }
}

fn figures(tracking: &Tracking) -> Figures {
    let smoothed = tracking.trajectory(PathKind::Smoothed);
    measure(&QualityInput::of_tracking(tracking, &smoothed, MotionSettings::default()))
}

fn judged(tracking: &Tracking) -> QualityVerdict {
    judge(&figures(tracking))
}

/// Is this what a clean clip of a resting tool lacks? A tool that never turns shows no trocar, and one of 5 mm in a small
/// picture has an error bar of about the limit of care.
fn is_of_resting(verdict: &QualityVerdict) -> bool {
    let causes = causes(verdict);
    causes == [QualityCause::NoTrocar] || causes == [QualityCause::NoTrocar, QualityCause::ErrorBar]
}

/// The causes of a verdict.
fn causes(verdict: &QualityVerdict) -> Vec<QualityCause> {
    verdict.concerns().iter().map(|concern| concern.cause).collect()
}

fn refusing(verdict: &QualityVerdict) -> Vec<QualityCause> {
    verdict.concerns().iter().filter(|c| c.severity == Severity::Refuse).map(|c| c.cause).collect()
}

/// Adds grain that is stronger than that of any current sensor.
fn with_grain(mut picture: Rendered, codes: f64, dice: &mut Dice) -> Rendered {
    for plane in [&mut picture.y, &mut picture.u, &mut picture.v] {
        plane.iter_mut().for_each(|c| *c = (f64::from(*c) + codes * dice.gauss()).round().clamp(16.0, 235.0) as u8);
    }
    picture
}

/// The path is smooth with any sizes; only the picture can contradict them.
#[test]
fn sizes_that_the_picture_contradicts_refuse_the_session() {
    let rest = RestingTool::of(30);
    let causes_with = |times| refusing(&judged(&rest.track_with_sizes(times)));
    assert_eq!(causes_with([1.0, 1.0]), []);
    assert!(causes_with([1.0, 2.0]).contains(&QualityCause::BandTooLong), "a band twice as long as it is");
    assert!(causes_with([0.5, 1.0]).contains(&QualityCause::BandTooLong), "a tube half as thick as it is");
}

#[test]
fn both_ways_to_the_noise_floor_of_a_clean_clip_agree() {
    let rest = RestingTool::of(90);
    let tracking = rest.track();
    assert!(is_of_resting(&judged(&tracking)), "{:?}", judged(&tracking));
    let diameter = figures(&tracking).tools[0].effective_diameter.unwrap();
    assert_eq!(diameter.basis, DiameterBasis::AssumedTrocar, "a tool that does not turn does not show its trocar");
    assert!((diameter.mm - rest.world.tools[0].design.diameter_mm).abs() < 3.0 * diameter.sigma_mm, "{diameter:?}");
    let measured = figures(&tracking).tools[0].noise_floor.unwrap();
    let mut smoothed = tracking.trajectory(PathKind::Smoothed);
    let speeds = smoothed.samples[13..77].iter().map(|s| s.velocity_mm_s.unwrap().norm_squared());
    let truth = (speeds.sum::<f64>() / 64.0).sqrt(); // the tool is at rest: all its speed is noise
    assert!(matches!(measured.basis, NoiseFloorBasis::Rest(_)), "{measured:?}");
    assert!((measured.smoothed_mm_s / truth - 1.0).abs() < 0.1, "{measured:?}, truth {truth}");

    // Without the information that it rests: from the scatter of the measurements alone.
    smoothed.samples.iter_mut().for_each(|sample| sample.tip_px = None);
    let evidence = QualityInput::of_tracking(&tracking, &smoothed, MotionSettings::default());
    let estimated = measure(&evidence).tools[0].noise_floor.unwrap();
    eprintln!("noise floor: measured {measured:?}, estimated {estimated:?}, truth {truth:.3} mm/s");
    assert_eq!(estimated.basis, NoiseFloorBasis::Measurements);
    let factor = estimated.smoothed_mm_s / truth;
    assert!((0.4..2.5).contains(&factor), "{estimated:?}, truth {truth}");
}

#[test]
fn a_session_whose_tool_is_mostly_out_of_view_is_refused_with_that_reason() {
    let rest = RestingTool::of(1);
    let tip_mm = truth::at(&rest.world, 0.0)[0].tip_mm;
    let tip = rest.world.rig.camera.project(CameraPoint(tip_mm)).unwrap();
    let start = tip.u() as usize - WINDOW / 2; // the tip in the window's middle
    let fits_on_the_right = start + 400 + WINDOW <= rest.pictures[0].width;
    let away = |frame: u64| {
        // 15 frames here, 20 on the way out, 100 away, and back
        let step = 20 * frame.saturating_sub(15).min(155u64.saturating_sub(frame)).min(20) as usize;
        if fits_on_the_right { start + step } else { start - step }
    };
    let verdict = judged(&rest.track_through_a_window(170, away));
    eprintln!("{verdict:?}");
    assert_eq!(refusing(&verdict), [QualityCause::Coverage, QualityCause::LeftView]);
    let still = judged(&rest.track_through_a_window(170, |_| start));
    assert!(!still.is_refused(), "{still:?}");
}

#[test]
fn grain_that_shakes_the_edges_raises_the_noise_floor_until_it_is_refused() {
    let rest = RestingTool::of(1);
    let with = |codes: f64| {
        let mut dice = Dice::new(7, "grain");
        let noisy = (0..80).map(|_| with_grain(rest.pictures[0].clone(), codes, &mut dice)).collect();
        let noisy = RestingTool { world: rest.world.clone(), pictures: noisy };
        let mut tracker = noisy.tracker(rest.settings(rest.world.rig.camera));
        for (index, picture) in noisy.pictures.iter().enumerate() {
            tracker.observe(&picture.frame(index as u64, index as f64 * FRAME_S));
        }
        let tracking = tracker.finish();
        (figures(&tracking).tools[0].noise_floor.map(|noise| noise.smoothed_mm_s), judged(&tracking))
    };
    let [clean, grainy, blizzard] = [0.5, 8.0, 60.0].map(with);
    eprintln!("{clean:?}\n{grainy:?}\n{blizzard:?}");
    assert!(is_of_resting(&clean.1), "{:?}", clean.1);
    assert!(grainy.0 > clean.0, "{:?} against {:?}", grainy.0, clean.0);
    assert!(blizzard.1.is_refused(), "{:?}", blizzard.1);
}

#[test]
fn a_camera_that_is_moved_in_the_middle_is_named_with_its_moment() {
    const STEP_S: f64 = 0.1;
    let rest = RestingTool::of(2);
    let setup = Setup { camera_moved_mm: 12.0, ..Setup::new(Scenario::Rest, Skill::INTERMEDIATE, 21) };
    let moved_world = World::new(&setup);
    let renderer = Renderer::new(&moved_world);
    let moved = [0.0, FRAME_S].map(|time_s| renderer.render(time_s));
    let track = |later: &[Rendered]| {
        let mut tracker = rest.tracker(rest.settings(rest.world.rig.camera));
        for index in 0..120 {
            let pictures = if index < 60 { &rest.pictures[..] } else { later };
            tracker.observe(&pictures[index % 2].frame(index as u64, index as f64 * STEP_S));
        }
        tracker.finish()
    };
    let tracking = track(&moved);
    let found = figures(&tracking).session.moved_during.unwrap();
    eprintln!("{found:?}");
    assert!((7.0..13.0).contains(&found.mm) && (6.0..7.2).contains(&found.at_s), "{found:?}");
    assert!(causes(&judged(&tracking)).contains(&QualityCause::CameraMovedDuring));
    let still = track(&rest.pictures);
    let found = figures(&still).session.moved_during.unwrap();
    assert!(found.mm < 0.5, "{found:?}");
    assert!(!causes(&judged(&still)).contains(&QualityCause::CameraMovedDuring));
}

#[test]
fn a_wrong_colour_is_refused_as_nothing_seen() {
    let rest = RestingTool::of(3);
    let mut settings = rest.settings(rest.world.rig.camera);
    let tool = settings.samples.labels.iter().position(|l| *l == settings.tools[0].name).unwrap();
    for sample in settings.samples.samples.iter_mut().filter(|s| s.label == tool) {
        sample.yuv.swap(1, 2); // orange marked as its complement
    }
    let mut tracker = rest.tracker(settings);
    for (index, picture) in rest.pictures.iter().enumerate() {
        tracker.observe(&picture.frame(index as u64, index as f64 * FRAME_S));
    }
    assert_eq!(refusing(&judged(&tracker.finish())), [QualityCause::NothingSeen]);
}
