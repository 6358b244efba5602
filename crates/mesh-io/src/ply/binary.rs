//! Binary bodies of either byte order.

use super::header::{Element, Kind, Scalar};
use super::layout;
use super::malformed;
use super::read::{Record, Role, Sinks};
use crate::ReadError;

/// What is left of a body.
pub(super) struct BinaryBody<'a, const BIG: bool> {
    rest: &'a [u8],
    /// The current one.
    record: Record,
}

impl<'a, const BIG: bool> BinaryBody<'a, BIG> {
    pub(super) fn new(rest: &'a [u8]) -> Self {
        Self {
            rest,
            record: Record::default(),
        }
    }

    pub(super) fn read(
        &mut self,
        role: Role,
        element: &Element,
        sinks: &mut Sinks<'_>,
    ) -> Result<(), ReadError> {
        match (role, layout::fixed_record_size(element)) {
            (Role::Other, Some(size)) => self.skip_records(element, size),
            (Role::Vertex, Some(size)) => self.fixed_vertices(element, size, sinks),
            (Role::Face, _) if is_plain_triangle_list(element) => self.triangles(element, sinks),
            _ => self.records(role, element, 0, sinks),
        }
    }

    fn skip_records(&mut self, element: &Element, size: usize) -> Result<(), ReadError> {
        let length = usize::try_from(element.count)
            .ok()
            .and_then(|n| n.checked_mul(size));
        let rest = length.and_then(|length| self.rest.get(length..));
        self.rest = rest.ok_or_else(|| self.ends(element, 0))?;
        Ok(())
    }

    fn fixed_vertices(
        &mut self,
        element: &Element,
        size: usize,
        sinks: &mut Sinks<'_>,
    ) -> Result<(), ReadError> {
        let body = self.rest;
        self.skip_records(element, size)?;
        let columns = layout::columns(element);
        for record in body[..body.len() - self.rest.len()].chunks_exact(size) {
            let value = |index: usize| {
                let (scalar, offset) = columns[index];
                load::<BIG>(scalar, &record[offset..])
            };
            sinks.vertices.push(value, None)?;
        }
        Ok(())
    }

    /// Records of one byte that says 3 and three 32-bit indices, up to the first
    /// other polygon.
    fn triangles(&mut self, element: &Element, sinks: &mut Sinks<'_>) -> Result<(), ReadError> {
        let mut done = 0;
        while done < element.count {
            let Some((record, rest)) = self.rest.split_first_chunk::<13>() else {
                break;
            };
            if record[0] != 3 {
                break;
            }
            let index = |at: usize| {
                let bytes = [record[at], record[at + 1], record[at + 2], record[at + 3]];
                if BIG {
                    u32::from_be_bytes(bytes)
                } else {
                    u32::from_le_bytes(bytes)
                }
            };
            let corners = [index(1), index(5), index(9)];
            if corners
                .iter()
                .any(|&corner| corner > i32::MAX.cast_unsigned())
            {
                // Negative if the type is signed: let the general path tell.
                break;
            }
            sinks.faces.push_triangle(corners)?;
            self.rest = rest;
            done += 1;
        }
        self.records(Role::Face, element, done, sinks)
    }

