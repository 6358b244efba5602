//! Drops faces that name a vertex twice, and faces that are there twice.

use crate::Face;
use crate::mesh::Rows;

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
    let pairs: Vec<(u32, [u32; 3])> = corners
        .iter()
        .zip(0..)
        .map(|(face, index)| {
            let [a, b, c] = face.map(|v| welded[v as usize]);
            let (lowest, highest) = (a.min(b).min(c), a.max(b).max(c));
            // The one between them: equal numbers cancel.
            (lowest, [a ^ b ^ c ^ lowest ^ highest, highest, index])
        })
        .collect();
    let by_lowest = Rows::from_pairs(welded.len(), &pairs);
    let mut repeated = Vec::new();
    let mut sorted = Vec::new();
    for row in (0..by_lowest.row_count()).map(|row| by_lowest.row(row)) {
        if row.len() < 2 {
            continue;
        }
        sorted.clear();
        sorted.extend_from_slice(row);
        sorted.sort_unstable();
        for same in sorted.chunk_by(|a, b| a[..2] == b[..2]) {
            repeated.extend(same[1..].iter().map(|&[_, _, index]| index));
        }
    }
    if repeated.is_empty() {
        return;
    }
    report.duplicate_faces += repeated.len();
    repeated.sort_unstable();
    drop_faces(corners, &repeated);
}

/// Drops the faces with these numbers, which ascend.
pub(super) fn drop_faces(faces: &mut Vec<Face>, dropped: &[u32]) {
    let mut dropped = dropped.iter().copied().peekable();
    let mut number = 0;
    faces.retain(|_| {
        let is_dropped = dropped.next_if_eq(&number).is_some();
        number += 1;
        !is_dropped
    });
}
