//! Sparse Cholesky factorisation of a matrix of 4 x 4 blocks, in `f32`.
//!
//! A graph of some hundred nodes is too small for a general sparse solver to pay: what it does
//! for every few columns costs more than the arithmetic. Here everything goes block by block, and
//! the order and the pattern of the factor are found on the graph of the nodes.
//!
//! # Source
//!
//! Davis, "Direct Methods for Sparse Linear Systems", SIAM 2006, sections 4.8 (left-looking) and
//! 7.1 (minimum degree), <https://doi.org/10.1137/1.9780898718881>.

use wide::f32x4;

/// A 4 x 4 block by columns.
pub(super) type Block = [f32x4; 4];

/// Three columns of four rows: a node's part of a right-hand side.
pub(super) type Right = [f32x4; 3];

/// An entry of the lower triangle of the factor, which is 0 until something is added to it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    column: u32,
    slot: u32,
    /// Whether the block's transpose is what goes here.
    transposed: bool,
}

/// The order of elimination, and where the factor is not 0.
pub(super) struct Pattern {
    /// The nodes in the order of their elimination.
    order: Vec<u32>,
    /// Where each column's blocks below the diagonal start.
    starts: Vec<u32>,
    /// Their rows, as places in the order, ascending.
    rows: Vec<u32>,
    /// For every row, the columns to the left with a block in it, and which block.
    left: Vec<Vec<(u32, u32)>>,
    /// For every edge, where it is in the factor.
    places: Vec<Place>,
}

/// A factorised matrix.
pub(super) struct Factor<'a> {
    pattern: &'a Pattern,
    /// Inverses of the diagonal blocks of L.
    inverses: Vec<Block>,
    below: Vec<Block>,
}

/// A diagonal block is not positive definite.
pub(super) struct NotPositive {
    /// The node it belongs to.
    pub node: usize,
}

impl Pattern {
    /// The pattern of a matrix with a block for every node and for every one of `edges`.
    pub fn new(node_count: usize, edges: &[(u32, u32)]) -> Self {
        let (order, columns) = eliminate(node_count, edges);
        let mut position = vec![0u32; node_count];
        for (place, &node) in order.iter().enumerate() {
            position[node as usize] = place as u32;
        }
        let mut pattern = Self {
            order,
            starts: vec![0],
            rows: Vec::new(),
            left: vec![Vec::new(); node_count],
            places: Vec::new(),
        };
        for (column, nodes) in columns.into_iter().enumerate() {
            let start = pattern.rows.len();
            pattern
                .rows
                .extend(nodes.iter().map(|&node| position[node as usize]));
            pattern.rows[start..].sort_unstable();
            for slot in start..pattern.rows.len() {
                pattern.left[pattern.rows[slot] as usize].push((column as u32, slot as u32));
            }
            pattern.starts.push(pattern.rows.len() as u32);
        }
        let place_of =
            |&(a, b): &(u32, u32)| pattern.place(position[a as usize], position[b as usize]);
        pattern.places = edges.iter().map(place_of).collect();
        pattern
    }

    /// Where the block of row `b` and column `a` is.
    fn place(&self, a: u32, b: u32) -> Place {
        let (column, row) = (a.min(b), a.max(b));
        let start = self.starts[column as usize];
        let rows = &self.rows[start as usize..self.starts[column as usize + 1] as usize];
        Place {
            column,
            slot: start + rows.partition_point(|&other| other < row) as u32,
            transposed: b < a,
        }
    }

    /// Factorises the matrix whose blocks are those of `diagonal` for the nodes and `edge_block`
    /// for the edges: rows of the second node, columns of the first.
    pub fn factorise(
        &self,
        diagonal: impl Fn(usize) -> Block,
        edge_block: impl Fn(usize) -> Block,
    ) -> Result<Factor<'_>, NotPositive> {
        let zero = [f32x4::ZERO; 4];
        let mut below = vec![zero; self.rows.len()];
        for (edge, place) in self.places.iter().enumerate() {
            debug_assert!(place.slot < self.starts[place.column as usize + 1]);
            let block = edge_block(edge);
            below[place.slot as usize] = if place.transposed {
                transposed(&block)
            } else {
                block
            };
        }
        let mut inverses = Vec::with_capacity(self.order.len());
        let mut sums = vec![zero; self.order.len()];
        for column in 0..self.order.len() {
            let node = self.order[column] as usize;
            let mut pivot = diagonal(node);
            let range = self.starts[column] as usize..self.starts[column + 1] as usize;
            for &(left, slot) in &self.left[column] {
                let across = below[slot as usize];
                subtract_product(&mut pivot, &across, &across);
                let end = self.starts[left as usize + 1] as usize;
                let rest = slot as usize + 1..end;
                for (block, &row) in below[rest.clone()].iter().zip(&self.rows[rest]) {
                    subtract_product(&mut sums[row as usize], block, &across);
                }
            }
            let inverse = inverse_of_factor(&pivot).ok_or(NotPositive { node })?;
            for slot in range {
                let sum = &mut sums[self.rows[slot] as usize];
                let mut block = below[slot];
                (0..4).for_each(|c| block[c] += sum[c]);
                below[slot] = zero;
                // L_ij = A_ij L_jj⁻ᵀ
                add_product(&mut below[slot], &block, &inverse);
                *sum = zero;
            }
            inverses.push(inverse);
        }
        Ok(Factor {
            pattern: self,
            inverses,
            below,
        })
    }
}

