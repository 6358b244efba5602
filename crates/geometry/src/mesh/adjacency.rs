//! Which faces and which neighbors each vertex has, in flat rows.

use crate::TriangleMesh;

/// Rows of unequal length in one allocation (compressed sparse rows).
#[derive(Debug, Clone, PartialEq)]
pub struct Rows<T = u32> {
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy + Default> Rows<T> {
    /// Sorts `(row, item)` pairs into `row_count` rows, each in the order of the pairs.
    ///
    /// # Panics
    ///
    /// If a row is not below `row_count`.
    #[must_use]
    pub fn from_pairs(row_count: usize, pairs: &[(u32, T)]) -> Self {
        let mut starts = vec![0u32; row_count + 1];
        for &(row, _) in pairs {
            starts[row as usize + 1] += 1;
        }
        for row in 0..row_count {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut items = vec![T::default(); pairs.len()];
        for &(row, item) in pairs {
            items[next[row as usize] as usize] = item;
            next[row as usize] += 1;
        }
        Self { starts, items }
    }

    /// The items of `row`.
    ///
    /// # Panics
    ///
    /// If there is no such row.
    #[must_use]
    #[inline]
    pub fn row(&self, row: usize) -> &[T] {
        &self.items[self.starts[row] as usize..self.starts[row + 1] as usize]
    }

    /// The same rows with every item changed; `change` gets the item's row too.
    #[must_use]
    pub fn map<U>(&self, mut change: impl FnMut(usize, T) -> U) -> Rows<U> {
        let mut items = Vec::with_capacity(self.items.len());
        for row in 0..self.row_count() {
            items.extend(self.row(row).iter().map(|&item| change(row, item)));
        }
        Rows {
            starts: self.starts.clone(),
            items,
        }
    }

    /// The number of rows.
    #[must_use]
    pub fn row_count(&self) -> usize {
        self.starts.len() - 1
    }
}

/// [`TriangleMesh::vertex_faces`].
pub(super) fn vertex_faces(mesh: &TriangleMesh) -> Rows {
    let mut starts = vec![0u32; mesh.vertex_count() + 1];
    for &corner in mesh.faces().iter().flatten() {
        starts[corner as usize + 1] += 1;
    }
    for vertex in 0..mesh.vertex_count() {
        starts[vertex + 1] += starts[vertex];
    }
    let mut next = starts.clone();
    let mut items = vec![0; 3 * mesh.face_count()];
    for (index, face) in mesh.faces().iter().enumerate() {
        for &corner in face {
            items[next[corner as usize] as usize] = index as u32;
            next[corner as usize] += 1;
        }
    }
    Rows { starts, items }
}

/// [`TriangleMesh::vertex_neighbors`].
pub(super) fn vertex_neighbors(mesh: &TriangleMesh) -> Rows {
    let around = mesh.vertex_faces();
    let mut neighbors = Rows {
        starts: Vec::with_capacity(mesh.vertex_count() + 1),
        items: Vec::with_capacity(3 * mesh.face_count()),
    };
    neighbors.starts.push(0);
    let mut row = Vec::new();
    for vertex in 0..mesh.vertex_count() {
        row.clear();
        let corners = around
            .row(vertex)
            .iter()
            .flat_map(|&f| mesh.faces()[f as usize]);
        row.extend(corners.filter(|&corner| corner as usize != vertex));
        row.sort_unstable();
        row.dedup();
        neighbors.items.extend_from_slice(&row);
        neighbors.starts.push(neighbors.items.len() as u32);
    }
    neighbors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;

    #[test]
    fn a_shared_edge_makes_neighbors_once() {
        let mesh = TriangleMesh::new(vec![Point::origin(); 4], vec![[0, 1, 2], [2, 1, 3]]).unwrap();
        let neighbors = vertex_neighbors(&mesh);
        assert_eq!(neighbors.row(0), [1, 2]);
        assert_eq!(neighbors.row(1), [0, 2, 3]);
        assert_eq!(vertex_faces(&mesh).row(2), [0, 1]);
    }
}
