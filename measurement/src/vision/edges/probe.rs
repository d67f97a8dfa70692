//! The search window for an edge, and the edge found in it.

use nalgebra::Vector2;

use super::edge_fit::EdgeFit;
use crate::vision::space::Pixel;
use crate::vision::tube::OutlinePart;

/// A search window for an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Middle of the chord.
    pub middle: Pixel,
    /// Unit normal, out of the tube.
    pub outward: Vector2<f64>,
    /// Curvature of the edge: `s` pixels along the chord it lies `bend·s²` farther out, px⁻¹.
    pub bend_per_px: f64,
    /// Lean of the window: pixels along the chord per pixel outwards, positive in the direction of the normal turned
    /// from x towards y.
    pub lean: f64,
    /// Half the chord's length, pixels.
    pub half_length_px: f64,
    /// Search distance inwards, pixels.
    pub inwards_px: f64,
    /// Search distance outwards, pixels.
    pub outwards_px: f64,
    /// Speed across the chord, along the normal, pixels/s.
    pub motion_px_s: f64,
    /// The outline's part.
    pub part: OutlinePart,
    /// Shading of the surface inside towards the edge.
    pub shading: Shading,
}

/// Shading of a surface towards its edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shading {
    /// A round surface that turns away from the camera: a tube of this radius in the picture.
    Limb {
        /// Radius, pixels.
        radius_px: f64,
    },
    /// A surface that ends without turning away, as at a tape's end. Light changes steadily towards it.
    Cut,
}

/// An edge found at a probe.
#[derive(Clone, Copy, Debug)]
pub struct LocatedEdge {
    /// Distance from the probe's chord along its normal, pixels.
    pub offset_px: f64,
    /// Its standard deviation, pixels: from the noise, and from what the model leaves out.
    pub sigma_px: f64,
    /// The fitted model; `None` for a plain step, which was not fitted.
    pub fit: Option<EdgeFit>,
}

/// An edge to learn from: its probe, and the model fitted to the pixels.
#[derive(Clone, Copy, Debug)]
pub struct FittedEdge {
    /// The probe that found it.
    pub probe: Probe,
    /// The fitted model.
    pub fit: EdgeFit,
}
