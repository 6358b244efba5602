//! The rigid motion between paired points, in closed form.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};

use crate::registration::{RegistrationError, nearest_rotation};
use crate::{Point, Vector};

use super::MIN_CORRESPONDENCES;

/// Finds the rigid transform that minimizes Σ‖T·`source[i]` − `target[i]`‖².
///
/// Returns `target_from_source`. Collinear points leave the rotation about their line free;
/// the result is then one of the minimizers.
///
/// # Errors
///
/// [`RegistrationError::CountMismatch`] if the slices differ in length,
/// [`RegistrationError::TooFewCorrespondences`] below [`MIN_CORRESPONDENCES`], and
/// [`RegistrationError::NotFinite`] for points that are not finite.
///
/// # Source
///
/// Eq. 7 of the Tracked QEM paper with Ω = I; Umeyama, "Least-Squares Estimation of
/// Transformation Parameters Between Two Point Patterns", IEEE TPAMI 13(4), 1991,
/// <https://doi.org/10.1109/34.88573>, with the scale fixed to 1.
pub fn fit_rigid(source: &[Point], target: &[Point]) -> Result<Isometry3<f64>, RegistrationError> {
    let (source_count, target_count) = (source.len(), target.len());
    if source_count != target_count {
        return Err(RegistrationError::CountMismatch {
            source_count,
            target_count,
        });
    }
    if source_count < MIN_CORRESPONDENCES {
        return Err(RegistrationError::TooFewCorrespondences {
            found: source_count,
            needed: MIN_CORRESPONDENCES,
        });
    }
    let (source_mean, target_mean) = (centroid(source), centroid(target));
    let covariance: Matrix3<f64> = source
        .iter()
        .zip(target)
        .map(|(s, t)| (t.coords - target_mean) * (s.coords - source_mean).transpose())
        .sum();
    // Scaled so that its entries are near one: the rotation does not depend on the unit.
    let size = covariance.amax();
    let covariance = if size > 0.0 {
        covariance / size
    } else {
        covariance
    };
    let rotation =
        nearest_rotation(&covariance).ok_or(RegistrationError::NotFinite { step: "rigid" })?;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let translation = Translation3::from(target_mean - rotation * source_mean);
    Ok(Isometry3::from_parts(translation, rotation))
}

fn centroid(points: &[Point]) -> Vector {
    points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn tetrahedron() -> Vec<Point> {
        [[0., 0., 0.], [1., 0., 0.], [0., 2., 0.], [0., 0., 3.]]
            .map(Point::from)
            .to_vec()
    }

    proptest! {
        /// Whatever rigid motion produced the target, the fit finds it again.
        #[test]
        fn fit_rigid_recovers_the_applied_motion(
            axis_angle in prop::array::uniform3(-3.0..3.0_f64),
            shift in prop::array::uniform3(-10.0..10.0_f64),
        ) {
            let target_from_source = Isometry3::new(shift.into(), axis_angle.into());
            let source = tetrahedron();
            let target: Vec<Point> = source.iter().map(|p| target_from_source * p).collect();

            let fitted = fit_rigid(&source, &target).unwrap();

            for (s, t) in source.iter().zip(&target) {
                prop_assert!((fitted * s - t).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn two_pairs_are_too_few() {
        let two = &tetrahedron()[..2];
        let error = fit_rigid(two, two).unwrap_err();
        let expected = RegistrationError::TooFewCorrespondences {
            found: 2,
            needed: 3,
        };
        assert_eq!(error, expected);
    }
}
