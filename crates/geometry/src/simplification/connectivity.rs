//! The mesh as it shrinks, and which collapses keep it a manifold.

use crate::mesh::Edge;
use crate::{Face, Point, TriangleMesh, Vector};

use super::faces_around::{FacesAround, MAX_VALENCE};
use super::surroundings::{Sector, Surroundings};

/// Faces and who is around whom, under edge collapses.
pub(super) struct Connectivity {
    faces: Vec<Face>,
    alive: Vec<bool>,
    face_count: usize,
    around: FacesAround,
    /// By vertex, whether it is on a boundary: whether its fan of faces is not closed.
    is_open: Vec<bool>,
    /// By vertex, whether it is on a boundary or on an edge whose faces turn against each other.
    is_irregular: Vec<bool>,
    marks: Marks,
    surroundings: Surroundings,
}

/// Tells in one look whether a vertex has been seen since the last fresh mark.
struct Marks {
    of_vertex: Vec<u32>,
    last: u32,
}

/// The square of the cosine of the largest angle by which a collapse may turn a face (78
/// degrees), after Garland's own implementation note that a right angle is too much.
const MIN_SQUARE_COSINE: f64 = 0.04;

impl Connectivity {
    pub fn new(mesh: &TriangleMesh) -> Self {
        let face_count = mesh.face_count();
        let mut connectivity = Self {
            faces: mesh.faces().to_vec(),
            alive: vec![true; face_count],
            face_count,
            around: FacesAround::new(mesh.vertex_count(), mesh.vertex_faces()),
            is_open: irregular_vertices(mesh),
            is_irregular: Vec::new(),
            marks: Marks {
                of_vertex: vec![0; mesh.vertex_count()],
                last: 0,
            },
            surroundings: Surroundings::default(),
        };
        connectivity.is_irregular = connectivity.is_open.clone();
        let mut neighbors = Vec::new();
        for vertex in 0..mesh.vertex_count() as u32 {
            if connectivity.is_open[vertex as usize] {
                connectivity.neighbors(vertex, &mut neighbors);
                // A closed fan has as many neighbors as faces, an open one has one more.
                let face_count = connectivity.around.valence(vertex);
                connectivity.is_open[vertex as usize] = face_count < neighbors.len();
            }
        }
        connectivity
    }

    pub fn face_count(&self) -> usize {
        self.face_count
    }

    pub fn vertex_count(&self) -> usize {
        self.marks.of_vertex.len()
    }

    /// The faces that are left.
    pub fn faces(&self) -> impl Iterator<Item = Face> {
        self.faces
            .iter()
            .zip(&self.alive)
            .filter(|(_, alive)| **alive)
            .map(|(face, _)| *face)
    }

    /// Whether a vertex has so many faces that no collapse may touch it.
    pub fn is_hub(&self, vertex: u32) -> bool {
        self.around.is_hub(vertex)
    }

    /// Puts the vertices that share an edge with `vertex`, which is not a hub, into `neighbors`,
    /// each once.
    pub fn neighbors(&mut self, vertex: u32, neighbors: &mut Vec<u32>) {
        neighbors.clear();
        let mark = self.marks.fresh();
        for &face in self.around.row(vertex) {
            let (next, last) = opposite(self.faces[face as usize], vertex);
            for corner in [next, last] {
                let is_new = self.marks.set(corner, mark);
                neighbors.push(corner);
                neighbors.truncate(neighbors.len() - usize::from(!is_new));
            }
        }
    }

    /// Reads the faces around a vertex, or the first of very many, for no other reason than to have
    /// them at hand.
    #[inline]
    pub fn read_around(&self, vertex: u32) -> u32 {
        const USUAL_VALENCE: usize = 6;
        let faces = self.around.row(vertex).iter().take(USUAL_VALENCE);
        faces.fold(0, |read, &face| read ^ self.faces[face as usize][0])
    }

    /// The corners across the edge between `a` and `b`, one for every face on it.
    fn apexes(&self, a: u32, b: u32) -> impl Iterator<Item = u32> {
        self.around
            .row(a)
            .iter()
            .filter_map(move |&face| apex(self.faces[face as usize], a, b))
    }

    /// The numbers of the faces that are left, ascending.
    pub fn face_numbers(&self) -> impl Iterator<Item = u32> {
        let numbers = (0..).zip(&self.alive);
        numbers.filter(|(_, alive)| **alive).map(|(face, _)| face)
    }

