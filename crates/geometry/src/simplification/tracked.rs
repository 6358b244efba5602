//! The reference of Tracked QEM: the registered previous frame, and what it adds to an edge.

use crate::mesh::{Edge, face_normal};
use crate::spatial::PointTree;
use crate::{Point, TriangleMesh, Vector};

use super::Quadric;

/// mesh^γ(k-1), prepared: its vertices' quadrics and a tree to find them.
pub(super) struct Reference {
    tree: PointTree,
    /// In the tree's order.
    quadrics: Vec<Quadric>,
    /// For every vertex of the current mesh, what the last search around it found.
    neighborhoods: Vec<Neighborhood>,
}

/// The reference's vertices around a place, nearest first.
#[derive(Clone, Default)]
struct Neighborhood {
    /// How far the search went; 0 if there was none.
    radius: f64,
    /// Squared distance and slot in the tree.
    found: Vec<(f64, u32)>,
}

/// What the reference adds to one edge: Q_δ(1) + Q_δ(2), and the barycenter m_δ if there is one.
pub(super) struct Tracked {
    pub quadric: Quadric,
    pub barycenter: Option<Point>,
}

/// How much further than asked a search goes: edges get longer, and the next one asks for more.
const SEARCH_MARGIN: f64 = 1.1;

impl Reference {
    /// The quadrics of `mesh`, over `positions` in the units of the simplification, for a current
    /// mesh of `vertex_count`; `None` for a mesh without vertices.
    pub fn new(mesh: &TriangleMesh, positions: &[Point], vertex_count: usize) -> Option<Self> {
        let tree = PointTree::new(positions)?;
        let quadrics = vertex_quadrics(mesh, positions);
        Some(Self {
            quadrics: tree.items().iter().map(|&v| quadrics[v as usize]).collect(),
            tree,
            neighborhoods: vec![Neighborhood::default(); vertex_count],
        })
    }

    /// A vertex of the current mesh has moved.
    pub fn forget(&mut self, vertex: u32) {
        self.neighborhoods[vertex as usize].radius = 0.0;
    }

    /// Gathers the reference around the edge between `v1` and `v2`.
    ///
    /// Every vertex closer to an endpoint than the edge is long, strictly, adds its quadric; one
    /// that is near both counts twice (Eq. 11 to 13). The barycenter is the mean of both
    /// neighborhoods' means (Eq. 16), or that of the only one that is not empty.
    pub fn around_edge(&mut self, edge: Edge, v1: &Point, v2: &Point) -> Tracked {
        let square = (v2 - v1).norm_squared();
        let mut quadric = Quadric::default();
        let [first, second] = [(edge.0, v1), (edge.1, v2)].map(|(vertex, endpoint)| {
            self.search(vertex, endpoint, (square, SEARCH_MARGIN));
            self.add_within(vertex, square, &mut quadric)
        });
        let barycenter = match (first, second) {
            (Some(first), Some(second)) => Some(nalgebra::center(&first, &second)),
            (one, other) => one.or(other),
        };
        Tracked {
            quadric,
            barycenter,
        }
    }

    /// Searches around a vertex all of whose edges are known, the longest of them by its square.
    pub fn prepare(&mut self, vertex: u32, position: &Point, longest_square: f64) {
        self.search(vertex, position, (longest_square, 1.0 + 1e-9));
    }

    /// Searches around a vertex and a little further than asked, unless the last search went far
    /// enough.
    fn search(&mut self, vertex: u32, position: &Point, (square, margin): (f64, f64)) {
        let neighborhood = &mut self.neighborhoods[vertex as usize];
        if square <= neighborhood.radius * neighborhood.radius {
            return;
        }
        neighborhood.radius = margin * square.sqrt();
        let found = &mut neighborhood.found;
        found.clear();
        self.tree
            .visit_within(position, neighborhood.radius, |slot, square| {
                found.push((square, slot));
            });
        // Squares are not negative, so that their bits are in their order.
        found.sort_unstable_by_key(|(square, _)| square.to_bits());
    }

    /// Adds the quadrics around a vertex, and returns the mean of the places they belong to.
    fn add_within(&self, vertex: u32, square: f64, quadric: &mut Quadric) -> Option<Point> {
        let mut sum = Vector::zeros();
        let mut count = 0;
        for (distance, slot) in &self.neighborhoods[vertex as usize].found {
            if square <= *distance {
                break;
            }
            *quadric += self.quadrics[*slot as usize];
            sum += self.tree.point(*slot).coords;
            count += 1;
        }
        (0 < count).then(|| Point::from(sum / f64::from(count)))
    }
}

/// Q_v of every vertex: the planes of the faces around it, each with weight 1 (Eq. 5). Faces
/// without a normal add nothing.
pub(super) fn vertex_quadrics(mesh: &TriangleMesh, positions: &[Point]) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::default(); positions.len()];
    for face in mesh.faces() {
        let corners = face.map(|corner| positions[corner as usize]);
        if let Some(normal) = face_normal(corners) {
            let plane = Quadric::of_plane(&corners[0], &normal, 1.0);
            face.iter()
                .for_each(|&corner| quadrics[corner as usize] += plane);
        }
    }
    quadrics
}
