//! The Welsch function, which bounds what a wrong correspondence can do.

/// ψ_ν(x) = 1 − exp(−x² / 2ν²), between 0 and 1, of a `residual` x ≥ 0 at the scale ν > 0.
///
/// # Source
///
/// Eq. 3 of the Tracked QEM paper; Holland and Welsch, "Robust Regression Using Iteratively
/// Reweighted Least-Squares", Communications in Statistics 6(9), 1977,
/// <https://doi.org/10.1080/03610927708827533>.
#[must_use]
pub fn welsch(residual: f64, scale: f64) -> f64 {
    -(-0.5 * (residual / scale).powi(2)).exp_m1()
}

/// exp(−x² / 2ν²): the weight that makes the quadratic w·x² / 2ν² touch [`welsch`] from above
/// at `residual`, up to a constant, as majorization-minimization needs it.
#[must_use]
pub fn welsch_weight(residual: f64, scale: f64) -> f64 {
    (-0.5 * (residual / scale).powi(2)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The surrogate lies above the function and touches it where it was made.
        #[test]
        fn the_weighted_quadratic_majorizes_the_function(
            x in 0.0..10.0_f64, y in 0.0..10.0_f64, scale in 0.1..5.0_f64,
        ) {
            let surrogate = welsch(y, scale)
                + welsch_weight(y, scale) * (x * x - y * y) / (2.0 * scale * scale);
            prop_assert!(welsch(x, scale) <= surrogate + 1e-12);
        }
    }
}