    /// The faces on the edge between `a` and `b`, each with the places of the two among its corners.
    pub fn faces_on(&self, a: u32, b: u32) -> impl Iterator<Item = (u32, [usize; 2])> {
        self.around.row(a).iter().filter_map(move |&face| {
            let corners = self.faces[face as usize];
            let place = |vertex| corners.iter().position(|&corner| corner == vertex);
            Some((face, [place(a)?, place(b)?]))
        })
    }

    /// Calls `take` with every edge of which neither end is a hub; with one whose faces turn
    /// against each other, perhaps twice.
    pub fn for_each_edge(&self, mut take: impl FnMut(Edge)) {
        for face in self.faces() {
            for corner in 0..3 {
                let (a, b) = (face[corner], face[(corner + 1) % 3]);
                if self.is_hub(a) || self.is_hub(b) {
                    continue;
                }
                if a < b || !self.has_opposite(a, b) {
                    take(Edge::new(a, b));
                }
            }
        }
    }

    /// Whether there is just one face on the edge from `a` to `b`, which has that one.
    pub fn is_boundary(&self, a: u32, b: u32) -> bool {
        !self.has_opposite(a, b) && self.apexes(a, b).count() == 1
    }

    /// Whether the edge from `a` to `b`, which a face has, runs the other way in another one.
    fn has_opposite(&self, a: u32, b: u32) -> bool {
        let is_regular = !self.is_irregular[a as usize] || !self.is_irregular[b as usize];
        let runs_back = |&face: &u32| {
            let [x, y, z] = self.faces[face as usize];
            [[x, y], [y, z], [z, x]].contains(&[b, a])
        };
        is_regular || self.around.row(b).iter().any(runs_back)
    }

    /// How many faces collapsing the edge between `a` and `b` takes away; `None` if it does not
    /// leave a surface of the same kind, or leaves a vertex with more than [`MAX_VALENCE`] faces.
    /// It is then the edge that [`Self::keeps_orientation`] and [`Self::collapse`] are about.
    ///
    /// The link condition, Lk(a) ∩ Lk(b) = Lk(ab): Dey, Edelsbrunner, Guha and Nekhayev,
    /// "Topology Preserving Edge Contraction", Publications de l'Institut Mathématique 66(80),
    /// 1999, with the boundary closed by an imagined vertex.
    pub fn faces_of_collapse(&mut self, a: u32, b: u32) -> Option<usize> {
        if MAX_VALENCE < self.around.valence(a) + self.around.valence(b) {
            return None;
        }
        let common = self.look_around(a, b);
        let (first, second) = match self.surroundings.vanishing() {
            [(_, one)] => (*one, None),
            [(_, one), (_, other)] if one != other => (*one, Some(*other)),
            _ => return None,
        };
        // An apex that only this face holds would be lost, and with it the surface's outline.
        let is_held = |apex: u32| self.around.valence(apex) != 1;
        if !is_held(first) || !second.is_none_or(is_held) {
            return None;
        }
        // Nor may a face go that hangs on its apex alone.
        if second.is_none() && self.around.valence(a) == 1 && self.around.valence(b) == 1 {
            return None;
        }
        // Apexes are neighbors of both: equal numbers are equal sets.
        let apex_count = 1 + usize::from(second.is_some());
        if common != apex_count {
            return None;
        }
        let Some(second) = second else {
            return Some(1);
        };
        if self.is_open[a as usize] && self.is_open[b as usize] {
            return None;
        }
        // A face at a and one at b over the same edge would fall onto each other, as on a
        // tetrahedron; that edge could only run between the apexes.
        let [at_a, at_b] = self.surroundings.staying();
        let is_between_apexes = |sector: &Sector| {
            (sector.next, sector.last) == (first, second)
                || (sector.last, sector.next) == (first, second)
        };
        let fall_together =
            at_a.iter().any(is_between_apexes) && at_b.iter().any(is_between_apexes);
        (!fall_together).then_some(2)
    }

