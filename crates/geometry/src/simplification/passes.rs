//! Cheap edges first, in passes: nearly the greedy order at half the time.

use crate::mesh::Edge;

use super::edge_collapse::{Collapses, Order, Rules};
use super::ranking::{Ranking, Rated};

/// Every pass ranks all edges by cost and collapses the cheapest of those whose vertices it has
/// not touched. The edges around a merged vertex get their new cost for the next pass.
///
/// An edge's cost depends on its two vertices alone, so that what is collapsed costs what it was
/// ranked by; only a merged vertex waits. The distance to the original is that of the greedy order to
/// 1 % on captures at a tenth of their faces.
pub(super) struct Passes {
    edges: Vec<Rated>,
    ranking: Ranking,
    /// By vertex, whether this pass has touched it.
    touched: Vec<bool>,
    /// Those that are left of the touched ones.
    merged: Vec<u32>,
    /// Edges that this pass was refused: they are forgotten until one of their vertices changes.
    refused: usize,
    neighbors: Vec<u32>,
}

/// The share of the edges that a pass looks at. Less means more passes and an order closer to
/// the greedy one: between 0.1 and 0.3 the distance to the original is the same.
const PASS_SHARE: f64 = 0.2;

/// A pass looks at no more edges than this for each collapse that is still to be made, so that
/// the last ones are cheap too.
const EDGES_PER_COLLAPSE: usize = 3;

/// But at no fewer than this: the last passes would rank all edges for a handful that are refused.
const MIN_EDGES: usize = 64;

/// Edges whose surroundings are read together before the first of them collapses: one by one the
/// processor would wait for each, as the next cheapest edge is elsewhere on the mesh. Frames that do not
/// fit into its cache gain the most, an eighth of the time at 100,000 faces.
const READ_AHEAD: usize = 32;

/// The cost of an edge that was refused.
const REFUSED: f32 = f32::INFINITY;

impl Passes {
    pub fn new(vertex_count: usize) -> Self {
        Self {
            edges: Vec::new(),
            ranking: Ranking::default(),
            touched: vec![false; vertex_count],
            merged: Vec::new(),
            refused: 0,
            neighbors: Vec::new(),
        }
    }

    /// Collapses what it can of the `wanted` cheapest edges.
    fn pass(&mut self, mesh: &mut Collapses<'_>, target: usize, rules: Rules, wanted: usize) {
        let Self {
            edges,
            ranking,
            touched,
            ..
        } = self;
        for cheapest in ranking.cheapest(edges, wanted).chunks(READ_AHEAD) {
            mesh.read_ahead(
                cheapest
                    .iter()
                    .map(|&(_, index)| edges[index as usize].edge),
            );
            for &(_, index) in cheapest {
                let Rated { edge, cost } = &mut edges[index as usize];
                let ends = [edge.0 as usize, edge.1 as usize];
                if ends.iter().any(|&end| touched[end]) {
                    continue;
                }
                let Some((left, _)) = mesh.try_collapse(*edge, target, rules) else {
                    *cost = REFUSED;
                    self.refused += 1;
                    continue;
                };
                ends.iter().for_each(|&end| touched[end] = true);
                self.merged.push(left);
                if mesh.connectivity.face_count() <= target {
                    return;
                }
            }
        }
    }

    /// Replaces the edges at touched vertices by those that are there now, and forgets those that
    /// were refused: cheap ones that are refused for good would leave room for no others.
    fn rate_again(&mut self, mesh: &mut Collapses<'_>) {
        let touched = &mut self.touched;
        // Without a branch: which edges stay is not to be foretold.
        let mut kept = 0;
        for at in 0..self.edges.len() {
            let Rated { edge, cost } = self.edges[at];
            let is_touched = touched[edge.0 as usize] | touched[edge.1 as usize];
            self.edges[kept] = Rated { edge, cost };
            kept += usize::from((cost != REFUSED) & !is_touched);
        }
        self.edges.truncate(kept);
        self.refused = 0;
        for &vertex in &self.merged {
            mesh.connectivity.neighbors(vertex, &mut self.neighbors);
            for &neighbor in &self.neighbors {
                // Those between two merged vertices come once.
                if touched[neighbor as usize] && neighbor < vertex {
                    continue;
                }
                let edge = Edge::new(vertex, neighbor);
                self.edges.push(Rated { edge, cost: 0.0 });
            }
        }
        mesh.rate(&mut self.edges[kept..]);
        for vertex in self.merged.drain(..) {
            touched[vertex as usize] = false;
        }
    }
}

impl Order for Passes {
    fn fill(&mut self, mesh: &mut Collapses<'_>) {
        self.edges.clear();
        mesh.connectivity
            .for_each_edge(|edge| self.edges.push(Rated { edge, cost: 0.0 }));
        mesh.rate(&mut self.edges);
    }

    fn drain(&mut self, mesh: &mut Collapses<'_>, target: usize, rules: Rules) {
        while target < mesh.connectivity.face_count() {
            let missing = (mesh.connectivity.face_count() - target).div_ceil(2);
            let share = (PASS_SHARE * self.edges.len() as f64) as usize;
            let wanted = share.min(EDGES_PER_COLLAPSE * missing).max(MIN_EDGES);
            self.pass(mesh, target, rules, wanted);
            if self.merged.is_empty() && self.refused == 0 {
                return;
            }
            self.rate_again(mesh);
        }
    }
}
