//! Reads the counts at the start of a Draco mesh, so that a file over a limit is
//! refused with its own figures before anything is decoded.
//!
//! Source: "Draco 3D Data Compression: Bitstream Specification", version 2.2,
//! sections 4 to 8 (header, metadata, connectivity).

const MAGIC: &[u8; 5] = b"DRACO";
const MESH: u8 = 1;
const SEQUENTIAL: u8 = 0;
const EDGEBREAKER: u8 = 1;
const METADATA_FLAG: u16 = 0x8000;

/// What a file of bitstream version 2.2 promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Vertices of the connectivity; seams can make the points more.
    pub vertices: u32,
    pub faces: u32,
}

/// True if `bytes` begin as every Draco file does.
pub(crate) fn has_magic(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The counts, or `None` if they cannot be told: another version, another
/// geometry or a file that ends early. libdraco then has the last word.
pub(crate) fn counts(bytes: &[u8]) -> Option<Counts> {
    let mut cursor = Cursor {
        rest: bytes.strip_prefix(MAGIC)?,
    };
    let version = (cursor.byte()?, cursor.byte()?);
    let geometry = cursor.byte()?;
    let method = cursor.byte()?;
    let flags = u16::from_le_bytes([cursor.byte()?, cursor.byte()?]);
    if version != (2, 2) || geometry != MESH {
        return None;
    }
    if flags & METADATA_FLAG != 0 {
        cursor.skip_all_metadata()?;
    }
    match method {
        SEQUENTIAL => {
            let faces = cursor.varint()?;
            Some(Counts {
                faces,
                vertices: cursor.varint()?,
            })
        }
        EDGEBREAKER => {
            let _traversal = cursor.byte()?;
            let vertices = cursor.varint()?;
            Some(Counts {
                vertices,
                faces: cursor.varint()?,
            })
        }
        _ => None,
    }
}

struct Cursor<'a> {
    rest: &'a [u8],
}

impl Cursor<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (&first, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(first)
    }

    fn skip(&mut self, count: usize) -> Option<()> {
        self.rest = self.rest.get(count..)?;
        Some(())
    }

    /// Seven bits a byte, least significant first; the top bit says "more follows".
    fn varint(&mut self) -> Option<u32> {
        let mut value = 0_u64;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return u32::try_from(value).ok();
            }
        }
        None
    }

    fn skip_name(&mut self) -> Option<()> {
        let length = self.byte()?;
        self.skip(usize::from(length))
    }

    fn skip_all_metadata(&mut self) -> Option<()> {
        let attribute_count = self.varint()?;
        for _ in 0..attribute_count {
            let _unique_id = self.varint()?;
            self.skip_metadata()?;
        }
        self.skip_metadata()
    }

    /// Skips one tree of metadata, which is stored in preorder. Each step reads
    /// at least one byte, so the loop ends with the file.
    fn skip_metadata(&mut self) -> Option<()> {
        let mut pending = 1_u64;
        let mut is_root = true;
        while pending > 0 {
            pending -= 1;
            if !is_root {
                self.skip_name()?;
            }
            is_root = false;
            for _ in 0..self.varint()? {
                self.skip_name()?;
                let length = self.varint()?;
                self.skip(usize::try_from(length).ok()?)?;
            }
            pending += u64::from(self.varint()?);
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edgebreaker(flags: u16, rest: &[u8]) -> Vec<u8> {
        let mut bytes = b"DRACO\x02\x02\x01\x01".to_vec();
        bytes.extend(flags.to_le_bytes());
        bytes.extend(rest);
        bytes
    }

    #[test]
    fn counts_of_an_edgebreaker_file_are_read() {
        let bytes = edgebreaker(0, &[0, 0xac, 0x02, 7]);
        assert_eq!(
            counts(&bytes),
            Some(Counts {
                vertices: 300,
                faces: 7
            })
        );
    }

    #[test]
    fn metadata_before_the_counts_is_skipped() {
        // One attribute (id 3) with one entry "a" = [9]; the file's own metadata
        // has no entry and one child "b", which is empty.
        let metadata = [1, 3, 1, 1, b'a', 1, 9, 0, 0, 1, 1, b'b', 0, 0];
        let mut rest = metadata.to_vec();
        rest.extend([0, 5, 6]);
        let bytes = edgebreaker(METADATA_FLAG, &rest);
        assert_eq!(
            counts(&bytes),
            Some(Counts {
                vertices: 5,
                faces: 6
            })
        );
    }

    #[test]
    fn a_file_that_ends_inside_its_counts_has_none() {
        let bytes = edgebreaker(0, &[0, 0xac]);
        assert_eq!(counts(&bytes), None);
    }
}
