//! Collapses the cheapest edge until the mesh is small enough.

use crate::mesh::{Edge, face_normal};
use crate::spatial::TriangleTree;
use crate::{Face, Point, TriangleMesh};

use super::Quadric;
use super::anchors::{Anchors, Pulls};
use super::connectivity::Connectivity;
use super::normalization::Normalization;
use super::placement::place;
use super::queue::{Candidate, Queue};
use super::refinement::{Kept, refine};
use super::tracked::{Reference, vertex_quadrics};

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
    simplify_guided(mesh, reference, &Anchors::default(), options).0
}

/// Simplifies `mesh`, whose surface is `surface`, so that the vertices and edges that `anchors`
/// carry over from the previous result come back, and fits what is left to the mesh.
///
/// Collapses edges like [`simplify`] without a reference, but holds on to the anchors where that
/// costs little; then refines the result as the anchors' options say. Without anchors, as for a
/// first frame, the result is still fitted.
#[must_use]
pub fn simplify_anchored(
    mesh: &TriangleMesh,
    surface: &TriangleTree,
    anchors: &Anchors,
    options: &Options,
) -> Simplified {
    let (simplified, kept) = simplify_guided(mesh, None, anchors, options);
    if simplified.collapses == 0 {
        return simplified;
    }
    Simplified {
        mesh: refine(
            simplified.mesh,
            (mesh, surface),
            (&kept, &anchors.previous_faces),
            &anchors.refinement,
        ),
        ..simplified
    }
}

fn simplify_guided(
    mesh: &TriangleMesh,
    reference: Option<&TriangleMesh>,
    anchors: &Anchors,
    options: &Options,
) -> (Simplified, Vec<Option<Kept>>) {
    if mesh.face_count() <= options.target_faces {
        let unchanged = Simplified {
            mesh: mesh.clone(),
            target_reached: true,
            collapses: 0,
        };
        return (unchanged, Vec::new());
    }
    let normalization = Normalization::of(mesh);
    let positions = normalization.apply(mesh.positions());
    let reference = reference.and_then(|r| {
        let positions = normalization.apply(r.positions());
        Reference::new(r, &positions, mesh.vertex_count())
    });
    let reduction = mesh.face_count() as f64 / options.target_faces.max(1) as f64;
    let mut connectivity = Connectivity::new(mesh);
    let mut run = Run {
        quadrics: initial_quadrics(mesh, &positions, &mut connectivity, options),
        connectivity,
        versions: vec![0; mesh.vertex_count()],
        positions,
        reference,
        pulls: Pulls::new(anchors, &normalization, (mesh.vertex_count(), reduction)),
        queue: Queue::new(mesh.vertex_count()),
        collapses: 0,
        neighbors: Vec::new(),
        candidates: Vec::new(),
    };
    run.collapse_to(options.target_faces);
    run.finish(mesh, &normalization, options.target_faces)
}

/// The planes of the faces around each vertex, and at boundary edges a plane through the edge
/// at right angles to its face.
fn initial_quadrics(
    mesh: &TriangleMesh,
    positions: &[Point],
    connectivity: &mut Connectivity,
    options: &Options,
) -> Vec<Quadric> {
    let mut quadrics = vertex_quadrics(mesh, positions);
    for face in mesh.faces() {
        for edge in Edge::of_face(*face) {
            if connectivity.face_count_on(edge.0, edge.1) != 1 {
                continue;
            }
            let (a, b) = (positions[edge.0 as usize], positions[edge.1 as usize]);
            let Some(normal) = face_normal(face.map(|corner| positions[corner as usize])) else {
                continue;
            };
            let Some(outward) = (b - a).cross(&normal).try_normalize(0.0) else {
                continue;
            };
            let plane = Quadric::of_plane(&a, &outward, options.boundary_weight);
            quadrics[edge.0 as usize] += plane;
            quadrics[edge.1 as usize] += plane;
        }
    }
    quadrics
}

/// How often the queue is filled again for one pass, at the most; captures need one or two.
const MAX_ROUNDS: usize = 16;

/// Costs below this (a distance of 1e-9 of the diagonal, squared) are rounding, and all alike.
const NO_COST: f64 = 1e-18;

