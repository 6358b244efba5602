//! Signed tokens (RFC 7519), checked with a key from a file.

use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use jsonwebtoken::errors::ErrorKind;
use jsonwebtoken::{Algorithm, DecodingKey, Validation, decode};
use serde::{Deserialize, Serialize};

use super::scope::Scope;
use super::{Denied, Grant};
use crate::streams::StreamPattern;

/// How signed tokens are checked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JwtOptions {
    /// The only algorithm that is accepted.
    pub algorithm: JwtAlgorithm,
    /// The secret itself (HS256, at least 32 bytes), or the public key in PEM (EdDSA).
    pub key_file: PathBuf,
    /// The `iss` that tokens must have, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub issuer: Option<String>,
    /// The `aud` that tokens must have, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audience: Option<String>,
}

/// An algorithm of RFC 7518 or RFC 8037.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum JwtAlgorithm {
    /// HMAC with SHA-256.
    #[serde(rename = "HS256")]
    Hs256,
    /// Ed25519.
    #[serde(rename = "EdDSA")]
    EdDsa,
}

/// Why the key of signed tokens cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("auth.jwt.key_file {path}: {reason}")]
pub struct UnusableKey {
    path: String,
    reason: String,
}

/// A secret that is shorter can be guessed.
const MIN_SECRET_BYTES: usize = 32;
/// How far the clocks of who signs and who checks may be apart, in seconds.
const LEEWAY: u64 = 5;

/// The claims that matter here; others are ignored.
#[derive(Debug, Deserialize)]
struct Claims {
    sub: Option<String>,
    /// Scopes, separated by spaces (RFC 8693).
    #[serde(default)]
    scope: String,
    #[serde(default)]
    streams: Vec<StreamPattern>,
    exp: u64,
}

/// Checks signed tokens.
pub(super) struct JwtVerifier {
    key: DecodingKey,
    validation: Validation,
}

impl std::fmt::Debug for JwtVerifier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("JwtVerifier(…)")
    }
}

impl JwtVerifier {
    pub fn new(options: &JwtOptions) -> Result<Self, UnusableKey> {
        let unusable = |reason: String| UnusableKey {
            path: options.key_file.display().to_string(),
            reason,
        };
        let bytes = std::fs::read(&options.key_file).map_err(|e| unusable(e.to_string()))?;
        let (algorithm, key) = match options.algorithm {
            JwtAlgorithm::Hs256 => {
                let secret = bytes.trim_ascii();
                if secret.len() < MIN_SECRET_BYTES {
                    let found = secret.len();
                    return Err(unusable(format!(
                        "the secret has {found} bytes, at least {MIN_SECRET_BYTES} are needed"
                    )));
                }
                (Algorithm::HS256, DecodingKey::from_secret(secret))
            }
            JwtAlgorithm::EdDsa => {
                let key = DecodingKey::from_ed_pem(&bytes);
                (Algorithm::EdDSA, key.map_err(|e| unusable(e.to_string()))?)
            }
        };
        let mut validation = Validation::new(algorithm);
        validation.leeway = LEEWAY;
        validation.validate_nbf = true;
        validation.validate_aud = options.audience.is_some();
        let mut required = vec!["exp"];
        if let Some(audience) = &options.audience {
            validation.set_audience(&[audience]);
            required.push("aud");
        }
        if let Some(issuer) = &options.issuer {
            validation.set_issuer(&[issuer]);
            required.push("iss");
        }
        validation.set_required_spec_claims(&required);
        Ok(Self { key, validation })
    }

