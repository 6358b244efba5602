//! Face and vertex normals.

use crate::{Point, TriangleMesh, Vector};

/// The unit normal of a triangle, or `None` if its corners lie on one line.
///
/// "On one line" is judged against the triangle's own size: a height below 1e-12 of the
/// longest edge is what `f64` rounding makes of none.
#[must_use]
#[inline]
pub fn face_normal([a, b, c]: [Point; 3]) -> Option<Vector> {
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let longest = ab
        .norm_squared()
        .max(ac.norm_squared())
        .max(bc.norm_squared());
    let cross = ab.cross(&ac);
    let doubled_area = cross.norm();
    (1e-12 * longest < doubled_area).then(|| cross / doubled_area)
}

/// [`TriangleMesh::face_normals`].
pub(super) fn face_normals(mesh: &TriangleMesh) -> Vec<Vector> {
    (0..mesh.face_count())
        .map(|face| face_normal(mesh.triangle(face)).unwrap_or_else(Vector::zeros))
        .collect()
}

/// [`TriangleMesh::vertex_normals`].
pub(super) fn vertex_normals(mesh: &TriangleMesh) -> Vec<Vector> {
    let mut sums = vec![Vector::zeros(); mesh.vertex_count()];
    for (index, face) in mesh.faces().iter().enumerate() {
        let [a, b, c] = mesh.triangle(index);
        let weighted = (b - a).cross(&(c - a));
        for &corner in face {
            sums[corner as usize] += weighted;
        }
    }
    sums.iter()
        .map(|sum| sum.try_normalize(0.0).unwrap_or_else(Vector::zeros))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counterclockwise_triangle_faces_the_viewer() {
        let triangle = [
            Point::new(0., 0., 0.),
            Point::new(1., 0., 0.),
            Point::new(0., 1., 0.),
        ];
        assert_eq!(face_normal(triangle), Some(Vector::z()));
    }

    #[test]
    fn three_points_on_a_line_have_no_normal_whatever_the_unit() {
        for unit in [1e-9, 1.0, 1e9] {
            let triangle = [0.1, 0.2, 0.3].map(|t| Point::new(t * unit, 3.0 * t * unit, 0.0));
            assert_eq!(face_normal(triangle), None);
        }
    }
}
