//! Reads the file and the environment, and says what is wrong with them.

use std::net::SocketAddr;
use std::path::Path;

use figment::Figment;
use figment::error::Kind;
use figment::providers::{Env, Format, Serialized, Toml};

use super::Config;

/// The prefix of environment variables; `__` stands between levels.
const PREFIX: &str = "STEADYMESH_";

/// The page on which every setting is documented.
const PAGE: &str = include_str!("../../docs/configuration.md");

/// All settings with their defaults, as a file with comments.
#[must_use]
pub fn default_file() -> &'static str {
    let block = PAGE.split("```toml\n").nth(1);
    block
        .and_then(|rest| rest.split("```").next())
        .unwrap_or_default()
}

/// Why the configuration cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// A file is named that cannot be read.
    #[error("the configuration file {path} cannot be read: {reason}")]
    File {
        /// The file.
        path: String,
        /// What the system says.
        reason: std::io::Error,
    },
    /// A setting has another form, or is none.
    #[error("{0}")]
    Setting(String),
    /// Everybody could publish and delete.
    #[error(
        "{0} can be reached from other machines, and there are no tokens: anybody could publish \
         and delete streams. Listen on 127.0.0.1, or set allow_public_without_tokens = true if \
         this is meant"
    )]
    PublicWithoutTokens(SocketAddr),
    /// The same port twice.
    #[error("listen and internal_listen are both {0}")]
    SameAddress(SocketAddr),
    /// A number that makes no sense.
    #[error("{name} is 0: it must be at least 1")]
    Zero {
        /// The setting.
        name: &'static str,
    },
}

impl Config {
    /// Reads the file, if one is named, and then the environment.
    ///
    /// Environment variables whose first level is no setting are left alone: Kubernetes makes
    /// some of its own, such as `STEADYMESH_SERVICE_HOST`.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] names the file and the setting.
    pub fn load(file: Option<&Path>) -> Result<Self, ConfigError> {
        let mut figment = Figment::from(Serialized::defaults(Self::default()));
        if let Some(path) = file {
            let text = std::fs::read_to_string(path).map_err(|reason| ConfigError::File {
                path: path.display().to_string(),
                reason,
            })?;
            figment = figment.merge(Toml::string(&text));
        }
        let names: Vec<String> = setting_names();
        let environment = Env::prefixed(PREFIX)
            .filter(move |key| {
                let first = key.as_str().split("__").next().unwrap_or_default();
                names.iter().any(|name| first.eq_ignore_ascii_case(name))
            })
            .split("__");
        figment
            .merge(environment)
            .extract()
            .map_err(|errors| ConfigError::Setting(explain(errors)))
    }

    /// Reads the text of a file, without the environment.
    ///
    /// # Errors
    ///
    /// [`ConfigError::Setting`].
    pub fn parse(text: &str) -> Result<Self, ConfigError> {
        Figment::from(Serialized::defaults(Self::default()))
            .merge(Toml::string(text))
            .extract()
            .map_err(|errors| ConfigError::Setting(explain(errors)))
    }

    /// Checks what cannot be checked setting by setting.
    ///
    /// # Errors
    ///
    /// [`ConfigError`].
    pub fn check(&self) -> Result<(), ConfigError> {
        let is_open = self.auth.is_open() && !self.allow_public_without_tokens;
        if is_open && !self.listen.ip().is_loopback() {
            return Err(ConfigError::PublicWithoutTokens(self.listen));
        }
        if self.listen == self.internal_listen && self.listen.port() != 0 {
            return Err(ConfigError::SameAddress(self.listen));
        }
        let at_least_one = [
            ("limits.body_bytes", self.limits.body_bytes),
            ("limits.memory_bytes", self.limits.memory_bytes),
            ("limits.connections", self.limits.connections),
            (
                "limits.connections_per_address",
                self.limits.connections_per_address,
            ),
            (
                "limits.subscribers_per_stream",
                self.limits.subscribers_per_stream,
            ),
            ("limits.vertices", self.limits.vertices),
            ("limits.faces", self.limits.faces),
            (
                "limits.decode_memory_bytes",
                self.limits.decode_memory_bytes,
            ),
            ("streams.max", self.streams.max),
            ("streams.queue_depth", self.streams.queue_depth),
            ("streams.parallel_frames", self.streams.parallel_frames),
            ("streams.history", self.streams.history),
            ("streams.history_bytes", self.streams.history_bytes),
            ("streams.subscriber_queue", self.streams.subscriber_queue),
        ];
        match at_least_one.into_iter().find(|(_, value)| *value == 0) {
            Some((name, _)) => Err(ConfigError::Zero { name }),
            None => Ok(()),
        }
    }
}

