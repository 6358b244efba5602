//! The configuration: a TOML file, then the environment, then each module's own options.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;
use std::time::Duration;

use figment::Figment;
use figment::providers::{Env, Format, Serialized, Toml};
use serde::{Deserialize, Serialize};
use steadymesh_mesh_io::Limits;
use steadymesh_proto::stream::StreamConfig;

use crate::telemetry::log;
use crate::{compute, server, streams};

/// The prefix of environment variables; `__` stands between levels.
const PREFIX: &str = "STEADYMESH_";

/// Everything that can be set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Where the API and the player listen.
    pub listen: SocketAddr,
    /// Where operations listen: `/metrics`, `/livez`, `/readyz`.
    pub internal_listen: SocketAddr,
    /// Whether `listen` may be an address that others reach although there are no tokens.
    pub allow_public_without_tokens: bool,
    /// How long accepted frames may take to come out once the server is asked to stop, in
    /// seconds.
    pub shutdown_grace_secs: u64,
    /// The log.
    pub log: log::Options,
    /// The threads that compute.
    pub compute: Compute,
    /// How large and how slow a request may be.
    pub limits: RequestLimits,
    /// How streams are kept.
    pub streams: Streams,
}

/// The threads that compute.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Compute {
    /// Threads; 0 for one per core.
    pub threads: usize,
    /// Jobs of either kind, short and long, that may wait for a thread.
    pub queue: usize,
}

/// How large and how slow a request may be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RequestLimits {
    /// Bytes of a frame's body.
    pub body_bytes: usize,
    /// Vertices of a frame.
    pub vertices: usize,
    /// Faces of a frame, polygons cut into triangles.
    pub faces: usize,
    /// Bytes that decoding a frame's Draco data may take.
    pub decode_memory_bytes: usize,
    /// Seconds until a request's head must be complete.
    pub header_timeout_secs: u64,
    /// Seconds until a request's body must be complete.
    pub body_timeout_secs: u64,
    /// Seconds that a player may take to receive one message before it is disconnected.
    pub send_timeout_secs: u64,
}

/// How streams are kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Streams {
    /// Most streams at a time.
    pub max: usize,
    /// Frames of a stream that may wait to be processed.
    pub queue_depth: usize,
    /// Frames that a stream remembers.
    pub history: usize,
    /// How many frames a player may fall behind before it is taken to the newest.
    pub subscriber_queue: usize,
    /// Seconds for which the place of a publisher that vanished is kept.
    pub linger_secs: u64,
    /// Seconds after which a stream without frames ends.
    pub idle_timeout_secs: u64,
    /// What a stream's configuration leaves out.
    pub defaults: StreamConfig,
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
    Setting(Box<figment::Error>),
    /// Everybody could publish and delete.
    #[error(
        "{0} can be reached from other machines, and there are no tokens: anybody could publish \
         and delete streams. Listen on 127.0.0.1, or set allow_public_without_tokens = true if \
         this is meant"
    )]
    PublicWithoutTokens(SocketAddr),
    /// A number that makes no sense.
    #[error("{name} is 0: it must be at least 1")]
    Zero {
        /// The setting.
        name: &'static str,
    },
}

impl Default for Config {
    fn default() -> Self {
        Self {
            listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8080),
            internal_listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 9090),
            allow_public_without_tokens: false,
            shutdown_grace_secs: 10,
            log: log::Options::default(),
            compute: Compute::default(),
            limits: RequestLimits::default(),
            streams: Streams::default(),
        }
    }
}

impl Default for Compute {
    fn default() -> Self {
        Self {
            threads: 0,
            queue: 64,
        }
    }
}

impl Default for RequestLimits {
    /// A million vertices, far above any rig of today, and what their files take.
    fn default() -> Self {
        Self {
            body_bytes: 64 << 20,
            vertices: 1_000_000,
            faces: 2_000_000,
            decode_memory_bytes: 256 << 20,
            header_timeout_secs: 10,
            body_timeout_secs: 30,
            send_timeout_secs: 10,
        }
    }
}

