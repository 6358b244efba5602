//! The distances between one result and the two frames it stands between.

use steadymesh_geometry::metrics::{surface_distances, vertex_distances};
use steadymesh_geometry::spatial::{TriangleTree, VertexTree};
use steadymesh_geometry::{Point, TriangleMesh};

use super::results::{ByFrame, ByMeasure, Measure};
use super::surface_samples::surface_samples;

/// Samples of a result's surface.
const SAMPLE_COUNT: usize = 20_000;

/// A frame that results are measured against.
pub(super) struct Reference<'a> {
    vertices: &'a [Point],
    surface: TriangleTree,
    vertex_tree: VertexTree,
}

impl<'a> Reference<'a> {
    /// Prepares `mesh`; none if it has no faces.
    pub fn new(mesh: &'a TriangleMesh) -> Option<Self> {
        Some(Self {
            vertices: mesh.positions(),
            surface: TriangleTree::new(mesh)?,
            vertex_tree: VertexTree::new(mesh.positions())?,
        })
    }
}

/// All distances between `output` and the `references`; none if it has no faces.
pub(super) fn measure(
    output: &TriangleMesh,
    references: &ByFrame<Reference<'_>>,
) -> Option<ByMeasure<ByFrame<Vec<f64>>>> {
    let surface = TriangleTree::new(output)?;
    let samples = surface_samples(output, SAMPLE_COUNT);
    let vertices = output.positions();
    Some(ByMeasure::from_fn(|measure| {
        references.map(|reference| match measure {
            Measure::Surface => surface_distances(vertices, &reference.surface),
            Measure::Vertex => vertex_distances(vertices, &reference.vertex_tree),
            Measure::Sample => surface_distances(&samples, &reference.surface),
            Measure::ToOutput => surface_distances(reference.vertices, &surface),
        })
    }))
}
