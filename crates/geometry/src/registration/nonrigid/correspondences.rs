//! Where each sample wants to go.

use crate::registration::Target;
use crate::spatial::SurfacePoint;
use crate::{Point, Vector};

use super::NodeTransforms;
use super::energy::{Correspondence, Samples, affine_part};

/// Beyond this many ν_a the weight of a pair is below 4e-6, and it is left out.
const REACH_IN_SCALES: f64 = 5.0;

/// What a pair of points must fulfil to correspond.
pub(super) struct Acceptance {
    /// ν_a, in the mesh's unit.
    pub scale: f64,
    /// The cosine of the largest angle between the normals.
    pub min_normal_cosine: f64,
    /// The cosine of the largest angle between the sample's normal and the way to its
    /// counterpart, either way along it.
    pub min_offset_cosine: f64,
    /// Whether a sample that is still above the face where it was found last stays with it,
    /// without looking for a closer one.
    pub trust_last_faces: bool,
}

/// The search for correspondences, which remembers where it found the last ones.
pub(super) struct Search<'a> {
    pub samples: &'a Samples,
    pub normals: &'a [Vector],
    pub target: &'a Target,
    /// For every sample the face it was closest to last.
    pub last_faces: Vec<u32>,
}

impl Search<'_> {
    /// u_ρ(i) of Eq. 3: the closest point of the target's surface to each deformed sample, and
    /// the surface's normal there.
    ///
    /// The paper takes the closest vertex. The closest point of the surface is what the vertices
    /// sample; with it a sample may slide along the surface, which halves the residual. `None`
    /// where nothing is in reach, where the sample belongs to no node, or where the normals say
    /// that it is another side of the body.
    pub fn find(
        &mut self,
        deformed: &[Point],
        transforms: &NodeTransforms,
        acceptance: &Acceptance,
    ) -> Vec<Option<Correspondence>> {
        (0..self.samples.len())
            .map(|sample| self.find_one(sample, &deformed[sample], transforms, acceptance))
            .collect()
    }

    fn find_one(
        &mut self,
        sample: usize,
        deformed: &Point,
        transforms: &NodeTransforms,
        acceptance: &Acceptance,
    ) -> Option<Correspondence> {
        if self.samples.basis(sample).is_empty() {
            return None;
        }
        let surface = self.closest(sample, deformed, acceptance.trust_last_faces);
        self.last_faces[sample] = surface.face;
        let face_normal = self.target.normal(surface.face);
        let normal = normal_at(&surface, deformed, face_normal, self.target.mean_edge());
        let turned = self.turned_normal(sample, transforms);
        let agree = acceptance.min_normal_cosine <= turned.dot(&face_normal);
        // Beside the sample and not above or below it: over a hole that is the hole's rim.
        let beside = next_to(self.target.mean_edge()) < surface.distance
            && turned.dot(&normal).abs() < acceptance.min_offset_cosine;
        let in_reach = surface.distance < REACH_IN_SCALES * acceptance.scale;
        (agree && !beside && in_reach).then_some(Correspondence {
            position: surface.position,
            normal,
        })
    }

    /// The closest point of the surface; or, if the last face may be trusted, one near it that is
    /// straight below the sample.
    fn closest(&self, sample: usize, deformed: &Point, trust: bool) -> SurfacePoint {
        let (surface, last) = (self.target.surface(), self.last_faces[sample]);
        if !trust {
            return surface.closest_from(deformed, last);
        }
        surface
            .straight_below(deformed, last)
            .unwrap_or_else(|| self.target.closest_near(deformed, last, f64::INFINITY))
    }

    /// The normal of a deformed sample: its own, turned by the nodes' affine maps, which are
    /// close to rotations.
    fn turned_normal(&self, sample: usize, transforms: &NodeTransforms) -> Vector {
        let normal = &self.normals[sample];
        let mut turned = Vector::zeros();
        for (node, basis) in self.samples.basis(sample) {
            // The last entry of a basis is the node's weight.
            turned += affine_part(&transforms[*node as usize]) * normal * basis[3];
        }
        turned.try_normalize(0.0).unwrap_or(*normal)
    }
}

/// Below this distance rounding decides where a closest point is.
fn next_to(mean_edge: f64) -> f64 {
    1e-6 * mean_edge
}

/// The direction to the closest point: the face's normal but where that point is on an edge or a
/// corner. Next to the surface rounding would decide it, and the face does.
fn normal_at(surface: &SurfacePoint, query: &Point, face_normal: Vector, mean_edge: f64) -> Vector {
    if surface.distance <= next_to(mean_edge) {
        return face_normal;
    }
    (query - surface.position) / surface.distance
}
