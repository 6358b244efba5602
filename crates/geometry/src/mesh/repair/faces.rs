//! Drops faces that name a vertex twice, and faces that are there twice.

use std::collections::HashSet;

use crate::Face;

use super::RepairReport;

/// Drops faces two of whose corners are one vertex after welding.
pub(super) fn drop_degenerate(corners: &mut Vec<Face>, welded: &[u32], report: &mut RepairReport) {
    let before = corners.len();
    corners.retain(|face| {
        let [a, b, c] = face.map(|v| welded[v as usize]);
        a != b && b != c && c != a
    });
    report.degenerate_faces += before - corners.len();
}

/// Drops every face whose three vertices an earlier face has, whichever way it is wound.
pub(super) fn drop_duplicates(corners: &mut Vec<Face>, welded: &[u32], report: &mut RepairReport) {
    let mut seen = HashSet::with_capacity(corners.len());
    let before = corners.len();
    corners.retain(|face| {
        let mut key = face.map(|v| welded[v as usize]);
        key.sort_unstable();
        seen.insert(key)
    });
    report.duplicate_faces += before - corners.len();
}
