//! Projection onto the rotations.

use nalgebra::Matrix3;

/// Steps of the singular value decomposition; it needs about ten for any 3 x 3 matrix.
const MAX_SVD_STEPS: usize = 100;

/// The rotation closest to `matrix` in the Frobenius norm: proj_R of Eq. 3.
///
/// `None` if the matrix is not finite. A matrix of rank one or none leaves a part of the
/// rotation free; the result is then one of the closest.
///
/// # Source
///
/// Kabsch, "A Solution for the Best Rotation to Relate Two Sets of Vectors", Acta
/// Crystallographica A32, 1976, <https://doi.org/10.1107/S0567739476001873>: U·diag(1, 1,
/// det UVᵀ)·Vᵀ, so that a reflection never comes out.
#[must_use]
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    if !matrix.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    let svd = matrix.try_svd(true, true, f64::EPSILON, MAX_SVD_STEPS)?;
    let (mut u, v_t) = (svd.u?, svd.v_t?);
    if u.determinant() * v_t.determinant() < 0.0 {
        // Singular values are in descending order: the last direction matters least.
        u.column_mut(2).neg_mut();
    }
    Some(u * v_t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

    #[test]
    fn a_reflection_becomes_a_rotation() {
        let reflection = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let rotation = nearest_rotation(&reflection).unwrap();
        assert!((rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_stretched_rotation_is_found_again() {
        let rotation = *Rotation3::from_euler_angles(0.3, -1.2, 2.0).matrix();
        let found = nearest_rotation(&(rotation * 1.7)).unwrap();
        assert!((found - rotation).norm() < 1e-12);
    }

    #[test]
    fn a_matrix_that_is_not_finite_has_none() {
        assert!(nearest_rotation(&Matrix3::from_element(f64::NAN)).is_none());
    }
}
