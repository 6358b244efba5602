//! Fits the vertices of a simplified mesh to what it was simplified from.

use nalgebra::Matrix3;

use crate::mesh::{Rows, face_normal};
use crate::spatial::{TriangleTree, barycentric, closest_point_on_triangle};
use crate::{Point, TriangleMesh, Vector};

use super::samples::Samples;
use super::{Kept, Options};

/// Moves the vertices of `simplified` to where its faces fit the samples best.
///
/// Minimizes, with the samples at fixed barycentric coordinates of their faces,
///
/// Σᵢ (nᵢ·(pᵢ − Σⱼ bᵢⱼ vⱼ))² + w Σⱼ (holds of vⱼ)²,
///
/// where nᵢ is the normal of the face that the sample pᵢ belongs to: the distance to the face's
/// plane, so that a vertex is free to slide along the surface but for what holds it there. A few
/// sweeps of Gauss-Seidel, 3 x 3 each. Vertices on a boundary stay.
///
/// # Source
///
/// The energy is that of Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Mesh Optimization",
/// SIGGRAPH 1993, <https://doi.org/10.1145/166117.166119>, with planes for points and holds for
/// springs.
pub(super) fn fit(
    simplified: &TriangleMesh,
    surface: &TriangleTree,
    (samples, kept): (&Samples<'_>, &[Option<Kept>]),
    options: &Options,
) -> TriangleMesh {
    let mut system = System::new(simplified, samples);
    let share = samples.count() as f64 / (3 * simplified.vertex_count()) as f64;
    system.hold(surface, (kept, share), options);
    for _ in 0..options.sweeps {
        system.sweep(options.smoothing * share);
    }
    let mut positions = system.positions;
    for (position, start) in positions.iter_mut().zip(simplified.positions()) {
        *position = start + (*position - start) * options.step;
    }
    let positions = unfolded(simplified, positions);
    TriangleMesh::from_valid(positions, simplified.faces().to_vec())
}

/// What the samples of a face say: the sums of bₐ·bᵦ and of bₐ times the distance to its plane.
#[derive(Clone, Copy, Default)]
struct Moments {
    products: [[f64; 3]; 3],
    distances: [f64; 3],
}

/// The least-squares problem. Everything the samples say is in their faces' moments.
struct System<'a> {
    mesh: &'a TriangleMesh,
    face_normals: &'a [Vector],
    moments: Vec<Moments>,
    faces: &'a Rows,
    neighbors: &'a Rows,
    normals: &'a [Vector],
    /// The normal equations of all that holds one vertex alone: a matrix, and what it pulls to.
    holds: Vec<(Matrix3<f64>, Vector)>,
    positions: Vec<Point>,
}

/// How close, in mean edges of the original, a vertex is to the face that it is straight above for
/// that to count without a look at the rest.
const NEAR: f64 = 0.3;

/// Vertices move by at most this share of the mean edge.
const MAX_MOVE: f64 = 0.5;

impl<'a> System<'a> {
    fn new(mesh: &'a TriangleMesh, samples: &Samples<'_>) -> Self {
        let face_normals = mesh.face_normals();
        let of_face = |face| {
            moments(
                &mesh.triangle(face),
                &face_normals[face],
                samples.on(face as u32),
            )
        };
        Self {
            moments: (0..mesh.face_count()).map(of_face).collect(),
            face_normals,
            faces: mesh.vertex_faces(),
            neighbors: mesh.vertex_neighbors(),
            normals: mesh.vertex_normals(),
            holds: Vec::new(),
            positions: mesh.positions().to_vec(),
            mesh,
        }
    }

