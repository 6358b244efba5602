//! Nodes on the source, and how they move its vertices.

use crate::mesh::Rows;
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
        let spacing = spacing_for(mesh, mesh.mean_edge(), options);
        let reach = spacing * options.influence;
        let spacing_share = (1.0 / options.influence) as f32;
        let mut search = EdgeDistances::new(mesh, reach);
        let mut covered = vec![false; mesh.vertex_count()];
        let mut nodes = Vec::new();
        let mut shares = Vec::new();
        for vertex in 0..mesh.vertex_count() {
            if covered[vertex] || options.max_nodes <= nodes.len() {
                continue;
            }
            let node = nodes.len() as u32;
            nodes.push(mesh.positions()[vertex]);
            search.visit_within_reach(vertex as u32, |reached, distance| {
                covered[reached as usize] |= distance <= spacing_share;
                // (1 − d²/r²)³ of Fast-RNRR, section 3.1: smooth, and 0 at the reach.
                let weight = (1.0 - f64::from(distance).powi(2)).powi(3);
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
    Rows::from_pairs(vertex_count, shares).map(|vertex, share| Influence {
        node: share.node,
        weight: share.weight / sums[vertex],
    })
}

fn edges_between(influences: &Rows<Influence>, node_count: usize) -> Vec<(u32, u32)> {
    // A bit for every pair of nodes, 64 to a word.
    let words = node_count.div_ceil(64);
    let mut coupled = vec![0u64; words * node_count];
    for vertex in 0..influences.row_count() {
        let row = influences.row(vertex);
        for (i, a) in row.iter().enumerate() {
            let others = &mut coupled[words * a.node as usize..][..words];
            for b in &row[i + 1..] {
                others[b.node as usize / 64] |= 1 << (b.node % 64);
            }
        }
    }
    let mut edges = Vec::new();
    for (number, mut word) in coupled.into_iter().enumerate() {
        while word != 0 {
            let other = (number % words * 64) as u32 + word.trailing_zeros();
            edges.push(((number / words) as u32, other));
            word &= word - 1;
        }
    }
    edges
}

/// Short paths along edges from one vertex, up to a reach, in shares of it.
///
/// Breadth first: a path has the fewest edges, or almost, and among those about the least length.
/// On the triangles of a captured surface, whose edges differ by a factor of some two, that is a few
/// percent longer than the shortest path, and every vertex is looked at once.
struct EdgeDistances {
    neighbors: Rows<(u32, f32)>,
    /// 1 where nothing has been reached.
    distances: Vec<f32>,
    /// In the order in which they were reached.
    reached: Vec<u32>,
}

impl EdgeDistances {
    fn new(mesh: &TriangleMesh, reach: f64) -> Self {
        let positions = mesh.positions();
        let scale = if reach > 0.0 { 1.0 / reach } else { 0.0 };
        Self {
            neighbors: mesh.vertex_neighbors().map(|from, to| {
                let step: Vector = positions[to as usize] - positions[from];
                (to, (step.norm() * scale) as f32)
            }),
            distances: vec![1.0; mesh.vertex_count()],
            reached: Vec::new(),
        }
    }

    /// Calls `visit` with every vertex closer than the reach and its distance, below 1.
    fn visit_within_reach(&mut self, start: u32, mut visit: impl FnMut(u32, f32)) {
        self.distances[start as usize] = 0.0;
        self.reached.push(start);
        let mut next = 0;
        while let Some(&vertex) = self.reached.get(next) {
            next += 1;
            let distance = self.distances[vertex as usize];
            for &(neighbor, length) in self.neighbors.row(vertex as usize) {
                let through = distance + length;
                let known = &mut self.distances[neighbor as usize];
                if through < *known {
                    if *known >= 1.0 {
                        self.reached.push(neighbor);
                    }
                    *known = through;
                }
            }
        }
        for vertex in self.reached.drain(..) {
            visit(
                vertex,
                std::mem::replace(&mut self.distances[vertex as usize], 1.0),
            );
        }
    }
}
