//! Vertices at exactly the same position become one.

use crate::Point;
use crate::mesh::Rows;

/// For every position, the index of the first one that equals it exactly.
///
/// Exactly: a seam's copies are written from one number, and a tolerance would weld what
/// merely touches. Zero equals negative zero.
#[must_use]
pub fn weld_exact(positions: &[Point]) -> Vec<u32> {
    let keys: Vec<[u64; 3]> = positions.iter().map(key).collect();
    let bits = positions.len().max(1).ilog2() + 1;
    let pairs: Vec<(u32, u32)> = keys
        .iter()
        .zip(0..)
        .map(|(key, index)| (bucket(key, bits), index))
        .collect();
    let buckets = Rows::from_pairs(1 << bits, &pairs);
    let mut first: Vec<u32> = (0..positions.len() as u32).collect();
    let mut sorted = Vec::new();
    for bucket in (0..buckets.row_count()).map(|row| buckets.row(row)) {
        if bucket.len() <= FEW {
            for (place, &index) in bucket.iter().enumerate() {
                let is_same = |&&other: &&u32| keys[other as usize] == keys[index as usize];
                if let Some(&same) = bucket[..place].iter().find(is_same) {
                    first[index as usize] = same;
                }
            }
        } else {
            sorted.clear();
            sorted.extend_from_slice(bucket);
            sorted.sort_unstable_by_key(|&index| (keys[index as usize], index));
            for same in sorted.chunk_by(|&a, &b| keys[a as usize] == keys[b as usize]) {
                for &index in same {
                    first[index as usize] = same[0];
                }
            }
        }
    }
    first
}

/// Where comparing each with each is faster than sorting.
const FEW: usize = 8;

/// Adding zero turns the negative zero into the positive one.
fn key(position: &Point) -> [u64; 3] {
    position.coords.map(|c| (c + 0.0).to_bits()).into()
}

/// Buckets are sorted, so that positions chosen to fall into one of them cost no more than
/// sorting does.
fn bucket(&[x, y, z]: &[u64; 3], bits: u32) -> u32 {
    // 2^64 divided by the golden ratio: Knuth, "The Art of Computer Programming", vol. 3, 6.4.
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let mixed = [x, y, z].into_iter().fold(0, |mixed: u64, bits| {
        (mixed.rotate_left(23) ^ bits ^ (bits >> 32)).wrapping_mul(GOLDEN)
    });
    (mixed >> (64 - bits)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whether few or many fall into one bucket.
        #[test]
        fn every_position_is_welded_to_the_first_that_equals_it(
            coordinates in prop::collection::vec(prop::array::uniform3(-1_i8..2), 0..300),
        ) {
            let positions: Vec<Point> = coordinates
                .iter()
                .map(|c| Point::from(c.map(|c| if c < 0 { -0.0 } else { f64::from(c) })))
                .collect();
            let expected: Vec<u32> = positions
                .iter()
                .map(|p| positions.iter().position(|q| q == p).unwrap() as u32)
                .collect();
            prop_assert_eq!(weld_exact(&positions), expected);
        }
    }
}
