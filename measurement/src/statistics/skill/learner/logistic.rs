//! Multinomial logistic regression with a ridge, by smartcore.

use smartcore::linalg::basic::arrays::Array;
use smartcore::linalg::basic::matrix::DenseMatrix;
use smartcore::linear::logistic_regression::{LogisticRegression, LogisticRegressionParameters};

use super::super::{LEVELS, SkillLevel};
use super::{Learner, LevelScorer, TrainingTable};

/// Multinomial logistic regression. A larger ridge gives smaller weights.
pub struct Logistic {
    pub ridge: f64,
}

impl Learner for Logistic {
    fn name(&self) -> &'static str {
        "logistic"
    }

    fn parameter(&self) -> String {
        format!("ridge {}", self.ridge)
    }

    fn fit(&self, table: &TrainingTable) -> Option<LevelScorer> {
        let x = DenseMatrix::from_2d_vec(&table.rows).ok()?;
        let y: Vec<u32> = table.levels.iter().map(|level| *level as u32).collect();
        let fitted = LogisticRegression::fit(&x, &y, LogisticRegressionParameters::default().with_alpha(self.ridge));
        let fitted = fitted.ok()?;
        if fitted.classes().len() != LEVELS {
            return None;
        }
        let (coefficients, intercept) = (fitted.coefficients(), fitted.intercept());
        let (mut weights, mut offsets) = (std::array::from_fn(|_| Vec::new()), [0.0; LEVELS]);
        for level in SkillLevel::ALL {
            let row = fitted.classes().iter().position(|class| *class == level as u32)?;
            weights[level as usize] =
                (0..table.rows[0].len()).map(|feature| *coefficients.get((row, feature))).collect();
            // The level's share of the sessions is removed again, so that a rare level is as likely as a common one.
            let sessions = table.levels.iter().filter(|of| **of == level).count() as f64;
            offsets[level as usize] = *intercept.get((row, 0)) - sessions.ln();
        }
        Some(LevelScorer::Linear { weights, offsets })
    }
}
