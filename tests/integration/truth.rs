//! Simulated scenes through the whole tracker, compared with their truth.
//!
//! Pixels come from the renderer, not from a file. These tests judge the measurement: the simulator and the tracker,
//! which share only the camera model, must agree on the position of a tool.

use nalgebra::Vector3;
use trocar::checks::evaluation::{Accuracy, Truth, TruthFrame, TruthTool, accuracy};
use trocar::simulation::render::{Rendered, Renderer};
use trocar::simulation::tool::{SimulatedMarker, SimulatedTool};
use trocar::simulation::{RigView, Scenario, Setup, Skill, World, marks, truth};
use trocar::vision::camera::Camera;
use trocar::vision::frame::Frame;
use trocar::vision::reason::MissReason;
use trocar::vision::segmentation::samples::{ColourSamples, MarkedRectangle};
use trocar::vision::space::CameraPoint;
use trocar::vision::tracker::{
    CameraView as TrackerView, DiameterBasis, FirstLook, HandSide, Marker, SceneSamples, ToolSpec, Tracker,
    TrackerSettings, Tracking,
};
use trocar::vision::trajectory::{PathKind, Sample};

const FPS: f64 = 25.0;

/// A scene, rendered.
pub struct Recording {
    pub world: World,
    view: RigView,
    times_s: Vec<f64>,
    pictures: Vec<Rendered>,
}

impl Recording {
    fn of(scenario: Scenario) -> Self {
        const FRAMES: usize = 30;
        Self::with(&Setup { rig: 2, ..Setup::new(scenario, Skill::INTERMEDIATE, 21) }, Some(FRAMES))
    }

    /// The first frames of a scene; all of it without a number.
    pub fn with(setup: &Setup, frames: Option<usize>) -> Self {
        let world = World::new(setup);
        let frames = frames.unwrap_or((world.duration_s * FPS) as usize);
        let times_s: Vec<f64> = (0..frames).map(|i| i as f64 / FPS).collect();
        let renderer = Renderer::new(&world);
        let pictures = times_s.iter().map(|time_s| renderer.render(*time_s)).collect();
        Self { view: setup.view, times_s, pictures, world }
    }

