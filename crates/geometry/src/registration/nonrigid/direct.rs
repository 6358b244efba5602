//! Minimizes a round's surrogate by one factorisation.
//!
//! With the rotations fixed to the projections of the last iterate, the surrogate is a linear
//! least-squares problem whose matrix does not change: project, substitute back, repeat. Every
//! step lowers the surrogate, since fixing the projections majorizes the rotation term.

use crate::registration::RegistrationError;

use super::energy::{Problem, Surrogate};
use super::system::System;
use super::{NodeTransforms, Options};

/// The minimizer, its value, and how many substitutions it took.
pub(super) struct Minimum {
    pub transforms: NodeTransforms,
    pub value: f64,
    pub iterations: usize,
}

pub(super) fn minimize(
    problem: &Problem<'_>,
    system: &System,
    surrogate: &Surrogate,
    (start, options): (&NodeTransforms, &Options),
) -> Result<Minimum, RegistrationError> {
    let factorised = system.factorise(problem, surrogate, start)?;
    let value = problem.surrogate_value(surrogate, start);
    let mut best = Minimum {
        transforms: start.clone(),
        value,
        iterations: 0,
    };
    for _ in 0..options.max_inner_iterations {
        let transforms = factorised.minimizer(&best.transforms)?;
        let value = problem.surrogate_value(surrogate, &transforms);
        best.iterations += 1;
        if best.value <= value {
            break;
        }
        let gain = best.value - value;
        (best.transforms, best.value) = (transforms, value);
        if gain < options.inner_tolerance * value {
            break;
        }
    }
    Ok(best)
}
