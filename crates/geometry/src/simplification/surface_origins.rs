//! Where on the original surface the attributes of a simplified mesh come from.

use crate::mesh::Wedges;
use crate::spatial::{barycentric, closest_point_on_triangle};
use crate::{Point, TriangleMesh};

use super::{NO_WEDGE, Simplified};

/// A point of the original surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceOrigin {
    /// The face of the original.
    pub face: u32,
    /// The weights of its corners, from 0 to 1; their sum is 1.
    pub weights: [f64; 3],
}

/// For every wedge of the simplified mesh, the closest point of its own part of `original`: the
/// faces of the wedges that have gone into it, and what can be reached from there without crossing
/// a seam while that comes closer. So the two sides of a seam each stay on theirs, and so do parts of
/// the surface that come near each other.
///
/// Empty if `original` has no wedges.
#[must_use]
pub fn surface_origins(original: &TriangleMesh, simplified: &Simplified) -> Vec<SurfaceOrigin> {
    let (Some(from), Some(to)) = (original.wedges(), simplified.mesh.wedges()) else {
        return Vec::new();
    };
    let targets: Vec<Point> = to
        .vertices()
        .iter()
        .map(|&vertex| simplified.mesh.positions()[vertex as usize])
        .collect();
    let mut found = closest_own_faces(original, (from, &simplified.merged_wedges), &targets);
    for (closest, target) in found.iter_mut().zip(&targets) {
        closest.walk(original, from, target);
    }
    let found = found.iter().zip(&targets);
    let origins =
        found.map(|(closest, target)| SurfaceOrigin::below(original, closest.face, target));
    origins.collect()
}

impl SurfaceOrigin {
    /// The point of face `face` of `original` that is closest to `target`.
    pub(super) fn below(original: &TriangleMesh, face: u32, target: &Point) -> Self {
        let triangle = original.triangle(face as usize);
        let point = closest_point_on_triangle(target, &triangle);
        Self {
            face,
            weights: within(barycentric(&point, &triangle)),
        }
    }
}

/// The closest face so far.
#[derive(Clone, Copy)]
pub(super) struct Closest {
    pub face: u32,
    square: f64,
}

/// A walk ends after so many steps; few take more than three.
const MAX_STEPS: usize = 64;

impl Closest {
    /// Nothing yet.
    pub const NONE: Self = Self {
        face: 0,
        square: f64::INFINITY,
    };

    /// Goes from face to face of one chart as long as that comes closer.
    pub fn walk(&mut self, original: &TriangleMesh, wedges: &Wedges, target: &Point) {
        for _ in 0..MAX_STEPS {
            let here = self.face;
            let corners = wedges.corners()[here as usize];
            for (vertex, wedge) in original.faces()[here as usize].into_iter().zip(corners) {
                for &face in original.vertex_faces().row(vertex as usize) {
                    if wedges.corners()[face as usize].contains(&wedge) {
                        self.consider(original, face, target);
                    }
                }
            }
            if self.face == here {
                return;
            }
        }
    }

    /// Takes a face if it is closer.
    pub fn consider(&mut self, original: &TriangleMesh, face: u32, target: &Point) {
        let point = closest_point_on_triangle(target, &original.triangle(face as usize));
        let square = (point - target).norm_squared();
        if square < self.square {
            *self = Self { face, square };
        }
    }
}

/// For every target, the closest of the faces that have a corner that went into its wedge.
fn closest_own_faces(
    original: &TriangleMesh,
    (wedges, merged): (&Wedges, &[u32]),
    targets: &[Point],
) -> Vec<Closest> {
    let mut found = vec![Closest::NONE; targets.len()];
    for (corners, face) in wedges.corners().iter().zip(0..) {
        let [a, b, c] = corners.map(|wedge| merged[wedge as usize]);
        let mut consider = |wedge: u32| {
            if wedge != NO_WEDGE {
                let wedge = wedge as usize;
                found[wedge].consider(original, face, &targets[wedge]);
            }
        };
        consider(a);
        if b != a {
            consider(b);
        }
        if c != a && c != b {
            consider(c);
        }
    }
    found
}

/// Rounding may take weights a little out of their range.
fn within(weights: [f64; 3]) -> [f64; 3] {
    let weights = weights.map(|weight| weight.clamp(0.0, 1.0));
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}
