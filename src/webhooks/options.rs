//! Who is told what, and when a figure is worth telling.

use std::path::PathBuf;

use reqwest::Url;
use serde::{Deserialize, Serialize};

use crate::streams::{Figures, StreamName, StreamPattern};

use super::{InvalidSecret, Kind, Secret};

/// What may be configured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// A stream that has had frames and has none for so long has stalled, in seconds.
    pub stall_secs: u64,
    /// So many frames in a row are out of a bound before that is told,
    pub exceeded_after_frames: u32,
    /// and so many in a row are within it before that is told.
    pub restored_after_frames: u32,
    /// How long an endpoint may take to answer, in seconds.
    pub timeout_secs: u64,
    /// How often a message is sent at most.
    pub attempts: u32,
    /// The time to the second attempt, in milliseconds; each further one takes twice as long, up
    /// to a minute.
    pub retry_ms: u64,
    /// Messages that may wait for one endpoint; the oldest is dropped for a new one.
    pub queue: usize,
    /// How long waiting messages may take to be delivered when the server stops, in seconds.
    pub shutdown_secs: u64,
    /// Who is told.
    pub endpoints: Vec<EndpointOptions>,
    /// Which figures are watched.
    pub bounds: Vec<Bound>,
}

/// A service that is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndpointOptions {
    /// Its name in the log and in metrics: 1 to 64 of `a-z`, `0-9`, `-`.
    pub name: String,
    /// Where messages go. It may hold a secret of its own, and is never shown.
    pub url: Address,
    /// What messages are signed with,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub secret: Option<Secret>,
    /// or the file that it is in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub secret_file: Option<PathBuf>,
    /// Of what it is told; of everything if there is nothing.
    #[serde(default)]
    pub events: Vec<Kind>,
    /// Of which streams it is told; of all if there are none.
    #[serde(default)]
    pub streams: Vec<StreamPattern>,
}

/// An `http` or `https` address, which never prints itself.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Address(Url);

/// What was given is none; it is not repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a webhook's url begins with https:// or http:// and a host")]
pub struct InvalidAddress;

/// What a figure may be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bound {
    /// Which figure.
    pub figure: Figure,
    /// The least it may be,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// or the most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// Of which streams; of all if there are none.
    #[serde(default)]
    pub streams: Vec<StreamPattern>,
}

/// A consistency figure: see [`Figures`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are those of the fields of Figures")]
pub enum Figure {
    SurfaceDistancePrevious,
    SurfaceDistanceCurrent,
    RegistrationResidual,
    VertexPersistence,
    Flicker,
}

/// One side of what a figure may be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Limit {
    /// The least it may be.
    Min(f64),
    /// The most.
    Max(f64),
}

/// Why the options cannot be used. Neither addresses nor secrets are repeated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnusableOptions {
    /// A number that makes no sense.
    #[error("webhooks.{name} is 0: it must be at least 1")]
    Zero {
        /// The setting.
        name: &'static str,
    },
    /// A name that could not be a label.
    #[error("webhooks.endpoints: the name {name:?} must have 1 to 64 of a-z, 0-9 and -")]
    Name {
        /// What was given.
        name: String,
    },
    /// Two endpoints of one name.
    #[error("webhooks.endpoints: there are two of the name {name}")]
    SameName {
        /// The name.
        name: String,
    },
    /// No secret, or two.
    #[error("webhooks.endpoints: {name} needs either secret or secret_file")]
    Secret {
        /// Whose.
        name: String,
    },
    /// The secret's file cannot be read.
    #[error("webhooks.endpoints: the secret_file of {name}, {path}: {reason}")]
    SecretFile {
        /// Whose.
        name: String,
        /// The file.
        path: String,
        /// What the system says.
        reason: std::io::Error,
    },
    /// What is in the file is none.
    #[error("webhooks.endpoints: the secret_file of {name}: {reason}")]
    SecretText {
        /// Whose.
        name: String,
        /// What is wrong.
        reason: InvalidSecret,
    },
    /// A bound that is none.
    #[error("webhooks.bounds: {figure:?} needs either min or max, a number from 0 on")]
    Bound {
        /// Of which figure.
        figure: Figure,
    },
    /// The client could not be made.
    #[error("webhooks: no HTTP client can be made: {0}")]
    Client(reqwest::Error),
}

impl Default for Options {
    fn default() -> Self {
        Self {
            stall_secs: 5,
            exceeded_after_frames: 15,
            restored_after_frames: 60,
            timeout_secs: 5,
            attempts: 6,
            retry_ms: 1000,
            queue: 256,
            shutdown_secs: 3,
            endpoints: Vec::new(),
            bounds: Vec::new(),
        }
    }
}

impl Options {
    /// Checks everything but files.
    ///
    /// # Errors
    ///
    /// [`UnusableOptions`] names the setting.
    pub fn check(&self) -> Result<(), UnusableOptions> {
        let at_least_one = [
            ("stall_secs", self.stall_secs),
            ("exceeded_after_frames", self.exceeded_after_frames.into()),
            ("restored_after_frames", self.restored_after_frames.into()),
            ("timeout_secs", self.timeout_secs),
            ("attempts", self.attempts.into()),
            ("retry_ms", self.retry_ms),
            ("queue", self.queue as u64),
        ];
        if let Some((name, _)) = at_least_one.into_iter().find(|(_, value)| *value == 0) {
            return Err(UnusableOptions::Zero { name });
        }
        for (index, endpoint) in self.endpoints.iter().enumerate() {
            endpoint.check()?;
            let name = &endpoint.name;
            if self.endpoints[..index].iter().any(|e| e.name == *name) {
                return Err(UnusableOptions::SameName { name: name.clone() });
            }
        }
        self.bounds
            .iter()
            .try_for_each(|bound| bound.limit().map(drop))
    }
}

