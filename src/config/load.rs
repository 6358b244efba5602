//! Reads the file and the environment, and says what is wrong with them.

use std::net::SocketAddr;
use std::path::Path;

use figment::Figment;
use figment::error::{Actual, Kind};
use figment::providers::{Env, Format, Serialized, Toml};

use super::{Config, Role};
use crate::webhooks::UnusableOptions;

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
    /// Webhooks could not be told as asked for.
    #[error(transparent)]
    Webhooks(#[from] UnusableOptions),
    /// A part of several nodes, and no way to the others.
    #[error("role is {0}: that takes bus.nats_url, which names the NATS servers between nodes")]
    RoleWithoutBus(&'static str),
    /// Not a subject.
    #[error(
        "bus.prefix is \"{0}\": it has letters, digits, - and _, and dots between them, 64 at the most"
    )]
    BusPrefix(String),
    /// Out of range.
    #[error("bus.ack_wait_secs is {0}: it must be from 0.5 to 600")]
    AckWait(f64),
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
        let place = file.map_or_else(|| "the file".to_owned(), |path| path.display().to_string());
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
            .map_err(|errors| ConfigError::Setting(explain(errors, &place)))
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
            .map_err(|errors| ConfigError::Setting(explain(errors, "the file")))
    }

    /// Checks what cannot be checked setting by setting.
    ///
    /// # Errors
    ///
    /// [`ConfigError`].
    pub fn check(&self) -> Result<(), ConfigError> {
        let is_open = self.auth.is_open() && !self.allow_public_without_tokens;
        if is_open && self.role != Role::Worker && !self.listen.ip().is_loopback() {
            return Err(ConfigError::PublicWithoutTokens(self.listen));
        }
        if self.listen == self.internal_listen && self.listen.port() != 0 {
            return Err(ConfigError::SameAddress(self.listen));
        }
        self.check_bus()?;
        self.webhooks.check()?;
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
            ("limits.playbacks", self.limits.playbacks),
            ("streams.max", self.streams.max),
            ("streams.queue_depth", self.streams.queue_depth),
            ("streams.parallel_frames", self.streams.parallel_frames),
            ("streams.history", self.streams.history),
            ("streams.history_bytes", self.streams.history_bytes),
            ("streams.subscriber_queue", self.streams.subscriber_queue),
            ("bus.frames", self.bus.frames),
            ("bus.replicas", self.bus.replicas),
            ("bus.max_age_secs", usize::from(self.bus.max_age_secs != 0)),
            ("recordings.queue_bytes", self.recordings.queue_bytes),
            (
                "recordings.sweep_interval_secs",
                usize::from(self.recordings.sweep_interval_secs != 0),
            ),
        ];
        match at_least_one.into_iter().find(|(_, value)| *value == 0) {
            Some((name, _)) => Err(ConfigError::Zero { name }),
            None => Ok(()),
        }
    }
}

impl Config {
    fn check_bus(&self) -> Result<(), ConfigError> {
        let role = match self.role {
            Role::All => None,
            Role::Gateway => Some("gateway"),
            Role::Worker => Some("worker"),
        };
        if let Some(role) = role.filter(|_| self.bus.nats_url.is_none()) {
            return Err(ConfigError::RoleWithoutBus(role));
        }
        let prefix = &self.bus.prefix;
        let is_word = |word: &str| {
            let allowed = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_');
            !word.is_empty() && word.bytes().all(allowed)
        };
        if 64 < prefix.len() || !prefix.split('.').all(is_word) {
            return Err(ConfigError::BusPrefix(prefix.clone()));
        }
        // A NaN is in no range.
        if !(0.5..=600.0).contains(&self.bus.ack_wait_secs) {
            return Err(ConfigError::AckWait(self.bus.ack_wait_secs));
        }
        Ok(())
    }

    /// The settings that differ in `new` and are read at the start only: a server that runs
    /// with `self` must be started anew for them.
    #[must_use]
    pub fn only_after_restart(&self, new: &Self) -> Vec<&'static str> {
        let differ = [
            ("listen", self.listen != new.listen),
            (
                "internal_listen",
                self.internal_listen != new.internal_listen,
            ),
            // The files of a certificate are read again; whether there is one is not.
            ("tls", self.tls.is_some() != new.tls.is_some()),
            ("log.level", self.log.level != new.log.level),
            ("log.format", self.log.format != new.log.format),
            (
                "compute.threads",
                self.compute.threads != new.compute.threads,
            ),
            ("compute.queue", self.compute.queue != new.compute.queue),
            ("role", self.role != new.role),
            ("bus", self.bus != new.bus),
            ("recordings", self.recordings != new.recordings),
            (
                "limits.playbacks",
                self.limits.playbacks != new.limits.playbacks,
            ),
            (
                "limits.memory_bytes",
                self.limits.memory_bytes != new.limits.memory_bytes,
            ),
            (
                "limits.header_timeout_secs",
                self.limits.header_timeout_secs != new.limits.header_timeout_secs,
            ),
        ];
        let differ = differ.into_iter().filter(|(_, differs)| *differs);
        differ.map(|(name, _)| name).collect()
    }
}

