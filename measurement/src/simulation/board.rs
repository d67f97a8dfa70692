//! The fixed scenery of the box: a coloured mat with printed guides, walls, and objects on the mat.

use nalgebra::{Isometry3, Point3, Vector3};

use super::checkerboard::HeldBoard;
use super::light::{LAMP_COUNT, Lighting, Material, Rgb, SplitRadiance};
use super::shape::RoundCone;
use crate::random::Dice;

/// Half the inside of the box, mm: x, y far, y near.
const WALLS: (f64, f64, f64) = (160.0, -128.0, 185.0);
/// Half the mat, mm.
const MAT: (f64, f64) = (126.0, 96.0);
const CELL_MM: f64 = 31.5;
const COLUMNS: usize = 8;
const ROWS: usize = 6;

const COLOURS: [Rgb; 6] = [
    [0.42, 0.04, 0.05],
    [0.06, 0.24, 0.09],
    [0.04, 0.075, 0.33],
    [0.64, 0.42, 0.05],
    [0.2, 0.065, 0.25],
    [0.5, 0.47, 0.42],
];
const PAPER: Rgb = [0.56, 0.54, 0.5];
const RUBBER: Rgb = [0.1, 0.1, 0.105];
const WALL: Rgb = [0.5, 0.48, 0.45];

/// A line printed on the mat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// From, mm on the mat.
    pub from: (f64, f64),
    /// To, mm on the mat.
    pub to: (f64, f64),
    /// Width, mm.
    pub width: f64,
    /// Matt reflectance.
    pub colour: Rgb,
}

/// A solid in the box that no tool carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prop {
    /// Its shape.
    pub solid: RoundCone,
    /// Its surface.
    pub material: Material,
}

/// Everything in the box that does not move.
#[derive(Clone, Debug)]
pub struct Scenery {
    board_from_camera: Isometry3<f64>,
    eye: Point3<f64>,
    lighting: Lighting,
    cells: [[MatCell; COLUMNS]; ROWS],
    strokes: Vec<Stroke>,
    props: Vec<Prop>,
    /// A printed checkerboard, and the inverse of its pose.
    sheet: Option<(HeldBoard, Isometry3<f64>)>,
}

#[derive(Clone, Copy, Debug)]
struct MatCell {
    form: MatFigure,
    ground: Rgb,
    figure: Rgb,
}

#[derive(Clone, Copy, Debug)]
enum MatFigure {
    Triangle { falling: bool },
    Disc,
    Ring,
    Diamond,
}

/// The first surface point along a camera ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Radiance, with a separate share for each lamp; shadows of the scenery's props are already subtracted.
    pub lit: SplitRadiance,
    /// Depth, mm.
    pub depth: f64,
}

impl Scenery {
    /// The scenery of one box (`number` seeds the mat), with a task's props (board frame) and printed lines, seen by
    /// this camera.
    pub fn new(
        number: u64,
        camera_from_board: &Isometry3<f64>,
        lighting: Lighting,
        props: Vec<Prop>,
        strokes: Vec<Stroke>,
    ) -> Self {
        let board_from_camera = camera_from_board.inverse();
        Self {
            board_from_camera,
            eye: board_from_camera * Point3::origin(),
            lighting,
            cells: cells(&mut Dice::new(number, "mat")),
            strokes,
            props: props.into_iter().map(|prop| prop.moved_by(camera_from_board)).collect(),
            sheet: None,
        }
    }

    /// The same scenery with a printed checkerboard instead of the mat.
    pub fn with_sheet(self, held: HeldBoard) -> Self {
        Self { sheet: Some((held, held.camera_from_sheet.inverse())), ..self }
    }

    /// The same scenery with more props; camera frame.
    pub fn with_props(mut self, props: impl IntoIterator<Item = Prop>) -> Self {
        self.props.extend(props);
        self
    }

