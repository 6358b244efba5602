//! Iterative closest point: correspondences and motion in turn.

use nalgebra::{Isometry3, Translation3};

use crate::metrics::DistanceStatistics;
use crate::registration::{RegistrationError, Target};
use crate::{Point, TriangleMesh, Vector};

use super::{fit_point_to_plane, fit_rigid};

/// What is minimized once the correspondences are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// The distance between the points (Eq. 7), in closed form.
    PointToPoint,
    /// The distance to the tangent plane of the target: lets surfaces slide, so that it needs a
    /// tenth of the steps near the solution.
    PointToPlane,
}

/// How ICP searches, and when it stops.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// What the last stage minimizes. The first, coarse one is always point-to-point, whose
    /// basin of attraction is wider.
    pub metric: Metric,
    /// Source vertices used in the coarse stage, evenly strided.
    pub coarse_samples: usize,
    /// Source vertices used in the last stage.
    pub fine_samples: usize,
    /// Iterations of the last stage at the most.
    pub max_iterations: usize,
    /// Iterations of the coarse stage, from each start, at the most.
    pub coarse_iterations: usize,
    /// A correspondence is rejected beyond this many median distances.
    pub rejection_factor: f64,
    /// Stop once no sample moves further than this share of the target's diagonal.
    pub tolerance: f64,
}

impl Default for Options {
    /// Tuned on human captures of 15,000 to 26,000 vertices.
    fn default() -> Self {
        Self {
            metric: Metric::PointToPlane,
            coarse_samples: 800,
            fine_samples: 3000,
            max_iterations: 30,
            coarse_iterations: 30,
            rejection_factor: 3.0,
            tolerance: 1e-6,
        }
    }
}

/// The motion that ICP found.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidRegistration {
    /// Carries the source onto the target.
    pub target_from_source: Isometry3<f64>,
    /// Root mean square of the distances of all sampled source vertices to the target's surface
    /// after the motion, rejected ones included.
    pub rmse: f64,
    /// Iterations of all stages together.
    pub iterations: usize,
    /// Whether the last stage came to rest before its iterations ran out.
    pub converged: bool,
}

/// Moves `source` rigidly onto `target`.
///
/// Starts from where the source is and, beside it, from where the centroids agree; takes the
/// better of both; and keeps the source where it is if that is better still, since ICP makes a
/// still body with one moving limb worse. "Better" is the mean of the closest 80 % of the
/// distances.
///
/// # Errors
///
/// [`RegistrationError::Empty`] for a source without vertices, and
/// [`RegistrationError::NotFinite`] if a solve fails.
///
/// # Source
///
/// Besl and McKay, "A Method for Registration of 3-D Shapes", IEEE TPAMI 14(2), 1992,
/// <https://doi.org/10.1109/34.121791>; rejection as in Rusinkiewicz and Levoy, "Efficient
/// Variants of the ICP Algorithm", 3DIM 2001, <https://doi.org/10.1109/IM.2001.924423>.
pub fn register(
    source: &TriangleMesh,
    target: &Target,
    options: &Options,
) -> Result<RigidRegistration, RegistrationError> {
    if source.vertex_count() == 0 {
        return Err(RegistrationError::Empty { which: "source" });
    }
    let coarse = strided(source.positions(), options.coarse_samples);
    let fine = strided(source.positions(), options.fine_samples);
    let centroids_agree = Isometry3::from_parts(
        centroid_shift(&coarse, target),
        nalgebra::UnitQuaternion::identity(),
    );
    let mut iterations = 0;
    let mut best: Option<(f64, Isometry3<f64>)> = None;
    for start in [Isometry3::identity(), centroids_agree] {
        let stage = Stage {
            metric: Metric::PointToPoint,
            points: &coarse,
            start,
            max_iterations: options.coarse_iterations,
        };
        // A start that leads nowhere is no reason to give up on the other.
        let Ok(outcome) = stage.run(target, options) else {
            continue;
        };
        iterations += outcome.iterations;
        let score = trimmed_mean(&coarse, &outcome.motion, target);
        if best.is_none_or(|(lowest, _)| score < lowest) {
            best = Some((score, outcome.motion));
        }
    }
    let start = best.map_or_else(Isometry3::identity, |(_, motion)| motion);
    let stage = Stage {
        metric: options.metric,
        points: &fine,
        start,
        max_iterations: options.max_iterations,
    };
    let outcome = stage.run(target, options)?;
    let unmoved = Isometry3::identity();
    let moves =
        trimmed_mean(&fine, &outcome.motion, target) < trimmed_mean(&fine, &unmoved, target);
    let target_from_source = if moves { outcome.motion } else { unmoved };
    let distances = distances(&fine, &target_from_source, target);
    Ok(RigidRegistration {
        target_from_source,
        rmse: DistanceStatistics::of(&distances).rmse,
        iterations: iterations + outcome.iterations,
        converged: outcome.converged,
    })
}

/// At most about `count` of `points`, evenly strided.
fn strided(points: &[Point], count: usize) -> Vec<Point> {
    points
        .iter()
        .step_by((points.len() / count.max(1)).max(1))
        .copied()
        .collect()
}

/// The translation that brings the points' centroid to the target's.
fn centroid_shift(points: &[Point], target: &Target) -> Translation3<f64> {
    let mean = points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64;
    Translation3::from(target.centroid().coords - mean)
}

fn distances(points: &[Point], motion: &Isometry3<f64>, target: &Target) -> Vec<f64> {
    points
        .iter()
        .map(|p| target.closest(&(motion * p)).0.distance)
        .collect()
}

