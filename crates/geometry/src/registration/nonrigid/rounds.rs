//! The rounds of non-rigid registration: correspond, majorize, minimize.

use crate::Point;
use crate::registration::rigid::MIN_CORRESPONDENCES;
use crate::registration::{RegistrationError, Target};

use super::correspondences::{Acceptance, Search};
use super::energy::{Correspondence, Problem, identity_transforms};
use super::normal_equations::NormalEquations;
use super::sampling::Sampling;
use super::system::{Factorised, System};
use super::{DeformationGraph, NodeTransforms, Options, Scales, Solver, direct, lbfgs};

/// What the rounds have come to.
pub(super) struct State {
    pub transforms: NodeTransforms,
    pub rounds: usize,
    pub inner_iterations: usize,
    pub matched: usize,
}

impl State {
    /// Before the first round: the identity.
    pub fn new(graph: &DeformationGraph) -> Self {
        Self {
            transforms: identity_transforms(graph.nodes().len()),
            rounds: 0,
            inner_iterations: 0,
            matched: 0,
        }
    }
}

/// Rounds on the same samples.
pub(super) struct Rounds<'a> {
    problem: Problem<'a>,
    system: &'a System,
    pub search: Search<'a>,
    options: &'a Options,
    pub state: State,
    /// Every sample under the state's transforms.
    deformed: Vec<Point>,
    /// The last correspondences and scales.
    last: Option<(Vec<Option<Correspondence>>, Scales)>,
}

impl<'a> Rounds<'a> {
    /// Goes on from `state` with the samples of `sampling`, which were found on `last_faces`.
    pub fn new(
        system: &'a System,
        (sampling, last_faces): (&'a Sampling<'_>, Vec<u32>),
        (target, options): (&'a Target, &'a Options),
        state: State,
    ) -> Self {
        let problem = sampling.problem(options);
        Self {
            deformed: problem.samples.all_deformed(&state.transforms),
            problem,
            system,
            search: Search {
                samples: &sampling.samples,
                normals: &sampling.normals,
                target,
                last_faces,
            },
            options,
            state,
            last: None,
        }
    }

    /// The energy for the last correspondences and scales.
    pub fn energy(&self) -> f64 {
        self.last.as_ref().map_or(0.0, |(targets, scales)| {
            let transforms = &self.state.transforms;
            self.problem.energy(transforms, targets, *scales)
        })
    }

    /// Rounds at one ν_a, until the samples come to rest.
    pub fn run_scale(
        &mut self,
        alignment: f64,
        max_rounds: usize,
    ) -> Result<(), RegistrationError> {
        let scales = Scales {
            alignment,
            smoothness: self.options.smoothness_scale_ratio * alignment,
        };
        let mut acceptance = Acceptance {
            scale: alignment,
            min_normal_cosine: self.options.max_normal_angle_degrees.to_radians().cos(),
            min_offset_cosine: self.options.max_offset_angle_degrees.to_radians().cos(),
            trust_last_faces: false,
        };
        let tolerance = self.options.motion_tolerance * self.search.target.mean_edge();
        let mut factorised = None;
        for round in 1..=max_rounds {
            let targets = self
                .search
                .find(&self.deformed, &self.state.transforms, &acceptance);
            let largest_motion = self.round(&targets, scales, &mut factorised)?;
            acceptance.trust_last_faces = true;
            if largest_motion < tolerance || round == max_rounds {
                self.last = Some((targets, scales));
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
        factorised: &mut Option<Factorised<'a>>,
    ) -> Result<f64, RegistrationError> {
        let matched = targets.iter().flatten().count();
        if matched < MIN_CORRESPONDENCES {
            return Err(RegistrationError::TooFewCorrespondences {
                found: matched,
                needed: MIN_CORRESPONDENCES,
            });
        }
        let before = &self.state.transforms;
        let surrogate = self
            .problem
            .surrogate(before, &self.deformed, targets, scales);
        // The matrix of a scale's first round still fits the later ones well.
        let factorised = match factorised {
            Some(factorised) => factorised,
            none => none.insert(self.system.factorise(&self.problem, &surrogate)?),
        };
        let equations = NormalEquations {
            problem: &self.problem,
            surrogate: &surrogate,
        };
        let minimize = match self.options.solver {
            Solver::Direct => direct::minimize,
            Solver::Lbfgs => lbfgs::minimize,
        };
        let minimum = minimize(&equations, factorised, before, self.options)?;
        let deformed = self.problem.samples.all_deformed(&minimum.transforms);
        let motions = deformed.iter().zip(&self.deformed);
        let largest_motion = motions.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
        self.deformed = deformed;
        self.state.transforms = minimum.transforms;
        self.state.rounds += 1;
        self.state.inner_iterations += minimum.iterations;
        self.state.matched = matched;
        Ok(largest_motion)
    }
}