    /// The first surface point that the ray `v = (x, y, 1)` meets.
    pub fn trace(&self, v: Vector3<f64>) -> SurfacePoint {
        let (mut depth, mut normal, mut material, mut own) = {
            let (depth, normal, material) = self.meet_box(v);
            (depth, normal, material, None)
        };
        let on_sheet = self.sheet.as_ref().and_then(|(held, sheet_from_camera)| held.meet_ray(sheet_from_camera, v));
        if let Some(met) = on_sheet.filter(|met| met.0 < depth) {
            (depth, normal, material) = met;
        }
        for (index, prop) in self.props.iter().enumerate() {
            if let Some(met) = prop.solid.meet(v).filter(|met| met.depth < depth) {
                (depth, normal, material, own) = (met.depth, met.normal, prop.material, Some(index));
            }
        }
        let point = Point3::from(v * depth);
        let mut lit = self.lighting.reflect(point, normal, v, &material);
        let hidden = self.hidden_by_props(point, own);
        for (rgb, hidden) in lit.from_lamp.iter_mut().zip(hidden) {
            *rgb = rgb.map(|c| c * (1.0 - hidden as f32));
        }
        SurfacePoint { lit, depth }
    }

    /// Depth of a prop in front of `depth` on this ray, if any.
    pub fn prop_before(&self, v: Vector3<f64>, depth: f64) -> Option<f64> {
        self.props.iter().filter_map(|p| p.solid.meet(v)).map(|met| met.depth).find(|d| *d < depth)
    }

    fn hidden_by_props(&self, point: Point3<f64>, own: Option<usize>) -> [f64; LAMP_COUNT] {
        self.lighting.lamps.map(|lamp| {
            let others = self.props.iter().enumerate().filter(|(index, _)| Some(*index) != own);
            others.map(|(_, prop)| lamp.hidden(point, &prop.solid)).sum::<f64>().min(1.0)
        })
    }

    /// The point on floor or walls: the nearest of the five planes ahead of the ray.
    fn meet_box(&self, v: Vector3<f64>) -> (f64, Vector3<f64>, Material) {
        let way = self.board_from_camera * v;
        let planes = [
            (-self.eye.z / way.z, Vector3::new(0.0, 0.0, -1.0)),
            ((WALLS.0 - self.eye.x) / way.x, Vector3::new(-1.0, 0.0, 0.0)),
            ((-WALLS.0 - self.eye.x) / way.x, Vector3::new(1.0, 0.0, 0.0)),
            ((WALLS.1 - self.eye.y) / way.y, Vector3::new(0.0, 1.0, 0.0)),
            ((WALLS.2 - self.eye.y) / way.y, Vector3::new(0.0, -1.0, 0.0)),
        ];
        let towards = planes.into_iter().filter(|(depth, inwards)| *depth > 0.0 && inwards.dot(&way) < 0.0);
        let (depth, inwards) = towards.min_by(|p, q| p.0.total_cmp(&q.0)).unwrap_or((1e4, -way.normalize()));
        let at = self.eye + way * depth;
        let (colour, gloss) = if inwards.z < 0.0 { self.floor(at.x, at.y) } else { (wall(at), 0.03) };
        let colour = colour.map(|c| c * corner_shade(at));
        let normal = self.board_from_camera.rotation.inverse() * inwards;
        (depth, normal, Material { matt: colour, gloss, sharpness: 12, mirror: 0.01 })
    }

    fn floor(&self, x: f64, y: f64) -> (Rgb, f32) {
        if self.sheet.is_some() || x.abs() > MAT.0 || y.abs() > MAT.1 {
            return (RUBBER.map(|c| c * grain(x, y, 1.4, 0.25)), 0.05);
        }
        let stroke = self.strokes.iter().rev().find(|s| s.covers(x, y));
        let printed = stroke.map_or_else(|| self.mat(x, y), |s| s.colour);
        (printed.map(|c| c * grain(x, y, 0.8, 0.05) * grain(x, y, 9.0, 0.06)), 0.06)
    }