struct Run {
    positions: Vec<Point>,
    quadrics: Vec<Quadric>,
    connectivity: Connectivity,
    /// How often each vertex was merged.
    versions: Vec<u32>,
    reference: Option<Reference>,
    pulls: Option<Pulls>,
    queue: Queue,
    collapses: usize,
    /// Kept for their allocations.
    neighbors: Vec<u32>,
    candidates: Vec<Candidate>,
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
            for _ in 0..MAX_ROUNDS {
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

    /// Every edge is with the smaller of its vertices.
    fn fill_queue(&mut self) {
        self.queue.clear();
        for vertex in 0..self.connectivity.vertex_count() as u32 {
            if !self.connectivity.is_hub(vertex) {
                self.queue_edges(vertex, |vertex, neighbor| vertex < neighbor);
            }
        }
    }

    fn drain_queue(&mut self, target: usize, pass: Pass) {
        while target < self.connectivity.face_count() {
            let versions = &self.versions;
            let is_current =
                |candidate: &Candidate| candidate.stamp == stamp(versions, candidate.edge);
            let Some(Candidate { edge, .. }) = self.queue.pop(is_current) else {
                return;
            };
            let Edge(a, b) = edge;
            if !self.connectivity.may_collapse(a, b) {
                continue;
            }
            let vanishing = self.connectivity.face_count_on(a, b);
            if self.connectivity.face_count() < target + vanishing {
                continue;
            }
            // Nothing around the edge has changed since it was queued: the same as then.
            let (position, _) = self.evaluate(edge);
            if pass == Pass::TopologyOnly
                || self
                    .connectivity
                    .keeps_orientation(&self.positions, (a, b), &position)
            {
                self.collapse(a, b, position);
            }
        }
    }

    fn collapse(&mut self, a: u32, b: u32, position: Point) {
        self.connectivity.collapse(a, b);
        self.positions[a as usize] = position;
        // The frame's own quadrics add up; the reference's are gathered anew for every edge.
        let merged = self.quadrics[a as usize] + self.quadrics[b as usize];
        self.quadrics[a as usize] = merged;
        if let Some(pulls) = &mut self.pulls {
            pulls.merge((a, b), &position);
        }
        self.versions[a as usize] += 1;
        self.versions[b as usize] += 1;
        self.collapses += 1;
        self.queue.set(b, &[]);
        self.queue_edges(a, |_, _| true);
    }

    /// Puts the edges between `vertex` and those of its neighbors that `is_wanted` accepts into
    /// the queue, with `vertex` as their owner.
    fn queue_edges(&mut self, vertex: u32, is_wanted: impl Fn(u32, u32) -> bool) {
        let mut neighbors = std::mem::take(&mut self.neighbors);
        let mut candidates = std::mem::take(&mut self.candidates);
        candidates.clear();
        self.connectivity.neighbors(vertex, &mut neighbors);
        if let Some(reference) = &mut self.reference {
            let position = &self.positions[vertex as usize];
            let lengths = neighbors
                .iter()
                .map(|&n| (self.positions[n as usize] - position).norm_squared());
            reference.prepare(vertex, position, lengths.fold(0.0, f64::max));
        }
        for &neighbor in neighbors.iter().filter(|&&n| is_wanted(vertex, n)) {
            let edge = Edge::new(vertex, neighbor);
            let (_, cost) = self.evaluate(edge);
            let along = self.positions[edge.1 as usize] - self.positions[edge.0 as usize];
            candidates.push(Candidate::new(
                edge,
                if cost < NO_COST { 0.0 } else { cost },
                along.norm_squared(),
                stamp(&self.versions, edge),
            ));
        }
        self.queue.set(vertex, &candidates);
        (self.neighbors, self.candidates) = (neighbors, candidates);
    }

    /// Where the edge's vertices would be merged, and what that costs (Eq. 10, 12 and 15).
    fn evaluate(&mut self, edge: Edge) -> (Point, f64) {
        let (a, b) = (edge.0 as usize, edge.1 as usize);
        let (v1, v2) = (&self.positions[a], &self.positions[b]);
        let mut quadric = self.quadrics[a] + self.quadrics[b];
        let mut barycenter = None;
        if let Some(reference) = &mut self.reference {
            let around = reference.around_edge(edge, v1, v2);
            quadric += around.quadric;
            barycenter = around.barycenter;
        }
        if let Some(pulls) = &self.pulls {
            return pulls.place(&quadric, edge, (v1, v2));
        }
        let position = place(&quadric, v1, v2, barycenter.as_ref());
        (position, quadric.cost(&position))
    }

    fn finish(
        &self,
        mesh: &TriangleMesh,
        normalization: &Normalization,
        target: usize,
    ) -> (Simplified, Vec<Option<Kept>>) {
        let faces: Vec<Face> = self.connectivity.faces().collect();
        let mut used = vec![false; self.positions.len()];
        faces
            .iter()
            .flatten()
            .for_each(|&corner| used[corner as usize] = true);
        let mut numbers = vec![0u32; used.len()];
        let mut positions = Vec::new();
        let mut kept = Vec::new();
        for vertex in (0..used.len()).filter(|&vertex| used[vertex]) {
            numbers[vertex] = positions.len() as u32;
            let anchor = self
                .pulls
                .as_ref()
                .and_then(|pulls| pulls.kept(vertex as u32));
            kept.push(anchor.map(|kept| Kept {
                position: normalization.undo(&kept.position),
                ..kept
            }));
            positions.push(if 0 < self.versions[vertex] {
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
        let simplified = Simplified {
            mesh: TriangleMesh::from_valid(positions, faces),
            target_reached,
            collapses: self.collapses,
        };
        (simplified, kept)
    }
}

/// Grows whenever one of the edge's vertices changes.
fn stamp(versions: &[u32], edge: Edge) -> u32 {
    versions[edge.0 as usize] + versions[edge.1 as usize]
}
