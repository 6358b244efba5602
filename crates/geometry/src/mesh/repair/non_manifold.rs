//! Edges with more than two faces.
//!
//! After welding these are places where two sheets touch (a hand on a hip) or where a fin
//! stands on the surface. The faces around such an edge are paired, each with one that it is
//! joined to around the edge's ends anyway, else with the one that continues it most smoothly,
//! and the vertices are copied so that only paired faces stay joined: "cutting" in the sense of Guéziec, Taubin, Lazarus and Horn, "Cutting and Stitching:
//! Converting Sets of Polygons to Manifold Surfaces", IEEE TVCG 7(2), 2001,
//! <https://doi.org/10.1109/2945.928166>.

use std::collections::{BTreeMap, BTreeSet};

use crate::mesh::{Edge, Rows, face_normal};
use crate::{Face, Point, Vector};

use super::RepairReport;
use super::faces::drop_faces;

/// Faces over vertices that have been copied where sheets were taken apart.
pub(super) struct Separated {
    /// The faces; a vertex below the input's count is the input's (welded), one above is a copy.
    pub faces: Vec<Face>,
    /// For every vertex, the input vertex whose position it has.
    pub vertex_origins: Vec<u32>,
}

/// Takes sheets apart along edges with more than two faces.
pub(super) fn separate(
    positions: &[Point],
    corners: &mut Vec<Face>,
    welded: &[u32],
    report: &mut RepairReport,
) -> Separated {
    let mut vertex_origins: Vec<u32> = (0..positions.len() as u32).collect();
    let mut faces: Vec<Face> = corners
        .iter()
        .map(|f| f.map(|v| welded[v as usize]))
        .collect();
    let crowded = crowded_edges(&faces, positions.len());
    report.non_manifold_edges = crowded.len();
    if !crowded.is_empty() {
        split_fans(positions, &mut faces, &mut vertex_origins, &crowded);
        let dropped = faces_in_the_way(positions, &faces, corners, vertex_origins.len());
        report.non_manifold_faces += dropped.len();
        drop_faces(&mut faces, &dropped);
        drop_faces(corners, &dropped);
    }
    Separated {
        faces,
        vertex_origins,
    }
}

/// The faces to be dropped where an edge is still crowded, ascending: both of its ends hold the
/// sheets together elsewhere, so that it cannot be cut, and the smallest faces on it go.
fn faces_in_the_way(
    positions: &[Point],
    faces: &[Face],
    corners: &[Face],
    vertex_count: usize,
) -> Vec<u32> {
    let area = |face: usize| {
        let [a, b, c] = corners[face].map(|v| positions[v as usize]);
        (b - a).cross(&(c - a)).norm()
    };
    let mut dropped = BTreeSet::new();
    // A face that goes makes the edges after this one less crowded, and none more.
    for on_edge in crowded_edges(faces, vertex_count).into_values() {
        let mut left: Vec<usize> = on_edge
            .into_iter()
            .filter(|&face| !dropped.contains(&(face as u32)))
            .collect();
        left.sort_by(|&f, &g| area(f).total_cmp(&area(g)));
        let excess = left.len().saturating_sub(2);
        dropped.extend(left[..excess].iter().map(|&face| face as u32));
    }
    dropped.into_iter().collect()
}

/// The edges with more than two faces, and those faces in ascending order.
fn crowded_edges(faces: &[Face], vertex_count: usize) -> BTreeMap<Edge, Vec<usize>> {
    let incidences: Vec<(u32, (u32, u32))> = faces
        .iter()
        .zip(0..)
        .flat_map(|(&face, index)| {
            Edge::of_face(face).map(|Edge(lower, upper)| (lower, (upper, index)))
        })
        .collect();
    let by_lower = Rows::from_pairs(vertex_count, &incidences);
    let mut crowded = BTreeMap::new();
    // By the upper vertex, for one lower vertex at a time.
    let mut face_counts = vec![0u32; vertex_count];
    for lower in 0..vertex_count {
        let row = by_lower.row(lower);
        let mut is_crowded = false;
        for &(upper, _) in row {
            face_counts[upper as usize] += 1;
            is_crowded |= 2 < face_counts[upper as usize];
        }
        if is_crowded {
            for &(upper, face) in row {
                if 2 < face_counts[upper as usize] {
                    let on_edge: &mut Vec<usize> =
                        crowded.entry(Edge(lower as u32, upper)).or_default();
                    on_edge.push(face as usize);
                }
            }
        }
        for &(upper, _) in row {
            face_counts[upper as usize] = 0;
        }
    }
    crowded
}

