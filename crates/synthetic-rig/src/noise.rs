//! Reproducible randomness: a keyed hash instead of a generator with state, so
//! that the value for (seed, frame, item) does not depend on what was drawn before.
//!
//! Source of the mixing function: Steele, Lea and Flood, "Fast Splittable
//! Pseudorandom Number Generators", OOPSLA 2014 (SplitMix64).

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

/// What the randomness is used for; keeps the uses independent of each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    GridRotation = 1,
    GridOffset = 2,
    SensorNoise = 3,
}

/// A source of independent numbers for one purpose in one frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Randomness {
    key: u64,
}

impl Randomness {
    pub(crate) fn new(seed: u64, frame: u64, purpose: Purpose) -> Self {
        let key = mix(mix(mix(seed) ^ frame) ^ purpose as u64);
        Self { key }
    }

    /// Uniform in [0, 1), with 53 random bits.
    pub(crate) fn uniform(&self, item: u64) -> f64 {
        const UNIT: f64 = 1.0 / (1_u64 << 53) as f64;
        (self.bits(item) >> 11) as f64 * UNIT
    }

    /// Two independent normal deviates with mean 0 and standard deviation 1 (Box–Muller).
    pub(crate) fn gaussian_pair(&self, item: u64) -> [f64; 2] {
        // 1 − u is in (0, 1], so that the logarithm is finite.
        let radius = (-2.0 * libm::log(1.0 - self.uniform(2 * item))).sqrt();
        let (sin, cos) = libm::sincos(TAU * self.uniform(2 * item + 1));
        [radius * cos, radius * sin]
    }

    /// A rotation drawn uniformly from all rotations.
    ///
    /// Source: Shoemake, "Uniform Random Rotations", Graphics Gems III, 1992.
    pub(crate) fn rotation(&self) -> Matrix3<f64> {
        let (u, v, w) = (
            self.uniform(0),
            TAU * self.uniform(1),
            TAU * self.uniform(2),
        );
        let (outer, inner) = ((1.0 - u).sqrt(), u.sqrt());
        let (x, y) = (outer * libm::sin(v), outer * libm::cos(v));
        let (z, r) = (inner * libm::sin(w), inner * libm::cos(w));
        Matrix3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - z * r),
            2.0 * (x * z + y * r),
            2.0 * (x * y + z * r),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - x * r),
            2.0 * (x * z - y * r),
            2.0 * (y * z + x * r),
            1.0 - 2.0 * (x * x + y * y),
        )
    }

    /// A point drawn uniformly from the unit cube.
    pub(crate) fn unit_cube(&self) -> Vector3<f64> {
        Vector3::new(self.uniform(0), self.uniform(1), self.uniform(2))
    }

    fn bits(&self, item: u64) -> u64 {
        mix(self.key ^ mix(item))
    }
}

/// One step of SplitMix64 from the state `value`.
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_number_from_state_zero_is_the_published_one() {
        assert_eq!(mix(0), 0xE220_A839_7B1D_CDAF);
    }

    #[test]
    fn gaussian_deviates_have_mean_zero_and_variance_one() {
        let randomness = Randomness::new(7, 3, Purpose::SensorNoise);
        let samples: Vec<f64> = (0..50_000)
            .flat_map(|i| randomness.gaussian_pair(i))
            .collect();
        let count = samples.len() as f64;
        let mean = samples.iter().sum::<f64>() / count;
        let variance = samples.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / count;
        // Five standard errors: 1/√n for the mean, √(2/n) for the variance.
        assert!(mean.abs() < 5.0 / count.sqrt(), "{mean}");
        assert!(
            (variance - 1.0).abs() < 5.0 * (2.0 / count).sqrt(),
            "{variance}"
        );
    }

    #[test]
    fn a_random_rotation_is_a_rotation() {
        for frame in 0..50 {
            let rotation = Randomness::new(1, frame, Purpose::GridRotation).rotation();
            let error = rotation * rotation.transpose() - Matrix3::identity();
            assert!(error.norm() < 1e-12);
            assert!((rotation.determinant() - 1.0).abs() < 1e-12);
        }
    }
}
