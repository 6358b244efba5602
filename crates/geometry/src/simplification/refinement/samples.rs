//! The mesh that was simplified, as points on the faces of the simplified one.

use crate::spatial::{TriangleTree, closest_point_on_triangle, near_vertices};
use crate::{Point, TriangleMesh};

/// The vertices of a mesh, each with the face of the simplified mesh that is closest to it.
pub(super) struct Samples<'a> {
    points: &'a [Point],
    /// By face of the simplified mesh.
    of_faces: Vec<Vec<u32>>,
    count: usize,
    /// The mean square distance.
    pub mean_square: f64,
}

/// A vertex belongs to a face only if the cosine between their normals is at least this: what is
/// nearest may be the other side of a thin part.
const MIN_COSINE: f64 = 0.2;

/// How close, in mean edges, a vertex is to a face that it is straight above for that to count
/// without a look at the rest.
const NEAR: f64 = 0.15;

/// The same for a vertex that is much further away than its neighbor: most of those are both close.
const SURE: f64 = 0.045;

impl<'a> Samples<'a> {
    /// Finds the face of each vertex of `mesh`; `None` if `simplified` has none.
    pub fn new(mesh: &'a TriangleMesh, simplified: &TriangleMesh) -> Option<Self> {
        let tree = TriangleTree::new(simplified)?;
        let (normals, face_normals) = (mesh.vertex_normals(), simplified.face_normals());
        let mut of_faces = vec![Vec::new(); simplified.face_count()];
        let (mut count, mut sum) = (0, 0.0);
        let mean_edge = simplified.mean_edge();
        let found = near_vertices(mesh, &tree, (SURE * mean_edge, NEAR * mean_edge));
        for (index, (closest, normal)) in found.iter().zip(normals).enumerate() {
            if face_normals[closest.face as usize].dot(normal) < MIN_COSINE {
                continue;
            }
            of_faces[closest.face as usize].push(index as u32);
            count += 1;
            sum += closest.distance * closest.distance;
        }
        Some(Self {
            points: mesh.positions(),
            of_faces,
            count,
            mean_square: if count == 0 { 0.0 } else { sum / count as f64 },
        })
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Those of one face.
    pub fn on(&self, face: u32) -> impl ExactSizeIterator<Item = &Point> {
        let indices = &self.of_faces[face as usize];
        indices.iter().map(|&index| &self.points[index as usize])
    }

    /// The sum of the square distances from the samples of two faces to two triangles, each to
    /// the nearer one.
    pub fn square_distances(&self, faces: [u32; 2], triangles: &[[Point; 3]; 2]) -> f64 {
        let square = |point: &Point, triangle| {
            (closest_point_on_triangle(point, triangle) - point).norm_squared()
        };
        let nearer = |point| square(point, &triangles[0]).min(square(point, &triangles[1]));
        let points = faces.into_iter().flat_map(|face| self.on(face));
        points.map(nearer).sum()
    }

    /// Divides the samples of two faces anew, which are now these triangles.
    pub fn divide(&mut self, [first, second]: [u32; 2], triangles: &[[Point; 3]; 2]) {
        let mut all = std::mem::take(&mut self.of_faces[first as usize]);
        all.append(&mut self.of_faces[second as usize]);
        for index in all {
            let point = &self.points[index as usize];
            let square =
                |triangle| (closest_point_on_triangle(point, triangle) - point).norm_squared();
            let face = if square(&triangles[1]) < square(&triangles[0]) {
                second
            } else {
                first
            };
            self.of_faces[face as usize].push(index);
        }
    }
}
