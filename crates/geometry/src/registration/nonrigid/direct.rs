//! Minimizes a round's surrogate by conjugate gradients on a factorised matrix.
//!
//! With the rotations fixed to the projections of the last iterate, the surrogate is a linear
//! least-squares problem whose matrix does not change: project, solve, repeat. Every step lowers
//! the surrogate, since fixing the projections majorizes the rotation term. The factorised matrix
//! weighs all directions of a correspondence alike; conjugate gradients on top of it make up for
//! that in a few steps.
//!
//! # Source
//!
//! Preconditioned conjugate gradients: Nocedal and Wright, "Numerical Optimization", 2nd edition
//! 2006, algorithm 5.3.

use wide::f32x4;

use crate::registration::RegistrationError;

use super::Options;
use super::normal_equations::{Blocks, NormalEquations};
use super::scaled_equations::{self, ScaledEquations};
use super::system::Factorised;

/// The minimizer, and how many substitutions it took.
#[derive(Debug, Clone)]
pub(super) struct Minimum {
    pub transforms: Blocks,
    pub iterations: usize,
}

/// Steps of the conjugate gradients between two projections, at the most.
const MAX_STEPS: usize = 8;

/// They end earlier once the preconditioned residual's square has shrunk to this share.
const RESIDUAL_SHARE: f64 = 1e-2;

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
    let mut gained = 0.0;
    for _ in 0..options.max_inner_iterations {
        let step = conjugate_gradients(equations, factorised, &best.transforms)?;
        best.iterations += step.iterations;
        add_scaled(&mut best.transforms, &step.blocks, 1.0);
        if step.gain <= options.inner_tolerance * gained {
            break;
        }
        gained += step.gain;
    }
    Ok(best)
}

/// A step, by how much it lowers the surrogate with the rotations fixed (and so at least the
/// surrogate itself), and the substitutions that it took.
struct Step {
    blocks: Blocks,
    gain: f64,
    iterations: usize,
}

/// The step to the minimizer with the rotations fixed, approximately.
fn conjugate_gradients(
    equations: &NormalEquations<'_>,
    factorised: &Factorised<'_>,
    transforms: &Blocks,
) -> Result<Step, RegistrationError> {
    let (mut residual, size) = factorised.scaled(&equations.half_gradient(transforms)?);
    let matrix = ScaledEquations::new(equations, factorised.scales());
    let nothing = vec![[f32x4::ZERO; 4]; transforms.len()];
    let (mut step, mut product) = (nothing.clone(), nothing);
    let mut direction = Vec::new();
    let (mut gain, mut iterations) = (0.0, 0);
    let mut square = 0.0;
    let mut enough = 0.0;
    while iterations < MAX_STEPS {
        let preconditioned = factorised.solve_scaled(&residual);
        let next_square = scaled_equations::dot(&residual, &preconditioned);
        iterations += 1;
        if iterations == 1 {
            direction = preconditioned;
            enough = RESIDUAL_SHARE * next_square;
        } else if next_square <= enough {
            break;
        } else {
            let turn = (next_square / square) as f32;
            for (direction, next) in direction.iter_mut().zip(&preconditioned) {
                *direction = std::array::from_fn(|r| next[r] + direction[r] * turn);
            }
        }
        square = next_square;
        matrix.apply(&direction, &mut product);
        let curvature = scaled_equations::dot(&direction, &product);
        if curvature.is_nan() {
            return Err(RegistrationError::NotFinite { step: "non-rigid" });
        }
        // Nothing left to gain in any direction that the equations know of.
        if square <= 0.0 || curvature <= 0.0 {
            break;
        }
        let length = square / curvature;
        // The residual is that of the gradient, and so is the step: downhill is the other way.
        scaled_equations::add_scaled(&mut step, &direction, -length);
        scaled_equations::add_scaled(&mut residual, &product, -length);
        gain += length * square;
    }
    Ok(Step {
        blocks: factorised.unscaled(&step, size)?,
        gain: gain * size * size,
        iterations,
    })
}

pub(super) fn dot(a: &Blocks, b: &Blocks) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

pub(super) fn add_scaled(sum: &mut Blocks, term: &Blocks, factor: f64) {
    sum.iter_mut()
        .zip(term)
        .for_each(|(sum, term)| *sum += term * factor);
}
