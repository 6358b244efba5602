//! Flips back the edges of the previous result.

use crate::mesh::{Edge, face_normal};
use crate::{Face, Point, Vector};

use super::Kept;
use super::edges::{FlippableFaces, Quad};
use super::samples::Samples;

/// The edges of the previous result between vertices that are still there, by the numbers that
/// these have now, ascending.
pub(super) fn previous_edges(kept: &[Option<Kept>], previous_faces: &[Face]) -> Vec<Edge> {
    let corners = previous_faces.iter().flatten();
    let Some(last) = corners.max() else {
        return Vec::new();
    };
    let mut numbers = vec![None; *last as usize + 1];
    for (number, kept) in kept.iter().enumerate() {
        if let Some(place) = kept.and_then(|kept| numbers.get_mut(kept.vertex as usize)) {
            *place = Some(number as u32);
        }
    }
    let now = |edge: Edge| {
        let (a, b) = (numbers[edge.0 as usize]?, numbers[edge.1 as usize]?);
        Some(Edge::new(a, b))
    };
    let edges = previous_faces.iter().flat_map(|face| Edge::of_face(*face));
    // In one word each: those are compared in half the time.
    let word = |Edge(a, b)| u64::from(a) << 32 | u64::from(b);
    let mut words: Vec<u64> = edges.filter_map(now).map(word).collect();
    words.sort_unstable();
    words.dedup();
    let edge = |word: u64| Edge((word >> 32) as u32, word as u32);
    words.into_iter().map(edge).collect()
}

/// A flip may make way for the next one.
const PASSES: usize = 2;

