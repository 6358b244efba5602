//! Numbers of accessors: typed, strided, sparse.

use super::buffers::Buffers;
use super::document::{Accessor, BufferView, Document, Sparse, entry};
use super::malformed;
use crate::ReadError;
use crate::error::are;
use steadymesh_proto::wording::counted;

/// A document with the bytes of its buffers.
pub(super) struct Source<'a> {
    pub(super) document: &'a Document,
    pub(super) buffers: &'a Buffers<'a>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    pub(super) fn of(code: u32) -> Result<Self, ReadError> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(malformed(format!("the component type {code} is unknown"))),
        })
    }

    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// What a normalized integer is divided by; 1 for floats.
    pub(super) fn divisor(self) -> f64 {
        match self {
            Self::I8 => f64::from(i8::MAX),
            Self::U8 => f64::from(u8::MAX),
            Self::I16 => f64::from(i16::MAX),
            Self::U16 => f64::from(u16::MAX),
            Self::U32 => f64::from(u32::MAX),
            Self::F32 => 1.0,
        }
    }

    /// The number at the start of `bytes`, which hold at least `size()` bytes.
    fn load(self, bytes: &[u8]) -> f64 {
        match self {
            Self::I8 => f64::from(bytes[0].cast_signed()),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        }
    }
}

/// Bytes that hold elements at equal distances.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    component: Component,
}

impl Elements<'_> {
    fn component(&self, element: usize, index: usize) -> f64 {
        let start = element * self.stride + index * self.component.size();
        self.component.load(&self.bytes[start..])
    }
}

impl<'a> Source<'a> {
    pub(super) fn accessor(&self, index: usize) -> Result<&'a Accessor, ReadError> {
        entry(&self.document.accessors, index, "accessor")
    }

    /// The `N` components of every element, normalized integers as fractions.
    ///
    /// The caller has compared the accessor's count with a limit: an accessor
    /// without data is all zeros, however small the file.
    pub(super) fn vectors<const N: usize>(&self, index: usize) -> Result<Vec<[f64; N]>, ReadError> {
        let accessor = self.accessor(index)?;
        let component = Component::of(accessor.component_type)?;
        let mut values = match accessor.buffer_view {
            None => vec![[0.0; N]; accessor.count],
            Some(view) => {
                let elements = self
                    .elements(view, accessor, component, N)
                    .map_err(in_(index))?;
                let element = |i: usize| std::array::from_fn(|n| elements.component(i, n));
                (0..accessor.count).map(element).collect()
            }
        };
        if let Some(sparse) = &accessor.sparse {
            self.replace(&mut values, sparse, component)
                .map_err(in_(index))?;
        }
        if accessor.normalized {
            let divisor = component.divisor();
            for value in values.as_flattened_mut() {
                // -128 and -127 both stand for -1.
                *value = (*value / divisor).max(-1.0);
            }
        }
        Ok(values)
    }

    /// The elements of a scalar accessor as indices.
    pub(super) fn indices(&self, index: usize) -> Result<Vec<u32>, ReadError> {
        let accessor = self.accessor(index)?;
        let component = Component::of(accessor.component_type)?;
        if !component.is_index() || accessor.shape != "SCALAR" || accessor.normalized {
            return Err(malformed(format!(
                "accessor {index} holds indices, but is not of unsigned whole numbers"
            )));
        }
        // All of them fit: they were read from at most 32 bits.
        Ok(self
            .vectors::<1>(index)?
            .into_iter()
            .map(|[value]| value as u32)
            .collect())
    }

    /// The bytes of a buffer view.
    pub(super) fn view(&self, index: usize) -> Result<(&'a [u8], &'a BufferView), ReadError> {
        let view = entry(&self.document.buffer_views, index, "buffer view")?;
        let data = self.buffers.bytes(self.document, view.buffer)?;
        let end = view.byte_offset.checked_add(view.byte_length);
        let bytes = end
            .and_then(|end| data.get(view.byte_offset..end))
            .ok_or_else(|| {
                malformed(format!(
                    "buffer view {index} spans {} from {} on, but buffer {} has {}",
                    counted(view.byte_length as u64, "byte"),
                    view.byte_offset,
                    view.buffer,
                    data.len()
                ))
            })?;
        Ok((bytes, view))
    }

    fn elements(
        &self,
        view: usize,
        accessor: &Accessor,
        component: Component,
        components: usize,
    ) -> Result<Elements<'a>, ReadError> {
        let (bytes, view) = self.view(view)?;
        let size = component.size() * components;
        let stride = view.byte_stride.unwrap_or(size);
        if stride < size {
            return Err(malformed(format!(
                "the stride of {stride} bytes is less than an element of {size}"
            )));
        }
        let bytes = bytes.get(accessor.byte_offset..).unwrap_or_default();
        span(bytes, accessor.count, stride, size)?;
        Ok(Elements {
            bytes,
            stride,
            component,
        })
    }

    /// Replaces some elements, as the sparse part of an accessor says.
    fn replace<const N: usize>(
        &self,
        values: &mut [[f64; N]],
        sparse: &Sparse,
        component: Component,
    ) -> Result<(), ReadError> {
        let packed = |view: usize, offset: usize, component: Component, components: usize| {
            let bytes = self.view(view)?.0.get(offset..).unwrap_or_default();
            let stride = component.size() * components;
            span(bytes, sparse.count, stride, stride)?;
            Ok::<_, ReadError>(Elements {
                bytes,
                stride,
                component,
            })
        };
        let (at, new) = (&sparse.indices, &sparse.values);
        let index_type = Component::of(at.component_type)?;
        if !index_type.is_index() {
            return Err(malformed(
                "its sparse indices are not unsigned whole numbers",
            ));
        }
        let indices = packed(at.buffer_view, at.byte_offset, index_type, 1)?;
        let new = packed(new.buffer_view, new.byte_offset, component, N)?;
        let count = values.len();
        for element in 0..sparse.count {
            let index = indices.component(element, 0);
            let value = values.get_mut(index as usize).ok_or_else(|| {
                malformed(format!(
                    "a sparse index is {index}, but there {}",
                    are(count, "element")
                ))
            })?;
            *value = std::array::from_fn(|n| new.component(element, n));
        }
        Ok(())
    }
}

/// Checks that `count` elements lie within `bytes`.
fn span(bytes: &[u8], count: usize, stride: usize, size: usize) -> Result<(), ReadError> {
    let needed = match count.checked_sub(1) {
        None => Some(0),
        Some(gaps) => gaps
            .checked_mul(stride)
            .and_then(|start| start.checked_add(size)),
    };
    if needed.is_none_or(|needed| needed > bytes.len()) {
        return Err(malformed(format!(
            "{} of {} at distances of {stride} do not fit into {}",
            counted(count as u64, "element"),
            counted(size as u64, "byte"),
            counted(bytes.len() as u64, "byte")
        )));
    }
    Ok(())
}

/// Puts the number of the accessor in front of a message.
fn in_(index: usize) -> impl Fn(ReadError) -> ReadError {
    move |error| match error {
        ReadError::Glb { message } => malformed(format!("accessor {index}: {message}")),
        other => other,
    }
}
