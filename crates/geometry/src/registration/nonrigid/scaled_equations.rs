//! The normal equations' matrix on scaled unknowns in `f32`: what conjugate gradients apply.
//!
//! Scaled so that the factorised stand-in has ones on its diagonal, the matrix does not depend on
//! the unit of length, and its entries are about one. Only steps are computed in it; what they
//! start from is in `f64`.

use nalgebra::{RowVector4, Vector4};
use wide::f32x4;

use crate::Vector;

use super::energy::SLIDING_WEIGHT;
use super::normal_equations::NormalEquations;

/// A node's unknowns: for each of the four rows its x, y, z and a 0.
pub(super) type Rows4 = [f32x4; 4];

/// The matrix H between two scalings.
pub(super) struct ScaledEquations {
    pulls: Vec<ScaledPull>,
    /// The nodes of the pulls' samples, with their bases times the scales and the root of the weight.
    basis: Vec<(u32, f32x4)>,
    gaps: Vec<Gap>,
    /// Of the rotation term, for every node.
    rotation: Vec<f32x4>,
}

struct ScaledPull {
    /// Where the sample's part of `basis` ends.
    end: u32,
    normal: f32x4,
}

/// How D_ij depends on both nodes: on all rows of j, and on the last row of i.
struct Gap {
    i: u32,
    j: u32,
    on_i: f32,
    on_j: f32x4,
}

impl ScaledEquations {
    /// `scales` are those of the factorised stand-in.
    pub fn new(equations: &NormalEquations<'_>, scales: &[Vector4<f64>]) -> Self {
        let (problem, surrogate) = (equations.problem, equations.surrogate);
        let on = |node: u32, basis: &RowVector4<f64>, root: f64| {
            let scale = &scales[node as usize];
            f32x4::from(std::array::from_fn(|r| (basis[r] * scale[r] * root) as f32))
        };
        let mut basis = Vec::with_capacity(8 * surrogate.alignment.len());
        let mut pulls = Vec::with_capacity(surrogate.alignment.len());
        for pull in &surrogate.alignment {
            let root = pull.weight.sqrt();
            let nodes = problem.samples.basis(pull.sample as usize).iter();
            basis.extend(nodes.map(|(node, basis)| (*node, on(*node, basis, root))));
            pulls.push(ScaledPull {
                end: basis.len() as u32,
                normal: lanes(&pull.to.normal),
            });
        }
        let mut gaps = Vec::with_capacity(2 * surrogate.smoothness.len());
        for (&(a, b), weights) in problem.graph.edges().iter().zip(&surrogate.smoothness) {
            for ((i, j), weight) in [((a, b), weights[0]), ((b, a), weights[1])] {
                let [basis_j, basis_i] = problem.edge_basis((i, j));
                gaps.push(Gap {
                    i,
                    j,
                    on_i: on(i, &basis_i, weight.sqrt()).to_array()[3],
                    on_j: on(j, &basis_j, weight.sqrt()),
                });
            }
        }
        let rotation = |scale: &Vector4<f64>| {
            let weight = |r: usize| (problem.weights.rotation * scale[r] * scale[r]) as f32;
            f32x4::from([weight(0), weight(1), weight(2), 0.0])
        };
        Self {
            pulls,
            basis,
            gaps,
            rotation: scales.iter().map(rotation).collect(),
        }
    }

    /// H times `step`.
    pub fn apply(&self, step: &[Rows4], product: &mut [Rows4]) {
        let nodes = product.iter_mut().zip(step).zip(&self.rotation);
        for ((product, step), weights) in nodes {
            let weights = weights.to_array();
            *product = std::array::from_fn(|r| step[r] * weights[r]);
        }
        let (sliding, rest) = (SLIDING_WEIGHT as f32, (1.0 - SLIDING_WEIGHT) as f32);
        let mut start = 0;
        for pull in &self.pulls {
            let basis = &self.basis[start..pull.end as usize];
            start = pull.end as usize;
            let mut moved = f32x4::ZERO;
            for (node, basis) in basis {
                moved += times(*basis, &step[*node as usize]);
            }
            let [x, y, z, _] = (moved * pull.normal).to_array();
            let force = moved * sliding + pull.normal * (rest * ((x + y) + z));
            for (node, basis) in basis {
                add_outer(&mut product[*node as usize], *basis, force);
            }
        }
        for gap in &self.gaps {
            let (i, j) = (gap.i as usize, gap.j as usize);
            let force = times(gap.on_j, &step[j]) + step[i][3] * gap.on_i;
            add_outer(&mut product[j], gap.on_j, force);
            product[i][3] += force * gap.on_i;
        }
    }
}

fn lanes(vector: &Vector) -> f32x4 {
    let [x, y, z] = vector.map(|c| c as f32).into();
    f32x4::from([x, y, z, 0.0])
}

/// `basis`·X.
#[inline]
fn times(basis: f32x4, x: &Rows4) -> f32x4 {
    let b = basis.to_array();
    (x[0] * b[0] + x[1] * b[1]) + (x[2] * b[2] + x[3] * b[3])
}

/// Adds `basis`ᵀ·`force`ᵀ.
#[inline]
fn add_outer(sum: &mut Rows4, basis: f32x4, force: f32x4) {
    let b = basis.to_array();
    for (sum, b) in sum.iter_mut().zip(b) {
        *sum += force * b;
    }
}

/// The sum of all products of entries.
pub(super) fn dot(a: &[Rows4], b: &[Rows4]) -> f64 {
    let sum_of = |(a, b): (&Rows4, &Rows4)| {
        let sum = (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
        f64::from(sum.reduce_add())
    };
    a.iter().zip(b).map(sum_of).sum()
}

/// Adds `factor` times `term`.
pub(super) fn add_scaled(sum: &mut [Rows4], term: &[Rows4], factor: f64) {
    let factor = f32x4::splat(factor as f32);
    for (sum, term) in sum.iter_mut().zip(term) {
        sum.iter_mut()
            .zip(term)
            .for_each(|(sum, term)| *sum += *term * factor);
    }
}
