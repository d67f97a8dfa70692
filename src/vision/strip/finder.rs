//! Finds the strips of each bare tool on a frame, once the box and the tools' trocars have been learned.

use std::cell::OnceCell;

use nalgebra::{Point2, Vector3};

use super::grid::{GridMap, UndistortedGrid};
use super::search::{SearchLimits, search, width_limits};
use super::{Strip, borders, end_step, meeting_point, outline};
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::segmentation::background::Background;
use crate::vision::segmentation::cells::CellPicture;
use crate::vision::segmentation::shaft_colour::{AnyColour, ShaftColour};
use crate::vision::segmentation::shaft_evidence::ShaftAppearance;
use crate::vision::space::HandSide;

/// Strips whose outline is fitted on each frame.
const CANDIDATES: usize = 3;

/// A bare tool to be found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BareTool {
    /// The side of the picture where its hand is.
    pub side: Option<HandSide>,
    /// Diameter, mm.
    pub diameter_mm: f64,
}

/// Finds strips.
#[derive(Clone)]
pub struct StripFinder {
    grid: UndistortedGrid,
    inside: GridMap,
    appearance: ShaftAppearance,
    tools: Vec<(BareTool, Option<Vector3<f64>>)>,
}

impl StripFinder {
    /// Learns the box and the tools' trocars from frames spread over the recording, and from the picture of the empty
    /// box if there is one. `None` without frames, or if the lens model does not cover the picture.
    pub fn learn(
        camera: &Camera,
        shaft: ShaftColour,
        tools: &[BareTool],
        frames: &[CellPicture],
        empty: Option<&CellPicture>,
    ) -> Option<Self> {
        /// Frames for the colours of anything, and for the trocars.
        const COLOUR_FRAMES: usize = 20;
        const TROCAR_FRAMES: usize = 20;
        let any = AnyColour::new(spread(frames, COLOUR_FRAMES));
        let background = empty
            .and_then(|empty| Background::from_empty(empty, frames, &shaft, &any))
            .or_else(|| Background::from_frames(frames, &shaft, &any))?;
        let grid = UndistortedGrid::new(camera)?;
        let inside = grid.inside();
        let appearance = ShaftAppearance { shaft, any, background };
        let mut finder = Self { grid, inside, appearance, tools: tools.iter().map(|tool| (*tool, None)).collect() };
        let spread: Vec<GridMap> = spread(frames, TROCAR_FRAMES).map(|cells| finder.evidence(cells)).collect();
        for tool in 0..tools.len() {
            let found: Vec<Vec<Strip>> = spread.iter().map(|evidence| finder.strips(evidence, tool)).collect();
            finder.tools[tool].1 = meeting_point::find(&found, |at| finder.may_be_trocar(at));
        }
        Some(finder)
    }

    /// Evidence on the undistorted grid.
    fn evidence(&self, cells: &CellPicture) -> GridMap {
        self.grid.undistorted(&self.appearance.evidence(cells))
    }

    /// The strips that may be a tool, the best first.
    fn strips(&self, evidence: &GridMap, tool: usize) -> Vec<Strip> {
        /// A border is a fifth of a cell off, so an outlined strip may miss the trocar by a third more than a rough one.
        const OUTLINED_MISS: f64 = meeting_point::MAX_MISS * 4.0 / 3.0;
        let (BareTool { side, diameter_mm }, trocar) = self.tools[tool];
        let limits = SearchLimits { side, diameter_mm, trocar: trocar.map(|at| (at, meeting_point::MAX_MISS)) };
        let widths = width_limits(&self.grid, diameter_mm);
        let rough = search(&self.grid, evidence, &limits, CANDIDATES);
        let outlined =
            rough.iter().filter_map(|rough| outline::outline(&self.grid, evidence, &self.inside, rough, widths));
        let passes = |strip: &Strip| trocar.is_none_or(|at| strip.plane().dot(&at).abs() < OUTLINED_MISS);
        let mut strips: Vec<Strip> = outlined.filter(|strip| strip.is_believable() && passes(strip)).collect();
        strips.sort_by(|one, other| other.score.total_cmp(&one.score));
        strips
    }

    /// Can a trocar be there? A place in the middle of the picture is none: the box's wall would be in sight.
    fn may_be_trocar(&self, at: Vector3<f64>) -> bool {
        /// Part of the grid's width and height on each side where a trocar may be in sight.
        const RIM: f64 = 0.12;
        if at.z.abs() < 1e-6 {
            return true;
        }
        let place = self.grid.place(crate::vision::space::Normalised(Point2::from(at.xy() / at.z)));
        let is_middle = |at: f64, size: usize| (RIM..1.0 - RIM).contains(&(at / size as f64));
        !(is_middle(place.x, self.grid.columns) && is_middle(place.y, self.grid.rows))
    }
}

/// The strips of one frame. The evidence is computed only if a tool must be searched for.
pub struct FrameStrips<'a> {
    finder: &'a StripFinder,
    frame: &'a Frame<'a>,
    cells: OnceCell<(CellPicture, GridMap)>,
}

impl<'a> FrameStrips<'a> {
    /// Of this frame.
    pub fn new(finder: &'a StripFinder, frame: &'a Frame<'a>) -> Self {
        Self { finder, frame, cells: OnceCell::new() }
    }

    /// Is the point through which the tool's strips pass known? A search without it takes ten times as long.
    pub fn is_trocar_known(&self, tool: usize) -> bool {
        self.finder.tools[tool].1.is_some()
    }

    /// Is a shaft likelier than anything else to show these codes?
    pub fn is_shaft_colour(&self, codes: [u8; 3]) -> bool {
        let ShaftAppearance { shaft, any, .. } = &self.finder.appearance;
        let codes = codes.map(f32::from);
        shaft.log_density(codes) > any.log_density(codes)
    }

    /// The strip with each likely pair of borders, the likeliest first.
    pub fn with_likely_borders(&self, camera: &Camera, strip: &Strip) -> Vec<Strip> {
        borders::with_likely_borders(self.frame, camera, &self.finder.appearance, strip)
    }

    /// The strips that may be a tool, the best first.
    pub fn of_tool(&self, tool: usize) -> Vec<Strip> {
        let (cells, evidence) = self.cells.get_or_init(|| {
            let cells = CellPicture::of(self.frame);
            let evidence = self.finder.evidence(&cells);
            (cells, evidence)
        });
        let strips = self.finder.strips(evidence, tool);
        strips.into_iter().map(|strip| end_step::with_end_at_step(&self.finder.grid, cells, strip)).collect()
    }
}

/// At most `count` of the pictures, evenly spread.
fn spread(frames: &[CellPicture], count: usize) -> impl Iterator<Item = &CellPicture> {
    let count = count.min(frames.len());
    (0..count).map(move |i| &frames[i * (frames.len() - 1) / (count.max(2) - 1)])
}
