//! The energy of Eq. 3, and the quadratic surrogate that majorizes it.
//!
//! The unknowns are a 4 x 3 matrix X_j = \[A_j | t_j\]ᵀ for every node. Everything but the
//! projection onto the rotations is then linear in them:
//!
//! - a sample: v̂ = Σ_j w_j (A_j (v − p_j) + p_j + t_j) is `basis`·X plus `offset`,
//! - a graph edge: D_ij = A_j (p_i − p_j) + p_j + t_j − (p_i + t_i).

use nalgebra::{Matrix3, Matrix4x3, RowVector3, RowVector4};

use crate::registration::{nearest_rotation, welsch, welsch_weight};
use crate::{Point, Vector};

use super::DeformationGraph;

/// X_j for every node: rows 0 to 2 hold A_jᵀ, row 3 holds t_jᵀ.
pub type NodeTransforms = Vec<Matrix4x3<f64>>;

/// The identity on every node.
pub(super) fn identity_transforms(node_count: usize) -> NodeTransforms {
    let mut identity = Matrix4x3::zeros();
    identity
        .fixed_rows_mut::<3>(0)
        .copy_from(&Matrix3::identity());
    vec![identity; node_count]
}

/// The scales of the two Welsch functions, in the mesh's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    /// ν_a, of the alignment term.
    pub alignment: f64,
    /// ν_r, of the regularization term.
    pub smoothness: f64,
}

/// The weights of the terms, with the counts of samples, edges and nodes worked in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Weights {
    /// α
    pub smoothness: f64,
    /// β
    pub rotation: f64,
}

/// How one source vertex depends on the unknowns.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// The nodes that move it, ascending, each with w_j·\[(v − p_j)ᵀ, 1\].
    pub basis: Vec<(u32, RowVector4<f64>)>,
    /// Σ_j w_j p_j.
    pub offset: Vector,
}

impl Sample {
    pub fn new(graph: &DeformationGraph, vertex: usize, position: &Point) -> Self {
        let mut offset = Vector::zeros();
        let basis = graph
            .influences(vertex)
            .iter()
            .map(|share| {
                let node = graph.nodes()[share.node as usize];
                offset += node.coords * share.weight;
                let d = position - node;
                (
                    share.node,
                    RowVector4::new(d.x, d.y, d.z, 1.0) * share.weight,
                )
            })
            .collect();
        Self { basis, offset }
    }

    /// v̂ of Eq. 2.
    pub fn deformed(&self, transforms: &NodeTransforms) -> Point {
        let linear: RowVector3<f64> = self
            .basis
            .iter()
            .map(|(node, basis)| basis * transforms[*node as usize])
            .sum();
        Point::from(linear.transpose() + self.offset)
    }
}

/// What does not change over the rounds: samples, graph and weights.
pub(super) struct Problem<'a> {
    pub graph: &'a DeformationGraph,
    pub samples: &'a [Sample],
    pub weights: Weights,
}

/// The surrogate of one round: Σ c_i ‖v̂_i − u_i‖² + Σ c_ij ‖D_ij‖² + β Σ ‖A_j − proj A_j‖²,
/// whose weights c make it majorize Eq. 3 (for fixed correspondences) up to a constant.
pub(super) struct Surrogate {
    /// For every sample with a correspondence: its index, c_i and u_i.
    pub alignment: Vec<(u32, f64, Point)>,
    /// For every graph edge and both of its directions (i to j, j to i): c_ij.
    pub smoothness: Vec<[f64; 2]>,
}

impl Problem<'_> {
    /// D_ij for the edge from node `i` to node `j`.
    pub fn edge_gap(&self, (i, j): (u32, u32), transforms: &NodeTransforms) -> Vector {
        let (pi, pj) = (
            self.graph.nodes()[i as usize],
            self.graph.nodes()[j as usize],
        );
        let (xi, xj) = (&transforms[i as usize], &transforms[j as usize]);
        let d = pi - pj;
        let moved = (RowVector4::new(d.x, d.y, d.z, 1.0) * xj).transpose();
        moved - d - xi.row(3).transpose()
    }

    /// Majorizes the energy at `transforms`.
    pub fn surrogate(
        &self,
        transforms: &NodeTransforms,
        targets: &[Option<Point>],
        scales: Scales,
    ) -> Surrogate {
        let curvature = |scale: f64| 0.5 / (scale * scale);
        let alignment = self
            .samples
            .iter()
            .zip(targets)
            .enumerate()
            .filter_map(|(index, (sample, target))| {
                let target = (*target)?;
                let residual = (sample.deformed(transforms) - target).norm();
                let weight = welsch_weight(residual, scales.alignment);
                Some((index as u32, weight * curvature(scales.alignment), target))
            })
            .collect();
        let edge_weight = |edge| {
            let gap = self.edge_gap(edge, transforms).norm();
            let weight = welsch_weight(gap, scales.smoothness);
            self.weights.smoothness * weight * curvature(scales.smoothness)
        };
        let smoothness = self
            .graph
            .edges()
            .iter()
            .map(|&(i, j)| [edge_weight((i, j)), edge_weight((j, i))]);
        Surrogate {
            alignment,
            smoothness: smoothness.collect(),
        }
    }

    /// The value of the surrogate; infinite if a transform is not finite.
    pub fn surrogate_value(&self, surrogate: &Surrogate, transforms: &NodeTransforms) -> f64 {
        let alignment: f64 = surrogate
            .alignment
            .iter()
            .map(|(index, weight, target)| {
                let deformed = self.samples[*index as usize].deformed(transforms);
                weight * (deformed - target).norm_squared()
            })
            .sum();
        let smoothness: f64 = self
            .graph
            .edges()
            .iter()
            .zip(&surrogate.smoothness)
            .map(|(&(i, j), [forward, backward])| {
                forward * self.edge_gap((i, j), transforms).norm_squared()
                    + backward * self.edge_gap((j, i), transforms).norm_squared()
            })
            .sum();
        alignment + smoothness + self.weights.rotation * rotation_term(transforms)
    }

    /// The energy of Eq. 3 for given correspondences. A sample without one counts as 1, the
    /// most that ψ reaches, so that dropping correspondences never lowers the energy.
    pub fn energy(
        &self,
        transforms: &NodeTransforms,
        targets: &[Option<Point>],
        scales: Scales,
    ) -> f64 {
        let alignment: f64 = self
            .samples
            .iter()
            .zip(targets)
            .map(|(sample, target)| {
                target.map_or(1.0, |target| {
                    welsch(
                        (sample.deformed(transforms) - target).norm(),
                        scales.alignment,
                    )
                })
            })
            .sum();
        let gap_energy = |edge| welsch(self.edge_gap(edge, transforms).norm(), scales.smoothness);
        let smoothness: f64 = self
            .graph
            .edges()
            .iter()
            .map(|&(i, j)| gap_energy((i, j)) + gap_energy((j, i)))
            .sum();
        alignment
            + self.weights.smoothness * smoothness
            + self.weights.rotation * rotation_term(transforms)
    }
}

/// A_j.
pub(super) fn affine_part(transform: &Matrix4x3<f64>) -> Matrix3<f64> {
    transform.fixed_rows::<3>(0).transpose()
}

/// Σ ‖A_j − proj A_j‖²; infinite if a transform is not finite.
fn rotation_term(transforms: &NodeTransforms) -> f64 {
    transforms
        .iter()
        .map(|transform| {
            let affine = affine_part(transform);
            nearest_rotation(&affine)
                .map_or(f64::INFINITY, |rotation| (affine - rotation).norm_squared())
        })
        .sum()
}
