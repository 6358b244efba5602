//! Whether the registered previous frame is one of the same scene.

use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Point, TriangleMesh, Vector};

/// The frame is not a continuation of the one before: nothing is carried over.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "scene cut: {:.0} % of the previous frame, registered, and {:.0} % of this one have no \
     counterpart in the other",
    100.0 * of_previous,
    100.0 * of_current
)]
pub struct SceneCut {
    /// The share of the registered previous frame's faces without a counterpart, 0 to 1.
    pub of_previous: f64,
    /// The share of the current frame's.
    pub of_current: f64,
}

/// A frame whose faces may have counterparts in another one.
pub(super) struct Surface<'a> {
    /// Where it is.
    pub now: &'a TriangleTree,
    /// The same faces where they were captured: a deformation crumples what it cannot fit.
    pub captured: &'a TriangleMesh,
    /// For every vertex a face of the other frame that is near; empty if that is not known.
    pub near: &'a [u32],
}

/// A share from which on it is a cut. From frame to frame it is at most 0.03 on four captures and on
/// a synthetic figure three times as fast as natural, 0.05 over two frames, and 0.09 where noise is
/// as large as an edge; on another capture as it comes it is 0.71, on a figure that becomes a
/// sphere at least 0.47, on a part of the figure 0.19. See `docs/tracking.md`.
const MAX_SHARE: f64 = 0.12;

/// A counterpart is no further away than this share of the current frame's diagonal. Consecutive
/// frames of captures are that far apart where they move fastest.
const REACH: f64 = 0.02;

/// A counterpart faces the same way but for this angle: 60 degrees.
const MIN_COSINE: f64 = 0.5;

/// Where the vertex normals of a face, averaged, are shorter than this there is noise, and no
/// direction: distances alone count.
const MIN_COHERENCE: f64 = 0.85;

/// Faces looked at, at the most, on each side.
const MAX_SAMPLES: usize = 1000;

/// Compares both ways: a frame may be found in the other one and yet be a small part of it.
///
/// A registration bends whatever it is given onto whatever is there, so distances alone do not
/// tell: what was crumpled onto another figure faces all ways.
pub(super) fn scene_cut(
    previous: &Surface<'_>,
    current: &Surface<'_>,
    diagonal: f64,
) -> Option<SceneCut> {
    let reach = REACH * diagonal;
    let cut = SceneCut {
        of_previous: share_without(previous, current, reach),
        of_current: share_without(current, previous, reach),
    };
    (MAX_SHARE < cut.of_previous.max(cut.of_current)).then_some(cut)
}

/// The share of the faces of `from` that have no counterpart in `to`.
fn share_without(from: &Surface<'_>, to: &Surface<'_>, reach: f64) -> f64 {
    let mut last = 0;
    let has_none = |index: usize| {
        let [a, b, c] = from.now.mesh().triangle(index).map(|corner| corner.coords);
        let center = Point::from((a + b + c) / 3.0);
        let corner = from.now.mesh().faces()[index][0];
        let near = from.near.get(corner as usize).copied();
        let found = to.now.closest_from(&center, near.unwrap_or(last));
        last = found.face;
        let (here, there) = (index, found.face as usize);
        let is_smooth = MIN_COHERENCE <= mean_normal(from.captured, here).norm()
            && MIN_COHERENCE <= mean_normal(to.captured, there).norm();
        let (one, other) = (
            mean_normal(from.now.mesh(), here),
            mean_normal(to.now.mesh(), there),
        );
        let turned = one.dot(&other) < MIN_COSINE * one.norm() * other.norm();
        reach < found.distance || (is_smooth && turned)
    };
    share(samples(from.now.mesh()).map(has_none))
}

/// The faces that are looked at.
fn samples(mesh: &TriangleMesh) -> impl Iterator<Item = usize> {
    let stride = mesh.face_count().div_ceil(MAX_SAMPLES).max(1);
    (0..mesh.face_count()).step_by(stride)
}

/// The share of those that are true; 0 of none.
fn share(of: impl Iterator<Item = bool>) -> f64 {
    let (mut yes, mut count) = (0_usize, 0_usize);
    for is_true in of {
        yes += usize::from(is_true);
        count += 1;
    }
    yes as f64 / count.max(1) as f64
}

/// The mean of the normals of a face's vertices.
fn mean_normal(mesh: &TriangleMesh, face: usize) -> Vector {
    let normals = mesh.vertex_normals();
    let corners = mesh.faces()[face].iter();
    corners
        .map(|&corner| normals[corner as usize])
        .sum::<Vector>()
        / 3.0
}
