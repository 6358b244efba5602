//! The secret that an endpoint shares with the server, and signatures made with it.

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use hmac::{Hmac, KeyInit, Mac};
use serde::{Deserialize, Serialize};
use sha2::Sha256;

/// How a secret is written: this, then base64.
const PREFIX: &str = "whsec_";
/// What Standard Webhooks asks for, in bytes.
const LENGTHS: std::ops::RangeInclusive<usize> = 24..=64;

const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// A secret, which never prints itself.
#[derive(Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct Secret(Vec<u8>);

/// What was given is no secret; it is not repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a webhook's secret is {PREFIX} and 24 to 64 random bytes in base64")]
pub struct InvalidSecret;

impl Secret {
    /// Reads `whsec_` and base64.
    ///
    /// # Errors
    ///
    /// [`InvalidSecret`].
    pub fn parse(text: &str) -> Result<Self, InvalidSecret> {
        let encoded = text.trim().strip_prefix(PREFIX).ok_or(InvalidSecret)?;
        let bytes = BASE64.decode(encoded).map_err(|_| InvalidSecret)?;
        if !LENGTHS.contains(&bytes.len()) {
            return Err(InvalidSecret);
        }
        Ok(Self(bytes))
    }

    /// The value of `webhook-signature` for a message, sent at `timestamp` seconds since 1970.
    ///
    /// # Source
    ///
    /// Standard Webhooks, "Signature scheme": HMAC-SHA256 over `id.timestamp.body`, version `v1`.
    #[must_use]
    pub fn sign(&self, id: &str, timestamp: u64, body: &[u8]) -> String {
        let mac = Hmac::<Sha256>::new_from_slice(&self.0);
        let mut mac = mac.expect("HMAC takes keys of every length");
        mac.update(format!("{id}.{timestamp}.").as_bytes());
        mac.update(body);
        format!("v1,{}", BASE64.encode(mac.finalize().into_bytes()))
    }
}

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Secret(…)")
    }
}

impl TryFrom<String> for Secret {
    type Error = InvalidSecret;

    fn try_from(text: String) -> Result<Self, InvalidSecret> {
        Self::parse(&text)
    }
}

impl From<Secret> for String {
    fn from(_: Secret) -> Self {
        format!("{PREFIX}…")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

    #[test]
    fn a_signature_is_that_of_the_specifications_example() {
        let body = br#"{"test": 2432232314}"#;
        let signature =
            Secret::parse(TEXT)
                .unwrap()
                .sign("msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, body);
        assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn a_secret_prints_nothing_of_itself() {
        let secret = Secret::parse(TEXT).unwrap();
        let serialized = serde_json::to_string(&secret).unwrap();
        for shown in [format!("{secret:?}"), serialized] {
            assert!(!shown.contains("MfKQ"), "{shown}");
        }
        let error = Secret::parse("whsec_tooshort").unwrap_err().to_string();
        assert!(!error.contains("tooshort"), "{error}");
    }

    #[test]
    fn what_is_too_short_or_not_base64_is_refused() {
        for text in [
            "",
            "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw",
            "whsec_c2hvcnQ=",
            "whsec_%%%%",
        ] {
            assert_eq!(Secret::parse(text), Err(InvalidSecret), "{text}");
        }
    }
}
