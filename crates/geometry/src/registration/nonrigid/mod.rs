//! Non-rigid registration: a deformation graph carried onto a target (Eq. 2, 3 and 8 of the
//! Tracked QEM paper).
//!
//! - [`DeformationGraph`]: nodes on the source and how they move its vertices (Eq. 2).
//! - [`energy`]: the three terms of Eq. 3 and the quadratic surrogate that majorizes them.
//! - [`system`]: the surrogate's normal matrix, its sparsity analysed once; [`block_cholesky`]
//!   factorises it.
//! - [`scaled_equations`]: that matrix itself, as it is applied to a step.
//! - [`direct`] and [`lbfgs`]: two ways to minimize the surrogate.
//! - [`register`]: correspondences, weights and minimization in turn, from a coarse scale of
//!   the Welsch function to a fine one.
//!
//! # Source
//!
//! Yao, Deng, Xu and Zhang, "Quasi-Newton Solver for Robust Non-Rigid Registration" (Fast-RNRR),
//! CVPR 2020, <https://doi.org/10.1109/CVPR42600.2020.00762>; embedded deformation from Sumner,
//! Schmid and Pauly, "Embedded Deformation for Shape Manipulation", ACM TOG 26(3), 2007,
//! <https://doi.org/10.1145/1276377.1276478>.

mod block_cholesky;
mod correspondences;
mod deformation_graph;
mod direct;
mod energy;
mod lbfgs;
mod normal_equations;
mod options;
mod outer_loop;
mod rounds;
mod sampling;
mod scaled_equations;
mod system;

pub use deformation_graph::{DeformationGraph, GraphOptions, Influence};
pub use energy::{NodeTransforms, Scales};
pub use options::{Options, Solver};
pub use outer_loop::{NonRigidRegistration, Sampled, register};

#[cfg(test)]
mod tests;
