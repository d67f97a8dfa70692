//! Renders one moment of a [`World`] as the planes that its camera would deliver.
//!
//! In: a world, a time. Out: 8-bit Y, U, V with perspective, lens distortion, shadows, gloss, motion and lens blur,
//! vignetting and sensor noise. The empty box is ray-traced once; a frame only traces the 16×16 tiles again that a tool
//! or its shadow touches. Silhouettes are those of the exact solids (see [`moving`]). The noise depends on seed and
//! time alone, so a frame does not depend on the frames rendered before it.

mod moving;
mod photo;
mod picture;
mod rays;
mod sensor;
mod static_scene;
mod tile;

#[cfg(test)]
pub(in crate::simulation) use moving::coverage;
pub use photo::{Photo, Photographer};
pub use picture::{Chroma, Rendered};

use nalgebra::Point3;
use rayon::prelude::*;

use self::moving::{Exposure, hidden};
use self::picture::chroma_length;
use self::rays::Rays;
use self::sensor::{BLUR_REACH_PX, EncodedTile, NoiseRow, SensorModel, SensorNoise};
use self::static_scene::StaticScene;
use self::tile::{TILE, TileBounds, Tiling};
use super::board::Scenery;
use super::light::{LAMP_COUNT, Rgb};
use super::shape::RoundCone;
use super::world::World;

/// Renders one world.
pub struct Renderer<'w> {
    world: &'w World,
    chroma: Chroma,
    tiling: Tiling,
    rays: Rays,
    film: SensorModel,
    grain: SensorNoise,
    /// The empty box for each stage of the world.
    backdrops: Vec<Backdrop>,
}

/// The empty box, traced once.
struct Backdrop {
    scene: StaticScene,
    /// The encoded tiles, before noise; most tiles of every frame are these.
    tiles: Vec<EncodedTile>,
    cones: Vec<TileCone>,
}

/// The cone of rays of a tile, and the part of the empty box that it covers.
struct TileCone {
    unit: nalgebra::Vector3<f64>,
    sine: f64,
    middle: Point3<f64>,
    spread_mm: f64,
}

type Painted = Option<Vec<Rgb>>;

impl<'w> Renderer<'w> {
    /// Prepares to render a world in 4:2:0; traces all of its scenery once.
    pub fn new(world: &'w World) -> Self {
        Self::with_chroma(world, Chroma::Quarter)
    }

    /// Prepares to render a world with this chroma resolution.
    pub fn with_chroma(world: &'w World, chroma: Chroma) -> Self {
        let camera = &world.rig.camera;
        let tiling = Tiling::new(camera.width as usize, camera.height as usize);
        let rays = Rays::new(camera);
        let (film, grain) = (SensorModel::new(&world.rig), SensorNoise::new(&world.rig.optics));
        let mut renderer = Self { world, chroma, tiling, rays, film, grain, backdrops: Vec::new() };
        renderer.backdrops = world.stages.iter().map(|stage| renderer.backdrop(&stage.scenery)).collect();
        renderer
    }

    fn backdrop(&self, scenery: &Scenery) -> Backdrop {
        let still = StaticScene::new(|v| scenery.trace(v), &self.rays, self.tiling.width, self.tiling.height);
        let tiles = 0..self.tiling.count();
        let cones = tiles.clone().map(|i| TileCone::new(self.tiling.square(i), &self.rays, &still)).collect();
        let mut backdrop = Backdrop { scene: still, tiles: Vec::new(), cones };
        let empty: Vec<Painted> = vec![None; tiles.len()];
        backdrop.tiles = tiles.into_par_iter().map(|i| self.develop(i, &backdrop, &empty)).collect();
        backdrop
    }

    /// The picture with the middle of its exposure at this time, s.
    pub fn render(&self, time_s: f64) -> Rendered {
        let exposure = Exposure::new(self.world, time_s, self.world.rig.optics.exposure_s);
        let backdrop = &self.backdrops[self.world.stage_at(time_s)];
        let painted: Vec<Painted> =
            (0..self.tiling.count()).into_par_iter().map(|tile| self.paint(tile, backdrop, &exposure)).collect();
        let mut picture = Rendered::black(self.tiling.width, self.tiling.height, self.chroma);
        self.fill_planes(backdrop, &painted, time_s, &mut picture);
        picture
    }

