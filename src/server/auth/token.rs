//! Tokens of which the server knows the hash only.

use std::fmt;
use std::str::FromStr;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use super::Grant;
use super::scope::Scope;
use crate::streams::StreamPattern;

const ALGORITHM: &str = "sha256:";

/// The SHA-256 of a token, as `sha256:` and 64 hexadecimal digits.
///
/// Tokens are long and random (see `steadymesh token`), so that a fast hash is enough: there is
/// no dictionary to try.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct TokenHash([u8; 32]);

/// The text is not the hash of a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a token's hash is \"sha256:\" and 64 hexadecimal digits: `steadymesh token` makes one")]
pub struct InvalidHash;

/// One token of the configuration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenOptions {
    /// Whose it is, for the log.
    pub name: String,
    /// Its hash.
    pub hash: TokenHash,
    /// What it opens.
    pub scopes: Vec<Scope>,
    /// For which streams; all if it is left out.
    #[serde(default = "all_streams")]
    pub streams: Vec<StreamPattern>,
    /// Until when, as RFC 3339 has it; for ever if it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires: Option<Expiry>,
}

/// A time such as `2027-01-01T00:00:00Z`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Expiry(SystemTime);

fn all_streams() -> Vec<StreamPattern> {
    vec!["*".parse().expect("a star is a pattern, as its tests say")]
}

impl TokenHash {
    /// The hash of a token.
    #[must_use]
    pub fn of(token: &str) -> Self {
        Self(Sha256::digest(token.as_bytes()).into())
    }
}

impl FromStr for TokenHash {
    type Err = InvalidHash;

    fn from_str(text: &str) -> Result<Self, InvalidHash> {
        let digits = text.strip_prefix(ALGORITHM).ok_or(InvalidHash)?.as_bytes();
        if digits.len() != 64 {
            return Err(InvalidHash);
        }
        let mut hash = [0; 32];
        for (byte, pair) in hash.iter_mut().zip(digits.chunks(2)) {
            let pair = std::str::from_utf8(pair).map_err(|_| InvalidHash)?;
            *byte = u8::from_str_radix(pair, 16).map_err(|_| InvalidHash)?;
        }
        Ok(Self(hash))
    }
}

impl fmt::Display for TokenHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(ALGORITHM)?;
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for TokenHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TokenHash(…)")
    }
}

impl TryFrom<String> for TokenHash {
    type Error = InvalidHash;

    fn try_from(text: String) -> Result<Self, InvalidHash> {
        text.parse()
    }
}

impl From<TokenHash> for String {
    fn from(hash: TokenHash) -> Self {
        hash.to_string()
    }
}

impl From<SystemTime> for Expiry {
    fn from(time: SystemTime) -> Self {
        Self(time)
    }
}

impl TryFrom<String> for Expiry {
    type Error = humantime::TimestampError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        humantime::parse_rfc3339(&text).map(Self)
    }
}

impl From<Expiry> for String {
    fn from(expiry: Expiry) -> Self {
        humantime::format_rfc3339_seconds(expiry.0).to_string()
    }
}

/// A token that the server knows.
#[derive(Debug)]
pub(super) struct Token {
    hash: TokenHash,
    grant: Grant,
}

impl Token {
    pub fn new(options: &TokenOptions) -> Self {
        Self {
            hash: options.hash.clone(),
            grant: Grant {
                name: options.name.clone(),
                scopes: options.scopes.clone(),
                streams: options.streams.clone(),
                expires: options.expires.map(|expiry| expiry.0),
            },
        }
    }

    /// Compares in constant time.
    pub fn has_hash(&self, hash: &TokenHash) -> bool {
        self.hash.0.ct_eq(&hash.0).into()
    }

    pub fn grant(&self) -> &Grant {
        &self.grant
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_is_the_sha256_of_the_token() {
        // From `printf abc | sha256sum`.
        let expected = "sha256:ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(TokenHash::of("abc").to_string(), expected);
        assert_eq!(expected.parse(), Ok(TokenHash::of("abc")));
        for wrong in [
            "ba78",
            "sha256:ba78",
            &expected[7..],
            &format!("{expected}0"),
        ] {
            assert_eq!(wrong.parse::<TokenHash>(), Err(InvalidHash), "{wrong}");
        }
        let not_hexadecimal = expected.replace('b', "ä");
        assert!(not_hexadecimal.parse::<TokenHash>().is_err());
    }
}