    pub fn grant(&self, token: &str) -> Result<Grant, Denied> {
        let claims = match decode::<Claims>(token, &self.key, &self.validation) {
            Ok(decoded) => decoded.claims,
            Err(error) if *error.kind() == ErrorKind::ExpiredSignature => {
                return Err(Denied::Expired);
            }
            Err(_) => return Err(Denied::Unknown),
        };
        let scopes = claims
            .scope
            .split_whitespace()
            .filter_map(|name| match name {
                "publish" => Some(Scope::Publish),
                "subscribe" => Some(Scope::Subscribe),
                "admin" => Some(Scope::Admin),
                // Scopes of other services.
                _ => None,
            });
        let lifetime = Duration::from_secs(claims.exp.saturating_add(LEEWAY));
        Ok(Grant {
            name: claims.sub.unwrap_or_else(|| "a signed token".to_owned()),
            scopes: scopes.collect(),
            streams: claims.streams,
            // A time that is out of range is as good as none: it will not be reached.
            expires: SystemTime::UNIX_EPOCH.checked_add(lifetime),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::StreamName;
    use jsonwebtoken::{EncodingKey, Header, encode};
    use serde_json::{Value, json};

    const SECRET: &[u8] = b"a secret of more than thirty-two bytes";

    fn verifier(issuer: Option<&str>) -> JwtVerifier {
        let folder = tempfile::tempdir().unwrap();
        let key_file = folder.path().join("key");
        std::fs::write(&key_file, SECRET).unwrap();
        JwtVerifier::new(&JwtOptions {
            algorithm: JwtAlgorithm::Hs256,
            key_file,
            issuer: issuer.map(str::to_owned),
            audience: None,
        })
        .unwrap()
    }

    fn sign(claims: &Value, algorithm: Algorithm, secret: &[u8]) -> String {
        let key = EncodingKey::from_secret(secret);
        encode(&Header::new(algorithm), claims, &key).unwrap()
    }

    fn in_an_hour() -> u64 {
        let now = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap();
        now.as_secs() + 3600
    }

    #[test]
    fn a_signed_token_opens_what_its_claims_say() {
        let claims = json!({"scope": "publish other", "streams": ["rig-*"], "exp": in_an_hour()});
        let grant = verifier(None)
            .grant(&sign(&claims, Algorithm::HS256, SECRET))
            .unwrap();
        let rig = StreamName::parse("rig-1").unwrap();
        assert_eq!(grant.check(Scope::Publish, &rig), Ok(()));
        assert!(grant.check(Scope::Subscribe, &rig).is_err());
        assert!(grant.expires.is_some());
    }

    #[test]
    fn a_token_of_another_key_algorithm_or_issuer_or_without_an_end_is_unknown() {
        let good = json!({"scope": "admin", "streams": ["*"], "exp": in_an_hour()});
        let denied = |token: &str| verifier(None).grant(token).unwrap_err();
        let other_key = sign(
            &good,
            Algorithm::HS256,
            b"another secret of more than 32 bytes!",
        );
        assert_eq!(denied(&other_key), Denied::Unknown);
        assert_eq!(
            denied(&sign(&good, Algorithm::HS512, SECRET)),
            Denied::Unknown
        );
        let endless = json!({"scope": "admin", "streams": ["*"]});
        assert_eq!(
            denied(&sign(&endless, Algorithm::HS256, SECRET)),
            Denied::Unknown
        );
        // {"alg":"none"}
        let payload = sign(&good, Algorithm::HS256, SECRET);
        let payload = payload.split('.').nth(1).unwrap();
        assert_eq!(
            denied(&format!("eyJhbGciOiJub25lIn0.{payload}.")),
            Denied::Unknown
        );
        let token = sign(&good, Algorithm::HS256, SECRET);
        assert_eq!(verifier(Some("studio")).grant(&token), Err(Denied::Unknown));
        let past = json!({"scope": "admin", "streams": ["*"], "exp": 1_600_000_000});
        assert_eq!(
            denied(&sign(&past, Algorithm::HS256, SECRET)),
            Denied::Expired
        );
    }

    #[test]
    fn a_short_secret_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let key_file = folder.path().join("key");
        std::fs::write(&key_file, "short\n").unwrap();
        let options = JwtOptions {
            algorithm: JwtAlgorithm::Hs256,
            key_file,
            issuer: None,
            audience: None,
        };
        let error = JwtVerifier::new(&options).unwrap_err().to_string();
        assert!(error.contains("5 bytes"), "{error}");
    }
}