    pub fn frame(&self, index: usize) -> Frame<'_> {
        self.pictures[index].frame(index as u64, self.times_s[index])
    }

    /// Tracks the recording with this camera model.
    pub fn track(&self, camera: Camera) -> Tracking {
        self.observed(camera).finish()
    }

    /// A tracker that has seen the whole recording.
    fn observed(&self, camera: Camera) -> Tracker {
        let mut tracker = self.tracker(camera);
        for index in 0..self.pictures.len() {
            tracker.observe(&self.frame(index));
        }
        tracker
    }

    /// A tracker for the recording, with this camera model.
    pub fn tracker(&self, camera: Camera) -> Tracker {
        let mut settings = TrackerSettings::new(camera, tools(&self.world), self.samples());
        settings.view = Some(match self.view {
            RigView::Top => TrackerView::Top,
            RigView::Side => TrackerView::Side,
        });
        let encoding = self.frame(0).encoding;
        Tracker::new(settings, camera.width, camera.height, encoding).unwrap()
    }

    fn samples(&self) -> ColourSamples {
        let mut samples = ColourSamples::new(self.frame(0).encoding);
        for mark in marks::mark_recording(&self.world, &self.times_s) {
            let [x, y, w, h] = [mark.x, mark.y, mark.w, mark.h].map(|n| n as usize);
            let rectangle = MarkedRectangle { label: mark.label.to_owned(), x, y, w, h };
            samples.collect_stroke(&self.frame(mark.frame), &[rectangle]);
        }
        samples
    }

    pub fn truth(&self) -> Truth {
        let frame = |(index, time_s): (usize, &f64)| TruthFrame {
            frame: index as u64,
            time_s: *time_s,
            tools: truth::at(&self.world, *time_s).into_iter().map(TruthTool::from).collect(),
        };
        Truth { frames: self.times_s.iter().enumerate().map(frame).collect() }
    }

    /// Paints the first frames dark beyond each tip and light along each shaft, like another tool's shaft and a lamp.
    fn paint_misleading_surroundings(&mut self, frames: usize) {
        const DARK: u8 = 20;
        const LIGHT: u8 = 230;
        let camera = self.world.rig.camera;
        let sizes: Vec<(f64, f64)> =
            self.world.tools.iter().map(|t| (t.design.diameter_mm, t.design.marker_mm())).collect();
        for (picture, time_s) in self.pictures.iter_mut().zip(&self.times_s).take(frames) {
            for (tool, (diameter_mm, band_mm)) in truth::at(&self.world, *time_s).iter().zip(&sizes) {
                let axis = tool.axis;
                let across = axis.cross(&tool.tip_mm.coords).normalize();
                let mut paint = |ahead_mm: f64, aside: f64, luma: u8| {
                    let place = tool.tip_mm + axis * ahead_mm + across * (aside * diameter_mm);
                    let Some(at) = camera.project(CameraPoint(place)) else { return };
                    set_grey(picture, [at.u(), at.v()], luma);
                };
                for step in 0..120 {
                    let beyond_mm = 0.3 * diameter_mm + 0.02 * f64::from(step) * diameter_mm;
                    for aside in (-30..=30).map(|n| 0.02 * f64::from(n)) {
                        paint(beyond_mm, aside, DARK);
                        paint(-band_mm - beyond_mm, aside, LIGHT);
                    }
                }
            }
        }
    }

    /// Paints a motionless pen across the picture, whose middle has a tape's colour and a band's size. In the first
    /// frames it also hides the band itself.
    fn paint_pen(&mut self, tool: usize, hidden_frames: usize) {
        const PEN: u8 = 30;
        const HALF_WIDTH_PX: i64 = 12;
        const HALF_BAND_PX: i64 = 45;
        let (camera, design) = (self.world.rig.camera, self.world.tools[tool].design);
        let tape = {
            let tip = &truth::at(&self.world, self.times_s[0])[tool];
            let middle = camera.project(CameraPoint(tip.tip_mm - tip.axis * (0.5 * design.marker_mm()))).unwrap();
            codes_at(&self.pictures[0], [middle.u(), middle.v()])
        };
        for (index, (picture, time_s)) in self.pictures.iter_mut().zip(&self.times_s).enumerate() {
            if index < hidden_frames {
                let tip = &truth::at(&self.world, *time_s)[tool];
                let across = tip.axis.cross(&tip.tip_mm.coords).normalize();
                for (along, aside) in (-20..320).flat_map(|along| (-40..=40).map(move |aside| (along, aside))) {
                    let back_mm = design.marker_mm() * f64::from(along) / 300.0;
                    let aside_mm = design.diameter_mm * 0.02 * f64::from(aside);
                    let at = camera.project(CameraPoint(tip.tip_mm - tip.axis * back_mm + across * aside_mm));
                    at.into_iter().for_each(|at| set_codes(picture, [at.u(), at.v()], [PEN, 128, 128]));
                }
            }
            let middle = (picture.width as i64 / 2, picture.height as i64 / 8);
            for (along, across) in
                (-200..=200).flat_map(|along| (-HALF_WIDTH_PX..=HALF_WIDTH_PX).map(move |across| (along, across)))
            {
                let codes = if i64::abs(along) <= HALF_BAND_PX { tape } else { [PEN, 128, 128] };
                set_codes(picture, [(middle.0 + along) as f64, (middle.1 + across) as f64], codes);
            }
        }
    }

    fn judged(&self, spoil: impl Fn(&mut Camera)) -> Accuracy {
        let mut camera = self.world.rig.camera;
        spoil(&mut camera);
        accuracy(&self.track(camera).trajectory(PathKind::Smoothed), &self.truth()).unwrap()
    }
}

fn set_grey(picture: &mut Rendered, at: [f64; 2], luma: u8) {
    set_codes(picture, at, [luma, 128, 128]);
}

fn set_codes(picture: &mut Rendered, at: [f64; 2], [y, u, v]: [u8; 3]) {
    let Some([of_luma, of_chroma]) = indices(picture, at) else { return };
    picture.y[of_luma] = y;
    (picture.u[of_chroma], picture.v[of_chroma]) = (u, v);
}

fn codes_at(picture: &Rendered, at: [f64; 2]) -> [u8; 3] {
    let [of_luma, of_chroma] = indices(picture, at).unwrap();
    [picture.y[of_luma], picture.u[of_chroma], picture.v[of_chroma]]
}

