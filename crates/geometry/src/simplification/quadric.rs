//! The quadric error metric.

use crate::{Point, Vector};

/// Δ(v) = vᵀQv: the sum of the squared distances from a point to a set of planes.
///
/// Held as Δ(v) = vᵀAv + 2b·v + c with A the upper left 3 x 3 part of Q, which for planes with
/// unit normals does not depend on the unit of length.
///
/// # Source
///
/// Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics", SIGGRAPH 1997,
/// <https://doi.org/10.1145/258734.258849>; Eq. 5 and 14 of the Tracked QEM paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quadric {
    /// A's entries xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: Vector,
    c: f64,
}

impl Default for Quadric {
    fn default() -> Self {
        Self {
            a: [0.0; 6],
            b: Vector::zeros(),
            c: 0.0,
        }
    }
}

/// det A must exceed this share of (trace A / 3)³ for A to count as invertible.
///
/// The ratio is 1 for planes in all directions alike and 0 for parallel ones, whatever the unit
/// and however many the planes. Tuned on human captures: below 1e-5 vertices wander along
/// nearly flat regions, above 1e-2 features lose their corners.
const MIN_RELATIVE_DETERMINANT: f64 = 1e-4;

impl Quadric {
    /// The squared distance to the plane through `point` with the unit `normal`, times `weight`:
    /// K_p of Eq. 5.
    #[must_use]
    pub fn of_plane(point: &Point, normal: &Vector, weight: f64) -> Self {
        let n = normal;
        let d = -n.dot(&point.coords);
        let a = [
            n.x * n.x,
            n.x * n.y,
            n.x * n.z,
            n.y * n.y,
            n.y * n.z,
            n.z * n.z,
        ];
        Self {
            a: a.map(|entry| entry * weight),
            b: n * (d * weight),
            c: d * d * weight,
        }
    }

    /// The squared distance to a point, times `weight`.
    #[must_use]
    pub fn of_point(point: &Point, weight: f64) -> Self {
        Self {
            a: [weight, 0.0, 0.0, weight, 0.0, weight],
            b: point.coords * -weight,
            c: point.coords.norm_squared() * weight,
        }
    }

    /// All ten coefficients: A's, b's and c.
    pub(super) fn coefficients(&self) -> [f64; 10] {
        let ([xx, xy, xz, yy, yz, zz], b) = (self.a, self.b);
        [xx, xy, xz, yy, yz, zz, b.x, b.y, b.z, self.c]
    }

    /// The quadric that has these [`coefficients`](Self::coefficients).
    pub(super) fn from_coefficients(coefficients: [f64; 10]) -> Self {
        let [xx, xy, xz, yy, yz, zz, x, y, z, c] = coefficients;
        Self {
            a: [xx, xy, xz, yy, yz, zz],
            b: Vector::new(x, y, z),
            c,
        }
    }

    /// Δ(v), not below zero.
    #[must_use]
    #[inline]
    pub fn cost(&self, v: &Point) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let product = Vector::new(
            xx * v.x + xy * v.y + xz * v.z,
            xy * v.x + yy * v.y + yz * v.z,
            xz * v.x + yz * v.y + zz * v.z,
        );
        (v.coords.dot(&(product + 2.0 * self.b)) + self.c).max(0.0)
    }

    /// The point of least cost (Eq. 6 and 15), or `None` where the matrix is too close to a
    /// singular one to say ("irreversible").
    #[must_use]
    #[inline]
    pub fn minimizer(&self) -> Option<Point> {
        self.minimizer_above(MIN_RELATIVE_DETERMINANT)
    }

    /// The same with another threshold for det A relative to (trace A / 3)³.
    #[inline]
    pub(super) fn minimizer_above(&self, min_relative_determinant: f64) -> Option<Point> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        // The adjugate of A, which is symmetric too.
        let (first, second, third) = (yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz);
        let determinant = xx * first + xy * second + xz * third;
        let mean = (xx + yy + zz) / 3.0;
        if determinant <= min_relative_determinant * mean * mean * mean {
            return None;
        }
        let (fourth, fifth, sixth) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
        let b = &self.b;
        let product = Vector::new(
            first * b.x + second * b.y + third * b.z,
            second * b.x + fourth * b.y + fifth * b.z,
            third * b.x + fifth * b.y + sixth * b.z,
        );
        Some(Point::from(product * (-1.0 / determinant)))
    }
}

impl std::ops::Add for Quadric {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

impl std::ops::AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        self.a
            .iter_mut()
            .zip(other.a)
            .for_each(|(sum, term)| *sum += term);
        self.b += other.b;
        self.c += other.c;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plane() -> impl Strategy<Value = (Point, Vector)> {
        let coordinates = prop::array::uniform3(-1.0..1.0_f64);
        (coordinates.clone(), coordinates)
            .prop_filter("a direction", |(_, n)| Vector::from(*n).norm() > 0.1)
            .prop_map(|(p, n)| (Point::from(p), Vector::from(n).normalize()))
    }

    proptest! {
        /// The quadratic form is the sum of squared distances it stands for.
        #[test]
        fn the_cost_is_the_sum_of_squared_distances_to_the_planes(
            planes in prop::collection::vec(plane(), 1..8),
            v in prop::array::uniform3(-2.0..2.0_f64),
        ) {
            let v = Point::from(v);
            let sum = planes
                .iter()
                .fold(Quadric::default(), |sum, (p, n)| sum + Quadric::of_plane(p, n, 1.0));
            let direct: f64 = planes.iter().map(|(p, n)| n.dot(&(v - p)).powi(2)).sum();
            prop_assert!((sum.cost(&v) - direct).abs() < 1e-12);
        }

        /// No point around the minimizer costs less.
        #[test]
        fn the_minimizer_costs_least(
            planes in prop::collection::vec(plane(), 3..8),
            step in prop::array::uniform3(-0.1..0.1_f64),
        ) {
            let sum = planes
                .iter()
                .fold(Quadric::default(), |sum, (p, n)| sum + Quadric::of_plane(p, n, 1.0));
            if let Some(best) = sum.minimizer() {
                prop_assert!(sum.cost(&best) <= sum.cost(&(best + Vector::from(step))) + 1e-9);
            }
        }
    }

    #[test]
    fn parallel_planes_have_no_minimizer_in_any_unit() {
        for unit in [1e-6, 1.0, 1e6] {
            let at = |z: f64| Quadric::of_plane(&Point::new(0.0, 0.0, z * unit), &Vector::z(), 1.0);
            assert_eq!((at(0.0) + at(1.0)).minimizer(), None);
        }
    }
}