    /// The light in a tile that a moving body or its shadow touches; `None` for other tiles.
    fn paint(&self, tile: usize, backdrop: &Backdrop, exposure: &Exposure) -> Painted {
        let cone = &backdrop.cones[tile];
        let bodies = exposure.near(cone.unit, cone.sine);
        let rods: Vec<RoundCone> =
            exposure.rods.iter().map(|(_, rod)| *rod).filter(|r| self.may_shade(cone, r)).collect();
        if bodies.is_empty() && rods.is_empty() {
            return None;
        }
        let square = self.tiling.square(tile);
        let shadows = Shadows::new(square, |u, v| self.shadow_loss((u, v), backdrop, &rods));
        let light = |(u, v): (usize, usize)| {
            let still = backdrop.scene.at(u, v);
            let lost = shadows.at(u, v);
            let behind = still.radiance.map(|c| c * (1.0 - lost));
            if bodies.is_empty() {
                return behind;
            }
            exposure.paint(self.world, &bodies, &self.rays.of(u, v), (behind, f64::from(still.depth)))
        };
        Some(square.pixels().map(light).collect())
    }

    fn may_shade(&self, cone: &TileCone, rod: &RoundCone) -> bool {
        self.world.rig.lighting.lamps.iter().any(|lamp| lamp.may_hide(cone.middle, cone.spread_mm, rod))
    }

    /// Share of the empty box's light at a pixel that the rods' shadows take.
    fn shadow_loss(&self, (u, v): (usize, usize), backdrop: &Backdrop, rods: &[RoundCone]) -> f32 {
        if rods.is_empty() {
            return 0.0;
        }
        let still = backdrop.scene.at(u, v);
        let point = Point3::from(self.rays.centre(u, v) * f64::from(still.depth));
        let hidden = hidden(self.world, point, rods.iter());
        (0..LAMP_COUNT).map(|lamp| still.from_lamp[lamp] * hidden[lamp]).sum()
    }

    /// The tile as the sensor encodes it, without noise.
    fn develop(&self, tile: usize, backdrop: &Backdrop, painted: &[Painted]) -> EncodedTile {
        let square = self.tiling.square(tile);
        let patch = self.tiling.patch(square, BLUR_REACH_PX, |u, v| self.light_at((u, v), backdrop, painted));
        let encoded = self.film.develop(&patch, square.left, square.top, square.size());
        EncodedTile::new(&encoded, square.size(), self.chroma.shift())
    }

    fn light_at(&self, (u, v): (usize, usize), backdrop: &Backdrop, painted: &[Painted]) -> Rgb {
        match &painted[(v / TILE) * self.tiling.columns + u / TILE] {
            None => backdrop.scene.at(u, v).radiance,
            Some(lights) => {
                let tile_width = TILE.min(self.tiling.width - u / TILE * TILE);
                lights[v % TILE * tile_width + u % TILE]
            }
        }
    }

    /// Fills the planes, one row of tiles at a time.
    fn fill_planes(&self, backdrop: &Backdrop, painted: &[Painted], time_s: f64, picture: &mut Rendered) {
        let (width, columns) = (self.tiling.width, self.tiling.columns);
        let (sx, sy) = self.chroma.shift();
        let chroma_band = chroma_length(width, sx) * (TILE >> sy);
        let bands = picture.y.par_chunks_mut(width * TILE);
        let chroma = picture.u.par_chunks_mut(chroma_band).zip(picture.v.par_chunks_mut(chroma_band));
        bands.zip(chroma).enumerate().for_each(|(band, (y, (u, v)))| {
            let mut grain = self.grain.row(self.world.seed, &format!("frame {:016x} band {band}", time_s.to_bits()));
            for tile in band * columns..(band + 1) * columns {
                let left = self.tiling.square(tile).left;
                if self.is_static(tile, painted) {
                    self.digitise(&backdrop.tiles[tile], left, &mut grain, (y, u, v));
                } else {
                    self.digitise(&self.develop(tile, backdrop, painted), left, &mut grain, (y, u, v));
                }
            }
        });
    }

