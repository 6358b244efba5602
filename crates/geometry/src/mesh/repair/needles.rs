//! Faces whose three corners lie on one line, although they are three vertices.
//!
//! Such a face has no normal and no area, but it may be what joins its neighbors: dropping it
//! from a closed surface would tear the surface open along its longest edge. The face beyond
//! that edge is split at the middle corner instead, which leaves the surface as it was:
//! `(a, b, c)` with `c` between `a` and `b`, and its neighbor `(b, a, d)`, become `(a, c, d)`
//! and `(c, b, d)` with the flip of the edge `ab` to `cd`.

use std::collections::BTreeMap;

use crate::mesh::{Edge, face_normal};
use crate::{Face, Point};

use super::RepairReport;
use super::faces::drop_faces;

/// Passes over the mesh: one needle's flip may leave another needle behind, a step smaller.
const MAX_PASSES: usize = 8;

/// Flips needles away where a neighbor can take them in, and drops those that are left.
pub(super) fn flip_needles(
    positions: &[Point],
    corners: &mut Vec<Face>,
    welded: &[u32],
    report: &mut RepairReport,
) {
    let is_needle = |face: &Face| face_normal(face.map(|v| positions[v as usize])).is_none();
    let mut needles: Vec<usize> = (0..corners.len())
        .filter(|&f| is_needle(&corners[f]))
        .collect();
    for _ in 0..MAX_PASSES {
        if needles.is_empty() {
            return;
        }
        let mut faces_on = faces_on_edges(corners, welded, &needles);
        let mut changed = Vec::new();
        for &needle in &needles {
            if !is_needle(&corners[needle]) {
                continue;
            }
            let neighbor = flip(positions, corners, welded, (needle, &mut faces_on));
            report.flipped_faces += usize::from(neighbor.is_some());
            changed.extend(neighbor);
        }
        if changed.is_empty() {
            break;
        }
        // No other face can have become one.
        needles.append(&mut changed);
        needles.retain(|&face| is_needle(&corners[face]));
        needles.sort_unstable();
        needles.dedup();
    }
    let dropped: Vec<u32> = needles.iter().map(|&face| face as u32).collect();
    report.degenerate_faces += dropped.len();
    drop_faces(corners, &dropped);
}

type FacesOnEdges = BTreeMap<Edge, Vec<usize>>;

/// The faces on every edge that has an end on one of `needles`: a flip asks for no other.
fn faces_on_edges(corners: &[Face], welded: &[u32], needles: &[usize]) -> FacesOnEdges {
    let mut is_end = vec![false; welded.len()];
    for corner in needles.iter().flat_map(|&needle| corners[needle]) {
        is_end[welded[corner as usize] as usize] = true;
    }
    let mut incidences = Vec::new();
    for (index, face) in corners.iter().enumerate() {
        let edges = Edge::of_face(face.map(|v| welded[v as usize]));
        let touching = edges
            .into_iter()
            .filter(|edge| is_end[edge.0 as usize] || is_end[edge.1 as usize]);
        incidences.extend(touching.map(|edge| (edge, index)));
    }
    incidences.sort_unstable();
    incidences
        .chunk_by(|a, b| a.0 == b.0)
        .map(|on| (on[0].0, on.iter().map(|&(_, face)| face).collect()))
        .collect()
}

/// Flips the longest edge of `needle`, if just one other face is on it, that face is not a
/// needle itself, and the new edge does not exist yet. Returns the other face if it did.
fn flip(
    positions: &[Point],
    corners: &mut [Face],
    welded: &[u32],
    (needle, faces_on): (usize, &mut FacesOnEdges),
) -> Option<usize> {
    let id = |v: u32| welded[v as usize];
    let at = |v: u32| positions[v as usize];
    let [a, b, c] = with_longest_edge_first(corners[needle], at);
    let long_edge = Edge::new(id(a), id(b));
    let Some(&[first, second]) = faces_on.get(&long_edge).map(Vec::as_slice) else {
        return None;
    };
    let neighbor = if first == needle { second } else { first };
    // The neighbor, turned so that its corner off the edge comes last: (b, a, d).
    let [x, y, z] = corners[neighbor];
    let turned = [[x, y, z], [y, z, x], [z, x, y]];
    let [nb, na, d] = turned
        .into_iter()
        .find(|t| id(t[0]) == id(b) && id(t[1]) == id(a))?;
    let new_edge = Edge::new(id(c), id(d));
    if id(c) == id(d)
        || faces_on.contains_key(&new_edge)
        || face_normal([nb, na, d].map(at)).is_none()
    {
        return None;
    }
    corners[needle] = [na, c, d];
    corners[neighbor] = [c, nb, d];
    faces_on.remove(&long_edge);
    faces_on.insert(new_edge, vec![needle, neighbor]);
    let mut replace = |edge: Edge, from: usize, to: usize| {
        let faces = faces_on.entry(edge).or_default();
        faces
            .iter_mut()
            .filter(|face| **face == from)
            .for_each(|face| *face = to);
    };
    // (b, c) was on the needle and (d, a) on the neighbor; they changed hands.
    replace(Edge::new(id(b), id(c)), needle, neighbor);
    replace(Edge::new(id(d), id(a)), neighbor, needle);
    Some(neighbor)
}

/// Turns a face so that its longest edge runs from the first corner to the second.
fn with_longest_edge_first([a, b, c]: Face, at: impl Fn(u32) -> Point) -> Face {
    let length = |from: u32, to: u32| (at(to) - at(from)).norm_squared();
    let (ab, bc, ca) = (length(a, b), length(b, c), length(c, a));
    if bc <= ab && ca <= ab {
        [a, b, c]
    } else if ca <= bc {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