impl Factor<'_> {
    /// Solves for right-hand sides, a part for every node.
    pub fn solve(&self, right: impl Fn(usize) -> Right) -> Vec<Right> {
        let pattern = self.pattern;
        let mut x: Vec<Right> = pattern.order.iter().map(|&n| right(n as usize)).collect();
        for column in 0..x.len() {
            let mut part = [f32x4::ZERO; 3];
            add_times(&mut part, &self.inverses[column], &x[column]);
            x[column] = part;
            let minus = part.map(|c| -c);
            for slot in self.slots(column) {
                let row = pattern.rows[slot] as usize;
                add_times(&mut x[row], &self.below[slot], &minus);
            }
        }
        for column in (0..x.len()).rev() {
            let mut sums = [[f32x4::ZERO; 4]; 3];
            for slot in self.slots(column) {
                add_transposed_times(
                    &mut sums,
                    &self.below[slot],
                    &x[pattern.rows[slot] as usize],
                );
            }
            let mut part = x[column];
            for (part, sums) in part.iter_mut().zip(&sums) {
                *part -= row_sums(sums);
            }
            let mut sums = [[f32x4::ZERO; 4]; 3];
            add_transposed_times(&mut sums, &self.inverses[column], &part);
            x[column] = sums.each_ref().map(row_sums);
        }
        let mut solution = vec![[f32x4::ZERO; 3]; x.len()];
        for (part, &node) in x.iter().zip(&pattern.order) {
            solution[node as usize] = *part;
        }
        solution
    }

    fn slots(&self, column: usize) -> std::ops::Range<usize> {
        let starts = &self.pattern.starts;
        starts[column] as usize..starts[column + 1] as usize
    }
}

/// The nodes in an order that fills in little, and for each the nodes that were coupled to it
/// when its turn came.
///
/// Minimum degree, the first of several: the graph that is left is kept as bits.
fn eliminate(node_count: usize, edges: &[(u32, u32)]) -> (Vec<u32>, Vec<Vec<u32>>) {
    let words = node_count.div_ceil(64);
    let mut coupled = vec![0u64; words * node_count];
    let mut degrees = vec![0u32; node_count];
    for &(a, b) in edges {
        for (a, b) in [(a as usize, b as usize), (b as usize, a as usize)] {
            coupled[words * a + b / 64] |= 1 << (b % 64);
            degrees[a] += 1;
        }
    }
    let mut left: Vec<u32> = (0..node_count as u32).collect();
    let mut order = Vec::with_capacity(node_count);
    let mut columns = Vec::with_capacity(node_count);
    let mut front = vec![0u64; words];
    while let Some(place) = (0..left.len()).min_by_key(|&i| (degrees[left[i] as usize], left[i])) {
        let node = left.swap_remove(place) as usize;
        front.copy_from_slice(&coupled[words * node..][..words]);
        let others: Vec<u32> = ones(&front).collect();
        for &other in &others {
            let other = other as usize;
            let row = &mut coupled[words * other..][..words];
            row.iter_mut()
                .zip(&front)
                .for_each(|(row, front)| *row |= front);
            row[node / 64] &= !(1 << (node % 64));
            row[other / 64] &= !(1 << (other % 64));
            degrees[other] = row.iter().map(|word| word.count_ones()).sum();
        }
        order.push(node as u32);
        columns.push(others);
    }
    (order, columns)
}

/// The places of the ones among bits, ascending.
fn ones(words: &[u64]) -> impl Iterator<Item = u32> {
    words.iter().enumerate().flat_map(|(index, &word)| {
        let mut rest = word;
        std::iter::from_fn(move || {
            let bit = (rest != 0).then(|| rest.trailing_zeros())?;
            rest &= rest - 1;
            Some(64 * index as u32 + bit)
        })
    })
}

/// Subtracts a·bᵀ.
#[inline]
fn subtract_product(sum: &mut Block, a: &Block, b: &Block) {
    let b = b.map(f32x4::to_array);
    for c in 0..4 {
        let product = (a[0] * f32x4::splat(b[0][c]) + a[1] * f32x4::splat(b[1][c]))
            + (a[2] * f32x4::splat(b[2][c]) + a[3] * f32x4::splat(b[3][c]));
        sum[c] -= product;
    }
}

