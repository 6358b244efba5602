//! Implicit solids: tapered, squashed capsules and their smooth union.
//!
//! Distances are negative inside. Every field here changes by at most the
//! distance walked (it is 1-Lipschitz), which is what lets the polygonizer skip
//! empty space; it may underestimate the true distance.

use nalgebra::Vector3;

/// The x, the y and the z coordinates of sample points.
pub(crate) type Samples<const N: usize> = [[f32; N]; 3];

/// A capsule whose radius varies smoothly along its segment, squashed along one axis.
#[derive(Debug, Clone)]
pub(crate) struct Capsule {
    start: Vector3<f64>,
    segment: Vector3<f64>,
    inverse_length_squared: f64,
    start_radius: f64,
    radius_change: f64,
    bulge: f64,
    squash_axis: Vector3<f64>,
    stretch: f64,
    scale: f64,
    blend: f64,
}

impl Capsule {
    /// The capsule around the segment from `start` to `end`, with a radius at either end.
    pub(crate) fn new(start: Vector3<f64>, end: Vector3<f64>, radii: [f64; 2]) -> Self {
        let mut capsule = Self {
            start,
            segment: end - start,
            inverse_length_squared: 0.0,
            start_radius: radii[0],
            radius_change: radii[1] - radii[0],
            bulge: 0.0,
            squash_axis: Vector3::zeros(),
            stretch: 0.0,
            scale: 1.0,
            blend: 0.02,
        };
        capsule.update_scale();
        capsule
    }

    /// Adds `bulge` to the radius half-way along the segment.
    pub(crate) fn bulging(mut self, bulge: f64) -> Self {
        self.bulge = bulge;
        self.update_scale();
        self
    }

    /// Makes the cross-section an ellipse, `factor` (0 to 1) as thick along the unit vector `axis`.
    pub(crate) fn squashed(mut self, axis: Vector3<f64>, factor: f64) -> Self {
        self.squash_axis = axis;
        self.stretch = 1.0 / factor - 1.0;
        self.start += axis * (self.stretch * axis.dot(&self.start));
        self.segment += axis * (self.stretch * axis.dot(&self.segment));
        self.update_scale();
        self
    }

    /// Sets the width over which the capsule blends into what it is joined to.
    pub(crate) fn blended(mut self, blend: f64) -> Self {
        self.blend = blend;
        self
    }

    /// The width over which the capsule blends into what it is joined to.
    pub(crate) fn blend(&self) -> f64 {
        self.blend
    }

    /// A lower bound of the signed distance.
    #[inline]
    pub(crate) fn distance(&self, point: Vector3<f64>) -> f64 {
        let local = point + self.squash_axis * (self.stretch * self.squash_axis.dot(&point));
        let from_start = local - self.start;
        let along = (from_start.dot(&self.segment) * self.inverse_length_squared).clamp(0.0, 1.0);
        let outward = from_start - self.segment * along;
        (outward.norm() - self.radius(along)) * self.scale
    }

    /// Joins the capsule to the field sampled in `values`, in single precision.
    pub(crate) fn join<const N: usize>(&self, points: &Samples<N>, values: &mut [f32; N]) {
        let [start, segment, squash_axis] =
            [self.start, self.segment, self.squash_axis].map(|vector| vector.map(|c| c as f32));
        let inverse_length_squared = self.inverse_length_squared as f32;
        let (start_radius, radius_change) = (self.start_radius as f32, self.radius_change as f32);
        let (bulge, stretch) = (16.0 * self.bulge as f32, self.stretch as f32);
        let (scale, blend) = (self.scale as f32, self.blend as f32);
        let inverse_blend = 0.25 / blend;
        // Written out in coordinates, so that the compiler makes four lanes of it.
        for i in 0..N {
            let (x, y, z) = (points[0][i], points[1][i], points[2][i]);
            let pull = stretch * (squash_axis.x * x + squash_axis.y * y + squash_axis.z * z);
            let x = x + squash_axis.x * pull - start.x;
            let y = y + squash_axis.y * pull - start.y;
            let z = z + squash_axis.z * pull - start.z;
            let along = (x * segment.x + y * segment.y + z * segment.z) * inverse_length_squared;
            let along = if along > 0.0 { along } else { 0.0 };
            let along = if along < 1.0 { along } else { 1.0 };
            let (x, y, z) = (
                x - segment.x * along,
                y - segment.y * along,
                z - segment.z * along,
            );
            let from_end = along * (1.0 - along);
            let radius = start_radius
                + radius_change * along * along * (3.0 - 2.0 * along)
                + bulge * from_end * from_end;
            let distance = ((x * x + y * y + z * z).sqrt() - radius) * scale;
            let value = values[i];
            let lower = if distance < value { distance } else { value };
            let overlap = blend - (distance - value).abs();
            let overlap = if overlap > 0.0 { overlap } else { 0.0 };
            values[i] = lower - overlap * overlap * inverse_blend;
        }
    }

