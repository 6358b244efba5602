//! What a token may be for.

use std::fmt;

use serde::{Deserialize, Serialize};

/// What may be done with a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scope {
    /// Make and configure it, and send frames.
    Publish,
    /// Receive frames and metrics, and see its state.
    Subscribe,
    /// Everything, deleting it included.
    Admin,
}

impl Scope {
    /// Whether having this scope is enough where `needed` is.
    #[must_use]
    pub fn includes(self, needed: Self) -> bool {
        self == Self::Admin || self == needed
    }
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Publish => "publish",
            Self::Subscribe => "subscribe",
            Self::Admin => "admin",
        })
    }
}