/// Adds a·bᵀ.
#[inline]
fn add_product(sum: &mut Block, a: &Block, b: &Block) {
    let b = b.map(f32x4::to_array);
    for c in 0..4 {
        for m in 0..4 {
            sum[c] += a[m] * f32x4::splat(b[m][c]);
        }
    }
}

/// Adds a·x.
#[inline]
fn add_times(sum: &mut Right, a: &Block, x: &Right) {
    for (sum, x) in sum.iter_mut().zip(x) {
        let x = x.to_array();
        *sum += (a[0] * f32x4::splat(x[0]) + a[1] * f32x4::splat(x[1]))
            + (a[2] * f32x4::splat(x[2]) + a[3] * f32x4::splat(x[3]));
    }
}

/// Adds what the rows of aᵀ·x are the sums of.
#[inline]
fn add_transposed_times(sums: &mut [[f32x4; 4]; 3], a: &Block, x: &Right) {
    for (sums, x) in sums.iter_mut().zip(x) {
        for (sum, a) in sums.iter_mut().zip(a) {
            *sum += *a * *x;
        }
    }
}

/// The sum of each of four vectors.
#[inline]
fn row_sums(sums: &[f32x4; 4]) -> f32x4 {
    let [a, b, c, d] = transposed(sums);
    (a + b) + (c + d)
}

fn transposed(block: &Block) -> Block {
    f32x4::transpose(*block)
}

/// L⁻¹ for L Lᵀ = `block`, of which the lower triangle counts.
fn inverse_of_factor(block: &Block) -> Option<Block> {
    let a = block.map(f32x4::to_array);
    let mut l = [[0.0f32; 4]; 4];
    for c in 0..4 {
        let square = a[c][c] - (0..c).map(|m| l[m][c] * l[m][c]).sum::<f32>();
        if square.is_nan() || square <= 0.0 {
            return None;
        }
        let root = square.sqrt();
        l[c][c] = root;
        for r in c + 1..4 {
            l[c][r] = (a[c][r] - (0..c).map(|m| l[m][r] * l[m][c]).sum::<f32>()) / root;
        }
    }
    let mut inverse = [[0.0f32; 4]; 4];
    for c in 0..4 {
        inverse[c][c] = 1.0 / l[c][c];
        for r in c + 1..4 {
            let sum: f32 = (c..r).map(|m| l[m][r] * inverse[c][m]).sum();
            inverse[c][r] = -sum / l[r][r];
        }
    }
    Some(inverse.map(f32x4::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What is solved for is what the matrix makes of the solution.
        #[test]
        fn a_solution_leads_back_to_its_right_hand_side(
            edges in prop::collection::btree_set((0..30u32, 0..30u32), 0..80),
            entries in prop::collection::vec(-0.1..0.1_f32, 16 * 80),
        ) {
            let edges: Vec<(u32, u32)> = edges.into_iter().filter(|(a, b)| a < b).collect();
            let block = |e: usize| -> Block {
                std::array::from_fn(|c| f32x4::from(std::array::from_fn(|r| entries[16 * e + 4 * c + r])))
            };
            // Heavier on the diagonal than the rest of a row together.
            let diagonal = |_| -> Block {
                std::array::from_fn(|c| f32x4::from(std::array::from_fn(|r| if r == c { 20.0 } else { 0.5 })))
            };
            let pattern = Pattern::new(30, &edges);
            let factor = pattern.factorise(diagonal, block).ok().unwrap();
            let right = |n: usize| -> Right {
                std::array::from_fn(|c| f32x4::from(std::array::from_fn(|r| (n * 12 + c * 4 + r) as f32 / 100.0 - 1.0)))
            };
            let x = factor.solve(right);
            let mut product = vec![[f32x4::ZERO; 3]; 30];
            for node in 0..30 {
                add_times(&mut product[node], &diagonal(node), &x[node]);
            }
            for (e, &(a, b)) in edges.iter().enumerate() {
                add_times(&mut product[b as usize], &block(e), &x[a as usize]);
                add_times(&mut product[a as usize], &transposed(&block(e)), &x[b as usize]);
            }
            for (node, product) in product.iter().enumerate() {
                for (found, expected) in product.iter().zip(right(node)) {
                    prop_assert!((*found - expected).abs().to_array().iter().all(|d| *d < 1e-4));
                }
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_names_the_node() {
        let one: Block =
            std::array::from_fn(|c| f32x4::from(std::array::from_fn(|r| f32::from(r == c))));
        let pattern = Pattern::new(2, &[]);
        let minus = |n: usize| if n == 1 { one.map(|c| -c) } else { one };
        let failed = pattern.factorise(minus, |_| one).err().unwrap();
        assert_eq!(failed.node, 1);
    }
}
