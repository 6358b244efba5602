//! D1 and D2: the point-to-point and point-to-plane errors of point-cloud coding, and their PSNR.

use crate::spatial::VertexTree;
use crate::{Point, TriangleMesh, Vector};

use super::surface_samples::surface_samples;

/// Points with normals, to be compared with others.
#[derive(Debug)]
pub struct OrientedPoints {
    positions: Vec<Point>,
    normals: Vec<Vector>,
    tree: VertexTree,
}

impl OrientedPoints {
    /// The vertices of `mesh` and their normals, faces weighted by area; none if it has none.
    #[must_use]
    pub fn vertices_of(mesh: &TriangleMesh) -> Option<Self> {
        Some(Self {
            positions: mesh.positions().to_vec(),
            normals: mesh.vertex_normals().to_vec(),
            tree: VertexTree::new(mesh.positions())?,
        })
    }

    /// `count` samples spread evenly over `mesh` and the normals of their faces; none if it has no
    /// area.
    #[must_use]
    pub fn samples_of(mesh: &TriangleMesh, count: usize) -> Option<Self> {
        let samples = surface_samples(mesh, count);
        let of_faces = mesh.face_normals();
        let positions: Vec<Point> = samples.iter().map(|sample| sample.position).collect();
        Some(Self {
            normals: samples.iter().map(|sample| of_faces[sample.face]).collect(),
            tree: VertexTree::new(&positions)?,
            positions,
        })
    }
}

/// One-sided mean square errors, in the square of the points' unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointErrors {
    /// Point to point: (1/n) Σ ‖aᵢ − bⱼ₍ᵢ₎‖², where bⱼ₍ᵢ₎ is the point nearest to aᵢ.
    pub d1: f64,
    /// Point to plane: (1/n) Σ ((aᵢ − bⱼ₍ᵢ₎) · nⱼ₍ᵢ₎)², where nⱼ is the normal at bⱼ.
    pub d2: f64,
}

/// The errors from the points of `from` to those of `to`.
///
/// One-sided: MPEG states the worse of both directions, that is the larger error.
///
/// # Source
///
/// Tian, Ochimizu, Feng, Cohen and Vetro, "Geometric Distortion Metrics for Point Cloud
/// Compression", ICIP 2017, <https://doi.org/10.1109/ICIP.2017.8296925>. There, a decoded cloud
/// has no normals and borrows those of the original; here both are meshes, each with its own.
#[must_use]
pub fn point_errors(from: &OrientedPoints, to: &OrientedPoints) -> PointErrors {
    let (mut d1, mut d2) = (0.0, 0.0);
    for point in &from.positions {
        let nearest = to.tree.nearest(point).0 as usize;
        let error = point - to.positions[nearest];
        let along_normal = error.dot(&to.normals[nearest]);
        d1 += error.norm_squared();
        d2 += along_normal * along_normal;
    }
    let count = from.positions.len() as f64;
    PointErrors {
        d1: d1 / count,
        d2: d2 / count,
    }
}

/// 10 log₁₀(`peak`² / `mean_square_error`), in dB; none for an error of 0.
///
/// `peak` is in the unit whose square that of the error is. Tian et al. take the diagonal of the
/// bounding box. The MPEG software takes 3 p² for `peak`², where p = 2^bits − 1 is the side of the
/// cube of voxels, so that √3 p is that cube's diagonal.
#[must_use]
pub fn psnr(mean_square_error: f64, peak: f64) -> Option<f64> {
    (0.0 < mean_square_error).then(|| 10.0 * (peak * peak / mean_square_error).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The triangle (0, 0), (1, 0), (0, 1), moved.
    fn triangle(by: Vector) -> TriangleMesh {
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
        let positions = corners.map(|corner| Point::from(corner) + by);
        TriangleMesh::new(positions.to_vec(), vec![[0, 1, 2]]).unwrap()
    }

    fn vertices(mesh: &TriangleMesh) -> OrientedPoints {
        OrientedPoints::vertices_of(mesh).unwrap()
    }

    #[test]
    fn sliding_along_the_surface_is_an_error_to_points_but_not_to_planes() {
        let slid = triangle(Vector::new(0.1, 0.2, 0.0));
        let errors = point_errors(&vertices(&slid), &vertices(&triangle(Vector::zeros())));
        assert!((errors.d1 - 0.05).abs() < 1e-15 && errors.d2 == 0.0);
    }

    #[test]
    fn only_the_part_along_the_normal_counts_to_planes() {
        let moved = triangle(Vector::new(0.1, 0.0, 0.3));
        let errors = point_errors(&vertices(&moved), &vertices(&triangle(Vector::zeros())));
        assert!((errors.d1 - 0.10).abs() < 1e-15, "{errors:?}");
        assert!((errors.d2 - 0.09).abs() < 1e-15, "{errors:?}");
    }

    #[test]
    fn the_directions_differ_where_one_cloud_has_more() {
        let near = triangle(Vector::zeros());
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 4., 0.]];
        let faces = vec![[0, 1, 2], [1, 3, 2]];
        let more = TriangleMesh::new(corners.map(Point::from).to_vec(), faces).unwrap();
        let (near, more) = (vertices(&near), vertices(&more));
        assert_eq!(point_errors(&near, &more).d1, 0.0);
        // Only (0, 4) has no partner: 3 away from (0, 1), one of four points.
        assert_eq!(point_errors(&more, &near).d1, 9.0 / 4.0);
    }

    #[test]
    fn even_samples_of_a_lifted_plane_are_off_by_its_height() {
        let samples = |by| OrientedPoints::samples_of(&triangle(by), 1000).unwrap();
        let errors = point_errors(&samples(Vector::z() * 0.5), &samples(Vector::zeros()));
        assert!((errors.d2 - 0.25).abs() < 1e-12, "{errors:?}");
        assert!((errors.d1 - 0.25).abs() < 1e-12, "{errors:?}");
    }

    #[test]
    fn an_error_of_a_thousandth_of_the_peak_is_sixty_decibels() {
        assert!((psnr(4e-6, 2.0).unwrap() - 60.0).abs() < 1e-9);
        assert_eq!(psnr(0.0, 2.0), None);
    }

    #[test]
    fn without_points_there_is_nothing_to_compare() {
        let flat = TriangleMesh::new(vec![Point::origin(); 3], vec![[0, 1, 2]]).unwrap();
        assert!(OrientedPoints::samples_of(&flat, 100).is_none());
    }
}
