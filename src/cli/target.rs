//! The size of simplified frames, and how strongly they are tracked, as they are typed.

use crate::pipeline::{AttributeWeight, InvalidSettings, TargetSize, TrackingStrength};

/// Files are the user's own: the limit is that of 32-bit indices.
const MAX_FACES: usize = u32::MAX as usize;

/// A number of faces.
///
/// # Errors
///
/// What is expected instead.
pub(super) fn target_faces(text: &str) -> Result<usize, String> {
    let faces = text.parse().map_err(|_| "a whole number is expected")?;
    expected(TargetSize::Faces(faces).check(MAX_FACES)).map(|_| faces)
}

/// A share of the faces.
///
/// # Errors
///
/// What is expected instead.
pub(super) fn target_ratio(text: &str) -> Result<f64, String> {
    let ratio = text.parse().map_err(|_| "a number is expected")?;
    expected(TargetSize::Ratio(ratio).check(MAX_FACES)).map(|_| ratio)
}

/// How strongly robust tracking holds a frame to the one before.
///
/// # Errors
///
/// What is expected instead.
pub(super) fn tracking_strength(text: &str) -> Result<TrackingStrength, String> {
    let strength = text.parse().map_err(|_| "a number is expected")?;
    expected(TrackingStrength::new(strength))
}

/// How much attributes count beside the shape.
///
/// # Errors
///
/// What is expected instead.
pub(super) fn attribute_weight(text: &str) -> Result<AttributeWeight, String> {
    let weight = text.parse().map_err(|_| "a number is expected")?;
    expected(AttributeWeight::new(weight))
}

/// What is checked, or what is expected instead: the parser has said already which option it is,
/// and what was given.
fn expected<T>(checked: Result<T, InvalidSettings>) -> Result<T, String> {
    checked.map_err(|error| {
        let error = error.to_string();
        let expected = error.split_once(": ").map(|(_, expected)| expected);
        expected.unwrap_or(&error).to_owned()
    })
}
