//! The size of simplified frames as it is typed.

use crate::pipeline::TargetSize;

/// Files are the user's own: the limit is that of 32-bit indices.
const MAX_FACES: usize = u32::MAX as usize;

/// A number of faces.
///
/// # Errors
///
/// What is expected instead.
pub(super) fn target_faces(text: &str) -> Result<usize, String> {
    let faces = text.parse().map_err(|_| "a whole number is expected")?;
    check(TargetSize::Faces(faces)).map(|()| faces)
}

/// A share of the faces.
///
/// # Errors
///
/// What is expected instead.
pub(super) fn target_ratio(text: &str) -> Result<f64, String> {
    let ratio = text.parse().map_err(|_| "a number is expected")?;
    check(TargetSize::Ratio(ratio)).map(|()| ratio)
}

fn check(target: TargetSize) -> Result<(), String> {
    let Err(error) = target.check(MAX_FACES) else {
        return Ok(());
    };
    // The parser has said already which option it is, and what was given.
    let error = error.to_string();
    let expected = error.split_once(": ").map(|(_, expected)| expected);
    Err(expected.unwrap_or(&error).to_owned())
}
