//! One step of the rigid motion that brings points onto planes.

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector6};

use crate::registration::RegistrationError;
use crate::{Point, Vector};

/// Six unknowns need six planes.
const MIN_PLANES: usize = 6;

/// How much of the largest diagonal entry is added to all: enough to hold directions in which
/// the planes say nothing (a sphere's rotations, a plane's translations), too little to matter
/// in the others.
const DAMPING: f64 = 1e-9;

/// Finds the small rigid motion T that minimizes Σ (nᵢ·(T·pᵢ − qᵢ))² over `(p, q, n)`:
/// a point, a point of its plane, and the plane's unit normal.
///
/// The rotation is linearised about the identity, so the result is exact only in the limit of
/// small angles: iterate it. Directions that no plane constrains are left alone.
///
/// # Errors
///
/// [`RegistrationError::TooFewCorrespondences`] below six planes,
/// [`RegistrationError::NotFinite`] if the solve gives none.
///
/// # Source
///
/// Chen and Medioni, "Object Modelling by Registration of Multiple Range Images", Image and
/// Vision Computing 10(3), 1992, <https://doi.org/10.1016/0262-8856(92)90066-C>; linearised as
/// in Low, "Linear Least-Squares Optimization for Point-to-Plane ICP Surface Registration",
/// UNC TR04-004, 2004.
pub fn fit_point_to_plane(
    planes: &[(Point, Point, Vector)],
) -> Result<Isometry3<f64>, RegistrationError> {
    if planes.len() < MIN_PLANES {
        return Err(RegistrationError::TooFewCorrespondences {
            found: planes.len(),
            needed: MIN_PLANES,
        });
    }
    // Rotating about the centroid and measuring in units of the spread keeps rotation and
    // translation of one size, whatever the unit and the place.
    let count = planes.len() as f64;
    let center = Point::from(planes.iter().map(|(p, _, _)| p.coords).sum::<Vector>() / count);
    let spread = (planes
        .iter()
        .map(|(p, _, _)| (p - center).norm_squared())
        .sum::<f64>()
        / count)
        .sqrt();
    let unit = if spread > 0.0 { spread } else { 1.0 };

    let mut matrix = Matrix6::<f64>::zeros();
    let mut right = Vector6::<f64>::zeros();
    for (p, q, n) in planes {
        let arm = ((p - center) / unit).cross(n);
        let row = Vector6::new(arm.x, arm.y, arm.z, n.x, n.y, n.z);
        matrix += row * row.transpose();
        right += row * (n.dot(&(q - p)) / unit);
    }
    let damping = DAMPING * matrix.diagonal().max();
    matrix += Matrix6::identity() * damping;
    let not_finite = RegistrationError::NotFinite { step: "rigid" };
    let solution = matrix.cholesky().ok_or(not_finite.clone())?.solve(&right);
    if !solution.iter().all(|x| x.is_finite()) {
        return Err(not_finite);
    }
    let rotation = UnitQuaternion::from_scaled_axis(solution.fixed_rows::<3>(0).into_owned());
    let shift = solution.fixed_rows::<3>(3) * unit;
    let translation = center.coords + shift - rotation * center.coords;
    Ok(Isometry3::from_parts(
        Translation3::from(translation),
        rotation,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iterating_the_step_recovers_a_motion_of_known_planes() {
        let motion = Isometry3::new(Vector::new(0.1, -0.2, 0.05), Vector::new(0.1, 0.2, -0.1));
        let samples: Vec<(Point, Vector)> = (0..60)
            .map(|i| {
                let t = f64::from(i);
                let p = Point::new(t.sin(), (1.7 * t).cos(), (0.3 * t).sin());
                (
                    p,
                    Vector::new((2.1 * t).cos(), (0.9 * t).sin(), 0.3).normalize(),
                )
            })
            .collect();
        let mut moved: Vec<Point> = samples.iter().map(|(p, _)| motion.inverse() * p).collect();
        for _ in 0..10 {
            let planes: Vec<_> = moved
                .iter()
                .zip(&samples)
                .map(|(p, (q, n))| (*p, *q, *n))
                .collect();
            let step = fit_point_to_plane(&planes).unwrap();
            moved.iter_mut().for_each(|p| *p = step * *p);
        }
        for (p, (q, n)) in moved.iter().zip(&samples) {
            assert!(n.dot(&(p - q)).abs() < 1e-9);
        }
    }

    #[test]
    fn five_planes_are_too_few_and_the_error_says_how_many_are_needed() {
        let plane = (Point::origin(), Point::origin(), Vector::x());
        let error = fit_point_to_plane(&[plane; 5]).unwrap_err().to_string();
        assert_eq!(
            error,
            "too few correspondences: 5, where at least 6 are needed"
        );
    }

    #[test]
    fn one_plane_many_times_moves_along_its_normal_only() {
        let corner = |x, y| (Point::new(x, y, 0.5), Point::new(x, y, 0.0), Vector::z());
        let planes =
            [(0., 0.), (1., 0.), (0., 1.), (1., 1.), (2., 0.), (0., 2.)].map(|(x, y)| corner(x, y));
        let step = fit_point_to_plane(&planes).unwrap();
        assert!((step * planes[3].0 - Point::new(1.0, 1.0, 0.0)).norm() < 1e-6);
    }
}
