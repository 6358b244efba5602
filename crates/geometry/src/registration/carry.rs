//! Carries what stands on the source along with it.

use crate::mesh::face_normal;
use crate::spatial::{SurfacePoint, barycentric};
use crate::{Point, TriangleMesh, Vector};

/// A point that was carried along.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// Where it is now.
    pub position: Point,
    /// The point of the registered surface that it stands on.
    pub foot: Point,
    /// The unit normal of the registered surface there; zero if it has none.
    pub normal: Vector,
    /// How far above that surface it is, along the normal.
    pub height: f64,
    /// A face of what the source was registered onto that is probably near.
    pub near: u32,
}

/// Carries points that are near `source` to where `registered` has it: the same mesh at other
/// positions. Each point comes with its foot, the point of the surface that is closest to it.
///
/// `near` has a face near every registered vertex, of the mesh that it was registered onto.
///
/// A point keeps its place in its foot's face: the foot's barycentric coordinates, the height along
/// the face's normal, and the rest of its offset unturned.
///
/// # Panics
///
/// If one of the meshes has fewer faces than a foot says, or `near` fewer vertices.
#[must_use]
pub fn carry(
    points: &[Point],
    feet: &[SurfacePoint],
    (source, registered): (&TriangleMesh, &TriangleMesh),
    near: &[u32],
) -> Vec<Carried> {
    let carry_one = |(point, closest): (&Point, &SurfacePoint)| {
        let (from, to) = (
            source.triangle(closest.face as usize),
            registered.triangle(closest.face as usize),
        );
        let shares = barycentric(&closest.position, &from);
        let foot = Point::from(
            to[0].coords * shares[0] + to[1].coords * shares[1] + to[2].coords * shares[2],
        );
        let normal_of = |triangle| face_normal(triangle).unwrap_or_default();
        let (before, after) = (normal_of(from), normal_of(to));
        let offset = point - closest.position;
        let height = offset.dot(&before);
        Carried {
            position: foot + (offset - before * height) + after * height,
            foot,
            normal: after,
            height,
            near: near[source.faces()[closest.face as usize][0] as usize],
        }
    };
    points.iter().zip(feet).map(carry_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::TriangleTree;
    use nalgebra::{Isometry3, Vector3};

    #[test]
    fn a_point_above_a_face_goes_where_a_rigid_motion_takes_it() {
        let corners = [[0., 0., 0.], [2., 0., 0.], [0., 2., 0.]].map(Point::from);
        let source = TriangleMesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
        let motion = Isometry3::new(Vector3::new(3., -1., 2.), Vector3::new(0.4, 0.9, -0.2));
        let moved = corners.iter().map(|p| motion * p).collect();
        let registered = source.with_positions(moved).unwrap();
        let point = Point::new(0.5, 0.3, 0.2);
        let surface = TriangleTree::new(&source).unwrap();
        let feet = [surface.closest(&point)];
        let carried = carry(&[point], &feet, (&source, &registered), &[0; 3])[0];
        assert!((carried.position - motion * point).norm() < 1e-12);
        assert!((carried.foot - motion * Point::new(0.5, 0.3, 0.0)).norm() < 1e-12);
        assert!((carried.height - 0.2).abs() < 1e-12);
    }
}
