use super::*;
use crate::mesh::EdgeTable;
use crate::registration::carry;
use crate::spatial::{TriangleTree, closest_to_vertices};
use crate::{Face, Point, TriangleMesh};

/// A closed surface of `2 * rings * segments - 2 * segments` faces: a bumpy ball.
fn ball(rings: u32, segments: u32, unit: f64) -> TriangleMesh {
    let mut positions = vec![Point::new(0.0, 1.0, 0.0) * unit];
    for ring in 1..rings {
        for s in 0..segments {
            let theta = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            let phi = std::f64::consts::TAU * f64::from(s) / f64::from(segments);
            let r = 1.0 + 0.1 * (5.0 * theta).sin() * (3.0 * phi).cos();
            let p = [
                theta.sin() * phi.cos(),
                theta.cos(),
                theta.sin() * phi.sin(),
            ];
            positions.push(Point::from(p.map(|c| c * r * unit)));
        }
    }
    positions.push(Point::new(0.0, -1.0, 0.0) * unit);
    let last = positions.len() as u32 - 1;
    let at = |ring: u32, s: u32| 1 + (ring - 1) * segments + s % segments;
    let mut faces: Vec<Face> = vec![];
    for s in 0..segments {
        faces.push([0, at(1, s + 1), at(1, s)]);
        for ring in 1..rings - 1 {
            faces.push([at(ring, s), at(ring, s + 1), at(ring + 1, s)]);
            faces.push([at(ring, s + 1), at(ring + 1, s + 1), at(ring + 1, s)]);
        }
        faces.push([last, at(rings - 1, s), at(rings - 1, s + 1)]);
    }
    TriangleMesh::new(positions, faces).unwrap()
}

/// A square sheet of `2 * n * n` faces in the plane z = 0, with a boundary.
fn sheet(n: u32) -> TriangleMesh {
    let at = |i: u32, j: u32| i * (n + 1) + j;
    let positions = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| Point::new(f64::from(i), f64::from(j), 0.0)))
        .collect();
    let faces = (0..n)
        .flat_map(|i| (0..n).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            [
                [at(i, j), at(i + 1, j), at(i, j + 1)],
                [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
            ]
        })
        .collect();
    TriangleMesh::new(positions, faces).unwrap()
}

#[test]
fn a_closed_surface_stays_closed_and_gets_exactly_the_asked_number_of_faces() {
    let ball = ball(40, 60, 1.0);
    for target in [1000, 500, 100, 20] {
        let simplified = simplify(&ball, None, &Options::to_faces(target));
        let table = EdgeTable::of(simplified.mesh.faces());
        assert_eq!(simplified.mesh.face_count(), target);
        assert_eq!((table.boundary_count(), table.non_manifold_count()), (0, 0));
        assert!(simplified.target_reached);
    }
}

#[test]
fn an_odd_target_on_a_closed_surface_gets_one_face_more() {
    let simplified = simplify(&ball(20, 30, 1.0), None, &Options::to_faces(301));
    assert_eq!(simplified.mesh.face_count(), 302);
    assert!(simplified.target_reached);
}

#[test]
fn an_odd_target_on_a_surface_with_a_boundary_is_met_exactly() {
    for target in [101, 100, 51, 2] {
        let simplified = simplify(&sheet(20), None, &Options::to_faces(target));
        assert_eq!(simplified.mesh.face_count(), target);
    }
}

#[test]
fn a_flat_sheet_keeps_its_outline() {
    let simplified = simplify(&sheet(20), None, &Options::to_faces(10));
    let area: f64 = (0..simplified.mesh.face_count())
        .map(|f| {
            let [a, b, c] = simplified.mesh.triangle(f);
            (b - a).cross(&(c - a)).norm() / 2.0
        })
        .sum();
    assert!((area - 400.0).abs() < 1e-6, "{area}");
}

#[test]
fn the_unit_of_length_does_not_change_a_single_face() {
    let reference = simplify(&ball(40, 60, 1.0), None, &Options::to_faces(400)).mesh;
    for unit in [0.001, 1000.0, 0.3] {
        let scaled = simplify(&ball(40, 60, unit), None, &Options::to_faces(400)).mesh;
        assert_eq!(scaled.faces(), reference.faces(), "unit {unit}");
    }
}

#[test]
fn a_tetrahedron_cannot_be_simplified_and_the_result_says_so() {
    let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(Point::from);
    let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let tetrahedron = TriangleMesh::new(corners.to_vec(), faces).unwrap();
    let simplified = simplify(&tetrahedron, None, &Options::to_faces(2));
    assert_eq!(simplified.mesh.face_count(), 4);
    assert!(!simplified.target_reached);
}

#[test]
fn a_mesh_that_is_small_enough_comes_back_untouched() {
    let sheet = sheet(3);
    assert_eq!(simplify(&sheet, None, &Options::to_faces(1000)).mesh, sheet);
}