/// The indices of a pixel's luma and chroma; `None` outside the picture.
fn indices(picture: &Rendered, [u, v]: [f64; 2]) -> Option<[usize; 2]> {
    let (x, y) = (u.round() as usize, v.round() as usize);
    let is_inside = u >= 0.0 && v >= 0.0 && x < picture.width && y < picture.height;
    is_inside.then(|| [y * picture.width + x, (y / 2) * picture.width.div_ceil(2) + x / 2])
}

fn tools(world: &World) -> Vec<ToolSpec> {
    let bare = Marker::Shaft { collar_mm: None, jaw_mm: None };
    let side = |name: &str| if name == "left" { HandSide::Left } else { HandSide::Right };
    let spec = |SimulatedTool { name, design, .. }: &SimulatedTool| ToolSpec {
        name: (*name).to_owned(),
        colour: design.band.map_or("shaft", |band| band.tape.name).to_owned(),
        side: design.band.is_none().then(|| side(name)),
        diameter_mm: design.diameter_mm,
        marker: design.band.map_or(bare, |band| Marker::Band { length_mm: Some(band.length_mm) }),
    };
    world.tools.iter().map(spec).collect()
}

/// The figures for frames on which at least 80 % of the band is visible.
fn mostly_visible(accuracy: &Accuracy) -> &trocar::checks::evaluation::VisibilityLevel {
    &accuracy.all.levels[1]
}

fn rms_mm(accuracy: &Accuracy) -> f64 {
    mostly_visible(accuracy).errors.unwrap().three_d.rms
}

#[test]
fn tools_of_every_scene_are_found_where_they_are() {
    // The rod of a self-test appears only after the end of this recording: api/self_tests.rs covers it.
    for scenario in Scenario::ALL.into_iter().filter(|scenario| *scenario != Scenario::SelfTest) {
        let accuracy = Recording::of(scenario).judged(|_| {});
        let level = mostly_visible(&accuracy);
        eprintln!(
            "{}: found {}/{}, swaps {}, false {}, errors {:?}",
            scenario.name(),
            level.found,
            level.frames,
            level.swaps,
            accuracy.all.false_tracks,
            level.errors.map(|e| (e.lateral.rms, e.depth.rms))
        );
        assert!(
            level.found as f64 >= 0.97 * level.frames as f64,
            "{}: {} of {}",
            scenario.name(),
            level.found,
            level.frames
        );
        assert_eq!((level.swaps, accuracy.all.false_tracks), (0, 0), "{}", scenario.name());
        assert!(rms_mm(&accuracy) < 2.0, "{}: {} mm RMS", scenario.name(), rms_mm(&accuracy));
    }
}

#[test]
fn away_from_the_pictures_centre_the_stated_error_is_longest_along_the_line_of_sight() {
    const MIN_ANGLE: f64 = 0.1; // radians between the line of sight and the axis of the lens
    let recording = Recording::of(Scenario::Pegs);
    let path = recording.track(recording.world.rig.camera).trajectory(PathKind::Smoothed);
    let mut rows = 0;
    for sample in &path.samples {
        let ray = sample.tip_mm.coords.normalize();
        if ray.xy().norm() < MIN_ANGLE {
            continue;
        }
        let stated = sample.covariance_mm2.unwrap();
        assert!(stated.is_valid(), "{stated:?}");
        let axes = stated.matrix().symmetric_eigen();
        let longest = axes.eigenvectors.column(axes.eigenvalues.imax()).into_owned();
        let [off_ray, off_lens] = [ray, Vector3::z()].map(|direction| longest.cross(&direction).norm());
        assert!(off_ray < 0.5 * off_lens, "{off_ray} from the line of sight, {off_lens} from the lens's axis");
        rows += 1;
    }
    assert!(rows >= 20, "{rows}");
}

#[test]
fn a_track_that_starts_the_wrong_way_round_is_corrected_and_no_wrong_pose_is_kept() {
    let setup = Setup { rig: 2, ..Setup::new(Scenario::Pegs, Skill::INTERMEDIATE, 21) };
    let mut recording = Recording::with(&setup, Some(40));
    recording.paint_misleading_surroundings(3);
    let accuracy = recording.judged(|_| {});
    let level = mostly_visible(&accuracy);
    eprintln!("found {}/{}, {:?}", level.found, level.frames, level.errors.map(|e| e.three_d));
    assert!(level.found * 2 >= level.frames && level.found < level.frames, "{} of {}", level.found, level.frames);
    assert!(level.errors.unwrap().three_d.rms < 2.0, "{:?}", level.errors);
    assert_eq!((level.swaps, accuracy.all.false_tracks), (0, 0));
}

