//! The logs on the servers: made if they are not there, and brought to a node's options.

use std::time::Duration;

use async_nats::jetstream::Context;
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::stream::{Config, DiscardPolicy, Stream};

use super::{BusError, Options, TIMEOUT, unavailable};

/// Within it a message that is sent twice is stored once.
const DUPLICATE_WINDOW: Duration = Duration::from_secs(120);
/// How long the servers are waited for at the start.
const START: Duration = Duration::from_secs(60);

/// The logs, and the consumer that gives frames out.
pub(super) struct Logs {
    pub frames: Stream,
    pub outcomes: Stream,
    pub records: Stream,
    pub workers: PullConsumer,
}

impl Logs {
    /// The same, waiting for servers that are not there yet.
    pub async fn wait_for(context: &Context, options: &Options) -> Result<Self, BusError> {
        let began = tokio::time::Instant::now();
        loop {
            let error = match Self::ensure(context, options).await {
                Ok(logs) => return Ok(logs),
                Err(error) => error,
            };
            if START < began.elapsed() {
                return Err(unavailable(format!("{}: {error}", options.url)));
            }
            tracing::warn!(url = options.url, %error, "waiting for the bus");
            tokio::time::sleep(TIMEOUT).await;
        }
    }

    /// Makes what is not there, and brings it to these options.
    pub async fn ensure(context: &Context, options: &Options) -> Result<Self, BusError> {
        let name = |log: &str| format!("{}_{log}", options.prefix.replace('.', "_"));
        let config = |log: &str| Config {
            name: name(log),
            subjects: vec![format!("{}.{log}.*", options.prefix)],
            num_replicas: options.replicas,
            duplicate_window: DUPLICATE_WINDOW.min(options.max_age),
            ..Config::default()
        };
        let max_bytes = i64::try_from(options.max_bytes).unwrap_or(i64::MAX);
        let frames = Config {
            // Whoever brings a frame is told that there is no room; none that was stored is lost.
            discard: DiscardPolicy::New,
            max_bytes,
            max_age: options.max_age,
            ..config("frames")
        };
        let outcomes = Config {
            // As long as there is the frame, so that nobody waits for what is gone.
            max_age: options.max_age * 2,
            max_bytes,
            ..config("outcomes")
        };
        let records = Config {
            max_messages_per_subject: 1,
            ..config("records")
        };
        let make = async |config: Config| {
            let name = config.name.clone();
            let made = context.create_or_update_stream(config).await;
            made.map_err(unavailable)?;
            context.get_stream(name).await.map_err(unavailable)
        };
        let frames = make(frames).await?;
        let consumer = pull::Config {
            durable_name: Some("workers".to_owned()),
            ack_policy: AckPolicy::Explicit,
            ack_wait: options.ack_wait,
            ..pull::Config::default()
        };
        let workers = frames.create_consumer(consumer).await;
        Ok(Self {
            outcomes: make(outcomes).await?,
            records: make(records).await?,
            workers: workers.map_err(unavailable)?,
            frames,
        })
    }
}
