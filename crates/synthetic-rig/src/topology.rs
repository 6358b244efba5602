//! Makes a sampled solid's boundary a manifold before it is polygonized.
//!
//! Seen as voxels around the grid's corners, the solid is *well-composed* if no
//! two of its voxels, and no two of its complement's, touch only along an edge
//! or in a corner. The boundary of a well-composed solid is a 2-manifold.
//! Offending places, which occur where a feature is thinner than the grid, are
//! filled.
//!
//! Source: Latecki, "3D Well-Composed Pictures", Graphical Models and Image
//! Processing 59(3), 1997.

use crate::blocks::{Blocks, CELL_CORNERS, CELL_COUNT, add, cells_around};

/// The value of a filled corner, in metres: just inside.
const FILLED: f32 = -1e-6;

/// The six faces of a cell, corners in cyclic order.
const FACES: [[usize; 4]; 6] = [
    [0, 1, 3, 2],
    [4, 5, 7, 6],
    [0, 1, 5, 4],
    [2, 3, 7, 6],
    [0, 2, 6, 4],
    [1, 3, 7, 5],
];

/// The four pairs of opposite corners of a cell, as bit sets.
const OPPOSITE_CORNERS: [u8; 4] = [0b1000_0001, 0b0100_0010, 0b0010_0100, 0b0001_1000];

/// Which sign patterns are not well-composed, by [`inside_corners`].
const CRITICAL: [bool; 256] = critical_patterns();

/// Fills corners until the solid is well-composed; returns how many.
///
/// This ends: a filled corner lies between two corners of the solid, so the
/// solid never outgrows its bounding box.
pub(crate) fn make_well_composed(blocks: &mut Blocks<'_>) -> usize {
    let mut suspects = Vec::new();
    for block in &blocks.blocks {
        for cell in 0..CELL_COUNT {
            if CRITICAL[usize::from(inside_corners(&block.cell_values(cell)))] {
                suspects.push(block.cell(cell));
            }
        }
    }
    let mut filled = 0;
    while let Some(cell) = suspects.pop() {
        let (block, in_block) = blocks.require_cell(cell);
        let values = blocks.blocks[block].cell_values(in_block);
        if let Some(corner) = corner_to_fill(&values) {
            let corner = add(cell, CELL_CORNERS[corner]);
            blocks.set_corner(corner, FILLED);
            suspects.extend(cells_around(corner));
            filled += 1;
        }
    }
    filled
}

/// The set of a cell's corners that are inside, one bit each.
#[inline]
pub(crate) fn inside_corners(values: &[f32; 8]) -> u8 {
    let mut inside = 0;
    for (corner, &value) in values.iter().enumerate() {
        inside |= u8::from(value < 0.0) << corner;
    }
    inside
}

/// The corner nearest to the surface that, filled, removes an offence of the cell.
fn corner_to_fill(values: &[f32; 8]) -> Option<usize> {
    let inside = inside_corners(values);
    let candidates = offending_outside(inside)?;
    let outside = (0..8).filter(|corner| candidates >> corner & 1 == 1);
    outside.min_by(|&a, &b| values[a].total_cmp(&values[b]))
}

const fn critical_patterns() -> [bool; 256] {
    let mut critical = [false; 256];
    let mut pattern = 0;
    while pattern < 256 {
        critical[pattern] = offending_outside(pattern as u8).is_some();
        pattern += 1;
    }
    critical
}

/// The outside corners of the first offence of a sign pattern: those of a face
/// with a diagonal inside, or those of a cell with two opposite corners alike
/// and the rest different.
const fn offending_outside(inside: u8) -> Option<u8> {
    let mut face = 0;
    while face < FACES.len() {
        let [a, b, c, d] = FACES[face];
        let (first, second) = (1_u8 << a | 1 << c, 1_u8 << b | 1 << d);
        if inside & (first | second) == first {
            return Some(second);
        }
        if inside & (first | second) == second {
            return Some(first);
        }
        face += 1;
    }
    let mut pair = 0;
    while pair < OPPOSITE_CORNERS.len() {
        let opposite = OPPOSITE_CORNERS[pair];
        if inside == opposite || !inside == opposite {
            return Some(!inside);
        }
        pair += 1;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_that_meet_in_an_edge_or_a_corner_only_are_critical() {
        assert!(CRITICAL[0b0000_1001]);
        assert!(CRITICAL[0b1000_0001]);
        assert!(CRITICAL[0b0111_1110]);
        assert!(!CRITICAL[0b0000_0000]);
        assert!(!CRITICAL[0b0000_0011]);
        assert!(!CRITICAL[0b0000_0111]);
        assert!(!CRITICAL[0b0001_0111]);
        assert!(!CRITICAL[0b1111_1111]);
    }

    #[test]
    fn filling_makes_every_pattern_well_composed() {
        for pattern in 0..=255_u8 {
            let mut values =
                [0, 1, 2, 3, 4, 5, 6, 7].map(|i| if pattern >> i & 1 == 1 { -1.0 } else { 1.0 });
            let mut steps = 0;
            while let Some(corner) = corner_to_fill(&values) {
                assert!(values[corner] > 0.0);
                values[corner] = FILLED;
                steps += 1;
            }
            assert!(steps <= 8 && !CRITICAL[usize::from(inside_corners(&values))]);
        }
    }
}