#[test]
fn a_second_look_measures_what_the_first_one_lost() {
    let setup = Setup { rig: 2, ..Setup::new(Scenario::Pegs, Skill::INTERMEDIATE, 21) };
    let mut recording = Recording::with(&setup, Some(40));
    let camera = recording.world.rig.camera;
    assert!(matches!(recording.observed(camera).finish_first_look(), FirstLook::Enough(_)), "nothing was lost");

    recording.paint_misleading_surroundings(3);
    let first = recording.track(camera);
    let FirstLook::LookAgain(mut second) = recording.observed(camera).finish_first_look() else {
        panic!("much was lost")
    };
    (0..recording.pictures.len()).for_each(|index| _ = second.observe(&recording.frame(index)));
    let (tracking, taken) = second.finish();
    let observed = |of: &Tracking| of.quality.tools.iter().map(|tool| tool.observed).collect::<Vec<_>>();
    let (before, after) = (observed(&first), observed(&tracking));
    eprintln!("{before:?} -> {after:?}");
    assert!((0..2).all(|tool| if taken[tool] { after[tool] > before[tool] } else { after[tool] == before[tool] }));
    assert!(taken.contains(&true) && after.iter().sum::<u64>() >= 70, "{before:?} -> {after:?}");
    let errors = accuracy(&tracking.trajectory(PathKind::Smoothed), &recording.truth()).unwrap();
    assert!(rms_mm(&errors) < 2.0, "{}", rms_mm(&errors));
}

#[test]
fn a_pen_with_the_tapes_colour_is_left_for_the_tool_that_appears_later() {
    const HIDDEN_FRAMES: usize = 12;
    let setup = Setup { rig: 2, ..Setup::new(Scenario::Pegs, Skill::INTERMEDIATE, 21) };
    let mut recording = Recording::with(&setup, Some(60));
    recording.paint_pen(0, HIDDEN_FRAMES);
    let tracking = recording.track(recording.world.rig.camera);
    let truth = recording.truth();
    let smoothed = tracking.trajectory(PathKind::Smoothed);
    let errors_mm: Vec<(u64, f64)> = smoothed
        .of_tool(0)
        .map(|s| (s.frame, (s.tip_mm - truth.frames[s.frame as usize].tools[0].tip_mm).norm()))
        .collect();
    eprintln!("{errors_mm:?} {:?}", tracking.quality.tools[0].reasons);
    assert!(errors_mm.iter().all(|(_, mm)| *mm < 6.0), "nothing of the pen's path is kept");
    assert!(errors_mm.len() + HIDDEN_FRAMES + 10 > 60, "found on {} frames", errors_mm.len());
    assert!(tracking.quality.tools[0].reasons.contains_key(&MissReason::NotTape), "the pen was followed at first");
}

#[test]
fn a_bare_tool_of_a_feed_is_followed_at_once_and_while_its_box_is_learned_again() {
    const FRAMES: usize = 24;
    const LEARNED_AGAIN: usize = 20;
    const MAX_ERROR_MM: f64 = 5.0;
    let pegs = Setup::new(Scenario::Pegs, Skill::INTERMEDIATE, 5);
    let setup = Setup { rig: 1, width: 960, height: 540, marker: SimulatedMarker::Bare, ..pegs };
    let recording = Recording::with(&setup, Some(FRAMES));
    let mut without_tools = World::new(&setup);
    without_tools.tools.clear();
    let (empty, first) = (Renderer::new(&without_tools).render(0.0), recording.frame(0));
    let mut scene = SceneSamples::default();
    scene.set_empty(&empty.frame(0, 0.0), first.encoding);
    scene.add(&first);
    let mut tracker = recording.tracker(recording.world.rig.camera);
    let learner = tracker.box_learner().unwrap();
    tracker.know_feed_box(learner.learn_box(&scene).unwrap());
    let mut seen = Vec::new();
    for index in 0..FRAMES {
        if index == LEARNED_AGAIN {
            tracker.know_feed_box(learner.learn_box(&scene).unwrap());
        }
        scene.add(&recording.frame(index));
        let Some(left) = tracker.observe(&recording.frame(index)).tools[0].filtered.filter(Sample::is_observed) else {
            continue;
        };
        let tip = truth::at(&recording.world, recording.times_s[index])[0].tip_mm.coords;
        let off_mm = left.tip_mm.coords.cross(&tip.normalize()).norm(); // depth is known less well
        assert!(off_mm < MAX_ERROR_MM, "frame {index}: {off_mm} mm across the line of sight");
        seen.push(index);
    }
    assert!(seen.len() >= FRAMES - 4, "{seen:?}");
    assert!(seen.contains(&(LEARNED_AGAIN - 1)) && seen.contains(&LEARNED_AGAIN), "{seen:?}");
}

