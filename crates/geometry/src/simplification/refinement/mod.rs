//! What collapsing edges leaves undone: the previous result's edges are flipped back where that
//! costs little, and the vertices are fitted to the mesh that was simplified.
//!
//! - `samples`: the mesh that was simplified, as points on the faces of the simplified one.
//! - `edges`: which edges may be flipped, and flipping them.
//! - `restore`: flips back what was there before.
//! - `fit`: moves the vertices.

mod edges;
mod fit;
mod restore;
mod samples;

use crate::mesh::Wedges;
use crate::spatial::TriangleTree;
use crate::{Face, Point, TriangleMesh};

use edges::FlippableFaces;
use samples::Samples;

/// How a simplified mesh is refined.
///
/// Weights are relative to the samples that each vertex has of its own, on the average.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// By how much an edge of the previous result that is flipped back may raise the mean square
    /// distance of the samples at its faces, relative to the mean over the whole mesh.
    pub flip_tolerance: f64,
    /// Weight of each vertex's own distance to the surface. Without it vertices leave convex
    /// surfaces outwards, so that the faces between them fit better.
    pub surface_weight: f64,
    /// What is added to that, in samples: where a vertex has few of its own, they are all at
    /// vertices of the original and know little of the surface between them.
    pub surface_samples: f64,
    /// Weight along the surface towards where edge collapse had put the vertex.
    pub hold: f64,
    /// Weight along the surface towards the anchor that the vertex kept.
    pub anchor_hold: f64,
    /// Weight along the surface towards the mean of the neighbors: even meshes compress better.
    pub smoothing: f64,
    /// Weight along the surface towards the nearest vertex of the mesh that was simplified.
    pub vertex_pull: f64,
    /// How far vertices go towards where they fit best, 0 to 1.
    pub step: f64,
    /// Times that every vertex is moved to its optimum with the others at rest.
    pub sweeps: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            flip_tolerance: 0.1,
            surface_weight: 0.65,
            surface_samples: 1.15,
            hold: 0.1,
            anchor_hold: 0.05,
            smoothing: 0.025,
            vertex_pull: 0.03,
            step: 1.0,
            sweeps: 4,
        }
    }
}

impl Options {
    /// These options with only a share of what is done, 0 to 1.
    pub(super) fn scaled(&self, share: f64) -> Self {
        Self {
            flip_tolerance: share * self.flip_tolerance,
            anchor_hold: share * self.anchor_hold,
            step: share * self.step,
            ..self.clone()
        }
    }
}

/// An anchor that a vertex of the simplified mesh kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Kept {
    /// Where the previous result had a vertex, carried along onto the surface.
    pub position: Point,
    /// The face of the original mesh on which that is.
    pub face: u32,
    /// How well it fits, above 0 and at most 1.
    pub fit: f64,
    /// Its vertex in the previous result.
    pub vertex: u32,
}

/// Refines `simplified`, which was made of the mesh of `surface`.
///
/// `kept` has the anchor of each vertex of `simplified`, and `previous_faces` are those of the
/// mesh that the anchors come from. The number of faces and vertices stays, and so do the
/// vertices of boundaries.
pub(super) fn refine(
    simplified: TriangleMesh,
    surface: &TriangleTree,
    (kept, previous_faces): (&[Option<Kept>], &[Face]),
    options: &Options,
) -> TriangleMesh {
    let Some(mut samples) = Samples::new(surface.mesh(), &simplified) else {
        return simplified;
    };
    let positions = simplified.positions().to_vec();
    let mut faces = FlippableFaces::new(&simplified);
    restore::restore_edges(
        &mut faces,
        (&positions, &mut samples),
        &restore::previous_edges(kept, previous_faces),
        options.flip_tolerance,
    );
    let (faces, wedges) = faces.into_parts();
    let flipped = TriangleMesh::from_valid(positions, faces);
    let fitted = fit::fit(&flipped, surface, (&samples, kept), options);
    match (wedges, simplified.wedges()) {
        (Some(corners), Some(before)) => {
            fitted.with_wedges(Wedges::from_valid(corners, before.vertices().to_vec()))
        }
        _ => fitted,
    }
}
