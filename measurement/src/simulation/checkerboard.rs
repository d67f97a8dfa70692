//! Photos of a checkerboard held in front of the box's camera, for its calibration; on request, some with a bent board.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::board::SurfacePoint;
use super::light::{Lighting, Material, Rgb};
use super::render::{Photo, Photographer};
use super::rig::Rig;
use crate::random::Dice;
use crate::vision::space::CameraPoint;

/// Inner corners across.
pub const COLUMNS: usize = 9;
/// Inner corners down.
pub const ROWS: usize = 6;
/// Side of a square, mm.
pub const SQUARE_MM: f64 = 21.0;

/// White paper around the outer squares, mm.
const MARGIN_MM: f64 = 16.0;
const BLACK_INK: Rgb = [0.025, 0.025, 0.026];
const WHITE_PAPER: Rgb = [0.72, 0.72, 0.7];

/// A board with its pose and bend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBoard {
    /// Sheet frame (x along the longer side, y along the shorter, origin in the middle) → camera frame, mm.
    pub camera_from_sheet: Isometry3<f64>,
    /// Curvature of the sheet along `bend_direction`, 1/mm; 0 for a flat board.
    pub bend: f64,
    /// Unit vector in the sheet across the fold.
    pub bend_direction: (f64, f64),
}

/// Boards for a calibration, each whole in the picture, at many angles, distances and positions. The last `bent` boards
/// are slightly bent.
pub fn poses(rig: &Rig, seed: u64, count: usize, bent: usize) -> Vec<HeldBoard> {
    let mut dice = Dice::new(seed, "boards");
    (0..count).map(|i| pose(rig, &mut dice, i, i + bent >= count)).collect()
}

/// The photo of a held board.
pub fn photo(photographer: &Photographer, lighting: &Lighting, held: &HeldBoard, seed: u64) -> Photo {
    let sheet_from_camera = held.camera_from_sheet.inverse();
    photographer.take(|v| trace(held, &sheet_from_camera, lighting, v), seed)
}

/// Position of an inner corner; column 0..9, row 0..6; camera frame, mm.
pub fn corner(held: &HeldBoard, column: usize, row: usize) -> Point3<f64> {
    let x = (column as f64 - 0.5 * (COLUMNS - 1) as f64) * SQUARE_MM;
    let y = (row as f64 - 0.5 * (ROWS - 1) as f64) * SQUARE_MM;
    held.camera_from_sheet * Point3::new(x, y, held.sag(x, y))
}

fn pose(rig: &Rig, dice: &mut Dice, index: usize, bent: bool) -> HeldBoard {
    const TRIES: usize = 4000;
    let mut found = None;
    for _ in 0..TRIES {
        let held = random_board(dice, index, bent);
        if in_picture(rig, &held) {
            return held;
        }
        found = Some(held);
    }
    // The picture is too narrow for a whole board: part of it is seen.
    found.unwrap_or_else(|| random_board(dice, index, bent))
}

fn random_board(dice: &mut Dice, index: usize, bent: bool) -> HeldBoard {
    let tilt = Vector3::new(dice.within(-0.62, 0.62), dice.within(-0.62, 0.62), 0.0);
    // Most boards are held upright; every fourth is rotated by 90°, 180° or 270°.
    let quarters = if index % 4 == 3 { 1.0 + (index / 4 % 3) as f64 } else { 0.0 };
    let roll = std::f64::consts::FRAC_PI_2 * quarters + dice.within(-0.35, 0.35);
    let turn = Rotation3::new(tilt) * Rotation3::from_axis_angle(&Vector3::z_axis(), roll);
    let z = dice.within(175.0, 330.0);
    let middle = Translation3::new(dice.within(-0.5, 0.5) * z, dice.within(-0.32, 0.32) * z, z);
    let fold = dice.within(-0.5, 0.5);
    let bend = if bent { dice.within(0.9e-3, 1.5e-3) * if dice.chance(0.5) { 1.0 } else { -1.0 } } else { 0.0 };
    HeldBoard {
        camera_from_sheet: Isometry3::from_parts(middle, UnitQuaternion::from_rotation_matrix(&turn)),
        bend,
        bend_direction: (fold.cos(), fold.sin()),
    }
}

/// True if the whole sheet is in the picture, with a small margin.
fn in_picture(rig: &Rig, held: &HeldBoard) -> bool {
    let (half_width, half_height) = half_sheet();
    let (width, height) = (f64::from(rig.camera.width), f64::from(rig.camera.height));
    let spare = 0.008 * width;
    let edge = [(-1.0, -1.0), (0.0, -1.0), (1.0, -1.0), (-1.0, 0.0), (1.0, 0.0), (-1.0, 1.0), (0.0, 1.0), (1.0, 1.0)];
    edge.into_iter().all(|(x, y)| {
        let (x, y) = (x * half_width, y * half_height);
        let point = CameraPoint(held.camera_from_sheet * Point3::new(x, y, held.sag(x, y)));
        let near = point.normalised().is_some_and(|n| n.0.coords.norm() < 1.2);
        let inside = |u: f64, v: f64| u > spare && v > spare && u < width - spare && v < height - spare;
        near && rig.camera.project(point).is_some_and(|p| inside(p.u(), p.v()))
    })
}

