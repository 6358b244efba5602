//! Collects faces, whatever encoding they come from.

use super::malformed;
use crate::{Limits, ReadError, check};
use steadymesh_proto::wording::counted;

pub(super) struct Faces<'a> {
    limits: &'a Limits,
    vertex_count: u64,
    polygon_count: usize,
    triangles: Vec<[u32; 3]>,
}

impl<'a> Faces<'a> {
    /// `vertex_count` is what the header says; vertices may come after the faces.
    pub(super) fn new(limits: &'a Limits, vertex_count: u64, count: usize) -> Self {
        Self {
            limits,
            vertex_count,
            polygon_count: 0,
            triangles: Vec::with_capacity(count),
        }
    }

    /// Adds a polygon as a fan around its first corner; `line` is known in ASCII files.
    pub(super) fn push(&mut self, corners: &[f64], line: Option<usize>) -> Result<(), ReadError> {
        let face = self.polygon_count;
        let count = corners.len();
        if count < 3 {
            let place = line
                .map(|line| format!("line {line}: "))
                .unwrap_or_default();
            return Err(malformed(format!(
                "{place}face {face} has {}, but at least 3 are needed",
                counted(count as u64, "corner")
            )));
        }
        let index = |corner: f64| self.index(corner, line);
        let first = index(corners[0])?;
        check::face_limit(self.triangles.len() + count - 2, self.limits)?;
        let mut previous = index(corners[1])?;
        for &corner in &corners[2..] {
            let next = self.index(corner, line)?;
            self.triangles.push([first, previous, next]);
            previous = next;
        }
        self.polygon_count += 1;
        Ok(())
    }

    /// Adds a triangle of 32-bit indices.
    #[inline]
    pub(super) fn push_triangle(&mut self, corners: [u32; 3]) -> Result<(), ReadError> {
        if corners
            .iter()
            .any(|&corner| u64::from(corner) >= self.vertex_count)
        {
            return self.push(&corners.map(f64::from), None);
        }
        self.triangles.push(corners);
        self.polygon_count += 1;
        Ok(())
    }

    pub(super) fn into_triangles(self) -> Vec<[u32; 3]> {
        self.triangles
    }

    fn index(&self, corner: f64, line: Option<usize>) -> Result<u32, ReadError> {
        if corner.fract() == 0.0 && (0.0..self.vertex_count as f64).contains(&corner) {
            // In range of `u32`, because the vertex count is.
            return Ok(corner as u32);
        }
        if corner.fract() != 0.0 {
            let face = self.polygon_count;
            let place = line
                .map(|line| format!("line {line}: "))
                .unwrap_or_default();
            return Err(malformed(format!(
                "{place}face {face} refers to vertex {corner}, which is not a whole number"
            )));
        }
        Err(ReadError::IndexOutOfRange {
            face: self.polygon_count,
            what: "vertex",
            index: corner as i64,
            count: usize::try_from(self.vertex_count).unwrap_or(usize::MAX),
            line,
        })
    }
}
