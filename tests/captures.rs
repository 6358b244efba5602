//! Accuracy on real captures, against the figures that public programs reach on them.
//!
//! The captures are not part of the project: they are looked for in the folder that
//! `STEADYMESH_DATA` names, else in `../shared/data`; without them these tests say that they
//! were skipped. Figures are in percent of the bounding box's diagonal.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it measured"
)]

use std::path::PathBuf;

use nalgebra::{Isometry3, Vector3};
use steadymesh::pipeline::{PreparedFrame, RawFrame, register};
use steadymesh_geometry::mesh::EdgeTable;
use steadymesh_geometry::metrics::{DistanceStatistics, surface_distances};
use steadymesh_geometry::registration::{self, Target};
use steadymesh_geometry::simplification::{Options, simplify};
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_mesh_io::{Format, Limits, obj, read};

fn captures() -> Option<PathBuf> {
    let folder = std::env::var_os("STEADYMESH_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    if folder.is_dir() {
        return Some(folder);
    }
    println!("SKIPPED: no captures in {}", folder.display());
    None
}

fn raw(name: &str) -> Option<RawFrame> {
    let path = captures()?.join(name);
    let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let format = Format::from_extension(path.extension()?.to_str()?)?;
    let limits = Limits {
        max_vertices: 1 << 20,
        max_faces: 1 << 20,
        max_memory_bytes: 1 << 30,
    };
    let mesh = read(&bytes, format, &limits).unwrap();
    Some(RawFrame::from_mesh(mesh, bytes.len()))
}

fn frame(name: &str) -> Option<TriangleMesh> {
    Some(
        PreparedFrame::new(raw(name)?, &mut ())
            .unwrap()
            .mesh()
            .clone(),
    )
}

fn percent(distances: &[f64], diagonal: f64) -> (f64, f64) {
    let statistics = DistanceStatistics::of(distances);
    (
        100.0 * statistics.mean / diagonal,
        100.0 * statistics.rmse / diagonal,
    )
}

const OFF_CASES: [&str; 4] = [
    "basketball_player/basketball_player_fr0012.obj",
    "basketball_player/basketball_player_fr0016.obj",
    "thomas/thomas_fr0002.obj",
    "liam/00010.drc",
];

#[test]
fn the_original_qem_is_as_accurate_as_cgal_and_leaves_no_edge_non_manifold() {
    let mut means = vec![];
    let mut rmses = vec![];
    for name in OFF_CASES {
        let Some(mesh) = frame(name) else { return };
        let out = simplify(&mesh, None, &Options::to_faces(4000));
        // One face more where an edge with a single face is left, but none that may collapse.
        assert!((4000..=4001).contains(&out.mesh.face_count()), "{name}");
        assert_eq!(
            EdgeTable::of(out.mesh.faces()).non_manifold_count(),
            0,
            "{name}"
        );
        let tree = TriangleTree::new(&out.mesh).unwrap();
        let diagonal = mesh.bounding_box().diagonal();
        let (mean, rmse) = percent(&surface_distances(mesh.positions(), &tree), diagonal);
        println!("{name}: original to result {mean:.4} / {rmse:.4}");
        means.push(mean);
        rmses.push(rmse);
    }
    let average = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    assert!(average(&means) <= 1.1 * 0.034, "{means:?}");
    assert!(average(&rmses) <= 1.1 * 0.044, "{rmses:?}");
}

#[test]
fn the_unit_of_a_capture_does_not_change_a_single_face() {
    let Some(raw) = raw(OFF_CASES[1]) else { return };
    let simplified = |unit: f64| {
        let positions = raw.positions.iter().map(|p| p.map(|c| c * unit)).collect();
        let scaled = RawFrame {
            positions,
            ..raw.clone()
        };
        let mesh = PreparedFrame::new(scaled, &mut ()).unwrap();
        simplify(mesh.mesh(), None, &Options::to_faces(4000))
            .mesh
            .faces()
            .to_vec()
    };
    let reference = simplified(1.0);
    for unit in [0.001, 1000.0] {
        assert!(simplified(unit) == reference, "unit {unit}");
    }
}

