//! Finds the strips of each bare tool on a frame, once the box has been learned. With the tools' trocars it is quicker
//! and surer.

use std::cell::OnceCell;
use std::collections::BTreeSet;

use nalgebra::{Point2, Vector2, Vector3};

use super::borders::StripRows;
use super::grid::{GridMap, UndistortedGrid};
use super::meeting_point::TrocarOfTool;
use super::search::{SearchLimits, search, width_limits};
use super::{Strip, end_step, meeting_point, outline};
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::segmentation::background::Background;
use crate::vision::segmentation::cells::{CellGrid, CellPicture};
use crate::vision::segmentation::shaft_colour::{AnyColour, ShaftColour};
use crate::vision::segmentation::shaft_evidence::ShaftAppearance;
use crate::vision::space::{HandSide, Pixel};

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
    /// The box was learned from a picture without tools.
    is_box_empty: bool,
}

impl StripFinder {
    /// Learns the box from frames spread over the recording, and from the picture of the empty box if there is one. No
    /// trocar is known then. `None` without frames, or if the lens model does not cover the picture.
    pub fn learn(
        camera: &Camera,
        shaft: ShaftColour,
        tools: &[BareTool],
        frames: &[CellPicture],
        empty: Option<&CellPicture>,
    ) -> Option<Self> {
        /// Frames for the colours of anything.
        const COLOUR_FRAMES: usize = 20;
        let any = AnyColour::new(spread(frames, COLOUR_FRAMES));
        let of_empty = empty.and_then(|empty| Background::from_empty(empty, frames, &shaft, &any));
        let is_box_empty = of_empty.is_some();
        let background = of_empty.or_else(|| Background::from_frames(frames, &shaft, &any))?;
        let grid = UndistortedGrid::new(camera)?;
        let inside = grid.inside();
        let appearance = ShaftAppearance { shaft, any, background };
        let tools = tools.iter().map(|tool| (*tool, None)).collect();
        Some(Self { grid, inside, appearance, tools, is_box_empty })
    }

    /// Finds the trocars of tools that turned about them by at least `min_turn` ([`meeting_point::turn`]). This
    /// searches many whole pictures, which takes seconds. Without a picture of the empty box, what is behind the jaws of
    /// these tools is learned again.
    pub fn find_trocars(&mut self, frames: &[CellPicture], min_turn: f64) {
        const TROCAR_FRAMES: usize = 20;
        let pictures: Vec<&CellPicture> = spread(frames, TROCAR_FRAMES).collect();
        let evidence: Vec<GridMap> = pictures.iter().map(|cells| self.evidence(cells)).collect();
        let strips = |tool: usize| evidence.iter().map(|evidence| self.strips(evidence, tool)).collect();
        let of_tools: Vec<Vec<Vec<Strip>>> = (0..self.tools.len()).map(strips).collect();
        let found = meeting_point::of_tools(of_tools, |at| self.may_be_trocar(at));
        for ((_, trocar), found) in self.tools.iter_mut().zip(&found) {
            *trocar = found.as_ref().filter(|found| found.turn >= min_turn).map(|found| found.at);
        }
        if !self.is_box_empty {
            self.learn_behind_jaws(&pictures, &found);
        }
    }

    /// Learns again what is behind the jaws of tools that are found on these pictures.
    fn learn_behind_jaws(&mut self, pictures: &[&CellPicture], found: &[Option<TrocarOfTool>]) {
        let covered = |frame: usize| {
            let tools = self.tools.iter().zip(found);
            let strips = tools.filter_map(|((tool, _), found)| Some((tool, found.as_ref()?.strips[frame].as_ref()?)));
            strips.flat_map(|(tool, strip)| self.cells_of_jaws(strip, tool.diameter_mm)).collect()
        };
        let frames: Vec<(&CellPicture, BTreeSet<usize>)> =
            pictures.iter().enumerate().map(|(frame, cells)| (*cells, covered(frame))).collect();
        let ShaftAppearance { shaft, any, background } = &mut self.appearance;
        background.learn_beside(&frames, shaft, any);
    }

