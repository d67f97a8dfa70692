//! Renders the moving solids over one exposure: every ray is cast against the exact solids.
//!
//! A pixel well inside a tube is sampled once, at the middle of the exposure. A pixel that a border, a band's end or a
//! jaw touches at any moment is sampled [`SAMPLES_PER_PIXEL`] times. Each sample has its own position in the pixel
//! *and* its own moment: this gives anti-aliasing and motion blur in one sum, without bias of the borders.

use nalgebra::{Point3, Vector3};

use super::super::light::{LAMP_COUNT, Material, Rgb};
use super::super::shape::{RayHit, RoundCone, TapedTube, TubePart};
use super::super::tool::{FACE, STEEL, ToolPose};
use super::super::world::World;
use super::rays::{PixelRays, SAMPLE_PATTERN, SAMPLES_PER_PIXEL};

/// The moving solids of one exposure.
pub struct Exposure {
    middle: Vec<MovingBody>,
    ends: [Vec<MovingBody>; 2],
    samples: Vec<Vec<MovingBody>>,
    hulls: Vec<RoundCone>,
    /// Rods that cast shadows, each with its owner.
    pub rods: Vec<(usize, RoundCone)>,
}

#[derive(Clone, Copy, Debug)]
struct MovingBody {
    owner: usize,
    form: BodyShape,
}

#[derive(Clone, Copy, Debug)]
enum BodyShape {
    /// A tube; `end` is the surface of its band, `rest` that of the tube behind it.
    Tube {
        tube: TapedTube,
        end: Material,
        rest: Material,
    },
    Solid {
        solid: RoundCone,
        material: Material,
    },
}

/// The intersection of a ray with a body.
#[derive(Clone, Copy)]
struct BodyHit {
    meeting: RayHit,
    body: usize,
    part: Option<TubePart>,
    material: Material,
}

/// Maximum of bodies considered for one pixel; two crossing tools with all their parts and a bead between them are
/// eleven.
const MAX_BODIES: usize = 16;

/// How a body overlaps a pixel during the exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PixelOverlap {
    Outside,
    Inside,
    Edge,
}

impl Exposure {
    /// The exposure of `exposure_s` with its middle at `time_s`.
    pub fn new(world: &World, time_s: f64, exposure_s: f64) -> Self {
        let at = |share: f64| bodies(world, time_s + (share - 0.5) * exposure_s);
        let middle = at(0.5);
        let samples: Vec<Vec<MovingBody>> = SAMPLE_PATTERN.iter().map(|look| at(look.moment)).collect();
        let ends = [at(0.0), at(1.0)];
        let hulls = middle.iter().zip(ends[0].iter().zip(&ends[1])).map(|(m, (f, l))| hull(m, f, l)).collect();
        let poses = world.poses(time_s);
        let of_tool =
            |(owner, pose): (usize, &ToolPose)| world.tools[owner].design.shadow_rods(pose).map(move |r| (owner, r));
        let carried = world.carried(&poses, time_s);
        let beads = carried.iter().enumerate().map(|(i, (solid, _))| (world.tools.len() + i, *solid));
        let rods = poses.iter().enumerate().flat_map(of_tool).chain(beads).collect();
        Self { middle, ends, samples, hulls, rods }
    }

    /// Bodies that a ray within the angle `margin` (sine) of `unit` may meet during the exposure.
    pub fn near(&self, unit: Vector3<f64>, margin: f64) -> Vec<usize> {
        (0..self.hulls.len()).filter(|i| self.hulls[*i].may_meet(unit, margin)).collect()
    }

    /// The light of a pixel that these bodies may cover; `behind` is the light and depth of the background.
    pub fn paint(&self, world: &World, near: &[usize], pixel: &PixelRays, behind: (Rgb, f64)) -> Rgb {
        self.gather(near, pixel, behind, |met, v| self.shade(world, met, v))
    }

