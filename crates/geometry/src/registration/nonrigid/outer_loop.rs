//! Non-rigid registration from end to end: graph, samples, and rounds from coarse to fine.

use nalgebra::{Matrix3, Matrix4x3};

use crate::metrics::DistanceStatistics;
use crate::registration::{RegistrationError, Target};
use crate::spatial::SurfacePoint;
use crate::{Point, TriangleMesh, Vector};

use super::energy::affine_part;
use super::rounds::{Rounds, State};
use super::sampling::Sampling;
use super::system::System;
use super::{DeformationGraph, NodeTransforms, Options};

/// A deformation of the source onto the target.
#[derive(Debug, Clone)]
pub struct NonRigidRegistration {
    /// The deformed position of every source vertex.
    pub positions: Vec<Point>,
    /// The source vertices that looked for correspondences at the coarse scales, ascending.
    pub samples: Vec<Sampled>,
    /// Nodes of the deformation graph.
    pub node_count: usize,
    /// Rounds of correspondences, over all scales.
    pub rounds: usize,
    /// Iterations of the solver, over all rounds.
    pub inner_iterations: usize,
    /// The share of the samples that had a correspondence in the last round, 0 to 1.
    pub matched_share: f64,
    /// The energy of Eq. 3 at the end, for the last correspondences, scales and weights.
    pub energy: f64,
}

/// A source vertex that looked for correspondences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampled {
    /// The vertex.
    pub vertex: u32,
    /// Its distance to the target's surface before the deformation.
    pub distance: f64,
}

/// Deforms `source`, rigidly aligned already, onto `target`. Equal inputs give equal bits.
///
/// # Errors
///
/// [`RegistrationError::Empty`] for a source without faces,
/// [`RegistrationError::TooFewCorrespondences`] where next to nothing of the source finds a
/// counterpart, [`RegistrationError::Factorisation`] and [`RegistrationError::NotFinite`] if a
/// solve fails.
pub fn register(
    source: &TriangleMesh,
    target: &Target,
    options: &Options,
) -> Result<NonRigidRegistration, RegistrationError> {
    if source.face_count() == 0 {
        return Err(RegistrationError::Empty { which: "source" });
    }
    let graph = DeformationGraph::new(source, &options.graph);
    let system = System::new(&graph);
    let normals = source.vertex_normals();
    let coarse = Sampling::new(source, normals, &graph, options.coarse_samples);
    let initial: Vec<SurfacePoint> = coarse
        .vertices
        .iter()
        .map(|&v| target.surface().closest(&source.positions()[v]))
        .collect();
    let (coarse_scales, last_scale) = alignment_scales(&initial, target, options);
    let rounds_on = |sampling, last_faces, state| {
        Rounds::new(&system, (sampling, last_faces), (target, options), state)
    };
    let faces = initial.iter().map(|surface| surface.face).collect();
    let mut rounds = rounds_on(&coarse, faces, State::new(&graph));
    for scale in coarse_scales {
        rounds.run_scale(scale, options.rounds_per_scale)?;
    }
    let fine = Sampling::new(source, normals, &graph, options.samples);
    let faces = coarse.guesses_for(&fine, &rounds.search.last_faces);
    let mut rounds = rounds_on(&fine, faces, rounds.state);
    rounds.run_scale(last_scale, options.final_rounds)?;
    let energy = rounds.energy();
    let State {
        transforms,
        rounds,
        inner_iterations,
        matched,
    } = rounds.state;
    let positions = deformed_positions(source, &graph, &transforms);
    if !positions.iter().all(|p| p.iter().all(|c| c.is_finite())) {
        return Err(RegistrationError::NotFinite { step: "non-rigid" });
    }
    let samples = coarse.vertices.iter().zip(&initial);
    Ok(NonRigidRegistration {
        positions,
        samples: samples
            .map(|(&vertex, surface)| Sampled {
                vertex: vertex as u32,
                distance: surface.distance,
            })
            .collect(),
        node_count: graph.nodes().len(),
        rounds,
        inner_iterations,
        matched_share: matched as f64 / fine.samples.len() as f64,
        energy,
    })
}

/// Every vertex under Eq. 2; vertices that no node moves stay.
fn deformed_positions(
    source: &TriangleMesh,
    graph: &DeformationGraph,
    transforms: &NodeTransforms,
) -> Vec<Point> {
    let nodes: Vec<NodeMotion> = graph
        .nodes()
        .iter()
        .zip(transforms)
        .map(node_motion)
        .collect();
    let positions = source.positions().iter().enumerate();
    positions
        .map(|(vertex, position)| {
            let influences = graph.influences(vertex);
            if influences.is_empty() {
                return *position;
            }
            let moved = influences.iter().map(|share| {
                let (affine, shift) = &nodes[share.node as usize];
                (affine * position.coords + shift) * share.weight
            });
            Point::from(moved.sum::<Vector>())
        })
        .collect()
}

/// A_j, and p_j + t_j − A_j p_j: a node moves v to A_j v plus that.
type NodeMotion = (Matrix3<f64>, Vector);

fn node_motion((node, transform): (&Point, &Matrix4x3<f64>)) -> NodeMotion {
    let affine = affine_part(transform);
    let shift = transform.row(3).transpose();
    (affine, node.coords + shift - affine * node.coords)
}

/// Below it the scales would be many, or without end.
const MIN_SCALE_STEP: f64 = 1.1;

/// ν_a in the mesh's unit: from the initial distances down, step by step; and the last.
fn alignment_scales(
    initial: &[SurfacePoint],
    target: &Target,
    options: &Options,
) -> (Vec<f64>, f64) {
    let distances: Vec<f64> = initial.iter().map(|surface| surface.distance).collect();
    let last = options.alignment_scale * target.mean_edge();
    let mut scale = DistanceStatistics::quantile(&distances, options.initial_scale_quantile);
    let mut scales = Vec::new();
    while last < scale {
        scales.push(scale);
        scale /= options.scale_step.max(MIN_SCALE_STEP);
    }
    (scales, last)
}