/// A regression test: the tracker took tremor for measurement errors, and borders of the front tool for those of the
/// tool behind it. It found 200 of 220 positions, 3.5 mm off.
#[test]
fn a_trembling_beginner_whose_tools_cross_is_tracked() {
    let recording = Recording::with(&Setup::new(Scenario::Crossing, Skill::NOVICE, 56), Some(110));
    let accuracy = recording.judged(|_| {});
    let level = mostly_visible(&accuracy);
    eprintln!("found {}/{}, {:?}, {:?}", level.found, level.frames, level.errors.map(|e| e.three_d), level.sigma_check);
    assert!(level.found as f64 >= 0.99 * level.frames as f64, "{} of {}", level.found, level.frames);
    assert!(level.errors.unwrap().three_d.rms < 1.0, "{:?}", level.errors);
    assert_eq!((level.swaps, accuracy.all.false_tracks), (0, 0));
}

#[test]
fn a_spoiled_calibration_makes_the_measured_error_worse() {
    let recording = Recording::of(Scenario::Rectangle);
    let with = |spoil: fn(&mut Camera)| rms_mm(&recording.judged(spoil));
    let good = with(|_| {});
    let spoiled = [
        ("a focal length 5 % too long", with(|c| (c.fx, c.fy) = (1.05 * c.fx, 1.05 * c.fy))),
        ("a principal point 20 px off", with(|c| c.cx += 20.0)),
        ("no lens distortion", with(|c| *c = c.without_distortion())),
    ];
    for (what, error) in spoiled {
        eprintln!("{what}: {error:.2} mm instead of {good:.2}");
        assert!(error > 1.5 * good, "{what}: {error} mm, but {good} mm with the true camera");
    }
}

#[test]
fn a_session_reports_the_apparent_width_of_its_tape() {
    let setup = Setup { rig: 2, ..Setup::new(Scenario::Pegs, Skill::INTERMEDIATE, 21) };
    let recording = Recording::with(&setup, Some(150)); // long enough to turn
    let tracking = recording.track(recording.world.rig.camera);
    let diameters: Vec<_> = tracking.quality.tools.iter().map(|tool| tool.effective_diameter.unwrap()).collect();
    eprintln!("{diameters:?}");
    assert!(
        diameters.iter().any(|tool| tool.basis == DiameterBasis::Session),
        "one of them turned enough: {diameters:?}"
    );
    for (diameter, spec) in diameters.iter().zip(tools(&recording.world)) {
        assert!(
            (diameter.mm - spec.diameter_mm).abs() < 3.0 * diameter.sigma_mm,
            "{diameter:?} of {} mm",
            spec.diameter_mm
        );
        let is_stated = diameter.mm == spec.diameter_mm;
        assert_eq!(is_stated, diameter.basis == DiameterBasis::Usual, "{diameter:?}: wrong basis");
    }
}

#[test]
fn a_resting_tool_is_measured_at_rest() {
    let recording = Recording::of(Scenario::Rest);
    let tracking = recording.track(recording.world.rig.camera);
    let tip = recording.truth().frames[0].tools[0].tip_mm;
    let smoothed = tracking.trajectory(PathKind::Smoothed);
    assert_eq!(smoothed.samples.len(), 30);
    let wander = smoothed.samples.iter().map(|s| (s.tip_mm - tip).xy().norm()).fold(0.0, f64::max);
    assert!(wander < 1.0, "a resting tip is seen {wander} mm off, across the line of sight");
    let speeds = smoothed.samples.iter().filter_map(|s| s.velocity_mm_s).map(|v| v.norm());
    let fastest = speeds.fold(0.0, f64::max);
    assert!(fastest < 12.0, "a resting tool moves at {fastest} mm/s");
}
