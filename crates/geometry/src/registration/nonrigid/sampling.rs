//! The source vertices that look for correspondences.

use crate::{TriangleMesh, Vector};

use super::energy::{Problem, Samples, Weights};
use super::{DeformationGraph, Options};

/// An even choice of the source's vertices.
pub(super) struct Sampling<'a> {
    graph: &'a DeformationGraph,
    vertex_count: usize,
    /// Ascending.
    pub vertices: Vec<usize>,
    pub samples: Samples,
    /// Of unit length.
    pub normals: Vec<Vector>,
}

impl<'a> Sampling<'a> {
    /// At most `count` samples, evenly strided; `normals` are those of all vertices.
    pub fn new(
        source: &TriangleMesh,
        normals: &[Vector],
        graph: &'a DeformationGraph,
        count: usize,
    ) -> Self {
        let vertex_count = source.vertex_count();
        let count = count.clamp(1, vertex_count);
        let vertices: Vec<usize> = (0..count).map(|i| i * vertex_count / count).collect();
        Self {
            graph,
            vertex_count,
            samples: Samples::new(graph, source, vertices.iter().copied()),
            normals: vertices.iter().map(|&v| normals[v]).collect(),
            vertices,
        }
    }

    /// The least-squares problem over these samples.
    ///
    /// α and β are per term, so that neither the number of samples nor that of nodes shifts the
    /// balance.
    pub fn problem(&self, options: &Options) -> Problem<'_> {
        let per = |count: usize| self.samples.len() as f64 / count.max(1) as f64;
        Problem {
            graph: self.graph,
            samples: &self.samples,
            weights: Weights {
                smoothness: options.smoothness_weight * per(2 * self.graph.edges().len()),
                rotation: options.rotation_weight * per(self.graph.nodes().len()),
            },
        }
    }

    /// For every sample of `other` the face of the sample here whose number is nearest: vertices
    /// with near numbers are often near each other.
    pub fn guesses_for(&self, other: &Sampling<'_>, faces: &[u32]) -> Vec<u32> {
        let nearest = |vertex: &usize| faces[vertex * faces.len() / self.vertex_count];
        other.vertices.iter().map(nearest).collect()
    }
}
