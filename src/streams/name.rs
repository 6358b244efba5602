//! A stream's public name.

use std::fmt;

/// A stream's public name: 1 to 64 of `a-z`, `0-9`, `-`.
///
/// Safe in a path, a bus subject and a metric label.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StreamName(String);

/// The text is not a stream's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a stream's name has 1 to {} of the characters a-z, 0-9 and -",
    StreamName::MAX_LEN
)]
pub struct InvalidStreamName;

impl StreamName {
    /// The length of the longest name.
    pub const MAX_LEN: usize = 64;

    /// Checks a name.
    ///
    /// # Errors
    ///
    /// [`InvalidStreamName`] if it is empty, too long, or has other characters.
    pub fn parse(text: &str) -> Result<Self, InvalidStreamName> {
        let allowed = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-';
        if text.is_empty() || Self::MAX_LEN < text.len() || !text.bytes().all(allowed) {
            return Err(InvalidStreamName);
        }
        Ok(Self(text.to_owned()))
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for StreamName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_could_mean_something_else_are_refused() {
        for name in [
            "",
            "Demo",
            "a/b",
            "a b",
            "..",
            "a.b",
            "ä",
            "a%2e",
            &"a".repeat(65),
        ] {
            assert_eq!(StreamName::parse(name), Err(InvalidStreamName), "{name}");
        }
        for name in ["a", "rig-2", "0", &"a".repeat(64)] {
            assert_eq!(StreamName::parse(name).unwrap().as_str(), name);
        }
    }
}
