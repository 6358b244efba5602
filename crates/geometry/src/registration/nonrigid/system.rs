//! The normal matrix of the surrogate: sparse, one for x, y and z, its pattern analysed once.
//!
//! The matrix has 4 rows a node. Nodes that move a vertex in common, and no others, share a
//! 4 x 4 block. Only the lower triangle is stored.

use faer::Mat;
use faer::Side;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use nalgebra::{Matrix4, Matrix4x3, RowVector4};

use crate::registration::{RegistrationError, nearest_rotation};

use super::NodeTransforms;
use super::energy::{Problem, Surrogate, affine_part};

/// Share of the largest diagonal entry that holds each node where it was in the last round:
/// what determines nodes that no correspondence reaches. Far below what any weight of 1e-6
/// does, so that it does not slow the others down.
const DAMPING: f64 = 1e-9;

/// The sparsity of the normal matrix, and its symbolic factorisation.
pub(super) struct System {
    symbolic_matrix: SymbolicSparseColMat<usize>,
    symbolic_factor: SymbolicLlt<usize>,
    /// For every node, the nodes above it that it shares a block with, ascending.
    below: Vec<Vec<u32>>,
    column_starts: Vec<usize>,
}

/// A factorised normal matrix and the part of the right-hand side that rotations do not change.
pub(super) struct Factorised {
    factor: Llt<usize, f64>,
    right: Vec<Matrix4x3<f64>>,
    rotation_weight: f64,
}

impl System {
    /// Analyses the pattern of `problem`.
    pub fn new(problem: &Problem<'_>) -> Result<Self, RegistrationError> {
        let node_count = problem.graph.nodes().len();
        let mut below = vec![Vec::new(); node_count];
        for &(i, j) in problem.graph.edges() {
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
            .map_err(|error| factorisation_error(size, &error))?;
        Ok(Self {
            symbolic_matrix,
            symbolic_factor,
            below,
            column_starts,
        })
    }

    /// Assembles and factorises the normal matrix of `surrogate`.
    pub fn factorise(
        &self,
        problem: &Problem<'_>,
        surrogate: &Surrogate,
        previous: &NodeTransforms,
    ) -> Result<Factorised, RegistrationError> {
        let size = 4 * self.below.len();
        let mut normal = Assembly {
            system: self,
            values: vec![0.0; self.column_starts[size]],
            right: vec![Matrix4x3::zeros(); self.below.len()],
        };
        normal.add_alignment(problem, surrogate);
        normal.add_smoothness(problem, surrogate);
        normal.add_rotation_and_damping(problem.weights.rotation, previous);
        let matrix = SparseColMatRef::new(self.symbolic_matrix.as_ref(), &normal.values);
        let factor = Llt::try_new_with_symbolic(self.symbolic_factor.clone(), matrix, Side::Lower)
            .map_err(|error| factorisation_error(size, &error))?;
        Ok(Factorised {
            factor,
            right: normal.right,
            rotation_weight: problem.weights.rotation,
        })
    }
}

fn factorisation_error(unknowns: usize, error: &dyn std::fmt::Debug) -> RegistrationError {
    RegistrationError::Factorisation {
        unknowns,
        reason: format!("{error:?}"),
    }
}

impl Factorised {
    /// Minimizes the surrogate with the rotation term's projections fixed to those of
    /// `transforms`.
    pub fn minimizer(
        &self,
        transforms: &NodeTransforms,
    ) -> Result<NodeTransforms, RegistrationError> {
        let mut right = self.right.clone();
        for (right, transform) in right.iter_mut().zip(transforms) {
            let rotation = nearest_rotation(&affine_part(transform))
                .ok_or(RegistrationError::NotFinite { step: "non-rigid" })?;
            let mut rows = right.fixed_rows_mut::<3>(0);
            rows += rotation.transpose() * self.rotation_weight;
        }
        self.solve(&right)
    }

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

