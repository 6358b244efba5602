//! PLY, the Stanford polygon format: ASCII and both binary byte orders.
//!
//! Source: Greg Turk, "The PLY Polygon File Format", 1994, with the type names that
//! later programs added (`int8` to `float64`).

mod ascii;
mod binary;
mod faces;
mod header;
mod layout;
mod read;
mod vertices;
mod write;

pub use read::read;
pub use write::write;

use crate::ReadError;

fn malformed(message: impl Into<String>) -> ReadError {
    ReadError::Ply {
        message: message.into(),
    }
}
