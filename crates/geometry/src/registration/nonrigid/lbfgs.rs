//! Minimizes a round's surrogate by L-BFGS.
//!
//! # Source
//!
//! Nocedal and Wright, "Numerical Optimization", 2nd edition 2006, algorithm 7.4 (two-loop
//! recursion) with the Armijo condition of section 3.1; as in Fast-RNRR section 3.3 the initial
//! Hessian is that of the surrogate with its rotations fixed, factorised.

use std::collections::VecDeque;

use nalgebra::Matrix4x3;

use crate::registration::RegistrationError;

use super::direct::Minimum;
use super::energy::{Problem, Surrogate};
use super::system::{Factorised, System};
use super::{NodeTransforms, Options};

/// Pairs of steps and gradient changes that are remembered (Fast-RNRR uses 5).
const MEMORY: usize = 5;
/// Sufficient decrease (Nocedal and Wright, section 3.1).
const ARMIJO: f64 = 1e-4;
/// Halvings of the step before the search gives up.
const MAX_HALVINGS: usize = 20;

type Blocks = Vec<Matrix4x3<f64>>;

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
    let mut gradient = factorised.half_gradient(problem, surrogate, start)?;
    let mut memory = Memory::default();
    for _ in 0..options.max_inner_iterations {
        let direction = memory.direction(&factorised, &gradient)?;
        // `gradient` is half of the gradient, hence the factor.
        let slope = 2.0 * dot(&gradient, &direction);
        best.iterations += 1;
        let Some((transforms, value)) = line_search(problem, surrogate, &best, (&direction, slope))
        else {
            break;
        };
        let next_gradient = factorised.half_gradient(problem, surrogate, &transforms)?;
        memory.push(
            difference(&transforms, &best.transforms),
            difference(&next_gradient, &gradient),
        );
        let gain = best.value - value;
        (best.transforms, best.value, gradient) = (transforms, value, next_gradient);
        if gain < options.inner_tolerance * value {
            break;
        }
    }
    Ok(best)
}

fn line_search(
    problem: &Problem<'_>,
    surrogate: &Surrogate,
    from: &Minimum,
    (direction, slope): (&Blocks, f64),
) -> Option<(NodeTransforms, f64)> {
    let mut step = 1.0;
    for _ in 0..MAX_HALVINGS {
        let transforms: NodeTransforms = from
            .transforms
            .iter()
            .zip(direction)
            .map(|(x, d)| x + d * step)
            .collect();
        let value = problem.surrogate_value(surrogate, &transforms);
        if value < from.value && value <= from.value + ARMIJO * step * slope {
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
        factorised: &Factorised,
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

fn dot(a: &Blocks, b: &Blocks) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn difference(a: &Blocks, b: &Blocks) -> Blocks {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn add_scaled(sum: &mut Blocks, term: &Blocks, factor: f64) {
    sum.iter_mut()
        .zip(term)
        .for_each(|(sum, term)| *sum += term * factor);
}
