//! The task that hears of streams and hands messages to the endpoints' queues.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use bytes::Bytes;
use reqwest::Client;
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::MissedTickBehavior;

use crate::streams::{Life, LifeEvent, Listener, StreamName};
use crate::telemetry::{EndpointMetrics, Telemetry};

use super::delivery::{Delivery, Patience, client};
use super::monitor::{Finding, Monitor, Rules};
use super::queue::{Message, Queue};
use super::{Details, Ending, EndpointOptions, Kind, Notice, Options, Secret, UnusableOptions};

/// How often it is looked whether a stream has stalled.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Tells endpoints what happens to streams, until it is stopped.
#[derive(Debug)]
pub struct Webhooks {
    commands: mpsc::Sender<Command>,
    task: JoinHandle<()>,
}

#[derive(Debug)]
enum Command {
    Reload(Prepared),
    Stop,
}

/// Options that have been checked, and secrets that have been read.
#[derive(Debug)]
pub struct Prepared {
    options: Options,
    secrets: Vec<Secret>,
}

impl Prepared {
    /// Checks and reads them.
    ///
    /// # Errors
    ///
    /// [`UnusableOptions`].
    pub fn new(options: &Options) -> Result<Self, UnusableOptions> {
        options.check()?;
        let secrets = options.endpoints.iter().map(EndpointOptions::load_secret);
        Ok(Self {
            secrets: secrets.collect::<Result<_, _>>()?,
            options: options.clone(),
        })
    }
}

impl Webhooks {
    /// Starts telling; must be called within a Tokio runtime.
    ///
    /// # Errors
    ///
    /// [`UnusableOptions`].
    pub fn start(
        options: &Options,
        listener: Listener,
        telemetry: Arc<Telemetry>,
    ) -> Result<Self, UnusableOptions> {
        let setup = Prepared::new(options)?;
        let mut hub = Hub {
            monitor: Monitor::new(Rules::new(&setup.options)),
            endpoints: BTreeMap::new(),
            shutdown: Duration::ZERO,
            client: client()?,
            telemetry,
        };
        hub.take(setup);
        let (commands, received) = mpsc::channel(1);
        let task = tokio::spawn(hub.run(listener, received));
        Ok(Self { commands, task })
    }

    /// Takes new options. Messages that wait for an endpoint whose name stays wait for the new
    /// one.
    pub async fn reload(&self, prepared: Prepared) {
        // Fails only if the task has panicked, which is said when it is stopped.
        self.commands.send(Command::Reload(prepared)).await.ok();
    }

    /// Delivers what has happened until now, for as long as `webhooks.shutdown_secs` allows.
    pub async fn shut_down(self) {
        self.commands.send(Command::Stop).await.ok();
        if self.task.await.is_err() {
            tracing::error!("the webhooks have panicked");
        }
    }
}

struct Hub {
    monitor: Monitor,
    endpoints: BTreeMap<String, Endpoint>,
    shutdown: Duration,
    client: Client,
    telemetry: Arc<Telemetry>,
}

struct Endpoint {
    options: EndpointOptions,
    secret: Secret,
    patience: Patience,
    queue: Arc<Queue>,
    metrics: Arc<EndpointMetrics>,
    worker: JoinHandle<()>,
}

