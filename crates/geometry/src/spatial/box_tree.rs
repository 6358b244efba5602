//! A tree of boxes, eight to a node, that is walked from the nearest box on.

use wide::f32x8;

/// The smallest corner and the largest.
pub(super) type Bounds = [[f32; 3]; 2];

/// Children of a node.
const WIDTH: usize = 8;

/// 8^11 are 2^33 items.
const MAX_LEVELS: usize = 11;

/// A walk that goes into every box holds at most seven a level beside the one it is in.
const STACK_SIZE: usize = MAX_LEVELS * (WIDTH - 1) + 1;

/// A bit for every child.
const ALL: u32 = (1 << WIDTH) - 1;

/// Eight boxes, a vector for each side, so that they are compared at once.
#[derive(Clone, Copy)]
struct Node {
    min: [f32x8; 3],
    max: [f32x8; 3],
}

impl Node {
    /// No boxes: infinitely far from everything.
    fn empty() -> Self {
        Self {
            min: [f32x8::splat(f32::INFINITY); 3],
            max: [f32x8::splat(f32::NEG_INFINITY); 3],
        }
    }

    fn set(&mut self, lane: usize, bounds: &Bounds) {
        for (sides, corner) in [&mut self.min, &mut self.max].into_iter().zip(bounds) {
            for (side, coordinate) in sides.iter_mut().zip(corner) {
                side.as_mut_array()[lane] = *coordinate;
            }
        }
    }

    fn bounds(&self) -> Bounds {
        let least = |sides: &f32x8| sides.to_array().into_iter().fold(f32::INFINITY, f32::min);
        let largest = |sides: &f32x8| {
            let sides = sides.to_array().into_iter();
            sides.fold(f32::NEG_INFINITY, f32::max)
        };
        [
            self.min.each_ref().map(least),
            self.max.each_ref().map(largest),
        ]
    }

    #[inline]
    fn square_distances(&self, point: &[f32x8; 3]) -> f32x8 {
        let outside = |axis: usize| {
            // `fast_max` does not ask for NaN, and there is none.
            let apart = (self.min[axis] - point[axis]).fast_max(point[axis] - self.max[axis]);
            apart.fast_max(f32x8::ZERO)
        };
        let (x, y, z) = (outside(0), outside(1), outside(2));
        x * x + y * y + z * z
    }
}

/// Boxes in a complete tree: the children of node `n` are `8n + 1` to `8n + 8`, and after the
/// last node come the groups of items, numbered the same way.
pub(super) struct BoxTree {
    nodes: Vec<Node>,
    items: Vec<u32>,
    group_size: usize,
    /// The number that the first group would have as a node.
    first_group: u32,
}

/// An item's center, by which it is sorted into place, in whole steps: those are compared in half
/// the time.
#[derive(Clone, Copy)]
struct Entry {
    center: [i32; 3],
    item: u32,
}

/// Steps along the longest side of all centers' box, as many as `f32` tells apart.
const STEPS: f32 = (1 << 24) as f32;

/// The items' entries, in their order.
fn entries(centers: &[[f32; 3]]) -> Vec<Entry> {
    let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for center in centers {
        min = std::array::from_fn(|axis| min[axis].min(center[axis]));
        max = std::array::from_fn(|axis| max[axis].max(center[axis]));
    }
    let longest = (0..3).fold(0.0, |longest: f32, axis| longest.max(max[axis] - min[axis]));
    let scale = if 0.0 < longest { STEPS / longest } else { 0.0 };
    let entry = |(center, item): (&[f32; 3], u32)| Entry {
        center: std::array::from_fn(|axis| ((center[axis] - min[axis]) * scale) as i32),
        item,
    };
    centers.iter().zip(0..).map(entry).collect()
}

impl BoxTree {
    /// A tree over `count` items, at least one and fewer than 2^31, whose boxes are finite.
    ///
    /// Items that are close to each other are in groups of `group_size`: the numbers that a walk
    /// visits are those of groups, and a group's items are next to each other.
    pub fn new(count: usize, group_size: usize, bounds_of: impl Fn(u32) -> Bounds) -> Self {
        let group_count = count.div_ceil(group_size);
        let mut capacity = WIDTH;
        let mut upper_nodes = 0;
        while capacity < group_count {
            upper_nodes = WIDTH * upper_nodes + 1;
            capacity *= WIDTH;
        }
        let centers = (0..count as u32).map(|item| {
            let [min, max] = bounds_of(item);
            [0, 1, 2].map(|axis| min[axis] / 2.0 + max[axis] / 2.0)
        });
        let mut entries = entries(&centers.collect::<Vec<_>>());
        // The order within a group does not matter.
        arrange(&mut entries, capacity * group_size / 2, group_size);
        let items = entries.iter().map(|entry| entry.item).collect();
        Self::of_items(items, group_size, upper_nodes, bounds_of)
    }

    /// The same items in the same places with other boxes.
    pub fn refitted(&self, bounds_of: impl Fn(u32) -> Bounds) -> Self {
        let upper_nodes = (self.first_group as usize - 1) / WIDTH;
        Self::of_items(self.items.clone(), self.group_size, upper_nodes, bounds_of)
    }