    /// The mean of `of` over the pixel and the exposure; `of` gives the light of each intersection.
    fn gather(
        &self,
        near: &[usize],
        pixel: &PixelRays,
        behind: (Rgb, f64),
        of: impl Fn(&BodyHit, Vector3<f64>) -> Rgb,
    ) -> Rgb {
        let mut touched = [0; MAX_BODIES];
        let mut count = 0;
        let mut edge = false;
        for body in near {
            let lie = self.overlap(*body, pixel);
            if lie != PixelOverlap::Outside && count < touched.len() {
                touched[count] = *body;
                count += 1;
                edge |= lie == PixelOverlap::Edge;
            }
        }
        let touched = &touched[..count];
        if touched.is_empty() {
            behind.0
        } else if edge {
            self.gather_samples(touched, pixel, behind, of)
        } else {
            let met = nearest(&self.middle, touched, pixel.centre).filter(|met| met.meeting.depth < behind.1);
            met.map_or(behind.0, |met| of(&met, pixel.centre))
        }
    }

    /// Takes sixteen samples. Each part that they meet is shaded once, since only its outline matters within one pixel.
    fn gather_samples(
        &self,
        bodies: &[usize],
        pixel: &PixelRays,
        behind: (Rgb, f64),
        of: impl Fn(&BodyHit, Vector3<f64>) -> Rgb,
    ) -> Rgb {
        let mut shaded: Vec<(usize, Option<TubePart>, Rgb)> = Vec::with_capacity(4);
        let mut sum = [0.0f32; 3];
        for (bodies_then, look) in self.samples.iter().zip(SAMPLE_PATTERN) {
            let v = pixel.at(look.right, look.down);
            let met = nearest(bodies_then, bodies, v).filter(|met| met.meeting.depth < behind.1);
            let rgb = met.map_or(behind.0, |met| {
                let known = shaded.iter().find(|(body, part, _)| (*body, *part) == (met.body, met.part));
                known.map(|k| k.2).unwrap_or_else(|| {
                    let rgb = of(&met, v);
                    shaded.push((met.body, met.part, rgb));
                    rgb
                })
            });
            for (channel, value) in sum.iter_mut().zip(rgb) {
                *channel += value / SAMPLES_PER_PIXEL as f32;
            }
        }
        sum
    }

    fn shade(&self, world: &World, met: &BodyHit, v: Vector3<f64>) -> Rgb {
        let point = Point3::from(v * met.meeting.depth);
        let lit = world.rig.lighting.reflect(point, met.meeting.normal, v, &met.material);
        let owner = self.middle[met.body].owner;
        let others = self.rods.iter().filter(|(of, _)| *of != owner);
        lit.with_hidden(hidden(world, point, others.map(|(_, rod)| rod)))
    }

    fn overlap(&self, body: usize, pixel: &PixelRays) -> PixelOverlap {
        match (&self.middle[body].form, &self.ends[0][body].form, &self.ends[1][body].form) {
            (BodyShape::Tube { tube, .. }, BodyShape::Tube { tube: first, .. }, BodyShape::Tube { tube: last, .. }) => {
                overlap_of_tube(tube, first, last, pixel)
            }
            _ => {
                let unit = pixel.centre.normalize();
                if self.hulls[body].may_meet(unit, 1.5 * pixel.pitch()) {
                    PixelOverlap::Edge
                } else {
                    PixelOverlap::Outside
                }
            }
        }
    }
}

/// Share of each lamp's light that the rods hide from a point.
pub fn hidden<'a>(
    world: &World,
    point: Point3<f64>,
    rods: impl Iterator<Item = &'a RoundCone> + Clone,
) -> [f32; LAMP_COUNT] {
    world.rig.lighting.lamps.map(|lamp| {
        let kept: f64 = rods.clone().map(|rod| lamp.hidden(point, rod)).sum();
        kept.min(1.0) as f32
    })
}

fn overlap_of_tube(tube: &TapedTube, first: &TapedTube, last: &TapedTube, pixel: &PixelRays) -> PixelOverlap {
    let v = pixel.centre;
    // Rays inside both tangent planes meet the infinite tube. The bare tube is a little thinner than these planes.
    let margin = 0.9 * pixel.pitch() + (tube.radius - tube.bare_radius) / tube.tip.coords.norm();
    let side = |of: &TapedTube, i: usize| of.borders()[i].dot(&v);
    let outside = |i: usize| side(first, i) < -margin && side(last, i) < -margin;
    if outside(0) || outside(1) {
        return PixelOverlap::Outside;
    }
    let inside = |i: usize| side(first, i) > margin && side(last, i) > margin;
    let (behind, depth, slant) = tube.along(v);
    let travel = (first.tip - last.tip).norm();
    let blur = 1.5 * pixel.pitch() * depth / slant + travel + 0.6 * tube.radius * (1.0 - slant * slant).sqrt();
    let face = if v.dot(&tube.axis) < 0.0 { 2.0 * tube.radius / slant } else { 0.0 };
    if behind < -blur - face {
        PixelOverlap::Outside
    } else if !(inside(0) && inside(1)) || behind < blur || (behind - tube.band_mm).abs() < blur {
        PixelOverlap::Edge
    } else {
        PixelOverlap::Inside
    }
}

