//! The `Prefer` header (RFC 7240), as far as it is about waiting.

use std::time::Duration;

use axum::http::HeaderMap;

/// Whether a publisher wants to wait for its frame to be out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wait {
    /// It does not.
    No,
    /// However long it takes: `Prefer: wait`.
    UntilDone,
    /// So long: `Prefer: wait=5`, in seconds.
    AtMost(Duration),
}

impl Wait {
    /// Reads the header. Preferences that are unknown or make no sense are ignored, as RFC
    /// 7240 asks.
    pub fn of(headers: &HeaderMap) -> Self {
        let values = headers.get_all("prefer").iter();
        let preferences = values
            .filter_map(|value| value.to_str().ok())
            .flat_map(|text| text.split(','));
        for preference in preferences {
            // What follows a semicolon are the preference's parameters; `wait` has none.
            let preference = preference.split(';').next().unwrap_or_default();
            let (name, value) = preference.split_once('=').unwrap_or((preference, ""));
            if !name.trim().eq_ignore_ascii_case("wait") {
                continue;
            }
            let value = value.trim().trim_matches('"');
            if value.is_empty() {
                return Self::UntilDone;
            }
            if let Ok(seconds) = value.parse() {
                return Self::AtMost(Duration::from_secs(seconds));
            }
        }
        Self::No
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(value: &str) -> Wait {
        let mut headers = HeaderMap::new();
        headers.insert("prefer", value.parse().unwrap());
        Wait::of(&headers)
    }

    #[test]
    fn waiting_is_asked_for_with_or_without_a_limit() {
        assert_eq!(of("wait"), Wait::UntilDone);
        assert_eq!(
            of("respond-async, Wait = 5"),
            Wait::AtMost(Duration::from_secs(5))
        );
        assert_eq!(of("handling=strict;wait"), Wait::No);
        assert_eq!(of("wait=soon"), Wait::No);
        assert_eq!(Wait::of(&HeaderMap::new()), Wait::No);
    }
}
