//! Linear support vector machines, each level against the others, by smartcore.

use smartcore::linalg::basic::matrix::DenseMatrix;
use smartcore::svm::Kernels;
use smartcore::svm::svc::{SVC, SVCParameters};

use super::super::{LEVELS, Level};
use super::{Learner, Scorer, Table};

/// The larger `c`, the dearer a session on the wrong side.
pub struct Vectors {
    pub c: f64,
}

/// Passes over the sessions.
const EPOCHS: usize = 4;
/// Order in which the sessions are passed: any, but always the same.
const SEED: u64 = 1;

impl Learner for Vectors {
    fn name(&self) -> &'static str {
        "svm"
    }

    fn parameter(&self) -> String {
        format!("c {}", self.c)
    }

    fn fit(&self, table: &Table) -> Option<Scorer> {
        let (mut weights, mut offsets) = (std::array::from_fn(|_| Vec::new()), [0.0; LEVELS]);
        for level in Level::ALL {
            let (own_weights, offset) = self.against_the_others(table, level)?;
            (weights[level as usize], offsets[level as usize]) = (own_weights, offset);
        }
        Some(Scorer::Linear { weights, offsets })
    }
}

impl Vectors {
    /// A linear machine is its values at the origin and at one step along each feature.
    fn against_the_others(&self, table: &Table, level: Level) -> Option<(Vec<f64>, f64)> {
        let features = table.rows.first()?.len();
        let x = DenseMatrix::from_2d_vec(&table.rows).ok()?;
        let y: Vec<i32> = table.levels.iter().map(|of| if *of == level { 1 } else { -1 }).collect();
        let parameters =
            SVCParameters::default().with_c(self.c).with_epoch(EPOCHS).with_kernel(Kernels::linear()).with_seed(Some(SEED));
        let step = |row: usize| (0..features).map(|feature| if feature + 1 == row { 1.0 } else { 0.0 }).collect();
        let steps = DenseMatrix::from_2d_vec(&(0..=features).map(step).collect::<Vec<Vec<f64>>>()).ok()?;
        let machine = SVC::fit(&x, &y, &parameters).ok()?;
        let values: Vec<f64> = machine.decision_function(&steps).ok()?;
        let origin = *values.first()?;
        let weights: Vec<f64> = values[1..].iter().map(|value| value - origin).collect();
        // It ends where it began, with infinities, where a level has nobody.
        let usable = origin.is_finite() && weights.iter().all(|weight| weight.is_finite());
        if usable { Some((weights, origin)) } else { None }
    }
}
