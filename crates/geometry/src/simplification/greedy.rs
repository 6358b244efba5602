//! The cheapest edge first, whatever it takes: the order of the paper's reference.

use crate::mesh::Edge;

use super::edge_collapse::{Collapses, Order, Rules};
use super::queue::{Candidate, Queue};

/// All edges in a queue; a collapse puts those around the merged vertex back with their new cost.
pub(super) struct Greedy {
    queue: Queue,
    /// Kept for their allocations.
    neighbors: Vec<u32>,
    candidates: Vec<Candidate>,
}

impl Greedy {
    pub fn new(vertex_count: usize) -> Self {
        Self {
            queue: Queue::new(vertex_count),
            neighbors: Vec::new(),
            candidates: Vec::new(),
        }
    }

    /// Puts the edges between `vertex` and those of its neighbors that `is_wanted` accepts into
    /// the queue, with `vertex` as their owner.
    fn queue_edges(
        &mut self,
        mesh: &mut Collapses<'_>,
        vertex: u32,
        is_wanted: impl Fn(u32, u32) -> bool,
    ) {
        self.candidates.clear();
        mesh.connectivity.neighbors(vertex, &mut self.neighbors);
        let positions = &mesh.positions;
        let square =
            |a: u32, b: u32| (positions[b as usize] - positions[a as usize]).norm_squared();
        if let Some(reference) = &mut mesh.reference {
            let squares = self.neighbors.iter().map(|&n| square(vertex, n));
            let farthest = squares.fold(0.0, f64::max);
            reference.prepare(vertex, &positions[vertex as usize], farthest);
        }
        for &neighbor in self.neighbors.iter().filter(|&&n| is_wanted(vertex, n)) {
            let edge = Edge::new(vertex, neighbor);
            let cost = mesh.cost(edge);
            let along = mesh.positions[edge.1 as usize] - mesh.positions[edge.0 as usize];
            self.candidates.push(Candidate::new(
                edge,
                cost,
                along.norm_squared(),
                stamp(&mesh.versions, edge),
            ));
        }
        self.queue.set(vertex, &self.candidates);
    }
}

impl Order for Greedy {
    /// Every edge is with the smaller of its vertices.
    fn fill(&mut self, mesh: &mut Collapses<'_>) {
        self.queue.clear();
        for vertex in 0..mesh.connectivity.vertex_count() as u32 {
            if !mesh.connectivity.is_hub(vertex) {
                self.queue_edges(mesh, vertex, |vertex, neighbor| vertex < neighbor);
            }
        }
    }

    fn drain(&mut self, mesh: &mut Collapses<'_>, target: usize, rules: Rules) {
        while target < mesh.connectivity.face_count() {
            let versions = &mesh.versions;
            let is_current =
                |candidate: &Candidate| candidate.stamp == stamp(versions, candidate.edge);
            let Some(Candidate { edge, .. }) = self.queue.pop(is_current) else {
                return;
            };
            // Nothing around the edge has changed since it was queued: it costs the same as then.
            if let Some((left, gone)) = mesh.try_collapse(edge, target, rules) {
                self.queue.set(gone, &[]);
                self.queue_edges(mesh, left, |_, _| true);
            }
        }
    }
}

/// Grows whenever one of the edge's vertices changes.
fn stamp(versions: &[u32], edge: Edge) -> u32 {
    versions[edge.0 as usize] + versions[edge.1 as usize]
}
