//! The fine step: what the deformation graph leaves is taken up by a membrane over the source.
//!
//! A graph whose nodes are several edges apart does not follow what is smaller than that. Every
//! vertex v_i of the source has an offset o_i to the closest point of the target. The
//! displacements d_i that are added minimize
//!
//! Σ_i w_i (n_i·(d_i − o_i))² + λ Σ_(i,j) ‖d_i − d_j‖² + ε Σ_i ‖d_i‖²
//!
//! over the vertices and the edges of the source, with n_i the direction of the offset: only
//! leaving the surface counts, sliding along it is up to the neighbors. The membrane smooths over
//! √(λ / w) edges, and where a weight is 0 the displacements of the neighbors are filled in and
//! fade out over √(λ / ε) edges.
//!
//! # Source
//!
//! The quadratic membrane of Terzopoulos, "The Computation of Visible-Surface Representations",
//! IEEE TPAMI 10(4), 1988, <https://doi.org/10.1109/34.3908>, on displacements; sweeps of
//! Gauss-Seidel.

use wide::f32x4;

use crate::mesh::Rows;
use crate::spatial::SurfacePoint;
use crate::{Point, TriangleMesh, Vector};

use super::{Target, welsch_weight};

/// How far the membrane smooths and what it goes by.
///
/// Tuned with the deformation graph on consecutive frames of human captures.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Rounds of closest points and displacements; none leaves the step out.
    pub rounds: usize,
    /// λ: the smoothing length is its root, in edges.
    pub smoothness: f64,
    /// ε: how soon displacements fade where there is nothing to go by.
    pub decay: f64,
    /// The scale of the weights' Welsch function of the distance, in mean edges of the target.
    pub scale: f64,
    /// The largest angle between the normals of source and target, and between the source's
    /// normal and the offset, in degrees.
    pub max_normal_angle_degrees: f64,
    /// Sweeps of Gauss-Seidel a round.
    pub sweeps: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rounds: 1,
            smoothness: 0.5,
            decay: 0.01,
            scale: 1.0,
            max_normal_angle_degrees: 60.0,
            sweeps: 8,
        }
    }
}

/// What a vertex goes by.
#[derive(Debug, Clone, Copy)]
struct Pull {
    /// Of unit length; whatever where the weight is 0.
    direction: Vector,
    /// n·o, in mean edges of the target.
    height: f64,
    weight: f64,
}

/// Moves the vertices of `mesh`, which found `closest` on the target, onto the target, as far as
/// a smooth field of displacements can. `closest` follows: a vertex that is still straight above
/// its face is not looked for again, since it only came closer to it.
///
/// A vertex without a counterpart goes along with those around it that have one.
pub(super) fn settle(
    mesh: &mut TriangleMesh,
    closest: &mut [SurfacePoint],
    target: &Target,
    options: &Options,
) {
    for _ in 0..options.rounds {
        let pulls = pulls(mesh, closest, target, options);
        let displacements = displacements(mesh.vertex_neighbors(), &pulls, options);
        let moved = mesh.positions().iter().zip(&displacements);
        let moved: Vec<Point> = moved
            .map(|(p, d)| {
                let [x, y, z, _] = d.to_array().map(f64::from);
                p + Vector::new(x, y, z) * target.mean_edge()
            })
            .collect();
        let Ok(settled) = mesh.with_positions(moved) else {
            return;
        };
        *mesh = settled;
        let surface = target.surface();
        for (found, point) in closest.iter_mut().zip(mesh.positions()) {
            let straight = surface.straight_below(point, found.face);
            *found = straight.unwrap_or_else(|| surface.closest_from(point, found.face));
        }
    }
}

