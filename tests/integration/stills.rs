//! Bare shafts in single pictures: `trocar palette --check` on a rendered scene, and on real pictures with labels of
//! people.

use std::fs;
use std::path::Path;

use nalgebra::{Point2, Point3, Vector3, center};
use serde_json::{Value, json};
use trocar::domain::files::camera::CameraFile;
use trocar::domain::files::truth::TruthFile;
use trocar::vision::space::CameraPoint;
use trocar::vision::tube::{BorderSide, Tube};

use crate::feed::scene::Folder;
use crate::process::program;
use crate::resources::shared;

/// The shafts that the check reports for these annotations.
fn shafts(folder: &Path) -> Vec<Value> {
    let order = ["palette", "--check", "annotations.json", "--json"];
    let checked = program().args(order).current_dir(folder).output().unwrap();
    assert!(checked.status.success(), "{checked:?}");
    let report: Value = serde_json::from_slice(&checked.stdout).unwrap();
    report["shafts"].as_array().unwrap().clone()
}

fn point(place: &Value) -> Point2<f64> {
    Point2::new(place[0].as_f64().unwrap(), place[1].as_f64().unwrap())
}

/// Both edges of a shaft, from the rim to its end; `None` if they were not found.
fn edges(shaft: &Value) -> Option<[[Point2<f64>; 2]; 2]> {
    let edges = shaft["edges_px"].as_array()?;
    Some([0, 1].map(|edge| [0, 1].map(|end| point(&edges[edge][end]))))
}