    /// Cells of a frame that the jaws ahead of a strip's end may cover.
    fn cells_of_jaws(&self, strip: &Strip, diameter_mm: f64) -> BTreeSet<usize> {
        /// Longest jaws with their collar, mm, and the error of a rough end, widths.
        const JAWS_MM: f64 = 30.0;
        const END_WIDTHS: f64 = 1.0;
        /// How far open jaws reach from the axis, widths: next to the end, and at most, blades of 16 mm at 30°.
        const ASIDE_WIDTHS: (f64, f64) = (0.75, 1.75);
        let CellGrid { cell_px, columns, rows } = self.appearance.background.grid();
        let [entry, end] = [strip.entry, strip.end].map(|at| self.grid.place(at));
        let Some(along) = (end - entry).try_normalize(1e-9) else { return BTreeSet::new() };
        let (across, width) = (Vector2::new(-along.y, along.x), strip.width / self.grid.pitch);
        let aside = |ahead: f64| width * (ASIDE_WIDTHS.0 + 0.5 * (ahead / width).max(0.0)).min(ASIDE_WIDTHS.1);
        let [behind, ahead] = [-END_WIDTHS, END_WIDTHS + JAWS_MM / diameter_mm].map(|widths| widths * width);
        let halves = |from: f64, to: f64| ((2.0 * from) as i32..=(2.0 * to) as i32).map(|i| 0.5 * f64::from(i));
        let places = halves(behind, ahead)
            .flat_map(|ahead| halves(-aside(ahead), aside(ahead)).map(move |aside| along * ahead + across * aside));
        let cells = places.filter(|place| self.grid.is_inside(end + place)).map(|place| {
            let [x, y] = pixel_of(self.grid.pixel(end + place));
            (y / cell_px).min(rows - 1) * columns + (x / cell_px).min(columns - 1)
        });
        cells.collect()
    }

    /// Takes over the trocars that an earlier finder of the same tools knows and this one does not, unless this one has
    /// learned that they are another tool's.
    pub fn keep_trocars_of(&mut self, earlier: &Self) {
        let learned: Vec<Vector3<f64>> = self.tools.iter().filter_map(|(_, trocar)| *trocar).collect();
        let is_free = |at: &Vector3<f64>| learned.iter().all(|other| other.cross(at).norm() > meeting_point::MAX_MISS);
        for ((_, trocar), (_, known)) in self.tools.iter_mut().zip(&earlier.tools) {
            *trocar = trocar.or(known.filter(is_free));
        }
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

/// Which tools without a known trocar a frame may be searched for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SearchTurn {
    /// All of them, as often as their searches succeed: a recording waits.
    All,
    /// This one, at its place among the bare tools: the frames of a feed do not wait.
    One(usize),
    /// None of them.
    None,
}

/// The strips of one frame. The evidence is computed only if a tool must be searched for.
pub struct FrameStrips<'a> {
    finder: &'a StripFinder,
    frame: &'a Frame<'a>,
    turn: SearchTurn,
    cells: OnceCell<(CellPicture, GridMap)>,
}

/// Column and row of a pixel.
fn pixel_of(at: Pixel) -> [usize; 2] {
    [at.u() as usize, at.v() as usize]
}

impl<'a> FrameStrips<'a> {
    /// Of this frame.
    pub fn new(finder: &'a StripFinder, frame: &'a Frame<'a>, turn: SearchTurn) -> Self {
        Self { finder, frame, turn, cells: OnceCell::new() }
    }

    /// Is it the tool's turn to be searched for? `None` if it does not have to wait for its turn.
    pub fn is_turn_of(&self, tool: usize) -> Option<bool> {
        match self.turn {
            SearchTurn::All => None,
            _ if self.is_trocar_known(tool) => None,
            turn => Some(turn == SearchTurn::One(tool)),
        }
    }

