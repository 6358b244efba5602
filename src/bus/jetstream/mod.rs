//! The bus in NATS JetStream.
//!
//! Three streams: frames (each stream's own subject, kept until its successor has been processed),
//! outcomes and records (the last of each subject). One durable consumer, shared by all workers,
//! gives frames out.

mod logs;
mod message;
mod objects;
mod tail;

use std::path::PathBuf;
use std::time::Duration;

use async_nats::connection::State;
use async_nats::jetstream::consumer::PullConsumer;
use async_nats::jetstream::context::{PublishError, PublishErrorKind};
use async_nats::jetstream::message::{Acker, PublishMessage};
use async_nats::jetstream::stream::{LastRawMessageErrorKind, RawMessageErrorKind, Stream};
use async_nats::jetstream::{AckKind, Context, context::ContextBuilder};
use async_nats::{Client, ConnectOptions, HeaderMap, ServerAddr};
use bytes::Bytes;
use futures_util::StreamExt;
use tokio::time::timeout;

use super::{BusError, Frame, InvalidMessage, Job, Position, Processed, StreamRecord};
use logs::Logs;
use objects::Objects;
use tail::Tail;

/// How long a worker waits for a frame before it is told that there is none.
const PATIENCE: Duration = Duration::from_secs(2);
/// How often it is looked, meanwhile, whether the server is there: what it was asked it has
/// forgotten when it comes back.
const LOOK: Duration = Duration::from_millis(200);
/// How long a request may take.
const TIMEOUT: Duration = Duration::from_secs(2);
/// How often a server that is connected must show that it is there.
const PING: Duration = Duration::from_secs(2);
/// Beside the body a message has headers; a server counts both.
const HEADER_ROOM: usize = 4096;

/// Where the bus is, and how much it holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Its servers, `nats://host:port`, with commas between them.
    pub url: String,
    /// A file with credentials (`.creds`), if the servers want some.
    pub credentials_file: Option<PathBuf>,
    /// What the names of streams and subjects begin with.
    pub prefix: String,
    /// How many servers keep each log.
    pub replicas: usize,
    /// A frame that a worker has not answered for within this time is given to another.
    pub ack_wait: Duration,
    /// Bytes of frames that may wait.
    pub max_bytes: u64,
    /// How long a frame is kept that nobody processes.
    pub max_age: Duration,
}

/// A connection, and the logs.
#[derive(Debug)]
pub(super) struct JetStream {
    client: Client,
    context: Context,
    frames: Stream,
    outcomes: Stream,
    records: Stream,
    workers: PullConsumer,
    objects: Objects,
    options: Options,
}

/// A claim on a frame.
pub(super) struct Ticket(Acker);

impl std::fmt::Debug for Ticket {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Ticket")
    }
}

fn unavailable(error: impl std::fmt::Display) -> BusError {
    BusError::Unavailable(error.to_string())
}

impl JetStream {
    pub async fn connect(options: Options) -> Result<Self, BusError> {
        let mut connect = ConnectOptions::new()
            .name("steadymesh")
            .connection_timeout(TIMEOUT)
            .request_timeout(Some(TIMEOUT))
            .ping_interval(PING)
            // A server that was away shall be back soon.
            .reconnect_delay_callback(|attempts| {
                Duration::from_millis(100 * u64::try_from(attempts).unwrap_or(20).min(20))
            });
        if let Some(file) = &options.credentials_file {
            connect = connect.credentials_file(file).await.map_err(|error| {
                unavailable(format!("bus.credentials_file {}: {error}", file.display()))
            })?;
        }
        let servers = options.url.split(',').map(|url| url.trim().parse());
        let servers: Vec<ServerAddr> = servers
            .collect::<Result<_, _>>()
            .map_err(|error| unavailable(format!("bus.nats_url {}: {error}", options.url)))?;
        let client = connect.retry_on_initial_connect().connect(servers).await;
        let client = client.map_err(unavailable)?;
        let context = ContextBuilder::new()
            .timeout(TIMEOUT)
            .ack_timeout(TIMEOUT)
            .build(client.clone());
        let made = Logs::wait_for(&context, &options).await?;
        Ok(Self {
            objects: Objects::new(context.clone(), &options),
            client,
            context,
            frames: made.frames,
            outcomes: made.outcomes,
            records: made.records,
            workers: made.workers,
            options,
        })
    }

