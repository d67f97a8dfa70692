//! Tools without tape, and the scenes for them.

use super::*;
use crate::simulation::light::Material;
use crate::simulation::marks;
use crate::simulation::render::{Photographer, coverage};
use crate::simulation::tool::{BLACK, FACE, STEEL, ShaftDesign, SimulatedMarker, TapeDesign, ToolPose};
use crate::vision::space::Pixel;

const VIEWS: [RigView; 2] = [RigView::Top, RigView::Side];

fn bare(scenario: Scenario, view: RigView) -> Setup {
    Setup { view, marker: SimulatedMarker::Bare, ..Setup::new(scenario, Skill::INTERMEDIATE, 5) }
}

fn is_black(material: &Material) -> bool {
    *material == BLACK
}

fn is_steel(material: &Material) -> bool {
    *material == STEEL
}

/// Index of the pixel that shows a point.
fn pixel_of(camera: &Camera, point: Point3<f64>) -> usize {
    let seen: Pixel = camera.project(CameraPoint(point)).unwrap();
    seen.v().round() as usize * camera.width as usize + seen.u().round() as usize
}

/// Pixels along a tool's shaft, from 2 to 40 mm behind the tip: on its axis, or this share of its radius beside it.
fn pixels_beside(world: &World, aside: f64) -> Vec<usize> {
    let (pose, radius) = (world.poses(0.0)[0], 0.5 * world.tools[0].design.diameter_mm);
    let at = |half_mm: u32| {
        let on_axis = pose.tip - pose.axis * (0.5 * f64::from(half_mm));
        let across = pose.axis.cross(&on_axis.coords).normalize();
        pixel_of(&world.rig.camera, on_axis + across * (aside * radius))
    };
    (4..=80).map(at).collect()
}

#[test]
fn a_bare_shaft_fills_its_outline_and_no_tape_is_seen() {
    for view in VIEWS {
        let world = World::new(&bare(Scenario::Rest, view));
        let shaft = coverage(&world, 0.0, is_black);
        for aside in [-0.8, 0.0, 0.8] {
            assert!(pixels_beside(&world, aside).into_iter().all(|at| shaft[at] > 0.99), "{view:?}: gap at {aside}");
        }
        for aside in [-1.3, 1.3] {
            assert!(pixels_beside(&world, aside).into_iter().all(|at| shaft[at] == 0.0), "{view:?}: wide at {aside}");
        }
        let is_tape = |material: &Material| TapeDesign::ALL.iter().any(|tape| tape.material() == *material);
        assert!(coverage(&world, 0.0, is_tape).iter().all(|share| *share == 0.0), "{view:?}");
    }
}

#[test]
fn the_tip_of_a_bare_tool_is_where_its_shaft_turns_to_steel() {
    const AROUND_MM: f64 = 3.0;
    const STEPS: u32 = 120;
    for view in VIEWS {
        let world = World::new(&bare(Scenario::Rest, view));
        let pose = world.poses(0.0)[0];
        assert_eq!(truth::at(&world, 0.0)[0].tip_mm, pose.tip);
        let towards_camera = -(pose.tip.coords - pose.axis * pose.tip.coords.dot(&pose.axis)).normalize();
        let facing = towards_camera * (0.5 * world.tools[0].design.diameter_mm);
        let step_mm = 2.0 * AROUND_MM / f64::from(STEPS);
        let at = |step: u32| {
            let ahead_mm = (0.5 + f64::from(step)) * step_mm - AROUND_MM;
            pixel_of(&world.rig.camera, pose.tip + pose.axis * ahead_mm + facing)
        };
        for is_such in [is_black, is_steel] {
            let share = coverage(&world, 0.0, is_such);
            let length_mm: f64 = (0..STEPS).map(|step| share[at(step)] * step_mm).sum();
            assert!((length_mm - AROUND_MM).abs() < 0.2, "{view:?}: {length_mm} mm of {AROUND_MM}");
        }
    }
}

