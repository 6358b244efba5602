//! Projection onto the rotations.

use nalgebra::Matrix3;

/// Steps of the singular value decomposition; it needs about ten for any 3 x 3 matrix.
const MAX_SVD_STEPS: usize = 100;

/// Steps of Newton's iteration; what is close to a rotation needs three or four.
const MAX_NEWTON_STEPS: usize = 10;

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
    if let Some(rotation) = polar_rotation(matrix) {
        return Some(rotation);
    }
    let svd = matrix.try_svd(true, true, f64::EPSILON, MAX_SVD_STEPS)?;
    let (mut u, v_t) = (svd.u?, svd.v_t?);
    if u.determinant() * v_t.determinant() < 0.0 {
        // Singular values are in descending order: the last direction matters least.
        u.column_mut(2).neg_mut();
    }
    Some(u * v_t)
}

/// The rotation in the polar decomposition of a matrix that is not far from one: then it is the
/// closest, for a tenth of the time. `None` for a reflection and for what converges slowly.
///
/// # Source
///
/// Higham, "Computing the Polar Decomposition - with Applications", SIAM J. Sci. Stat. Comput.
/// 7(4), 1986, <https://doi.org/10.1137/0907079>: X becomes (X + X⁻ᵀ) / 2, quadratically.
fn polar_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let mut x = *matrix;
    for _ in 0..MAX_NEWTON_STEPS {
        let (a, b, c) = (x.column(0), x.column(1), x.column(2));
        let (bc, ca, ab) = (b.cross(&c), c.cross(&a), a.cross(&b));
        let determinant = a.dot(&bc);
        // Far from ±1 the first steps would only halve or double.
        if !(0.05..20.0).contains(&determinant) {
            return None;
        }
        // The columns of X⁻ᵀ times the determinant are the cross products.
        let next = (x + Matrix3::from_columns(&[bc, ca, ab]) / determinant) / 2.0;
        let change = (next - x).norm_squared();
        x = next;
        // The next change would be the square of this one: below rounding.
        if change < 1e-17 {
            return Some(x);
        }
    }
    None
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