    fn mat(&self, x: f64, y: f64) -> Rgb {
        const GRID_LINE_MM: f64 = 0.9;
        let (column, row) = ((x + MAT.0) / CELL_MM, (y + MAT.1 - 1.5) / CELL_MM);
        let (u, v) = (column - column.floor(), row - row.floor());
        let edge = GRID_LINE_MM / CELL_MM;
        let inside = (0.0..ROWS as f64).contains(&row) && column < COLUMNS as f64;
        if !inside || u < edge || v < edge {
            return PAPER;
        }
        let cell = &self.cells[row as usize][column as usize];
        if cell.form.covers(u - 0.5, v - 0.5) { cell.figure } else { cell.ground }
    }
}

impl Prop {
    /// The prop after a rigid motion.
    pub fn moved_by(self, motion: &Isometry3<f64>) -> Self {
        let solid = RoundCone { a: motion * self.solid.a, b: motion * self.solid.b, ..self.solid };
        Self { solid, ..self }
    }
}

impl Stroke {
    fn covers(&self, x: f64, y: f64) -> bool {
        let (dx, dy) = (self.to.0 - self.from.0, self.to.1 - self.from.1);
        let (px, py) = (x - self.from.0, y - self.from.1);
        let share = ((px * dx + py * dy) / (dx * dx + dy * dy).max(1e-9)).clamp(0.0, 1.0);
        (px - dx * share).hypot(py - dy * share) <= 0.5 * self.width
    }
}

impl MatFigure {
    /// True if the point (−½..½) is part of the figure.
    fn covers(self, u: f64, v: f64) -> bool {
        match self {
            MatFigure::Triangle { falling } => {
                if falling {
                    v > u
                } else {
                    v > -u
                }
            }
            MatFigure::Disc => u.hypot(v) < 0.36,
            MatFigure::Ring => (0.2..0.38).contains(&u.hypot(v)),
            MatFigure::Diamond => u.abs() + v.abs() < 0.44,
        }
    }
}

fn cells(dice: &mut Dice) -> [[MatCell; COLUMNS]; ROWS] {
    let mut cell = || {
        let (ground, step) = (dice.pick(COLOURS.len()), 1 + dice.pick(COLOURS.len() - 1));
        let form = match dice.pick(6) {
            0 => MatFigure::Disc,
            1 => MatFigure::Ring,
            2 => MatFigure::Diamond,
            n => MatFigure::Triangle { falling: n == 3 },
        };
        MatCell { form, ground: COLOURS[ground], figure: COLOURS[(ground + step) % COLOURS.len()] }
    };
    std::array::from_fn(|_| std::array::from_fn(|_| cell()))
}

fn wall(at: Point3<f64>) -> Rgb {
    WALL.map(|c| c * grain(at.x + at.y, at.z, 1.6, 0.04) * grain(at.x - at.y, at.z, 24.0, 0.05))
}

/// Factor on the ambient light: less of it reaches the corners of the box.
fn corner_shade(at: Point3<f64>) -> f32 {
    let mut gaps = [WALLS.0 - at.x.abs(), at.y - WALLS.1, WALLS.2 - at.y, -at.z];
    gaps.sort_by(f64::total_cmp);
    (1.0 - 0.4 * (-gaps[1].max(0.0) / 16.0).exp()) as f32 // gaps[0] is the surface that the point lies on
}

/// Texture of a surface: smooth noise with blobs of `size` mm, between `1 − depth` and `1 + depth`.
fn grain(x: f64, y: f64, size: f64, depth: f32) -> f32 {
    let (x, y) = (x / size, y / size);
    let (column, row) = (x.floor(), y.floor());
    let (u, v) = ((x - column) as f32, (y - row) as f32);
    let (u, v) = (u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v));
    let corner = |dx: i64, dy: i64| lattice(column as i64 + dx, row as i64 + dy);
    let near = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * u;
    let far = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * u;
    1.0 + depth * (near + (far - near) * v)
}

/// A fixed value in −1..1 for every lattice point (a 64-bit mix of its coordinates).
fn lattice(column: i64, row: i64) -> f32 {
    let mut bits =
        (column as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (row as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    bits = (bits ^ (bits >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((bits >> 40) as f32) / (1u32 << 23) as f32 - 1.0
}
