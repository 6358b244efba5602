//! Points within a radius.

use wide::f32x4;

use crate::Point;

use super::box_tree::BoxTree;

/// A tree of boxes over points, for many searches within a small radius.
///
/// Points are looked at four at a time: such a *quad* has the slots from four times its number
/// on. Searches that are close to each other share the walk through the tree: one gathers the
/// quads that are near them all, and each then looks at those only.
pub struct PointTree {
    /// Over groups of [`GROUP_QUADS`] quads.
    boxes: BoxTree,
    /// In the order of the boxes.
    points: Vec<Point>,
    /// The same rounded, infinitely far away where the last quads are not full.
    quads: Vec<[f32x4; 3]>,
    /// The largest coordinate.
    extent: f64,
}

/// Points of a quad.
const QUAD: usize = 4;

/// Tuned on captures: a search within an edge of a simplified mesh finds some ten to thirty
/// points.
const GROUP_QUADS: usize = 4;

/// What rounding to `f32` moves a point by, at the most, relative to its largest coordinate: the
/// root of 3 times half a unit in the last place, and some more.
const ROUNDING: f64 = 1.0 / (1 << 23) as f64;

/// Covers the rounding of squared distances.
const SQUARE_ROUNDING: f64 = 1e-6;

impl PointTree {
    /// Builds the tree; `None` for no points at all.
    #[must_use]
    pub fn new(points: &[Point]) -> Option<Self> {
        if points.is_empty() {
            return None;
        }
        let boxes = BoxTree::new(points.len(), GROUP_QUADS * QUAD, |index| {
            let corner = rounded(&points[index as usize]);
            [corner, corner]
        });
        let points: Vec<Point> = boxes.items().iter().map(|&i| points[i as usize]).collect();
        let mut quads = vec![[f32x4::splat(f32::INFINITY); 3]; points.len().div_ceil(QUAD)];
        for (slot, point) in points.iter().enumerate() {
            for (axis, coordinate) in quads[slot / QUAD].iter_mut().zip(rounded(point)) {
                axis.as_mut_array()[slot % QUAD] = coordinate;
            }
        }
        Some(Self {
            extent: points.iter().map(|p| p.coords.amax()).fold(0.0, f64::max),
            boxes,
            points,
            quads,
        })
    }

    /// The points' indices in the tree's order: *slots* are places in it.
    #[must_use]
    pub fn items(&self) -> &[u32] {
        self.boxes.items()
    }

    /// Puts into `quads` those that have a point within `radius` of `center`, and perhaps some
    /// that are a little further away, in an order that depends only on the points.
    pub fn quads_around(&self, center: &Point, radius: f64, quads: &mut Vec<u32>) {
        quads.clear();
        let reach = radius + self.rounding(center);
        let bound = (reach * reach * (1.0 + SQUARE_ROUNDING)) as f32;
        let center = rounded(center);
        let lanes = center.map(f32x4::splat);
        let bounds = f32x4::splat(bound);
        self.boxes.visit_within(&center, bound, |group| {
            let first = group as usize * GROUP_QUADS;
            let last = (first + GROUP_QUADS).min(self.quads.len());
            for quad in first..last {
                if square_distances(&self.quads[quad], &lanes)
                    .simd_lt(bounds)
                    .any()
                {
                    quads.push(quad as u32);
                }
            }
        });
    }

    /// Puts the slots of all points of `quads` that are closer to `query` than the square root
    /// of `square` (strictly) to the front of `slots`, and returns how many there are.
    ///
    /// `slots` grows as needed. Searches of the same quads that differ little cost little, since
    /// nothing is decided point by point.
    pub fn slots_within(
        &self,
        query: &Point,
        square: f64,
        quads: &[u32],
        slots: &mut Vec<u32>,
    ) -> usize {
        let (radius, rounding) = (square.sqrt(), self.rounding(query));
        let (inner, outer) = ((radius - rounding).max(0.0), radius + rounding);
        let surely = f32x4::splat((inner * inner * (1.0 - SQUARE_ROUNDING)) as f32);
        let perhaps = f32x4::splat((outer * outer * (1.0 + SQUARE_ROUNDING)) as f32);
        let lanes = rounded(query).map(f32x4::splat);
        if slots.len() < (quads.len() + 1) * QUAD {
            slots.resize((quads.len() + 1) * QUAD, 0);
        }
        let mut count = 0;
        for &quad in quads {
            let squares = square_distances(&self.quads[quad as usize], &lanes);
            let mut near = squares.simd_lt(surely).to_bitmask();
            let mut unsure = squares.simd_lt(perhaps).to_bitmask() & !near;
            while unsure != 0 {
                let slot = quad as usize * QUAD + unsure.trailing_zeros() as usize;
                let is_near = (self.points[slot] - query).norm_squared() < square;
                near |= u32::from(is_near) << unsure.trailing_zeros();
                unsure &= unsure - 1;
            }
            for lane in 0..QUAD as u32 {
                slots[count] = quad * QUAD as u32 + lane;
                count += (near >> lane & 1) as usize;
            }
        }
        count
    }

    /// What rounding may change a distance to `query` by.
    fn rounding(&self, query: &Point) -> f64 {
        ROUNDING * (self.extent + query.coords.amax())
    }
}

#[inline]
fn square_distances(quad: &[f32x4; 3], lanes: &[f32x4; 3]) -> f32x4 {
    let [x, y, z] = [0, 1, 2].map(|axis| quad[axis] - lanes[axis]);
    x * x + y * y + z * z
}

fn rounded(point: &Point) -> [f32; 3] {
    point.coords.map(|c| c as f32).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use proptest::prelude::*;

    proptest! {
        /// The tree finds what looking at every point finds, from quads gathered elsewhere and as
        /// far from the origin as it may be.
        #[test]
        fn the_tree_agrees_with_looking_at_every_point(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 1..300),
            query in prop::array::uniform3(-1.5..1.5_f64),
            step in prop::array::uniform3(-0.5..0.5_f64),
            radius in 0.0..1.0_f64,
            shift in prop::sample::select(vec![0.0, 1e3, 1e6]),
        ) {
            let shift = Vector::new(shift, -shift, shift);
            let points: Vec<Point> = points.into_iter().map(|p| Point::from(p) + shift).collect();
            let (query, step) = (Point::from(query) + shift, Vector::from(step));
            let tree = PointTree::new(&points).unwrap();
            let (mut quads, mut slots) = (vec![], vec![]);
            tree.quads_around(&(query + step), radius + step.norm(), &mut quads);
            let count = tree.slots_within(&query, radius * radius, &quads, &mut slots);
            let mut found: Vec<u32> = slots[..count]
                .iter()
                .map(|&slot| tree.items()[slot as usize])
                .collect();
            found.sort_unstable();
            let near = |i: &u32| (points[*i as usize] - query).norm_squared() < radius * radius;
            let expected: Vec<u32> = (0..points.len() as u32).filter(near).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
