//! The closest point of one triangle, exactly.

use crate::Point;

/// The point of triangle `[a, b, c]` that is closest to `point`.
///
/// Works for degenerate triangles too, which are then a segment or a point.
///
/// # Source
///
/// Ericson, "Real-Time Collision Detection", 2005, section 5.1.5: the Voronoi region of the
/// triangle's features in which the point lies decides.
#[must_use]
#[inline]
pub fn closest_point_on_triangle(point: &Point, &[a, b, c]: &[Point; 3]) -> Point {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if 0.0 <= d3 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && 0.0 <= d1 && d3 <= 0.0 {
        return a + ab * ratio(d1, d1 - d3);
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if 0.0 <= d6 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && 0.0 <= d2 && d6 <= 0.0 {
        return a + ac * ratio(d2, d2 - d6);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && 0.0 <= d4 - d3 && 0.0 <= d5 - d6 {
        let share = ratio(d4 - d3, (d4 - d3) + (d5 - d6));
        return b + (c - b) * share;
    }
    let sum = va + vb + vc;
    a + ab * ratio(vb, sum) + ac * ratio(vc, sum)
}

/// `part / whole`, and 0 where both are nothing (an edge without length).
fn ratio(part: f64, whole: f64) -> f64 {
    if whole == 0.0 { 0.0 } else { part / whole }
}

/// The barycentric coordinates of a point in the plane of a triangle; the first corner's where the
/// triangle has no area.
#[must_use]
pub fn barycentric(point: &Point, [a, b, c]: &[Point; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let normal = ab.cross(&ac);
    let square = normal.norm_squared();
    if square <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (u, v) = (
        ap.cross(&ac).dot(&normal) / square,
        ab.cross(&ap).dot(&normal) / square,
    );
    [1.0 - u - v, u, v]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point> {
        prop::array::uniform3(-2.0..2.0_f64).prop_map(Point::from)
    }

    proptest! {
        /// No point of the triangle, sampled densely, is closer than the one returned.
        #[test]
        fn no_sample_of_the_triangle_is_closer(
            p in point(), a in point(), b in point(), c in point(),
        ) {
            let closest = closest_point_on_triangle(&p, &[a, b, c]);
            let distance = (p - closest).norm();
            let steps = 40;
            for i in 0..=steps {
                for j in 0..=(steps - i) {
                    let (u, v) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                    let sample = a + (b - a) * u + (c - a) * v;
                    prop_assert!(distance <= (p - sample).norm() + 1e-12);
                }
            }
        }
    }

    #[test]
    fn barycentric_coordinates_lead_back_to_the_point() {
        let triangle = [[1., 0., 0.], [3., 0., 1.], [1., 2., 1.]].map(Point::from);
        let [a, b, c] = triangle.map(|corner| corner.coords);
        let point = Point::from(a * 0.2 + b * 0.3 + c * 0.5);
        let found = barycentric(&point, &triangle);
        for (found, expected) in found.into_iter().zip([0.2, 0.3, 0.5]) {
            assert!((found - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_triangle_without_area_is_a_segment() {
        let line = [
            Point::new(0., 0., 0.),
            Point::new(1., 0., 0.),
            Point::new(2., 0., 0.),
        ];
        let closest = closest_point_on_triangle(&Point::new(1.5, 1.0, 0.0), &line);
        assert!((closest - Point::new(1.5, 0.0, 0.0)).norm() < 1e-12);
    }
}