    /// [`Self::distance`] and its gradient.
    #[inline]
    pub(crate) fn distance_and_gradient(&self, point: Vector3<f64>) -> (f64, Vector3<f64>) {
        let local = point + self.squash_axis * (self.stretch * self.squash_axis.dot(&point));
        let from_start = local - self.start;
        let along = (from_start.dot(&self.segment) * self.inverse_length_squared).clamp(0.0, 1.0);
        let outward = from_start - self.segment * along;
        let length = outward.norm();
        let distance = (length - self.radius(along)) * self.scale;
        let from_end = along * (1.0 - along);
        let slope = self.radius_change * 6.0 * from_end
            + self.bulge * 32.0 * from_end * (1.0 - 2.0 * along);
        let gradient = outward / length.max(f64::MIN_POSITIVE)
            - self.segment * (self.inverse_length_squared * slope);
        let unsquashed = self.squash_axis * (self.stretch * self.squash_axis.dot(&gradient));
        (distance, (gradient + unsquashed) * self.scale)
    }

    /// A smooth step between the two radii (so that no crease shows at the ends) and the bulge.
    #[inline]
    fn radius(&self, along: f64) -> f64 {
        let from_end = along * (1.0 - along);
        self.start_radius
            + self.radius_change * along * along * (3.0 - 2.0 * along)
            + self.bulge * 16.0 * from_end * from_end
    }

    /// Divides the field by its steepest slope, so that it is 1-Lipschitz.
    fn update_scale(&mut self) {
        // Greatest derivatives of the smooth step and of 16 t²(1 − t)² on [0, 1].
        const STEP_SLOPE: f64 = 1.5;
        const BULGE_SLOPE: f64 = 3.08;
        let length_squared = self.segment.norm_squared();
        self.inverse_length_squared = if length_squared > 0.0 {
            1.0 / length_squared
        } else {
            0.0
        };
        let steepest = STEP_SLOPE * self.radius_change.abs() + BULGE_SLOPE * self.bulge.abs();
        let slope_squared = steepest * steepest * self.inverse_length_squared;
        self.scale = 1.0 / ((1.0 + self.stretch) * (1.0 + slope_squared).sqrt());
    }
}

/// The smooth minimum of `a` and `b`: exactly the smaller one where they differ by `blend` or more.
///
/// Source: Quilez, "Smooth minimum" (the quadratic polynomial variant).
#[inline]
pub(crate) fn smooth_min(a: f64, b: f64, blend: f64) -> f64 {
    let overlap = (blend - (a - b).abs()).max(0.0);
    a.min(b) - overlap * overlap / (4.0 * blend)
}

/// [`smooth_min`] of two fields, with the gradient.
#[inline]
pub(crate) fn smooth_min_with_gradient(
    a: (f64, Vector3<f64>),
    b: (f64, Vector3<f64>),
    blend: f64,
) -> (f64, Vector3<f64>) {
    let (near, far) = if a.0 < b.0 { (a, b) } else { (b, a) };
    let overlap = (blend - (far.0 - near.0)).max(0.0);
    if overlap == 0.0 {
        return near;
    }
    let share = overlap / (2.0 * blend);
    (
        near.0 - overlap * share / 2.0,
        near.1 * (1.0 - share) + far.1 * share,
    )
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn thumb_like() -> Capsule {
        Capsule::new(
            Vector3::new(0.1, 0.2, 0.0),
            Vector3::new(0.3, 0.1, 0.2),
            [0.09, 0.04],
        )
        .bulging(0.01)
        .squashed(Vector3::new(0.6, 0.8, 0.0), 0.5)
    }

    proptest! {
        /// The polygonizer skips a ball when the field at its centre exceeds its radius.
        #[test]
        fn the_field_never_changes_faster_than_the_distance_walked(
            p in prop::array::uniform3(-0.5..0.5_f64),
            step in prop::array::uniform3(-0.05..0.05_f64),
        ) {
            let capsule = thumb_like();
            let (p, step) = (Vector3::from(p), Vector3::from(step));
            let change = capsule.distance(p + step) - capsule.distance(p);
            prop_assert!(change.abs() <= step.norm() * (1.0 + 1e-9));
        }

        #[test]
        fn joining_samples_is_the_smooth_minimum(p in prop::array::uniform3(-0.5..0.5_f32)) {
            let capsule = thumb_like();
            let mut values = [0.2_f32];
            capsule.join(&p.map(|coordinate| [coordinate]), &mut values);
            let distance = capsule.distance(Vector3::from(p.map(f64::from)));
            let expected = smooth_min(0.2, distance, capsule.blend());
            // Ten units in the last place of a float of about 1.
            prop_assert!((f64::from(values[0]) - expected).abs() < 1e-6);
        }

        #[test]
        fn the_gradient_is_the_slope_of_the_field(p in prop::array::uniform3(-0.5..0.5_f64)) {
            let capsule = thumb_like();
            let other = Capsule::new(Vector3::zeros(), Vector3::y(), [0.1, 0.1]);
            let p = Vector3::from(p);
            let field = |p| smooth_min(capsule.distance(p), other.distance(p), 0.1);
            let (value, gradient) = smooth_min_with_gradient(
                capsule.distance_and_gradient(p),
                other.distance_and_gradient(p),
                0.1,
            );
            prop_assert!((value - field(p)).abs() < 1e-12);
            for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                let slope = (field(p + axis * 1e-6) - field(p - axis * 1e-6)) / 2e-6;
                prop_assert!((slope - gradient.dot(&axis)).abs() < 1e-3);
            }
        }
    }
}
