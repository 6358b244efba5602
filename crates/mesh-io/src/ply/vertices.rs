//! Collects vertices, whatever encoding they come from.

use super::layout::VertexSlots;
use crate::{Attribute, Mesh, ReadError, check};

pub(super) struct Vertices {
    slots: VertexSlots,
    positions: Vec<[f64; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[u8; 4]>,
    coordinates: Vec<[f32; 2]>,
}

impl Vertices {
    /// Makes room for `count` vertices, which the caller compared with the body.
    pub(super) fn new(slots: VertexSlots, count: usize) -> Self {
        let room = |is_there: bool| if is_there { count } else { 0 };
        Self {
            positions: Vec::with_capacity(count),
            normals: Vec::with_capacity(room(slots.normal.is_some())),
            colors: Vec::with_capacity(room(slots.color.is_some())),
            coordinates: Vec::with_capacity(room(slots.coordinate.is_some())),
            slots,
        }
    }

    /// Adds one vertex; `value` gives the number of a property by its index, and
    /// `line` is known in ASCII files.
    #[inline]
    pub(super) fn push(
        &mut self,
        value: impl Fn(usize) -> f64,
        line: Option<usize>,
    ) -> Result<(), ReadError> {
        let position = self.slots.position.map(&value);
        check::position(position, self.positions.len(), line)?;
        self.positions.push(position);
        if let Some(slots) = self.slots.normal {
            self.normals.push(slots.map(|slot| value(slot) as f32));
        }
        if let Some(slots) = &self.slots.color {
            // `as` clamps, and sends NaN to 0.
            let channel = |slot: usize, max: f64| (value(slot) * 255.0 / max).round() as u8;
            let [red, green, blue] = slots.channels.map(|slot| channel(slot, slots.max));
            let alpha = slots
                .alpha
                .map_or(u8::MAX, |slot| channel(slot, slots.alpha_max));
            self.colors.push([red, green, blue, alpha]);
        }
        if let Some(slots) = self.slots.coordinate {
            let coordinate = slots.map(|slot| value(slot) as f32);
            check::texture_coordinate(coordinate, self.coordinates.len(), line)?;
            self.coordinates.push(coordinate);
        }
        Ok(())
    }

    /// The mesh, with `faces` that the caller has not compared with the vertices yet.
    pub(super) fn into_mesh(mut self, faces: Vec<[u32; 3]>) -> Mesh {
        check::clean_normals(&mut self.normals);
        let slots = &self.slots;
        Mesh {
            faces,
            normals: slots
                .normal
                .is_some()
                .then(|| Attribute::per_vertex(self.normals)),
            colors: slots
                .color
                .is_some()
                .then(|| Attribute::per_vertex(self.colors)),
            texture_coordinates: slots
                .coordinate
                .is_some()
                .then(|| Attribute::per_vertex(self.coordinates)),
            positions: self.positions,
            materials: None,
            image: None,
        }
    }
}
