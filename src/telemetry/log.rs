//! The log, on standard error.

use std::io::IsTerminal;

use serde::{Deserialize, Serialize};
use tracing_subscriber::EnvFilter;

/// How the log is written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Which events: `error`, `warn`, `info`, `debug`, `trace`, or directives such as
    /// `info,steadymesh::streams=debug`.
    pub level: String,
    /// In which form.
    pub format: Format,
}

/// The form of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// A line for people.
    #[default]
    Text,
    /// A line of JSON for machines.
    Json,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            level: "info".to_owned(),
            format: Format::Text,
        }
    }
}

/// Why the log could not be set up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NotSetUp {
    /// The level is not one.
    #[error(
        "log.level {level:?} is neither a level (error, warn, info, debug, trace) nor a list of directives"
    )]
    Level {
        /// What was given.
        level: String,
    },
    /// There is a log already.
    #[error("the log has been set up before")]
    Twice,
}

/// Sets up the log of this process.
///
/// # Errors
///
/// [`NotSetUp`].
pub fn set_up(options: &Options) -> Result<(), NotSetUp> {
    let level = &options.level;
    let filter = EnvFilter::try_new(level).map_err(|_| NotSetUp::Level {
        level: level.clone(),
    })?;
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        // A line that cannot be written, on a full disk say, is lost. Saying so on the same full
        // disk would panic.
        .log_internal_errors(false)
        .with_writer(std::io::stderr);
    let outcome = match options.format {
        Format::Text => subscriber.try_init(),
        Format::Json => subscriber.json().flatten_event(true).try_init(),
    };
    outcome.map_err(|_| NotSetUp::Twice)
}