    /// Sets up what holds each vertex, its own distance to the surface included.
    fn hold(
        &mut self,
        surface: &TriangleTree,
        (kept, share): (&[Option<Kept>], f64),
        options: &Options,
    ) {
        let surface_weight = options.surface_weight * share + options.surface_samples;
        let near = NEAR * surface.mesh().mean_edge();
        let hold_of = |(vertex, start): (usize, &Point)| {
            let normal = self.normals[vertex];
            let along = Matrix3::identity() - normal * normal.transpose();
            let kept = kept.get(vertex).copied().flatten();
            let foot = match kept {
                Some(kept) => surface.below_or_closest(start, kept.face, near),
                None => surface.closest(start),
            };
            let corners = surface.mesh().triangle(foot.face as usize);
            let square = |corner: &Point| (corner - start).norm_squared();
            let nearest = corners
                .into_iter()
                .min_by(|a, b| square(a).total_cmp(&square(b)))
                .unwrap_or(*start);
            let mut weight = options.hold + options.vertex_pull;
            let mut pull = (nearest - start) * options.vertex_pull;
            if let Some(kept) = kept {
                weight += options.anchor_hold * kept.fit;
                pull += (kept.position - start) * (options.anchor_hold * kept.fit);
            }
            let towards = normal * normal.transpose() * surface_weight;
            let along = along * share;
            (
                along * weight + towards,
                along * pull + towards * (foot.position - start),
            )
        };
        self.holds = self.positions.iter().enumerate().map(hold_of).collect();
    }

    /// Moves every vertex to its optimum with the others at rest, in their order.
    fn sweep(&mut self, smoothing: f64) {
        for vertex in 0..self.positions.len() {
            let neighbors = self.neighbors.row(vertex);
            // A closed fan has as many neighbors as faces.
            if neighbors.len() != self.faces.row(vertex).len() || neighbors.is_empty() {
                continue;
            }
            let here = self.positions[vertex];
            let start = self.mesh.positions()[vertex];
            let (mut matrix, pull) = self.holds[vertex];
            let mut gradient = pull - matrix * (here - start);
            let normal = self.normals[vertex];
            let along = Matrix3::identity() - normal * normal.transpose();
            let sum: Vector = neighbors
                .iter()
                .map(|&n| self.positions[n as usize] - here)
                .sum();
            matrix += along * smoothing;
            gradient += along * sum * (smoothing / neighbors.len() as f64);
            for &face in self.faces.row(vertex) {
                let (weight, distance) = self.plane(face, vertex as u32);
                let normal = self.face_normals[face as usize];
                matrix += normal * normal.transpose() * weight;
                gradient += normal * distance;
            }
            if let Some(inverse) = matrix.try_inverse() {
                self.positions[vertex] += inverse * gradient;
            }
        }
    }

    /// The weight with which a face's samples hold one of its corners, and the sum of their
    /// distances to the face as it is now, each times its share of the corner.
    fn plane(&self, face: u32, vertex: u32) -> (f64, f64) {
        let corners = self.mesh.faces()[face as usize];
        let Moments {
            products,
            distances,
        } = &self.moments[face as usize];
        let normal = &self.face_normals[face as usize];
        let Some(own) = corners.iter().position(|&corner| corner == vertex) else {
            return (0.0, 0.0);
        };
        let moved = |corner: usize| {
            let corner = corners[corner] as usize;
            normal.dot(&(self.positions[corner] - self.mesh.positions()[corner]))
        };
        let taken: f64 = (0..3)
            .map(|other| products[own][other] * moved(other))
            .sum();
        (products[own][own], distances[own] - taken)
    }
}

fn moments<'p>(
    triangle: &[Point; 3],
    normal: &Vector,
    samples: impl Iterator<Item = &'p Point>,
) -> Moments {
    let mut sums = Moments::default();
    for sample in samples {
        let closest = closest_point_on_triangle(sample, triangle);
        let shares = barycentric(&closest, triangle);
        let distance = normal.dot(&(sample - closest));
        for a in 0..3 {
            sums.distances[a] += shares[a] * distance;
            for b in 0..3 {
                sums.products[a][b] += shares[a] * shares[b];
            }
        }
    }
    sums
}

/// A face may turn this far: the cosine of 72 degrees.
const MIN_COSINE: f64 = 0.3;

