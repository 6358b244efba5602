//! A factorised stand-in for the normal matrix of the surrogate: sparse, one for x, y and z, its
//! pattern analysed once.
//!
//! Correspondences weigh all directions alike in it, by the mean of what they weigh in truth:
//! that makes it a good preconditioner and an initial Hessian a ninth the size.
//!
//! The matrix has 4 rows a node. Nodes that move a vertex in common, and no others, share a
//! 4 x 4 block. Only the lower triangle is stored.

use nalgebra::{Matrix4, Matrix4x3, Vector4};
use wide::f32x4;

use crate::registration::RegistrationError;

use super::block_cholesky::{Block, Factor, Pattern, Right};
use super::energy::{MEAN_WEIGHT, Problem, Surrogate};
use super::scaled_equations::Rows4;
use super::{DeformationGraph, NodeTransforms};

/// Share of every diagonal entry that is added to it: what determines nodes that no
/// correspondence reaches. Above what rounding to `f32` takes away.
const DAMPING: f64 = 1e-5;

/// The sparsity of the normal matrix, and its symbolic factorisation.
pub(super) struct System {
    pattern: Pattern,
    /// For every node, where its edges to nodes above it start.
    starts: Vec<usize>,
    /// Where they lead.
    seconds: Vec<u32>,
}

/// A factorised matrix. It is in `f32`, with ones on its diagonal, whatever the unit of length: a
/// stand-in need not be more exact, and costs half.
pub(super) struct Factorised<'a> {
    factor: Factor<'a>,
    /// For every row, what makes its diagonal entry 1 from both sides.
    scales: Vec<Vector4<f64>>,
}

impl System {
    /// Analyses the pattern of `graph`.
    pub fn new(graph: &DeformationGraph) -> Self {
        let (node_count, edges) = (graph.nodes().len(), graph.edges());
        let first_of = |node| edges.partition_point(|&(a, _)| (a as usize) < node);
        Self {
            pattern: Pattern::new(node_count, edges),
            starts: (0..=node_count).map(first_of).collect(),
            seconds: edges.iter().map(|&(_, b)| b).collect(),
        }
    }

    /// Assembles and factorises the stand-in for the normal matrix of `surrogate`.
    pub fn factorise(
        &self,
        problem: &Problem<'_>,
        surrogate: &Surrogate,
    ) -> Result<Factorised<'_>, RegistrationError> {
        let node_count = self.starts.len() - 1;
        let mut normal = Assembly {
            system: self,
            diagonal: vec![Matrix4::zeros(); node_count],
            edges: vec![Matrix4::zeros(); self.seconds.len()],
        };
        normal.add_alignment(problem, surrogate);
        normal.add_smoothness(problem, surrogate);
        normal.add_rotation(problem.weights.rotation);
        let scales: Vec<Vector4<f64>> = normal.diagonal.iter().map(scales_of).collect();
        let diagonal = |node: usize| {
            let mut block = scaled(&normal.diagonal[node], &scales[node], &scales[node]);
            block.set_diagonal(&Vector4::repeat(1.0 + DAMPING));
            rounded(&block)
        };
        let edges = problem.graph.edges();
        let edge_block = |edge: usize| {
            let (a, b) = edges[edge];
            let (rows, columns) = (&scales[b as usize], &scales[a as usize]);
            rounded(&scaled(&normal.edges[edge], rows, columns))
        };
        let factor = self
            .pattern
            .factorise(diagonal, edge_block)
            .map_err(|failed| RegistrationError::Factorisation {
                unknowns: 4 * node_count,
                reason: format!("the block of node {} is not positive", failed.node),
            })?;
        Ok(Factorised { factor, scales })
    }
}

fn scales_of(block: &Matrix4<f64>) -> Vector4<f64> {
    let scale = |entry: f64| {
        if entry > 0.0 { 1.0 / entry.sqrt() } else { 0.0 }
    };
    block.diagonal().map(scale)
}

fn scaled(block: &Matrix4<f64>, rows: &Vector4<f64>, columns: &Vector4<f64>) -> Matrix4<f64> {
    Matrix4::from_fn(|r, c| block[(r, c)] * rows[r] * columns[c])
}

fn rounded(block: &Matrix4<f64>) -> Block {
    std::array::from_fn(|c| f32x4::from(std::array::from_fn(|r| block[(r, c)] as f32)))
}

