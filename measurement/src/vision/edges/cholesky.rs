//! Solves small linear systems with a symmetric, positive definite matrix by Cholesky factorisation.
//!
//! Made for the tracker's innermost loop: all loop lengths are known at compile time, no row is exchanged, and
//! everything is inlined into the caller, so that it is compiled for the widest registers of the machine.

/// The lower Cholesky factor of a matrix.
pub struct CholeskyFactor<const N: usize> {
    lower: [[f64; N]; N],
}

impl<const N: usize> CholeskyFactor<N> {
    /// Factors a matrix, reading only its lower half; `None` if it is not positive definite.
    #[inline(always)]
    pub fn new(mut matrix: [[f64; N]; N]) -> Option<Self> {
        for column in 0..N {
            let pivot = matrix[column][column];
            if pivot <= 0.0 || !pivot.is_finite() {
                return None;
            }
            let root = pivot.sqrt();
            let per_root = 1.0 / root;
            matrix[column][column] = root;
            let mut below = [0.0; N];
            for row in column + 1..N {
                matrix[row][column] *= per_root;
                below[row] = matrix[row][column];
            }
            // Whole rows are processed, so that several numbers are computed at once. Earlier columns subtract 0, and
            // the upper half is computed but never read.
            for row in column + 1..N {
                let factor = below[row];
                for (of, other) in matrix[row].iter_mut().zip(below) {
                    *of -= factor * other;
                }
            }
        }
        Some(Self { lower: matrix })
    }

    /// Solves the system for this right side.
    #[inline(always)]
    pub fn solve(&self, mut right: [f64; N]) -> [f64; N] {
        for row in 0..N {
            let known: f64 = (0..row).map(|column| self.lower[row][column] * right[column]).sum();
            right[row] = (right[row] - known) / self.lower[row][row];
        }
        for row in (0..N).rev() {
            right[row] /= self.lower[row][row];
            for column in 0..row {
                right[column] -= self.lower[row][column] * right[row];
            }
        }
        right
    }

    /// Information (inverse variance) on the last unknown, with all other unknowns free.
    #[inline(always)]
    pub fn information_on_last(&self) -> f64 {
        self.lower[N - 1][N - 1].powi(2)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn an_answer_solves_its_equations(
            roots in prop::array::uniform5(prop::array::uniform5(-3.0..3.0f64)),
            right in prop::array::uniform5(-9.0..9.0f64),
        ) {
            // The square of any matrix, and a little more, is positive definite.
            let matrix: [[f64; 5]; 5] = std::array::from_fn(|i| std::array::from_fn(|j| {
                (0..5).map(|k| roots[i][k] * roots[j][k]).sum::<f64>() + f64::from(u8::from(i == j))
            }));
            let answer = CholeskyFactor::new(matrix).unwrap().solve(right);
            for (row, right) in matrix.iter().zip(right) {
                let left: f64 = row.iter().zip(answer).map(|(a, b)| a * b).sum();
                prop_assert!((left - right).abs() < 1e-9, "{left} for {right}");
            }
        }
    }

    #[test]
    fn the_last_unknowns_information_is_that_of_its_inverse() {
        let factor = CholeskyFactor::new([[4.0, 0.0], [2.0, 3.0]]).unwrap(); // inverse: 3 -2, -2 4 over 8
        assert!((factor.information_on_last() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_positive_definite_has_no_factor() {
        assert!(CholeskyFactor::new([[1.0, 0.0], [2.0, 1.0]]).is_none());
        assert!(CholeskyFactor::new([[f64::NAN]]).is_none());
    }
}
