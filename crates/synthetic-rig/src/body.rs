//! The figure at rest as an implicit solid.
//!
//! 1.8 m tall in metres, y up, soles at y = 0, facing +z, so that its left is
//! +x; the arms are spread 40° below the horizontal. Trousers, shirt, belt and
//! hair are shape only: there is no colour.

use nalgebra::Vector3;

use crate::implicit::{Capsule, Samples, smooth_min, smooth_min_with_gradient};

/// The most by which folds, belt and collar move the surface, in metres.
pub(crate) const MAX_DISPLACEMENT: f64 = 0.0065;

/// Which parts of the body can matter in some region of space.
pub(crate) type Parts = Vec<u16>;

/// The resting figure.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    parts: Vec<Capsule>,
}

impl Body {
    pub(crate) fn new() -> Self {
        let mut parts = torso();
        parts.extend(head());
        for side in [1.0, -1.0] {
            parts.extend(arm(side));
            parts.extend(hand(side));
            parts.extend(leg(side));
        }
        Self { parts }
    }

    /// The indices of all parts, the candidates to start [`Self::parts_near`] from.
    pub(crate) fn all_parts(&self) -> Parts {
        (0..self.parts.len()).map(|part| part as u16).collect()
    }

    /// The centre and radius of a ball that contains the figure.
    pub(crate) fn bounding_ball(&self) -> (Vector3<f64>, f64) {
        (Vector3::new(0.0, 0.95, 0.0), 1.05)
    }

    /// The smooth distance at `point`, without folds, and each candidate's own distance.
    pub(crate) fn smooth_distance(
        &self,
        candidates: &[u16],
        point: Vector3<f64>,
    ) -> (f64, Vec<f64>) {
        let distances: Vec<f64> = self
            .parts_of(candidates)
            .map(|part| part.distance(point))
            .collect();
        let join = |sum, (part, &distance): (&Capsule, _)| smooth_min(sum, distance, part.blend());
        (
            self.parts_of(candidates)
                .zip(&distances)
                .fold(f64::INFINITY, join),
            distances,
        )
    }

    /// Those of `candidates`, at these distances from a point, that matter within `radius` of it.
    ///
    /// Leaving out the others does not change the field there at all: a part
    /// `w` (the widest blend) farther than the nearest one has no weight in a
    /// union with it, and a union of any number of such parts lies at most `w`
    /// below them, hence twice that.
    pub(crate) fn parts_near(&self, candidates: &[u16], distances: &[f64], radius: f64) -> Parts {
        let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
        let widest = self
            .parts_of(candidates)
            .map(Capsule::blend)
            .fold(0.0, f64::max);
        let limit = nearest + 2.0 * (radius + widest);
        let is_near = |&(_, &distance): &(&u16, &f64)| distance <= limit;
        candidates
            .iter()
            .zip(distances)
            .filter(is_near)
            .map(|(&part, _)| part)
            .collect()
    }

    /// The signed distance bound at every one of `points`, from `candidates`.
    pub(crate) fn sample<const N: usize>(
        &self,
        candidates: &[u16],
        points: &Samples<N>,
    ) -> [f32; N] {
        // Far outside, but finite: the vectorized union has no care for infinities.
        let mut values = [1e3; N];
        for part in self.parts_of(candidates) {
            part.join(points, &mut values);
        }
        for i in 0..N {
            values[i] -= displacement(points[0][i], points[1][i], points[2][i]);
        }
        values
    }

    /// The field at `point` and its gradient, that of the folds left out.
    ///
    /// Folds are shallow, so repeated Newton steps along it still end on the surface.
    pub(crate) fn distance_and_gradient(
        &self,
        candidates: &[u16],
        point: Vector3<f64>,
    ) -> (f64, Vector3<f64>) {
        let nothing = (f64::INFINITY, Vector3::zeros());
        let (distance, gradient) = self.parts_of(candidates).fold(nothing, |sum, part| {
            if part.distance(point) >= sum.0 + part.blend() {
                return sum;
            }
            smooth_min_with_gradient(sum, part.distance_and_gradient(point), part.blend())
        });
        let [x, y, z] = [point.x, point.y, point.z].map(|coordinate| coordinate as f32);
        (distance - f64::from(displacement(x, y, z)), gradient)
    }

