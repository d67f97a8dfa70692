//! The viewing direction of every pixel: the lens distortion is undone once, not for every frame.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::vision::camera::Camera;
use crate::vision::space::Pixel;

/// Rays `(x, y, 1)` of all pixel centres.
pub struct Rays {
    width: usize,
    height: usize,
    directions: Vec<[f32; 2]>,
}

/// The rays of one pixel: the ray through its centre, and its change over one pixel to the right and one down.
#[derive(Clone, Copy, Debug)]
pub struct PixelRays {
    /// Through the centre.
    pub centre: Vector3<f64>,
    right: Vector3<f64>,
    down: Vector3<f64>,
}

impl Rays {
    /// All rays of a camera.
    pub fn new(camera: &Camera) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut directions = vec![[0.0; 2]; width * height];
        directions.par_chunks_mut(width).enumerate().for_each(|(v, row)| {
            for (u, direction) in row.iter_mut().enumerate() {
                // A lens that folds over inside the picture has no direction there; none of the rigs has one.
                let seen = camera.normalised_of(Pixel::new(u as f64, v as f64));
                *direction = seen.map_or([f32::NAN; 2], |n| [n.0.x as f32, n.0.y as f32]);
            }
        });
        Self { width, height, directions }
    }

    /// The rays of the pixel at column `u`, row `v`.
    pub fn of(&self, u: usize, v: usize) -> PixelRays {
        let at = |u: usize, v: usize| {
            let [x, y] = self.directions[v * self.width + u];
            Vector3::new(f64::from(x), f64::from(y), 1.0)
        };
        let centre = at(u, v);
        let right = if u + 1 < self.width { at(u + 1, v) - centre } else { centre - at(u - 1, v) };
        let down = if v + 1 < self.height { at(u, v + 1) - centre } else { centre - at(u, v - 1) };
        PixelRays { centre, right, down }
    }

    /// The ray through the pixel's centre.
    pub fn centre(&self, u: usize, v: usize) -> Vector3<f64> {
        let [x, y] = self.directions[v * self.width + u];
        Vector3::new(f64::from(x), f64::from(y), 1.0)
    }
}

impl PixelRays {
    /// The ray through the point `du`, `dv` pixels off the centre, both within ±½.
    pub fn at(&self, du: f64, dv: f64) -> Vector3<f64> {
        self.centre + self.right * du + self.down * dv
    }

    /// Distance between the rays of neighbouring pixels at depth 1.
    pub fn pitch(&self) -> f64 {
        self.right.norm().max(self.down.norm())
    }
}

/// Number of samples of a pixel where one is not enough; each has its own point in the pixel and moment in the
/// exposure.
pub const SAMPLES_PER_PIXEL: usize = 16;

/// One sample of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct PixelSample {
    /// Offset from the pixel's centre to the right, −½..½.
    pub right: f64,
    /// Offset downwards, −½..½.
    pub down: f64,
    /// Share of the exposure that has passed, 0..1.
    pub moment: f64,
}

/// The samples of a pixel: a Sobol sequence in three dimensions. Each coordinate alone is spread evenly, and the two
/// offsets together put one sample in each sixteenth of the pixel.
pub const SAMPLE_PATTERN: [PixelSample; SAMPLES_PER_PIXEL] = pattern();

const fn pattern() -> [PixelSample; SAMPLES_PER_PIXEL] {
    // Direction numbers of the first three Sobol dimensions (Joe & Kuo 2008), 4 bits.
    const DIRECTIONS: [[usize; 4]; 3] = [[8, 4, 2, 1], [8, 12, 10, 15], [8, 12, 6, 9]];
    let mut looks = [PixelSample { right: 0.0, down: 0.0, moment: 0.0 }; SAMPLES_PER_PIXEL];
    let mut i = 0;
    while i < SAMPLES_PER_PIXEL {
        let mut share = [0.0; 3];
        let mut d = 0;
        while d < 3 {
            let (mut value, mut bit) = (0, 0);
            while bit < 4 {
                if (i >> bit) & 1 == 1 {
                    value ^= DIRECTIONS[d][bit];
                }
                bit += 1;
            }
            share[d] = (value as f64 + 0.5) / SAMPLES_PER_PIXEL as f64;
            d += 1;
        }
        looks[i] = PixelSample { right: share[0] - 0.5, down: share[1] - 0.5, moment: share[2] };
        i += 1;
    }
    looks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_spread_evenly_in_time_and_over_the_pixel() {
        let widest_gap = |of: fn(&PixelSample) -> f64| {
            let mut values: Vec<f64> = SAMPLE_PATTERN.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
        };
        assert_eq!([widest_gap(|l| l.right), widest_gap(|l| l.down), widest_gap(|l| l.moment)], [1.0 / 16.0; 3]);
        for sixteenth in 0..16 {
            let cell = (sixteenth % 4, sixteenth / 4);
            let inside = |l: &&PixelSample| (((l.right + 0.5) * 4.0) as usize, ((l.down + 0.5) * 4.0) as usize) == cell;
            assert_eq!(SAMPLE_PATTERN.iter().filter(inside).count(), 1);
        }
    }
}
