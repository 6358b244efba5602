//! Minimizes a round's surrogate by one factorisation.
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

use nalgebra::Matrix4x3;

use crate::registration::RegistrationError;

use super::Options;
use super::normal_equations::{Blocks, NormalEquations};
use super::system::Factorised;

/// The minimizer, its value, and how many substitutions it took.
#[derive(Debug, Clone)]
pub(super) struct Minimum {
    pub transforms: Blocks,
    pub value: f64,
    pub iterations: usize,
}

/// Steps of the conjugate gradients between two projections, at the most.
const MAX_STEPS: usize = 8;

/// They end earlier once the preconditioned residual's square has shrunk to this share.
const RESIDUAL_SHARE: f64 = 1e-2;

/// Lowers the surrogate from `start`, which comes with its value.
pub(super) fn minimize(
    equations: &NormalEquations<'_>,
    factorised: &Factorised,
    start: Minimum,
    options: &Options,
) -> Result<Minimum, RegistrationError> {
    let mut best = start;
    for _ in 0..options.max_inner_iterations {
        let (step, iterations) = conjugate_gradients(equations, factorised, &best.transforms)?;
        best.iterations += iterations;
        let transforms: Blocks = best
            .transforms
            .iter()
            .zip(&step)
            .map(|(x, d)| x + d)
            .collect();
        let value = equations
            .problem
            .surrogate_value(equations.surrogate, &transforms);
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

/// The step to the minimizer with the rotations fixed, approximately, and the substitutions
/// that it took.
fn conjugate_gradients(
    equations: &NormalEquations<'_>,
    factorised: &Factorised,
    transforms: &Blocks,
) -> Result<(Blocks, usize), RegistrationError> {
    let mut residual = equations.half_gradient(transforms)?;
    residual.iter_mut().for_each(|block| *block = -*block);
    let mut step = vec![Matrix4x3::zeros(); transforms.len()];
    let mut product = step.clone();
    let mut preconditioned = factorised.solve(&residual)?;
    let mut direction = preconditioned.clone();
    let mut square = dot(&residual, &preconditioned);
    let enough = RESIDUAL_SHARE * square;
    for iteration in 1..=MAX_STEPS {
        equations.apply(&direction, &mut product);
        let curvature = dot(&direction, &product);
        if curvature.is_nan() {
            return Err(RegistrationError::NotFinite { step: "non-rigid" });
        }
        // Nothing left to gain in any direction that the equations know of.
        if square <= 0.0 || curvature <= 0.0 {
            return Ok((step, iteration));
        }
        let length = square / curvature;
        add_scaled(&mut step, &direction, length);
        if iteration == MAX_STEPS {
            break;
        }
        add_scaled(&mut residual, &product, -length);
        preconditioned = factorised.solve(&residual)?;
        let next_square = dot(&residual, &preconditioned);
        if next_square <= enough {
            return Ok((step, iteration + 1));
        }
        let turn = next_square / square;
        direction
            .iter_mut()
            .zip(&preconditioned)
            .for_each(|(d, p)| *d = p + *d * turn);
        square = next_square;
    }
    Ok((step, MAX_STEPS))
}

pub(super) fn dot(a: &Blocks, b: &Blocks) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

pub(super) fn add_scaled(sum: &mut Blocks, term: &Blocks, factor: f64) {
    sum.iter_mut()
        .zip(term)
        .for_each(|(sum, term)| *sum += term * factor);
}