fn nearest(all: &[MovingBody], bodies: &[usize], v: Vector3<f64>) -> Option<BodyHit> {
    let met = bodies.iter().filter_map(|body| all[*body].meet(*body, v));
    met.min_by(|p, q| p.meeting.depth.total_cmp(&q.meeting.depth))
}

impl MovingBody {
    fn meet(&self, body: usize, v: Vector3<f64>) -> Option<BodyHit> {
        match &self.form {
            BodyShape::Tube { tube, end, rest } => tube.meet(v).map(|(meeting, part, _)| {
                let material = match part {
                    TubePart::Band => *end,
                    TubePart::Shaft => *rest,
                    TubePart::Face => FACE,
                };
                BodyHit { meeting, body, part: Some(part), material }
            }),
            BodyShape::Solid { solid, material } => {
                solid.meet(v).map(|meeting| BodyHit { meeting, body, part: None, material: *material })
            }
        }
    }

    /// The body as a rod.
    fn rod(&self) -> RoundCone {
        match &self.form {
            BodyShape::Tube { tube, .. } => {
                RoundCone::capsule(tube.tip, tube.tip - tube.axis * tube.length_mm, tube.radius)
            }
            BodyShape::Solid { solid, .. } => *solid,
        }
    }
}

/// All moving bodies at one time, always in the same order.
fn bodies(world: &World, time_s: f64) -> Vec<MovingBody> {
    let poses = world.poses(time_s);
    let mut bodies = Vec::with_capacity(4 * poses.len() + 4);
    for (owner, (tool, pose)) in world.tools.iter().zip(&poses).enumerate() {
        let (design, rest) = (&tool.design, tool.design.shaft.material);
        let end = design.band.map_or(rest, |band| band.tape.material());
        let tube = BodyShape::Tube { tube: design.tube(pose), end, rest };
        let collar = design.collar(pose).map(|tube| BodyShape::Tube { tube, end: STEEL, rest: STEEL });
        let jaws = design.jaws(pose).into_iter().flatten().map(|solid| BodyShape::Solid { solid, material: STEEL });
        let forms = std::iter::once(tube).chain(collar).chain(jaws);
        bodies.extend(forms.map(|form| MovingBody { owner, form }));
    }
    for (index, (solid, material)) in world.carried(&poses, time_s).into_iter().enumerate() {
        bodies.push(MovingBody { owner: world.tools.len() + index, form: BodyShape::Solid { solid, material } });
    }
    bodies
}

/// A rod that encloses the body during the whole exposure.
fn hull(middle: &MovingBody, first: &MovingBody, last: &MovingBody) -> RoundCone {
    let (m, f, l) = (middle.rod(), first.rod(), last.rod());
    let travel = |m: Point3<f64>, f: Point3<f64>, l: Point3<f64>| (m - f).norm().max((m - l).norm());
    let wide = m.radius_a.max(m.radius_b) + travel(m.a, f.a, l.a).max(travel(m.b, f.b, l.b));
    RoundCone::capsule(m.a, m.b, wide)
}

/// Share of every pixel that moving surfaces of such a material cover, as rendered.
#[cfg(test)]
pub(in crate::simulation) fn coverage(world: &World, time_s: f64, is_such: impl Fn(&Material) -> bool) -> Vec<f64> {
    let rays = super::rays::Rays::new(&world.rig.camera);
    let exposure = Exposure::new(world, time_s, world.rig.optics.exposure_s);
    let all: Vec<usize> = (0..exposure.middle.len()).collect();
    let white = |met: &BodyHit, _| [if is_such(&met.material) { 1.0 } else { 0.0 }; 3];
    let (width, height) = (world.rig.camera.width as usize, world.rig.camera.height as usize);
    let cover = |i: usize| exposure.gather(&all, &rays.of(i % width, i / width), ([0.0; 3], 1e6), white)[0];
    (0..width * height).map(|i| f64::from(cover(i))).collect()
}