impl Default for Streams {
    /// Ten seconds of frames at 30 per second are remembered.
    fn default() -> Self {
        Self {
            max: 64,
            queue_depth: 4,
            history: 300,
            subscriber_queue: 8,
            linger_secs: 5,
            idle_timeout_secs: 3600,
            defaults: StreamConfig::default(),
        }
    }
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
            .map_err(|error| ConfigError::Setting(Box::new(error)))
    }

    /// Checks what cannot be checked setting by setting.
    ///
    /// # Errors
    ///
    /// [`ConfigError`].
    pub fn check(&self) -> Result<(), ConfigError> {
        if !self.listen.ip().is_loopback() && !self.allow_public_without_tokens {
            return Err(ConfigError::PublicWithoutTokens(self.listen));
        }
        let at_least_one = [
            ("limits.body_bytes", self.limits.body_bytes),
            ("limits.vertices", self.limits.vertices),
            ("limits.faces", self.limits.faces),
            (
                "limits.decode_memory_bytes",
                self.limits.decode_memory_bytes,
            ),
            ("streams.max", self.streams.max),
            ("streams.queue_depth", self.streams.queue_depth),
            ("streams.history", self.streams.history),
            ("streams.subscriber_queue", self.streams.subscriber_queue),
        ];
        match at_least_one.into_iter().find(|(_, value)| *value == 0) {
            Some((name, _)) => Err(ConfigError::Zero { name }),
            None => Ok(()),
        }
    }

    /// For the pool.
    #[must_use]
    pub fn compute(&self) -> compute::Options {
        let cores = std::thread::available_parallelism().map_or(1, Into::into);
        let asked = self.compute.threads;
        compute::Options {
            threads: if asked == 0 { cores } else { asked },
            queue: self.compute.queue,
        }
    }

    /// For the streams.
    #[must_use]
    pub fn streams(&self) -> streams::Options {
        streams::Options {
            max_streams: self.streams.max,
            queue_depth: self.streams.queue_depth,
            history: self.streams.history,
            subscriber_queue: self.streams.subscriber_queue,
            linger: Duration::from_secs(self.streams.linger_secs),
            idle_timeout: Duration::from_secs(self.streams.idle_timeout_secs),
            limits: Limits {
                max_vertices: self.limits.vertices,
                max_faces: self.limits.faces,
                max_memory_bytes: self.limits.decode_memory_bytes,
            },
            defaults: self.streams.defaults.clone(),
        }
    }

    /// For the server.
    #[must_use]
    pub fn server(&self) -> server::Options {
        server::Options {
            listen: self.listen,
            internal_listen: self.internal_listen,
            shutdown_grace: Duration::from_secs(self.shutdown_grace_secs),
            max_body_bytes: self.limits.body_bytes,
            header_timeout: Duration::from_secs(self.limits.header_timeout_secs),
            body_timeout: Duration::from_secs(self.limits.body_timeout_secs),
            send_timeout: Duration::from_secs(self.limits.send_timeout_secs),
        }
    }
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

    fn from_toml(text: &str) -> Result<Config, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steadymesh.toml");
        std::fs::write(&path, text).unwrap();
        Config::load(Some(&path)).map_err(|error| error.to_string())
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
        let page = include_str!("../docs/configuration.md");
        let toml = page.split("```toml\n").nth(1).unwrap();
        let mut config = from_toml(toml.split("```").next().unwrap()).unwrap();
        let documented = std::mem::take(&mut config.streams.defaults);
        assert_eq!(config, Config::default());
        let nothing = StreamConfig::default();
        let limit = config.limits.faces;
        let own = streams::Configured::new(&nothing, &nothing, limit).unwrap();
        assert_eq!(documented, own.config);
        for name in setting_names() {
            assert!(toml.contains(&name), "{name} is not documented");
        }
    }

    #[test]
    fn a_setting_that_does_not_exist_is_named() {
        let error = from_toml("[limits]\nbody_bites = 3").unwrap_err();
        assert!(error.contains("body_bites"), "{error}");
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