    /// Puts boxes around groups of items that are in order.
    fn of_items(
        items: Vec<u32>,
        group_size: usize,
        upper_nodes: usize,
        bounds_of: impl Fn(u32) -> Bounds,
    ) -> Self {
        let group_count = items.len().div_ceil(group_size);
        let mut nodes = vec![Node::empty(); upper_nodes + group_count.div_ceil(WIDTH)];
        for (group, items) in items.chunks(group_size).enumerate() {
            let bounds = items.iter().map(|&item| bounds_of(item));
            let bounds = bounds.reduce(|a, b| union(&a, &b)).unwrap_or_default();
            nodes[upper_nodes + group / WIDTH].set(group % WIDTH, &bounds);
        }
        for node in (1..nodes.len()).rev() {
            let bounds = nodes[node].bounds();
            nodes[(node - 1) / WIDTH].set((node - 1) % WIDTH, &bounds);
        }
        Self {
            nodes,
            items,
            group_size,
            first_group: (WIDTH * upper_nodes + 1) as u32,
        }
    }

    /// The items in the tree's order, group by group.
    pub fn items(&self) -> &[u32] {
        &self.items
    }

    /// Calls `visit` with the number of every group whose box is closer to `point` than the square
    /// root of `bound`, about nearest first; `visit` returns the new bound.
    #[inline]
    pub fn visit_nearest(
        &self,
        point: &[f32; 3],
        mut bound: f32,
        mut visit: impl FnMut(u32) -> f32,
    ) {
        let lanes = point.map(f32x8::splat);
        // The nodes above that have children left to look at: their distances, and which.
        let mut above = [(f32x8::ZERO, 0u32, 0u32); MAX_LEVELS];
        let mut level = 0;
        let (mut number, mut left) = (0u32, ALL);
        let mut squares = self.nodes[0].square_distances(&lanes);
        loop {
            let nearer = squares.simd_lt(f32x8::splat(bound)).to_bitmask() & left;
            if nearer == 0 {
                if level == 0 {
                    return;
                }
                level -= 1;
                (squares, number, left) = above[level];
                continue;
            }
            let lane = nearest_of(squares, nearer);
            left = nearer & !(1 << lane);
            let child = WIDTH as u32 * number + 1 + lane;
            if self.first_group <= child {
                bound = visit(child - self.first_group);
                continue;
            }
            if left != 0 {
                above[level] = (squares, number, left);
                level += 1;
            }
            (number, left) = (child, ALL);
            squares = self.nodes[number as usize].square_distances(&lanes);
        }
    }

    /// Calls `visit` with the number of every group whose box is closer to `point` than the square
    /// root of `bound`.
    #[inline]
    pub fn visit_within(&self, point: &[f32; 3], bound: f32, mut visit: impl FnMut(u32)) {
        let lanes = point.map(f32x8::splat);
        let bound = f32x8::splat(bound);
        let mut stack = [0u32; STACK_SIZE];
        let mut size = 1;
        while 0 < size {
            size -= 1;
            let number = stack[size];
            let squares = self.nodes[number as usize].square_distances(&lanes);
            let mut nearer = squares.simd_lt(bound).to_bitmask();
            while nearer != 0 {
                let child = WIDTH as u32 * number + 1 + nearer.trailing_zeros();
                nearer &= nearer - 1;
                if self.first_group <= child {
                    visit(child - self.first_group);
                } else {
                    stack[size] = child;
                    size += 1;
                }
            }
        }
    }
}

/// The lane of the least of `squares` among those whose bit is set in `among`, at least one.
#[inline]
pub(super) fn nearest_of(squares: f32x8, among: u32) -> u32 {
    let (mut nearest, mut rest) = (among.trailing_zeros(), among & (among - 1));
    if rest == 0 {
        return nearest;
    }
    let squares = squares.to_array();
    while rest != 0 {
        let lane = rest.trailing_zeros();
        rest &= rest - 1;
        if squares[lane as usize] < squares[nearest as usize] {
            nearest = lane;
        }
    }
    nearest
}

/// Sorts entries so that every full subtree's are together and apart from the others: halves
/// are separated by a plane across the longest side of their centers. Halves of fewer than
/// `smallest` stay as they are.
fn arrange(entries: &mut [Entry], half: usize, smallest: usize) {
    if entries.len() <= smallest || half < smallest {
        return;
    }
    if half < entries.len() {
        // Written out, so that no comparison looks for its axis.
        match longest_axis(entries) {
            0 => entries.select_nth_unstable_by_key(half, |entry| entry.center[0]),
            1 => entries.select_nth_unstable_by_key(half, |entry| entry.center[1]),
            _ => entries.select_nth_unstable_by_key(half, |entry| entry.center[2]),
        };
        let (lower, upper) = entries.split_at_mut(half);
        arrange(lower, half / 2, smallest);
        arrange(upper, half / 2, smallest);
    } else {
        arrange(entries, half / 2, smallest);
    }
}

fn union([min_a, max_a]: &Bounds, [min_b, max_b]: &Bounds) -> Bounds {
    [
        std::array::from_fn(|axis| min_a[axis].min(min_b[axis])),
        std::array::from_fn(|axis| max_a[axis].max(max_b[axis])),
    ]
}

fn longest_axis(entries: &[Entry]) -> usize {
    let (mut min, mut max) = ([i32::MAX; 3], [i32::MIN; 3]);
    for entry in entries {
        for axis in 0..3 {
            min[axis] = min[axis].min(entry.center[axis]);
            max[axis] = max[axis].max(entry.center[axis]);
        }
    }
    let length = |axis: usize| i64::from(max[axis]) - i64::from(min[axis]);
    let longer = |a: usize, b: usize| if length(a) < length(b) { b } else { a };
    longer(longer(0, 1), 2)
}