    fn parts_of<'a>(&'a self, candidates: &'a [u16]) -> impl Iterator<Item = &'a Capsule> {
        candidates
            .iter()
            .map(|&part| &self.parts[usize::from(part)])
    }
}

fn at(x: f64, y: f64, z: f64) -> Vector3<f64> {
    Vector3::new(x, y, z)
}

fn torso() -> Vec<Capsule> {
    let z = Vector3::z();
    let mut parts = vec![
        Capsule::new(
            at(-0.06, 0.955, -0.005),
            at(0.06, 0.955, -0.005),
            [0.117, 0.117],
        )
        .squashed(z, 0.92)
        .blended(0.04),
        Capsule::new(at(0.0, 1.0, 0.0), at(0.0, 1.18, 0.0), [0.152, 0.142])
            .squashed(z, 0.70)
            .blended(0.05),
        Capsule::new(at(0.0, 1.24, -0.005), at(0.0, 1.34, -0.01), [0.162, 0.168])
            .squashed(z, 0.68)
            .blended(0.05),
    ];
    for side in [1.0, -1.0] {
        let clavicle = Capsule::new(
            at(side * 0.05, 1.425, -0.01),
            at(side * 0.165, 1.425, -0.012),
            [0.055, 0.060],
        );
        let trapezius = Capsule::new(
            at(side * 0.01, 1.515, -0.02),
            at(side * 0.14, 1.45, -0.02),
            [0.045, 0.038],
        );
        let breast = Capsule::new(
            at(side * 0.06, 1.335, 0.06),
            at(side * 0.10, 1.345, 0.05),
            [0.055, 0.05],
        );
        let buttock = Capsule::new(
            at(side * 0.075, 0.93, -0.045),
            at(side * 0.08, 0.90, -0.04),
            [0.086, 0.08],
        );
        parts.extend([
            clavicle.blended(0.05),
            trapezius.blended(0.04),
            breast.blended(0.05),
            buttock.blended(0.04),
        ]);
    }
    parts
}

fn head() -> Vec<Capsule> {
    let x = Vector3::x();
    let mut parts = vec![
        Capsule::new(at(0.0, 1.44, -0.02), at(0.0, 1.60, 0.0), [0.062, 0.054]).blended(0.03),
        Capsule::new(at(0.0, 1.69, -0.022), at(0.0, 1.685, 0.02), [0.098, 0.094])
            .squashed(x, 0.78)
            .blended(0.02),
        Capsule::new(at(0.0, 1.66, 0.035), at(0.0, 1.607, 0.05), [0.070, 0.045])
            .squashed(x, 0.86)
            .blended(0.03),
        Capsule::new(at(0.0, 1.592, 0.076), at(0.0, 1.594, 0.078), [0.020, 0.020]).blended(0.025),
        Capsule::new(at(0.0, 1.686, 0.104), at(0.0, 1.652, 0.120), [0.009, 0.015]).blended(0.012),
        Capsule::new(
            at(-0.036, 1.704, 0.094),
            at(0.036, 1.704, 0.094),
            [0.010, 0.010],
        )
        .bulging(0.004)
        .blended(0.018),
        Capsule::new(
            at(-0.014, 1.622, 0.098),
            at(0.014, 1.622, 0.098),
            [0.009, 0.009],
        )
        .blended(0.012),
        // Hair: a cap a little larger than the skull, leaving the face free.
        Capsule::new(
            at(0.0, 1.702, -0.028),
            at(0.0, 1.724, 0.034),
            [0.107, 0.086],
        )
        .squashed(x, 0.86)
        .blended(0.008),
        Capsule::new(at(0.0, 1.66, -0.055), at(0.0, 1.62, -0.045), [0.072, 0.052])
            .squashed(x, 0.95)
            .blended(0.015),
    ];
    for side in [1.0, -1.0] {
        parts.push(
            Capsule::new(
                at(side * 0.083, 1.648, 0.004),
                at(side * 0.090, 1.686, -0.006),
                [0.014, 0.021],
            )
            .squashed(x, 0.5)
            .blended(0.008),
        );
    }
    parts
}

/// Where the joints of the limbs are, for the left (`side` = 1) or right (−1) of the figure.
pub(crate) mod joints {
    use nalgebra::Vector3;

