//! Axis-aligned bounding boxes.

use crate::Point;

/// An axis-aligned box, in the mesh's own unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundingBox {
    /// The corner with the smallest coordinates.
    pub min: Point,
    /// The corner with the largest coordinates.
    pub max: Point,
}

impl BoundingBox {
    /// The smallest box that holds `points`; of no extent at the origin if there are none.
    #[must_use]
    pub fn of(points: &[Point]) -> Self {
        let Some(&first) = points.first() else {
            return Self {
                min: Point::origin(),
                max: Point::origin(),
            };
        };
        points.iter().fold(
            Self {
                min: first,
                max: first,
            },
            |bounds, p| Self {
                min: bounds.min.inf(p),
                max: bounds.max.sup(p),
            },
        )
    }

    /// The length of the diagonal: the length that relative figures refer to.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        (self.max - self.min).norm()
    }

    /// The middle of the box.
    #[must_use]
    pub fn center(&self) -> Point {
        nalgebra::center(&self.min, &self.max)
    }
}