/// Flips edges that are not `wanted` to ones that are, where the surface stays as close to its
/// samples: no further than by `tolerance` of the mean square distance, for each of them.
pub(super) fn restore_edges(
    faces: &mut FlippableFaces,
    (positions, samples): (&[Point], &mut Samples<'_>),
    wanted: &[Edge],
    tolerance: f64,
) {
    // No flip takes away what is wanted: what is there stays.
    let missing = wanted
        .iter()
        .filter(|edge| !faces.are_connected(edge.0, edge.1));
    let missing: Vec<Edge> = missing.copied().collect();
    for _ in 0..PASSES {
        for &Edge(u, v) in &missing {
            if faces.are_connected(u, v) {
                continue;
            }
            let Some(quad) = faces.quad_between(u, v) else {
                continue;
            };
            let [_, s, _, r] = quad.corners;
            if wanted.binary_search(&Edge::new(s, r)).is_ok() {
                continue;
            }
            if is_worth_it(&quad, (positions, samples), tolerance) {
                faces.flip(&quad);
                samples.divide([quad.first, quad.second], &after(&quad, positions));
            }
        }
    }
}

fn before(quad: &Quad, positions: &[Point]) -> [[Point; 3]; 2] {
    let [u, s, v, r] = quad.corners.map(|corner| positions[corner as usize]);
    [[u, s, r], [v, r, s]]
}

fn after(quad: &Quad, positions: &[Point]) -> [[Point; 3]; 2] {
    let [u, s, v, r] = quad.corners.map(|corner| positions[corner as usize]);
    [[u, s, v], [u, v, r]]
}

/// A flipped face may lean this far from what its surroundings face: the cosine of 60 degrees.
const MIN_COSINE: f64 = 0.5;

/// Square distances below this share of the edge's square are rounding.
const ROUNDING: f64 = 1e-24;

fn is_worth_it(
    quad: &Quad,
    (positions, samples): (&[Point], &Samples<'_>),
    tolerance: f64,
) -> bool {
    let (before, after) = (before(quad, positions), after(quad, positions));
    let faces = [quad.first, quad.second];
    let count: usize = faces.iter().map(|&face| samples.on(face).len()).sum();
    if !faces_alike(&before, &after, FEW_SAMPLES < count) {
        return false;
    }
    let old = samples.square_distances(faces, &before);
    let new = samples.square_distances(faces, &after);
    let edge = after[0][0] - after[0][2];
    let allowed = tolerance * samples.mean_square + ROUNDING * edge.norm_squared();
    new - old <= allowed * count.max(1) as f64
}

/// So many samples may all be at the four corners: they do not know which diagonal is better.
const FEW_SAMPLES: usize = 5;

/// Whether the new faces look where the old ones did, and make no sharper an edge; or, if there
/// are samples between them to tell, none that is sharp.
fn faces_alike(before: &[[Point; 3]; 2], after: &[[Point; 3]; 2], has_samples: bool) -> bool {
    let [[a, b], [c, d]] = [before, after].map(|pair| pair.map(face_normal));
    let (Some(c), Some(d)) = (c, d) else {
        return false;
    };
    let [a, b] = [a, b].map(Option::unwrap_or_default);
    let Some(middle) = (a + b).try_normalize(0.0) else {
        return false;
    };
    let looks_there = |normal: &Vector| MIN_COSINE <= normal.dot(&middle);
    let least = if has_samples {
        a.dot(&b).min(MIN_COSINE)
    } else {
        // Rounding makes a flat quad's edge no sharper.
        a.dot(&b) - 1e-9
    };
    looks_there(&c) && looks_there(&d) && least <= c.dot(&d)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TriangleMesh;

    const SIDE: u32 = 6;

    /// A sheet of squares with its middle at some height, each cut along the one diagonal or the
    /// other.
    fn sheet(diagonal: bool, height: f64) -> TriangleMesh {
        let at = |i: u32, j: u32| i * (SIDE + 1) + j;
        let lifted = |i: u32, j: u32| if (i, j) == (3, 3) { height } else { 0.0 };
        let positions = (0..=SIDE)
            .flat_map(|i| (0..=SIDE).map(move |j| (i, j)))
            .map(|(i, j)| Point::new(f64::from(i), f64::from(j), lifted(i, j)))
            .collect();
        let faces = (0..SIDE)
            .flat_map(|i| (0..SIDE).map(move |j| (i, j)))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                if diagonal {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, b, d], [b, c, d]]
                }
            });
        TriangleMesh::new(positions, faces.collect()).unwrap()
    }

    fn all_kept(mesh: &TriangleMesh) -> Vec<Option<Kept>> {
        let kept = |(vertex, &position): (usize, &Point)| {
            Some(Kept {
                position,
                face: 0,
                fit: 1.0,
                vertex: vertex as u32,
            })
        };
        mesh.positions().iter().enumerate().map(kept).collect()
    }

    /// How many edges of the one mesh are there after the other one was told to restore them.
    fn restored(before: &TriangleMesh, now: &TriangleMesh, tolerance: f64) -> (usize, usize) {
        let wanted = previous_edges(&all_kept(now), before.faces());
        // Every face as three, so that there are samples between the vertices too.
        let centers = (0..now.face_count()).map(|face| {
            let [a, b, c] = now.triangle(face).map(|corner| corner.coords);
            Point::from((a + b + c) / 3.0)
        });
        let points: Vec<Point> = now.positions().iter().copied().chain(centers).collect();
        let thirds = now.faces().iter().zip(now.vertex_count() as u32..);
        let thirds = thirds.flat_map(|(&[a, b, c], m)| [[a, b, m], [b, c, m], [c, a, m]]);
        let original = TriangleMesh::new(points, thirds.collect()).unwrap();
        let mut samples = Samples::new(&original, now).unwrap();
        let mut faces = FlippableFaces::new(now);
        let places = (now.positions(), &mut samples);
        restore_edges(&mut faces, places, &wanted, tolerance);
        let found = wanted.iter().filter(|e| faces.are_connected(e.0, e.1));
        (found.count(), wanted.len())
    }

    #[test]
    fn on_a_flat_sheet_all_edges_come_back_but_where_the_boundary_would_lose_faces() {
        let (found, wanted) = restored(&sheet(true, 0.0), &sheet(false, 0.0), 0.1);
        let squares_on_the_boundary = (4 * SIDE - 4) as usize;
        assert_eq!(found, wanted - squares_on_the_boundary);
    }

    #[test]
    fn an_edge_does_not_come_back_where_the_surface_would_leave_its_samples() {
        let flat = restored(&sheet(true, 0.0), &sheet(false, 0.0), 0.0).0;
        let bent = restored(&sheet(true, 0.5), &sheet(false, 0.5), 0.0).0;
        assert!(bent < flat, "{bent} {flat}");
    }

    #[test]
    fn only_edges_between_vertices_that_are_still_there_are_wanted() {
        let kept = |vertex| {
            Some(Kept {
                position: Point::origin(),
                face: 0,
                fit: 1.0,
                vertex,
            })
        };
        // Vertex 1 of the previous result is gone; a number beyond it is not trusted.
        let edges = previous_edges(&[kept(2), None, kept(0), kept(9)], &[[0, 1, 2]]);
        assert_eq!(edges, [Edge::new(0, 2)]);
    }
}