    use super::at;

    pub(crate) fn shoulder(side: f64) -> Vector3<f64> {
        at(side * 0.182, 1.425, -0.012)
    }

    /// `length` metres from the shoulder along the resting arm.
    pub(crate) fn along_arm(side: f64, length: f64) -> Vector3<f64> {
        shoulder(side) + arm_direction(side) * length
    }

    /// 40° below the horizontal.
    pub(crate) fn arm_direction(side: f64) -> Vector3<f64> {
        at(side * 0.766_044_443, -0.642_787_610, 0.0)
    }

    pub(crate) const ELBOW: f64 = 0.29;
    pub(crate) const WRIST: f64 = 0.545;

    pub(crate) fn hip(side: f64) -> Vector3<f64> {
        at(side * 0.095, 0.93, 0.0)
    }

    pub(crate) fn knee(side: f64) -> Vector3<f64> {
        at(side * 0.115, 0.50, 0.008)
    }

    pub(crate) fn ankle(side: f64) -> Vector3<f64> {
        at(side * 0.13, 0.09, -0.015)
    }
}

fn arm(side: f64) -> Vec<Capsule> {
    let on_arm = |length: f64| joints::along_arm(side, length);
    vec![
        Capsule::new(on_arm(0.0), on_arm(joints::ELBOW), [0.062, 0.047])
            .bulging(0.004)
            .blended(0.035),
        Capsule::new(
            on_arm(joints::ELBOW),
            on_arm(joints::WRIST - 0.02),
            [0.046, 0.037],
        )
        .bulging(0.004)
        .blended(0.02),
    ]
}

fn hand(side: f64) -> Vec<Capsule> {
    let along = joints::arm_direction(side);
    // The palm faces down and inwards; the fingers lie side by side along z.
    let palm_normal = along.cross(&Vector3::z());
    let place = |forward: f64, across: f64, down: f64| {
        joints::along_arm(side, joints::WRIST + forward)
            + Vector3::z() * across
            + palm_normal * (side * down)
    };
    let mut parts = vec![
        Capsule::new(
            place(-0.03, 0.0, 0.0),
            place(0.03, 0.0, 0.0),
            [0.027, 0.026],
        )
        .squashed(palm_normal, 0.8)
        .blended(0.008),
        Capsule::new(
            place(0.035, 0.0, 0.0),
            place(0.07, 0.0, 0.0),
            [0.040, 0.042],
        )
        .squashed(palm_normal, 0.42)
        .blended(0.02),
        Capsule::new(
            place(0.025, 0.025, 0.008),
            place(0.075, 0.065, 0.018),
            [0.016, 0.011],
        )
        .blended(0.012),
    ];
    // Closed fingers: gaps between them would come and go with the sampling grid.
    for (across, reach) in [
        (0.034, 0.160),
        (0.011, 0.175),
        (-0.012, 0.168),
        (-0.034, 0.145),
    ] {
        let tip = place(reach, across * 0.92, 0.016);
        parts.push(Capsule::new(place(0.07, across, 0.0), tip, [0.0135, 0.0115]).blended(0.008));
    }
    parts
}

fn leg(side: f64) -> Vec<Capsule> {
    let (hip, knee, ankle) = (joints::hip(side), joints::knee(side), joints::ankle(side));
    let y = Vector3::y();
    vec![
        Capsule::new(hip + at(0.0, -0.01, 0.0), knee, [0.090, 0.062])
            .bulging(0.004)
            .blended(0.03),
        Capsule::new(knee, ankle + at(0.0, 0.02, 0.0), [0.060, 0.048])
            .bulging(0.006)
            .blended(0.03),
        Capsule::new(
            at(side * 0.120, 0.40, -0.022),
            at(side * 0.124, 0.26, -0.02),
            [0.048, 0.042],
        )
        .blended(0.04),
        // The trouser leg, open over the shoe.
        Capsule::new(
            at(side * 0.124, 0.30, -0.006),
            at(side * 0.13, 0.10, -0.012),
            [0.050, 0.060],
        )
        .blended(0.02),
        Capsule::new(
            at(side * 0.131, 0.062, -0.045),
            at(side * 0.148, 0.048, 0.13),
            [0.052, 0.046],
        )
        .squashed(y, 0.85)
        .blended(0.012),
        Capsule::new(
            at(side * 0.131, 0.021, -0.045),
            at(side * 0.149, 0.021, 0.135),
            [0.053, 0.053],
        )
        .squashed(y, 0.4)
        .blended(0.008),
    ]
}

