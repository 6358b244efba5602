//! How the deformation is found.

use super::GraphOptions;

/// How the surrogate of each round is minimized. Both minimize the same function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Solver {
    /// One sparse Cholesky factorisation a scale; conjugate gradients on it.
    #[default]
    Direct,
    /// L-BFGS, as the paper names it, with the factorised matrix as its initial Hessian.
    Lbfgs,
}

/// How stiff the deformation is, how it is solved, and when to stop.
///
/// Lengths are in mean edges of the target, so that the unit does not matter. The defaults are
/// tuned on consecutive frames of human captures (15,000 to 26,000 vertices).
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Where the nodes go and how far they reach.
    pub graph: GraphOptions,
    /// How the surrogate is minimized.
    pub solver: Solver,
    /// Source vertices that look for correspondences at the last scale, evenly strided.
    pub samples: usize,
    /// The same at the coarser scales.
    pub coarse_samples: usize,
    /// Weight α of the regularization term, per graph edge relative to a sample.
    pub smoothness_weight: f64,
    /// Weight β of the rotation term, per node relative to a sample.
    pub rotation_weight: f64,
    /// Scale ν_a of the alignment's Welsch function in the last rounds, in mean edges.
    pub alignment_scale: f64,
    /// The first ν_a is this quantile of the initial distances: high, so that a limb that
    /// moves on a still body is not taken for an outlier.
    pub initial_scale_quantile: f64,
    /// ν_a is divided by this from one scale to the next.
    pub scale_step: f64,
    /// ν_r over ν_a: the scale of the regularization's Welsch function.
    pub smoothness_scale_ratio: f64,
    /// The largest angle between the normals of a correspondence, in degrees.
    pub max_normal_angle_degrees: f64,
    /// The largest angle between a sample's normal and the way to its counterpart, in degrees.
    pub max_offset_angle_degrees: f64,
    /// Rounds of correspondences at each scale but the last, at the most.
    pub rounds_per_scale: usize,
    /// Rounds of correspondences at the last scale, at the most.
    pub final_rounds: usize,
    /// Inner iterations a round, at the most.
    pub max_inner_iterations: usize,
    /// A round's inner iterations end once one of them gains a smaller share than all before.
    pub inner_tolerance: f64,
    /// A scale ends once no sample moved further than this in a round, in mean edges.
    pub motion_tolerance: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            graph: GraphOptions::default(),
            solver: Solver::Direct,
            samples: 4000,
            coarse_samples: 1500,
            smoothness_weight: 0.1,
            rotation_weight: 0.1,
            alignment_scale: 0.5,
            initial_scale_quantile: 0.999,
            scale_step: 2.5,
            smoothness_scale_ratio: 1.0,
            max_normal_angle_degrees: 80.0,
            max_offset_angle_degrees: 70.0,
            rounds_per_scale: 2,
            final_rounds: 2,
            max_inner_iterations: 1,
            inner_tolerance: 1e-4,
            motion_tolerance: 0.02,
        }
    }
}
