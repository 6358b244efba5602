//! Vertices at exactly the same position become one.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use crate::Point;

/// For every position, the index of the first one that equals it exactly.
///
/// Exactly: a seam's copies are written from one number, and a tolerance would weld what
/// merely touches. Zero equals negative zero.
#[must_use]
pub fn weld_exact(positions: &[Point]) -> Vec<u32> {
    let mut first_at = HashMap::with_capacity(positions.len());
    positions
        .iter()
        .enumerate()
        .map(|(index, position)| {
            // Adding zero turns the negative zero into the positive one.
            let key: [u64; 3] = position.coords.map(|c| (c + 0.0).to_bits()).into();
            match first_at.entry(key) {
                Entry::Occupied(entry) => *entry.get(),
                Entry::Vacant(entry) => *entry.insert(index as u32),
            }
        })
        .collect()
}