/// How far folds, belt and collar push the surface out at a point.
#[inline(always)]
fn displacement(x: f32, y: f32, z: f32) -> f32 {
    let is_torso = ramp((0.30 - x.abs()) / 0.03);
    let belt = plateau((y - 1.015) / 0.022) * is_torso;
    let collar = plateau((y - 1.525) / 0.014) * ramp((0.12 - x.abs()) / 0.02);
    // Everything between the shoes, the hands and the collar is cloth.
    let cloth = ramp((1.50 - y) / 0.03) * ramp((y - 0.11) / 0.04) * ramp((0.575 - x.abs()) / 0.03);
    let bend = wave(6.0 * z + 2.5 * x);
    let folds =
        wave(9.0 * y + 4.0 * x + 0.3 * bend) * 0.6 + wave(17.0 * x - 7.0 * y + 13.0 * z) * 0.4;
    0.004 * belt + 0.004 * collar + 0.0024 * folds * cloth * (1.0 - belt)
}

/// 0 below 0, 1 above 1, smooth in between.
#[inline(always)]
fn ramp(t: f32) -> f32 {
    let t = if t > 0.0 { t } else { 0.0 };
    let t = if t < 1.0 { t } else { 1.0 };
    t * t * (3.0 - 2.0 * t)
}

/// 1 in the middle of −1 to 1, 0 outside, with steep smooth flanks.
#[inline(always)]
fn plateau(t: f32) -> f32 {
    ramp((1.0 - t.abs()) * 3.0)
}

/// A smooth wave of period 1 between −1 and 1, of parabolas: cheap, and the same bits everywhere.
#[inline(always)]
fn wave(t: f32) -> f32 {
    // Adding and subtracting 1.5 · 2^23 rounds to the nearest integer.
    const ROUNDER: f32 = 12_582_912.0;
    let t = t - ((t + ROUNDER) - ROUNDER);
    8.0 * t * (1.0 - 2.0 * t.abs())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn anywhere() -> impl Strategy<Value = Vector3<f64>> {
        (-0.9..0.9_f64, -0.1..1.9_f64, -0.3..0.3_f64).prop_map(|(x, y, z)| at(x, y, z))
    }

    proptest! {
        #[test]
        fn leaving_distant_parts_out_does_not_change_a_bit(
            center in anywhere(),
            offset in prop::array::uniform3(-0.05..0.05_f64),
        ) {
            let body = Body::new();
            let all = body.all_parts();
            let near = body.parts_near(&all, &body.smooth_distance(&all, center).1, 0.1);
            let point = center + Vector3::from(offset);
            let field = |parts| body.smooth_distance(parts, point).0;
            prop_assert_eq!(field(&near), field(&all));
            let samples = [point.x, point.y, point.z].map(|coordinate| [coordinate as f32]);
            prop_assert_eq!(body.sample(&near, &samples), body.sample(&all, &samples));
        }

        #[test]
        fn the_displacement_stays_within_its_bound(point in anywhere()) {
            let [x, y, z] = [point.x, point.y, point.z].map(|coordinate| coordinate as f32);
            prop_assert!(f64::from(displacement(x, y, z).abs()) <= MAX_DISPLACEMENT);
        }
    }

    #[test]
    fn the_figure_is_one_metre_eighty_tall_and_lies_in_its_bounding_ball() {
        let body = Body::new();
        let all = body.all_parts();
        let highest_inside = (0..2000)
            .map(|step| f64::from(step) * 0.001)
            .filter(|&y| body.smooth_distance(&all, at(0.0, y, -0.01)).0 < 0.0)
            .fold(0.0, f64::max);
        assert!((highest_inside - 1.8).abs() < 0.01, "{highest_inside}");
        let (center, radius) = body.bounding_ball();
        for tip in [
            joints::along_arm(1.0, 0.73),
            at(0.15, 0.0, 0.2),
            at(0.0, 1.82, 0.0),
        ] {
            assert!((tip - center).norm() < radius);
        }
    }
}