fn pulls(
    mesh: &TriangleMesh,
    closest: &[SurfacePoint],
    target: &Target,
    options: &Options,
) -> Vec<Pull> {
    let min_cosine = options.max_normal_angle_degrees.to_radians().cos();
    let scale = options.scale * target.mean_edge();
    let normals = mesh.vertex_normals();
    let vertices = mesh.positions().iter().zip(closest).zip(normals);
    vertices
        .map(|((position, found), normal)| {
            let face_normal = target.normal(found.face);
            let offset = found.position - position;
            // Next to the surface rounding would decide the direction, and the face does.
            let direction = if found.distance <= 1e-6 * target.mean_edge() {
                face_normal
            } else {
                offset / found.distance
            };
            let agreement = face_normal.dot(normal).min(direction.dot(normal).abs());
            let weight = if agreement <= min_cosine {
                0.0
            } else {
                let straightness = (agreement - min_cosine) / (1.0 - min_cosine);
                straightness * welsch_weight(found.distance, scale)
            };
            Pull {
                direction,
                height: direction.dot(&offset) / target.mean_edge(),
                weight,
            }
        })
        .collect()
}

/// The minimizer, approximately, from 0: in mean edges of the target, so that `f32` will do.
fn displacements(neighbors: &Rows, pulls: &[Pull], options: &Options) -> Vec<f32x4> {
    let mut displacements = vec![f32x4::ZERO; pulls.len()];
    let steps: Vec<Step> = pulls
        .iter()
        .enumerate()
        .map(|(vertex, pull)| Step::new(pull, neighbors.row(vertex).len(), options))
        .collect();
    for _ in 0..options.sweeps {
        for (vertex, step) in steps.iter().enumerate() {
            let mut sum = f32x4::ZERO;
            for &neighbor in neighbors.row(vertex) {
                sum += displacements[neighbor as usize];
            }
            let [x, y, z, _] = (sum * step.direction).to_array();
            let missing = step.pulled - step.drawn * ((x + y) + z);
            displacements[vertex] = sum * step.filled + step.direction * missing;
        }
    }
    displacements
}

/// What makes a vertex's displacement of the sum of its neighbors'.
struct Step {
    direction: f32x4,
    /// What the sum counts.
    filled: f32,
    /// How far along the direction the pull takes it, and what of the sum's part along it that
    /// replaces.
    pulled: f32,
    drawn: f32,
}

impl Step {
    fn new(pull: &Pull, neighbor_count: usize, options: &Options) -> Self {
        let stiffness = options.smoothness * neighbor_count as f64 + options.decay;
        let share = pull.weight / (pull.weight + stiffness);
        let filled = options.smoothness / stiffness;
        let [x, y, z] = pull.direction.map(|c| c as f32).into();
        Self {
            direction: f32x4::from([x, y, z, 0.0]),
            filled: filled as f32,
            pulled: (share * pull.height) as f32,
            drawn: (share * filled) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of unit cells at height `height`, without the cells that `is_hole` names.
    fn sheet(height: f64, is_hole: impl Fn(u32, u32) -> bool) -> TriangleMesh {
        const SIDE: u32 = 20;
        let at = |x: u32, y: u32| y * (SIDE + 1) + x;
        let corners = (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| (x, y)));
        let positions = corners.map(|(x, y)| Point::new(f64::from(x), f64::from(y), height));
        let cells = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
        let faces = cells.filter(|&(x, y)| !is_hole(x, y)).flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        TriangleMesh::new(positions.collect(), faces.collect()).unwrap()
    }

    #[test]
    fn over_a_hole_a_sheet_follows_its_surroundings_and_not_the_rim() {
        let mut source = sheet(0.0, |_, _| false);
        let is_hole = |x, y| (8..11).contains(&x) && (8..11).contains(&y);
        let target = Target::new(&sheet(0.3, is_hole)).unwrap();
        let before = source.clone();
        let closest_to = |p: &Point| target.surface().closest(p);
        let mut closest: Vec<SurfacePoint> = source.positions().iter().map(closest_to).collect();
        let options = Options {
            rounds: 3,
            ..Options::default()
        };
        settle(&mut source, &mut closest, &target, &options);
        for (from, to) in before.positions().iter().zip(source.positions()) {
            let displacement = to - from;
            assert!(
                (displacement.z - 0.3).abs() < 0.06,
                "{from}: {displacement}"
            );
            assert!(displacement.xy().norm() < 0.02, "{from}: {displacement}");
        }
    }
}
