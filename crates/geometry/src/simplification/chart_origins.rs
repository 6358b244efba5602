//! The charts of a mesh that was simplified without regard to seams.

use crate::mesh::Wedges;
use crate::spatial::TriangleTree;
use crate::{Point, TriangleMesh};

use super::SurfaceOrigin;
use super::surface_origins::Closest;

/// The wedges of `simplified`, and for each of them where on the surface it was made of its
/// attributes come from. `wedges` are those of that surface's mesh.
///
/// Every face belongs to the chart that is closest to its center, and takes its attributes from that
/// chart alone, so that none lies on two of them; where two faces of different charts meet there is a
/// seam. It runs along edges of the result, not where the original has it: beyond its own border
/// a chart goes on with its last texels. In return the surface is as close as it can be.
#[must_use]
pub fn chart_origins(
    (surface, wedges): (&TriangleTree, &Wedges),
    simplified: &TriangleMesh,
) -> (Wedges, Vec<SurfaceOrigin>) {
    let original = surface.mesh();
    let charts = Charts::of(wedges);
    let center = |[a, b, c]: [Point; 3]| Point::from((a.coords + b.coords + c.coords) / 3.0);
    let faces = 0..simplified.face_count();
    // For every face of the result, the one of the original below its center.
    let below: Vec<u32> = faces
        .map(|face| surface.closest(&center(simplified.triangle(face))).face)
        .collect();
    let split = Wedges::by_key(simplified, |face, _| charts.chart_of(below[face]));
    let targets: Vec<Point> = split
        .vertices()
        .iter()
        .map(|&vertex| simplified.positions()[vertex as usize])
        .collect();
    let mut found = vec![Closest::NONE; targets.len()];
    for (corners, &face) in split.corners().iter().zip(&below) {
        for &wedge in corners {
            let wedge = wedge as usize;
            found[wedge].consider(original, face, &targets[wedge]);
        }
    }
    let closest = found.iter_mut().zip(&targets);
    let origins = closest.map(|(closest, target)| {
        let straight = surface.closest(target).face;
        if charts.chart_of(straight) == charts.chart_of(closest.face) {
            closest.consider(original, straight, target);
        } else {
            closest.walk(original, wedges, target);
        }
        SurfaceOrigin::below(original, closest.face, target)
    });
    let origins = origins.collect();
    (split, origins)
}

/// Which faces hang together without crossing a seam.
struct Charts {
    /// By face.
    numbers: Vec<u32>,
}

impl Charts {
    fn of(wedges: &Wedges) -> Self {
        let mut sets: Vec<u32> = (0..wedges.count() as u32).collect();
        for &[a, b, c] in wedges.corners() {
            let first = root(&mut sets, a);
            for wedge in [b, c] {
                let other = root(&mut sets, wedge);
                // The lower one, whatever the order.
                let (low, high) = (first.min(other), first.max(other));
                let low = root(&mut sets, low);
                sets[high as usize] = low;
            }
        }
        let numbers = wedges.corners().iter();
        let numbers = numbers.map(|corners| root(&mut sets, corners[0]));
        Self {
            numbers: numbers.collect(),
        }
    }

    fn chart_of(&self, face: u32) -> u32 {
        self.numbers[face as usize]
    }
}

/// The lowest wedge of a set; the way there is made shorter.
fn root(sets: &mut [u32], mut wedge: u32) -> u32 {
    while sets[wedge as usize] != wedge {
        let above = sets[sets[wedge as usize] as usize];
        sets[wedge as usize] = above;
        wedge = above;
    }
    wedge
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of two quads over the same four-by-two points, cut in the middle.
    fn strip() -> (TriangleMesh, Wedges) {
        let positions = [
            [0.0, 0.0],
            [1.0, 0.0],
            [2.0, 0.0],
            [0.0, 1.0],
            [1.0, 1.0],
            [2.0, 1.0],
        ];
        let positions = positions.map(|[x, y]| Point::new(x, y, 0.0)).to_vec();
        let faces = vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]];
        let mesh = TriangleMesh::new(positions, faces).unwrap();
        let wedges = Wedges::by_key(&mesh, |face, _| face / 2);
        (mesh, wedges)
    }

    #[test]
    fn faces_that_share_wedges_are_one_chart() {
        let charts = Charts::of(&strip().1);
        assert_eq!(charts.chart_of(0), charts.chart_of(1));
        assert_eq!(charts.chart_of(2), charts.chart_of(3));
        assert_ne!(charts.chart_of(0), charts.chart_of(2));
    }

    #[test]
    fn a_face_across_a_seam_stays_on_one_side_of_it() {
        let (original, wedges) = strip();
        let tree = TriangleTree::new(&original).unwrap();
        // Its seam is at x = 1.5, where the original's is at 1.
        let positions = [
            [0.0, 0.0],
            [1.5, 0.0],
            [2.0, 0.0],
            [0.0, 1.0],
            [1.5, 1.0],
            [2.0, 1.0],
        ];
        let positions = positions.map(|[x, y]| Point::new(x, y, 0.0)).to_vec();
        let simplified = TriangleMesh::new(positions, original.faces().to_vec()).unwrap();
        let (split, origins) = chart_origins((&tree, &wedges), &simplified);
        // The two in the middle have one for each side.
        assert_eq!(split.count(), 8);
        for (face, corners) in split.corners().iter().enumerate() {
            for (&wedge, &vertex) in corners.iter().zip(&simplified.faces()[face]) {
                let origin = &origins[wedge as usize];
                assert_eq!(origin.face / 2, face as u32 / 2, "face {face}");
                let triangle = original.triangle(origin.face as usize);
                let x: f64 = (0..3).map(|i| origin.weights[i] * triangle[i].x).sum();
                let own = simplified.positions()[vertex as usize].x;
                let expected = if face < 2 { own.min(1.0) } else { own.max(1.0) };
                assert!((x - expected).abs() < 1e-9, "face {face}: {x} for {own}");
            }
        }
    }
}