/// Gives every fan of faces that is no longer joined at a vertex its own copy of the vertex.
fn split_fans(
    positions: &[Point],
    faces: &mut [Face],
    vertex_origins: &mut Vec<u32>,
    crowded: &BTreeMap<Edge, Vec<usize>>,
) {
    let mut is_touched = vec![false; vertex_origins.len()];
    for vertex in crowded.keys().flat_map(|edge| [edge.0, edge.1]) {
        is_touched[vertex as usize] = true;
    }
    let mut around: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (index, face) in faces.iter().enumerate() {
        for &corner in face.iter().filter(|&&corner| is_touched[corner as usize]) {
            around.entry(corner).or_default().push(index);
        }
    }
    let original = faces.to_vec();
    // With every crowded edge cut, which faces still hold together around each vertex?
    let nothing_joined = crowded.keys().map(|&edge| (edge, vec![])).collect();
    let fans: BTreeMap<u32, Vec<Vec<usize>>> = around
        .iter()
        .map(|(&vertex, fan)| (vertex, components(vertex, fan, &original, &nothing_joined)))
        .collect();
    let shared_fans = |edge: Edge, f: usize, g: usize| {
        let together = |v: u32| {
            fans[&v]
                .iter()
                .any(|fan| fan.contains(&f) && fan.contains(&g))
        };
        usize::from(together(edge.0)) + usize::from(together(edge.1))
    };
    let joined: BTreeMap<Edge, Vec<(usize, usize)>> = crowded
        .iter()
        .map(|(&edge, on_edge)| {
            let closeness = |f, g| {
                (
                    shared_fans(edge, f, g),
                    smoothness(positions, &original, f, g),
                )
            };
            (edge, pair_faces(&original, edge, on_edge, closeness))
        })
        .collect();
    for (&vertex, fan) in &around {
        for component in components(vertex, fan, &original, &joined)
            .into_iter()
            .skip(1)
        {
            let copy = vertex_origins.len() as u32;
            vertex_origins.push(vertex);
            for face in component {
                faces[face]
                    .iter_mut()
                    .filter(|c| **c == vertex)
                    .for_each(|c| *c = copy);
            }
        }
    }
}

/// The cosine of the angle between the normals of two faces; 0 where one has none.
fn smoothness(positions: &[Point], faces: &[Face], f: usize, g: usize) -> f64 {
    let normal = |face: usize| {
        face_normal(faces[face].map(|v| positions[v as usize])).unwrap_or_else(Vector::zeros)
    };
    normal(f).dot(&normal(g))
}

/// Pairs faces that run along `edge` in opposite directions, the closest pairs first: closest
/// by how many ends of the edge they share a fan at, then by how smoothly one continues the other.
fn pair_faces(
    faces: &[Face],
    edge: Edge,
    on_edge: &[usize],
    closeness: impl Fn(usize, usize) -> (usize, f64),
) -> Vec<(usize, usize)> {
    let runs_forward = |face: usize| {
        let [a, b, c] = faces[face];
        [(a, b), (b, c), (c, a)].contains(&(edge.0, edge.1))
    };
    let (forward, backward): (Vec<usize>, Vec<usize>) =
        on_edge.iter().partition(|&&face| runs_forward(face));
    let mut candidates: Vec<((usize, f64), usize, usize)> = forward
        .iter()
        .flat_map(|&f| backward.iter().map(move |&g| (f, g)))
        .map(|(f, g)| (closeness(f, g), f, g))
        .collect();
    candidates.sort_by(
        |((fans_a, smooth_a), fa, ga), ((fans_b, smooth_b), fb, gb)| {
            fans_b
                .cmp(fans_a)
                .then(smooth_b.total_cmp(smooth_a))
                .then((fa, ga).cmp(&(fb, gb)))
        },
    );
    let mut taken = BTreeSet::new();
    let mut pairs = Vec::new();
    for (_, f, g) in candidates {
        if !taken.contains(&f) && !taken.contains(&g) {
            taken.extend([f, g]);
            pairs.push((f, g));
        }
    }
    pairs
}

/// The faces around `vertex`, grouped by what is joined across an edge at that vertex.
fn components(
    vertex: u32,
    fan: &[usize],
    faces: &[Face],
    joined: &BTreeMap<Edge, Vec<(usize, usize)>>,
) -> Vec<Vec<usize>> {
    let mut on_spoke: BTreeMap<Edge, Vec<usize>> = BTreeMap::new();
    for &face in fan {
        for edge in Edge::of_face(faces[face]) {
            if edge.0 == vertex || edge.1 == vertex {
                on_spoke.entry(edge).or_default().push(face);
            }
        }
    }
    let mut group: BTreeMap<usize, usize> = fan.iter().map(|&face| (face, face)).collect();
    let mut join = |f: usize, g: usize| {
        let (from, to) = (group[&f].max(group[&g]), group[&f].min(group[&g]));
        group
            .values_mut()
            .filter(|label| **label == from)
            .for_each(|label| *label = to);
    };
    for (edge, on_edge) in &on_spoke {
        match joined.get(edge) {
            Some(pairs) => pairs.iter().for_each(|&(f, g)| join(f, g)),
            None => on_edge.windows(2).for_each(|pair| join(pair[0], pair[1])),
        }
    }
    let mut grouped: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (&face, &label) in &group {
        grouped.entry(label).or_default().push(face);
    }
    grouped.into_values().collect()
}
