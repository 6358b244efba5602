//! A factorised stand-in for the normal matrix of the surrogate: sparse, one for x, y and z, its
//! pattern analysed once.
//!
//! Correspondences weigh all directions alike in it, by the mean of what they weigh in truth:
//! that makes it a good preconditioner and an initial Hessian a ninth the size.
//!
//! The matrix has 4 rows a node. Nodes that move a vertex in common, and no others, share a
//! 4 x 4 block. Only the lower triangle is stored.

use faer::Mat;
use faer::Side;
use faer::linalg::cholesky::llt::factor::LltError as PivotError;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::LltError;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{FaerError, SparseColMatRef, SymbolicSparseColMat};
use nalgebra::{Matrix4, Matrix4x3};

use crate::registration::RegistrationError;

use super::energy::{MEAN_WEIGHT, Problem, Surrogate};
use super::{DeformationGraph, NodeTransforms};

/// Share of the largest diagonal entry that is added to all: what determines nodes that no
/// correspondence reaches. Far below what any weight of 1e-6 does.
const DAMPING: f64 = 1e-9;

/// The sparsity of the normal matrix, and its symbolic factorisation.
pub(super) struct System {
    symbolic_matrix: SymbolicSparseColMat<usize>,
    symbolic_factor: SymbolicLlt<usize>,
    /// For every node, the nodes above it that it shares a block with, ascending.
    below: Vec<Vec<u32>>,
    column_starts: Vec<usize>,
}

/// A factorised matrix.
pub(super) struct Factorised {
    factor: Llt<usize, f64>,
}

impl System {
    /// Analyses the pattern of `graph`.
    pub fn new(graph: &DeformationGraph) -> Result<Self, RegistrationError> {
        let node_count = graph.nodes().len();
        let mut below = vec![Vec::new(); node_count];
        for &(i, j) in graph.edges() {
            below[i as usize].push(j);
        }
        let mut column_starts = vec![0];
        let mut row_indices = Vec::new();
        for (node, others) in below.iter().enumerate() {
            for column in 0..4 {
                row_indices.extend((column..4).map(|row| 4 * node + row));
                for &other in others {
                    row_indices.extend((0..4).map(|row| 4 * other as usize + row));
                }
                column_starts.push(row_indices.len());
            }
        }
        let size = 4 * node_count;
        let symbolic_matrix =
            SymbolicSparseColMat::new_checked(size, size, column_starts.clone(), None, row_indices);
        let symbolic_factor = SymbolicLlt::try_new(symbolic_matrix.as_ref(), Side::Lower)
            .map_err(|error| factorisation_error(size, error.into()))?;
        Ok(Self {
            symbolic_matrix,
            symbolic_factor,
            below,
            column_starts,
        })
    }

    /// Assembles and factorises the stand-in for the normal matrix of `surrogate`.
    pub fn factorise(
        &self,
        problem: &Problem<'_>,
        surrogate: &Surrogate,
    ) -> Result<Factorised, RegistrationError> {
        let size = 4 * self.below.len();
        let mut normal = Assembly {
            system: self,
            values: vec![0.0; self.column_starts[size]],
        };
        normal.add_alignment(problem, surrogate);
        normal.add_smoothness(problem, surrogate);
        normal.add_rotation_and_damping(problem.weights.rotation);
        let matrix = SparseColMatRef::new(self.symbolic_matrix.as_ref(), &normal.values);
        let factor = Llt::try_new_with_symbolic(self.symbolic_factor.clone(), matrix, Side::Lower)
            .map_err(|error| factorisation_error(size, error))?;
        Ok(Factorised { factor })
    }
}

fn factorisation_error(unknowns: usize, error: LltError) -> RegistrationError {
    let reason = match error {
        LltError::Numeric(PivotError::NonPositivePivot { index }) => {
            format!("pivot {index} is not positive")
        }
        LltError::Generic(FaerError::OutOfMemory) => "there is too little memory".to_owned(),
        LltError::Generic(_) => "its indices are too large".to_owned(),
    };
    RegistrationError::Factorisation { unknowns, reason }
}

