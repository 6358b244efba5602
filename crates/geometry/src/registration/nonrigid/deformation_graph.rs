//! Nodes on the source, and how they move its vertices.

use std::collections::VecDeque;

use crate::mesh::{Rows, mean_edge, vertex_neighbors};
use crate::{Point, TriangleMesh, Vector};

/// Where the nodes go and how far they reach.
#[derive(Debug, Clone, PartialEq)]
pub struct GraphOptions {
    /// No vertex is further than this from a node, along the edges, in mean edges.
    pub node_spacing: f64,
    /// A node moves vertices up to this many spacings away, along the edges.
    pub influence: f64,
    /// Nodes at the most. The spacing grows on meshes whose area would need more; parts that are
    /// left over after that (thousands of loose pieces) move with the rigid step only.
    pub max_nodes: usize,
}

impl Default for GraphOptions {
    fn default() -> Self {
        Self {
            node_spacing: 7.0,
            influence: 1.25,
            max_nodes: 1500,
        }
    }
}

/// One node's share in a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Influence {
    /// The node.
    pub node: u32,
    /// Its weight w_j(v), above 0; the weights of one vertex add up to 1.
    pub weight: f64,
}

/// A coarse graph over a mesh whose nodes carry an affine map and a translation each (Eq. 2).
///
/// Distances are along the mesh's edges, so that surfaces that touch (arm and torso) are not
/// coupled.
#[derive(Debug, Clone)]
pub struct DeformationGraph {
    nodes: Vec<Point>,
    influences: Rows<Influence>,
    edges: Vec<(u32, u32)>,
}

impl DeformationGraph {
    /// Places nodes on `mesh` so that every vertex is within the spacing of one.
    #[must_use]
    pub fn new(mesh: &TriangleMesh, options: &GraphOptions) -> Self {
        let spacing = spacing_for(mesh, mean_edge(mesh), options);
        let reach = spacing * options.influence;
        let mut search = EdgeDistances::new(mesh);
        let mut covered = vec![false; mesh.vertex_count()];
        let mut nodes = Vec::new();
        let mut shares: Vec<(u32, Influence)> = Vec::new();
        for vertex in 0..mesh.vertex_count() {
            if covered[vertex] || options.max_nodes <= nodes.len() {
                continue;
            }
            let node = nodes.len() as u32;
            nodes.push(mesh.positions()[vertex]);
            search.visit_within(vertex as u32, reach, |reached, distance| {
                covered[reached as usize] |= distance <= spacing;
                // (1 − d²/r²)³ of Fast-RNRR, section 3.1: smooth, and 0 at the reach.
                let weight = (1.0 - (distance / reach).powi(2)).powi(3);
                shares.push((reached, Influence { node, weight }));
            });
        }
        let influences = normalized(mesh.vertex_count(), &shares);
        let edges = edges_between(&influences, nodes.len());
        Self {
            nodes,
            influences,
            edges,
        }
    }

    /// The nodes' positions p_j (g_j in Eq. 2).
    #[must_use]
    pub fn nodes(&self) -> &[Point] {
        &self.nodes
    }

    /// The nodes that move `vertex`, in ascending order; none for a vertex that only the rigid
    /// step moves.
    #[must_use]
    pub fn influences(&self, vertex: usize) -> &[Influence] {
        self.influences.row(vertex)
    }

    /// Pairs of nodes that move a vertex in common, each once, the smaller first.
    #[must_use]
    pub fn edges(&self) -> &[(u32, u32)] {
        &self.edges
    }
}

/// The spacing asked for, or more where that would need too many nodes.
fn spacing_for(mesh: &TriangleMesh, mean_edge: f64, options: &GraphOptions) -> f64 {
    let area: f64 = (0..mesh.face_count())
        .map(|f| {
            let [a, b, c] = mesh.triangle(f);
            (b - a).cross(&(c - a)).norm() / 2.0
        })
        .sum();
    // Discs that cover everything and whose centers are a radius apart: about one node for
    // every r² of area.
    let fits = (area / options.max_nodes.max(1) as f64).sqrt();
    (options.node_spacing * mean_edge).max(fits)
}

fn normalized(vertex_count: usize, shares: &[(u32, Influence)]) -> Rows<Influence> {
    let mut sums = vec![0.0; vertex_count];
    for (vertex, share) in shares {
        sums[*vertex as usize] += share.weight;
    }
    let scaled: Vec<(u32, Influence)> = shares
        .iter()
        .filter(|(_, share)| 0.0 < share.weight)
        .map(|&(vertex, Influence { node, weight })| {
            (
                vertex,
                Influence {
                    node,
                    weight: weight / sums[vertex as usize],
                },
            )
        })
        .collect();
    Rows::from_pairs(vertex_count, &scaled)
}

fn edges_between(influences: &Rows<Influence>, node_count: usize) -> Vec<(u32, u32)> {
    // A node has few neighbors: looking through them is cheaper than sorting all pairs.
    let mut above = vec![Vec::new(); node_count];
    for vertex in 0..influences.row_count() {
        let row = influences.row(vertex);
        for (i, a) in row.iter().enumerate() {
            let known: &mut Vec<u32> = &mut above[a.node as usize];
            for b in &row[i + 1..] {
                if !known.contains(&b.node) {
                    known.push(b.node);
                }
            }
        }
    }
    let mut edges = Vec::new();
    for (a, others) in above.iter_mut().enumerate() {
        others.sort_unstable();
        edges.extend(others.iter().map(|&b| (a as u32, b)));
    }
    edges
}

/// Shortest paths along edges from one vertex, up to a limit.
///
/// Labels are corrected first in, first out (Bellman and Ford): within so few edges that is
/// cheaper than keeping a heap.
struct EdgeDistances {
    neighbors: Rows<(u32, f64)>,
    distances: Vec<f64>,
    waiting: Vec<bool>,
    queue: VecDeque<u32>,
    touched: Vec<u32>,
}

impl EdgeDistances {
    fn new(mesh: &TriangleMesh) -> Self {
        let positions = mesh.positions();
        Self {
            neighbors: vertex_neighbors(mesh).map(|from, to| {
                let step: Vector = positions[to as usize] - positions[from];
                (to, step.norm())
            }),
            distances: vec![f64::INFINITY; mesh.vertex_count()],
            waiting: vec![false; mesh.vertex_count()],
            queue: VecDeque::new(),
            touched: Vec::new(),
        }
    }

    /// Calls `visit` with every vertex closer than `limit` and its distance.
    fn visit_within(&mut self, start: u32, limit: f64, mut visit: impl FnMut(u32, f64)) {
        self.distances[start as usize] = 0.0;
        self.touched.push(start);
        self.queue.push_back(start);
        while let Some(vertex) = self.queue.pop_front() {
            self.waiting[vertex as usize] = false;
            let distance = self.distances[vertex as usize];
            for &(next, length) in self.neighbors.row(vertex as usize) {
                let through = distance + length;
                let known = &mut self.distances[next as usize];
                if through < limit && through < *known {
                    if known.is_infinite() {
                        self.touched.push(next);
                    }
                    *known = through;
                    if !std::mem::replace(&mut self.waiting[next as usize], true) {
                        self.queue.push_back(next);
                    }
                }
            }
        }
        for vertex in self.touched.drain(..) {
            let distance = &mut self.distances[vertex as usize];
            visit(vertex, *distance);
            *distance = f64::INFINITY;
        }
    }
}
