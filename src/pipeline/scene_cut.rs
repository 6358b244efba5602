//! Whether the registered previous frame is one of the same scene.

use steadymesh_geometry::mesh::vertex_normals;
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Face, Point, TriangleMesh, Vector};

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
    pub mesh: &'a TriangleMesh,
    /// The same faces where they were captured: a deformation crumples what it cannot fit.
    pub captured: &'a TriangleMesh,
    /// That of `mesh`.
    pub tree: &'a TriangleTree,
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
    let sides = [previous, current].map(Normals::of);
    let reach = REACH * diagonal;
    let cut = SceneCut {
        of_previous: share_without((previous, &sides[0]), (current, &sides[1]), reach),
        of_current: share_without((current, &sides[1]), (previous, &sides[0]), reach),
    };
    (MAX_SHARE < cut.of_previous.max(cut.of_current)).then_some(cut)
}

/// The vertex normals of a surface.
struct Normals {
    now: Vec<Vector>,
    captured: Vec<Vector>,
}

impl Normals {
    fn of(surface: &Surface<'_>) -> Self {
        Self {
            now: vertex_normals(surface.mesh),
            captured: vertex_normals(surface.captured),
        }
    }
}

/// The share of the faces of `from` that have no counterpart in `to`.
fn share_without(
    (from, normals): (&Surface<'_>, &Normals),
    (to, normals_there): (&Surface<'_>, &Normals),
    reach: f64,
) -> f64 {
    let has_none = |index: usize| {
        let [a, b, c] = from.mesh.triangle(index).map(|corner| corner.coords);
        let found = to.tree.closest(&Point::from((a + b + c) / 3.0));
        let (here, there) = (
            from.mesh.faces()[index],
            to.mesh.faces()[found.face as usize],
        );
        let is_smooth = MIN_COHERENCE <= mean(&normals.captured, here).norm()
            && MIN_COHERENCE <= mean(&normals_there.captured, there).norm();
        let (one, other) = (mean(&normals.now, here), mean(&normals_there.now, there));
        let turned = one.dot(&other) < MIN_COSINE * one.norm() * other.norm();
        reach < found.distance || (is_smooth && turned)
    };
    share(samples(from.mesh).map(has_none))
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

fn mean(normals: &[Vector], face: Face) -> Vector {
    face.iter()
        .map(|&corner| normals[corner as usize])
        .sum::<Vector>()
        / 3.0
}
