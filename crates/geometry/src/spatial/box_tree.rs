//! A tree of boxes, four to a node, that is walked from the nearest box on.

use wide::f32x4;

/// The smallest corner and the largest.
pub(super) type Bounds = [[f32; 3]; 2];

/// Children of a node.
const WIDTH: usize = 4;

/// The walk holds at most three boxes a level beside the one it is in; 16 levels are 2^32 items.
const STACK_SIZE: usize = 64;

/// Four boxes, a vector for each side, so that they are compared at once.
#[derive(Clone, Copy)]
struct Node {
    min: [f32x4; 3],
    max: [f32x4; 3],
}

impl Node {
    /// No boxes: infinitely far from everything.
    fn empty() -> Self {
        Self {
            min: [f32x4::splat(f32::INFINITY); 3],
            max: [f32x4::splat(f32::NEG_INFINITY); 3],
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
        let fold = |sides: &f32x4, f: fn(f32, f32) -> f32| {
            let [a, b, c, d] = sides.to_array();
            f(f(a, b), f(c, d))
        };
        [
            self.min.each_ref().map(|sides| fold(sides, f32::min)),
            self.max.each_ref().map(|sides| fold(sides, f32::max)),
        ]
    }

    #[inline]
    fn square_distances(&self, point: &[f32x4; 3]) -> f32x4 {
        let outside = |axis: usize| {
            // `fast_max` does not ask for NaN, and there is none.
            let apart = (self.min[axis] - point[axis]).fast_max(point[axis] - self.max[axis]);
            apart.fast_max(f32x4::ZERO)
        };
        let (x, y, z) = (outside(0), outside(1), outside(2));
        x * x + y * y + z * z
    }
}

/// Boxes in a complete tree: the children of node `n` are `4n + 1` to `4n + 4`, and after the
/// last node come the items, numbered the same way.
pub(super) struct BoxTree {
    nodes: Vec<Node>,
    items: Vec<u32>,
    /// The number that the first item would have as a node.
    first_item: u32,
}

/// An item's center, by which it is sorted into place.
#[derive(Clone, Copy)]
struct Entry {
    center: [f32; 3],
    item: u32,
}

impl BoxTree {
    /// A tree over `count` items, at least one and fewer than 2^31, whose boxes are finite.
    pub fn new(count: usize, bounds_of: impl Fn(u32) -> Bounds) -> Self {
        Self::of_groups(count, 1, bounds_of)
    }

    /// The same over groups of `group_size` items that are close to each other: the numbers that
    /// a walk visits are those of groups, and a group's items are next to each other.
    pub fn of_groups(count: usize, group_size: usize, bounds_of: impl Fn(u32) -> Bounds) -> Self {
        let group_count = count.div_ceil(group_size);
        let mut capacity = WIDTH;
        let mut upper_nodes = 0;
        while capacity < group_count {
            upper_nodes = WIDTH * upper_nodes + 1;
            capacity *= WIDTH;
        }
        let mut entries: Vec<Entry> = (0..count as u32)
            .map(|item| {
                let [min, max] = bounds_of(item);
                let center = [0, 1, 2].map(|axis| min[axis] + max[axis]);
                Entry { center, item }
            })
            .collect();
        // The order within a node does not matter, that within a group neither.
        let smallest = if group_size == 1 { WIDTH } else { group_size };
        arrange(&mut entries, capacity * group_size / 2, smallest);
        let items = entries.iter().map(|entry| entry.item).collect();
        Self::of_items(items, group_size, upper_nodes, bounds_of)
    }

    /// The same items in the same places, one a group, with other boxes.
    pub fn refitted(&self, bounds_of: impl Fn(u32) -> Bounds) -> Self {
        let upper_nodes = (self.first_item as usize - 1) / WIDTH;
        Self::of_items(self.items.clone(), 1, upper_nodes, bounds_of)
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
            first_item: (WIDTH * upper_nodes + 1) as u32,
        }
    }

    /// The items in the tree's order: the *slots* that a walk visits are places in it.
    pub fn items(&self) -> &[u32] {
        &self.items
    }

    /// Calls `visit` with the slot of every item whose box is closer to `point` than the square
    /// root of `bound`, about nearest first; `visit` returns the new bound.
    #[inline]
    pub fn visit_nearest(
        &self,
        point: &[f32; 3],
        mut bound: f32,
        mut visit: impl FnMut(u32) -> f32,
    ) {
        let mut stack = [(0.0f32, 0u32); STACK_SIZE];
        let lanes = point.map(f32x4::splat);
        let mut size = 1;
        // The root is looked at whatever the bound.
        stack[0].0 = f32::NEG_INFINITY;
        while 0 < size {
            size -= 1;
            let (square, mut number) = stack[size];
            if bound <= square {
                continue;
            }
            let (squares, mut nearer) = loop {
                if self.first_item <= number {
                    bound = visit(number - self.first_item);
                    break (f32x4::ZERO, 0);
                }
                let squares = self.nodes[number as usize].square_distances(&lanes);
                let nearer = squares.simd_lt(f32x4::splat(bound)).to_bitmask();
                // Most often there is one to go on with: no need to put it aside.
                if nearer == 0 || nearer & (nearer - 1) != 0 {
                    break (squares, nearer);
                }
                number = WIDTH as u32 * number + 1 + nearer.trailing_zeros();
            };
            let (squares, first) = (squares.to_array(), size);
            while nearer != 0 {
                let lane = nearer.trailing_zeros();
                nearer &= nearer - 1;
                let entry = (squares[lane as usize], WIDTH as u32 * number + 1 + lane);
                // The nearest ends on top.
                let mut place = size;
                while first < place && stack[place - 1].0 < entry.0 {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = entry;
                size += 1;
            }
        }
    }

    /// Calls `visit` with the slot of every item whose box is closer to `point` than the square
    /// root of `bound`.
    #[inline]
    pub fn visit_within(&self, point: &[f32; 3], bound: f32, mut visit: impl FnMut(u32)) {
        let lanes = point.map(f32x4::splat);
        let bound = f32x4::splat(bound);
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
                if self.first_item <= child {
                    visit(child - self.first_item);
                } else {
                    stack[size] = child;
                    size += 1;
                }
            }
        }
    }
}

/// Sorts entries so that every full subtree's are together and apart from the others: halves
/// are separated by a plane across the longest side of their centers. Halves of fewer than
/// `smallest` stay as they are.
fn arrange(entries: &mut [Entry], half: usize, smallest: usize) {
    if entries.len() <= smallest || half < smallest {
        return;
    }
    if half < entries.len() {
        let axis = longest_axis(entries);
        entries.select_nth_unstable_by(half, |a, b| a.center[axis].total_cmp(&b.center[axis]));
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
    let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for entry in entries {
        for axis in 0..3 {
            min[axis] = min[axis].min(entry.center[axis]);
            max[axis] = max[axis].max(entry.center[axis]);
        }
    }
    let length = |axis: usize| max[axis] - min[axis];
    let longer = |a: usize, b: usize| if length(a) < length(b) { b } else { a };
    longer(longer(0, 1), 2)
}
