//! Which streams something is about.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{InvalidStreamName, StreamName};

/// A stream's name, the beginning of names (`rig-*`), or all (`*`).
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct StreamPattern {
    prefix: String,
    is_exact: bool,
}

impl StreamPattern {
    /// Whether `name` is one of those meant.
    #[must_use]
    pub fn matches(&self, name: &StreamName) -> bool {
        if self.is_exact {
            name.as_str() == self.prefix
        } else {
            name.as_str().starts_with(&self.prefix)
        }
    }
}

impl FromStr for StreamPattern {
    type Err = InvalidStreamName;

    fn from_str(text: &str) -> Result<Self, InvalidStreamName> {
        let (prefix, is_exact) = match text.strip_suffix('*') {
            Some(prefix) => (prefix, false),
            None => (text, true),
        };
        if is_exact || !prefix.is_empty() {
            StreamName::parse(prefix)?;
        }
        Ok(Self {
            prefix: prefix.to_owned(),
            is_exact,
        })
    }
}

impl From<StreamName> for StreamPattern {
    fn from(name: StreamName) -> Self {
        Self {
            prefix: name.to_string(),
            is_exact: true,
        }
    }
}

impl TryFrom<String> for StreamPattern {
    type Error = InvalidStreamName;

    fn try_from(text: String) -> Result<Self, InvalidStreamName> {
        text.parse()
    }
}

impl From<StreamPattern> for String {
    fn from(pattern: StreamPattern) -> Self {
        let star = if pattern.is_exact { "" } else { "*" };
        format!("{}{star}", pattern.prefix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_is_a_name_or_the_beginning_of_names() {
        let matches = |pattern: &str, name: &str| {
            let pattern: StreamPattern = pattern.parse().unwrap();
            pattern.matches(&StreamName::parse(name).unwrap())
        };
        assert!(matches("rig", "rig") && !matches("rig", "rig-1"));
        assert!(matches("rig-*", "rig-1") && !matches("rig-*", "rig"));
        assert!(matches("*", "anything"));
        assert!("Rig".parse::<StreamPattern>().is_err());
        assert!("a*b".parse::<StreamPattern>().is_err());
    }
}