    pub fn is_connected(&self) -> bool {
        self.client.connection_state() == State::Connected
    }

    /// The servers have lost everything, as those without a disk do: the logs are made again.
    async fn made_anew(&self, error: impl std::fmt::Display) -> BusError {
        if let Err(error) = Logs::ensure(&self.context, &self.options).await {
            return error;
        }
        tracing::error!("the logs on the bus were gone, and have been made again");
        unavailable(error)
    }

    async fn disconnected(&self) {
        while self.is_connected() {
            tokio::time::sleep(LOOK).await;
        }
    }

    fn subject(&self, log: &str, stream: &str) -> String {
        format!("{}.{log}.{stream}", self.options.prefix)
    }

    /// A message of this id. A body that is too large for one goes beside it.
    async fn message(
        &self,
        id: &str,
        mut headers: HeaderMap,
        mut body: Bytes,
    ) -> Result<PublishMessage, BusError> {
        let room = self.client.server_info().max_payload;
        if room.saturating_sub(HEADER_ROOM) < body.len() {
            headers.insert(message::OBJECT, self.objects.put(id, &body).await?);
            body.clear();
        }
        let message = PublishMessage::build().headers(headers).payload(body);
        Ok(message.message_id(id))
    }

    /// Writes a message, and gives its place once it is stored.
    async fn send(
        &self,
        log: &str,
        stream: &str,
        message: PublishMessage,
    ) -> Result<u64, PublishError> {
        let subject = self.subject(log, stream);
        let ack = self.context.send_publish(subject, message).await?.await?;
        Ok(ack.sequence)
    }

    pub async fn append(
        &self,
        frame: &Frame,
        behind: Option<Position>,
    ) -> Result<Position, BusError> {
        let (instance, seq, received) = frame.identity();
        let id = format!("{}/{instance}/{seq}/{received}", frame.stream);
        let (headers, body) = (message::frame_headers(frame), frame.body.clone());
        let message = self.message(&id, headers, body).await?;
        let before = behind.map_or(0, |position| position.0);
        let message = message.expected_last_subject_sequence(before);
        match self.send("frames", &frame.stream, message).await {
            Ok(sequence) => Ok(Position(sequence)),
            Err(error) => Err(match error.kind() {
                PublishErrorKind::WrongLastSequence => BusError::Conflict,
                PublishErrorKind::StreamNotFound => self.made_anew(error).await,
                // Says so only in words, whose code this client does not hand out.
                _ if is_full(&error) => BusError::Full,
                _ => unavailable(error),
            }),
        }
    }

    pub async fn last(&self, stream: &str) -> Result<Option<(Position, Frame)>, BusError> {
        let subject = self.subject("frames", stream);
        let found = self.frames.get_last_raw_message_by_subject(&subject).await;
        match found {
            Ok(found) => {
                let position = Position(found.sequence);
                let frame = message::frame(&found.subject, &found.headers, found.payload)?;
                Ok(Some((position, frame)))
            }
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(None),
            Err(error) => Err(unavailable(error)),
        }
    }

