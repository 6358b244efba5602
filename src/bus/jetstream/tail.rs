//! A log read from the last message of every subject on, over whatever happens to the server.

use std::time::Duration;

use async_nats::jetstream::Context;
use async_nats::jetstream::consumer::{DeliverPolicy, push};
use async_nats::jetstream::stream::Stream;
use async_nats::{Client, HeaderMap};
use bytes::Bytes;
use futures_util::StreamExt;
use tokio::time::{Instant, timeout_at};

use super::{BusError, unavailable};

/// How long to wait before the server is asked again.
pub(super) const LOOK_AGAIN: Duration = Duration::from_millis(300);

/// How often it is looked whether a log was lost and made again: the consumer waits for the next
/// number for ever then.
const LOOK: Duration = Duration::from_secs(3);

/// A place in a log.
pub(super) struct Tail {
    client: Client,
    context: Context,
    log: Stream,
    messages: Option<push::Ordered>,
    /// The last message that was given.
    last: Option<u64>,
    /// When to look whether the log is still the same.
    look_at: Instant,
}

impl std::fmt::Debug for Tail {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tail").field("last", &self.last).finish()
    }
}

impl Tail {
    /// Starts reading now.
    pub async fn begin(client: &Client, context: &Context, log: &Stream) -> Result<Self, BusError> {
        let messages = Self::read(client, log, None).await;
        Ok(Self {
            client: client.clone(),
            context: context.clone(),
            log: log.clone(),
            messages: Some(messages.map_err(unavailable)?),
            last: None,
            look_at: Instant::now() + LOOK,
        })
    }

    /// The next message: subject, headers and payload. Cancel safe.
    pub async fn next(&mut self) -> (String, HeaderMap, Bytes) {
        loop {
            let Some(messages) = &mut self.messages else {
                match Self::read(&self.client, &self.log, self.last).await {
                    Ok(messages) => self.messages = Some(messages),
                    Err(error) => {
                        tracing::debug!(%error, "a log of the bus cannot be read");
                        tokio::time::sleep(LOOK_AGAIN).await;
                        self.look().await;
                    }
                }
                continue;
            };
            match timeout_at(self.look_at, messages.next()).await {
                Err(_) => self.look().await,
                Ok(Some(Ok(message))) => {
                    let Ok(info) = message.info() else {
                        continue;
                    };
                    let sequence = info.stream_sequence;
                    // A consumer that was begun anew may begin with what was there already.
                    if self.last.is_some_and(|last| sequence <= last) {
                        continue;
                    }
                    self.last = Some(sequence);
                    let (message, _) = message.split();
                    let headers = message.headers.unwrap_or_default();
                    return (message.subject.to_string(), headers, message.payload);
                }
                Ok(Some(Err(error))) => {
                    tracing::debug!(%error, "a log of the bus is read anew");
                    self.messages = None;
                }
                Ok(None) => self.messages = None,
            }
        }
    }

    /// Begins anew with a log that was lost and made again.
    async fn look(&mut self) {
        // Not asked again before its time if this is given up.
        self.look_at = Instant::now() + LOOK;
        let Ok(info) = self.log.get_info().await else {
            return;
        };
        let is_another = info.created != self.log.cached_info().created;
        if is_another && let Ok(log) = self.context.get_stream(&info.config.name).await {
            tracing::warn!(
                log = info.config.name,
                "a log of the bus was lost, and begins anew"
            );
            (self.log, self.last, self.messages) = (log, None, None);
        }
    }

    /// Not a method: what has been begun cannot be shared between threads.
    async fn read(
        client: &Client,
        log: &Stream,
        last: Option<u64>,
    ) -> Result<push::Ordered, async_nats::Error> {
        let deliver_policy = match last {
            None => DeliverPolicy::LastPerSubject,
            Some(last) => DeliverPolicy::ByStartSequence {
                start_sequence: last + 1,
            },
        };
        let subjects = &log.cached_info().config.subjects;
        let config = push::OrderedConfig {
            deliver_subject: client.new_inbox(),
            // The server wants one where it is to find the last of each.
            filter_subject: subjects.first().cloned().unwrap_or_default(),
            deliver_policy,
            ..push::OrderedConfig::default()
        };
        Ok(log.create_consumer(config).await?.messages().await?)
    }
}