#[test]
fn a_bare_shaft_has_the_colour_of_its_design_and_the_box_shows_beside_it() {
    let setup = bare(Scenario::Rest, RigView::Top);
    let mut without_tools = World::new(&setup);
    let inside = [-0.4, 0.0, 0.4].map(|aside| pixels_beside(&without_tools, aside)).concat();
    let beside = [-2.5, 2.5].map(|aside| pixels_beside(&without_tools, aside)).concat();
    without_tools.tools.clear();
    let empty = Renderer::new(&without_tools).render(0.0).y;
    let mean = |of: &dyn Fn(usize) -> f64, at: &[usize]| at.iter().map(|at| of(*at)).sum::<f64>() / at.len() as f64;
    let lumas = ShaftDesign::ALL.map(|shaft| {
        let shown = Renderer::new(&World::new(&Setup { shaft, ..setup })).render(0.0).y;
        let change = |at: usize| f64::from(shown[at].abs_diff(empty[at]));
        if shaft.material == BLACK {
            let (on, off) = (mean(&change, &inside), mean(&change, &beside));
            assert!(off < 0.5 * on, "beside the shaft {off:.1} codes, on it {on:.1}");
        }
        mean(&|at| f64::from(shown[at]), &inside)
    });
    assert!(lumas[0] < mean(&|at| f64::from(empty[at]), &inside) - 25.0, "{lumas:?}");
    assert!(lumas.windows(2).all(|pair| pair[0] + 30.0 < pair[1]), "{lumas:?}");
}

#[test]
fn the_empty_box_is_what_the_camera_would_see_without_tools() {
    let setup = Setup { width: 320, height: 180, ..bare(Scenario::Pegs, RigView::Top) };
    let mut world = World::new(&setup);
    let scenery = world.empty_box();
    let photo = Photographer::new(&world.rig).take(|v| scenery.trace(v), 1);
    world.tools.clear();
    let rendered = Renderer::new(&world).render(0.0).y;
    let luma = |rgb: &[u8]| {
        let [r, g, b] = [0, 1, 2].map(|channel| f64::from(rgb[channel]) / 255.0);
        16.0 + 219.0 * (0.2126 * r + 0.7152 * g + 0.0722 * b)
    };
    let gaps: Vec<f64> = photo.rgb.chunks(3).map(luma).zip(&rendered).map(|(a, b)| (a - f64::from(*b)).abs()).collect();
    let (mean, far) = (gaps.iter().sum::<f64>() / gaps.len() as f64, gaps.iter().filter(|gap| **gap > 25.0).count());
    assert!(mean < 4.0 && far < gaps.len() / 500, "mean difference {mean:.2} codes, {far} pixels far off");
}

#[test]
fn marks_of_bare_tools_lie_on_shafts_or_clear_of_every_tool() {
    let setup = Setup { width: 640, height: 360, diameter_mm: 10.0, ..bare(Scenario::Pegs, RigView::Top) };
    let world = World::new(&setup);
    let times_s: Vec<f64> = (0..60).map(|i| f64::from(i) * 0.1).collect();
    let marks = marks::mark_recording(&world, &times_s);
    let count = |label: &str| marks.iter().filter(|mark| mark.label == label).count();
    assert!(count("shaft") >= 16 && count("background") >= 20, "{} and {}", count("shaft"), count("background"));
    assert_eq!(count("shaft") + count("background"), marks.len());
    for of_frame in marks.chunk_by(|a, b| a.frame == b.frame) {
        let time_s = times_s[of_frame[0].frame];
        let shaft = coverage(&world, time_s, is_black);
        let tool = coverage(&world, time_s, |material| [BLACK, STEEL, FACE].contains(material));
        for mark in of_frame {
            let corners = [(0, 0), (mark.w - 1, 0), (0, mark.h - 1), (mark.w - 1, mark.h - 1)];
            for (right, down) in corners {
                let at = (mark.y + down) as usize * 640 + (mark.x + right) as usize;
                let is_right = if mark.label == "shaft" { shaft[at] > 0.99 } else { tool[at] == 0.0 };
                assert!(is_right, "{mark:?}: {} of the shaft, {} of a tool", shaft[at], tool[at]);
            }
        }
    }
}

#[test]
fn the_rod_of_a_self_test_has_neither_collar_nor_jaws() {
    let rod = bare(Scenario::SelfTest, RigView::Top).tool_design(0);
    assert_eq!((rod.band, rod.collar_mm, rod.jaw_mm), (None, 0.0, 0.0));
    let taped = Setup::new(Scenario::Pegs, Skill::EXPERT, 1).tool_design(1);
    assert_eq!((taped.collar_mm, taped.point_mm(), taped.marker_mm()), (0.0, 17.0, 29.0));
}

