//! Which collapses leave the charts of a texture apart, and what becomes of its wedges.

use crate::mesh::{Edge, Wedges};
use crate::{Face, TriangleMesh};

use super::NO_WEDGE;
use super::attribute_costs::Pairs;
use super::connectivity::Connectivity;

/// What a vertex is to the seams.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// No seam comes near.
    Inside,
    /// One seam passes: two sides, and two edges along it.
    OnSeam,
    /// Seams meet, end, or reach the boundary of the mesh: it stays.
    Fixed,
}

/// The seams of a mesh whose edges collapse.
///
/// A vertex that is gone leaves its wedges to those of the vertex it went into, side by side: where
/// that is not possible the collapse is refused. So a face never has corners of two charts.
pub(super) struct Seams<'a> {
    wedges: &'a Wedges,
    kinds: Vec<Kind>,
    /// By face, which of its edges (from corner i to i + 1) are seams, one bit each.
    seam_edges: Vec<u8>,
    /// The wedge that each has gone into, or itself.
    merged_into: Vec<u32>,
}

/// An edge from a vertex, as one of its faces has it: the vertex at the other end, the wedges at both
/// ends, and the face with the edge's number in it.
type Spoke = (u32, [u32; 2], (u32, u8));

impl<'a> Seams<'a> {
    pub fn new(mesh: &TriangleMesh, wedges: &'a Wedges) -> Self {
        let mut seams = Self {
            wedges,
            kinds: vec![Kind::Inside; mesh.vertex_count()],
            seam_edges: vec![0; mesh.face_count()],
            merged_into: (0..wedges.count() as u32).collect(),
        };
        let mut count = vec![0u32; mesh.vertex_count()];
        for &vertex in wedges.vertices() {
            count[vertex as usize] += 1;
        }
        let mut ends = Vec::new();
        let mut spokes = Vec::new();
        // An edge is a seam where the wedges of its two faces differ, and at one of its ends at
        // least there are two wedges then.
        for vertex in (0..mesh.vertex_count() as u32).filter(|&v| 1 < count[v as usize]) {
            collect_spokes(mesh, wedges, vertex, &mut spokes);
            let (mut on_seam, mut is_closed) = (0, true);
            for edge in spokes.chunk_by(|a, b| a.0 == b.0) {
                is_closed &= edge.len() == 2;
                if edge.iter().all(|spoke| spoke.1 == edge[0].1) {
                    continue;
                }
                on_seam += 1;
                for &(end, _, (face, number)) in edge {
                    seams.seam_edges[face as usize] |= 1 << number;
                    ends.push(end);
                }
            }
            let is_simple = is_closed && on_seam == 2 && count[vertex as usize] == 2;
            seams.kinds[vertex as usize] = if is_simple { Kind::OnSeam } else { Kind::Fixed };
        }
        // Where a seam ends there is one wedge.
        for end in ends.into_iter().filter(|&end| count[end as usize] == 1) {
            seams.kinds[end as usize] = Kind::Fixed;
        }
        seams
    }

    /// Whether the edge of a face from corner `corner` on is a seam.
    pub fn is_seam(&self, face: usize, corner: usize) -> bool {
        self.seam_edges[face] & (1 << corner) != 0
    }

    /// Which vertex would be left and which be gone if an edge collapsed; none if it must not.
    pub fn left_and_gone(
        &self,
        connectivity: &Connectivity,
        Edge(a, b): Edge,
    ) -> Option<(u32, u32)> {
        let (left, gone) = match (self.kinds[a as usize], self.kinds[b as usize]) {
            (_, Kind::Inside) => return Some((a, b)),
            (Kind::Inside, _) => return Some((b, a)),
            (_, Kind::OnSeam) => (a, b),
            (Kind::OnSeam, Kind::Fixed) => (b, a),
            (Kind::Fixed, Kind::Fixed) => return None,
        };
        // Along the seam each side goes into its own. Across a chart both would go into one.
        let mut sides = connectivity.faces_on(left, gone);
        let (first, second) = (sides.next()?, sides.next()?);
        let [first, second] = [first, second].map(|side| self.side(side));
        (first[1] != second[1]).then_some((left, gone))
    }

    /// The wedges that become one if a vertex goes into another: one pair, or one for each side.
    pub fn pairs(&self, connectivity: &Connectivity, (left, gone): (u32, u32)) -> Pairs {
        let mut sides = connectivity.faces_on(left, gone);
        let first = sides.next().map(|side| self.side(side));
        let second = sides.next().map(|side| self.side(side));
        [first, second.filter(|_| second != first)]
    }

    /// Merges the wedges of a vertex that goes into those of the one that is left.
    pub fn merge(&mut self, pairs: &Pairs) {
        for [kept, merged] in pairs.iter().flatten() {
            self.merged_into[*merged as usize] = *kept;
        }
    }

    /// The wedges that are left, over vertices with new `numbers`, and which of them each wedge of
    /// the original has gone into.
    pub fn finish(&self, connectivity: &Connectivity, numbers: &[u32]) -> (Wedges, Vec<u32>) {
        let mut new = vec![NO_WEDGE; self.merged_into.len()];
        let mut vertices = Vec::new();
        let number_of = |(face, vertices_of_face): (u32, Face)| -> Face {
            let corners = self.wedges.corners()[face as usize];
            std::array::from_fn(|corner| {
                let wedge = self.resolved(corners[corner]) as usize;
                if new[wedge] == NO_WEDGE {
                    new[wedge] = vertices.len() as u32;
                    vertices.push(numbers[vertices_of_face[corner] as usize]);
                }
                new[wedge]
            })
        };
        let faces = connectivity.face_numbers().zip(connectivity.faces());
        let corners = faces.map(number_of).collect();
        let merged = (0..new.len() as u32).map(|wedge| new[self.resolved(wedge) as usize]);
        let merged = merged.collect();
        (Wedges::from_valid(corners, vertices), merged)
    }

    /// The wedges at two corners of a face.
    fn side(&self, (face, places): (u32, [usize; 2])) -> [u32; 2] {
        let corners = self.wedges.corners()[face as usize];
        places.map(|place| self.resolved(corners[place]))
    }

    fn resolved(&self, mut wedge: u32) -> u32 {
        while self.merged_into[wedge as usize] != wedge {
            wedge = self.merged_into[wedge as usize];
        }
        wedge
    }
}

/// All edges from a vertex, once for every face on them, sorted by their other end.
fn collect_spokes(mesh: &TriangleMesh, wedges: &Wedges, vertex: u32, spokes: &mut Vec<Spoke>) {
    spokes.clear();
    for &face in mesh.vertex_faces().row(vertex as usize) {
        let (vertices, corners) = (mesh.faces()[face as usize], wedges.corners()[face as usize]);
        for number in 0..3 {
            let next = (number + 1) % 3;
            let (from, to) = (vertices[number], vertices[next]);
            let edge = (face, number as u8);
            if from == vertex {
                spokes.push((to, [corners[number], corners[next]], edge));
            } else if to == vertex {
                spokes.push((from, [corners[next], corners[number]], edge));
            }
        }
    }
    spokes.sort_unstable();
}
