//! The energy of Eq. 3, and the quadratic surrogate that majorizes it.
//!
//! The unknowns are a 4 x 3 matrix X_j = \[A_j | t_j\]ᵀ for every node. Everything but the
//! projection onto the rotations is then linear in them:
//!
//! - a sample: v̂ = Σ_j w_j (A_j (v − p_j) + p_j + t_j) is `basis`·X plus `offset`,
//! - a graph edge: D_ij = A_j (p_i − p_j) + p_j + t_j − (p_i + t_i).

use nalgebra::{Matrix3, Matrix4x3, RowVector4};

use crate::registration::{nearest_rotation, welsch, welsch_weight};
use crate::{Point, TriangleMesh, Vector};

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

/// How source vertices depend on the unknowns.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    /// Where each sample's part of `basis` ends.
    ends: Vec<u32>,
    /// The nodes that move a sample, ascending, each with w_j·\[(v − p_j)ᵀ, 1\].
    basis: Vec<(u32, RowVector4<f64>)>,
    /// Σ_j w_j p_j.
    offsets: Vec<Vector>,
}

impl Samples {
    /// The given vertices as samples, at their positions in `mesh`.
    pub fn new(
        graph: &DeformationGraph,
        mesh: &TriangleMesh,
        vertices: impl Iterator<Item = usize>,
    ) -> Self {
        let mut samples = Self::default();
        for vertex in vertices {
            let position = mesh.positions()[vertex];
            let mut offset = Vector::zeros();
            for share in graph.influences(vertex) {
                let node = graph.nodes()[share.node as usize];
                offset += node.coords * share.weight;
                let d = position - node;
                let basis = RowVector4::new(d.x, d.y, d.z, 1.0) * share.weight;
                samples.basis.push((share.node, basis));
            }
            samples.ends.push(samples.basis.len() as u32);
            samples.offsets.push(offset);
        }
        samples
    }

    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// The nodes that move a sample, each with w_j·\[(v − p_j)ᵀ, 1\].
    #[inline]
    pub fn basis(&self, sample: usize) -> &[(u32, RowVector4<f64>)] {
        let start = if sample == 0 {
            0
        } else {
            self.ends[sample - 1]
        };
        &self.basis[start as usize..self.ends[sample] as usize]
    }

    /// The part of v̂ that is linear in the unknowns.
    #[inline]
    pub fn linear(&self, sample: usize, transforms: &[Matrix4x3<f64>]) -> Vector {
        let mut sum = Vector::zeros();
        for (node, basis) in self.basis(sample) {
            sum += row_times(basis, &transforms[*node as usize]);
        }
        sum
    }

    /// v̂ of Eq. 2.
    #[inline]
    pub fn deformed(&self, sample: usize, transforms: &[Matrix4x3<f64>]) -> Point {
        Point::from(self.linear(sample, transforms) + self.offsets[sample])
    }

    /// v̂ of every sample.
    pub fn all_deformed(&self, transforms: &[Matrix4x3<f64>]) -> Vec<Point> {
        (0..self.len())
            .map(|sample| self.deformed(sample, transforms))
            .collect()
    }
}

/// `basis`·X, written out: what most of the time goes into.
#[inline]
pub(super) fn row_times(basis: &RowVector4<f64>, x: &Matrix4x3<f64>) -> Vector {
    let entry = |c: usize| {
        (basis[0] * x[(0, c)] + basis[1] * x[(1, c)])
            + (basis[2] * x[(2, c)] + basis[3] * x[(3, c)])
    };
    Vector::new(entry(0), entry(1), entry(2))
}

/// Adds `basis`ᵀ·`force`ᵀ.
#[inline]
pub(super) fn add_outer(sum: &mut Matrix4x3<f64>, basis: &RowVector4<f64>, force: &Vector) {
    for c in 0..3 {
        for r in 0..4 {
            sum[(r, c)] += basis[r] * force[c];
        }
    }
}

/// Where a sample wants to go: a point of the target's surface, and the direction in which
/// leaving it counts in full.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Correspondence {
    pub position: Point,
    /// Of unit length.
    pub normal: Vector,
}

