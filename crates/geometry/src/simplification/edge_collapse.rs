//! Collapses the cheapest edge until the mesh is small enough.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::mesh::{Edge, EdgeTable, face_normal};
use crate::{Face, Point, TriangleMesh};

use super::connectivity::Connectivity;
use super::normalization::Normalization;
use super::placement::place;
use super::tracked::{Reference, vertex_quadrics};
use super::{Quadric, tracked};

/// How far to simplify.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How many faces are wanted.
    pub target_faces: usize,
    /// Weight of the plane that holds a boundary edge in place, relative to a face's plane.
    ///
    /// Garland and Heckbert, section 6, ask for "a large penalty"; 10 keeps cuffs and fingers
    /// without spending the budget of faces on the outline.
    pub boundary_weight: f64,
}

impl Options {
    /// The usual options for a target.
    #[must_use]
    pub fn to_faces(target_faces: usize) -> Self {
        Self {
            target_faces,
            boundary_weight: 10.0,
        }
    }
}

/// A simplified mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// The mesh; its vertices are in the order of the input's.
    pub mesh: TriangleMesh,
    /// Whether it has the asked number of faces, or one more where every collapse that is left
    /// takes two away, or was that small to begin with.
    pub target_reached: bool,
    /// Collapses made.
    pub collapses: usize,
}

/// Simplifies `mesh` to the asked number of faces.
///
/// With a `reference` (the previous frame, registered onto this one) it is Tracked QEM to the
/// letter of the paper; without, the original QEM. Deterministic, and independent of the unit
/// of length. A mesh that has no more faces than asked for comes back as it is.
#[must_use]
pub fn simplify(
    mesh: &TriangleMesh,
    reference: Option<&TriangleMesh>,
    options: &Options,
) -> Simplified {
    if mesh.face_count() <= options.target_faces {
        return Simplified {
            mesh: mesh.clone(),
            target_reached: true,
            collapses: 0,
        };
    }
    let normalization = Normalization::of(mesh);
    let positions = normalization.apply(mesh.positions());
    let reference = reference.and_then(|r| Reference::new(r, normalization.apply(r.positions())));
    let mut run = Run {
        quadrics: initial_quadrics(mesh, &positions, options.boundary_weight),
        connectivity: Connectivity::new(mesh.vertex_count(), mesh.faces()),
        versions: vec![0; mesh.vertex_count()],
        moved: vec![false; mesh.vertex_count()],
        positions,
        reference,
        queue: BinaryHeap::new(),
        collapses: 0,
    };
    run.collapse_to(options.target_faces);
    run.finish(mesh, &normalization, options.target_faces)
}

/// The planes of the faces around each vertex, and at boundary edges a plane through the edge
/// at right angles to its face.
fn initial_quadrics(
    mesh: &TriangleMesh,
    positions: &[Point],
    boundary_weight: f64,
) -> Vec<Quadric> {
    let mut quadrics = vertex_quadrics(mesh, positions);
    for (edge, on_edge) in EdgeTable::of(mesh.faces()).iter() {
        let [(_, face)] = on_edge else { continue };
        let corners = mesh.faces()[*face as usize].map(|corner| positions[corner as usize]);
        let (a, b) = (positions[edge.0 as usize], positions[edge.1 as usize]);
        let Some(normal) = face_normal(corners) else {
            continue;
        };
        let Some(outward) = (b - a).cross(&normal).try_normalize(0.0) else {
            continue;
        };
        let plane = Quadric::of_plane(&a, &outward, boundary_weight);
        quadrics[edge.0 as usize] += plane;
        quadrics[edge.1 as usize] += plane;
    }
    quadrics
}

/// An edge that may be collapsed, ordered by cost, then length, then vertices.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    key: (u64, u64, Edge),
    versions: (u32, u32),
    position: Point,
}

impl Candidate {
    fn order(&self) -> (u64, u64, Edge) {
        self.key
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.order() == other.order()
    }
}
impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.order().cmp(&other.order())
    }
}

/// Costs below this (a distance of 1e-9 of the diagonal, squared) are rounding, and all alike.
const NO_COST: f64 = 1e-18;

struct Run {
    positions: Vec<Point>,
    quadrics: Vec<Quadric>,
    connectivity: Connectivity,
    versions: Vec<u32>,
    moved: Vec<bool>,
    reference: Option<Reference>,
    queue: BinaryHeap<Reverse<Candidate>>,
    collapses: usize,
}

/// What a collapse must respect.
#[derive(Clone, Copy, PartialEq)]
enum Pass {
    /// Topology, and no face may flip.
    Strict,
    /// Topology only: the last resort before giving up on the target.
    TopologyOnly,
}

