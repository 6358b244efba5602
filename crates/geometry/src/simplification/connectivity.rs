//! The mesh as it shrinks, and which collapses keep it a manifold.

use crate::mesh::face_normal;
use crate::{Face, Point};

/// Faces and who is around whom, under edge collapses.
pub(super) struct Connectivity {
    faces: Vec<Face>,
    alive: Vec<bool>,
    around: Vec<Vec<u32>>,
    face_count: usize,
}

/// The cosine of the largest angle by which a collapse may turn a face (78 degrees), after
/// Garland's own implementation note that a right angle is too much.
const MIN_NORMAL_COSINE: f64 = 0.2;

impl Connectivity {
    pub fn new(vertex_count: usize, faces: &[Face]) -> Self {
        let mut around = vec![Vec::new(); vertex_count];
        for (index, face) in faces.iter().enumerate() {
            for &corner in face {
                around[corner as usize].push(index as u32);
            }
        }
        let face_count = faces.len();
        Self {
            faces: faces.to_vec(),
            alive: vec![true; face_count],
            around,
            face_count,
        }
    }

    pub fn face_count(&self) -> usize {
        self.face_count
    }

    /// The faces that are left.
    pub fn faces(&self) -> impl Iterator<Item = Face> {
        self.faces
            .iter()
            .zip(&self.alive)
            .filter(|(_, alive)| **alive)
            .map(|(face, _)| *face)
    }

    /// The vertices that share an edge with `vertex`, ascending.
    pub fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let corners = self.around[vertex as usize]
            .iter()
            .flat_map(|&f| self.faces[f as usize]);
        let mut neighbors: Vec<u32> = corners.filter(|&corner| corner != vertex).collect();
        neighbors.sort_unstable();
        neighbors.dedup();
        neighbors
    }

    /// The faces on the edge between `a` and `b`.
    pub fn faces_on(&self, a: u32, b: u32) -> Vec<u32> {
        let has_b = |face: &&u32| self.faces[**face as usize].contains(&b);
        self.around[a as usize]
            .iter()
            .filter(has_b)
            .copied()
            .collect()
    }

    /// Whether an edge at `vertex` has just one face.
    fn is_on_boundary(&self, vertex: u32) -> bool {
        self.neighbors(vertex)
            .iter()
            .any(|&other| self.faces_on(vertex, other).len() == 1)
    }

    /// Whether collapsing the edge between `a` and `b` leaves a surface of the same kind.
    ///
    /// The link condition, Lk(a) ∩ Lk(b) = Lk(ab): Dey, Edelsbrunner, Guha and Nekhayev,
    /// "Topology Preserving Edge Contraction", Publications de l'Institut Mathématique 66(80),
    /// 1999, with the boundary closed by an imagined vertex.
    pub fn may_collapse(&self, a: u32, b: u32) -> bool {
        let on_edge = self.faces_on(a, b);
        if on_edge.is_empty() || 2 < on_edge.len() {
            return false;
        }
        let mut apexes: Vec<u32> = on_edge.iter().map(|&f| self.apex(f, a, b)).collect();
        apexes.sort_unstable();
        apexes.dedup();
        let of_b = self.neighbors(b);
        let mut common = self.neighbors(a);
        common.retain(|vertex| of_b.binary_search(vertex).is_ok());
        if common != apexes || apexes.len() != on_edge.len() {
            return false;
        }
        // An apex that only this face holds would be lost, and with it the surface's outline.
        if apexes
            .iter()
            .any(|&apex| self.around[apex as usize].len() == 1)
        {
            return false;
        }
        let joins_boundaries =
            on_edge.len() == 2 && self.is_on_boundary(a) && self.is_on_boundary(b);
        !joins_boundaries && !self.share_a_link_edge(a, b)
    }

    fn apex(&self, face: u32, a: u32, b: u32) -> u32 {
        let corners = self.faces[face as usize];
        corners
            .into_iter()
            .find(|&corner| corner != a && corner != b)
            .unwrap_or(a)
    }

    /// Whether a face at `a` and one at `b` have the same opposite edge: they would fall onto
    /// each other, as on a tetrahedron.
    fn share_a_link_edge(&self, a: u32, b: u32) -> bool {
        let opposite = |face: u32, vertex: u32, other: u32| {
            let corners = self.faces[face as usize];
            if corners.contains(&other) {
                return None;
            }
            let mut rest: Vec<u32> = corners.into_iter().filter(|&c| c != vertex).collect();
            rest.sort_unstable();
            Some(rest)
        };
        let of_a: Vec<Vec<u32>> = self.around[a as usize]
            .iter()
            .filter_map(|&f| opposite(f, a, b))
            .collect();
        self.around[b as usize]
            .iter()
            .filter_map(|&f| opposite(f, b, a))
            .any(|e| of_a.contains(&e))
    }

    /// Whether moving `a` and `b` to `to` keeps every face around them, but those on their edge,
    /// turned the way it was and with an area.
    pub fn keeps_orientation(&self, positions: &[Point], (a, b): (u32, u32), to: &Point) -> bool {
        [(a, b), (b, a)].into_iter().all(|(vertex, other)| {
            self.around[vertex as usize].iter().all(|&face| {
                let corners = self.faces[face as usize];
                if corners.contains(&other) {
                    return true;
                }
                let before = face_normal(corners.map(|c| positions[c as usize]));
                let moved = corners.map(|c| {
                    if c == vertex {
                        *to
                    } else {
                        positions[c as usize]
                    }
                });
                match (before, face_normal(moved)) {
                    (_, None) => false,
                    (None, Some(_)) => true,
                    (Some(before), Some(after)) => MIN_NORMAL_COSINE < before.dot(&after),
                }
            })
        })
    }

    /// Merges `b` into `a`. The faces on their edge vanish.
    pub fn collapse(&mut self, a: u32, b: u32) {
        for face in self.faces_on(a, b) {
            self.alive[face as usize] = false;
            self.face_count -= 1;
            for corner in self.faces[face as usize] {
                self.around[corner as usize].retain(|&f| f != face);
            }
        }
        let moved = std::mem::take(&mut self.around[b as usize]);
        for &face in &moved {
            let corners = &mut self.faces[face as usize];
            corners
                .iter_mut()
                .filter(|corner| **corner == b)
                .for_each(|corner| *corner = a);
        }
        self.around[a as usize].extend(moved);
    }
}
