//! Brings messages to one endpoint, one after the other.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use reqwest::{Client, StatusCode, header, redirect};

use crate::telemetry::EndpointMetrics;

use super::queue::{Message, Queue};
use super::{Address, Options, Secret, UnusableOptions};

/// No pause between two attempts is longer, not even if the endpoint asks for it.
const LONGEST_PAUSE: Duration = Duration::from_secs(60);

/// Makes a client for all endpoints. It follows no redirects: they would lead messages to whom
/// they are not meant for.
///
/// # Errors
///
/// If the system has no certificates to trust.
pub(super) fn client() -> Result<Client, UnusableOptions> {
    Client::builder()
        .redirect(redirect::Policy::none())
        .user_agent(concat!("steadymesh/", env!("CARGO_PKG_VERSION")))
        .build()
        .map_err(UnusableOptions::Client)
}

/// What a worker knows of its endpoint.
#[derive(Debug)]
pub(super) struct Delivery {
    pub name: String,
    pub url: Address,
    pub secret: Secret,
    pub patience: Patience,
    pub client: Client,
    pub metrics: Arc<EndpointMetrics>,
}

/// How long and how often it is tried.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Patience {
    timeout: Duration,
    attempts: u32,
    first_pause: Duration,
}

impl Patience {
    pub fn new(options: &Options) -> Self {
        Self {
            timeout: Duration::from_secs(options.timeout_secs),
            attempts: options.attempts,
            first_pause: Duration::from_millis(options.retry_ms),
        }
    }

    /// The pause after so many attempts: half of it certain, half by chance, which is from 0
    /// to 1, so that not all servers come back at once.
    fn pause(&self, attempts: u32, chance: f64) -> Duration {
        let doubled = self
            .first_pause
            .saturating_mul(1 << attempts.saturating_sub(1).min(16));
        doubled.min(LONGEST_PAUSE).mul_f64(0.5 + 0.5 * chance)
    }
}

/// Why a message has not been taken.
#[derive(Debug)]
struct Failed {
    reason: String,
    /// Whether it may be taken another time, and how long the endpoint wants to be left alone.
    again: Option<Duration>,
}

impl Delivery {
    /// Runs until the queue is closed and empty.
    pub async fn run(self, queue: Arc<Queue>) {
        while let Some(message) = queue.next().await {
            self.deliver(&message).await;
            queue.done();
            self.metrics.queued.set(queue.len() as i64);
        }
    }

    async fn deliver(&self, message: &Message) {
        let mut attempt = 1;
        loop {
            let Err(failed) = self.send(message).await else {
                self.metrics.delivered.inc();
                return;
            };
            match failed.again {
                Some(asked) if attempt < self.patience.attempts => {
                    let pause = self.patience.pause(attempt, chance()).max(asked);
                    tokio::time::sleep(pause.min(LONGEST_PAUSE)).await;
                    attempt += 1;
                }
                _ => {
                    self.metrics.failed.inc();
                    let (event, reason) = (message.kind.as_str(), failed.reason);
                    tracing::warn!(
                        endpoint = %self.name, event, attempt, reason, "webhook not delivered"
                    );
                    return;
                }
            }
        }
    }

    async fn send(&self, message: &Message) -> Result<(), Failed> {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let timestamp = now.unwrap_or_default().as_secs();
        let signature = self.secret.sign(&message.id, timestamp, &message.body);
        let request = self
            .client
            .post(self.url.url().clone())
            .timeout(self.patience.timeout)
            .header(header::CONTENT_TYPE, "application/json")
            .header("webhook-id", &message.id)
            .header("webhook-timestamp", timestamp)
            .header("webhook-signature", signature)
            .body(message.body.clone());
        let answer = request.send().await.map_err(|error| Failed {
            reason: what_went_wrong(&error).to_owned(),
            again: Some(Duration::ZERO),
        })?;
        let status = answer.status();
        if status.is_success() {
            return Ok(());
        }
        let may_pass = status.is_server_error() || status == StatusCode::TOO_MANY_REQUESTS;
        let asked = answer.headers().get(header::RETRY_AFTER);
        let asked = asked.and_then(|value| value.to_str().ok()?.parse().ok());
        Err(Failed {
            reason: format!("the answer was {}", status.as_u16()),
            again: may_pass.then(|| Duration::from_secs(asked.unwrap_or_default())),
        })
    }
}

/// In words of our own: the library's have the address in them.
fn what_went_wrong(error: &reqwest::Error) -> &'static str {
    if error.is_timeout() {
        "no answer in time"
    } else if error.is_connect() {
        "no connection"
    } else {
        "the connection broke"
    }
}

/// A number from 0 to 1.
fn chance() -> f64 {
    // Without random numbers, pauses are merely as long as possible.
    getrandom::u32().map_or(1.0, |random| f64::from(random) / f64::from(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_a_minute() {
        let patience = Patience::new(&Options::default());
        let pauses: Vec<_> = [1, 2, 3, 7, 40]
            .map(|n| patience.pause(n, 1.0).as_secs())
            .into();
        assert_eq!(pauses, [1, 2, 4, 60, 60]);
        assert_eq!(patience.pause(1, 0.0), Duration::from_millis(500));
    }
}