    /// May every frame be searched for the tool? A recording waits for a search, and with a known trocar it is short.
    pub fn may_search_always(&self, tool: usize) -> bool {
        self.turn == SearchTurn::All && self.is_trocar_known(tool)
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

    /// Does the frame show the box without tools about a pixel, lit or in shade? `None` outside the picture, and where
    /// the box is unknown.
    pub fn shows_box(&self, at: Pixel) -> Option<bool> {
        Some(self.known_box(at)?.may_show(pixel_of(at), self.mean_about(at)?))
    }

    /// The same of the box as it is usually lit.
    pub fn shows_lit_box(&self, at: Pixel) -> Option<bool> {
        Some(self.known_box(at)?.may_show_lit(pixel_of(at), self.mean_about(at)?))
    }

    /// Does the box without tools look otherwise at one pixel than about another? `None` outside the picture, and where
    /// the box is unknown.
    pub fn box_changes(&self, one: Pixel, other: Pixel) -> Option<bool> {
        self.known_box(one)?;
        Some(self.known_box(other)?.changes_between(pixel_of(one), pixel_of(other)))
    }

    /// The box, if it is known at a pixel of the picture.
    fn known_box(&self, at: Pixel) -> Option<&Background> {
        let (width, height) = (self.frame.width() as f64, self.frame.height() as f64);
        let is_inside = (0.0..width).contains(&at.u()) && (0.0..height).contains(&at.v());
        Some(self.background()).filter(|background| is_inside && background.is_known_at(pixel_of(at)))
    }

    fn background(&self) -> &Background {
        &self.finder.appearance.background
    }

    /// Mean codes of a square about a pixel, as large as a cell. `None` if it is not all in the picture.
    fn mean_about(&self, at: Pixel) -> Option<[f32; 3]> {
        let half = 0.5 * self.background().cell_px() as f64;
        let [left, top, right, bottom] = [at.u() - half, at.v() - half, at.u() + half, at.v() + half];
        if left < 0.0 || top < 0.0 || right >= self.frame.width() as f64 || bottom >= self.frame.height() as f64 {
            return None;
        }
        let rows = top as usize..=bottom as usize;
        let pixels = rows.flat_map(|y| (left as usize..=right as usize).map(move |x| (x, y)));
        let (count, sum) = pixels.fold((0.0f32, [0.0f32; 3]), |(count, sum), (x, y)| {
            let codes = self.frame.yuv_at(x, y).map(f32::from);
            (count + 1.0, std::array::from_fn(|part| sum[part] + codes[part]))
        });
        Some(sum.map(|sum| sum / count))
    }

    /// Rows across a strip.
    pub fn rows_across<'b>(&'b self, camera: &Camera, strip: &'b Strip) -> StripRows<'b> {
        StripRows::read(self.frame, camera, &self.finder.appearance, strip)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::STRAIGHT;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::cells::CellGrid;

    fn finder() -> StripFinder {
        let grid = CellGrid::new(STRAIGHT.width as usize, STRAIGHT.height as usize);
        let frame = CellPicture { grid, codes: vec![[150, 128, 128]; grid.count()] };
        let shaft = ShaftColour::new(&[[30, 128, 128]]).unwrap();
        let tools = [HandSide::Left, HandSide::Right].map(|side| BareTool { side: Some(side), diameter_mm: 5.0 });
        StripFinder::learn(&STRAIGHT, shaft, &tools, &[frame], None).unwrap()
    }

    #[test]
    fn jaws_lie_ahead_of_the_end_of_a_strip() {
        let finder = finder();
        let at = |u: f64, v: f64| STRAIGHT.normalised_of(Pixel::new(u, v)).unwrap();
        let (width, height) = (f64::from(STRAIGHT.width), f64::from(STRAIGHT.height));
        let (entry, end) = (at(1.0, 0.5 * height), at(0.4 * width, 0.5 * height));
        let strip = Strip {
            borders: [[entry.0, end.0]; 2],
            entry,
            end,
            width: 20.0 / STRAIGHT.fx,
            length_widths: 10.0,
            score: 1.0,
            net_evidence: 1.0,
            supported_share: 1.0,
            end_step_codes: None,
        };
        let cells = finder.cells_of_jaws(&strip, 5.0);
        let grid = finder.appearance.background.grid();
        let covers = |ahead_px: f64, aside_px: f64| {
            let [x, y] = [0.4 * width + ahead_px, 0.5 * height + aside_px].map(|px| px as usize / grid.cell_px);
            cells.contains(&(y * grid.columns + x))
        };
        assert!(covers(0.0, 8.0) && covers(60.0, -25.0) && covers(115.0, 0.0), "20 px are 5 mm");
        assert!(!covers(-40.0, 0.0) && !covers(60.0, 50.0) && !covers(160.0, 0.0));
    }

    /// Calls `with` on an even frame.
    fn with_frame<T>(with: impl Fn(&Frame<'_>) -> T) -> T {
        let samples = [150; 16];
        let plane = Plane { data: &samples, stride: 4, width: 4, height: 4 };
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: plane,
            u: plane,
            v: plane,
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding: ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 },
        };
        with(&frame)
    }

    #[test]
    fn trocars_stay_known_until_others_are_found() {
        let [left, right, after] = [Vector3::x(), Vector3::z(), Vector3::y()];
        let (mut known, mut learned) = (finder(), finder());
        known.tools[0].1 = Some(left);
        known.tools[1].1 = Some(right);
        learned.tools[1].1 = Some(after);
        learned.keep_trocars_of(&known);
        assert_eq!([learned.tools[0].1, learned.tools[1].1], [Some(left), Some(after)]);
        let mut learned = finder();
        learned.tools[1].1 = Some(left);
        learned.keep_trocars_of(&known);
        assert_eq!(learned.tools[0].1, None, "it was the other tool's");
    }

    #[test]
    fn a_recording_is_always_searched_for_a_tool_with_a_known_trocar() {
        let mut finder = finder();
        finder.tools[0].1 = Some(Vector3::x());
        let may = |turn| {
            with_frame(|frame| [0, 1].map(|tool| FrameStrips::new(&finder, frame, turn).may_search_always(tool)))
        };
        assert_eq!(may(SearchTurn::All), [true, false]);
        assert_eq!(may(SearchTurn::One(0)), [false, false]);
    }

    #[test]
    fn only_tools_without_a_known_trocar_wait_for_their_turn() {
        let mut finder = finder();
        finder.tools[0].1 = Some(Vector3::x());
        let turns =
            |turn| with_frame(|frame| [0, 1].map(|tool| FrameStrips::new(&finder, frame, turn).is_turn_of(tool)));
        assert_eq!(turns(SearchTurn::All), [None, None]);
        assert_eq!(turns(SearchTurn::One(0)), [None, Some(false)]);
        assert_eq!(turns(SearchTurn::One(1)), [None, Some(true)]);
        assert_eq!(turns(SearchTurn::None), [None, Some(false)]);
    }
}
