//! Nodes on the source, and how they move its vertices.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

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
            node_spacing: 5.0,
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
        let edges = edges_between(&influences);
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

fn edges_between(influences: &Rows<Influence>) -> Vec<(u32, u32)> {
    let mut edges = Vec::new();
    for vertex in 0..influences.row_count() {
        let row = influences.row(vertex);
        for (i, a) in row.iter().enumerate() {
            edges.extend(row[i + 1..].iter().map(|b| (a.node, b.node)));
        }
        // Neighboring vertices have nearly the same pairs; this keeps the list short.
        if vertex % 1024 == 1023 {
            edges.sort_unstable();
            edges.dedup();
        }
    }
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// Shortest paths along edges from one vertex, up to a limit (Dijkstra's algorithm).
struct EdgeDistances<'a> {
    positions: &'a [Point],
    neighbors: Rows,
    distances: Vec<f64>,
    touched: Vec<u32>,
}

impl<'a> EdgeDistances<'a> {
    fn new(mesh: &'a TriangleMesh) -> Self {
        Self {
            positions: mesh.positions(),
            neighbors: vertex_neighbors(mesh),
            distances: vec![f64::INFINITY; mesh.vertex_count()],
            touched: Vec::new(),
        }
    }

    /// Calls `visit` with every vertex closer than `limit` and its distance, nearest first.
    fn visit_within(&mut self, start: u32, limit: f64, mut visit: impl FnMut(u32, f64)) {
        // Distances are not negative, so their bits are in their order.
        let mut queue = BinaryHeap::from([Reverse((0.0f64.to_bits(), start))]);
        self.distances[start as usize] = 0.0;
        self.touched.push(start);
        while let Some(Reverse((bits, vertex))) = queue.pop() {
            let distance = f64::from_bits(bits);
            if self.distances[vertex as usize] < distance {
                continue;
            }
            visit(vertex, distance);
            for &next in self.neighbors.row(vertex as usize) {
                let step: Vector = self.positions[next as usize] - self.positions[vertex as usize];
                let through = distance + step.norm();
                if through < limit && through < self.distances[next as usize] {
                    if self.distances[next as usize].is_infinite() {
                        self.touched.push(next);
                    }
                    self.distances[next as usize] = through;
                    queue.push(Reverse((through.to_bits(), next)));
                }
            }
        }
        for vertex in self.touched.drain(..) {
            self.distances[vertex as usize] = f64::INFINITY;
        }
    }
}
