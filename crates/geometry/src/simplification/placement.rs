//! Where the merged vertex goes.

use crate::Point;

use super::Quadric;

/// C_max of Algorithm 1; the paper's choice.
const MAX_SEARCH_STEPS: usize = 4;

/// The position of the vertex that replaces the edge between `v1` and `v2`.
///
/// The minimizer of `quadric` where there is one (Eq. 15); else the two-stage search of section
/// 3.3: along the edge, then from there towards the reference's `barycenter`, if there is one.
pub(super) fn place(
    quadric: &Quadric,
    v1: &Point,
    v2: &Point,
    barycenter: Option<&Point>,
) -> Point {
    if let Some(position) = quadric.minimizer() {
        return position;
    }
    let on_edge = search_segment(quadric, *v1, *v2);
    barycenter.map_or(on_edge, |barycenter| {
        search_segment(quadric, on_edge, *barycenter)
    })
}

/// Algorithm 1: the cheapest of the points that halving the segment visits.
///
/// The step that fails the algorithm's test changes nothing, so that all later ones would fail
/// it too: it ends the search. `v2` wins a tie against the middle's right half, `v1` one between
/// the endpoints.
fn search_segment(quadric: &Quadric, mut v1: Point, mut v2: Point) -> Point {
    let cost = |v: &Point| quadric.cost(v);
    let mut middle = nalgebra::center(&v1, &v2);
    let mut best = v1;
    for _ in 0..MAX_SEARCH_STEPS {
        let goes_on = cost(&middle) < cost(&v1).min(cost(&v2));
        for candidate in [v2, middle] {
            if cost(&candidate) < cost(&best) {
                best = candidate;
            }
        }
        if !goes_on {
            break;
        }
        let (left, right) = (
            nalgebra::center(&v1, &middle),
            nalgebra::center(&middle, &v2),
        );
        if cost(&left) < cost(&right) {
            (v2, middle) = (middle, left);
        } else {
            (v1, middle) = (middle, right);
        }
    }
    if cost(&middle) < cost(&best) {
        middle
    } else {
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    fn plane(point: [f64; 3], normal: Vector) -> Quadric {
        Quadric::of_plane(&Point::from(point), &normal, 1.0)
    }

    #[test]
    fn three_planes_place_the_vertex_at_their_corner() {
        let corner = plane([1., 2., 3.], Vector::x())
            + plane([1., 2., 3.], Vector::y())
            + plane([1., 2., 3.], Vector::z());
        let placed = place(&corner, &Point::origin(), &Point::new(1., 1., 1.), None);
        assert!((placed - Point::new(1., 2., 3.)).norm() < 1e-12);
    }

    #[test]
    fn a_singular_quadric_is_searched_along_the_edge() {
        let wall = plane([0.3, 0., 0.], Vector::x());
        let placed = place(&wall, &Point::origin(), &Point::new(1., 0., 0.), None);
        // Four halvings narrow the segment down to a sixteenth of the edge.
        assert!((placed.x - 0.3).abs() <= 1.0 / 16.0, "{placed}");
    }

    #[test]
    fn the_second_stage_goes_towards_the_barycenter() {
        // The edge runs along the plane z = 1, so that only the second stage can get lower.
        let floor = plane([0., 0., 0.], Vector::z());
        let barycenter = Point::new(0.5, 0.0, -1.0);
        let (v1, v2) = (Point::new(0., 0., 1.), Point::new(1., 0., 1.));
        let placed = place(&floor, &v1, &v2, Some(&barycenter));
        assert!(placed.z.abs() < 1e-12, "{placed}");
    }
}