/// Longest time without any movement of a tool, s, and its start.
fn longest_rest(world: &World, tool: usize) -> (f64, f64) {
    const STEP_S: f64 = 0.1;
    let poses: Vec<(f64, ToolPose)> = times(world, STEP_S).map(|t| (t, world.poses(t)[tool])).collect();
    let rests = poses.chunk_by(|a, b| a.1 == b.1).map(|rest| (rest.len() as f64 * STEP_S, rest[0].0));
    rests.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

#[test]
fn both_tools_lie_still_for_a_minute_in_a_long_rest() {
    let world = World::new(&bare(Scenario::LongRest, RigView::Top));
    let (left, right) = (longest_rest(&world, 0), longest_rest(&world, 1));
    assert!(left.0 > 60.0 && left.1 == 0.0, "the left one rests for {} s from {} s", left.0, left.1);
    assert!(right.0 >= 59.9 && right.1 > 1.0, "the right one rests for {} s from {} s", right.0, right.1);
    assert!(world.duration_s > right.0 + right.1 + 1.0, "both move afterwards");
}

#[test]
fn a_hidden_tip_is_away_for_half_a_second_while_the_shaft_stays_in_sight() {
    const STEP_S: f64 = 0.01;
    let setups = VIEWS.into_iter().flat_map(|view| SimulatedMarker::ALL.map(|marker| (view, marker)));
    for (view, marker) in setups {
        let world = World::new(&Setup { marker, ..bare(Scenario::HiddenTip, view) });
        let is_hidden = |time_s: f64| {
            let tip = world.poses(time_s)[0].tip;
            world.stages[0].scenery.prop_before(tip.coords / tip.z, tip.z).is_some()
        };
        let seen: Vec<(f64, bool)> = times(&world, STEP_S).map(|t| (t, is_hidden(t))).collect();
        let spells: Vec<&[(f64, bool)]> = seen.chunk_by(|a, b| a.1 == b.1).filter(|spell| spell[0].1).collect();
        assert!(spells.len() >= 6, "{view:?} {marker:?}: {} spells", spells.len());
        for spell in spells {
            let length_s = spell.len() as f64 * STEP_S;
            assert!(
                (0.35..0.7).contains(&length_s),
                "{view:?} {marker:?}: hidden for {length_s} s at {} s",
                spell[0].0
            );
            let visible = truth::at(&world, spell[spell.len() / 2].0)[0].visible;
            assert!((0.3..0.95).contains(&visible), "{view:?} {marker:?}: {visible} visible at {} s", spell[0].0);
        }
    }
}

#[test]
fn black_pegs_are_moved_one_after_the_other() {
    let world = World::new(&bare(Scenario::MovedPegs, RigView::Top));
    let now = |time_s: f64| world.moved_props(time_s);
    assert!(now(0.0).iter().all(|prop| is_black(&prop.material)));
    let mut has_moved = vec![false; now(0.0).len()];
    for time_s in times(&world, 0.1) {
        let way = now(time_s).into_iter().zip(now(time_s + 0.1)).map(|(a, b)| (a.solid.a - b.solid.a).norm());
        let moving: Vec<usize> = way.enumerate().filter(|(_, way)| *way > 0.0).map(|(peg, _)| peg).collect();
        assert!(moving.len() <= 1, "pegs {moving:?} move at {time_s} s");
        moving.into_iter().for_each(|peg| has_moved[peg] = true);
    }
    assert!(has_moved.iter().all(|moved| *moved), "{has_moved:?}");
    for time_s in [0.0, world.duration_s] {
        let black = coverage(&world, time_s, is_black);
        for prop in now(time_s) {
            assert!(black[pixel_of(&world.rig.camera, prop.solid.b)] > 0.99, "{prop:?} is not shown at {time_s} s");
        }
    }
}

#[test]
fn bare_shafts_pass_before_black_props() {
    const FAR_MM: f64 = 1000.0;
    for view in VIEWS {
        let world = World::new(&bare(Scenario::BlackProps, view));
        for tool in 0..2 {
            let is_beside_black = |time_s: f64| {
                let pose = world.poses(time_s)[tool];
                (2..30).any(|back_mm| {
                    let on_axis = pose.tip - pose.axis * f64::from(back_mm);
                    let beside = on_axis.coords + pose.axis.cross(&on_axis.coords).normalize() * 3.0;
                    world.stages[0].scenery.prop_before(beside / beside.z, FAR_MM).is_some()
                })
            };
            let all: Vec<bool> = times(&world, 0.1).map(is_beside_black).collect();
            let share = all.iter().filter(|beside| **beside).count() as f64 / all.len() as f64;
            assert!(share > 0.1, "{view:?}, tool {tool}: before black in {share:.2} of the time");
        }
    }
}
