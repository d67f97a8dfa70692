//! The files of a scene whose tools have no tape: its annotations, and a picture of the empty box.

use std::path::Path;

use anyhow::Context;
use serde::Serialize;

use super::scene::{CLIP, rectangle, view_of, write_photo};
use crate::domain::files::annotations::{LabelledRectangle, Side, View};
use crate::simulation::render::Photographer;
use crate::simulation::tool::SimulatedTool;
use crate::simulation::{Setup, World, marks};

/// File name of the empty box's picture in the folder.
pub const EMPTY_BOX: &str = "empty.jpg";

/// The version of the format that has markers of this kind.
const NEEDS: u32 = 2;

/// `annotations.json` of a scene with bare tools.
#[derive(Serialize)]
struct BareAnnotations {
    needs: u32,
    tool_diameter_mm: f64,
    view: View,
    video: &'static str,
    empty_box: &'static str,
    tools: Vec<BareToolEntry>,
    labels: Vec<LabelledRectangle>,
}

#[derive(Serialize)]
struct BareToolEntry {
    tool: &'static str,
    side: Side,
    diameter_mm: f64,
    marker: BareMarker,
}

#[derive(Serialize)]
struct BareMarker {
    kind: &'static str,
    /// Absent for a rod without a collar.
    #[serde(skip_serializing_if = "Option::is_none")]
    collar_mm: Option<f64>,
    /// Of a rod without jaws: 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    jaw_mm: Option<f64>,
}

/// The text of the annotations, with marks on frames of these times, s.
pub fn annotations_of(world: &World, setup: &Setup, times: &[f64]) -> anyhow::Result<String> {
    let file = BareAnnotations {
        needs: NEEDS,
        tool_diameter_mm: setup.diameter_mm,
        view: view_of(setup.view),
        video: CLIP,
        empty_box: EMPTY_BOX,
        tools: world.tools.iter().map(entry).collect(),
        labels: marks::mark_recording(world, times).into_iter().map(rectangle).collect(),
    };
    serde_json::to_string_pretty(&file).map(|text| text + "\n").context("cannot write the annotations")
}

fn entry(tool: &SimulatedTool) -> BareToolEntry {
    let collar_mm = Some(tool.design.collar_mm).filter(|length| *length > 0.0);
    BareToolEntry {
        tool: tool.name,
        side: if tool.name == "left" { Side::Left } else { Side::Right },
        diameter_mm: tool.design.diameter_mm,
        marker: BareMarker { kind: "shaft", collar_mm, jaw_mm: (tool.design.jaw_mm == 0.0).then_some(0.0) },
    }
}

/// Writes the picture of the box without its tools.
pub fn write_empty_box(folder: &Path, world: &World) -> anyhow::Result<()> {
    let scenery = world.empty_box();
    let photo = Photographer::new(&world.rig).take(|v| scenery.trace(v), world.seed);
    write_photo(&folder.join(EMPTY_BOX), &photo)
}
