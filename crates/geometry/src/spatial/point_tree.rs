//! Points within a radius.

use crate::Point;

use super::box_tree::BoxTree;

/// A tree of boxes over points, for many searches within a small radius.
///
/// The points should be within a few units of the origin: further away the search is as exact,
/// but slower.
pub struct PointTree {
    boxes: BoxTree,
    /// In the order of the boxes.
    points: Vec<Point>,
}

/// How far boxes are grown: above what `f32` rounds a coordinate of up to 4 by.
const BOX_MARGIN: f32 = 5e-7;

/// On the squared radius: covers the rounding of squares, and of coordinates further away.
const BOUND_MARGIN: f64 = 1.0 + 1e-5;

impl PointTree {
    /// Builds the tree; `None` for no points at all.
    #[must_use]
    pub fn new(points: &[Point]) -> Option<Self> {
        if points.is_empty() {
            return None;
        }
        let boxes = BoxTree::new(points.len(), |index| {
            let center: [f32; 3] = points[index as usize].coords.map(|c| c as f32).into();
            [
                center.map(|c| c - BOX_MARGIN),
                center.map(|c| c + BOX_MARGIN),
            ]
        });
        let points = boxes.items().iter().map(|&i| points[i as usize]).collect();
        Some(Self { boxes, points })
    }

    /// The points' indices in the tree's order: *slots* are places in it.
    #[must_use]
    pub fn items(&self) -> &[u32] {
        self.boxes.items()
    }

    /// The point in a slot.
    ///
    /// # Panics
    ///
    /// If there is no such slot.
    #[must_use]
    pub fn point(&self, slot: u32) -> &Point {
        &self.points[slot as usize]
    }

    /// Calls `visit` with the slot of every point closer to `query` than `radius` (strictly) and
    /// the square of its distance, in an order that depends only on the points.
    pub fn visit_within(&self, query: &Point, radius: f64, mut visit: impl FnMut(u32, f64)) {
        let square = radius * radius;
        let coordinates: [f32; 3] = query.coords.map(|c| c as f32).into();
        let bound = (square * BOUND_MARGIN) as f32;
        self.boxes.visit_within(&coordinates, bound, |slot| {
            let distance = (self.points[slot as usize] - query).norm_squared();
            if distance < square {
                visit(slot, distance);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The tree finds what looking at every point finds.
        #[test]
        fn the_tree_agrees_with_looking_at_every_point(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 1..300),
            query in prop::array::uniform3(-1.5..1.5_f64),
            radius in 0.0..1.0_f64,
        ) {
            let points: Vec<Point> = points.into_iter().map(Point::from).collect();
            let query = Point::from(query);
            let tree = PointTree::new(&points).unwrap();
            let mut found = vec![];
            tree.visit_within(&query, radius, |slot, _| found.push(tree.items()[slot as usize]));
            found.sort_unstable();
            let near = |i: &u32| (points[*i as usize] - query).norm_squared() < radius * radius;
            let expected: Vec<u32> = (0..points.len() as u32).filter(near).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