    fn records(
        &mut self,
        role: Role,
        element: &Element,
        first: u64,
        sinks: &mut Sinks<'_>,
    ) -> Result<(), ReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        for record in first..element.count {
            self.read_record(element, record, sinks.corner_list)?;
            sinks.push(role, &self.record, None)?;
        }
        Ok(())
    }

    /// Reads one record.
    fn read_record(
        &mut self,
        element: &Element,
        record: u64,
        corner_list: usize,
    ) -> Result<(), ReadError> {
        self.record.scalars.clear();
        for (index, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(scalar) => {
                    let bytes = self
                        .take(scalar.size())
                        .ok_or_else(|| self.ends(element, record))?;
                    self.record.scalars.push(load::<BIG>(scalar, bytes));
                }
                Kind::List { count, item } => {
                    let bytes = self
                        .take(count.size())
                        .ok_or_else(|| self.ends(element, record))?;
                    let length = list_length(load::<BIG>(count, bytes), element, record)?;
                    let bytes = length
                        .checked_mul(item.size())
                        .and_then(|size| self.take(size))
                        .ok_or_else(|| self.ends(element, record))?;
                    if index == corner_list {
                        self.record.corners.clear();
                        let items = bytes.chunks_exact(item.size());
                        self.record
                            .corners
                            .extend(items.map(|bytes| load::<BIG>(item, bytes)));
                    }
                    self.record.scalars.push(0.0);
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, size: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(size)?;
        self.rest = rest;
        Some(taken)
    }

    fn ends(&self, element: &Element, record: u64) -> ReadError {
        malformed(format!(
            "the file ends inside {} {record} of {}",
            element.name, element.count
        ))
    }
}

pub(super) fn list_length(length: f64, element: &Element, record: u64) -> Result<usize, ReadError> {
    // Counts are integers of at most 32 bits, or text that was checked to be whole.
    if length < 0.0 || length.fract() != 0.0 || length > f64::from(u32::MAX) {
        return Err(malformed(format!(
            "a list of {} {record} has the length {length}",
            element.name
        )));
    }
    Ok(length as usize)
}

fn is_plain_triangle_list(element: &Element) -> bool {
    let [property] = element.properties.as_slice() else {
        return false;
    };
    match property.kind {
        Kind::List { count, item } => {
            count.size() == 1 && matches!(item, Scalar::I32 | Scalar::U32)
        }
        Kind::Scalar(_) => false,
    }
}

/// The number at the start of `bytes`, which hold at least `scalar.size()` bytes.
#[inline]
fn load<const BIG: bool>(scalar: Scalar, bytes: &[u8]) -> f64 {
    #[inline]
    fn array<const BIG: bool, const N: usize>(bytes: &[u8]) -> [u8; N] {
        let mut array = [0; N];
        array.copy_from_slice(&bytes[..N]);
        if BIG {
            array.reverse();
        }
        array
    }
    match scalar {
        Scalar::I8 => f64::from(bytes[0].cast_signed()),
        Scalar::U8 => f64::from(bytes[0]),
        Scalar::I16 => f64::from(i16::from_le_bytes(array::<BIG, 2>(bytes))),
        Scalar::U16 => f64::from(u16::from_le_bytes(array::<BIG, 2>(bytes))),
        Scalar::I32 => f64::from(i32::from_le_bytes(array::<BIG, 4>(bytes))),
        Scalar::U32 => f64::from(u32::from_le_bytes(array::<BIG, 4>(bytes))),
        Scalar::F32 => f64::from(f32::from_le_bytes(array::<BIG, 4>(bytes))),
        Scalar::F64 => f64::from_le_bytes(array::<BIG, 8>(bytes)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_is_loaded_in_both_byte_orders() {
        assert_eq!(load::<false>(Scalar::I8, &[0xfe]), -2.0);
        assert_eq!(load::<false>(Scalar::U8, &[0xfe]), 254.0);
        assert_eq!(load::<true>(Scalar::I16, &(-300_i16).to_be_bytes()), -300.0);
        assert_eq!(
            load::<false>(Scalar::U16, &60_000_u16.to_le_bytes()),
            60_000.0
        );
        assert_eq!(
            load::<true>(Scalar::I32, &(-70_000_i32).to_be_bytes()),
            -70_000.0
        );
        assert_eq!(
            load::<false>(Scalar::U32, &4_000_000_000_u32.to_le_bytes()),
            4e9
        );
        assert_eq!(load::<true>(Scalar::F32, &1.5_f32.to_be_bytes()), 1.5);
        assert_eq!(load::<false>(Scalar::F64, &0.1_f64.to_le_bytes()), 0.1);
    }
}