/// What is wrong, where, and what may have been meant.
fn explain(errors: figment::Error) -> String {
    let messages = errors.into_iter().map(|error| {
        let place = error.path.join(".");
        let source = error
            .metadata
            .as_ref()
            .map_or("", |metadata| &metadata.name);
        let place = match (source.is_empty(), place.is_empty()) {
            (_, true) => String::new(),
            (true, false) => format!("{place}: "),
            (false, false) => format!("{place} ({source}): "),
        };
        match &error.kind {
            Kind::UnknownField(name, known) => {
                let nearest = nearest(name, known);
                format!("{place}there is no setting {name}{nearest}")
            }
            kind => format!("{place}{kind}"),
        }
    });
    messages.collect::<Vec<_>>().join("; ")
}

/// The known name that is closest to one that is not.
fn nearest(name: &str, known: &[&str]) -> String {
    let similarity = |known: &str| strsim::jaro_winkler(name, known);
    let best = known
        .iter()
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)));
    best.map_or_else(String::new, |best| format!(": did you mean {best}?"))
}

/// The names of the settings of the first level.
fn setting_names() -> Vec<String> {
    match serde_json::to_value(Config::default()) {
        Ok(serde_json::Value::Object(settings)) => {
            settings.into_iter().map(|(key, _)| key).collect()
        }
        // The defaults are plain values, which always serialize to an object.
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{RequestLimits, Streams};
    use crate::streams::Configured;
    use steadymesh_proto::stream::StreamConfig;

    fn from_toml(text: &str) -> Result<Config, String> {
        Config::parse(text).map_err(|error| error.to_string())
    }

    #[test]
    fn what_a_file_leaves_out_has_its_default() {
        let config = from_toml("[streams]\nhistory = 30\ndefaults.tracking = 'off'").unwrap();
        assert_eq!(config.streams.history, 30);
        assert_eq!(config.streams.queue_depth, Streams::default().queue_depth);
        assert_eq!(config.limits, RequestLimits::default());
        assert!(config.streams.defaults.tracking.is_some());
    }

    #[test]
    fn the_documented_settings_are_all_there_are_with_their_defaults() {
        let toml = default_file();
        let mut config = from_toml(toml).unwrap();
        let documented = std::mem::take(&mut config.streams.defaults);
        assert_eq!(config, Config::default());
        let nothing = StreamConfig::default();
        let limit = config.limits.faces;
        let own = Configured::new(&[&nothing], limit).unwrap();
        assert_eq!(documented, own.config);
        for name in setting_names() {
            assert!(toml.contains(&name), "{name} is not documented");
        }
    }

    #[test]
    fn a_setting_that_does_not_exist_is_named() {
        let error = from_toml("[limits]\nbody_bites = 3").unwrap_err();
        assert!(error.contains("limits"), "{error}");
        assert!(
            error.contains("there is no setting body_bites: did you mean body_bytes?"),
            "{error}"
        );
    }

    #[test]
    fn a_public_address_without_tokens_must_be_meant() {
        let mut config = Config {
            listen: "0.0.0.0:8080".parse().unwrap(),
            ..Config::default()
        };
        let error = config.check().unwrap_err().to_string();
        assert!(error.contains("allow_public_without_tokens"), "{error}");
        config.allow_public_without_tokens = true;
        config.check().unwrap();
    }
}
