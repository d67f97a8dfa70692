//! Simulated scenes through the whole tracker, held against their truth.
//!
//! Pixels come from the renderer, not from a file: what is judged here is the measurement, and that the simulator and
//! the tracker, which share nothing but the camera model, agree on where a tool is.

use trocar::pipeline::camera::Camera;
use trocar::pipeline::evaluation::{Accuracy, Truth, TruthFrame, accuracy};
use trocar::pipeline::segmentation::samples::{ColourSamples, Rectangle};
use trocar::pipeline::tracker::{ToolSpec, Tracker, TrackerSettings, Tracking, View as TrackerView};
use trocar::simulation::render::Renderer;
use trocar::simulation::{Scenario, Setup, Skill, View, World, marks, truth};

const FPS: f64 = 25.0;

fn setup(scenario: Scenario) -> Setup {
    Setup { width: 1280, height: 720, ..Setup::new(scenario, Skill::INTERMEDIATE, 21) }
}

/// Tracks the frames of a world as this camera would have it.
fn track(world: &World, setup: &Setup, frames: usize, camera: Camera) -> (Tracking, Truth) {
    let times: Vec<f64> = (0..frames).map(|i| i as f64 / FPS).collect();
    let renderer = Renderer::new(world);
    let first = renderer.render(times[0]);
    let encoding = first.frame(0, times[0]).encoding;
    let mut settings = TrackerSettings::new(camera, tools(world), samples(world, &renderer, &times));
    settings.view = Some(match setup.view {
        View::Top => TrackerView::Top,
        View::Side => TrackerView::Side,
    });
    let mut tracker = Tracker::new(settings, setup.width, setup.height, encoding).unwrap();
    for (index, time_s) in times.iter().enumerate() {
        tracker.observe(&renderer.render(*time_s).frame(index as u64, *time_s));
    }
    let frame = |(index, time_s): (usize, &f64)| TruthFrame {
        frame: index as u64,
        time_s: *time_s,
        tools: truth::at(world, *time_s),
    };
    (tracker.finish(), Truth { frames: times.iter().enumerate().map(frame).collect() })
}

fn tools(world: &World) -> Vec<ToolSpec> {
    let spec = |tool: &trocar::simulation::tool::Tool| ToolSpec {
        name: tool.design.tape.name.to_owned(),
        diameter_mm: tool.design.diameter_mm,
        band_length_mm: Some(tool.design.band_mm),
    };
    world.tools.iter().map(spec).collect()
}

fn samples(world: &World, renderer: &Renderer, times: &[f64]) -> ColourSamples {
    let mut samples: Option<ColourSamples> = None;
    for mark in marks::of_recording(world, times) {
        let picture = renderer.render(times[mark.frame]);
        let frame = picture.frame(mark.frame as u64, times[mark.frame]);
        let [x, y, w, h] = [mark.x, mark.y, mark.w, mark.h].map(|n| n as usize);
        let rectangle = Rectangle { label: mark.label.to_owned(), x, y, w, h };
        samples.get_or_insert_with(|| ColourSamples::new(frame.encoding)).collect(&frame, &rectangle);
    }
    samples.unwrap()
}

fn judged(scenario: Scenario, frames: usize, spoil: impl Fn(&mut Camera)) -> Accuracy {
    let setup = setup(scenario);
    let world = World::new(&setup);
    let mut camera = world.rig.camera;
    spoil(&mut camera);
    let (tracking, truth) = track(&world, &setup, frames, camera);
    accuracy(&tracking.smoothed, &truth).unwrap()
}

fn plain(accuracy: &Accuracy) -> &trocar::pipeline::evaluation::Level {
    &accuracy.all.levels[1]
}

fn rms_mm(accuracy: &Accuracy) -> f64 {
    plain(accuracy).errors.unwrap().three_d.rms
}

#[test]
fn tools_of_every_scene_are_found_where_they_are() {
    for scenario in Scenario::ALL {
        let accuracy = judged(scenario, 30, |_| {});
        let level = plain(&accuracy);
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
        assert!(rms_mm(&accuracy) < 3.0, "{}: {} mm RMS", scenario.name(), rms_mm(&accuracy));
    }
}

#[test]
fn a_spoiled_calibration_makes_the_measured_error_worse() {
    let with = |spoil: fn(&mut Camera)| rms_mm(&judged(Scenario::Rectangle, 30, spoil));
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
fn a_resting_tool_is_measured_at_rest() {
    let setup = setup(Scenario::Rest);
    let world = World::new(&setup);
    let (tracking, truth) = track(&world, &setup, 30, world.rig.camera);
    let tip = truth.frames[0].tools[0].tip_mm;
    let wander = tracking.smoothed.samples.iter().map(|s| (s.tip_mm - tip).xy().norm()).fold(0.0, f64::max);
    assert!(wander < 1.0, "a resting tip is seen {wander} mm off, across the line of sight");
    let speeds = tracking.smoothed.samples.iter().filter_map(|s| s.velocity_mm_s).map(|v| v.norm());
    let fastest = speeds.fold(0.0, f64::max);
    assert!(fastest < 12.0, "a resting tool moves at {fastest} mm/s");
}
