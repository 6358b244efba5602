//! Sorts edges by cost, roughly.

use crate::mesh::Edge;

/// An edge that may be collapsed, and what that costs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rated {
    pub edge: Edge,
    /// Not negative.
    pub cost: f32,
}

/// Puts the cheapest edges in order.
///
/// By the upper 22 bits below the sign: costs that differ by less than 2⁻¹⁴ of themselves are
/// alike, and stay in the order in which they come. A radix sort in two digits, over those edges
/// alone that are cheap enough.
#[derive(Default)]
pub(super) struct Ranking {
    keyed: Vec<(u32, u32)>,
    scratch: Vec<(u32, u32)>,
}

const DIGIT_BITS: u32 = 11;
const DIGITS: usize = 1 << DIGIT_BITS;
const DROPPED_BITS: u32 = 31 - 2 * DIGIT_BITS;

impl Ranking {
    /// The keys and indices of the cheapest edges, cheapest first: as many as wanted, and those
    /// that are about as cheap as the last of them.
    pub fn cheapest(&mut self, edges: &[Rated], wanted: usize) -> &[(u32, u32)] {
        let limit = limit(edges, wanted);
        self.keyed.resize(edges.len(), (0, 0));
        let mut count = 0;
        for (edge, index) in edges.iter().zip(0..) {
            let key = key(edge);
            // Without a branch: which edges are cheap is not to be foretold.
            self.keyed[count] = (key, index);
            count += usize::from(key >> DIGIT_BITS <= limit);
        }
        self.keyed.truncate(count);
        self.scratch.resize(count, (0, 0));
        sort_by_digit(&self.keyed, &mut self.scratch, 0);
        sort_by_digit(&self.scratch, &mut self.keyed, DIGIT_BITS);
        &self.keyed
    }
}

/// The bits of numbers that are not negative are in their order.
fn key(edge: &Rated) -> u32 {
    edge.cost.to_bits() >> DROPPED_BITS
}

/// The upper digit below which, or at which, at least `wanted` keys are.
fn limit(edges: &[Rated], wanted: usize) -> u32 {
    let mut counts = [0u32; DIGITS];
    for edge in edges {
        counts[(key(edge) >> DIGIT_BITS) as usize] += 1;
    }
    let mut sum = 0;
    for (digit, count) in (0..).zip(counts) {
        sum += count as usize;
        if wanted <= sum {
            return digit;
        }
    }
    DIGITS as u32
}

fn sort_by_digit(from: &[(u32, u32)], to: &mut [(u32, u32)], shift: u32) {
    let digit = |key: u32| (key >> shift) as usize % DIGITS;
    let mut next = [0u32; DIGITS];
    for &(key, _) in from {
        next[digit(key)] += 1;
    }
    let mut start = 0;
    for place in &mut next {
        (*place, start) = (start, start + *place);
    }
    for &item in from {
        let place = &mut next[digit(item.0)];
        to[*place as usize] = item;
        *place += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rated(costs: &[f32]) -> Vec<Rated> {
        let rated = |&cost| Rated {
            edge: Edge(0, 1),
            cost,
        };
        costs.iter().map(rated).collect()
    }

    fn cheapest(edges: &[Rated], wanted: usize) -> Vec<u32> {
        let mut ranking = Ranking::default();
        let found = ranking.cheapest(edges, wanted).iter();
        found.map(|&(_, index)| index).collect()
    }

    #[test]
    fn the_cheapest_come_in_order_and_equals_as_they_were() {
        let edges = rated(&[3.0, 0.0, 1e-12, 2.0, 1e-12, 1e9]);
        assert_eq!(cheapest(&edges, 6), [1, 2, 4, 3, 0, 5]);
        assert_eq!(cheapest(&edges, 3), [1, 2, 4]);
    }

    #[test]
    fn asking_for_more_than_there_are_gives_all() {
        let edges = rated(&[2.0, 1.0, f32::MAX]);
        assert_eq!(cheapest(&edges, 100), [1, 0, 2]);
    }
}
