//! From face to face to the one that a point is straight above.

use crate::{Point, TriangleMesh};

use super::SurfacePoint;

/// Faces that are crossed at the most.
const MAX_STEPS: usize = 16;

/// Where a point is straight above a triangle.
enum Foot {
    /// The foot of the perpendicular is within it.
    Inside(Point, f64),
    /// It is across the edge from this corner to the next.
    Across(usize),
    /// The triangle has no area.
    Nowhere,
}

/// The foot of the perpendicular from `query` to the face of `mesh` that it is straight above, looked
/// for from `start` on: across the edge beyond which the foot on a face's plane is furthest, and so on.
///
/// It is the closest point of the sheet of surface that the way is on, but for dents, where a point
/// is straight above several faces. Where the way ends otherwise, at a boundary or between faces of
/// which neither has the foot, the last face, which is probably near.
///
/// # Panics
///
/// If there is no such face.
pub(crate) fn straight_walk(
    mesh: &TriangleMesh,
    query: &Point,
    start: u32,
) -> Result<SurfacePoint, u32> {
    let (mut face, mut last) = (start, start);
    for _ in 0..MAX_STEPS {
        match foot(query, &mesh.triangle(face as usize)) {
            Foot::Inside(position, distance) => {
                return Ok(SurfacePoint {
                    position,
                    face,
                    distance,
                });
            }
            Foot::Across(from) => {
                let next = across(mesh, face, from).ok_or(face)?;
                if next == last {
                    return Err(face);
                }
                (last, face) = (face, next);
            }
            Foot::Nowhere => return Err(face),
        }
    }
    Err(face)
}

/// The foot of the perpendicular from `query` to the plane of a face of `mesh`, if it is on the face.
pub(super) fn straight_below(
    mesh: &TriangleMesh,
    query: &Point,
    face: u32,
) -> Option<SurfacePoint> {
    match foot(query, &mesh.triangle(face as usize)) {
        Foot::Inside(position, distance) => Some(SurfacePoint {
            position,
            face,
            distance,
        }),
        Foot::Across(_) | Foot::Nowhere => None,
    }
}

#[inline]
fn foot(query: &Point, [a, b, c]: &[Point; 3]) -> Foot {
    let (ab, ac, ap) = (b - a, c - a, query - a);
    let normal = ab.cross(&ac);
    let square = normal.norm_squared();
    // Barycentric coordinates times the square.
    let (of_b, of_c) = (ap.cross(&ac).dot(&normal), ab.cross(&ap).dot(&normal));
    let of_a = square - of_b - of_c;
    if 0.0 <= of_a.min(of_b).min(of_c) && 0.0 < square {
        let height = ap.dot(&normal);
        return Foot::Inside(
            query - normal * (height / square),
            height.abs() / square.sqrt(),
        );
    }
    if of_a < of_b && of_a < of_c {
        Foot::Across(1)
    } else if of_b < of_c {
        Foot::Across(2)
    } else if of_c < 0.0 {
        Foot::Across(0)
    } else {
        Foot::Nowhere
    }
}

/// Faces around a vertex that are looked through, at the most: at a hub of thousands every step would
/// take as long as a search.
const MAX_VALENCE: usize = 64;

/// Another face on the edge from a corner of `face` to the next, if there is one and neither end is
/// known to have too many faces to find it.
#[inline]
fn across(mesh: &TriangleMesh, face: u32, from: usize) -> Option<u32> {
    let (faces, around) = (mesh.faces(), mesh.vertex_faces());
    let corners = faces[face as usize];
    let (mut one, mut other) = (corners[from], corners[(from + 1) % 3]);
    if MAX_VALENCE < around.row(one as usize).len() {
        (one, other) = (other, one);
    }
    let around = around.row(one as usize);
    if MAX_VALENCE < around.len() {
        return None;
    }
    let mut others = around.iter().copied();
    others.find(|&next| next != face && faces[next as usize].contains(&other))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square sheet of unit cells whose height is that of a parabola, of either sign.
    fn sheet(bend: f64) -> TriangleMesh {
        const SIDE: u32 = 12;
        let at = |x: u32, y: u32| y * (SIDE + 1) + x;
        let corners = (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| (x, y)));
        let height = |x: f64| bend * (x - 6.0).powi(2);
        let positions = corners.map(|(x, y)| (f64::from(x), f64::from(y)));
        let positions = positions.map(|(x, y)| Point::new(x, y, height(x)));
        let cells = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
        let faces = cells.flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        TriangleMesh::new(positions.collect(), faces.collect()).unwrap()
    }

    #[test]
    fn from_any_face_the_way_leads_to_the_one_below() {
        let mesh = sheet(0.0);
        for start in 0..mesh.face_count() as u32 {
            let found = straight_walk(&mesh, &Point::new(7.2, 3.6, 0.5), start);
            // At most so many faces lie between.
            if let Ok(found) = found {
                assert!((found.position - Point::new(7.2, 3.6, 0.0)).norm() < 1e-12);
                assert!((found.distance - 0.5).abs() < 1e-12);
            }
            let (column, row) = (start / 2 % 12, start / 2 / 12);
            let cells = column.abs_diff(7) + row.abs_diff(3);
            assert!(found.is_ok() || 6 < cells, "{start}");
        }
    }

    #[test]
    fn around_a_hub_the_way_goes_by_the_rim() {
        let count = 3000;
        let rim = (0..count).map(|k| f64::from(k) * std::f64::consts::TAU / f64::from(count));
        let rim = rim.map(|angle| Point::new(angle.cos(), angle.sin(), 0.0));
        let positions = std::iter::once(Point::origin()).chain(rim).collect();
        let faces = (0..count)
            .map(|k| [0, 1 + k, 1 + (k + 1) % count])
            .collect();
        let mesh = TriangleMesh::new(positions, faces).unwrap();
        let middle = |face: usize| {
            let [a, b, c] = mesh.triangle(face).map(|corner| corner.coords);
            Point::from((a + b + c) / 3.0)
        };
        let found = straight_walk(&mesh, &middle(10), 3).unwrap();
        assert_eq!(found.face, 10);
    }

    #[test]
    fn beyond_the_boundary_and_above_a_ridge_there_is_no_face_below() {
        let beyond = straight_walk(&sheet(0.0), &Point::new(-0.5, 3.0, 0.1), 40);
        assert!(beyond.is_err());
        // The cells meet in ridges along y; straight above one the way goes back and forth.
        let ridge = straight_walk(&sheet(-0.2), &Point::new(6.0, 3.3, 0.5), 66);
        assert!(ridge.is_err());
    }
}