impl Factorised {
    /// Solves for a right-hand side of a 4 x 3 block a node.
    pub fn solve(&self, right: &[Matrix4x3<f64>]) -> Result<NodeTransforms, RegistrationError> {
        let dense = Mat::from_fn(4 * right.len(), 3, |row, column| {
            right[row / 4][(row % 4, column)]
        });
        let solution = self.factor.solve(&dense);
        let transforms: NodeTransforms = (0..right.len())
            .map(|node| Matrix4x3::from_fn(|row, column| solution[(4 * node + row, column)]))
            .collect();
        if transforms
            .iter()
            .all(|x| x.iter().all(|entry| entry.is_finite()))
        {
            Ok(transforms)
        } else {
            Err(RegistrationError::NotFinite { step: "non-rigid" })
        }
    }
}

struct Assembly<'a> {
    system: &'a System,
    values: Vec<f64>,
}

impl Assembly<'_> {
    fn add_alignment(&mut self, problem: &Problem<'_>, surrogate: &Surrogate) {
        for pull in &surrogate.alignment {
            let basis = problem.samples.basis(pull.sample as usize);
            for (slot, (column, column_basis)) in basis.iter().enumerate() {
                let weighted = column_basis * (pull.weight * MEAN_WEIGHT);
                for (row, row_basis) in &basis[slot..] {
                    self.add_block(*row, *column, &(row_basis.transpose() * weighted));
                }
            }
        }
    }

    fn add_smoothness(&mut self, problem: &Problem<'_>, surrogate: &Surrogate) {
        for (&(a, b), weights) in problem.graph.edges().iter().zip(&surrogate.smoothness) {
            for ((i, j), weight) in [((a, b), weights[0]), ((b, a), weights[1])] {
                let [basis_j, basis_i] = problem.edge_basis((i, j));
                self.add_block(j, j, &(basis_j.transpose() * basis_j * weight));
                self.add_block(i, i, &(basis_i.transpose() * basis_i * weight));
                if j < i {
                    self.add_block(i, j, &(basis_i.transpose() * basis_j * weight));
                } else {
                    self.add_block(j, i, &(basis_j.transpose() * basis_i * weight));
                }
            }
        }
    }

    fn add_rotation_and_damping(&mut self, rotation_weight: f64) {
        let node_count = self.system.below.len();
        let diagonal = |(node, c): (usize, usize)| self.diagonal(node, c);
        let entries = || (0..node_count).flat_map(|node| (0..4).map(move |c| (node, c)));
        let slots: Vec<usize> = entries().map(diagonal).collect();
        // The rows of the matrices and those of the translations differ by a squared length.
        let largest = |is_affine: bool, least: f64| {
            let of_kind = slots.iter().zip(entries());
            let of_kind = of_kind.filter(|(_, (_, c))| (*c < 3) == is_affine);
            of_kind.fold(least, |largest, (&slot, _)| largest.max(self.values[slot]))
        };
        let affine = DAMPING * largest(true, rotation_weight) + rotation_weight;
        let translation = DAMPING * largest(false, 0.0);
        for (&slot, (_, c)) in slots.iter().zip(entries()) {
            self.values[slot] += if c < 3 { affine } else { translation };
        }
    }

    /// Where the diagonal entry `c` of `node` is stored.
    fn diagonal(&self, node: usize, c: usize) -> usize {
        self.system.column_starts[4 * node + c]
    }

    /// Adds a block to row node `row` and column node `column`, `column <= row`.
    fn add_block(&mut self, row: u32, column: u32, block: &Matrix4<f64>) {
        let starts = &self.system.column_starts[4 * column as usize..4 * column as usize + 4];
        if row == column {
            for (c, &start) in starts.iter().enumerate() {
                for r in c..4 {
                    self.values[start + r - c] += block[(r, c)];
                }
            }
            return;
        }
        let below = &self.system.below[column as usize];
        let slot = below.partition_point(|&node| node < row);
        for (c, &start) in starts.iter().enumerate() {
            let first = start + (4 - c) + 4 * slot;
            for r in 0..4 {
                self.values[first + r] += block[(r, c)];
            }
        }
    }
}
