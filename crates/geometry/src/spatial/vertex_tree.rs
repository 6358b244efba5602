//! Nearest vertex and vertices within a radius.

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::Point;

/// A k-d tree over points, in the order in which they were given.
pub struct VertexTree {
    tree: ImmutableKdTree<f64, 3>,
}

impl std::fmt::Debug for VertexTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("VertexTree")
            .field("points", &self.tree.size())
            .finish()
    }
}

impl VertexTree {
    /// Builds the tree; `None` for no points at all, which have no nearest one.
    #[must_use]
    pub fn new(points: &[Point]) -> Option<Self> {
        if points.is_empty() {
            return None;
        }
        let entries: Vec<[f64; 3]> = points.iter().map(|p| p.coords.into()).collect();
        let tree = ImmutableKdTree::new_from_slice(&entries).ok()?;
        Some(Self { tree })
    }

    /// The index of the point nearest to `query`, and its distance.
    #[must_use]
    pub fn nearest(&self, query: &Point) -> (u32, f64) {
        let query: [f64; 3] = query.coords.into();
        let nearest = self
            .tree
            .query(&query)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        (nearest.item, nearest.distance.sqrt())
    }

    /// Calls `visit` with the index of every point closer to `query` than `radius` (strictly), in
    /// an order that depends only on the points.
    pub fn visit_within(&self, query: &Point, radius: f64, mut visit: impl FnMut(u32)) {
        let query: [f64; 3] = query.coords.into();
        self.tree
            .query(&query)
            .within::<SquaredEuclidean<f64>>(radius * radius)
            .exclusive_boundaries()
            .unsorted()
            .visit(|found| visit(found.item));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_radius_is_exclusive() {
        let tree = VertexTree::new(&[Point::origin(), Point::new(3.0, 4.0, 0.0)]).unwrap();
        let within = |radius| {
            let mut found = vec![];
            tree.visit_within(&Point::origin(), radius, |index| found.push(index));
            found.sort_unstable();
            found
        };
        assert_eq!(within(5.0), [0]);
        assert_eq!(within(5.0 + 1e-9), [0, 1]);
    }

    #[test]
    fn nearest_gives_the_distance_itself() {
        let tree = VertexTree::new(&[Point::new(3.0, 4.0, 0.0)]).unwrap();
        assert_eq!(tree.nearest(&Point::origin()), (0, 5.0));
    }

    #[test]
    fn many_points_at_one_place_are_no_obstacle() {
        let tree = VertexTree::new(&vec![Point::new(1.0, 1.0, 1.0); 1000]).unwrap();
        assert_eq!(tree.nearest(&Point::new(1.0, 1.0, 2.0)).1, 1.0);
    }
}
