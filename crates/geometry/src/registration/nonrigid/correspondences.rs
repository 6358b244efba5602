//! Where each sample wants to go.

use crate::registration::Target;
use crate::{Point, Vector};

use super::NodeTransforms;
use super::energy::{Sample, affine_part};

/// Beyond this many ν_a the weight of a pair is below 4e-6, and it is left out.
const REACH_IN_SCALES: f64 = 5.0;

/// What a pair of points must fulfil to correspond.
pub(super) struct Acceptance {
    /// ν_a, in the mesh's unit.
    pub scale: f64,
    /// The cosine of the largest angle between the normals.
    pub min_normal_cosine: f64,
}

/// The search for correspondences, which remembers where it found the last ones.
pub(super) struct Search<'a> {
    pub samples: &'a [Sample],
    pub normals: &'a [Vector],
    pub target: &'a Target,
    /// For every sample the face it was closest to last.
    pub last_faces: Vec<u32>,
}

impl Search<'_> {
    /// u_ρ(i) of Eq. 3: the closest point of the target's surface to each deformed sample.
    ///
    /// The paper takes the closest vertex. The closest point of the surface is what the vertices
    /// sample; with it a sample may slide along the surface, which halves the residual. `None`
    /// where nothing is in reach, where the sample belongs to no node, or where the normals say
    /// that it is another side of the body.
    pub fn find(
        &mut self,
        transforms: &NodeTransforms,
        acceptance: &Acceptance,
    ) -> Vec<Option<Point>> {
        let reach = REACH_IN_SCALES * acceptance.scale;
        self.samples
            .iter()
            .zip(self.normals)
            .zip(&mut self.last_faces)
            .map(|((sample, normal), last_face)| {
                if sample.basis.is_empty() {
                    return None;
                }
                let deformed = sample.deformed(transforms);
                let (surface, surface_normal) = self.target.closest_from(&deformed, *last_face);
                *last_face = surface.face;
                let turned = turned_normal(sample, normal, transforms);
                let agree = acceptance.min_normal_cosine <= turned.dot(&surface_normal);
                (agree && surface.distance < reach).then_some(surface.position)
            })
            .collect()
    }
}

/// The normal of a deformed sample: its own, turned by the nodes' affine maps, which are close
/// to rotations.
fn turned_normal(sample: &Sample, normal: &Vector, transforms: &NodeTransforms) -> Vector {
    let turned: Vector = sample
        .basis
        .iter()
        // The last entry of a basis is the node's weight.
        .map(|(node, basis)| affine_part(&transforms[*node as usize]) * normal * basis[3])
        .sum();
    turned.try_normalize(0.0).unwrap_or(*normal)
}
