//! Multinomial logistic regression with a ridge, by smartcore.

use smartcore::linalg::basic::arrays::Array;
use smartcore::linalg::basic::matrix::DenseMatrix;
use smartcore::linear::logistic_regression::{LogisticRegression, LogisticRegressionParameters};

use super::super::LEVELS;
use super::{Learner, Scorer, Table};

/// The larger the ridge, the smaller the weights.
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

    fn fit(&self, table: &Table) -> Option<Scorer> {
        let x = DenseMatrix::from_2d_vec(&table.rows).ok()?;
        let y: Vec<u32> = table.levels.iter().map(|level| *level as u32).collect();
        let fitted = LogisticRegression::fit(&x, &y, LogisticRegressionParameters::default().with_alpha(self.ridge));
        let fitted = fitted.ok()?;
        if fitted.classes().len() != LEVELS {
            return None;
        }
        let (coefficients, intercept) = (fitted.coefficients(), fitted.intercept());
        let place = |level: usize| fitted.classes().iter().position(|class| *class as usize == level);
        let mut scorer = (std::array::from_fn(|_| Vec::new()), [0.0; LEVELS]);
        // The levels' shares are taken out again: a rare level is as likely as a common one.
        let shares = table.levels.iter().fold([0.0; LEVELS], |mut n: [f64; LEVELS], level| {
            n[*level as usize] += 1.0;
            n
        });
        for level in 0..LEVELS {
            let row = place(level)?;
            scorer.0[level] = (0..table.rows[0].len()).map(|feature| *coefficients.get((row, feature))).collect();
            scorer.1[level] = *intercept.get((row, 0)) - shares[level].ln();
        }
        let (weights, offsets) = scorer;
        Some(Scorer::Linear { weights, offsets })
    }
}
