//! The synthetic rig as a sequence of frames whose true motion is known.

use steadymesh_geometry::spatial::{TriangleTree, barycentric};
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_synthetic_rig::{Frame, Options, OptionsError, Rig};

use crate::pipeline::{PreparedFrame, RawFrame, UnusableFrame};

/// A rig that says where everything on the figure goes.
#[derive(Debug)]
pub struct KnownMotion {
    rig: Rig,
}

/// A frame as the rig knows it.
#[derive(Debug)]
pub struct KnownFrame {
    index: u64,
    frame: Frame,
    /// As it was captured, not repaired: the rig's own faces.
    mesh: TriangleMesh,
    surface: TriangleTree,
}

impl KnownMotion {
    /// Sets up the rig.
    ///
    /// # Errors
    ///
    /// [`OptionsError`] names the option that is out of its range.
    pub fn new(options: &Options) -> Result<Self, OptionsError> {
        Rig::new(options).map(|rig| Self { rig })
    }

    /// Captures frame `index`: what the rig knows of it, and what the pipeline gets of it.
    ///
    /// # Errors
    ///
    /// [`UnusableFrame`], which the rig's frames are not.
    pub fn frame(&self, index: u64) -> Result<(KnownFrame, PreparedFrame), UnusableFrame> {
        let frame = self.rig.frame(index);
        let positions: Vec<[f64; 3]> = frame.positions.iter().map(|p| p.map(f64::from)).collect();
        let points = positions.iter().copied().map(Point::from).collect();
        let mesh = TriangleMesh::new(points, frame.faces.clone())?;
        let raw = RawFrame {
            positions,
            faces: frame.faces.clone(),
            ..RawFrame::default()
        };
        let surface = TriangleTree::new(&mesh).ok_or(UnusableFrame::TooFewFaces {
            faces: 0,
            received: 0,
        })?;
        let known = KnownFrame {
            index,
            frame,
            mesh,
            surface,
        };
        Ok((known, PreparedFrame::new(raw, &mut ())?))
    }

    /// Carries the result for `frame` along the true motion to frame `to`; none if a position is
    /// no longer finite.
    #[must_use]
    pub fn carry(
        &self,
        frame: &KnownFrame,
        output: &TriangleMesh,
        to: u64,
    ) -> Option<TriangleMesh> {
        let rest: Option<Vec<[f64; 3]>> = output
            .positions()
            .iter()
            .map(|vertex| frame.rest_nearest_to(vertex))
            .collect();
        let points: Vec<[f64; 3]> = output.positions().iter().map(|p| p.coords.into()).collect();
        let moved = self.rig.carry(&points, &rest?, frame.index, to);
        let moved = moved.into_iter().map(Point::from).collect();
        output.with_positions(moved).ok()
    }
}

impl KnownFrame {
    /// The material point at the place of the surface that is closest to `point`.
    fn rest_nearest_to(&self, point: &Point) -> Option<[f64; 3]> {
        let closest = self.surface.closest(point);
        let face = closest.face as usize;
        let weights = barycentric(&closest.position, &self.mesh.triangle(face));
        self.frame.rest_at(face, weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_carried_along_the_true_motion_lies_on_the_next_one() {
        let options = Options {
            vertex_count: 8000,
            speed: 2.0,
            noise: 0.0,
            ..Options::default()
        };
        let motion = KnownMotion::new(&options).unwrap();
        let (before, prepared) = motion.frame(4).unwrap();
        let (after, _) = motion.frame(5).unwrap();
        let carried = motion.carry(&before, prepared.mesh(), 5).unwrap();
        let mean_distance = |mesh: &TriangleMesh| {
            let distances = mesh
                .positions()
                .iter()
                .map(|p| after.surface.closest(p).distance);
            distances.sum::<f64>() / mesh.vertex_count() as f64
        };
        let (still, moved) = (mean_distance(prepared.mesh()), mean_distance(&carried));
        // What is left is the difference of the two meshings.
        assert!(moved < 0.2 * still, "{moved} of {still}");
    }
}
