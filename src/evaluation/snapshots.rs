//! The results that are pictured, and which ones those are.

use std::ops::Range;

use steadymesh_geometry::TriangleMesh;
use steadymesh_geometry::metrics::{Persistence, persistence};

use super::measure::Distances;
use super::results::ByFrame;

/// Frames on a contact sheet.
const PICTURED: u64 = 5;

/// The numbers of the frames that are pictured in a sequence of `frame_count`: the middle ones
/// of those that have a predecessor.
#[must_use]
pub fn pictured_frames(frame_count: u64) -> Range<u64> {
    let count = PICTURED.min(frame_count.saturating_sub(1));
    let start = 1 + (frame_count.saturating_sub(1) - count) / 2;
    start..start + count
}

/// A result to be pictured.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// The number of frame k.
    pub seq: u64,
    /// The result as players see it.
    pub mesh: TriangleMesh,
    /// What of it was there before; none without a registration.
    pub persistence: Option<Persistence>,
    /// The distance of each vertex to the surface of the frames, in percent of the diagonal.
    pub distances: ByFrame<Vec<f64>>,
}

impl Snapshot {
    /// Takes one of the result for frame `seq`, whose bounding box has this `diagonal`.
    /// `carried` is the result before it, carried along.
    pub(super) fn take(
        seq: u64,
        mesh: &TriangleMesh,
        carried: Option<&TriangleMesh>,
        (distances, diagonal): (&Distances, f64),
    ) -> Self {
        let percent = |distances: &Vec<f64>| -> Vec<f64> {
            distances.iter().map(|d| 100.0 * d / diagonal).collect()
        };
        Self {
            seq,
            mesh: mesh.clone(),
            persistence: carried.and_then(|carried| persistence(carried, mesh)),
            distances: distances.surface_distance.map(percent),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_frames_that_have_a_predecessor_are_pictured() {
        assert_eq!(pictured_frames(10), 3..8);
        assert_eq!(pictured_frames(6), 1..6);
        assert_eq!(pictured_frames(3), 1..3);
        assert!(pictured_frames(1).is_empty() && pictured_frames(0).is_empty());
    }
}
