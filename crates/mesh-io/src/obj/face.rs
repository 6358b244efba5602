//! Corners of `f` records and the index lists that they build.

use crate::ReadError;
use crate::cursor::shown;

/// Indices from 0 into positions, texture coordinates and normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Corner {
    position: u32,
    coordinate: Option<u32>,
    normal: Option<u32>,
}

const NAMES: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// Parses `v`, `v/vt`, `v//vn` or `v/vt/vn`. Negative indices count back from the
/// last of the `counts` (vertices, texture coordinates, normals) so far.
pub(super) fn parse_corner(
    token: &[u8],
    counts: [usize; 3],
    face: usize,
    line: usize,
) -> Result<Corner, ReadError> {
    let mut indices = [None; 3];
    let mut parts = token.split(|&byte| byte == b'/');
    for (slot, parsed) in indices.iter_mut().enumerate() {
        let Some(part) = parts.next() else { break };
        if part.is_empty() && slot > 0 {
            continue;
        }
        let index = parse_index(part).ok_or_else(|| invalid(token, line))?;
        *parsed = Some(resolve(index, slot, counts, face, line)?);
    }
    match (indices, parts.next()) {
        ([Some(position), coordinate, normal], None) => Ok(Corner {
            position,
            coordinate,
            normal,
        }),
        _ => Err(invalid(token, line)),
    }
}

fn resolve(
    index: i64,
    slot: usize,
    counts: [usize; 3],
    face: usize,
    line: usize,
) -> Result<u32, ReadError> {
    let count = counts[slot];
    let resolved = if index > 0 {
        Some(index - 1)
    } else {
        count_back(index, count)
    };
    match resolved.map(u32::try_from) {
        Some(Ok(resolved)) => Ok(resolved),
        _ if index == 0 => Err(ReadError::Obj {
            line,
            message: format!("a {} index is 0, but OBJ counts from 1", NAMES[slot]),
        }),
        _ => Err(ReadError::IndexOutOfRange {
            face,
            what: NAMES[slot],
            index,
            count,
            line: Some(line),
        }),
    }
}

fn count_back(index: i64, count: usize) -> Option<i64> {
    let count = i64::try_from(count).ok()?;
    if index < 0 {
        count.checked_add(index).filter(|&resolved| resolved >= 0)
    } else {
        None
    }
}

fn invalid(token: &[u8], line: usize) -> ReadError {
    let message = format!(
        "{} is not a face corner; expected v, v/vt, v//vn or v/vt/vn with whole numbers",
        shown(token)
    );
    ReadError::Obj { line, message }
}

/// A whole number of at most 18 digits.
fn parse_index(text: &[u8]) -> Option<i64> {
    let (is_negative, digits) = match text {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    if digits.is_empty() || digits.len() > 18 {
        return None;
    }
    let mut value = 0_i64;
    for digit in digits {
        if !digit.is_ascii_digit() {
            return None;
        }
        value = value * 10 + i64::from(digit - b'0');
    }
    Some(if is_negative { -value } else { value })
}

/// The triangles of a file, in three numberings.
pub(super) struct Indices {
    positions: Vec<[u32; 3]>,
    /// `None` once a corner lacked its index.
    coordinates: Option<Vec<[u32; 3]>>,
    normals: Option<Vec<[u32; 3]>>,
}

impl Default for Indices {
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            coordinates: Some(Vec::new()),
            normals: Some(Vec::new()),
        }
    }
}

/// An index that nothing answers to, before its line is known.
pub(super) struct OutOfRange {
    face: usize,
    slot: usize,
    index: u32,
    count: usize,
}

impl OutOfRange {
    pub(super) fn face(&self) -> usize {
        self.face
    }

    pub(super) fn with_line(&self, line: Option<usize>) -> ReadError {
        ReadError::IndexOutOfRange {
            face: self.face,
            what: NAMES[self.slot],
            index: i64::from(self.index) + 1,
            count: self.count,
            line,
        }
    }
}

impl Indices {
    pub(super) fn len(&self) -> usize {
        self.positions.len()
    }

    /// Adds a polygon of at least three corners as a fan around its first one.
    pub(super) fn push_fan(&mut self, polygon: &[Corner]) {
        let Some((first, rest)) = polygon.split_first() else {
            return;
        };
        for pair in rest.windows(2) {
            let corners = [first, &pair[0], &pair[1]];
            self.positions.push(corners.map(|corner| corner.position));
            push_if_complete(
                &mut self.coordinates,
                corners.map(|corner| corner.coordinate),
            );
            push_if_complete(&mut self.normals, corners.map(|corner| corner.normal));
        }
    }

    /// Checks every index against the counts of positions, coordinates and normals.
    pub(super) fn check(&self, counts: [usize; 3]) -> Result<(), OutOfRange> {
        let lists = [
            Some(&self.positions),
            self.coordinates.as_ref(),
            self.normals.as_ref(),
        ];
        for (slot, list) in lists.into_iter().enumerate() {
            let count = counts[slot];
            for (face, corners) in list.into_iter().flatten().enumerate() {
                if let Some(&index) = corners.iter().find(|&&index| index as usize >= count) {
                    return Err(OutOfRange {
                        face,
                        slot,
                        index,
                        count,
                    });
                }
            }
        }
        Ok(())
    }

    /// The faces of positions, texture coordinates and normals.
    #[expect(clippy::type_complexity, reason = "three lists of one kind")]
    pub(super) fn into_parts(
        self,
    ) -> (Vec<[u32; 3]>, Option<Vec<[u32; 3]>>, Option<Vec<[u32; 3]>>) {
        (self.positions, self.coordinates, self.normals)
    }
}

fn push_if_complete(list: &mut Option<Vec<[u32; 3]>>, corners: [Option<u32>; 3]) {
    match (list.as_mut(), corners) {
        (Some(list), [Some(a), Some(b), Some(c)]) => list.push([a, b, c]),
        _ => *list = None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_a_corner_is_read() {
        let parse = |text: &str| parse_corner(text.as_bytes(), [10, 20, 30], 0, 1);
        let corner = |position, coordinate, normal| {
            Ok(Corner {
                position,
                coordinate,
                normal,
            })
        };
        assert_eq!(parse("3"), corner(2, None, None));
        assert_eq!(parse("3/4"), corner(2, Some(3), None));
        assert_eq!(parse("3//5"), corner(2, None, Some(4)));
        assert_eq!(parse("3/4/5"), corner(2, Some(3), Some(4)));
        assert_eq!(parse("3/"), corner(2, None, None));
        assert_eq!(parse("-1/-20/-30"), corner(9, Some(0), Some(0)));
    }

    #[test]
    fn anything_else_is_refused() {
        for text in [
            "",
            "/1",
            "a",
            "1/a",
            "1.0",
            "1/2/3/4",
            "0",
            "-11",
            "1/0",
            "99999999999",
        ] {
            assert!(
                parse_corner(text.as_bytes(), [10, 20, 30], 0, 1).is_err(),
                "{text}"
            );
        }
    }
}