    /// Adds noise to a tile's codes and writes them to its place in a band of the planes.
    fn digitise(
        &self,
        plate: &EncodedTile,
        left: usize,
        grain: &mut NoiseRow,
        band: (&mut [u8], &mut [u8], &mut [u8]),
    ) {
        let shift = self.chroma.shift().0;
        let (width, chroma_width) = (self.tiling.width, chroma_length(self.tiling.width, shift));
        write_tile(&plate.y, plate.width, band.0, left, width, |code| grain.luma(code));
        write_tile(&plate.u, plate.chroma_width, band.1, left >> shift, chroma_width, |code| grain.chroma(code));
        write_tile(&plate.v, plate.chroma_width, band.2, left >> shift, chroma_width, |code| grain.chroma(code));
    }

    fn is_static(&self, tile: usize, painted: &[Painted]) -> bool {
        let (column, row) = (tile % self.tiling.columns, tile / self.tiling.columns);
        let (first, last) = (column.saturating_sub(1), (column + 1).min(self.tiling.columns - 1));
        let mut rows = row.saturating_sub(1)..=(row + 1).min(self.tiling.rows - 1);
        rows.all(|r| {
            painted[r * self.tiling.columns + first..=r * self.tiling.columns + last].iter().all(Option::is_none)
        })
    }
}

/// Share of light lost to shadows in a tile, computed once for every 2×2 pixels: shadow edges are softer than that.
struct Shadows {
    square: TileBounds,
    lost: Vec<f32>,
}

impl Shadows {
    fn new(square: TileBounds, lost_at: impl Fn(usize, usize) -> f32) -> Self {
        let rows = (square.top..square.bottom).step_by(2);
        let places = rows.flat_map(|v| (square.left..square.right).step_by(2).map(move |u| (u, v)));
        Self { square, lost: places.map(|(u, v)| lost_at(u, v)).collect() }
    }

    fn at(&self, u: usize, v: usize) -> f32 {
        let columns = self.square.size().0.div_ceil(2);
        self.lost[(v - self.square.top) / 2 * columns + (u - self.square.left) / 2]
    }
}

impl TileCone {
    fn new(square: TileBounds, rays: &Rays, still: &StaticScene) -> Self {
        let at = |u: usize, v: usize| rays.centre(u, v);
        let corners = [
            (square.left, square.top),
            (square.right - 1, square.top),
            (square.left, square.bottom - 1),
            (square.right - 1, square.bottom - 1),
        ];
        let (middle_u, middle_v) = ((square.left + square.right) / 2, (square.top + square.bottom) / 2);
        let unit = at(middle_u, middle_v).normalize();
        let sines = corners.map(|(u, v)| at(u, v).normalize().cross(&unit).norm());
        let middle = Point3::from(at(middle_u, middle_v) * f64::from(still.at(middle_u, middle_v).depth));
        let gaps =
            square.pixels().map(|(u, v)| (Point3::from(at(u, v) * f64::from(still.at(u, v).depth)) - middle).norm());
        // 1.15 covers half a pixel beyond the corners' centres, and the lens's curvature over a tile.
        Self { unit, sine: sines.into_iter().fold(0.0, f64::max) * 1.15, middle, spread_mm: gaps.fold(0.0, f64::max) }
    }
}

/// Writes a tile's codes into a plane's band, `left` samples from its edge.
fn write_tile(
    codes: &[f32],
    tile_width: usize,
    band: &mut [u8],
    left: usize,
    width: usize,
    mut code: impl FnMut(f32) -> u8,
) {
    for (row, line) in codes.chunks_exact(tile_width).enumerate() {
        for (sample, value) in band[row * width + left..][..tile_width].iter_mut().zip(line) {
            *sample = code(*value);
        }
    }
}
