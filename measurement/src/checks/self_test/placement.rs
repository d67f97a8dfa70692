//! Finds where and when the board lay still.
//!
//! In: [`BoardSighting`]s in order of time. Out: [`BoardPlacement`]s: runs of sightings that agree to [`STILL_MM`]. A
//! board that is carried has no two sightings that agree, and gives no placement. The corners of a placement are the
//! mean over its sightings, which reduces the noise.

use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use super::board_watch::{BoardSighting, possible_orders};
use crate::numbers::quantile::quantile;
use crate::vision::camera::board_pose::locate;
use crate::vision::camera::{Board, Camera};
use crate::vision::space::Pixel;

/// The board lies still if two sightings differ by less than this, mean over its corners, mm. Noise moves the mean of
/// 54 corners by a few micrometres and a rod's shadow by some 20; a larger slip would count as an error of the rod.
const STILL_MM: f64 = 0.25;

/// A board that lies still.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardPlacement {
    /// First sighting, s.
    pub from_s: f64,
    /// Last sighting, s.
    pub to_s: f64,
    /// Number of sightings that agree.
    pub sightings: usize,
    /// Pose, mm: z runs through the board, away from the camera.
    pub camera_from_board: Isometry3<f64>,
    /// Root mean square reprojection error of the corners, median over the sightings, px.
    pub rms_px: f64,
    /// Mean corners, px.
    pub corners: Vec<Pixel>,
}

impl BoardPlacement {
    /// Unit normal, towards the camera.
    pub fn normal(&self) -> Vector3<f64> {
        -(self.camera_from_board.rotation * Vector3::z())
    }

    /// An inner corner in the camera frame, mm.
    pub fn corner_mm(&self, board: Board, index: usize) -> Point3<f64> {
        let on_board = board.points_mm()[index];
        self.camera_from_board * Point3::new(on_board.x, on_board.y, 0.0)
    }

    /// True if the board was seen here both before `from_s` and after `to_s`.
    pub fn spans(&self, from_s: f64, to_s: f64) -> bool {
        self.from_s <= from_s && to_s <= self.to_s
    }
}

/// Groups sightings into placements.
pub(super) fn placements_of(looks: Vec<BoardSighting>, camera: &Camera, board: Board) -> Vec<BoardPlacement> {
    let mut runs: Vec<SightingRun> = Vec::new();
    for look in looks {
        match runs.last_mut() {
            Some(run) if run.agrees(&look, camera, board) => run.looks.push(look),
            _ => runs.push(SightingRun { looks: vec![look] }),
        }
    }
    // A single sighting is a moving board, or a shadow or a hand between two sightings that agree.
    runs.retain(|run| run.looks.len() > 1);
    let mut joined: Vec<SightingRun> = Vec::new();
    for run in runs {
        match joined.last_mut() {
            Some(last) if last.agrees(&run.looks[0], camera, board) => last.looks.extend(run.looks),
            _ => joined.push(run),
        }
    }
    joined.into_iter().filter_map(|run| run.placement(camera, board)).collect()
}

/// Sightings that agree with the first of them.
struct SightingRun {
    looks: Vec<BoardSighting>,
}

impl SightingRun {
    fn agrees(&self, look: &BoardSighting, camera: &Camera, board: Board) -> bool {
        let first = &self.looks[0];
        let mm_per_px = first.placed.camera_from_board.translation.z / camera.fx;
        let apart = |other: &Vec<Pixel>| mean_distance_px(&first.corners, other) * mm_per_px;
        possible_orders(look.corners.clone(), board).iter().map(apart).fold(f64::INFINITY, f64::min) < STILL_MM
    }

    fn placement(self, camera: &Camera, board: Board) -> Option<BoardPlacement> {
        let first = self.looks[0].corners.clone();
        let (count, mut sums) = (self.looks.len(), vec![Vector2::zeros(); first.len()]);
        for look in &self.looks {
            let readings = possible_orders(look.corners.clone(), board);
            let like_first =
                readings.iter().min_by(|a, b| mean_distance_px(&first, a).total_cmp(&mean_distance_px(&first, b)))?;
            sums.iter_mut().zip(like_first).for_each(|(sum, corner)| *sum += corner.0.coords);
        }
        let corners: Vec<Pixel> = sums.into_iter().map(|sum| Pixel((sum / count as f64).into())).collect();
        let placed = locate(camera, board, &corners)?;
        Some(BoardPlacement {
            from_s: self.looks.first()?.time_s,
            to_s: self.looks.last()?.time_s,
            sightings: count,
            camera_from_board: placed.camera_from_board,
            rms_px: quantile(self.looks.iter().map(|look| look.placed.rms_px).collect(), 0.5)?,
            corners,
        })
    }
}

fn mean_distance_px(a: &[Pixel], b: &[Pixel]) -> f64 {
    a.iter().zip(b).map(|(p, q)| (p.0 - q.0).norm()).sum::<f64>() / a.len().max(1) as f64
}