impl Hub {
    async fn run(mut self, mut listener: Listener, mut commands: mpsc::Receiver<Command>) {
        let mut ticks = tokio::time::interval(LOOK_EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                biased;
                command = commands.recv() => match command {
                    Some(Command::Reload(setup)) => self.take(setup),
                    Some(Command::Stop) | None => break,
                },
                life = listener.lives.recv() => match life {
                    Ok(event) => self.tell_life(event),
                    Err(RecvError::Lagged(missed)) => self.missed(missed),
                    Err(RecvError::Closed) => break,
                },
                _ = ticks.tick() => self.tell_stalls(),
                frame = listener.frames.recv() => match frame {
                    Ok(event) => {
                        let findings = self.monitor.frame(&event, Instant::now());
                        self.tell_findings(&event.stream, findings);
                    }
                    // The next frame says what there is to know.
                    Err(RecvError::Lagged(_)) => {}
                    Err(RecvError::Closed) => break,
                },
            }
        }
        loop {
            match listener.lives.try_recv() {
                Ok(event) => self.tell_life(event),
                Err(TryRecvError::Lagged(missed)) => self.missed(missed),
                Err(TryRecvError::Empty | TryRecvError::Closed) => break,
            }
        }
        self.finish().await;
    }

    /// Begins to work with these options.
    fn take(&mut self, setup: Prepared) {
        let Prepared { options, secrets } = setup;
        self.monitor.set_rules(Rules::new(&options));
        self.shutdown = Duration::from_secs(options.shutdown_secs);
        let patience = Patience::new(&options);
        let mut former = std::mem::take(&mut self.endpoints);
        for (endpoint, secret) in options.endpoints.into_iter().zip(secrets) {
            let name = endpoint.name.clone();
            let kept = match former.remove(&name) {
                Some(old) => {
                    old.metrics
                        .dropped
                        .inc_by(old.queue.resize(options.queue) as u64);
                    if old.is_same(&endpoint, &secret, &patience) {
                        self.endpoints.insert(name, old);
                        continue;
                    }
                    old.worker.abort();
                    Some((old.queue, old.metrics))
                }
                None => None,
            };
            let (queue, metrics) = kept.unwrap_or_else(|| {
                let metrics = Arc::new(self.telemetry.endpoint(&name));
                (Arc::new(Queue::new(options.queue)), metrics)
            });
            let delivery = Delivery {
                name: name.clone(),
                url: endpoint.url.clone(),
                secret: secret.clone(),
                patience: patience.clone(),
                client: self.client.clone(),
                metrics: Arc::clone(&metrics),
            };
            let started = Endpoint {
                options: endpoint,
                secret,
                patience: patience.clone(),
                worker: tokio::spawn(delivery.run(Arc::clone(&queue))),
                queue,
                metrics,
            };
            self.endpoints.insert(name, started);
        }
        for (name, gone) in former {
            gone.worker.abort();
            let unsent = gone.queue.len();
            if 0 < unsent {
                tracing::warn!(endpoint = %name, unsent, "webhooks discarded with their endpoint");
            }
        }
    }

    fn tell_life(&mut self, event: LifeEvent) {
        let LifeEvent { stream, at, life } = event;
        let name = stream.to_string();
        match life {
            Life::Started { seq } => {
                self.monitor.start(stream.clone(), seq, Instant::now());
                let details = Details::Started { stream: name, seq };
                self.tell(&stream, at, (Kind::Started, details));
            }
            Life::Ended {
                reason,
                published,
                dropped,
                latest_seq,
            } => {
                self.monitor.end(&stream);
                let ending = Ending {
                    stream: name,
                    reason,
                    published,
                    dropped,
                    latest_seq,
                };
                self.tell(&stream, at, (Kind::Ended, Details::Ended(ending)));
            }
        }
    }

    fn tell_stalls(&mut self) {
        for (stream, finding) in self.monitor.tick(Instant::now()) {
            self.tell(&stream, SystemTime::now(), finding);
        }
    }

    fn tell_findings(&self, stream: &StreamName, findings: Vec<Finding>) {
        for finding in findings {
            self.tell(stream, SystemTime::now(), finding);
        }
    }

    /// Hands a message to all endpoints that want it.
    fn tell(&self, stream: &StreamName, timestamp: SystemTime, (kind, data): Finding) {
        let wanting = self
            .endpoints
            .values()
            .filter(|e| e.options.wants(kind, stream));
        let mut message = None;
        for endpoint in wanting {
            if message.is_none() {
                let (r#type, data) = (kind, data.clone());
                message = message_of(&Notice {
                    r#type,
                    timestamp,
                    data,
                });
            }
            let Some(message) = &message else { return };
            let dropped = endpoint.queue.push(Arc::clone(message));
            endpoint.metrics.dropped.inc_by(dropped as u64);
            endpoint.metrics.queued.set(endpoint.queue.len() as i64);
        }
    }

    fn missed(&self, count: u64) {
        // A thousand streams began and ended while this task did not get to run.
        tracing::error!(
            count,
            "starts and ends of streams were not told to webhooks"
        );
    }

    /// Lets the queues run empty, for a while.
    async fn finish(self) {
        let deadline = tokio::time::Instant::now() + self.shutdown;
        for endpoint in self.endpoints.values() {
            endpoint.queue.close();
        }
        for (name, mut endpoint) in self.endpoints {
            if tokio::time::timeout_at(deadline, &mut endpoint.worker)
                .await
                .is_err()
            {
                endpoint.worker.abort();
                let unsent = endpoint.queue.len();
                endpoint.metrics.dropped.inc_by(unsent as u64);
                tracing::warn!(endpoint = %name, unsent, "webhooks left undelivered");
            }
        }
    }
}

impl Endpoint {
    fn is_same(&self, options: &EndpointOptions, secret: &Secret, patience: &Patience) -> bool {
        // What it wants is looked up here, not by the worker, but is part of its options.
        self.options == *options && self.secret == *secret && self.patience == *patience
    }
}

fn message_of(notice: &Notice) -> Option<Arc<Message>> {
    let mut random = [0; 16];
    // Names and numbers always serialize, and a system that gives no random numbers gives none
    // to TLS either.
    getrandom::fill(&mut random).ok()?;
    let body = Bytes::from(serde_json::to_vec(notice).ok()?);
    let id: String = random.iter().map(|byte| format!("{byte:02x}")).collect();
    Some(Arc::new(Message {
        id: format!("msg_{id}"),
        kind: notice.r#type,
        body,
    }))
}
