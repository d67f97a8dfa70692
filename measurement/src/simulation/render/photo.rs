//! Single photos in colour, with the same lens and sensor as the recordings.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::board::SurfacePoint;
use super::super::rig::Rig;
use super::rays::Rays;
use super::sensor::{BLUR_REACH_PX, SensorModel, SensorNoise};
use super::static_scene::StaticScene;
use super::tile::Tiling;

/// A photo, 8-bit sRGB, packed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue of every pixel, row by row.
    pub rgb: Vec<u8>,
}

/// A rig's camera, for photos of any scene.
pub struct Photographer {
    tiling: Tiling,
    rays: Rays,
    film: SensorModel,
    grain: SensorNoise,
}

impl Photographer {
    /// The camera of a rig.
    pub fn new(rig: &Rig) -> Self {
        let tiling = Tiling::new(rig.camera.width as usize, rig.camera.height as usize);
        Self { tiling, rays: Rays::new(&rig.camera), film: SensorModel::new(rig), grain: SensorNoise::new(&rig.optics) }
    }

    /// Takes a photo; `look` gives the surface along each ray, and `seed` sets the noise.
    pub fn take(&self, look: impl Fn(Vector3<f64>) -> SurfacePoint + Sync, seed: u64) -> Photo {
        let (width, height) = (self.tiling.width, self.tiling.height);
        let still = StaticScene::new(look, &self.rays, width, height);
        let developed = |tile: usize| {
            let square = self.tiling.square(tile);
            let patch = self.tiling.patch(square, BLUR_REACH_PX, |u, v| still.at(u, v).radiance);
            (square, self.film.develop(&patch, square.left, square.top, square.size()))
        };
        let tiles: Vec<_> = (0..self.tiling.count()).into_par_iter().map(developed).collect();
        let mut rgb = vec![0; 3 * width * height];
        for (square, pixels) in tiles {
            let mut grain = self.grain.row(seed, &format!("photo {} {}", square.left, square.top));
            for ((u, v), colour) in square.pixels().zip(pixels) {
                let at = 3 * (v * width + u);
                // The noise table is made for limited-range luma; 255/219 of it is the same noise in full range.
                let noise = grain.luma_noise(16.0 + 219.0 * colour[1]) * (255.0 / 219.0);
                rgb[at..at + 3].copy_from_slice(&colour.map(|c| (255.0 * c + noise + 0.5) as u8));
            }
        }
        Photo { width: width as u32, height: height as u32, rgb }
    }
}
