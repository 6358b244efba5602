//! What the points of a frame look like, and how a simplified mesh comes to look like that.

use steadymesh_geometry::mesh::Wedges;
use steadymesh_geometry::simplification::{
    AttributeField, CHANNELS, Simplified, SurfaceOrigin, chart_origins, surface_origins,
};
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Face, TriangleMesh};

use super::AttributeWeight;

/// One value per point in each of those that are there.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Attributes {
    /// Normals of about unit length; zero where there is none.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Red, green, blue, alpha, 0 to 255.
    pub colors: Option<Vec<[u8; 4]>>,
    /// Texture coordinates, usually 0 to 1.
    pub texture_coordinates: Option<Vec<[f32; 2]>>,
    /// Numbers of materials: all points of a face have the same.
    pub materials: Option<Vec<u16>>,
}

impl Attributes {
    /// Whether there are none at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.normals.is_none()
            && self.colors.is_none()
            && self.texture_coordinates.is_none()
            && self.materials.is_none()
    }
}

/// The attributes of a frame, at the corners of its repaired faces.
#[derive(Debug, Clone)]
pub(super) struct CornerAttributes {
    /// Of the points as they came.
    values: Attributes,
    /// For every face of the repaired mesh, the points at its corners.
    corners: Vec<Face>,
    /// The wedges of the repaired mesh, if it is simplified without regard to them.
    left_out: Option<Wedges>,
}

impl CornerAttributes {
    pub fn new(values: Attributes, corners: Vec<Face>) -> Self {
        Self {
            values,
            corners,
            left_out: None,
        }
    }

    /// Keeps the wedges of `mesh`, the repaired one, for when it has been simplified without them.
    pub fn leave_out_wedges(&mut self, mesh: &TriangleMesh) {
        self.left_out = Some(self.wedges(mesh));
    }

    /// Where the corners of `mesh`, the repaired one, look alike. Only texture coordinates and materials
    /// make a seam: a color or a normal that jumps from face to face (a hard edge, a painted face) would
    /// leave nothing to collapse, and between two of either there is a third.
    pub fn wedges(&self, mesh: &TriangleMesh) -> Wedges {
        Wedges::by_key(mesh, |face, corner| {
            let point = self.corners[face][corner] as usize;
            let coordinates = self.values.texture_coordinates.as_ref();
            let materials = self.values.materials.as_ref();
            // Zero has two bit patterns.
            let coordinates = coordinates.map(|values| values[point].map(|c| (c + 0.0).to_bits()));
            (coordinates, materials.map(|values| values[point]))
        })
    }

    /// The attributes as the simplification weighs them; none if they have no weight.
    ///
    /// Texture coordinates count where there is an image. Without one their charts are laid anew.
    pub fn field(&self, weight: AttributeWeight) -> Option<AttributeField> {
        let weight = weight.get();
        let values = &self.values;
        let coordinates = values.texture_coordinates.as_ref();
        let coordinates = coordinates.filter(|_| self.left_out.is_none());
        let mut channels = 0;
        let mut corners = vec![[[0.0; CHANNELS]; 3]; self.corners.len()];
        let mut take = |count: usize, value: &dyn Fn(usize, usize) -> f64| {
            for (values, points) in corners.iter_mut().zip(&self.corners) {
                for (values, &point) in values.iter_mut().zip(points) {
                    for channel in 0..count {
                        values[channels + channel] = weight * value(point as usize, channel);
                    }
                }
            }
            channels += count;
        };
        if let Some(colors) = &values.colors {
            take(4, &|point, channel| {
                f64::from(colors[point][channel]) / 255.0
            });
        }
        if let Some(normals) = &values.normals {
            // From -1 to 1 is a range of 2.
            take(3, &|point, axis| f64::from(normals[point][axis]) / 2.0);
        }
        if let Some(coordinates) = coordinates {
            take(2, &|point, axis| f64::from(coordinates[point][axis]));
        }
        (0.0 < weight && 0 < channels).then_some(AttributeField { corners, channels })
    }

    /// The attributes of every wedge of a simplified mesh, from the closest points of the original
    /// `surface`. A mesh that was simplified without regard to wedges is given them.
    pub fn of_simplified(&self, surface: &TriangleTree, simplified: &mut Simplified) -> Attributes {
        let origins = match &self.left_out {
            None => surface_origins(surface.mesh(), simplified),
            Some(left_out) => {
                let (wedges, origins) = chart_origins((surface, left_out), &simplified.mesh);
                simplified.mesh = simplified.mesh.clone().with_wedges(wedges);
                origins
            }
        };
        Attributes {
            normals: self.blend(self.values.normals.as_ref(), &origins, unit),
            colors: self.blend(self.values.colors.as_ref(), &origins, |rgba: [f64; 4]| {
                rgba.map(|channel| channel.round() as u8)
            }),
            texture_coordinates: self.blend(
                self.values.texture_coordinates.as_ref(),
                &origins,
                |coordinates: [f64; 2]| coordinates.map(|c| c as f32),
            ),
            materials: self.values.materials.as_ref().map(|values| {
                let of_origin = |origin: &SurfaceOrigin| {
                    let [point, ..] = self.corners[origin.face as usize];
                    values[point as usize]
                };
                origins.iter().map(of_origin).collect()
            }),
        }
    }

    fn blend<T: Copy + Into<f64>, const N: usize>(
        &self,
        values: Option<&Vec<[T; N]>>,
        origins: &[SurfaceOrigin],
        finish: impl Fn([f64; N]) -> [T; N],
    ) -> Option<Vec<[T; N]>> {
        let values = values?;
        let blended = origins.iter().map(|origin| {
            let mut sum = [0.0; N];
            let corners = self.corners[origin.face as usize];
            for (point, weight) in corners.into_iter().zip(origin.weights) {
                for (sum, value) in sum.iter_mut().zip(values[point as usize]) {
                    *sum += weight * value.into();
                }
            }
            finish(sum)
        });
        Some(blended.collect())
    }
}

/// Of unit length, if it has a direction.
fn unit(vector: [f64; 3]) -> [f32; 3] {
    let length = vector.iter().map(|c| c * c).sum::<f64>().sqrt();
    let scale = if length > 0.0 { length.recip() } else { 0.0 };
    vector.map(|c| (c * scale) as f32)
}
