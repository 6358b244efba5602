//! The log, on standard error.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::io::IsTerminal;

use opentelemetry_sdk::trace::SdkTracer;
use serde::{Deserialize, Serialize};
use tracing_subscriber::filter::{FilterExt, LevelFilter, filter_fn};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};

use super::traces;

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

impl Options {
    /// Which events are written.
    ///
    /// # Errors
    ///
    /// [`NotSetUp::Level`].
    pub fn filter(&self) -> Result<EnvFilter, NotSetUp> {
        EnvFilter::try_new(&self.level).map_err(|_| NotSetUp::Level {
            level: self.level.clone(),
        })
    }
}

/// Why the log could not be set up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NotSetUp {
    /// The level is not one.
    #[error(
        "log.level \"{level}\" is neither a level (error, warn, info, debug, trace) nor a list of directives"
    )]
    Level {
        /// What was given.
        level: String,
    },
    /// There is a log already.
    #[error("the log has been set up before")]
    Twice,
}

/// Sets up the log of this process, panics included, and hands spans to `tracer` if there is
/// one.
///
/// # Errors
///
/// [`NotSetUp`].
pub fn set_up(options: &Options, tracer: Option<SdkTracer>) -> Result<(), NotSetUp> {
    let is_for_log = filter_fn(|metadata| !traces::is_trace(metadata));
    // Without this hint every event in the process would be looked at.
    let is_for_log = is_for_log.with_max_level_hint(LevelFilter::TRACE);
    let filter = options.filter()?.and(is_for_log);
    let lines = tracing_subscriber::fmt::layer()
        .with_ansi(std::io::stderr().is_terminal())
        // A line that cannot be written, on a full disk say, is lost. Saying so on the same full
        // disk would panic.
        .log_internal_errors(false)
        .with_writer(std::io::stderr);
    let lines = match options.format {
        Format::Text => lines.boxed(),
        // The spans' list has the current one too.
        Format::Json => lines
            .json()
            .flatten_event(true)
            .with_current_span(false)
            .boxed(),
    };
    let mut layers = vec![lines.with_filter(filter).boxed()];
    layers.extend(tracer.map(|tracer| traces::layer(tracer).boxed()));
    let outcome = tracing_subscriber::registry().with(layers).try_init();
    outcome.map_err(|_| NotSetUp::Twice)?;
    std::panic::set_hook(Box::new(|info| {
        let payload = info.payload();
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let panic = text.or(payload.downcast_ref::<&str>().copied());
        let location = info.location().map(ToString::to_string);
        // Taken only if RUST_BACKTRACE asks for it.
        let backtrace = Backtrace::capture();
        let is_there = backtrace.status() == BacktraceStatus::Captured;
        let backtrace = is_there.then(|| backtrace.to_string());
        tracing::error!(location, panic, backtrace, "a panic, which is a defect");
    }));
    Ok(())
}
