//! One scale for all meshes, so that the unit of length never decides anything.

use crate::{Point, TriangleMesh};

/// Coordinates are rounded to this share of the diagonal: a sixtieth of `f32`'s resolution,
/// and far above the rounding that another unit brings into the input. What two units make of
/// one mesh is then the same, bit for bit, but for a coordinate in some ten million.
const GRID: f64 = 1.0 / (1u64 << 30) as f64;

/// Maps a mesh into a box of diagonal 1, and back.
pub(super) struct Normalization {
    origin: Point,
    diagonal: f64,
}

impl Normalization {
    pub fn of(mesh: &TriangleMesh) -> Self {
        let bounds = mesh.bounding_box();
        let diagonal = bounds.diagonal();
        Self {
            origin: bounds.min,
            diagonal: if diagonal > 0.0 { diagonal } else { 1.0 },
        }
    }

    pub fn apply(&self, points: &[Point]) -> Vec<Point> {
        let normalize = |p: &Point| {
            Point::from(((p - self.origin) / self.diagonal).map(|c| (c / GRID).round() * GRID))
        };
        points.iter().map(normalize).collect()
    }

    pub fn undo(&self, point: &Point) -> Point {
        self.origin + point.coords * self.diagonal
    }
}
