//! Closest point on a triangle mesh.

use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use std::time::Duration;

use crate::{Point, TriangleMesh};

use super::closest_point_on_triangle;

/// The point of a surface that is closest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Where it is.
    pub position: Point,
    /// The face it lies on; the lowest-numbered of several is not guaranteed.
    pub face: u32,
    /// Its distance from the query.
    pub distance: f64,
}

/// A bounding-volume hierarchy over the faces of a mesh.
///
/// The boxes are in `f32`, relative to the mesh's own box and grown by more than their
/// rounding; the triangles are in `f64`, so the distances are exact to rounding.
pub struct TriangleTree {
    hierarchy: Bvh2,
    triangles: Vec<[Point; 3]>,
    origin: Point,
    scale: f64,
}

impl std::fmt::Debug for TriangleTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TriangleTree")
            .field("triangles", &self.triangles.len())
            .finish()
    }
}

/// How far boxes are grown, in units of the mesh's diagonal: above the rounding of `f32`
/// (6e-8) after one subtraction and one product.
const BOX_MARGIN: f32 = 5e-7;

/// Deep enough for 2^64 triangles in a balanced tree; deeper trees continue on the heap.
const EXPECTED_DEPTH: usize = 64;

impl TriangleTree {
    /// Builds the tree; `None` for a mesh without faces, which has no closest point.
    #[must_use]
    pub fn new(mesh: &TriangleMesh) -> Option<Self> {
        if mesh.face_count() == 0 {
            return None;
        }
        let bounds = mesh.bounding_box();
        let diagonal = bounds.diagonal();
        let (origin, scale) = (
            bounds.center(),
            if diagonal > 0.0 { 1.0 / diagonal } else { 1.0 },
        );
        let triangles: Vec<_> = (0..mesh.face_count())
            .map(|face| mesh.triangle(face))
            .collect();
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|t| grown_box(t, &origin, scale))
            .collect();
        let mut params = BvhBuildParams::fast_build();
        params.pre_split = false;
        // The builder reports its own build time, which nobody here asks for.
        let hierarchy = build_bvh2(&boxes, params, &mut Duration::default());
        Some(Self {
            hierarchy,
            triangles,
            origin,
            scale,
        })
    }

    /// The point of the surface closest to `query`.
    #[must_use]
    pub fn closest(&self, query: &Point) -> SurfacePoint {
        self.closest_below(query, f64::INFINITY)
            .unwrap_or(SurfacePoint {
                position: self.triangles[0][0],
                face: 0,
                distance: f64::INFINITY,
            })
    }

    /// The same, told a face that is probably near: the answer of the last search for a query
    /// that has moved a little since. A good guess saves most of the search; the result is as
    /// exact with a bad one.
    ///
    /// # Panics
    ///
    /// If there is no such face.
    #[must_use]
    pub fn closest_from(&self, query: &Point, guess: u32) -> SurfacePoint {
        let position = closest_point_on_triangle(query, self.triangles[guess as usize]);
        let distance = (query - position).norm();
        let guessed = SurfacePoint {
            position,
            face: guess,
            distance,
        };
        self.closest_below(query, distance).unwrap_or(guessed)
    }

    /// The point of the surface closest to `query`, if it is closer than `limit`.
    ///
    /// A tight limit saves most of the search.
    #[must_use]
    pub fn closest_below(&self, query: &Point, limit: f64) -> Option<SurfacePoint> {
        let relative: [f32; 3] = ((query - self.origin) * self.scale)
            .map(|c| c as f32)
            .into();
        let mut best = Best {
            square: limit * limit,
            found: None,
        };
        let mut stack: Vec<(f32, u32)> = Vec::with_capacity(EXPECTED_DEPTH);
        stack.push((0.0, 0));
        while let Some((box_square, node)) = stack.pop() {
            if best.excludes(box_square, self.scale) {
                continue;
            }
            let node = &self.hierarchy.nodes[node as usize];
            if node.is_leaf() {
                self.visit_leaf(node.first_index, node.prim_count, query, &mut best);
                continue;
            }
            let child = |index: u32| {
                (
                    square_distance(&relative, self.hierarchy.nodes[index as usize].aabb()),
                    index,
                )
            };
            let (left, right) = (child(node.first_index), child(node.first_index + 1));
            let (near, far) = if left.0 <= right.0 {
                (left, right)
            } else {
                (right, left)
            };
            stack.push(far);
            stack.push(near);
        }
        best.found.map(|(position, face)| SurfacePoint {
            position,
            face,
            distance: best.square.sqrt(),
        })
    }

    fn visit_leaf(&self, first: u32, count: u32, query: &Point, best: &mut Best) {
        for slot in first..first + count {
            let face = self.hierarchy.primitive_indices[slot as usize];
            let position = closest_point_on_triangle(query, self.triangles[face as usize]);
            let square = (query - position).norm_squared();
            if square < best.square {
                *best = Best {
                    square,
                    found: Some((position, face)),
                };
            }
        }
    }
}