    /// Half the gradient of the surrogate at `transforms`: H·X minus the right-hand side of the
    /// minimizer, which is H·(X − minimizer).
    pub fn half_gradient(
        &self,
        problem: &Problem<'_>,
        surrogate: &Surrogate,
        transforms: &NodeTransforms,
    ) -> Result<Vec<Matrix4x3<f64>>, RegistrationError> {
        let mut gradient = vec![Matrix4x3::zeros(); transforms.len()];
        for (index, weight, target) in &surrogate.alignment {
            let sample = &problem.samples[*index as usize];
            let residual = (sample.deformed(transforms) - target).transpose() * *weight;
            for (node, basis) in &sample.basis {
                gradient[*node as usize] += basis.transpose() * residual;
            }
        }
        for (&(a, b), weights) in problem.graph.edges().iter().zip(&surrogate.smoothness) {
            for ((i, j), weight) in [((a, b), weights[0]), ((b, a), weights[1])] {
                let gap = problem.edge_gap((i, j), transforms).transpose() * weight;
                let [basis_j, basis_i] = edge_basis(problem, (i, j));
                gradient[j as usize] += basis_j.transpose() * gap;
                gradient[i as usize] += basis_i.transpose() * gap;
            }
        }
        for (gradient, transform) in gradient.iter_mut().zip(transforms) {
            let affine = affine_part(transform);
            let rotation = nearest_rotation(&affine)
                .ok_or(RegistrationError::NotFinite { step: "non-rigid" })?;
            let mut rows = gradient.fixed_rows_mut::<3>(0);
            rows += (affine - rotation).transpose() * self.rotation_weight;
        }
        Ok(gradient)
    }
}

/// How D_ij depends on X_j and on X_i.
fn edge_basis(problem: &Problem<'_>, (i, j): (u32, u32)) -> [RowVector4<f64>; 2] {
    let d = problem.graph.nodes()[i as usize] - problem.graph.nodes()[j as usize];
    [
        RowVector4::new(d.x, d.y, d.z, 1.0),
        RowVector4::new(0.0, 0.0, 0.0, -1.0),
    ]
}

struct Assembly<'a> {
    system: &'a System,
    values: Vec<f64>,
    right: Vec<Matrix4x3<f64>>,
}

impl Assembly<'_> {
    fn add_alignment(&mut self, problem: &Problem<'_>, surrogate: &Surrogate) {
        for (index, weight, target) in &surrogate.alignment {
            let sample = &problem.samples[*index as usize];
            let wanted = (target.coords - sample.offset).transpose();
            for (slot, (column, column_basis)) in sample.basis.iter().enumerate() {
                let weighted = column_basis.transpose() * *weight;
                self.right[*column as usize] += weighted * wanted;
                for (row, row_basis) in &sample.basis[slot..] {
                    self.add_block(
                        *row,
                        *column,
                        &(row_basis.transpose() * weighted.transpose()),
                    );
                }
            }
        }
    }

    fn add_smoothness(&mut self, problem: &Problem<'_>, surrogate: &Surrogate) {
        for (&(a, b), weights) in problem.graph.edges().iter().zip(&surrogate.smoothness) {
            for ((i, j), weight) in [((a, b), weights[0]), ((b, a), weights[1])] {
                let [basis_j, basis_i] = edge_basis(problem, (i, j));
                // D_ij = 0 wants basis_j·X_j + basis_i·X_i to be p_i − p_j.
                let wanted = basis_j.fixed_columns::<3>(0).into_owned();
                self.right[j as usize] += basis_j.transpose() * wanted * weight;
                self.right[i as usize] += basis_i.transpose() * wanted * weight;
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

    fn add_rotation_and_damping(&mut self, rotation_weight: f64, previous: &NodeTransforms) {
        let largest = (0..self.right.len())
            .flat_map(|node| (0..4).map(move |c| (node, c)))
            .map(|(node, c)| self.values[self.diagonal(node, c)])
            .fold(rotation_weight, f64::max);
        let damping = DAMPING * largest;
        for (node, previous) in previous.iter().enumerate() {
            for c in 0..4 {
                let slot = self.diagonal(node, c);
                self.values[slot] += damping + if c < 3 { rotation_weight } else { 0.0 };
            }
            self.right[node] += previous * damping;
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
