//! The mesh as it shrinks, and which collapses keep it a manifold.

use crate::mesh::vertex_faces;
use crate::{Face, Point, TriangleMesh, Vector};

use super::faces_around::{FacesAround, MAX_VALENCE};

/// Faces and who is around whom, under edge collapses.
pub(super) struct Connectivity {
    faces: Vec<Face>,
    alive: Vec<bool>,
    face_count: usize,
    around: FacesAround,
    marks: Marks,
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
        Self {
            faces: mesh.faces().to_vec(),
            alive: vec![true; face_count],
            face_count,
            around: FacesAround::new(mesh.vertex_count(), &vertex_faces(mesh)),
            marks: Marks {
                of_vertex: vec![0; mesh.vertex_count()],
                last: 0,
            },
        }
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
            for corner in self.faces[face as usize] {
                if corner != vertex && self.marks.set(corner, mark) {
                    neighbors.push(corner);
                }
            }
        }
    }

    /// The corners across the edge between `a` and `b`, one for every face on it.
    fn apexes(&self, a: u32, b: u32) -> impl Iterator<Item = u32> {
        self.around
            .row(a)
            .iter()
            .filter_map(move |&face| apex(self.faces[face as usize], a, b))
    }

    /// The number of faces on the edge between `a` and `b`, not both of them hubs unless nothing
    /// was collapsed yet.
    pub fn face_count_on(&self, a: u32, b: u32) -> usize {
        if self.around.valence(a) <= self.around.valence(b) {
            self.apexes(a, b).count()
        } else {
            self.apexes(b, a).count()
        }
    }

    /// Whether collapsing the edge between `a` and `b` leaves a surface of the same kind, and no
    /// vertex with more than [`MAX_VALENCE`] faces.
    ///
    /// The link condition, Lk(a) ∩ Lk(b) = Lk(ab): Dey, Edelsbrunner, Guha and Nekhayev,
    /// "Topology Preserving Edge Contraction", Publications de l'Institut Mathématique 66(80),
    /// 1999, with the boundary closed by an imagined vertex.
    pub fn may_collapse(&mut self, a: u32, b: u32) -> bool {
        if MAX_VALENCE < self.around.valence(a) + self.around.valence(b) {
            return false;
        }
        let mut apexes = self.apexes(a, b);
        let (first, second) = (apexes.next(), apexes.next());
        let (Some(first), None) = (first, apexes.next()) else {
            return false;
        };
        drop(apexes);
        if second == Some(first) {
            return false;
        }
        // An apex that only this face holds would be lost, and with it the surface's outline.
        let apex_count = 1 + usize::from(second.is_some());
        if [Some(first), second]
            .into_iter()
            .flatten()
            .any(|apex| self.around.valence(apex) == 1)
        {
            return false;
        }
        let (common, [a_is_on_boundary, b_is_on_boundary]) = self.common_neighbors(a, b);
        // Apexes are neighbors of both: equal numbers are equal sets.
        if common != apex_count {
            return false;
        }
        let Some(second) = second else { return true };
        if a_is_on_boundary && b_is_on_boundary {
            return false;
        }
        // A face at a and one at b over the same edge would fall onto each other, as on a
        // tetrahedron; that edge could only run between the apexes.
        !(self.has_face([a, first, second]) && self.has_face([b, first, second]))
    }

    /// The number of vertices that neighbor both, and whether each of the two is on a boundary.
    fn common_neighbors(&mut self, a: u32, b: u32) -> (usize, [bool; 2]) {
        let (of_a, of_both, of_b) = (self.marks.fresh(), self.marks.fresh(), self.marks.fresh());
        let mut count_a = 0;
        for &face in self.around.row(a) {
            for corner in self.faces[face as usize] {
                count_a += usize::from(corner != a && self.marks.set(corner, of_a));
            }
        }
        let (mut common, mut count_b) = (0, 0);
        for &face in self.around.row(b) {
            for corner in self.faces[face as usize] {
                let mark = &mut self.marks.of_vertex[corner as usize];
                if corner == b || *mark == of_both || *mark == of_b {
                    continue;
                }
                count_b += 1;
                let is_common = *mark == of_a;
                common += usize::from(is_common);
                *mark = if is_common { of_both } else { of_b };
            }
        }
        // A closed fan has as many neighbors as faces, an open one has one more.
        let on_boundary = [
            self.around.row(a).len() < count_a,
            self.around.row(b).len() < count_b,
        ];
        (common, on_boundary)
    }

    /// Whether the three vertices, the first of them alive, are the corners of a face.
    fn has_face(&self, [a, b, c]: [u32; 3]) -> bool {
        self.around.row(a).iter().any(|&face| {
            let corners = self.faces[face as usize];
            corners.contains(&b) && corners.contains(&c)
        })
    }

    /// Whether moving `a` and `b` to `to` keeps every face around them, but those on their edge,
    /// turned the way it was and with an area.
    pub fn keeps_orientation(&self, positions: &[Point], (a, b): (u32, u32), to: &Point) -> bool {
        let at = |corner: u32| &positions[corner as usize];
        [(a, b), (b, a)].into_iter().all(|(vertex, other)| {
            self.around.row(vertex).iter().all(|&face| {
                let [x, y, z] = self.faces[face as usize];
                // The other two corners, in the face's direction.
                let (left, right) = if x == vertex {
                    (y, z)
                } else if y == vertex {
                    (z, x)
                } else {
                    (x, y)
                };
                left == other || right == other || {
                    let far_edge = at(right) - at(left);
                    keeps_side(&far_edge, &(at(vertex) - at(left)), &(to - at(left)))
                }
            })
        })
    }

    /// Merges `b` into `a`. The faces on their edge vanish.
    pub fn collapse(&mut self, a: u32, b: u32) {
        let start = self.around.start_row();
        for index in self.around.range(a) {
            let face = self.around.at(index);
            match apex(self.faces[face as usize], a, b) {
                Some(apex) => {
                    self.alive[face as usize] = false;
                    self.face_count -= 1;
                    self.around.remove(apex, face, &self.alive);
                }
                None => self.around.push(face),
            }
        }
        for index in self.around.range(b) {
            let face = self.around.at(index);
            if self.alive[face as usize] {
                let corners = &mut self.faces[face as usize];
                *corners = corners.map(|corner| if corner == b { a } else { corner });
                self.around.push(face);
            }
        }
        self.around.finish_row(start, (a, b));
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

/// Whether a triangle over `base` keeps its direction, within the largest angle, when its third
/// corner goes from `before` to `after` (all from the base's first end).
///
/// A triangle that has no area before may go anywhere; none may lose it. What counts as no area
/// is that of [`face_normal`](crate::mesh::face_normal): a height of 1e-12 of the longest edge.
#[inline]
fn keeps_side(base: &Vector, before: &Vector, after: &Vector) -> bool {
    let (old, new) = (base.cross(before), base.cross(after));
    let (old_square, new_square) = (old.norm_squared(), new.norm_squared());
    let longest_square = |corner: &Vector| {
        let longest = base.norm_squared().max(corner.norm_squared());
        longest.max((corner - base).norm_squared())
    };
    let has_area = |square: f64, corner: &Vector| {
        let longest = longest_square(corner);
        1e-24 * longest * longest < square
    };
    if !has_area(new_square, after) {
        return false;
    }
    let cosine = old.dot(&new);
    let keeps = 0.0 < cosine && MIN_SQUARE_COSINE * old_square * new_square < cosine * cosine;
    keeps || !has_area(old_square, before)
}