struct Best {
    square: f64,
    found: Option<(Point, u32)>,
}

impl Best {
    /// Whether a box at this (relative) squared distance cannot hold anything closer.
    fn excludes(&self, box_square: f32, scale: f64) -> bool {
        // The box is grown by more than its own rounding; this factor covers that of the
        // squared distance and of the query's coordinates far away from the mesh.
        self.square * scale * scale * (1.0 + 1e-5) < f64::from(box_square) * (1.0 - 1e-5)
    }
}

fn grown_box(triangle: &[Point; 3], origin: &Point, scale: f64) -> Aabb {
    let mut bounds = Aabb::empty();
    for corner in triangle {
        let [x, y, z]: [f32; 3] = ((corner - origin) * scale).map(|c| c as f32).into();
        bounds.extend([x, y, z].into());
    }
    bounds.min -= BOX_MARGIN;
    bounds.max += BOX_MARGIN;
    bounds
}

fn square_distance(point: &[f32; 3], bounds: &Aabb) -> f32 {
    let (min, max) = (bounds.min.to_array(), bounds.max.to_array());
    (0..3)
        .map(|axis| {
            let outside = (min[axis] - point[axis])
                .max(point[axis] - max[axis])
                .max(0.0);
            outside * outside
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud_of_triangles(corners: &[[f64; 3]], unit: f64) -> TriangleMesh {
        let positions: Vec<Point> = corners.iter().map(|&c| Point::from(c) * unit).collect();
        let faces = (0..corners.len() as u32 / 3)
            .map(|f| [3 * f, 3 * f + 1, 3 * f + 2])
            .collect();
        TriangleMesh::new(positions, faces).unwrap()
    }

    proptest! {
        /// The tree finds what looking at every triangle finds, in any unit.
        #[test]
        fn the_tree_agrees_with_looking_at_every_triangle(
            corners in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 3..120),
            query in prop::array::uniform3(-3.0..3.0_f64),
            unit in prop::sample::select(vec![1e-6, 1.0, 1e6]),
        ) {
            let mesh = cloud_of_triangles(&corners, unit);
            let query = Point::from(query) * unit;
            let brute = (0..mesh.face_count())
                .map(|f| (query - closest_point_on_triangle(&query, mesh.triangle(f))).norm())
                .fold(f64::INFINITY, f64::min);
            let tree = TriangleTree::new(&mesh).unwrap();
            prop_assert!((tree.closest(&query).distance - brute).abs() <= 1e-12 * unit);
            for guess in 0..mesh.face_count() as u32 {
                let found = tree.closest_from(&query, guess);
                prop_assert!((found.distance - brute).abs() <= 1e-12 * unit);
            }
        }
    }

    #[test]
    fn nothing_is_found_below_a_limit_that_is_too_small() {
        let mesh = cloud_of_triangles(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], 1.0);
        let tree = TriangleTree::new(&mesh).unwrap();
        assert!(
            tree.closest_below(&Point::new(0.0, 0.0, 1.0), 0.5)
                .is_none()
        );
    }
}