impl EndpointOptions {
    fn check(&self) -> Result<(), UnusableOptions> {
        let name = self.name.clone();
        if StreamName::parse(&name).is_err() {
            return Err(UnusableOptions::Name { name });
        }
        if self.secret.is_some() == self.secret_file.is_some() {
            return Err(UnusableOptions::Secret { name });
        }
        Ok(())
    }

    /// The secret, from its file if need be.
    ///
    /// # Errors
    ///
    /// [`UnusableOptions`].
    pub(super) fn load_secret(&self) -> Result<Secret, UnusableOptions> {
        let name = || self.name.clone();
        match (&self.secret, &self.secret_file) {
            (Some(secret), _) => Ok(secret.clone()),
            (None, None) => Err(UnusableOptions::Secret { name: name() }),
            (None, Some(path)) => {
                let text = std::fs::read_to_string(path).map_err(|reason| {
                    UnusableOptions::SecretFile {
                        name: name(),
                        path: path.display().to_string(),
                        reason,
                    }
                })?;
                Secret::parse(&text).map_err(|reason| UnusableOptions::SecretText {
                    name: name(),
                    reason,
                })
            }
        }
    }

    /// Whether it is told of this.
    pub(super) fn wants(&self, kind: Kind, stream: &StreamName) -> bool {
        (self.events.is_empty() || self.events.contains(&kind)) && is_among(&self.streams, stream)
    }
}

impl Address {
    /// The address itself, for the client.
    pub(super) fn url(&self) -> &Url {
        &self.0
    }
}

impl std::fmt::Debug for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Address(…)")
    }
}

impl TryFrom<String> for Address {
    type Error = InvalidAddress;

    fn try_from(text: String) -> Result<Self, InvalidAddress> {
        let url = Url::parse(&text).map_err(|_| InvalidAddress)?;
        let is_web = matches!(url.scheme(), "http" | "https");
        is_web.then_some(Self(url)).ok_or(InvalidAddress)
    }
}

impl From<Address> for String {
    fn from(_: Address) -> Self {
        "…".to_owned()
    }
}

impl Bound {
    /// The side that is given.
    ///
    /// # Errors
    ///
    /// [`UnusableOptions::Bound`] if neither or both are, or it is not a number.
    pub(super) fn limit(&self) -> Result<Limit, UnusableOptions> {
        let limit = match (self.min, self.max) {
            (Some(min), None) => Limit::Min(min),
            (None, Some(max)) => Limit::Max(max),
            _ => {
                return Err(UnusableOptions::Bound {
                    figure: self.figure,
                });
            }
        };
        let (Limit::Min(value) | Limit::Max(value)) = limit;
        if value.is_finite() && 0.0 <= value {
            Ok(limit)
        } else {
            Err(UnusableOptions::Bound {
                figure: self.figure,
            })
        }
    }

    /// Whether it is about this stream.
    pub(super) fn is_about(&self, stream: &StreamName) -> bool {
        is_among(&self.streams, stream)
    }
}

impl Limit {
    pub(super) fn is_exceeded_by(self, value: f64) -> bool {
        match self {
            Self::Min(min) => value < min,
            Self::Max(max) => max < value,
        }
    }
}

impl Figure {
    pub(super) fn of(self, figures: &Figures) -> Option<f64> {
        match self {
            Self::SurfaceDistancePrevious => figures.surface_distance_previous,
            Self::SurfaceDistanceCurrent => figures.surface_distance_current,
            Self::RegistrationResidual => figures.registration_residual,
            Self::VertexPersistence => figures.vertex_persistence,
            Self::Flicker => figures.flicker,
        }
    }
}

fn is_among(patterns: &[StreamPattern], stream: &StreamName) -> bool {
    patterns.is_empty() || patterns.iter().any(|pattern| pattern.matches(stream))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(endpoints: &str) -> Result<(), String> {
        let options: Options = serde_json::from_str(endpoints).map_err(|e| e.to_string())?;
        options.check().map_err(|error| error.to_string())
    }

    #[test]
    fn what_cannot_be_used_is_named_and_neither_address_nor_secret_is_repeated() {
        let secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";
        for (name, rest, words) in [
            ("Ops", r#""url": "https://a.example/k3y""#, "a-z, 0-9"),
            ("ops", r#""url": "ftp://a.example/k3y""#, "https://"),
            (
                "ops",
                r#""url": "https://a.example/k3y", "secret_file": "f""#,
                "either secret",
            ),
            (
                "ops",
                r#""url": "https://a.example/k3y", "events": ["stream.begun"]"#,
                "begun",
            ),
        ] {
            let text =
                format!(r#"{{"endpoints": [{{"name": "{name}", "secret": "{secret}", {rest}}}]}}"#);
            let error = check(&text).unwrap_err();
            assert!(error.contains(words), "{error}");
            assert!(!error.contains("k3y") && !error.contains("MfKQ"), "{error}");
        }
        let error = check(r#"{"bounds": [{"figure": "flicker"}]}"#).unwrap_err();
        assert!(error.contains("either min or max"), "{error}");
    }
}