/// The new positions, but the old ones for the corners of faces that would flip, of all faces
/// that flip through that, and for vertices that went too far.
fn unfolded(before: &TriangleMesh, mut positions: Vec<Point>) -> Vec<Point> {
    let start = before.positions();
    let limit = MAX_MOVE * before.mean_edge();
    for (position, start) in positions.iter_mut().zip(start) {
        let moved = (*position - start).norm();
        if moved.is_nan() || limit < moved {
            *position = *start;
        }
    }
    let turned = |positions: &[Point], face: usize| {
        let now = before.faces()[face].map(|corner| positions[corner as usize]);
        match (face_normal(before.triangle(face)), face_normal(now)) {
            (Some(old), Some(new)) => old.dot(&new) < MIN_COSINE,
            (Some(_), None) => true,
            (None, _) => false,
        }
    };
    loop {
        let mut changed = false;
        for face in 0..before.face_count() {
            if turned(&positions, face) {
                for corner in before.faces()[face].map(|corner| corner as usize) {
                    changed |= positions[corner] != start[corner];
                    positions[corner] = start[corner];
                }
            }
        }
        if !changed {
            return positions;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::surface_distances;
    use crate::simplification::{Options as Target, simplify};

    /// A bowl over a square, with a boundary.
    fn bowl(side: u32) -> TriangleMesh {
        let at = |i: u32, j: u32| i * side + j;
        let coordinate = |i: u32| 2.0 * f64::from(i) / f64::from(side - 1) - 1.0;
        let positions = (0..side * side)
            .map(|k| (coordinate(k / side), coordinate(k % side)))
            .map(|(x, y)| Point::new(x, y, 0.5 * (x * x + y * y) + 0.05 * (9.0 * x).sin()))
            .collect();
        let faces = (0..side - 1)
            .flat_map(|i| (0..side - 1).map(move |j| (i, j)))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                [[a, b, c], [a, c, d]]
            });
        TriangleMesh::new(positions, faces.collect()).unwrap()
    }

    fn fitted(original: &TriangleMesh, simplified: &TriangleMesh) -> TriangleMesh {
        let surface = TriangleTree::new(original).unwrap();
        let samples = Samples::new(original, simplified).unwrap();
        let options = Options::default();
        fit(simplified, &surface, (&samples, &[]), &options)
    }

    fn mean_distance(from: &TriangleMesh, to: &TriangleMesh) -> f64 {
        let distances = surface_distances(from.positions(), &TriangleTree::new(to).unwrap());
        distances.iter().sum::<f64>() / distances.len() as f64
    }

    #[test]
    fn the_original_is_closer_to_the_fitted_mesh() {
        let original = bowl(60);
        let simplified = simplify(&original, None, &Target::to_faces(400)).mesh;
        let fitted = fitted(&original, &simplified);
        let (before, after) = (
            mean_distance(&original, &simplified),
            mean_distance(&original, &fitted),
        );
        assert!(after < 0.9 * before, "{before} {after}");
    }

    #[test]
    fn vertices_of_the_boundary_stay_and_no_face_turns_over() {
        let original = bowl(60);
        let simplified = simplify(&original, None, &Target::to_faces(300)).mesh;
        let fitted = fitted(&original, &simplified);
        let (neighbors, faces) = (simplified.vertex_neighbors(), simplified.vertex_faces());
        let mut moved = 0;
        for (vertex, (before, after)) in simplified
            .positions()
            .iter()
            .zip(fitted.positions())
            .enumerate()
        {
            let is_closed = neighbors.row(vertex).len() == faces.row(vertex).len();
            assert!(is_closed || before == after);
            moved += usize::from(before != after);
        }
        assert!(100 < moved);
        let turned = simplified
            .face_normals()
            .iter()
            .zip(fitted.face_normals())
            .any(|(before, after)| before.dot(after) < MIN_COSINE);
        assert!(!turned);
    }

    #[test]
    fn the_corners_of_a_face_that_turned_over_go_back_and_the_others_do_not() {
        let [center, east, north, west] = [0, 1, 2, 3];
        let corners = [[0.45, 0.45], [1., 0.], [0., 1.], [-1., 0.], [0., -1.]];
        let positions = corners.map(|[x, y]| Point::new(x, y, 0.0)).to_vec();
        let faces = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];
        let before = TriangleMesh::new(positions.clone(), faces).unwrap();
        let mut after = positions.clone();
        // Across the line from east to north.
        after[center] = Point::new(0.55, 0.55, 0.0);
        after[north].y += 0.01;
        after[west].x -= 0.01;
        let back = unfolded(&before, after.clone());
        for vertex in [center, east, north] {
            assert_eq!(back[vertex], positions[vertex]);
        }
        assert_eq!(back[west], after[west]);
    }
}
