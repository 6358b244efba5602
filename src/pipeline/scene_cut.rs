//! Whether the registered previous frame is one of the same scene.

use steadymesh_geometry::mesh::vertex_normals;
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Face, Point, TriangleMesh, Vector};

/// The frame is not a continuation of the one before: nothing is carried over.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "scene cut: {:.0} % of the previous frame, registered, and {:.0} % of this one have no \
     counterpart in the other, and {:.0} % of its edges had to be stretched or shrunk",
    100.0 * of_previous,
    100.0 * of_current,
    100.0 * of_edges
)]
pub struct SceneCut {
    /// The share of the registered previous frame's faces without a counterpart, 0 to 1.
    pub of_previous: f64,
    /// The share of the current frame's.
    pub of_current: f64,
    /// The share of the previous frame's edges whose length is another one now.
    pub of_edges: f64,
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

/// A share from which on it is a cut. On four captures and a synthetic figure three times as fast
/// as natural it is at most 0.13 from frame to frame, and 0.20 over five frames of fast play; on
/// another capture as it comes it is 0.46, on a figure that becomes a sphere at least 0.25, on a
/// distorted mirror image 0.78.
/// See `docs/tracking.md`.
const MAX_SHARE: f64 = 0.23;

/// The same for edges. It is at most 0.15 over up to five frames of captures and on the fast
/// figure, and 0.26 where noise is twice as large as an edge; a sphere that became a figure and
/// left nothing over has 0.57.
const MAX_EDGES: f64 = 0.35;

/// An edge that has become so many times longer or shorter has another length: e to the power of
/// 0.4.
const STRETCH: f64 = 1.49;

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
/// tell: what was crumpled onto another figure faces all ways, or had to be stretched.
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
        of_edges: share_stretched(previous),
    };
    let is_cut = MAX_SHARE < cut.of_previous.max(cut.of_current) || MAX_EDGES < cut.of_edges;
    is_cut.then_some(cut)
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

/// The share of the edges that have another length than they were captured with.
fn share_stretched(surface: &Surface<'_>) -> f64 {
    let corners = samples(surface.mesh).flat_map(|index| [0, 1, 2].map(|corner| (index, corner)));
    share(corners.map(|(index, corner)| {
        let length = |mesh: &TriangleMesh| {
            let triangle = mesh.triangle(index);
            (triangle[corner] - triangle[(corner + 1) % 3]).norm()
        };
        let (now, captured) = (length(surface.mesh), length(surface.captured));
        STRETCH * captured < now || STRETCH * now < captured
    }))
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
