//! Minimizes a round's surrogate by L-BFGS.
//!
//! # Source
//!
//! Nocedal and Wright, "Numerical Optimization", 2nd edition 2006, algorithm 7.4 (two-loop
//! recursion) with the Armijo condition of section 3.1; as in Fast-RNRR section 3.3 the initial
//! Hessian is that of the surrogate with its rotations fixed, factorised.

use std::collections::VecDeque;

use crate::registration::RegistrationError;

use super::Options;
use super::direct::{Minimum, add_scaled, dot};
use super::normal_equations::{Blocks, NormalEquations};
use super::system::Factorised;

/// Pairs of steps and gradient changes that are remembered (Fast-RNRR uses 5).
const MEMORY: usize = 5;
/// Sufficient decrease (Nocedal and Wright, section 3.1).
const ARMIJO: f64 = 1e-4;
/// Halvings of the step before the search gives up.
const MAX_HALVINGS: usize = 20;

/// Lowers the surrogate from `start`.
pub(super) fn minimize(
    equations: &NormalEquations<'_>,
    factorised: &Factorised<'_>,
    start: &Blocks,
    options: &Options,
) -> Result<Minimum, RegistrationError> {
    let mut best = Minimum {
        transforms: start.clone(),
        iterations: 0,
    };
    let mut best_value = value_of(equations, start);
    let mut gradient = equations.half_gradient(start)?;
    let mut memory = Memory::default();
    let mut gained = 0.0;
    for _ in 0..options.max_inner_iterations {
        let direction = memory.direction(factorised, &gradient)?;
        // `gradient` is half of the gradient, hence the factor.
        let slope = 2.0 * dot(&gradient, &direction);
        best.iterations += 1;
        let Some((transforms, value)) = line_search(
            equations,
            (&best.transforms, best_value),
            (&direction, slope),
        ) else {
            break;
        };
        let next_gradient = equations.half_gradient(&transforms)?;
        memory.push(
            difference(&transforms, &best.transforms),
            difference(&next_gradient, &gradient),
        );
        let gain = best_value - value;
        (best.transforms, best_value, gradient) = (transforms, value, next_gradient);
        if gain <= options.inner_tolerance * gained {
            break;
        }
        gained += gain;
    }
    Ok(best)
}

fn value_of(equations: &NormalEquations<'_>, transforms: &Blocks) -> f64 {
    equations
        .problem
        .surrogate_value(equations.surrogate, transforms)
}

fn line_search(
    equations: &NormalEquations<'_>,
    (from, value_there): (&Blocks, f64),
    (direction, slope): (&Blocks, f64),
) -> Option<(Blocks, f64)> {
    let mut step = 1.0;
    for _ in 0..MAX_HALVINGS {
        let mut transforms = from.clone();
        add_scaled(&mut transforms, direction, step);
        let value = value_of(equations, &transforms);
        if value < value_there && value <= value_there + ARMIJO * step * slope {
            return Some((transforms, value));
        }
        step /= 2.0;
    }
    None
}

#[derive(Default)]
struct Memory {
    pairs: VecDeque<(Blocks, Blocks, f64)>,
}

impl Memory {
    /// Remembers a step `s` and the change of the gradient `y` along it, if their product keeps
    /// the approximation positive definite.
    fn push(&mut self, s: Blocks, y: Blocks) {
        let curvature = dot(&s, &y);
        if 0.0 < curvature {
            if self.pairs.len() == MEMORY {
                self.pairs.pop_front();
            }
            self.pairs.push_back((s, y, curvature));
        }
    }

    /// Minus the approximate inverse Hessian times the gradient.
    fn direction(
        &self,
        factorised: &Factorised<'_>,
        gradient: &Blocks,
    ) -> Result<Blocks, RegistrationError> {
        let mut q = gradient.clone();
        let mut coefficients = Vec::with_capacity(self.pairs.len());
        for (s, y, curvature) in self.pairs.iter().rev() {
            let a = dot(s, &q) / curvature;
            add_scaled(&mut q, y, -a);
            coefficients.push(a);
        }
        let mut r = factorised.solve(&q)?;
        for ((s, y, curvature), a) in self.pairs.iter().zip(coefficients.iter().rev()) {
            let b = dot(y, &r) / curvature;
            add_scaled(&mut r, s, a - b);
        }
        r.iter_mut().for_each(|block| *block = -*block);
        Ok(r)
    }
}

fn difference(a: &Blocks, b: &Blocks) -> Blocks {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