    pub async fn pull(&self) -> Result<Option<Job>, BusError> {
        let batch = self.workers.batch().max_messages(1).expires(PATIENCE);
        let batch = timeout(PATIENCE + TIMEOUT, batch.messages()).await;
        let mut batch = batch.map_err(unavailable)?.map_err(unavailable)?;
        let next = tokio::select! {
            next = timeout(PATIENCE + TIMEOUT, batch.next()) => next,
            () = self.disconnected() => return Err(unavailable("the connection broke")),
        };
        let Some(given) = next.map_err(unavailable)? else {
            return Ok(None);
        };
        let given = given.map_err(unavailable)?;
        let info = given.info().map_err(unavailable)?;
        let (position, delivered) = (Position(info.stream_sequence), info.delivered);
        let (message, acker) = given.split();
        let headers = message.headers.unwrap_or_default();
        let frame = self
            .whole(&message.subject, &headers, message.payload)
            .await;
        let frame = match frame {
            Ok(Some(frame)) => frame,
            // Nobody can process it: it shall not come again.
            Ok(None) | Err(BusError::Invalid(_)) => {
                tracing::error!(position = position.0, "a frame on the bus cannot be read");
                acker.ack_with(AckKind::Term).await.map_err(unavailable)?;
                // Gone, so that its gateway gives it up and nobody waits for it.
                self.forget(position).await?;
                return Ok(None);
            }
            Err(error) => return Err(error),
        };
        Ok(Some(Job {
            frame,
            position,
            deliveries: u64::try_from(delivered).unwrap_or(1),
            ticket: super::Ticket::JetStream(Box::new(Ticket(acker))),
        }))
    }

    pub async fn frame(&self, position: Position) -> Result<Option<Frame>, BusError> {
        match self.frames.get_raw_message(position.0).await {
            Ok(found) => {
                self.whole(&found.subject, &found.headers, found.payload)
                    .await
            }
            Err(error) if error.kind() == RawMessageErrorKind::NoMessageFound => Ok(None),
            Err(error) => Err(unavailable(error)),
        }
    }

    /// A frame with its body, wherever that is; none if it is gone.
    async fn whole(
        &self,
        subject: &str,
        headers: &HeaderMap,
        payload: Bytes,
    ) -> Result<Option<Frame>, BusError> {
        let mut frame = message::frame(subject, headers, payload)?;
        if let Some(object) = headers.get(message::OBJECT) {
            match self.objects.get(object.as_str()).await? {
                Some(body) => frame.body = body,
                None => return Ok(None),
            }
        }
        Ok(Some(frame))
    }

    pub async fn forget(&self, position: Position) -> Result<(), BusError> {
        // An object that it refers to goes with its age.
        match self.frames.delete_message(position.0).await {
            Ok(_) => Ok(()),
            Err(error) if self.is_connected() => {
                // One that is gone already.
                tracing::debug!(%error, position = position.0, "a frame is not there to be forgotten");
                Ok(())
            }
            Err(error) => Err(unavailable(error)),
        }
    }

    pub async fn publish(&self, processed: &Processed) -> Result<(), BusError> {
        let Processed {
            stream,
            instance,
            seq,
            ..
        } = processed;
        let (headers, body) = message::outcome_parts(processed);
        let id = format!("{stream}/{instance}/{seq}/outcome");
        let message = self.message(&id, headers, body).await?;
        let sent = self.send("outcomes", stream, message).await;
        sent.map(drop).map_err(unavailable)
    }

    pub async fn outcomes(&self) -> Result<Outcomes, BusError> {
        Ok(Outcomes {
            tail: Tail::begin(&self.client, &self.context, &self.outcomes).await?,
            objects: self.objects.clone(),
            pending: None,
        })
    }

    pub async fn begin(&self, stream: &str, record: &StreamRecord) -> Result<(), BusError> {
        let (last, sequence) = self.last_record(stream).await?;
        if last.is_some_and(|last| last.is_in_the_way_of(record)) {
            return Err(BusError::Conflict);
        }
        self.write_record(stream, record, sequence).await
    }

    pub async fn announce(&self, stream: &str, record: &StreamRecord) -> Result<(), BusError> {
        loop {
            let (last, sequence) = self.last_record(stream).await?;
            if last.is_some_and(|last| !record.follows(&last)) {
                return Ok(());
            }
            match self.write_record(stream, record, sequence).await {
                // Somebody else was faster: which of both is the later one?
                Err(BusError::Conflict) => {}
                written => return written,
            }
        }
    }

