//! The camera of the pictures, and what it sees.

use steadymesh_geometry::{Point, TriangleMesh};

/// How far the camera stands aside of the front, in radians: a three-quarter view.
const ASIDE: f64 = 0.45;

/// An orthographic camera on a window of the meshes. As in glTF, +y is up.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// The horizontal direction from the meshes to the camera, in x and z.
    towards: [f64; 2],
    /// The left and the upper edge of the window, in camera coordinates.
    corner: [f64; 2],
    /// Picture units in a unit of the mesh.
    scale: f64,
    /// The size of the window in picture units.
    pub size: [i32; 2],
}

/// A mesh as a camera sees it.
pub(super) struct Seen {
    /// The vertices in whole picture units.
    pub vertices: Vec<[i32; 2]>,
    /// How much of each face is seen.
    pub faces: Vec<Visibility>,
    /// The faces from the farthest to the nearest.
    pub order: Vec<usize>,
}

/// How much of a face is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Visibility {
    /// Nothing: it faces away, or others cover it.
    Hidden,
    /// Something else covers a part of it.
    Partly,
    /// All.
    Wholly,
}

/// Right, down and towards the camera, in the mesh's unit.
fn to_camera([x, z]: [f64; 2], point: &Point) -> [f64; 3] {
    [
        z * point.x - x * point.z,
        -point.y,
        x * point.x + z * point.z,
    ]
}

/// From a front that faces this way to a camera that stands aside of it.
fn aside([x, z]: [f64; 2]) -> [f64; 2] {
    let (sine, cosine) = ASIDE.sin_cos();
    [cosine * x + sine * z, cosine * z - sine * x]
}

/// Where a figure faces: its feet stick out of its shins. Without feet it is +z, as in glTF.
fn front(points: &[Point]) -> [f64; 2] {
    /// Between which shares of the height there are soles and shins.
    const FEET: [f64; 2] = [0.0, 0.03];
    const SHINS: [f64; 2] = [0.06, 0.15];
    /// How far feet stick out, in heights.
    const LEAST: f64 = 0.01;
    let (low, high) = range(points.iter().map(|p| p.y));
    let height = high - low;
    let mean = |[from, to]: [f64; 2]| {
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        for p in points {
            if (low + from * height..=low + to * height).contains(&p.y) {
                sum = [sum[0] + p.x, sum[1] + p.z];
                count += 1.0;
            }
        }
        sum.map(|sum| sum / count)
    };
    let (feet, shins) = (mean(FEET), mean(SHINS));
    let [x, z] = [feet[0] - shins[0], feet[1] - shins[1]];
    let length = x.hypot(z);
    // What is not a number is not far enough either.
    if LEAST * height < length {
        [x / length, z / length]
    } else {
        [0.0, 1.0]
    }
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

impl View {
    /// A window `height` picture units high that holds `meshes` from the top down to the share
    /// `shown` of their height.
    pub fn of(meshes: &[&TriangleMesh], shown: f64, height: i32) -> Self {
        let towards = aside(front(meshes.first().map_or(&[], |mesh| mesh.positions())));
        let all = || meshes.iter().flat_map(|mesh| mesh.positions());
        let points = || all().map(|point| to_camera(towards, point));
        let (top, bottom) = range(points().map(|[_, y, _]| y));
        let cut = top + shown * (bottom - top);
        let (left, right) = range(points().filter(|p| p[1] <= cut).map(|[x, ..]| x));
        // A margin on every side; a mesh without height would have no scale.
        let margin = 0.012 * (bottom - top).max(f64::MIN_POSITIVE);
        let scale = f64::from(height) / (cut - top + 2.0 * margin);
        let width = (right - left + 2.0 * margin) * scale;
        Self {
            towards,
            corner: [left - margin, top - margin],
            scale,
            size: [width.min(4.0 * f64::from(height)).ceil() as i32, height],
        }
    }

    /// Looks at `mesh`. Faces outside the window are hidden.
    pub fn look_at(&self, mesh: &TriangleMesh) -> Seen {
        let projected: Vec<[f64; 3]> = mesh
            .positions()
            .iter()
            .map(|point| {
                let [x, y, z] = to_camera(self.towards, point);
                let [left, top] = self.corner;
                [
                    (x - left) * self.scale,
                    (y - top) * self.scale,
                    z * self.scale,
                ]
            })
            .collect();
        let faces: Vec<[[f64; 3]; 3]> = mesh
            .faces()
            .iter()
            .map(|face| face.map(|corner| projected[corner as usize]))
            .collect();
        let depth = |face: usize| faces[face].iter().map(|corner| corner[2]).sum::<f64>();
        let mut order: Vec<usize> = (0..faces.len()).collect();
        order.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)));
        Seen {
            vertices: projected
                .iter()
                .map(|[x, y, _]| [x.round() as i32, y.round() as i32])
                .collect(),
            faces: visibility(&faces, self.size),
            order,
        }
    }
}

