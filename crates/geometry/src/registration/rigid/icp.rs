//! Iterative closest point: correspondences and motion in turn.

use nalgebra::{Isometry3, Translation3};

use crate::metrics::DistanceStatistics;
use crate::registration::{RegistrationError, Target};
use crate::spatial::SurfacePoint;
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
    /// Source vertices used in the coarse stage, evenly strided. There is none if the source
    /// lies within a mean edge of the target as it is.
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
            coarse_samples: 400,
            fine_samples: 600,
            max_iterations: 30,
            coarse_iterations: 30,
            rejection_factor: 3.0,
            tolerance: 1e-5,
        }
    }
}

/// The coarse stage ends once no sample moves further than this share of the target's diagonal:
/// about half an edge of a capture, from where the last stage finds on its own.
const COARSE_TOLERANCE: f64 = 1e-3;

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
/// Starts from where the source is and, unless that is close already, also from where the
/// centroids agree; takes the better of both; and keeps the source where it is if that is better
/// still, since ICP makes a still body with one moving limb worse. "Better" is the mean of the
/// closest 80 % of the distances.
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
    let fine = strided(source.positions(), options.fine_samples);
    let mut search = Search::new(&fine, target);
    let unmoved = search.distances(&Isometry3::identity());
    let (start, coarse_iterations) = if trimmed_mean(&unmoved) < target.mean_edge() {
        (Isometry3::identity(), 0)
    } else {
        coarse_motion(source, target, options)
    };
    let stage = Stage {
        metric: options.metric,
        start,
        max_iterations: options.max_iterations,
        tolerance: options.tolerance,
    };
    let outcome = stage.run(&mut search, options)?;
    let moved = search.distances(&outcome.motion);
    let moves = trimmed_mean(&moved) < trimmed_mean(&unmoved);
    let (target_from_source, distances) = if moves {
        (outcome.motion, moved)
    } else {
        (Isometry3::identity(), unmoved)
    };
    Ok(RigidRegistration {
        target_from_source,
        rmse: DistanceStatistics::of(&distances).rmse,
        iterations: coarse_iterations + outcome.iterations,
        converged: outcome.converged,
    })
}

/// The better of two motions, one from where the source is and one from where the centroids
/// agree, and the iterations that both took.
fn coarse_motion(
    source: &TriangleMesh,
    target: &Target,
    options: &Options,
) -> (Isometry3<f64>, usize) {
    let coarse = strided(source.positions(), options.coarse_samples);
    let centroids_agree = Isometry3::from_parts(
        centroid_shift(&coarse, target),
        nalgebra::UnitQuaternion::identity(),
    );
    let mut iterations = 0;
    let mut best: Option<(f64, Isometry3<f64>)> = None;
    for start in [Isometry3::identity(), centroids_agree] {
        let mut search = Search::new(&coarse, target);
        let stage = Stage {
            metric: Metric::PointToPoint,
            start,
            max_iterations: options.coarse_iterations,
            tolerance: COARSE_TOLERANCE,
        };
        // A start that leads nowhere is no reason to give up on the other.
        let Ok(outcome) = stage.run(&mut search, options) else {
            continue;
        };
        iterations += outcome.iterations;
        let score = trimmed_mean(&search.distances(&outcome.motion));
        if best.is_none_or(|(lowest, _)| score < lowest) {
            best = Some((score, outcome.motion));
        }
    }
    let motion = best.map_or_else(Isometry3::identity, |(_, motion)| motion);
    (motion, iterations)
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

fn trimmed_mean(distances: &[f64]) -> f64 {
    let mut distances = distances.to_vec();
    let kept = (distances.len() * 4).div_ceil(5);
    if kept < distances.len() {
        distances.select_nth_unstable_by(kept, f64::total_cmp);
    }
    distances[..kept].iter().sum::<f64>() / kept as f64
}

struct Stage {
    metric: Metric,
    start: Isometry3<f64>,
    max_iterations: usize,
    tolerance: f64,
}

struct StageOutcome {
    motion: Isometry3<f64>,
    iterations: usize,
    converged: bool,
}

impl Stage {
    fn run(
        &self,
        search: &mut Search<'_>,
        options: &Options,
    ) -> Result<StageOutcome, RegistrationError> {
        let mut motion = self.start;
        let tolerance = self.tolerance * search.target.diagonal();
        for iteration in 1..=self.max_iterations {
            let pairs = search.correspondences(&motion, options.rejection_factor);
            let step = match self.metric {
                Metric::PointToPoint => {
                    let (from, to): (Vec<Point>, Vec<Point>) =
                        pairs.iter().map(|(p, q, _)| (*p, *q)).unzip();
                    fit_rigid(&from, &to)?
                }
                Metric::PointToPlane => fit_point_to_plane(&pairs)?,
            };
            let next = step * motion;
            let largest = search
                .points
                .iter()
                .map(|p| (next * p - motion * p).norm())
                .fold(0.0, f64::max);
            if !largest.is_finite() {
                return Err(RegistrationError::NotFinite { step: "rigid" });
            }
            motion = next;
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

/// The closest points of some samples, which remembers where it found the last ones.
struct Search<'a> {
    points: &'a [Point],
    target: &'a Target,
    /// The last answers, and the next guesses.
    faces: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(points: &'a [Point], target: &'a Target) -> Self {
        let faces = vec![0; points.len()];
        Self {
            points,
            target,
            faces,
        }
    }

    fn find(&mut self, motion: &Isometry3<f64>) -> Vec<(Point, SurfacePoint)> {
        self.points
            .iter()
            .zip(&mut self.faces)
            .map(|(p, face)| {
                let moved = motion * p;
                let surface = self.target.surface().closest_from(&moved, *face);
                *face = surface.face;
                (moved, surface)
            })
            .collect()
    }

    fn distances(&mut self, motion: &Isometry3<f64>) -> Vec<f64> {
        let found = self.find(motion);
        found.iter().map(|(_, surface)| surface.distance).collect()
    }

    /// Pairs every moved point with the closest point of the surface and its normal; drops pairs
    /// that are much further apart than the median.
    fn correspondences(
        &mut self,
        motion: &Isometry3<f64>,
        rejection_factor: f64,
    ) -> Vec<(Point, Point, Vector)> {
        let found = self.find(motion);
        let distances: Vec<f64> = found.iter().map(|(_, surface)| surface.distance).collect();
        let limit = rejection_factor * DistanceStatistics::quantile(&distances, 0.5);
        found
            .iter()
            .filter(|(_, surface)| surface.distance <= limit)
            .map(|(p, surface)| (*p, surface.position, self.target.normal(surface.face)))
            .collect()
    }
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
                tolerance: 1e-6,
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
