//! Tests of the whole simulation: truth, motion, pixels.

mod bare;

use nalgebra::{Point3, Vector3};

use super::light::Lamp;
use super::render::{Chroma, Renderer};
use super::skill::Skill;
use super::{RigView, Scenario, Setup, World, truth};
use crate::vision::camera::Camera;
use crate::vision::space::CameraPoint;

fn small(scenario: Scenario, skill: Skill, seed: u64) -> Setup {
    Setup { width: 320, height: 180, ..Setup::new(scenario, skill, seed) }
}

fn worlds() -> impl Iterator<Item = (Setup, World)> {
    let views = [RigView::Top, RigView::Side];
    let setups = Scenario::ALL
        .into_iter()
        .flat_map(move |scenario| views.map(|view| Setup { view, ..small(scenario, Skill::INTERMEDIATE, 5) }));
    setups.map(|setup| (setup, World::new(&setup)))
}

fn times(world: &World, step_s: f64) -> impl Iterator<Item = f64> + use<> {
    let count = (world.duration_s / step_s) as usize;
    (0..count).map(move |i| i as f64 * step_s)
}

#[test]
fn the_tip_lies_on_the_line_through_the_fulcrum_at_all_times() {
    for (setup, world) in worlds() {
        for time_s in times(&world, 0.31) {
            for (tool, pose) in world.tools.iter().zip(world.poses(time_s)) {
                let from_fulcrum = pose.tip - tool.fulcrum;
                let off = from_fulcrum.cross(&pose.axis).norm();
                assert!(off < 1e-9, "{setup:?} at {time_s} s: {off} mm off");
                assert!(from_fulcrum.dot(&pose.axis) > 20.0, "{setup:?} at {time_s} s: drawn out of its trocar");
            }
        }
    }
}

#[test]
fn the_tip_is_seen_where_the_truth_says() {
    for (_, world) in worlds() {
        for time_s in times(&world, 1.7) {
            for tool in truth::at(&world, time_s) {
                let seen = world.rig.camera.project(CameraPoint(tool.tip_mm)).unwrap();
                assert_eq!(tool.tip_px, Some(seen.0));
                assert!((0.0..=1.0).contains(&tool.visible), "visible {}", tool.visible);
            }
        }
    }
}

#[test]
fn hands_move_at_human_speed_without_jumps() {
    for (setup, world) in worlds() {
        for time_s in times(&world, 0.05) {
            let pairs = world.poses(time_s).into_iter().zip(world.poses(time_s + 1e-4));
            for (now, then) in pairs {
                let speed = (then.tip - now.tip).norm() / 1e-4;
                assert!(speed < 420.0, "{setup:?} at {time_s} s: {speed} mm/s");
            }
        }
    }
}

#[test]
fn every_scene_keeps_its_tools_in_sight_unless_it_withdraws_or_hides_one() {
    for (setup, world) in worlds() {
        for (index, tool) in world.tools.iter().enumerate() {
            let seen: Vec<f64> = times(&world, 0.5).map(|t| truth::at(&world, t)[index].visible).collect();
            let share = seen.iter().filter(|v| **v > 0.8).count() as f64 / seen.len() as f64;
            let least = match setup.scenario {
                Scenario::Crossing | Scenario::Exchange | Scenario::SelfTest => 0.4,
                Scenario::HiddenTip => 0.7,
                _ => 0.8,
            };
            assert!(share > least, "{setup:?}, {}: only {share:.2} of the time in view", tool.name);
        }
    }
}

#[test]
fn one_tool_passes_behind_the_other_and_leaves_the_view_in_crossing() {
    let world = World::new(&small(Scenario::Crossing, Skill::INTERMEDIATE, 2));
    let cyan: Vec<f64> = times(&world, 0.05).map(|t| truth::at(&world, t)[1].visible).collect();
    assert!(cyan.iter().any(|v| (0.2..0.9).contains(v)), "never partly hidden");
    assert!(cyan.contains(&0.0), "never out of view");
    assert!(*cyan.last().unwrap() > 0.9, "does not come back");
}

#[test]
fn both_cross_leave_and_return_in_the_other_order_in_exchange() {
    for view in [RigView::Top, RigView::Side] {
        let world = World::new(&Setup { view, ..small(Scenario::Exchange, Skill::INTERMEDIATE, 2) });
        let seen: Vec<_> = times(&world, 0.05).map(|t| truth::at(&world, t)).collect();
        let crossed = |tools: &[truth::TrueTool]| tools[0].tip_mm.x > tools[1].tip_mm.x + 20.0;
        assert!(seen.iter().any(|tools| crossed(tools)), "{view:?}: never crossed");
        let absent =
            |tool: usize| -> Vec<usize> { (0..seen.len()).filter(|k| seen[*k][tool].visible == 0.0).collect() };
        let (left, right) = (absent(0), absent(1));
        assert!(left.first() < right.first() && right.last() < left.last(), "{view:?}: {left:?}, {right:?}");
        assert!(left.iter().any(|k| right.contains(k)), "{view:?}: never both away");
    }
}