impl Run {
    /// Collapses edges until `target` is reached or no collapse is left.
    ///
    /// An edge that was refused may become possible when its surroundings change, so the queue
    /// is filled again as long as that helps.
    fn collapse_to(&mut self, target: usize) {
        for pass in [Pass::Strict, Pass::TopologyOnly] {
            loop {
                self.fill_queue();
                let before = self.collapses;
                self.drain_queue(target, pass);
                // One face too many may be all that the topology allows; flipping faces to get
                // rid of it is not worth it.
                let close = self.connectivity.face_count() <= target + 1;
                if self.connectivity.face_count() <= target || (close && before == self.collapses) {
                    return;
                }
                if before == self.collapses {
                    break;
                }
            }
        }
    }

    fn fill_queue(&mut self) {
        self.queue.clear();
        let faces: Vec<Face> = self.connectivity.faces().collect();
        let edges: Vec<Edge> = EdgeTable::of(&faces).iter().map(|(edge, _)| edge).collect();
        for edge in edges {
            self.push(edge);
        }
    }

    fn drain_queue(&mut self, target: usize, pass: Pass) {
        while target < self.connectivity.face_count() {
            let Some(Reverse(candidate)) = self.queue.pop() else {
                return;
            };
            let (_, _, Edge(a, b)) = candidate.key;
            if candidate.versions != (self.versions[a as usize], self.versions[b as usize])
                || !self.is_possible(&candidate, target, pass)
            {
                continue;
            }
            self.collapse(a, b, candidate.position);
        }
    }

    fn is_possible(&self, candidate: &Candidate, target: usize, pass: Pass) -> bool {
        let (_, _, Edge(a, b)) = candidate.key;
        let vanishing = self.connectivity.faces_on(a, b).len();
        target + vanishing <= self.connectivity.face_count()
            && self.connectivity.may_collapse(a, b)
            && (pass == Pass::TopologyOnly
                || self.connectivity.keeps_orientation(
                    &self.positions,
                    (a, b),
                    &candidate.position,
                ))
    }

    fn collapse(&mut self, a: u32, b: u32, position: Point) {
        self.connectivity.collapse(a, b);
        self.positions[a as usize] = position;
        // The frame's own quadrics add up; the reference's are gathered anew for every edge.
        let merged = self.quadrics[a as usize] + self.quadrics[b as usize];
        self.quadrics[a as usize] = merged;
        self.moved[a as usize] = true;
        self.versions[a as usize] += 1;
        self.versions[b as usize] += 1;
        self.collapses += 1;
        for neighbor in self.connectivity.neighbors(a) {
            self.push(Edge::new(a, neighbor));
        }
    }

    /// Evaluates an edge (Eq. 10, 12 and 15) and queues it.
    fn push(&mut self, edge: Edge) {
        let (a, b) = (edge.0 as usize, edge.1 as usize);
        let (v1, v2) = (&self.positions[a], &self.positions[b]);
        let mut quadric = self.quadrics[a] + self.quadrics[b];
        let mut barycenter = None;
        if let Some(reference) = &self.reference {
            let tracked::Tracked {
                quadric: added,
                barycenter: center,
            } = reference.around_edge(v1, v2);
            quadric += added;
            barycenter = center;
        }
        let position = place(&quadric, v1, v2, barycenter.as_ref());
        let cost = quadric.cost(&position);
        let cost = if cost < NO_COST { 0.0 } else { cost };
        // Neither is negative, so that their bits are in their order.
        let key = (cost.to_bits(), (v2 - v1).norm_squared().to_bits(), edge);
        let versions = (self.versions[a], self.versions[b]);
        self.queue.push(Reverse(Candidate {
            key,
            versions,
            position,
        }));
    }

    fn finish(
        &self,
        mesh: &TriangleMesh,
        normalization: &Normalization,
        target: usize,
    ) -> Simplified {
        let faces: Vec<Face> = self.connectivity.faces().collect();
        let mut used = vec![false; self.positions.len()];
        faces
            .iter()
            .flatten()
            .for_each(|&corner| used[corner as usize] = true);
        let mut numbers = vec![0u32; used.len()];
        let mut positions = Vec::new();
        for vertex in (0..used.len()).filter(|&vertex| used[vertex]) {
            numbers[vertex] = positions.len() as u32;
            positions.push(if self.moved[vertex] {
                normalization.undo(&self.positions[vertex])
            } else {
                mesh.positions()[vertex]
            });
        }
        let faces: Vec<Face> = faces
            .iter()
            .map(|f| f.map(|c| numbers[c as usize]))
            .collect();
        let target_reached = faces.len() <= target + 1;
        Simplified {
            mesh: TriangleMesh::from_valid(positions, faces),
            target_reached,
            collapses: self.collapses,
        }
    }
}
