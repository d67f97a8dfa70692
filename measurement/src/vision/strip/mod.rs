//! Bare shafts as straight strips of the picture (METHOD 3.6).
//!
//! A shaft is long, straight, of nearly parallel borders, and comes from the picture's rim on the side of its hand. Where
//! the [evidence](crate::vision::segmentation::shaft_evidence) of its cells adds up along such a strip, there is a shaft.
//!
//! | step | input | output |
//! |---|---|---|
//! | [`grid`] | camera | cells of the undistorted picture, where shafts are straight |
//! | [`search`] | evidence | rough strips: direction, offset, width, end |
//! | [`outline`] | evidence, rough strip | both borders and the end, to a fifth of a cell |
//! | [`end_step`] | cells, strip | the strip, ending where its colour changes most |
//! | [`meeting_point`] | strips of many frames | the picture's point through which all of a tool's strips pass |

pub mod borders;
pub mod end_step;
pub mod finder;
pub mod grid;
pub mod meeting_point;
pub mod outline;
pub mod search;

use nalgebra::{Point2, Vector3};

use crate::vision::space::Normalised;

/// Distance from the camera to a shaft's axis, mm: nearest, where a shaft enters the picture close to the camera, and
/// farthest. It limits the width of a strip.
pub const DISTANCES_MM: (f64, f64) = (40.0, 330.0);

/// A strip of the picture that may be a bare shaft. All points are normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct Strip {
    /// Both borders, each from its beginning at the picture's rim to the strip's end.
    pub borders: [[Point2<f64>; 2]; 2],
    /// The middle at the picture's rim.
    pub entry: Normalised,
    /// The middle at its end.
    pub end: Normalised,
    /// Width at its end.
    pub width: f64,
    /// Length, as a multiple of its width.
    pub length_widths: f64,
    /// Evidence of its rows, added up, nats.
    pub score: f64,
    /// Mean evidence of a row, less what lies beside it, nats.
    pub net_evidence: f64,
    /// Share of its rows with evidence for a shaft.
    pub supported_share: f64,
    /// Step of colour at its end, codes; `None` if there is no clear step.
    pub end_step_codes: Option<f64>,
}

impl Strip {
    /// Is it long for its width, and on the whole of the shaft's colour before its background?
    pub fn is_believable(&self) -> bool {
        /// A shorter piece has no direction.
        const MIN_LENGTH_WIDTHS: f64 = 2.5;
        /// Half of what true strips have over a dark mat.
        const MIN_NET_EVIDENCE: f64 = 0.4;
        /// More rows for it than against it.
        const MIN_SUPPORTED: f64 = 0.5;
        self.length_widths >= MIN_LENGTH_WIDTHS
            && self.net_evidence > MIN_NET_EVIDENCE
            && self.supported_share > MIN_SUPPORTED
    }

    /// Unit normal of the plane through the camera and the strip's middle line.
    pub fn plane(&self) -> Vector3<f64> {
        plane_through(self.entry, self.end)
    }

    /// Are both of one thing: is the line of one within the other?
    pub fn is_same_as(&self, other: &Self) -> bool {
        let apart = self.plane().cross(&other.plane()).norm();
        apart < 0.5 * self.width.max(other.width)
    }
}

/// Unit normal of the plane through the camera and two points.
pub fn plane_through(one: Normalised, other: Normalised) -> Vector3<f64> {
    one.ray().cross(&other.ray()).try_normalize(1e-12).unwrap_or_else(Vector3::zeros)
}