#[test]
fn tools_of_one_tape_are_called_by_their_sides() {
    let tape = super::tool::TapeDesign::ALL[0];
    let world = World::new(&Setup { tapes: [tape; 2], ..small(Scenario::Exchange, Skill::EXPERT, 2) });
    let names: Vec<String> = truth::at(&world, 0.0).into_iter().map(|tool| tool.tool).collect();
    assert_eq!(names, ["left", "right"]);
}

#[test]
fn tools_do_not_pass_through_each_other() {
    for scenario in [Scenario::Crossing, Scenario::Exchange, Scenario::Rectangle] {
        for view in [RigView::Top, RigView::Side] {
            let world = World::new(&Setup { view, ..small(scenario, Skill::INTERMEDIATE, 3) });
            for time_s in times(&world, 0.05) {
                let poses = world.poses(time_s);
                let gap = gap_between(
                    (poses[0].grip, poses[0].tip - poses[0].axis * poses[0].length_mm),
                    (poses[1].grip, poses[1].tip - poses[1].axis * poses[1].length_mm),
                );
                assert!(gap > 5.0, "{scenario:?} {view:?} at {time_s} s: axes {gap:.1} mm apart");
            }
        }
    }
}

fn gap_between(a: (Point3<f64>, Point3<f64>), b: (Point3<f64>, Point3<f64>)) -> f64 {
    let on = |line: (Point3<f64>, Point3<f64>), i: usize| line.0 + (line.1 - line.0) * (i as f64 / 150.0);
    let pairs = (0..=150).flat_map(|i| (0..=150).map(move |j| (i, j)));
    pairs.map(|(i, j)| (on(a, i) - on(b, j)).norm()).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_resting_tool_does_not_move_at_all() {
    let world = World::new(&small(Scenario::Rest, Skill::NOVICE, 9));
    assert_eq!(world.poses(0.0), world.poses(6.66));
}

#[test]
fn a_guided_slide_stays_within_a_third_of_a_millimetre_of_its_line_five_times() {
    for seed in 0..5 {
        let world = World::new(&small(Scenario::Slide, Skill::NOVICE, seed));
        let to_board = world.rig.camera_from_board.inverse();
        let start = Vector3::new(-48.0, 4.0, -18.0);
        let along = (Vector3::new(44.0, -26.0, -30.0) - start).normalize();
        let grips: Vec<Vector3<f64>> =
            times(&world, 0.04).map(|t| (to_board * world.poses(t)[0].grip).coords - start).collect();
        let off = grips.iter().map(|g| (g - along * g.dot(&along)).norm()).fold(0.0, f64::max);
        assert!(off < 0.34, "seed {seed}: {off} mm off the guide");
        let far: Vec<bool> = grips.iter().map(|g| g.dot(&along) > 48.0).collect();
        let turns = far.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert_eq!(turns, 10, "five times there and back");
    }
}

#[test]
fn experts_are_faster_smoother_and_straighter_than_novices() {
    for scenario in [Scenario::Wire, Scenario::Rectangle, Scenario::Pegs] {
        let of = |skill: Skill| {
            let runs: Vec<(f64, f64, f64)> =
                (0..4).map(|seed| measures(&World::new(&small(scenario, skill, seed)))).collect();
            let mean = |part: fn(&(f64, f64, f64)) -> f64| runs.iter().map(part).sum::<f64>() / runs.len() as f64;
            [mean(|m| m.0), mean(|m| m.1), mean(|m| m.2)]
        };
        let [novice, intermediate, expert] = [of(Skill::NOVICE), of(Skill::INTERMEDIATE), of(Skill::EXPERT)];
        for part in 0..3 {
            assert!(
                novice[part] > intermediate[part] && intermediate[part] > expert[part],
                "{scenario:?} measure {part}: {} {} {}",
                novice[part],
                intermediate[part],
                expert[part]
            );
        }
    }
}

/// Duration, path of all tools, and roughness: the third difference of the path per mm of it.
fn measures(world: &World) -> (f64, f64, f64) {
    const STEP_S: f64 = 0.02;
    let (mut path, mut roughness) = (0.0, 0.0);
    let tips: Vec<Vec<Point3<f64>>> =
        times(world, STEP_S).map(|t| world.poses(t).iter().map(|p| p.tip).collect()).collect();
    for quartet in tips.windows(4) {
        let [first, second, third, fourth] = quartet else { continue };
        for (((a, b), c), d) in first.iter().zip(second).zip(third).zip(fourth) {
            let [a, b, c, d] = [a, b, c, d].map(|tip| tip.coords);
            path += (b - a).norm();
            roughness += (d - c * 3.0 + b * 3.0 - a).norm();
        }
    }
    (world.duration_s, path, roughness / path)
}

#[test]
fn the_same_seed_gives_the_same_pixels_and_another_seed_others() {
    let world = World::new(&small(Scenario::Pegs, Skill::NOVICE, 11));
    let first = Renderer::new(&world).render(1.4);
    let again = World::new(&small(Scenario::Pegs, Skill::NOVICE, 11));
    let renderer = Renderer::new(&again);
    renderer.render(0.3);
    assert_eq!(first, renderer.render(1.4), "a frame depends on nothing but world and time");
    let other = World::new(&small(Scenario::Pegs, Skill::NOVICE, 12));
    assert_ne!(first, Renderer::new(&other).render(1.4));
}

#[test]
fn full_chroma_shows_the_same_luma() {
    let world = World::new(&small(Scenario::Rectangle, Skill::EXPERT, 4));
    let (quarter, full) = (Renderer::new(&world).render(1.0), Renderer::with_chroma(&world, Chroma::Full).render(1.0));
    assert_eq!(full.u.len(), full.y.len());
    assert_eq!(quarter.u.len() * 4, quarter.y.len());
    let differing = quarter.y.iter().zip(&full.y).filter(|(a, b)| a.abs_diff(**b) > 12).count();
    assert!(differing < 20, "{differing} samples of luma differ by more than noise");
}

#[test]
fn a_rendered_silhouette_lies_within_a_twentieth_of_a_pixel_of_the_tangent_planes() {
    let worlds = (1..4).map(|seed| World::new(&Setup::new(Scenario::Rest, Skill::EXPERT, seed)));
    for (left, right) in worlds.map(|world| measured_edges(&world)) {
        for misses in [left, right] {
            assert!(misses.len() > 12, "only {} rows measured", misses.len());
            let count = misses.len() as f64;
            let mean = misses.iter().sum::<f64>() / count;
            let rms = (misses.iter().map(|miss| miss * miss).sum::<f64>() / count).sqrt();
            assert!(mean.abs() < 0.01 && rms < 0.05, "the border is {mean:.4} px off, {rms:.4} px RMS row by row");
        }
    }
}

/// Distances of the rendered left and right borders of the band from the tangent planes, row by row, across the border.
fn measured_edges(world: &World) -> (Vec<f64>, Vec<f64>) {
    let tape = world.tools[0].design.band.unwrap().tape.material();
    let coverage = super::render::coverage(world, 0.0, |material| *material == tape);
    let camera = world.rig.camera;
    let pose = world.poses(0.0)[0];
    let tube = world.tools[0].design.tube(&pose);
    let row_of = |behind: f64| camera.project(CameraPoint(pose.tip - pose.axis * behind)).unwrap().v();
    let (from, to) = (row_of(0.3 * tube.band_mm), row_of(0.7 * tube.band_mm));
    let (mut lefts, mut rights) = (Vec::new(), Vec::new());
    for v in from.min(to).ceil() as usize..from.max(to) as usize {
        let row = &coverage[v * camera.width as usize..(v + 1) * camera.width as usize];
        let middle = middle_of(row);
        let left = middle - row[..middle as usize].iter().sum::<f64>() - 0.5;
        let right = middle + row[middle as usize..].iter().sum::<f64>() - 0.5;
        let crossings = |v: f64| {
            let mut at = tube.borders().map(|border| crossing(&camera, border, v, middle));
            at.sort_by(f64::total_cmp);
            at
        };
        let (expected, above, below) = (crossings(v as f64), crossings(v as f64 - 0.5), crossings(v as f64 + 0.5));
        let across = [0, 1].map(|side| 1.0 / 1f64.hypot(below[side] - above[side]));
        lefts.push((left - expected[0]) * across[0]);
        rights.push((right - expected[1]) * across[1]);
    }
    (lefts, rights)
}

/// A column inside the band.
fn middle_of(row: &[f64]) -> f64 {
    let (sum, weight) = row.iter().enumerate().fold((0.0, 0.0), |(s, w), (u, c)| (s + c * u as f64, w + c));
    (sum / weight).round()
}

/// The column at which row `v` crosses a tangent plane's image, by bisection from a column inside.
fn crossing(camera: &Camera, border: Vector3<f64>, v: f64, inside: f64) -> f64 {
    let side = |u: f64| border.dot(&camera.normalised_of(crate::vision::space::Pixel::new(u, v)).unwrap().ray());
    let reach = 60.0;
    let outside = if side(inside - reach) < 0.0 { inside - reach } else { inside + reach };
    let (mut out, mut within) = (outside, inside);
    for _ in 0..60 {
        let middle = 0.5 * (out + within);
        if side(middle) < 0.0 { out = middle } else { within = middle }
    }
    0.5 * (out + within)
}

#[test]
fn the_shadow_of_a_tool_darkens_the_mat_and_nothing_brightens_it() {
    let world = World::new(&small(Scenario::Rectangle, Skill::EXPERT, 1));
    let mut dark = world.clone();
    for lamp in &mut dark.rig.lighting.lamps {
        *lamp = Lamp { power: [0.0; 3], ..*lamp };
    }
    let lit = Renderer::new(&world).render(2.0);
    let mean = |y: &[u8]| y.iter().map(|c| f64::from(*c)).sum::<f64>() / y.len() as f64;
    assert!(mean(&lit.y) > mean(&Renderer::new(&dark).render(2.0).y));
}
