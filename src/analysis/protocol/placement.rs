//! Wire form of trocars and of their shift since earlier sessions.

use serde::{Deserialize, Serialize};

use crate::motion::quality::{Displacement, PortPlacement};
use crate::vision::pose::fulcrum::Fulcrum;

/// Wire form of [`Fulcrum`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FulcrumShape {
    /// Position, mm.
    pub at_mm: [f64; 3],
    /// Covariance, mm²: xx, xy, xz, yy, yz, zz.
    pub covariance_mm2: [f64; 6],
}

impl FulcrumShape {
    /// All numbers.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        self.at_mm.into_iter().chain(self.covariance_mm2)
    }
}

impl From<Fulcrum> for FulcrumShape {
    fn from(fulcrum: Fulcrum) -> Self {
        Self { at_mm: fulcrum.at.into(), covariance_mm2: fulcrum.upper() }
    }
}

impl From<FulcrumShape> for Fulcrum {
    fn from(FulcrumShape { at_mm, covariance_mm2 }: FulcrumShape) -> Self {
        Fulcrum::from_upper(at_mm.into(), covariance_mm2)
    }
}

/// Wire form of [`PortPlacement`]: each shift and its standard deviation, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlacementShape {
    /// How far the camera has moved, if it has moved.
    pub camera: Option<[f64; 2]>,
    /// How far each tool's trocar has moved by itself, if it has.
    pub ports: Vec<Option<[f64; 2]>>,
}

impl PlacementShape {
    /// The wire form; `None` while no trocar is known.
    pub fn new(placement: &PortPlacement) -> Option<Self> {
        let numbers = |shift: Displacement| [shift.mm, shift.sigma_mm];
        let ports = (0..placement.tools.len()).map(|tool| placement.port(tool).map(numbers)).collect();
        let is_known = placement.tools.iter().any(Option::is_some);
        is_known.then(|| Self { camera: placement.camera.map(numbers), ports })
    }

    /// All numbers.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        self.ports.iter().chain([&self.camera]).flatten().flatten().copied()
    }
}
