//! A decoded mesh on the C++ side, and how its numbers are brought over.

use crate::{DecodeError, DecodeLimits, header, status};
use std::ptr;
use steadymesh_draco_sys as sys;

#[derive(Clone, Copy)]
pub(crate) enum Scale {
    /// As the file's `normalized` flag says.
    ByFlag,
    AsStored,
}

#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Position,
    Normal,
    Color,
    TextureCoordinate,
    Material,
}

impl Kind {
    pub(crate) fn semantic(self) -> i32 {
        match self {
            Self::Position => 0,
            Self::Normal => 1,
            Self::Color => 2,
            Self::TextureCoordinate => 3,
            // Not one of libdraco's: see the shim.
            Self::Material => 5,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Position => "positions",
            Self::Normal => "normals",
            Self::Color => "colors",
            Self::TextureCoordinate => "texture coordinates",
            Self::Material => "materials",
        }
    }

    pub(crate) fn accepts(self, component_count: usize) -> bool {
        match self {
            Self::Position | Self::Normal => component_count == 3,
            Self::Color => component_count == 3 || component_count == 4,
            Self::TextureCoordinate => component_count == 2,
            Self::Material => component_count == 1,
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Self::Position | Self::Normal => "3",
            Self::Color => "3 or 4",
            Self::TextureCoordinate => "2",
            Self::Material => "1",
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Attribute {
    index: usize,
    pub(crate) info: sys::Attribute,
}

impl Attribute {
    /// The largest value of an integer type; `None` for floats.
    fn integer_max(&self) -> Option<f32> {
        Some(match self.info.data_type {
            1 => f32::from(i8::MAX),
            2 => f32::from(u8::MAX),
            3 => f32::from(i16::MAX),
            4 => f32::from(u16::MAX),
            5 => i32::MAX as f32,
            6 => u32::MAX as f32,
            7 => i64::MAX as f32,
            8 => u64::MAX as f32,
            11 => 1.0,
            _ => return None,
        })
    }
}

/// A decoded mesh that lives on the C++ side.
pub(crate) struct Mesh {
    raw: ptr::NonNull<sys::Mesh>,
    vertex_count: usize,
    face_count: usize,
}

impl Drop for Mesh {
    fn drop(&mut self) {
        // SAFETY: the pointer came from `steadymesh_draco_decode`, is freed nowhere
        // else and is not used after this.
        unsafe { sys::steadymesh_draco_free_mesh(self.raw.as_ptr()) }
    }
}

impl Mesh {
    pub(crate) fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<Self, DecodeError> {
        if !header::has_magic(bytes) {
            return Err(DecodeError::NotDraco);
        }
        let mut plausible = usize::MAX;
        if let Some(counts) = header::counts(bytes) {
            let (vertices, faces) = (counts.vertices as usize, counts.faces as usize);
            check_limits(vertices, faces, limits)?;
            plausible = plausible_memory(vertices.saturating_add(faces), bytes.len());
        }
        let limit = limits.max_memory_bytes.min(plausible);
        let mut raw = ptr::null_mut();
        let mut status = status::unset();
        // SAFETY: `bytes` is readable for `bytes.len()` bytes during the call and the
        // shim keeps no pointer into it; it writes a handle only on success. It is
        // noexcept, so no C++ exception unwinds into Rust.
        unsafe {
            sys::steadymesh_draco_decode(
                bytes.as_ptr(),
                bytes.len(),
                limit,
                &raw mut raw,
                &raw mut status,
            );
        }
        let raw = ptr::NonNull::new(raw).ok_or_else(|| failure(&status, limits, plausible))?;
        // SAFETY: the handle was just made and is not null.
        let (vertex_count, face_count) = unsafe {
            (
                sys::steadymesh_draco_point_count(raw.as_ptr()),
                sys::steadymesh_draco_face_count(raw.as_ptr()),
            )
        };
        let mesh = Self {
            raw,
            vertex_count,
            face_count,
        };
        if vertex_count == 0 || face_count == 0 {
            return Err(DecodeError::Empty {
                vertices: vertex_count,
                faces: face_count,
            });
        }
        check_limits(vertex_count, face_count, limits)?;
        Ok(mesh)
    }

    pub(crate) fn attributes(&self) -> Result<Vec<Attribute>, DecodeError> {
        // SAFETY: the handle is alive.
        let count = unsafe { sys::steadymesh_draco_attribute_count(self.raw.as_ptr()) };
        (0..count)
            .map(|index| {
                let mut info = sys::Attribute::default();
                let mut status = status::unset();
                // SAFETY: the handle is alive; the shim checks the index and writes
                // only to the two references, which outlive the call.
                unsafe {
                    sys::steadymesh_draco_attribute(
                        self.raw.as_ptr(),
                        index,
                        &raw mut info,
                        &raw mut status,
                    );
                }
                accept(&status)?;
                Ok(Attribute { index, info })
            })
            .collect()
    }

    pub(crate) fn faces(&self) -> Result<Vec<[u32; 3]>, DecodeError> {
        let mut faces = vec![[0_u32; 3]; self.face_count];
        let flat = faces.as_flattened_mut();
        let mut status = status::unset();
        // SAFETY: the handle is alive and `flat` is writable for `flat.len()` values,
        // which the shim compares with what it writes.
        unsafe {
            sys::steadymesh_draco_read_faces(
                self.raw.as_ptr(),
                flat.as_mut_ptr(),
                flat.len(),
                &raw mut status,
            );
        }
        accept(&status)?;
        Ok(faces)
    }

    /// All components of all vertices, as stored.
    fn numbers(&self, attribute: &Attribute, kind: Kind) -> Result<Vec<f32>, DecodeError> {
        let components = attribute.info.component_count as usize;
        if !kind.accepts(components) {
            return Err(DecodeError::ComponentCount {
                what: kind.name(),
                found: components,
                expected: kind.expected(),
            });
        }
        let mut numbers = vec![0.0_f32; self.vertex_count * components];
        let mut status = status::unset();
        // SAFETY: the handle is alive and `numbers` is writable for its length, which
        // the shim compares with what it writes; it checks the index as well.
        unsafe {
            sys::steadymesh_draco_read_attribute(
                self.raw.as_ptr(),
                attribute.index,
                numbers.as_mut_ptr(),
                numbers.len(),
                &raw mut status,
            );
        }
        accept(&status)?;
        Ok(numbers)
    }

    pub(crate) fn vectors<const N: usize>(
        &self,
        attribute: &Attribute,
        kind: Kind,
        scale: Scale,
    ) -> Result<Vec<[f32; N]>, DecodeError> {
        let mut numbers = self.numbers(attribute, kind)?;
        let is_fraction = attribute.info.normalized != 0 && matches!(scale, Scale::ByFlag);
        if let (true, Some(max)) = (is_fraction, attribute.integer_max()) {
            for number in &mut numbers {
                *number = (*number / max).max(-1.0);
            }
        }
        Ok(numbers.as_chunks::<N>().0.to_vec())
    }

    pub(crate) fn optional_vectors<const N: usize>(
        &self,
        attribute: Option<&Attribute>,
        kind: Kind,
        scale: Scale,
    ) -> Result<Option<Vec<[f32; N]>>, DecodeError> {
        attribute.map(|a| self.vectors(a, kind, scale)).transpose()
    }

    pub(crate) fn colors(&self, attribute: &Attribute) -> Result<Vec<[u8; 4]>, DecodeError> {
        let numbers = self.numbers(attribute, Kind::Color)?;
        let scale = 255.0 / attribute.integer_max().unwrap_or(1.0);
        // `as` sends NaN to 0 and clamps the rest.
        let channel = |number: f32| (number * scale).round() as u8;
        let components = attribute.info.component_count as usize;
        Ok(numbers
            .chunks_exact(components)
            .map(|c| {
                let alpha = c.get(3).map_or(u8::MAX, |&alpha| channel(alpha));
                [channel(c[0]), channel(c[1]), channel(c[2]), alpha]
            })
            .collect())
    }

    pub(crate) fn materials(&self, attribute: &Attribute) -> Result<Vec<u16>, DecodeError> {
        let numbers = self.numbers(attribute, Kind::Material)?;
        // `as` sends NaN to 0 and clamps the rest.
        Ok(numbers.into_iter().map(|number| number as u16).collect())
    }
}

fn check_limits(vertices: usize, faces: usize, limits: &DecodeLimits) -> Result<(), DecodeError> {
    let checks = [
        ("vertices", vertices, limits.max_vertices),
        ("faces", faces, limits.max_faces),
    ];
    for (what, found, limit) in checks {
        if found > limit {
            return Err(DecodeError::LimitExceeded { what, found, limit });
        }
    }
    Ok(())
}

fn accept(status: &sys::Status) -> Result<(), DecodeError> {
    match status.code {
        sys::OK => Ok(()),
        _ => Err(DecodeError::Malformed {
            message: status::message(status),
        }),
    }
}

/// More than libdraco needs for an honest mesh: 130 bytes per vertex and face were
/// measured with four attributes, and 350 with two that have a seam at every corner.
/// The decoder spends time in proportion to counts deep inside a file, which it
/// believes as long as there is memory for them (seconds for 100 kB), so memory is
/// kept in proportion.
fn plausible_memory(elements: usize, byte_count: usize) -> usize {
    const BASE: usize = 4 << 20;
    const PER_ELEMENT: usize = 768;
    const PER_BYTE: usize = 32;
    let for_elements = elements.saturating_mul(PER_ELEMENT);
    let for_bytes = byte_count.saturating_mul(PER_BYTE);
    BASE.saturating_add(for_elements).saturating_add(for_bytes)
}

fn failure(status: &sys::Status, limits: &DecodeLimits, plausible: usize) -> DecodeError {
    match status.code {
        sys::OVER_BUDGET if plausible < limits.max_memory_bytes => DecodeError::Malformed {
            message: format!(
                "decoding it needs more than {plausible} bytes, far too much for its own counts \
                 of vertices and faces"
            ),
        },
        sys::OVER_BUDGET => DecodeError::OutOfMemory {
            limit: limits.max_memory_bytes,
        },
        sys::NOT_A_MESH => DecodeError::PointCloud,
        _ => DecodeError::Malformed {
            message: status::message(status),
        },
    }
}