    /// A stream's record, if it can be read, and where it is; 0 if there is none.
    async fn last_record(&self, stream: &str) -> Result<(Option<StreamRecord>, u64), BusError> {
        let subject = self.subject("records", stream);
        let last = self.records.get_last_raw_message_by_subject(&subject).await;
        match last {
            Ok(last) => Ok((serde_json::from_slice(&last.payload).ok(), last.sequence)),
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok((None, 0)),
            Err(error) => Err(unavailable(error)),
        }
    }

    async fn write_record(
        &self,
        stream: &str,
        record: &StreamRecord,
        behind: u64,
    ) -> Result<(), BusError> {
        // Names and numbers, which always serialize.
        let text = serde_json::to_vec(record).unwrap_or_default();
        let message = PublishMessage::build()
            .payload(text.into())
            .expected_last_subject_sequence(behind);
        match self.send("records", stream, message).await {
            Ok(_) => Ok(()),
            Err(error) if error.kind() == PublishErrorKind::WrongLastSequence => {
                Err(BusError::Conflict)
            }
            Err(error) => Err(unavailable(error)),
        }
    }

    pub async fn records(&self) -> Result<Records, BusError> {
        let tail = Tail::begin(&self.client, &self.context, &self.records).await?;
        Ok(Records(tail))
    }

    pub async fn waiting(&self) -> Option<u64> {
        let info = self.workers.get_info().await.ok()?;
        Some(info.num_pending)
    }
}

/// The server's answer when a stream is at its limit.
fn is_full(error: &(dyn std::error::Error + 'static)) -> bool {
    let mut error = Some(error);
    while let Some(this) = error {
        if this.to_string().contains("maximum bytes exceeded") {
            return true;
        }
        error = this.source();
    }
    false
}

impl Ticket {
    pub async fn done(&self) -> Result<(), BusError> {
        self.0.double_ack().await.map_err(unavailable)
    }

    pub async fn put_back(&self, delay: Duration) {
        // Without it, it comes again after `ack_wait`.
        self.0.ack_with(AckKind::Nak(Some(delay))).await.ok();
    }

    pub async fn keep(&self) {
        // Without it, another worker does the same again.
        self.0.ack_with(AckKind::Progress).await.ok();
    }
}

/// See [`super::Outcomes`].
#[derive(Debug)]
pub(super) struct Outcomes {
    tail: Tail,
    objects: Objects,
    /// One whose body is still to be read.
    pending: Option<(Processed, String)>,
}

impl Outcomes {
    pub async fn next(&mut self) -> Processed {
        loop {
            if let Some((processed, object)) = &self.pending {
                match self.objects.get(object).await {
                    Ok(body) => {
                        let body = message::with_body(processed.clone(), body);
                        self.pending = None;
                        return body;
                    }
                    Err(_) => {
                        tokio::time::sleep(tail::LOOK_AGAIN).await;
                        continue;
                    }
                }
            }
            let (subject, headers, payload) = self.tail.next().await;
            match message::outcome(&subject, &headers, payload) {
                Ok(processed) => match headers.get(message::OBJECT) {
                    None => return processed,
                    Some(object) => self.pending = Some((processed, object.to_string())),
                },
                Err(error) => tracing::error!(%error, %subject, "an outcome cannot be read"),
            }
        }
    }
}

/// See [`super::Records`].
#[derive(Debug)]
pub(super) struct Records(Tail);

impl Records {
    pub async fn next(&mut self) -> (String, StreamRecord) {
        loop {
            let (subject, _, payload) = self.0.next().await;
            let record = serde_json::from_slice(&payload)
                .map_err(|_| InvalidMessage { what: "the record" })
                .and_then(|record| Ok((message::stream_of(&subject)?, record)));
            match record {
                Ok(record) => return record,
                Err(error) => tracing::error!(%error, %subject, "a record cannot be read"),
            }
        }
    }
}