#[test]
fn a_reference_pulls_the_result_towards_itself() {
    let current = ball(40, 60, 1.0);
    let bigger = current.positions().iter().map(|p| p * 1.01).collect();
    let reference = current.with_positions(bigger).unwrap();
    let options = Options::to_faces(400);
    let mean_radius = |mesh: &TriangleMesh| {
        let sum: f64 = mesh.positions().iter().map(|p| p.coords.norm()).sum();
        sum / mesh.vertex_count() as f64
    };
    let untracked = mean_radius(&simplify(&current, None, &options).mesh);
    let tracked = mean_radius(&simplify(&current, Some(&reference), &options).mesh);
    assert!(untracked + 0.002 < tracked, "{untracked} {tracked}");
}

/// `n` faces around a vertex above a circle, and as many below it if the circle is `closed`.
fn hub(n: u32, closed: bool) -> TriangleMesh {
    let mut positions = vec![Point::new(0.0, 0.0, 0.2), Point::new(0.0, 0.0, -0.2)];
    positions.extend((0..n).map(|i| {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        Point::new(angle.cos(), angle.sin(), 0.0)
    }));
    let at = |i: u32| 2 + i % n;
    let above = (0..n).map(|i| [0, at(i), at(i + 1)]);
    let below = (0..n).filter(|_| closed).map(|i| [1, at(i + 1), at(i)]);
    TriangleMesh::new(positions, above.chain(below).collect()).unwrap()
}

/// A collapse at such a vertex costs as much as it has faces: this takes minutes if all are made
/// there.
#[test]
fn a_vertex_with_100_000_faces_is_simplified_to_the_target() {
    for closed in [false, true] {
        let simplified = simplify(&hub(100_000, closed), None, &Options::to_faces(100));
        assert!(simplified.target_reached);
        assert_eq!(simplified.mesh.face_count(), 100);
        let highest = simplified
            .mesh
            .positions()
            .iter()
            .map(|p| p.z)
            .fold(0.0, f64::max);
        assert!(0.15 < highest, "the hub is at {highest}");
    }
}

/// The mesh with `count` tetrahedra of the given size beside it, none of which can go.
fn with_debris(mesh: &TriangleMesh, count: u32, size: f64) -> TriangleMesh {
    let mut positions = mesh.positions().to_vec();
    let mut faces = mesh.faces().to_vec();
    for k in 0..count {
        let first = positions.len() as u32;
        let at = |x: f64, y: f64, z: f64| {
            Point::new(
                3.0 + f64::from(k % 30) * 0.1 + x * size,
                f64::from(k / 30) * 0.1 + y * size,
                z * size,
            )
        };
        positions.extend([
            at(0., 0., 0.),
            at(1., 0., 0.),
            at(0., 1., 0.),
            at(0., 0., 1.),
        ]);
        let tetrahedron = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        faces.extend(tetrahedron.map(|face: Face| face.map(|corner| first + corner)));
    }
    TriangleMesh::new(positions, faces).unwrap()
}

#[test]
fn edges_that_are_refused_for_good_do_not_change_the_order_of_the_others() {
    let ball = ball(40, 60, 1.0);
    let error = |debris: u32| {
        let mesh = with_debris(&ball, debris, 1e-4);
        let target = Options::to_faces(600 + 4 * debris as usize);
        let simplified = simplify(&mesh, None, &target);
        assert!(simplified.target_reached);
        let surface = TriangleTree::new(&simplified.mesh).unwrap();
        let distances = ball.positions().iter().map(|p| surface.closest(p).distance);
        distances.sum::<f64>()
    };
    let (alone, beside_debris) = (error(0), error(900));
    assert!(beside_debris < 1.03 * alone, "{alone} {beside_debris}");
}

#[test]
fn a_face_that_hangs_on_one_vertex_stays() {
    let ball = ball(40, 60, 1.0);
    let mut positions = ball.positions().to_vec();
    let first = positions.len() as u32;
    positions.extend([Point::new(0.0, 1.5, 0.1), Point::new(0.1, 1.5, 0.0)]);
    let mut faces = ball.faces().to_vec();
    faces.push([0, first, first + 1]);
    let mesh = TriangleMesh::new(positions, faces).unwrap();
    let simplified = simplify(&mesh, None, &Options::to_faces(200)).mesh;
    let is_outside = |p: &&Point| 1.3 < p.y;
    assert_eq!(simplified.positions().iter().filter(is_outside).count(), 2);
}

#[test]
fn where_few_faces_go_the_result_is_as_close_as_the_original_qem() {
    let ball = ball(40, 60, 1.0);
    let surface = TriangleTree::new(&ball).unwrap();
    let target = Options::to_faces(ball.face_count() * 9 / 10);
    let before = simplify(&ball, None, &target).mesh;
    let carried = carry(
        before.positions(),
        &closest_to_vertices(&before, &surface),
        (surface.mesh(), &ball),
        &vec![0; ball.vertex_count()],
    );
    let anchors = Anchors::new(
        (&carried, before.faces()),
        &surface,
        &anchors::Options::default(),
    );
    let held = simplify_anchored(&surface, &anchors, &target).mesh;
    assert_eq!(held, before);
}
