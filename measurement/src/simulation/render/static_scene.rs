//! The fixed scenery, traced once: radiance, depth, and the share of light that a tool's shadow can remove.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::board::SurfacePoint;
use super::super::light::{LAMP_COUNT, Rgb};
use super::rays::{Rays, SAMPLE_PATTERN, SAMPLES_PER_PIXEL};

/// The empty box.
pub struct StaticScene {
    width: usize,
    pixels: Vec<StaticPixel>,
}

/// One pixel of the empty box.
#[derive(Clone, Copy, Debug)]
pub struct StaticPixel {
    /// Linear light.
    pub radiance: Rgb,
    /// Share of the radiance that comes directly from each lamp.
    pub from_lamp: [f32; LAMP_COUNT],
    /// Depth at the pixel's centre, mm.
    pub depth: f32,
}

impl StaticScene {
    /// Traces every pixel once, and takes more samples of pixels on an edge.
    pub fn new(look: impl Fn(Vector3<f64>) -> SurfacePoint + Sync, rays: &Rays, width: usize, height: usize) -> Self {
        let first = rows(width, height, |u, v| StaticPixel::from(look(rays.centre(u, v))));
        let at = |u: usize, v: usize| &first[v * width + u];
        let pixels = rows(width, height, |u, v| {
            let here = *at(u, v);
            let beside = [(u.wrapping_sub(1), v), (u + 1, v), (u, v.wrapping_sub(1)), (u, v + 1)];
            let inside = beside.into_iter().filter(|(x, y)| *x < width && *y < height);
            let edge = inside.into_iter().any(|(x, y)| is_edge(&here.radiance, &at(x, y).radiance));
            if edge { StaticPixel { radiance: averaged(&look, rays, u, v), ..here } } else { here }
        });
        Self { width, pixels }
    }

    /// The pixel at column `u`, row `v`.
    #[inline]
    pub fn at(&self, u: usize, v: usize) -> &StaticPixel {
        &self.pixels[v * self.width + u]
    }
}

impl From<SurfacePoint> for StaticPixel {
    fn from(sight: SurfacePoint) -> Self {
        let radiance = sight.lit.with_hidden([0.0; LAMP_COUNT]);
        let whole = brightness(&radiance).max(1e-6);
        let from_lamp = sight.lit.from_lamp.map(|rgb| brightness(&rgb) / whole);
        Self { radiance, from_lamp, depth: sight.depth as f32 }
    }
}

fn rows<T: Send + Copy>(width: usize, height: usize, pixel: impl Fn(usize, usize) -> T + Sync) -> Vec<T> {
    let row = |v: usize| (0..width).map(|u| pixel(u, v)).collect::<Vec<T>>();
    (0..height).into_par_iter().flat_map_iter(row).collect()
}

fn averaged(look: impl Fn(Vector3<f64>) -> SurfacePoint, rays: &Rays, u: usize, v: usize) -> Rgb {
    let pixel = rays.of(u, v);
    let mut sum = [0.0; 3];
    for offset in SAMPLE_PATTERN {
        let rgb = look(pixel.at(offset.right, offset.down)).lit.with_hidden([0.0; LAMP_COUNT]);
        for (channel, value) in sum.iter_mut().zip(rgb) {
            *channel += value / SAMPLES_PER_PIXEL as f32;
        }
    }
    sum
}

fn is_edge(a: &Rgb, b: &Rgb) -> bool {
    a.iter().zip(b).any(|(a, b)| (a - b).abs() > 0.012 + 0.06 * a.max(*b))
}

fn brightness(rgb: &Rgb) -> f32 {
    rgb.iter().sum()
}
