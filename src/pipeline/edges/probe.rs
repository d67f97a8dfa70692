//! Where to look for an edge, and what is found there.

use nalgebra::Vector2;

use crate::pipeline::space::Pixel;

/// Where to look for an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Middle of the chord.
    pub middle: Pixel,
    /// Unit normal, out of the tube.
    pub outward: Vector2<f64>,
    /// How the edge bends: `s` pixels along the chord it lies `bend·s²` farther out, px⁻¹.
    pub bend_per_px: f64,
    /// How far the window leans: so many pixels along the chord per pixel outwards, counted in the direction of the normal
    /// turned from x towards y.
    pub lean: f64,
    /// Half the chord's length, pixels.
    pub half_length_px: f64,
    /// How far to look inwards, pixels.
    pub inwards_px: f64,
    /// How far to look outwards, pixels.
    pub outwards_px: f64,
    /// Speed across the chord, along the normal, pixels/s.
    pub motion_px_s: f64,
    /// Which of an outline's four parts it lies on: each is lit in its own way.
    pub part: usize,
    /// How the surface inside shades towards the edge.
    pub shading: Shading,
}

/// How a surface shades towards its edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shading {
    /// A round one that turns away from the camera: a tube of this radius in the picture, pixels.
    Limb {
        /// Radius, pixels.
        radius_px: f64,
    },
    /// One that ends without turning away: a tape's end. Light changes steadily towards it.
    Cut,
}

/// An edge found at a probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Distance from the probe's chord along its normal, pixels.
    pub offset_px: f64,
    /// Standard deviation of that, pixels: from the noise, and from what the model leaves out.
    pub sigma_px: f64,
}