    /// Writes down what is around the edge between `a` and `b`, and says how many vertices neighbor
    /// both. Without branches on who is whom, which are not to be foretold.
    fn look_around(&mut self, a: u32, b: u32) -> usize {
        let (of_a, counted) = (self.marks.fresh(), self.marks.fresh());
        let around = &mut self.surroundings;
        around.start((a, b));
        for &face in self.around.row(a) {
            let (next, last) = opposite(self.faces[face as usize], a);
            self.marks.set(next, of_a);
            self.marks.set(last, of_a);
            around.add_at_a(Sector { face, next, last });
        }
        around.staying_at_a = around.staying_count;
        let mut common = 0;
        for &face in self.around.row(b) {
            let (next, last) = opposite(self.faces[face as usize], b);
            for corner in [next, last] {
                let mark = &mut self.marks.of_vertex[corner as usize];
                let is_common = *mark == of_a;
                common += usize::from(is_common);
                *mark = if is_common { counted } else { *mark };
            }
            around.add_at_b(Sector { face, next, last });
        }
        common
    }

    /// Whether moving both ends of the edge to `to` keeps every face around them, but those on the
    /// edge, turned the way it was and with an area.
    pub fn keeps_orientation(&self, positions: &[Point], to: &Point) -> bool {
        let at = |corner: u32| &positions[corner as usize];
        let (a, b) = self.surroundings.edge;
        let [at_a, at_b] = self.surroundings.staying();
        [(a, at_a), (b, at_b)].into_iter().all(|(vertex, sectors)| {
            sectors.iter().all(|&Sector { next, last, .. }| {
                let far_edge = at(last) - at(next);
                keeps_side(&far_edge, &(at(vertex) - at(next)), &(to - at(next)))
            })
        })
    }

    /// Merges the edge's second end into its first. The faces on it vanish.
    pub fn collapse(&mut self) {
        let (a, b) = self.surroundings.edge;
        self.is_open[a as usize] |= self.is_open[b as usize];
        self.is_irregular[a as usize] |= self.is_irregular[b as usize];
        for &(face, apex) in self.surroundings.vanishing() {
            self.alive[face as usize] = false;
            self.face_count -= 1;
            self.around.remove(apex, face, &self.alive);
        }
        let [at_a, at_b] = self.surroundings.staying();
        for &Sector { face, .. } in at_b {
            let corners = &mut self.faces[face as usize];
            *corners = corners.map(|corner| if corner == b { a } else { corner });
        }
        let staying = at_a.iter().chain(at_b).map(|sector| sector.face);
        self.around.merge((a, b), staying);
    }
}

impl Marks {
    /// A mark that no vertex has.
    fn fresh(&mut self) -> u32 {
        if self.last == u32::MAX {
            self.of_vertex.fill(0);
            self.last = 0;
        }
        self.last += 1;
        self.last
    }

    /// Marks a vertex and says whether it had another mark.
    #[inline]
    fn set(&mut self, vertex: u32, mark: u32) -> bool {
        std::mem::replace(&mut self.of_vertex[vertex as usize], mark) != mark
    }
}

/// The vertices whose fan of faces is open or not turned one way: around the others, what follows a
/// vertex in its faces and what precedes it are the same vertices.
///
/// A sum of hashes: what is missed, one in 2⁶⁴, is a boundary that is taken for none.
fn irregular_vertices(mesh: &TriangleMesh) -> Vec<bool> {
    let hash = |vertex: u32| {
        // 2⁶⁴ divided by the golden ratio spreads neighbors far apart (Knuth's multiplicative
        // hashing); once more, so that sums of hashes are not hashes of sums.
        const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
        let mixed = (u64::from(vertex) + 1).wrapping_mul(SPREAD);
        (mixed ^ (mixed >> 32)).wrapping_mul(SPREAD)
    };
    let mut sums = vec![0u64; mesh.vertex_count()];
    for face in mesh.faces() {
        let [a, b, c] = face.map(hash);
        for (vertex, next, last) in [(face[0], b, c), (face[1], c, a), (face[2], a, b)] {
            let sum = &mut sums[vertex as usize];
            *sum = sum.wrapping_add(next).wrapping_sub(last);
        }
    }
    sums.iter().map(|&sum| sum != 0).collect()
}

/// The other two corners of a face that has `vertex`, in the face's direction.
#[inline]
fn opposite([x, y, z]: Face, vertex: u32) -> (u32, u32) {
    let is_second = 0u32.wrapping_sub(u32::from(y == vertex));
    let is_third = 0u32.wrapping_sub(u32::from(z == vertex));
    let is_first = !(is_second | is_third);
    (
        y & is_first | z & is_second | x & is_third,
        z & is_first | x & is_second | y & is_third,
    )
}