/// Finds what is seen of each face by a depth buffer with a pixel for each picture unit.
fn visibility(faces: &[[[f64; 3]; 3]], [width, height]: [i32; 2]) -> Vec<Visibility> {
    let mut buffer = vec![(f64::NEG_INFINITY, usize::MAX); (width * height) as usize];
    let mut covered = vec![0_u32; faces.len()];
    for (index, face) in faces.iter().enumerate() {
        for_each_pixel(face, [width, height], |pixel, depth| {
            covered[index] += 1;
            if buffer[pixel].0 < depth {
                buffer[pixel] = (depth, index);
            }
        });
    }
    let mut seen = vec![0_u32; faces.len()];
    for (_, index) in buffer {
        if let Some(count) = seen.get_mut(index) {
            *count += 1;
        }
    }
    let of = |(seen, covered)| match seen {
        0 => Visibility::Hidden,
        _ if seen == covered => Visibility::Wholly,
        _ => Visibility::Partly,
    };
    seen.into_iter().zip(covered).map(of).collect()
}

/// Calls `visit` with the index and the depth of each pixel in the window whose center is inside
/// `face`, unless that faces away.
fn for_each_pixel(
    face: &[[f64; 3]; 3],
    [width, height]: [i32; 2],
    mut visit: impl FnMut(usize, f64),
) {
    let [a, b, c] = *face;
    let cross = |p: [f64; 2], q: [f64; 3], r: [f64; 3]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    };
    // y points down, so that what is counterclockwise to the viewer has a negative area.
    let area = cross([a[0], a[1]], b, c);
    if 0.0 <= area {
        return;
    }
    let span = |axis: usize, limit: i32| {
        let low = a[axis].min(b[axis]).min(c[axis]).floor().max(0.0);
        let high = a[axis]
            .max(b[axis])
            .max(c[axis])
            .ceil()
            .min(f64::from(limit));
        low as usize..high.max(0.0) as usize
    };
    for y in span(1, height) {
        for x in span(0, width) {
            let center = [x as f64 + 0.5, y as f64 + 0.5];
            let weights = [
                cross(center, b, c),
                cross(center, c, a),
                cross(center, a, b),
            ];
            if weights.iter().all(|weight| *weight < 0.0) {
                let depth = weights.iter().zip(face).map(|(w, corner)| w * corner[2]);
                visit(y * width as usize + x, depth.sum::<f64>() / area);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square from (-1, -1) to (1, 1) that faces +z at height z, and one that faces away.
    fn square(z: f64, size: f64) -> Vec<Point> {
        let corners = [[-1., -1.], [1., -1.], [1., 1.], [-1., 1.]];
        let to_point = |[x, y]: [f64; 2]| Point::new(x * size, y * size, z);
        corners.map(to_point).to_vec()
    }

    #[test]
    fn what_is_behind_is_hidden_and_what_sticks_out_is_seen_in_part() {
        let mut positions = square(0.0, 1.0);
        positions.extend(square(-0.01, 0.5));
        positions.extend(square(-0.02, 2.0));
        let faces =
            [0, 4, 8].map(|first| [[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        let mut faces = faces.concat();
        // Faces away.
        faces.push([0, 2, 1]);
        let mesh = TriangleMesh::new(positions, faces).unwrap();
        let seen = View::of(&[&mesh], 1.0, 200).look_at(&mesh);
        let (hidden, partly, wholly) = (Visibility::Hidden, Visibility::Partly, Visibility::Wholly);
        assert_eq!(
            seen.faces,
            [wholly, wholly, hidden, hidden, partly, partly, hidden]
        );
    }

    #[test]
    fn faces_are_ordered_from_the_back_to_the_front() {
        let positions = [2.0, -1.0, 0.0].map(|z| square(z, 1.0)).concat();
        let faces = [0, 4, 8].map(|first| [first, first + 1, first + 2]);
        let mesh = TriangleMesh::new(positions, faces.to_vec()).unwrap();
        let seen = View::of(&[&mesh], 1.0, 100).look_at(&mesh);
        assert_eq!(seen.order, [1, 2, 0]);
    }

    #[test]
    fn a_window_begins_at_the_top_and_ends_where_it_is_cut() {
        let mesh = TriangleMesh::new(square(0.0, 1.0), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let view = View::of(&[&mesh], 0.5, 100);
        let seen = view.look_at(&mesh);
        assert_eq!(view.size[1], 100);
        let [bottom, top] = [seen.vertices[0][1], seen.vertices[2][1]];
        assert!((0..10).contains(&top) && 150 < bottom, "{top} {bottom}");
    }

    #[test]
    fn the_camera_stands_where_the_feet_point_to() {
        for angle in [0.3_f64, 2.0, 4.5] {
            let towards = [angle.sin(), angle.cos()];
            let foot = |share: f64, out: f64| Point::new(out * towards[0], share, out * towards[1]);
            let figure = [
                foot(0.0, 0.0),
                foot(0.0, 0.1),
                foot(0.1, 0.0),
                foot(1.0, 0.0),
            ];
            let found = front(&figure);
            assert!((found[0] - towards[0]).abs() + (found[1] - towards[1]).abs() < 1e-9);
            // In a view from the front, the front is nearest.
            assert!(0.099 < to_camera(found, &figure[1])[2]);
        }
        let ball = square(0.0, 1.0);
        assert_eq!(front(&ball), [0.0, 1.0]);
        assert_eq!(front(&[]), [0.0, 1.0]);
    }

    #[test]
    fn a_mesh_without_extent_can_be_looked_at() {
        let mesh = TriangleMesh::new(vec![Point::origin(); 3], vec![[0, 1, 2]]).unwrap();
        let seen = View::of(&[&mesh], 1.0, 10).look_at(&mesh);
        assert_eq!(seen.faces, [Visibility::Hidden]);
    }
}
