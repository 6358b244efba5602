//! The surrogate's normal equations with the rotations fixed, without being assembled.

use nalgebra::{Matrix3, Matrix4x3};

use crate::Vector;
use crate::registration::{RegistrationError, nearest_rotation};

use super::NodeTransforms;
use super::energy::{Problem, Surrogate, add_outer, affine_part};

/// A 4 x 3 block a node, like the unknowns.
pub(super) type Blocks = Vec<Matrix4x3<f64>>;

/// H·X = right-hand side. Correspondences that weigh leaving the surface more than sliding along
/// it couple x, y and z: assembled, H would have three times the rows.
pub(super) struct NormalEquations<'a> {
    pub problem: &'a Problem<'a>,
    pub surrogate: &'a Surrogate,
}

impl NormalEquations<'_> {
    /// Half the gradient of the surrogate at `transforms`: H·X minus the right-hand side, with
    /// the rotations that are closest to `transforms`.
    pub fn half_gradient(&self, transforms: &NodeTransforms) -> Result<Blocks, RegistrationError> {
        let mut gradient = vec![Matrix4x3::zeros(); transforms.len()];
        let samples = self.problem.samples;
        for pull in &self.surrogate.alignment {
            let sample = pull.sample as usize;
            let gap = samples.deformed(sample, transforms) - pull.to.position;
            let force = pull.to.pull(&gap) * pull.weight;
            for (node, basis) in samples.basis(sample) {
                add_outer(&mut gradient[*node as usize], basis, &force);
            }
        }
        self.add_smoothness(&mut gradient, |edge| {
            self.problem.edge_gap(edge, transforms)
        });
        let weight = self.problem.weights.rotation;
        for (gradient, transform) in gradient.iter_mut().zip(transforms) {
            let affine = affine_part(transform);
            let rotation = nearest_rotation(&affine)
                .ok_or(RegistrationError::NotFinite { step: "non-rigid" })?;
            add_affine(gradient, &(affine - rotation), weight);
        }
        Ok(gradient)
    }

    fn add_smoothness(&self, sum: &mut Blocks, gap_of: impl Fn((u32, u32)) -> Vector) {
        let edges = self.problem.graph.edges().iter();
        for (&(a, b), weights) in edges.zip(&self.surrogate.smoothness) {
            for ((i, j), weight) in [((a, b), weights[0]), ((b, a), weights[1])] {
                let force = gap_of((i, j)) * weight;
                let [basis_j, _] = self.problem.edge_basis((i, j));
                add_outer(&mut sum[j as usize], &basis_j, &force);
                let sum = &mut sum[i as usize];
                (0..3).for_each(|c| sum[(3, c)] -= force[c]);
            }
        }
    }
}

fn add_affine(block: &mut Matrix4x3<f64>, affine: &Matrix3<f64>, weight: f64) {
    let mut rows = block.fixed_rows_mut::<3>(0);
    rows += affine.transpose() * weight;
}