fn half_sheet() -> (f64, f64) {
    (0.5 * (COLUMNS + 1) as f64 * SQUARE_MM + MARGIN_MM, 0.5 * (ROWS + 1) as f64 * SQUARE_MM + MARGIN_MM)
}

impl HeldBoard {
    /// Height of the bent sheet over its flat middle, mm.
    fn sag(&self, x: f64, y: f64) -> f64 {
        let across = x * self.bend_direction.0 + y * self.bend_direction.1;
        0.5 * self.bend * across * across
    }

    /// Intersection of a ray, in the sheet's frame, with the sheet: Newton's method on the ray's height over the sheet.
    fn meet(&self, eye: Point3<f64>, way: Vector3<f64>) -> Option<(f64, Point3<f64>)> {
        const STEPS: usize = 6; // the sheet is nearly flat: two would be enough
        let mut depth = -eye.z / way.z;
        for _ in 0..STEPS {
            let at = eye + way * depth;
            let across = at.x * self.bend_direction.0 + at.y * self.bend_direction.1;
            let slope = way.z - self.bend * across * (way.x * self.bend_direction.0 + way.y * self.bend_direction.1);
            depth -= (at.z - self.sag(at.x, at.y)) / slope;
        }
        let at = eye + way * depth;
        let (half_width, half_height) = half_sheet();
        let on_sheet = at.x.abs() < half_width && at.y.abs() < half_height;
        (depth.is_finite() && depth > 0.0 && on_sheet).then_some((depth, at))
    }
}

fn trace(held: &HeldBoard, sheet_from_camera: &Isometry3<f64>, lighting: &Lighting, v: Vector3<f64>) -> SurfacePoint {
    const TABLE_MM: f64 = 700.0;
    let met = held.meet_ray(sheet_from_camera, v);
    let (depth, normal, material) = met.unwrap_or((TABLE_MM, -Vector3::z(), paper([0.5, 0.42, 0.33])));
    SurfacePoint { lit: lighting.reflect(Point3::from(v * depth), normal, v, &material), depth }
}

impl HeldBoard {
    /// A flat board in this pose (sheet frame → camera frame).
    pub fn flat(camera_from_sheet: Isometry3<f64>) -> Self {
        Self { camera_from_sheet, bend: 0.0, bend_direction: (1.0, 0.0) }
    }

    /// Intersection of a camera ray with the sheet: depth, normal in the camera frame, and the printed material.
    pub fn meet_ray(
        &self,
        sheet_from_camera: &Isometry3<f64>,
        v: Vector3<f64>,
    ) -> Option<(f64, Vector3<f64>, Material)> {
        let (eye, way) = (sheet_from_camera * Point3::origin(), sheet_from_camera * v);
        let (depth, at) = self.meet(eye, way)?;
        Some((depth, self.camera_from_sheet * self.normal(at, way), paper(print(at))))
    }

    /// Unit normal on the side of the ray's origin; sheet frame.
    fn normal(&self, at: Point3<f64>, way: Vector3<f64>) -> Vector3<f64> {
        let slope = self.bend * (at.x * self.bend_direction.0 + at.y * self.bend_direction.1);
        let normal = Vector3::new(-slope * self.bend_direction.0, -slope * self.bend_direction.1, 1.0).normalize();
        if normal.dot(&way) < 0.0 { normal } else { -normal }
    }
}

fn paper(matt: Rgb) -> Material {
    Material { matt, gloss: 0.05, sharpness: 10, mirror: 0.01 }
}

fn print(at: Point3<f64>) -> Rgb {
    let column = (at.x / SQUARE_MM + 0.5 * (COLUMNS + 1) as f64).floor();
    let row = (at.y / SQUARE_MM + 0.5 * (ROWS + 1) as f64).floor();
    let on_board = (0.0..=COLUMNS as f64).contains(&column) && (0.0..=ROWS as f64).contains(&row);
    if on_board && (column + row) as i64 % 2 == 0 { BLACK_INK } else { WHITE_PAPER }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::RigView;

    #[test]
    fn a_ray_through_a_corner_meets_the_sheet_there_bent_or_not() {
        let rig = Rig::new(1, RigView::Top, 640, 360);
        for held in poses(&rig, 4, 8, 3) {
            let corner = corner(&held, 8, 0);
            let sheet_from_camera = held.camera_from_sheet.inverse();
            let (eye, way) = (sheet_from_camera * Point3::origin(), sheet_from_camera * (corner.coords / corner.z));
            let (depth, _) = held.meet(eye, way).unwrap();
            assert!((depth - corner.z).abs() < 1e-6, "met at {depth}, corner at {}", corner.z);
        }
    }

    #[test]
    fn every_board_lies_whole_in_the_picture_and_the_last_ones_are_bent() {
        let rig = Rig::new(1, RigView::Top, 1280, 720);
        let boards = poses(&rig, 1, 19, 3);
        assert!(boards.iter().all(|held| in_picture(&rig, held)));
        let bent: Vec<bool> = boards.iter().map(|held| held.bend != 0.0).collect();
        assert_eq!(bent, [vec![false; 16], vec![true; 3]].concat());
    }
}