/// What a step along the surface counts relative to one away from it. Not 0, so that a flat
/// sheet does not swim.
pub(super) const SLIDING_WEIGHT: f64 = 0.01;

impl Correspondence {
    /// W·(v − u) with W = μ I + (1 − μ) n nᵀ.
    #[inline]
    pub fn pull(&self, gap: &Vector) -> Vector {
        gap * SLIDING_WEIGHT + self.normal * ((1.0 - SLIDING_WEIGHT) * self.normal.dot(gap))
    }

    /// (v − u)ᵀ W (v − u).
    #[inline]
    pub fn square(&self, gap: &Vector) -> f64 {
        gap.dot(&self.pull(gap))
    }
}

/// The mean of W's eigenvalues: what stands for W where x, y and z are to be one system.
pub(super) const MEAN_WEIGHT: f64 = (1.0 + 2.0 * SLIDING_WEIGHT) / 3.0;

/// A sample's term in the surrogate: c_i, the sample and where it wants to go.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pull {
    pub sample: u32,
    pub weight: f64,
    pub to: Correspondence,
}

/// What does not change over the rounds: samples, graph and weights.
pub(super) struct Problem<'a> {
    pub graph: &'a DeformationGraph,
    pub samples: &'a Samples,
    pub weights: Weights,
}

/// The surrogate of one round: Σ c_i (v̂_i − u_i)ᵀ W_i (v̂_i − u_i) +
/// Σ c_ij ‖D_ij‖² + β Σ ‖A_j − proj A_j‖², whose weights c make it majorize Eq. 3 (for fixed correspondences,
/// and with W's norm in place of the plain one) up to a constant.
pub(super) struct Surrogate {
    /// The samples that have a correspondence.
    pub alignment: Vec<Pull>,
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
        self.edge_gap_change((i, j), transforms) - (pi - pj)
    }

    /// The part of D_ij that is linear in the unknowns.
    pub fn edge_gap_change(&self, (i, j): (u32, u32), step: &[Matrix4x3<f64>]) -> Vector {
        let [basis_j, _] = self.edge_basis((i, j));
        let x = &step[i as usize];
        row_times(&basis_j, &step[j as usize]) - Vector::new(x[(3, 0)], x[(3, 1)], x[(3, 2)])
    }

    /// How D_ij depends on X_j and on X_i.
    pub fn edge_basis(&self, (i, j): (u32, u32)) -> [RowVector4<f64>; 2] {
        let d = self.graph.nodes()[i as usize] - self.graph.nodes()[j as usize];
        [
            RowVector4::new(d.x, d.y, d.z, 1.0),
            RowVector4::new(0.0, 0.0, 0.0, -1.0),
        ]
    }

    /// Majorizes the energy at `transforms`, under which the samples are `deformed`.
    pub fn surrogate(
        &self,
        transforms: &NodeTransforms,
        deformed: &[Point],
        targets: &[Option<Correspondence>],
        scales: Scales,
    ) -> Surrogate {
        let curvature = |scale: f64| 0.5 / (scale * scale);
        let alignment = targets
            .iter()
            .zip(deformed)
            .enumerate()
            .filter_map(|(index, (target, deformed))| {
                let to = (*target)?;
                let gap = deformed - to.position;
                let weight = welsch_weight(to.square(&gap).sqrt(), scales.alignment);
                Some(Pull {
                    sample: index as u32,
                    weight: weight * curvature(scales.alignment),
                    to,
                })
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
            .map(|pull| {
                let deformed = self.samples.deformed(pull.sample as usize, transforms);
                pull.weight * pull.to.square(&(deformed - pull.to.position))
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
        targets: &[Option<Correspondence>],
        scales: Scales,
    ) -> f64 {
        let alignment: f64 = targets
            .iter()
            .enumerate()
            .map(|(index, target)| {
                target.map_or(1.0, |to| {
                    let gap = self.samples.deformed(index, transforms) - to.position;
                    welsch(to.square(&gap).sqrt(), scales.alignment)
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