fn trimmed_mean(points: &[Point], motion: &Isometry3<f64>, target: &Target) -> f64 {
    let mut distances = distances(points, motion, target);
    distances.sort_unstable_by(f64::total_cmp);
    let kept = &distances[..(distances.len() * 4).div_ceil(5)];
    kept.iter().sum::<f64>() / kept.len() as f64
}

struct Stage<'a> {
    metric: Metric,
    points: &'a [Point],
    start: Isometry3<f64>,
    max_iterations: usize,
}

struct StageOutcome {
    motion: Isometry3<f64>,
    iterations: usize,
    converged: bool,
}

impl Stage<'_> {
    fn run(&self, target: &Target, options: &Options) -> Result<StageOutcome, RegistrationError> {
        let mut motion = self.start;
        let tolerance = options.tolerance * target.diagonal();
        let mut faces = vec![0; self.points.len()];
        for iteration in 1..=self.max_iterations {
            let moved: Vec<Point> = self.points.iter().map(|p| motion * p).collect();
            let pairs = correspondences(&moved, &mut faces, target, options.rejection_factor);
            let step = match self.metric {
                Metric::PointToPoint => {
                    let (from, to): (Vec<Point>, Vec<Point>) =
                        pairs.iter().map(|(p, q, _)| (*p, *q)).unzip();
                    fit_rigid(&from, &to)?
                }
                Metric::PointToPlane => fit_point_to_plane(&pairs)?,
            };
            motion = step * motion;
            let largest = moved
                .iter()
                .map(|p| (step * p - p).norm())
                .fold(0.0, f64::max);
            if !largest.is_finite() {
                return Err(RegistrationError::NotFinite { step: "rigid" });
            }
            if largest < tolerance {
                return Ok(StageOutcome {
                    motion,
                    iterations: iteration,
                    converged: true,
                });
            }
        }
        Ok(StageOutcome {
            motion,
            iterations: self.max_iterations,
            converged: false,
        })
    }
}

/// Pairs every point with the closest point of the surface and its normal; drops pairs that
/// are much further apart than the median. `faces` are the last answers, and the next guesses.
fn correspondences(
    points: &[Point],
    faces: &mut [u32],
    target: &Target,
    rejection_factor: f64,
) -> Vec<(Point, Point, Vector)> {
    let found: Vec<_> = points
        .iter()
        .zip(faces.iter())
        .map(|(p, &face)| target.closest_from(p, face))
        .collect();
    faces
        .iter_mut()
        .zip(&found)
        .for_each(|(face, (surface, _))| *face = surface.face);
    let distances: Vec<f64> = found.iter().map(|(surface, _)| surface.distance).collect();
    let limit = rejection_factor * DistanceStatistics::quantile(&distances, 0.5);
    points
        .iter()
        .zip(&found)
        .filter(|(_, (surface, _))| surface.distance <= limit)
        .map(|(p, (surface, normal))| (*p, surface.position, *normal))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A closed surface without symmetry: a bumpy ellipsoid over a sphere's grid.
    fn bumpy() -> TriangleMesh {
        let (rings, segments) = (40, 60);
        let point = |ring: u32, segment: u32| {
            let theta = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            let phi = std::f64::consts::TAU * f64::from(segment % segments) / f64::from(segments);
            let r = 1.0 + 0.2 * (2.0 * phi).sin() * theta.sin() + 0.1 * (3.0 * theta).cos();
            let d = Vector::new(
                theta.sin() * phi.cos(),
                theta.cos(),
                theta.sin() * phi.sin(),
            );
            Point::new(r * d.x, 2.0 * r * d.y, 0.7 * r * d.z + 0.2 * d.x)
        };
        let mut positions = vec![];
        let mut faces = vec![];
        for ring in 0..=rings {
            positions.extend((0..segments).map(|s| point(ring, s)));
        }
        for ring in 0..rings {
            for s in 0..segments {
                let at = |r: u32, s: u32| r * segments + s % segments;
                faces.push([at(ring, s), at(ring, s + 1), at(ring + 1, s)]);
                faces.push([at(ring, s + 1), at(ring + 1, s + 1), at(ring + 1, s)]);
            }
        }
        TriangleMesh::new(positions, faces).unwrap()
    }

    #[test]
    fn twenty_degrees_and_a_tenth_of_the_diagonal_are_undone_by_both_metrics() {
        let source = bumpy();
        let diagonal = source.bounding_box().diagonal();
        let axis = Vector::new(0.3, 1.0, -0.5).normalize() * 20f64.to_radians();
        let motion = Isometry3::new(Vector::new(0.1, 0.0, 0.0) * diagonal, axis);
        let moved = source.positions().iter().map(|p| motion * p).collect();
        let moved = source.with_positions(moved).unwrap();
        // Point-to-point approaches linearly, and so slowly that it is only asked to get close.
        for (metric, max_iterations, within) in [
            (Metric::PointToPlane, 60, 1e-9),
            (Metric::PointToPoint, 400, 1e-4),
        ] {
            let target = Target::new(&moved).unwrap();
            let options = Options {
                metric,
                max_iterations,
                ..Options::default()
            };
            let found = register(&source, &target, &options).unwrap();
            let worst = source
                .positions()
                .iter()
                .map(|p| (found.target_from_source * p - motion * p).norm())
                .fold(0.0, f64::max);
            assert!(worst < within * diagonal, "{metric:?}: {worst}");
        }
    }

    #[test]
    fn a_frame_that_did_not_move_stays_exactly_where_it_is() {
        let mesh = bumpy();
        let target = Target::new(&mesh).unwrap();
        let found = register(&mesh, &target, &Options::default()).unwrap();
        assert_eq!(found.target_from_source, Isometry3::identity());
    }
}
