//! The rounds of non-rigid registration: correspond, majorize, minimize.

use crate::mesh::vertex_normals;
use crate::metrics::DistanceStatistics;
use crate::registration::rigid::MIN_CORRESPONDENCES;
use crate::registration::{RegistrationError, Target};
use crate::spatial::SurfacePoint;
use crate::{Point, TriangleMesh, Vector};

use super::correspondences::{Acceptance, Search};
use super::direct::Minimum;
use super::energy::{Correspondence, Problem, Samples, Weights, identity_transforms};
use super::normal_equations::NormalEquations;
use super::system::System;
use super::{DeformationGraph, NodeTransforms, Options, Scales, Solver, direct, lbfgs};

/// A deformation of the source onto the target.
#[derive(Debug, Clone)]
pub struct NonRigidRegistration {
    /// The deformed position of every source vertex.
    pub positions: Vec<Point>,
    /// The source vertices that looked for correspondences, ascending.
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
    let sampling = Sampling::new(source, &graph, options.samples);
    let problem = Problem {
        graph: &graph,
        samples: &sampling.samples,
        weights: weights(&graph, sampling.samples.len(), options),
    };
    let system = System::new(&problem)?;
    let transforms = identity_transforms(graph.nodes().len());
    let initial: Vec<SurfacePoint> = sampling
        .vertices
        .iter()
        .map(|&v| target.surface().closest(&source.positions()[v]))
        .collect();
    let mut rounds = Rounds {
        problem: &problem,
        system: &system,
        search: Search {
            samples: &sampling.samples,
            normals: &sampling.normals,
            target,
            last_faces: initial.iter().map(|surface| surface.face).collect(),
        },
        options,
        state: State {
            transforms,
            rounds: 0,
            inner_iterations: 0,
            matched: 0,
            energy: 0.0,
        },
    };
    let (coarse, last) = alignment_scales(&initial, target, options);
    for scale in coarse {
        rounds.run_scale(scale, options.rounds_per_scale)?;
    }
    rounds.run_scale(last, options.final_rounds)?;
    let State {
        transforms,
        rounds,
        inner_iterations,
        matched,
        energy,
    } = rounds.state;
    let positions = deformed_positions(source, &graph, &transforms);
    if !positions.iter().all(|p| p.iter().all(|c| c.is_finite())) {
        return Err(RegistrationError::NotFinite { step: "non-rigid" });
    }
    let samples = sampling.vertices.iter().zip(&initial);
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
        matched_share: matched as f64 / sampling.samples.len() as f64,
        energy,
    })
}

/// Every vertex under Eq. 2; vertices that no node moves stay.
fn deformed_positions(
    source: &TriangleMesh,
    graph: &DeformationGraph,
    transforms: &NodeTransforms,
) -> Vec<Point> {
    let all = Samples::new(graph, source, 0..source.vertex_count());
    let positions = source.positions().iter().enumerate();
    positions
        .map(|(vertex, position)| {
            if graph.influences(vertex).is_empty() {
                return *position;
            }
            all.deformed(vertex, transforms)
        })
        .collect()
}

/// α and β per term, so that neither the number of samples nor that of nodes shifts the balance.
fn weights(graph: &DeformationGraph, sample_count: usize, options: &Options) -> Weights {
    let per = |count: usize| sample_count as f64 / count.max(1) as f64;
    Weights {
        smoothness: options.smoothness_weight * per(2 * graph.edges().len()),
        rotation: options.rotation_weight * per(graph.nodes().len()),
    }
}

/// ν_a in the mesh's unit: from the initial distances down, halved each time; and the last.
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
        scale /= 2.0;
    }
    (scales, last)
}

/// The source vertices that look for correspondences.
struct Sampling {
    vertices: Vec<usize>,
    samples: Samples,
    normals: Vec<Vector>,
}

impl Sampling {
    fn new(source: &TriangleMesh, graph: &DeformationGraph, count: usize) -> Self {
        let stride = (source.vertex_count() / count.max(1)).max(1);
        let vertices: Vec<usize> = (0..source.vertex_count()).step_by(stride).collect();
        let all_normals = vertex_normals(source);
        Self {
            samples: Samples::new(graph, source, vertices.iter().copied()),
            normals: vertices.iter().map(|&v| all_normals[v]).collect(),
            vertices,
        }
    }
}

struct State {
    transforms: NodeTransforms,
    rounds: usize,
    inner_iterations: usize,
    matched: usize,
    energy: f64,
}

struct Rounds<'a> {
    problem: &'a Problem<'a>,
    system: &'a System,
    search: Search<'a>,
    options: &'a Options,
    state: State,
}

impl Rounds<'_> {
    /// Rounds at one ν_a, until the samples come to rest.
    fn run_scale(&mut self, alignment: f64, max_rounds: usize) -> Result<(), RegistrationError> {
        let smoothness = self.options.smoothness_scale_ratio * alignment;
        let scales = Scales {
            alignment,
            smoothness,
        };
        let mut acceptance = Acceptance {
            scale: alignment,
            min_normal_cosine: self.options.max_normal_angle_degrees.to_radians().cos(),
            trust_last_faces: false,
        };
        for _ in 0..max_rounds {
            let targets = self.search.find(&self.state.transforms, &acceptance);
            let largest_motion = self.round(&targets, scales)?;
            acceptance.trust_last_faces = true;
            if largest_motion < self.options.motion_tolerance * self.search.target.mean_edge() {
                break;
            }
        }
        Ok(())
    }

    /// One round; returns how far the sample that moved most moved.
    fn round(
        &mut self,
        targets: &[Option<Correspondence>],
        scales: Scales,
    ) -> Result<f64, RegistrationError> {
        let matched = targets.iter().flatten().count();
        if matched < MIN_CORRESPONDENCES {
            return Err(RegistrationError::TooFewCorrespondences { found: matched });
        }
        let before = &self.state.transforms;
        let surrogate = self.problem.surrogate(before, targets, scales);
        let factorised = self.system.factorise(self.problem, &surrogate)?;
        let equations = NormalEquations {
            problem: self.problem,
            surrogate: &surrogate,
        };
        let start = Minimum {
            transforms: before.clone(),
            value: self.problem.surrogate_value(&surrogate, before),
            iterations: 0,
        };
        let minimize = match self.options.solver {
            Solver::Direct => direct::minimize,
            Solver::Lbfgs => lbfgs::minimize,
        };
        let minimum = minimize(&equations, &factorised, start, self.options)?;
        let samples = self.problem.samples;
        let largest_motion = (0..samples.len())
            .map(|s| {
                (samples.deformed(s, &minimum.transforms) - samples.deformed(s, before)).norm()
            })
            .fold(0.0, f64::max);
        self.state.energy = self.problem.energy(&minimum.transforms, targets, scales);
        self.state.transforms = minimum.transforms;
        self.state.rounds += 1;
        self.state.inner_iterations += minimum.iterations;
        self.state.matched = matched;
        Ok(largest_motion)
    }
}
