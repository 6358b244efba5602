//! Everything that is measured between one result and the two frames it stands between.

use steadymesh_geometry::metrics::{
    OrientedPoints, PointErrors, point_errors, psnr, surface_distances, surface_samples,
    vertex_distances,
};
use steadymesh_geometry::spatial::{TriangleTree, VertexTree};
use steadymesh_geometry::{Point, TriangleMesh};

use super::results::{ByError, ByFrame, ByMeasure, Directions, Measure, Psnr};

/// Samples of a result's surface that distances are measured from.
const SAMPLE_COUNT: usize = 20_000;
/// Samples of each surface as point clouds: as dense as captures are, and more.
const CLOUD_SAMPLE_COUNT: usize = 100_000;

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

/// The distances of one result, one by one.
pub(super) type Distances = ByMeasure<ByFrame<Vec<f64>>>;

/// All distances between `output` and the `references`; none if it has no faces.
pub(super) fn measure(
    output: &TriangleMesh,
    references: &ByFrame<Reference<'_>>,
) -> Option<Distances> {
    let surface = TriangleTree::new(output)?;
    let samples = surface_samples(output, SAMPLE_COUNT);
    let samples: Vec<Point> = samples.iter().map(|sample| sample.position).collect();
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

/// The largest distance between the result and frame k, in either direction.
pub(super) fn hausdorff(distances: &Distances) -> f64 {
    [Measure::Surface, Measure::Sample, Measure::ToOutput]
        .into_iter()
        .flat_map(|measure| &distances.get(measure).current)
        .copied()
        .fold(0.0, f64::max)
}

/// A mesh as point clouds.
pub(super) struct Clouds {
    vertices: OrientedPoints,
    samples: OrientedPoints,
}

impl Clouds {
    /// Prepares `mesh`; none if it has no area.
    pub fn new(mesh: &TriangleMesh) -> Option<Self> {
        Some(Self {
            vertices: OrientedPoints::vertices_of(mesh)?,
            samples: OrientedPoints::samples_of(mesh, CLOUD_SAMPLE_COUNT)?,
        })
    }

    /// The errors of `output`, which stands for this frame, in dB below `peak`.
    pub fn psnr(&self, output: &Self, peak: f64) -> Psnr {
        Psnr {
            vertices: by_error(&self.vertices, &output.vertices, peak),
            samples: by_error(&self.samples, &output.samples, peak),
        }
    }
}

fn by_error(original: &OrientedPoints, output: &OrientedPoints, peak: f64) -> ByError {
    let (there, back) = (
        point_errors(original, output),
        point_errors(output, original),
    );
    let decibels = |of: fn(&PointErrors) -> f64| Directions {
        worse: psnr(of(&there).max(of(&back)), peak),
        better: psnr(of(&there).min(of(&back)), peak),
    };
    ByError {
        d1: decibels(|errors| errors.d1),
        d2: decibels(|errors| errors.d2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worse_direction_is_the_worse_one_whichever_mesh_is_the_original() {
        let with = |corners: &[[f64; 3]], faces: &[[u32; 3]]| {
            let positions = corners.iter().copied().map(Point::from).collect();
            TriangleMesh::new(positions, faces.to_vec()).unwrap()
        };
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 4., 1.]];
        let small = with(&corners[..3], &[[0, 1, 2]]);
        let large = with(&corners, &[[0, 1, 2], [1, 3, 2]]);
        let [small, large] = [&small, &large].map(|mesh| Clouds::new(mesh).unwrap());
        let found = large.psnr(&small, 1.0);
        assert_eq!(found, small.psnr(&large, 1.0));
        // The corner that only the large one has is √10 from the nearest of the small one.
        let d1 = found.vertices.d1;
        assert!((d1.worse.unwrap() - 10.0 * (4.0_f64 / 10.0).log10()).abs() < 1e-9);
        assert_eq!(d1.better, None);
    }
}
