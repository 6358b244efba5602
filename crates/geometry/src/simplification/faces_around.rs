//! The faces around each vertex, as they change under edge collapses.

use crate::mesh::Rows;

/// Most faces around a vertex that a collapse may touch or make.
///
/// A collapse takes time in proportion to the faces around its vertices, so hubs with thousands
/// of faces would take a time that is quadratic in them. The faces around a hub still go, by
/// collapses of the edges opposite to it, until it is no longer one. Captures stay far below, at
/// some dozens.
pub(super) const MAX_VALENCE: usize = 128;

/// The faces around each vertex. A vertex that takes in another one gets a new row at the end.
pub(super) struct FacesAround {
    rows: Vec<Row>,
    faces: Vec<u32>,
    /// Length of `faces` at which the space of old rows is given back.
    compact_at: usize,
}

#[derive(Clone, Copy)]
struct Row {
    start: u32,
    length: u32,
    /// Faces of a hub's row that are no more: looking for them one by one would take too long.
    gone: u32,
}

impl Row {
    fn range(self) -> std::ops::Range<usize> {
        let start = self.start as usize;
        start..start + self.length as usize
    }

    fn is_hub(self) -> bool {
        MAX_VALENCE < (self.length - self.gone) as usize
    }
}

impl FacesAround {
    pub fn new(vertex_count: usize, faces: &Rows) -> Self {
        let mut around = Self {
            rows: Vec::with_capacity(vertex_count),
            faces: Vec::new(),
            compact_at: 0,
        };
        for vertex in 0..vertex_count {
            let start = around.faces.len() as u32;
            around.faces.extend_from_slice(faces.row(vertex));
            around.rows.push(Row {
                start,
                length: faces.row(vertex).len() as u32,
                gone: 0,
            });
        }
        around.compact_at = 2 * around.faces.len();
        around
    }

    /// The number of faces around a vertex.
    #[inline]
    pub fn valence(&self, vertex: u32) -> usize {
        let row = self.rows[vertex as usize];
        (row.length - row.gone) as usize
    }

    /// Whether a vertex has more than [`MAX_VALENCE`] faces.
    #[inline]
    pub fn is_hub(&self, vertex: u32) -> bool {
        self.rows[vertex as usize].is_hub()
    }

    /// The faces around a vertex. Those of a hub may include some that are no more.
    #[inline]
    pub fn row(&self, vertex: u32) -> &[u32] {
        &self.faces[self.rows[vertex as usize].range()]
    }

    /// Takes a face that is no more out of the row of a vertex.
    pub fn remove(&mut self, vertex: u32, face: u32, alive: &[bool]) {
        let row = &mut self.rows[vertex as usize];
        let faces = &mut self.faces[row.range()];
        if row.is_hub() {
            row.gone += 1;
            if !row.is_hub() {
                row.length = retain(faces, |face| alive[face as usize]) as u32;
                row.gone = 0;
            }
        } else if let Some(place) = faces.iter().position(|&f| f == face) {
            faces[place] = faces[faces.len() - 1];
            row.length -= 1;
        }
    }

    /// Gives `into` a new row of these faces, and leaves `from` without.
    pub fn merge(&mut self, (into, from): (u32, u32), faces: impl Iterator<Item = u32>) {
        self.make_room();
        let start = self.faces.len();
        self.faces.extend(faces);
        self.rows[from as usize].length = 0;
        self.rows[into as usize] = Row {
            start: start as u32,
            length: (self.faces.len() - start) as u32,
            gone: 0,
        };
    }

    /// Gives back the space of old rows if that has become as much as all rows had at first.
    fn make_room(&mut self) {
        if self.faces.len() <= self.compact_at {
            return;
        }
        let mut faces = Vec::with_capacity(self.compact_at);
        for row in &mut self.rows {
            let start = faces.len() as u32;
            faces.extend_from_slice(&self.faces[row.range()]);
            row.start = start;
        }
        self.faces = faces;
    }
}

/// Moves what is to be kept to the front, in order, and says how much that is.
fn retain(items: &mut [u32], is_kept: impl Fn(u32) -> bool) -> usize {
    let mut kept = 0;
    for index in 0..items.len() {
        let item = items[index];
        if is_kept(item) {
            items[kept] = item;
            kept += 1;
        }
    }
    kept
}