impl Factorised<'_> {
    /// For every row, what makes its diagonal entry 1 from both sides.
    pub fn scales(&self) -> &[Vector4<f64>] {
        &self.scales
    }

    /// Scales a right-hand side of a 4 x 3 block a node by its rows' scales, and into the range of
    /// `f32`; returns also what it was divided by.
    pub fn scaled(&self, right: &[Matrix4x3<f64>]) -> (Vec<Rows4>, f64) {
        let nodes = || right.iter().zip(&self.scales);
        let size = nodes()
            .flat_map(|(block, scales)| (0..12).map(move |i| (block[i] * scales[i % 4]).abs()))
            .fold(f64::MIN_POSITIVE, f64::max);
        let scaled = nodes().map(|(block, scales)| -> Rows4 {
            std::array::from_fn(|r| {
                let entry = |c: usize| (block[(r, c)] * scales[r] / size) as f32;
                f32x4::from([entry(0), entry(1), entry(2), 0.0])
            })
        });
        (scaled.collect(), size)
    }

    /// A step in scaled unknowns, times `size`, as it is.
    pub fn unscaled(&self, step: &[Rows4], size: f64) -> Result<NodeTransforms, RegistrationError> {
        let nodes = step.iter().zip(&self.scales);
        let blocks: NodeTransforms = nodes
            .map(|(rows, scales)| {
                let rows = rows.map(f32x4::to_array);
                let entry = |r: usize, c: usize| f64::from(rows[r][c]) * (size * scales[r]);
                Matrix4x3::from_fn(entry)
            })
            .collect();
        let is_finite = |block: &Matrix4x3<f64>| block.iter().all(|entry| entry.is_finite());
        if blocks.iter().all(is_finite) {
            Ok(blocks)
        } else {
            Err(RegistrationError::NotFinite { step: "non-rigid" })
        }
    }

    /// Solves for a scaled right-hand side, in scaled unknowns.
    pub fn solve_scaled(&self, right: &[Rows4]) -> Vec<Rows4> {
        let solution = self.factor.solve(|node| -> Right {
            let [x, y, z, _] = f32x4::transpose(right[node]);
            [x, y, z]
        });
        let rows = solution.iter();
        rows.map(|&[x, y, z]| f32x4::transpose([x, y, z, f32x4::ZERO]))
            .collect()
    }

    /// Solves for a right-hand side of a 4 x 3 block a node.
    pub fn solve(&self, right: &[Matrix4x3<f64>]) -> Result<NodeTransforms, RegistrationError> {
        let (right, size) = self.scaled(right);
        self.unscaled(&self.solve_scaled(&right), size)
    }
}

struct Assembly<'a> {
    system: &'a System,
    diagonal: Vec<Matrix4<f64>>,
    /// Rows of the second node, columns of the first.
    edges: Vec<Matrix4<f64>>,
}

impl Assembly<'_> {
    fn add_alignment(&mut self, problem: &Problem<'_>, surrogate: &Surrogate) {
        for pull in &surrogate.alignment {
            let basis = problem.samples.basis(pull.sample as usize);
            for (slot, (column, column_basis)) in basis.iter().enumerate() {
                let weighted = column_basis * (pull.weight * MEAN_WEIGHT);
                self.diagonal[*column as usize] += column_basis.transpose() * weighted;
                for (row, row_basis) in &basis[slot + 1..] {
                    let edge = self.edge(*column, *row);
                    self.edges[edge] += row_basis.transpose() * weighted;
                }
            }
        }
    }

    fn add_smoothness(&mut self, problem: &Problem<'_>, surrogate: &Surrogate) {
        let edges = problem.graph.edges().iter().zip(&surrogate.smoothness);
        for (edge, (&(a, b), weights)) in edges.enumerate() {
            for ((i, j), weight) in [((a, b), weights[0]), ((b, a), weights[1])] {
                let [basis_j, basis_i] = problem.edge_basis((i, j));
                self.diagonal[j as usize] += basis_j.transpose() * basis_j * weight;
                self.diagonal[i as usize] += basis_i.transpose() * basis_i * weight;
                self.edges[edge] += if j < i {
                    basis_i.transpose() * basis_j * weight
                } else {
                    basis_j.transpose() * basis_i * weight
                };
            }
        }
    }

    fn add_rotation(&mut self, weight: f64) {
        for block in &mut self.diagonal {
            (0..3).for_each(|c| block[(c, c)] += weight);
        }
    }

    /// The edge from `first` to `second`, which is above it and has a vertex in common with it.
    fn edge(&self, first: u32, second: u32) -> usize {
        let starts = &self.system.starts[first as usize..];
        let seconds = &self.system.seconds[starts[0]..starts[1]];
        starts[0] + seconds.partition_point(|&node| node < second)
    }
}