/// Distance of a point from the line through two others.
fn distance([from, to]: [Point2<f64>; 2], point: Point2<f64>) -> f64 {
    let along = (to - from).normalize();
    (point - from).perp(&along).abs()
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn shafts_of_a_rendered_scene_are_where_the_truth_is_on_each_frame_alone() {
    const DIAMETER_MM: f64 = 5.0;
    let scene = Folder::of("--marker bare --seed 5 --seconds 3 --size 1280x720");
    let camera = CameraFile::parse(&fs::read_to_string(scene.file("camera.json")).unwrap()).unwrap().camera();
    let truth = TruthFile::parse(&fs::read_to_string(scene.file("truth.json")).unwrap()).unwrap();
    let found = shafts(scene.file("annotations.json").parent().unwrap());
    assert!(!found.is_empty() && found.iter().all(|shaft| shaft["tool"].is_string()), "{found:?}");
    let (mut off_edges, mut off_ends) = (Vec::new(), Vec::new());
    for shaft in &found {
        let Some(edges) = edges(shaft) else { continue };
        let frame = truth.frames.iter().find(|frame| shaft["frame"] == frame.frame).unwrap();
        let tool = frame.tools.iter().find(|tool| shaft["tool"] == tool.tool.as_str()).unwrap();
        let axis = Vector3::from(tool.axis.unwrap());
        let outline = Tube { tip: Point3::from(tool.tip_mm), axis, radius: 0.5 * DIAMETER_MM }.outline().unwrap();
        let pixel = |at| camera.project(CameraPoint(at)).unwrap().0;
        let border = |side, back_mm| pixel(outline.border(side, back_mm));
        for back_mm in [3.0, 20.0, 40.0] {
            let [one, other] = BorderSide::BOTH.map(|side| border(side, back_mm));
            let off = |first, second| [distance(edges[0], first), distance(edges[1], second)];
            let [same, crossed] = [off(one, other), off(other, one)];
            off_edges.extend(if same[0] < crossed[0] { same } else { crossed });
        }
        if let Some(end) = shaft.get("end_px").filter(|end| !end.is_null()) {
            off_ends.push((point(end) - pixel(outline.rim(0.0, 0.0))).norm());
        }
    }
    eprintln!("{} shafts, {} ends: edges {off_edges:.1?} px, ends {off_ends:.1?} px", found.len(), off_ends.len());
    assert!(off_edges.len() > 3 * found.len(), "more than half are found: {found:?}");
    assert!(off_edges.iter().all(|px| *px < 6.0) && median(&mut off_edges) < 2.0, "{off_edges:?}");
    // The tools have collars, so the end of the look alone does not count.
    assert!(off_ends.iter().all(|px| *px < 15.0), "{off_ends:?}");
}

/// Labels of people on a real picture: `tool1` or `tool2`.
struct Labels {
    /// Both edges of the shaft, each from the picture's rim to its end.
    edges: [[Point2<f64>; 2]; 2],
    /// The joint of the jaws.
    joint: Point2<f64>,
}

impl Labels {
    fn of(all: &Value, tool: &str) -> Self {
        let joint = point(&all[format!("{tool}_joint")]);
        let edges = ["top", "bottom"].map(|edge| {
            let [one, other] = [0, 1].map(|end| point(&all[format!("{tool}_lines")][edge][end]));
            if (one - joint).norm() > (other - joint).norm() { [one, other] } else { [other, one] }
        });
        Self { edges, joint }
    }

    /// Three pieces of the shaft as a person would mark them: squares in its middle.
    fn marks(&self) -> [Value; 3] {
        [0.3, 0.6, 0.85].map(|share| {
            let [one, other] = self.edges.map(|[from, to]| from + (to - from) * share);
            let (at, side) = (center(&one, &other), (0.3 * (one - other).norm()).round());
            let [x, y] = [at.x, at.y].map(|middle| (middle - 0.5 * side) as i64);
            json!({"frame": 0, "label": "shaft", "x": x, "y": y, "w": side as i64, "h": side as i64})
        })
    }
}

#[test]
fn shafts_of_real_pictures_are_where_people_saw_them() {
    /// Distance of the jaws' joint ahead of the shaft's end in these pictures, as a share of its width: the joint
    /// is not measured.
    const JOINT_AHEAD: f64 = 0.5;
    let Some(folder) = shared("data/lask") else { return };
    let (mut off_edges, mut off_joints) = (Vec::new(), Vec::new());
    for name in ["trial46_frame_0200", "trial46_frame_1000", "trial46_frame_1800"] {
        let all: Value = serde_json::from_slice(&fs::read(folder.join(format!("{name}.json"))).unwrap()).unwrap();
        let labels = ["tool1", "tool2"].map(|tool| Labels::of(&all, tool));
        let scene = tempfile::tempdir().unwrap();
        fs::copy(folder.join(format!("{name}.jpg")), scene.path().join("still.jpg")).unwrap();
        let tool = |name| json!({"tool": name, "diameter_mm": 5.0, "marker": {"kind": "shaft"}});
        let white = json!({"frame": 0, "label": "background", "x": 640, "y": 620, "w": 60, "h": 40});
        let marks: Vec<Value> = labels.iter().flat_map(Labels::marks).chain([white]).collect();
        let annotations =
            json!({"needs": 2, "video": "still.jpg", "tools": [tool("left"), tool("right")], "labels": marks});
        fs::write(scene.path().join("annotations.json"), annotations.to_string()).unwrap();
        for (shaft, labels) in shafts(scene.path()).iter().zip(&labels) {
            let edges = edges(shaft).unwrap_or_else(|| panic!("{name}: {shaft}"));
            let off = |of: &[Point2<f64>; 2], edge| of.map(|at| distance(edge, at));
            let [same, crossed] = [[0, 1], [1, 0]]
                .map(|order| [off(&labels.edges[0], edges[order[0]]), off(&labels.edges[1], edges[order[1]])].concat());
            let sum = |px: &[f64]| px.iter().sum::<f64>();
            off_edges.extend(if sum(&same) < sum(&crossed) { same } else { crossed });
            let end = shaft.get("end_px").filter(|end| !end.is_null()).unwrap_or_else(|| panic!("{name}: {shaft}"));
            let [rim, to] = [0, 1].map(|at| center(&edges[0][at], &edges[1][at]));
            let width = (edges[0][1] - edges[1][1]).norm();
            off_joints.push((point(end) + (to - rim).normalize() * JOINT_AHEAD * width - labels.joint).norm());
        }
    }
    eprintln!("{} shafts: edges {off_edges:.1?} px, joints {off_joints:.1?} px", off_joints.len());
    assert_eq!(off_joints.len(), 6);
    assert!(median(&mut off_edges) <= 3.0 && median(&mut off_joints) <= 6.0, "{off_edges:?} {off_joints:?}");
}

#[test]
fn a_tool_that_is_not_in_the_picture_is_not_found() {
    let folder = tempfile::tempdir().unwrap();
    let mut picture = image::RgbImage::from_pixel(640, 360, image::Rgb([190, 190, 195]));
    // A black peg: it does not come from the picture's rim.
    for (x, y) in (300..330).flat_map(|x| (100..220).map(move |y| (x, y))) {
        picture.put_pixel(x, y, image::Rgb([25, 25, 27]));
    }
    picture.save(folder.path().join("still.png")).unwrap();
    let mark = |label: &str, x| json!({"frame": 0, "label": label, "x": x, "y": 120, "w": 20, "h": 60});
    let annotations = json!({
        "needs": 2, "video": "still.png", "labels": [mark("shaft", 305), mark("background", 500)],
        "tools": [{"tool": "left", "diameter_mm": 5.0, "marker": {"kind": "shaft"}}],
    });
    fs::write(folder.path().join("annotations.json"), annotations.to_string()).unwrap();
    let found = shafts(folder.path());
    assert_eq!(found.len(), 1);
    assert!(found[0]["edges_px"].is_null() && found[0]["reason"].is_string(), "{found:?}");
}