#[test]
fn registration_is_at_least_as_close_as_the_best_public_program() {
    let player = |n| format!("basketball_player/basketball_player_fr{n:04}.obj");
    let thomas = |n| format!("thomas/thomas_fr{n:04}.obj");
    // SPARE's mean and root mean square, which are the lowest on every pair.
    let cases = [
        (player(11), player(12), (0.021, 0.032)),
        (player(15), player(16), (0.024, 0.049)),
        (thomas(1), thomas(2), (0.010, 0.024)),
        (thomas(5), thomas(6), (0.008, 0.013)),
    ];
    for (source, target, bounds) in cases {
        let (Some(from), Some(to)) = (frame(&source), frame(&target)) else {
            return;
        };
        let prepared = Target::new(&to).unwrap();
        let found =
            registration::register(&from, &prepared, &registration::Options::default()).unwrap();
        let (mean, rmse) = percent(&found.residuals(), to.bounding_box().diagonal());
        println!("{source}: residual {mean:.4} / {rmse:.4}");
        assert!(mean <= bounds.0, "{source}: mean {mean} above {}", bounds.0);
        assert!(rmse <= bounds.1, "{source}: rmse {rmse} above {}", bounds.1);
        let folds = new_folds(&from, &found.positions);
        println!("{source}: folds {folds}");
        assert!(folds <= from.face_count() / 1000, "{source}: {folds} folds");
    }
}

/// Edges whose faces looked the same way in `mesh` and look against each other at `positions`.
fn new_folds(mesh: &TriangleMesh, positions: &[Point]) -> usize {
    let moved = mesh.with_positions(positions.to_vec()).unwrap();
    let (before, after) = (mesh.face_normals(), moved.face_normals());
    let mut on_edges = std::collections::HashMap::new();
    let mut folds = 0;
    for (face, [a, b, c]) in mesh.faces().iter().enumerate() {
        for edge in [[a, b], [b, c], [c, a]] {
            let key = (edge[0].min(edge[1]), edge[0].max(edge[1]));
            if let Some(other) = on_edges.insert(key, face) {
                let smooth = 0.2 < before[face].dot(&before[other]);
                folds += usize::from(smooth && after[face].dot(&after[other]) < 0.0);
            }
        }
    }
    folds
}

#[test]
fn a_cut_between_captures_is_told_from_motion_within_one() {
    let player = |n| format!("basketball_player/basketball_player_fr{n:04}.obj");
    let thomas = |n| format!("thomas/thomas_fr{n:04}.obj");
    let liam = |n| format!("liam/{n:05}.drc");
    let textured = |n| format!("textured/basketball_player_{n:08}.obj");
    let mut cases = vec![
        (textured(1), textured(2), false),
        (player(11), thomas(1), true),
        (thomas(1), liam(0), true),
        (liam(0), player(11), true),
    ];
    for step in [1, 2, 3] {
        for n in 1..=(10 - step) {
            cases.push((player(10 + n), player(10 + n + step), false));
            cases.push((thomas(n), thomas(n + step), false));
            cases.push((liam(6 * n - 6), liam(6 * n - 6 + step), false));
        }
    }
    let prepared = |name: &str| Some(PreparedFrame::new(raw(name)?, &mut ()).unwrap());
    for (before, after, is_cut) in cases {
        let (Some(from), Some(to)) = (prepared(&before), prepared(&after)) else {
            return;
        };
        // Captures in other units cannot be registered at all.
        let found = register(&from, &to, &registration::Options::default());
        let cut = found.map(|found| found.scene_cut());
        assert_eq!(
            !matches!(cut, Ok(None)),
            is_cut,
            "{before} to {after}: {cut:?}"
        );
    }
}

#[test]
fn a_capture_moved_rigidly_is_found_again() {
    let Some(mesh) = frame("thomas/thomas_fr0001.obj") else {
        return;
    };
    let diagonal = mesh.bounding_box().diagonal();
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let shift = Vector3::new(0.06, -0.05, 0.06) * diagonal;
        let motion = Isometry3::new(shift, axis * 20f64.to_radians());
        let moved: Vec<Point> = mesh.positions().iter().map(|p| motion * p).collect();
        let target = Target::new(&mesh.with_positions(moved.clone()).unwrap()).unwrap();
        let options = registration::Options::default();
        let found = registration::register(&mesh, &target, &options).unwrap();
        let pairs = found.positions.iter().zip(&moved);
        let worst = pairs.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
        assert!(
            worst < 1e-4 * diagonal,
            "about {axis:?}: {worst} of {diagonal}"
        );
    }
}

#[test]
fn a_capture_survives_being_written_and_read_again() {
    let Some(mesh) = raw("thomas/thomas_fr0001.obj") else {
        return;
    };
    let limits = Limits {
        max_vertices: 1 << 20,
        max_faces: 1 << 20,
        max_memory_bytes: 1 << 30,
    };
    let file = steadymesh_mesh_io::Mesh {
        positions: mesh.positions.clone(),
        faces: mesh.faces.clone(),
        normals: None,
        colors: None,
        materials: None,
        texture_coordinates: None,
        image: None,
    };
    let again = obj::read(&obj::write(&file), &limits).unwrap();
    assert_eq!((again.positions, again.faces), (mesh.positions, mesh.faces));
}
