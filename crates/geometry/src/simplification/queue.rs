//! The edges that may be collapsed, cheapest first.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;

use crate::mesh::Edge;

/// An edge that may be collapsed, ordered by cost, then length, then vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Candidate {
    cost: u64,
    length: u32,
    pub edge: Edge,
    /// Tells whether its surroundings have changed since.
    pub stamp: u32,
}

impl Candidate {
    /// Neither the cost nor the square of the length is negative.
    pub fn new(edge: Edge, cost: f64, square_length: f64, stamp: u32) -> Self {
        // The bits of numbers that are not negative are in their order.
        Self {
            cost: cost.to_bits(),
            length: (square_length as f32).to_bits(),
            edge,
            stamp,
        }
    }
}

/// All candidates, each in the list of one of its vertices, its owner.
///
/// Only the best of every list is in the heap, which stays small: when a vertex changes it takes
/// over all edges around it with one push, where the other lists are left to find out when their
/// turn comes.
pub(super) struct Queue {
    heap: BinaryHeap<Reverse<Entry>>,
    lists: Vec<List>,
    candidates: Vec<Candidate>,
    /// Length of `candidates` at which the space of old lists is given back.
    compact_at: usize,
}

/// Not worth giving back.
const MIN_COMPACTED: usize = 1 << 16;

/// An owner's part of the candidates.
#[derive(Clone, Copy, Default)]
struct List {
    start: u32,
    length: u32,
    generation: u32,
}

/// The best of an owner's list.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    best: Candidate,
    owner: u32,
    generation: u32,
}

impl Queue {
    pub fn new(vertex_count: usize) -> Self {
        Self {
            heap: BinaryHeap::with_capacity(vertex_count),
            lists: vec![List::default(); vertex_count],
            candidates: Vec::new(),
            compact_at: MIN_COMPACTED,
        }
    }

    pub fn clear(&mut self) {
        self.heap.clear();
        self.candidates.clear();
        self.lists.iter_mut().for_each(|list| list.length = 0);
    }

    /// Replaces `owner`'s list.
    pub fn set(&mut self, owner: u32, candidates: &[Candidate]) {
        if self.compact_at < self.candidates.len() {
            self.compact();
        }
        let list = &mut self.lists[owner as usize];
        *list = List {
            start: self.candidates.len() as u32,
            length: candidates.len() as u32,
            generation: list.generation.wrapping_add(1),
        };
        self.candidates.extend_from_slice(candidates);
        let entry = candidates.iter().min().map(|&best| Entry {
            best,
            owner,
            generation: list.generation,
        });
        self.heap.extend(entry.map(Reverse));
    }

    /// Gives back the space of lists that were replaced and of candidates that were taken out.
    fn compact(&mut self) {
        let mut kept = Vec::with_capacity(self.compact_at);
        for list in &mut self.lists {
            let start = list.start as usize;
            list.start = kept.len() as u32;
            kept.extend_from_slice(&self.candidates[start..start + list.length as usize]);
        }
        self.candidates = kept;
        self.compact_at = MIN_COMPACTED.max(3 * self.candidates.len());
    }

    /// Takes out the cheapest candidate that `is_current`; the others are dropped as they are
    /// met.
    pub fn pop(&mut self, is_current: impl Fn(&Candidate) -> bool) -> Option<Candidate> {
        while let Some(mut top) = self.heap.peek_mut() {
            let Reverse(Entry {
                best,
                owner,
                generation,
            }) = *top;
            let list = &mut self.lists[owner as usize];
            if list.generation != generation {
                PeekMut::pop(top);
                continue;
            }
            match take_out(list, &mut self.candidates, &best, &is_current) {
                Some(next) => top.0.best = next,
                None => {
                    PeekMut::pop(top);
                }
            }
            if is_current(&best) {
                return Some(best);
            }
        }
        None
    }
}

/// Removes `best` and what is not current from a list, and returns the best of the rest.
fn take_out(
    list: &mut List,
    candidates: &mut [Candidate],
    best: &Candidate,
    is_current: impl Fn(&Candidate) -> bool,
) -> Option<Candidate> {
    let start = list.start as usize;
    let part = &mut candidates[start..start + list.length as usize];
    let mut kept = 0;
    let mut next: Option<Candidate> = None;
    for index in 0..part.len() {
        let candidate = part[index];
        if candidate != *best && is_current(&candidate) {
            part[kept] = candidate;
            kept += 1;
            next = Some(next.map_or(candidate, |next| next.min(candidate)));
        }
    }
    list.length = kept as u32;
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(a: u32, b: u32, cost: f64) -> Candidate {
        Candidate::new(Edge::new(a, b), cost, 1.0, 0)
    }

    #[test]
    fn candidates_come_out_in_order_whoever_owns_them() {
        let mut queue = Queue::new(4);
        queue.set(0, &[candidate(0, 1, 5.0), candidate(0, 2, 1.0)]);
        queue.set(1, &[candidate(1, 2, 3.0), candidate(1, 3, 0.5)]);
        let costs: Vec<f64> = std::iter::from_fn(|| queue.pop(|_| true))
            .map(|candidate| f64::from_bits(candidate.cost))
            .collect();
        assert_eq!(costs, [0.5, 1.0, 3.0, 5.0]);
    }

    #[test]
    fn a_list_that_was_replaced_is_forgotten() {
        let mut queue = Queue::new(4);
        queue.set(0, &[candidate(0, 1, 1.0)]);
        queue.set(0, &[candidate(0, 2, 2.0)]);
        let edges: Vec<Edge> = std::iter::from_fn(|| queue.pop(|_| true))
            .map(|candidate| candidate.edge)
            .collect();
        assert_eq!(edges, [Edge(0, 2)]);
    }

    #[test]
    fn what_is_not_current_does_not_come_out() {
        let mut queue = Queue::new(4);
        queue.set(0, &[candidate(0, 1, 1.0), candidate(0, 2, 2.0)]);
        let found = queue.pop(|candidate| candidate.edge != Edge(0, 1));
        assert_eq!(found, Some(candidate(0, 2, 2.0)));
    }
}
