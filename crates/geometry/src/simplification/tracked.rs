//! The reference of Tracked QEM: the registered previous frame, and what it adds to an edge.

use crate::mesh::{Edge, face_normal};
use crate::spatial::PointTree;
use crate::{Point, TriangleMesh, Vector};

use super::Quadric;

/// mesh^γ(k-1), prepared: its vertices' quadrics and a tree to find them.
pub(super) struct Reference {
    tree: PointTree,
    /// In the tree's order.
    terms: Vec<Terms>,
    /// For every vertex of the current mesh, the last search around it.
    neighborhoods: Vec<Neighborhood>,
    /// Kept for its allocation.
    slots: Vec<u32>,
    /// Quads that may still be looked at.
    budget: usize,
}

/// Quads looked at per vertex of the reference, at the most: ten times what captures need. Frames
/// whose edges are as long as the mesh would otherwise gather all of it for every edge; once the
/// budget is spent the reference takes no further part.
const BUDGET_PER_VERTEX: usize = 2000;

/// Where a search went, and the quads of the tree that it found. As long as all that is asked
/// for lies within, there is no need for another.
#[derive(Clone)]
struct Neighborhood {
    center: Point,
    /// Below 0 if there was no search.
    radius: f64,
    quads: Vec<u32>,
}

/// What a vertex adds, to be added up in one go: the coefficients of its quadric, its position
/// and 1.
type Terms = [f64; 14];

/// What the reference adds to one edge: Q_δ(1) + Q_δ(2), and the barycenter m_δ if there is one.
pub(super) struct Tracked {
    pub quadric: Quadric,
    pub barycenter: Option<Point>,
}

/// How much further than asked a search goes: vertices move, edges get longer, and the next one
/// asks for more. Tuned on captures.
const SEARCH_MARGIN: f64 = 1.3;

impl Reference {
    /// The quadrics of `mesh`, over `positions` in the units of the simplification, for a current
    /// mesh of `vertex_count`; `None` for a mesh without vertices.
    pub fn new(mesh: &TriangleMesh, positions: &[Point], vertex_count: usize) -> Option<Self> {
        let tree = PointTree::new(positions)?;
        let quadrics = vertex_quadrics(mesh, positions);
        let terms_of = |&vertex: &u32| {
            let mut terms = [1.0; 14];
            terms[..10].copy_from_slice(&quadrics[vertex as usize].coefficients());
            terms[10..13].copy_from_slice(positions[vertex as usize].coords.as_slice());
            terms
        };
        let nowhere = Neighborhood {
            center: Point::origin(),
            radius: -1.0,
            quads: Vec::new(),
        };
        Some(Self {
            terms: tree.items().iter().map(terms_of).collect(),
            tree,
            neighborhoods: vec![nowhere; vertex_count],
            slots: Vec::new(),
            budget: BUDGET_PER_VERTEX * positions.len(),
        })
    }

    /// Gathers the reference around the edge between `v1` and `v2`.
    ///
    /// Every vertex closer to an endpoint than the edge is long, strictly, adds its quadric; one
    /// that is near both counts twice (Eq. 11 to 13). The barycenter is the mean of both
    /// neighborhoods' means (Eq. 16), or that of the only one that is not empty.
    pub fn around_edge(&mut self, edge: Edge, v1: &Point, v2: &Point) -> Tracked {
        if self.budget == 0 {
            return Tracked {
                quadric: Quadric::default(),
                barycenter: None,
            };
        }
        let square = (v2 - v1).norm_squared();
        let [first, second] = [(edge.0, v1), (edge.1, v2)].map(|(vertex, endpoint)| {
            self.prepare(vertex, endpoint, square);
            self.sum_within(vertex, endpoint, square)
        });
        let barycenter = match (mean_position(&first), mean_position(&second)) {
            (Some(first), Some(second)) => Some(nalgebra::center(&first, &second)),
            (one, other) => one.or(other),
        };
        let coefficients = std::array::from_fn(|term| first[term] + second[term]);
        Tracked {
            quadric: Quadric::from_coefficients(coefficients),
            barycenter,
        }
    }

    /// Searches around a vertex, at least as far as asked by the square of the radius, unless
    /// the last search covers that.
    pub fn prepare(&mut self, vertex: u32, position: &Point, square: f64) {
        if self.budget == 0 {
            return;
        }
        let neighborhood = &mut self.neighborhoods[vertex as usize];
        let margin = neighborhood.radius - (position - neighborhood.center).norm();
        // Rounding is far below what the tree's search is generous by.
        if 0.0 <= margin && square <= margin * margin {
            return;
        }
        neighborhood.center = *position;
        neighborhood.radius = SEARCH_MARGIN * square.sqrt();
        self.tree
            .quads_around(position, neighborhood.radius, &mut neighborhood.quads);
        self.budget = self.budget.saturating_sub(neighborhood.quads.len());
    }

    /// What the vertices closer to `vertex` than asked, by the square of the distance, add.
    fn sum_within(&mut self, vertex: u32, position: &Point, square: f64) -> Terms {
        let quads = &self.neighborhoods[vertex as usize].quads;
        self.budget = self.budget.saturating_sub(quads.len());
        let count = self
            .tree
            .slots_within(position, square, quads, &mut self.slots);
        let mut sum = [0.0; 14];
        for &slot in &self.slots[..count] {
            let terms = &self.terms[slot as usize];
            sum.iter_mut()
                .zip(terms)
                .for_each(|(sum, term)| *sum += term);
        }
        sum
    }
}

/// The mean of the places that were added up, if there are any.
fn mean_position(sum: &Terms) -> Option<Point> {
    let [.., x, y, z, count] = *sum;
    (0.0 < count).then(|| Point::from(Vector::new(x, y, z) / count))
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