/// What is wrong, where, and what may have been meant; `file` is what the file is called.
fn explain(errors: figment::Error, file: &str) -> String {
    let messages = errors.into_iter().map(|error| {
        let source = error.metadata.as_ref().map(|metadata| &*metadata.name);
        let is_environment = source.is_some_and(|name| name.contains("environment"));
        let place = match (error.path.is_empty(), is_environment) {
            (true, _) => format!("{file}: "),
            (false, true) => {
                let name = error.path.join("__").to_uppercase();
                format!("{PREFIX}{name} in the environment: ")
            }
            (false, false) => format!("{} in {file}: ", error.path.join(".")),
        };
        match &error.kind {
            Kind::UnknownField(name, known) => {
                let nearest = nearest(name, known);
                format!("{place}there is no setting {name}{nearest}")
            }
            Kind::InvalidType(found, expected) | Kind::InvalidValue(found, expected) => {
                format!(
                    "{place}{} is expected, not {}",
                    wanted(expected),
                    given(found)
                )
            }
            Kind::UnknownVariant(found, known) => {
                format!("{place}\"{found}\" is none of {}", known.join(", "))
            }
            Kind::MissingField(name) => format!("{place}the setting {name} is missing"),
            kind => format!("{place}{kind}"),
        }
    });
    without_secrets(messages.collect::<Vec<_>>().join("; "))
}

/// A file that is no TOML is quoted where it goes wrong, and that may be where a secret is.
fn without_secrets(message: String) -> String {
    const MARK: &str = "whsec_";
    let Some((first, rest)) = message.split_once(MARK) else {
        return message;
    };
    let mut clean = first.to_owned();
    for part in rest.split(MARK) {
        let is_secret = |c: char| c.is_ascii_alphanumeric() || "+/=-_".contains(c);
        clean = clean + MARK + "…" + part.trim_start_matches(is_secret);
    }
    clean
}

/// A type in the words of people who write no Rust.
fn wanted(expected: &str) -> &str {
    match expected {
        "usize" | "u64" | "u32" | "u16" | "u8" => "a whole number of at least 0",
        "i64" | "i32" => "a whole number",
        "f64" | "f32" => "a number",
        "a boolean" | "bool" => "true or false",
        "a sequence" => "a list",
        other => other,
    }
}

fn given(found: &Actual) -> String {
    match found {
        Actual::Bool(value) => value.to_string(),
        Actual::Unsigned(value) => value.to_string(),
        Actual::Signed(value) => value.to_string(),
        Actual::Float(value) => value.to_string(),
        Actual::Str(text) => format!("\"{text}\""),
        Actual::Seq => "a list".to_owned(),
        Actual::Map => "a table".to_owned(),
        other => other.to_string(),
    }
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
    fn a_value_of_the_wrong_kind_is_told_apart_from_what_is_expected() {
        for (text, expected) in [
            (
                "[streams]\nhistory = -3",
                "streams.history in the file: a whole number of at least 0 is expected, not -3",
            ),
            (
                "[limits]\nfaces = 'many'",
                "limits.faces in the file: a whole number of at least 0 is expected, not \"many\"",
            ),
            (
                "streams.defaults.tracking = 'fast'",
                "streams.defaults.tracking in the file: \"fast\" is none of off, paper, robust",
            ),
            (
                "allow_public_without_tokens = 1",
                "allow_public_without_tokens in the file: true or false is expected, not 1",
            ),
        ] {
            assert_eq!(from_toml(text).unwrap_err(), expected);
        }
        let error = from_toml("[streams").unwrap_err();
        assert!(
            error.starts_with("the file: TOML parse error at line 1"),
            "{error}"
        );
    }

    #[test]
    fn what_a_running_server_cannot_take_is_named() {
        let running = Config::default();
        let new = from_toml(
            "listen = '127.0.0.1:8081'\n[compute]\nthreads = 3\n[log]\nlevel = 'debug'\n\
             [limits]\nmemory_bytes = 1\nconnections = 3\n[streams]\nhistory = 3",
        );
        assert_eq!(
            running.only_after_restart(&new.unwrap()),
            [
                "listen",
                "log.level",
                "compute.threads",
                "limits.memory_bytes"
            ]
        );
        assert!(running.only_after_restart(&running).is_empty());
    }

    #[test]
    fn a_secret_is_not_repeated_when_the_line_that_it_is_in_is_wrong() {
        let secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";
        for text in [
            format!("[[webhooks.endpoints]]\nname = 'ops' secret = '{secret}'"),
            format!("[[webhooks.endpoints]]\nname = 'ops'\nurl = ''\nsecrets = '{secret}'"),
            format!("[[webhooks.endpoints]]\nname = 'ops'\nurl = ''\nsecret = '{secret}A'"),
        ] {
            let error = from_toml(&text).unwrap_err();
            assert!(!error.contains("MfKQ"), "{error}");
        }
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
