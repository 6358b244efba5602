//! Points spread evenly over a surface.

use crate::{Point, TriangleMesh};

/// A point on a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceSample {
    /// Where it is.
    pub position: Point,
    /// The index of the face that it is on.
    pub face: usize,
}

/// `count` points on `mesh`, as dense everywhere as anywhere else; none if it has no area.
///
/// Equal meshes give equal points: the i-th lies where the running sum of the face areas passes
/// (i + ½) / `count` of the total, so that no face has more than one point too many or too few,
/// and within its face at the i-th point of the R₂ low-discrepancy sequence.
///
/// # Source
///
/// The map from the unit square to a triangle is Eq. 1 of Osada et al., "Shape Distributions",
/// ACM TOG 21(4), 2002, <https://doi.org/10.1145/571647.571648>; the sequence is Roberts, "The
/// Unreasonable Effectiveness of Quasirandom Sequences", 2018.
#[must_use]
pub fn surface_samples(mesh: &TriangleMesh, count: usize) -> Vec<SurfaceSample> {
    let areas: Vec<f64> = (0..mesh.face_count())
        .map(|face| area(mesh.triangle(face)))
        .collect();
    let total: f64 = areas.iter().sum();
    let mut samples = Vec::with_capacity(count);
    let mut passed = 0.0;
    for (face, area) in areas.iter().enumerate() {
        passed += area;
        // The comparison is never true for a total of 0 or one that is not a number.
        while samples.len() < count && (samples.len() as f64 + 0.5) * total < passed * count as f64
        {
            let position = on_triangle(mesh.triangle(face), r2(samples.len()));
            samples.push(SurfaceSample { position, face });
        }
    }
    samples
}

fn area([a, b, c]: [Point; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// Maps the unit square onto a triangle, equal areas onto equal areas.
fn on_triangle([a, b, c]: [Point; 3], [u, v]: [f64; 2]) -> Point {
    let root = u.sqrt();
    let (of_b, of_c) = (root * (1.0 - v), root * v);
    a + (b - a) * of_b + (c - a) * of_c
}

/// The powers of 1/ρ, where ρ is the real root of ρ³ = ρ + 1.
const R2_STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];

fn r2(index: usize) -> [f64; 2] {
    R2_STEPS.map(|step| (0.5 + step * index as f64).fract())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rectangle from (0, 0) to (4, 1) in three faces of very different size.
    fn rectangle() -> TriangleMesh {
        let corners = [[0., 0.], [4., 0.], [4., 1.], [0., 1.], [0.5, 1.]];
        let positions = corners.map(|[x, y]| Point::new(x, y, 0.0)).to_vec();
        TriangleMesh::new(positions, vec![[0, 1, 4], [1, 2, 4], [0, 4, 3]]).unwrap()
    }

    #[test]
    fn every_part_of_a_surface_gets_its_share_whatever_the_faces() {
        let samples = surface_samples(&rectangle(), 20_000);
        assert_eq!(samples.len(), 20_000);
        let positions: Vec<Point> = samples.iter().map(|sample| sample.position).collect();
        for (column, row) in [(0, 0), (1, 1), (2, 0), (3, 1)] {
            let inside = positions.iter().filter(|p| {
                (p.x as usize).min(3) == column && (2.0 * p.y) as usize == row && p.z == 0.0
            });
            let share = inside.count() as f64 / samples.len() as f64;
            // A random draw would be off by 0.0023 (one standard deviation).
            assert!((share - 0.125).abs() < 0.001, "{column} {row}: {share}");
        }
    }

    #[test]
    fn the_mean_over_the_samples_is_the_integral_over_the_surface() {
        let samples = surface_samples(&rectangle(), 20_000);
        let positions = samples.iter().map(|sample| sample.position);
        let positions: Vec<Point> = positions.collect();
        let mean = |of: fn(&Point) -> f64| positions.iter().map(of).sum::<f64>() / 20_000.0;
        assert!((mean(|p| p.x) - 2.0).abs() < 1e-3);
        assert!((mean(|p| p.x * p.x) - 16.0 / 3.0).abs() < 4e-3);
        assert!((mean(|p| p.y) - 0.5).abs() < 1e-3);
    }

    #[test]
    fn a_surface_without_area_has_no_samples() {
        let mesh = TriangleMesh::new(vec![Point::origin(); 3], vec![[0, 1, 2]]).unwrap();
        assert!(surface_samples(&mesh, 100).is_empty());
    }

    #[test]
    fn a_sample_is_on_the_face_that_it_names() {
        let mesh = rectangle();
        for sample in surface_samples(&mesh, 1000) {
            let [a, b, c] = mesh.triangle(sample.face);
            let area = |a: Point, b: Point, c: Point| area([a, b, c]);
            let p = sample.position;
            let parts = area(a, b, p) + area(b, c, p) + area(c, a, p);
            assert!((parts - area(a, b, c)).abs() < 1e-12);
        }
    }
}