/// The third corner of a face with `a`, if it has `b` too.
#[inline]
fn apex([x, y, z]: Face, a: u32, b: u32) -> Option<u32> {
    if x == b {
        Some(if y == a { z } else { y })
    } else if y == b {
        Some(if x == a { z } else { x })
    } else if z == b {
        Some(if x == a { y } else { x })
    } else {
        None
    }
}

/// What is no height, relative to the longest edge.
const NO_HEIGHT: f64 = 1e-12;

/// What is too low to be made by a collapse.
const MIN_HEIGHT: f64 = 1e-6;

/// Whether a triangle over `base` keeps its direction, within the largest angle, when its third
/// corner goes from `before` to `after` (all from the base's first end).
///
/// A triangle that has no area before may go anywhere; none may lose it. What counts as no area
/// is that of [`face_normal`](crate::mesh::face_normal); a triangle that is higher than
/// [`MIN_HEIGHT`] must stay so, since vertices are rounded afterwards.
#[inline]
fn keeps_side(base: &Vector, before: &Vector, after: &Vector) -> bool {
    let (old, new) = (base.cross(before), base.cross(after));
    let (old_square, new_square) = (old.norm_squared(), new.norm_squared());
    let cosine = old.dot(&new);
    let keeps = 0.0 < cosine && MIN_SQUARE_COSINE * old_square * new_square < cosine * cosine;
    // Most triangles are so high that there is no need to look for their longest edge: its square is
    // at most twice the sum of the other two.
    let longest_at_most = 2.0 * (base.norm_squared() + after.norm_squared());
    if keeps && MIN_HEIGHT * MIN_HEIGHT * longest_at_most * longest_at_most < new_square {
        return true;
    }
    let longest_square = |corner: &Vector| {
        let longest = base.norm_squared().max(corner.norm_squared());
        longest.max((corner - base).norm_squared())
    };
    // Heights are compared by their squares.
    let is_higher = |square: f64, corner: &Vector, height: f64| {
        let longest = longest_square(corner);
        height * height * longest * longest < square
    };
    let has_area = |square: f64, corner: &Vector| is_higher(square, corner, NO_HEIGHT);
    if !is_higher(new_square, after, MIN_HEIGHT)
        && (!has_area(new_square, after) || is_higher(old_square, before, MIN_HEIGHT))
    {
        return false;
    }
    keeps || !has_area(old_square, before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::EdgeTable;

    /// A torus of quads, cut in two, with some faces turned and some left out.
    fn torus(keeps: impl Fn(u32) -> bool, turns: impl Fn(u32) -> bool) -> TriangleMesh {
        let side = 12u32;
        let at = |i: u32, j: u32| i % side * side + j % side;
        let faces = (0..side * side).flat_map(|k| {
            let (i, j) = (k / side, k % side);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        });
        let faces = faces.zip(0..).filter(|(_, index)| keeps(*index));
        let faces =
            faces.map(|([a, b, c], index)| if turns(index) { [a, c, b] } else { [a, b, c] });
        let positions = vec![Point::origin(); (side * side) as usize];
        TriangleMesh::new(positions, faces.collect()).unwrap()
    }

    #[test]
    fn every_edge_is_found_with_holes_and_faces_turned_either_way() {
        let holes = torus(|index| index % 17 != 3, |_| false);
        let turned = torus(|_| true, |index| index % 5 == 0);
        let both = torus(|index| index % 17 != 3, |index| index * 7 % 3 == 0);
        for mesh in [holes, turned, both] {
            let mut found = Vec::new();
            Connectivity::new(&mesh).for_each_edge(|edge| found.push(edge));
            found.sort_unstable();
            found.dedup();
            let table = EdgeTable::of(mesh.faces());
            assert_eq!(
                found,
                table.iter().map(|(edge, _)| edge).collect::<Vec<_>>()
            );
        }
    }

    #[test]
    fn boundaries_are_where_one_face_is() {
        let mesh = torus(|index| index % 17 != 3, |index| index % 5 == 0);
        let connectivity = Connectivity::new(&mesh);
        for (edge, faces) in EdgeTable::of(mesh.faces()).iter() {
            let face = mesh.faces()[faces[0].1 as usize];
            let runs = (0..3).map(|corner| (face[corner], face[(corner + 1) % 3]));
            let (a, b) = runs
                .into_iter()
                .find(|&(a, b)| Edge::new(a, b) == edge)
                .unwrap();
            assert_eq!(connectivity.is_boundary(a, b), faces.len() == 1, "{edge:?}");
        }
    }
}
