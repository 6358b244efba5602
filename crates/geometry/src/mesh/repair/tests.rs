use super::*;
use crate::Point;
use crate::mesh::EdgeTable;

fn mesh(positions: &[[f64; 3]], faces: &[Face]) -> TriangleMesh {
    let positions = positions.iter().map(|&p| Point::from(p)).collect();
    TriangleMesh::new(positions, faces.to_vec()).unwrap()
}

#[test]
fn copies_of_a_seam_vertex_become_one_and_stay_known() {
    let square = mesh(
        &[
            [0., 0., 0.],
            [1., 0., 0.],
            [0., 1., 0.],
            [1., 0., 0.],
            [1., 1., 0.],
            [-0., 1., -0.],
        ],
        &[[0, 1, 2], [3, 4, 5]],
    );
    let repaired = repair(&square);
    assert_eq!(repaired.mesh.vertex_count(), 4);
    assert_eq!(repaired.report.welded_vertices, 2);
    assert_eq!(EdgeTable::of(repaired.mesh.faces()).boundary_count(), 4);
    assert_eq!(repaired.corner_origins, [[0, 1, 2], [3, 4, 5]]);
}

#[test]
fn degenerate_and_duplicate_faces_and_unused_vertices_are_dropped_and_counted() {
    let messy = mesh(
        &[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [9., 9., 9.]],
        &[[0, 1, 2], [0, 0, 1], [1, 2, 0], [2, 1, 0]],
    );
    let repaired = repair(&messy);
    assert_eq!(repaired.mesh.faces(), [[0, 1, 2]]);
    assert_eq!(repaired.report.degenerate_faces, 1);
    assert_eq!(repaired.report.duplicate_faces, 2);
    assert_eq!(repaired.report.removed_faces(), 3);
    assert_eq!(repaired.report.unreferenced_vertices, 1);
}

#[test]
fn a_needle_between_two_faces_is_flipped_so_that_nothing_tears() {
    // A tetrahedron one of whose edges (0-1) carries a needle over the extra vertex 4.
    let torn = mesh(
        &[
            [0., 0., 0.],
            [1., 0., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [0.5, 0., 0.],
        ],
        &[
            [0, 2, 1],
            [0, 4, 3],
            [4, 1, 3],
            [0, 3, 2],
            [1, 2, 3],
            [0, 1, 4],
        ],
    );
    let repaired = repair(&torn);
    let table = EdgeTable::of(repaired.mesh.faces());
    assert_eq!(repaired.report.flipped_faces, 1);
    assert_eq!(repaired.report.degenerate_faces, 0);
    assert_eq!(repaired.mesh.face_count(), 6);
    assert_eq!((table.boundary_count(), table.non_manifold_count()), (0, 0));
    let has_normal = |f| crate::mesh::face_normal(repaired.mesh.triangle(f)).is_some();
    assert!((0..6).all(has_normal));
}

#[test]
fn two_tetrahedra_that_touch_along_an_edge_are_taken_apart() {
    let touching = mesh(
        &[
            [0., 0., 0.],
            [0., 0., 1.],
            [1., 0., 0.],
            [1., 1., 0.],
            [-1., 0., 0.],
            [-1., -1., 0.],
        ],
        &[
            [0, 1, 2],
            [1, 0, 3],
            [0, 2, 3],
            [1, 3, 2],
            [0, 1, 4],
            [1, 0, 5],
            [0, 4, 5],
            [1, 5, 4],
        ],
    );
    let repaired = repair(&touching);
    let table = EdgeTable::of(repaired.mesh.faces());
    assert_eq!(repaired.report.non_manifold_edges, 1);
    assert_eq!(repaired.report.split_vertices, 2);
    assert_eq!(repaired.report.non_manifold_faces, 0);
    assert_eq!((table.boundary_count(), table.non_manifold_count()), (0, 0));
    assert_eq!(repaired.mesh.face_count(), 8);
}

#[test]
fn a_fin_on_a_surface_leaves_at_most_two_faces_on_each_edge() {
    let fin = mesh(
        &[
            [0., 0., 0.],
            [1., 0., 0.],
            [0., 1., 0.],
            [0., -1., 0.],
            [0.5, 0., 1.],
        ],
        &[[0, 1, 2], [1, 0, 3], [0, 1, 4]],
    );
    let repaired = repair(&fin);
    assert_eq!(EdgeTable::of(repaired.mesh.faces()).non_manifold_count(), 0);
    assert_eq!(repaired.mesh.face_count(), 3);
}
