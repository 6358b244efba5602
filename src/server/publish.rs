//! Frames in, by WebSocket.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade, close_code};
use axum::response::Response;
use bytes::Bytes;
use futures_util::StreamExt;
use futures_util::future::BoxFuture;
use futures_util::stream::{FuturesUnordered, SplitStream};
use serde::Deserialize;
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::stream::{DropReason, FrameState, PublishReply, PublisherMessage};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite;
use tracing::Instrument;

use crate::streams::{Loss, Outcome, Publication, Session, Stream, Submission, Ticket};

use super::App;
use super::access::Access;
use super::auth::Scope;
use super::error::Problem;
use super::extract::{Asking, Strict};
use super::ingest::{Stamps, sniffed_format, with_native_stamps};
use super::request_log::LogSpan;
use super::socket::{
    self, CLOSE_CHATTER, CLOSE_EXPIRED, CLOSE_SILENT, CLOSE_SUPERSEDED, Chatter, NotSent, Outgoing,
    SILENCE,
};

/// What a publisher may say when it connects.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Arrival {
    session: Option<String>,
    #[serde(default)]
    takeover: bool,
    /// Has been read as a credential.
    #[serde(rename = "ticket")]
    _ticket: Option<String>,
}

/// How long a publisher may take to hear the last of it.
const GOODBYE: Duration = Duration::from_secs(1);

/// Why a connection ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Farewell {
    Ours(u16, &'static str),
    /// The publisher said goodbye.
    Theirs,
    /// The connection broke: the publisher may come back.
    Broken,
}

/// `GET /v1/streams/{stream}/publish`.
pub(super) async fn publish(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(arrival): Strict<Arrival>,
    Extension(LogSpan(span)): Extension<LogSpan>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let access = app.authorize(&credential, Scope::Publish, &name)?;
    let upgrade = socket::accept(upgrade)?;
    let stream = app.registry.get_or_create(&name)?;
    let session = match arrival.session {
        Some(session) => Session::from_client(&session),
        None => new_session()?,
    };
    let publication = stream
        .publish(session, arrival.takeover)
        .map_err(|_| Problem::occupied())?;
    let (ongoing, options) = (app.sockets.token(), app.options());
    Ok(upgrade
        .max_message_size(options.max_body_bytes)
        .max_frame_size(options.max_body_bytes)
        .on_upgrade(move |socket| async move {
            let send_timeout = options.send_timeout;
            let serving = serve(socket, &stream, (publication, access), send_timeout);
            serving.instrument(span).await;
            drop(ongoing);
        }))
}

fn new_session() -> Result<Session, Problem> {
    let mut random = [0; 16];
    getrandom::fill(&mut random)
        .map_err(|_| Problem::defect("the system has no random numbers to give"))?;
    Ok(Session::new(random))
}

async fn serve(
    socket: WebSocket,
    stream: &Arc<Stream>,
    (publication, access): (Publication, Access),
    send_timeout: Duration,
) {
    let (sink, mut incoming) = socket.split();
    let mut connection = Connection {
        outgoing: Outgoing::new(sink, send_timeout),
        stream,
        publication: &publication,
        access: &access,
        messages: 0,
        credit: 0,
        stamps: Stamps::default(),
        is_rejected: false,
        answers: FuturesUnordered::new(),
    };
    let farewell = connection.run(&mut incoming).await;
    tracing::debug!(stream = %stream.name(), ?farewell, "publisher leaves");
    match farewell {
        Farewell::Ours(code, reason) => {
            // Read on for a moment: a connection that is dropped with frames in flight is reset,
            // and the rig would not learn why.
            if connection.outgoing.close(code, reason).await.is_ok() {
                timeout(GOODBYE, forget(&mut incoming)).await.ok();
            }
        }
        Farewell::Theirs => connection.outgoing.finish().await,
        Farewell::Broken => {}
    }
    drop(connection);
    match farewell {
        Farewell::Broken => drop(publication),
        Farewell::Ours(..) | Farewell::Theirs => publication.end(),
    }
}

/// Reads until the publisher has closed too.
async fn forget(incoming: &mut SplitStream<WebSocket>) {
    while let Some(Ok(_)) = incoming.next().await {}
}

/// What has become of a frame so far.
struct Answer {
    message: u64,
    state: FrameState,
}

/// One publisher's connection.
struct Connection<'a> {
    outgoing: Outgoing,
    stream: &'a Arc<Stream>,
    publication: &'a Publication,
    access: &'a Access,
    /// Frames that have come.
    messages: u64,
    /// What the publisher has been told.
    credit: u64,
    /// What has been said about the next frame.
    stamps: Stamps,
    /// Whether the next frame has been rejected already, for what was said about it.
    is_rejected: bool,
    /// Answers that are being waited for: at most two a frame that is in the stream.
    answers: FuturesUnordered<BoxFuture<'static, Answer>>,
}

impl Connection<'_> {
    async fn run(&mut self, incoming: &mut SplitStream<WebSocket>) -> Farewell {
        self.credit = self.messages + self.publication.free_places() as u64;
        if self.outgoing.say(&self.welcome()).await.is_err() {
            return Farewell::Broken;
        }
        let mut chatter = Chatter::new();
        let mut pings = socket::pings();
        let ended = self.stream.ended();
        tokio::pin!(ended);
        loop {
            let sent = tokio::select! {
                message = timeout(SILENCE, incoming.next()) => match message {
                    Err(_) => return Farewell::Ours(CLOSE_SILENT, "no sign of life"),
                    Ok(None) => return Farewell::Broken,
                    Ok(Some(Err(error))) => return broken(&error),
                    Ok(Some(Ok(Message::Close(_)))) => return Farewell::Theirs,
                    Ok(Some(Ok(Message::Ping(_) | Message::Pong(_)))) if chatter.is_too_much() => {
                        return Farewell::Ours(CLOSE_CHATTER, "too many pings");
                    }
                    Ok(Some(Ok(message))) => self.take(message).await,
                },
                Some(answer) = self.answers.next(), if !self.answers.is_empty() => {
                    self.answer(answer).await
                }
                () = self.publication.superseded() => {
                    return Farewell::Ours(CLOSE_SUPERSEDED, "another publisher has taken over");
                }
                () = self.access.expired() => {
                    return Farewell::Ours(CLOSE_EXPIRED, "the token has expired");
                }
                reason = &mut ended => {
                    self.say_last_answers().await;
                    let (code, reason) = socket::close_of(reason);
                    return Farewell::Ours(code, reason);
                }
                _ = pings.tick() => self.outgoing.ping().await,
            };
            if sent.is_err() || self.grant().await.is_err() {
                return Farewell::Broken;
            }
        }
    }

    /// What became of the frames that are in, now that the stream has ended: all of it is known.
    async fn say_last_answers(&mut self) {
        let answering = async {
            while let Some(answer) = self.answers.next().await {
                if self.answer(answer).await.is_err() {
                    return;
                }
            }
        };
        timeout(GOODBYE, answering).await.ok();
    }

    fn welcome(&self) -> PublishReply {
        PublishReply::Welcome {
            protocol: SUBPROTOCOL.to_owned(),
            stream: self.stream.name().to_string(),
            session: self.publication.session().as_str().to_owned(),
            latest_seq: self.stream.latest_accepted(),
            credit: self.credit,
            config: self.stream.configured().config.clone(),
        }
    }

    async fn take(&mut self, message: Message) -> Result<(), NotSent> {
        match message {
            Message::Text(text) => match serde_json::from_str(&text) {
                Ok(PublisherMessage::Frame {
                    seq,
                    capture_time_us,
                }) => {
                    self.stamps = Stamps::new(seq, capture_time_us);
                    Ok(())
                }
                // It was about the next frame, which is therefore not what it was to be.
                Err(_) if self.is_rejected => Ok(()),
                Err(error) => {
                    self.is_rejected = true;
                    let problem = Problem::bad_request(format!("the text message: {error}"));
                    self.reject(self.messages, problem).await
                }
            },
            Message::Binary(bytes) => {
                let number = self.messages;
                self.messages += 1;
                let stamps = std::mem::take(&mut self.stamps);
                if std::mem::take(&mut self.is_rejected) {
                    return Ok(());
                }
                match self.hand_in(stamps, bytes) {
                    Ok(ticket) => {
                        self.answers.push(Box::pin(accepted(number, ticket)));
                        Ok(())
                    }
                    Err(problem) => self.reject(number, problem).await,
                }
            }
            Message::Ping(_) | Message::Pong(_) | Message::Close(_) => Ok(()),
        }
    }

    fn hand_in(&self, stamps: Stamps, bytes: Bytes) -> Result<Ticket, Problem> {
        let place = self.publication.reserve()?;
        let format = sniffed_format(&bytes)?;
        let stamps = with_native_stamps(stamps, format, &bytes)?;
        Ok(place.submit(Submission {
            bytes,
            format,
            seq: stamps.seq,
            capture_time_us: stamps.capture_time_us,
            arrived: Instant::now(),
        })?)
    }

    async fn reject(&mut self, message: u64, problem: Problem) -> Result<(), NotSent> {
        if problem.is_rejection() {
            self.stream.count_rejected();
        }
        let problem = problem.into_document();
        let state = FrameState::Rejected { problem };
        self.outgoing
            .say(&PublishReply::Ack { message, state })
            .await
    }

    async fn answer(&mut self, answer: Answer) -> Result<(), NotSent> {
        let Answer { message, state } = answer;
        match &state {
            FrameState::Accepted { seq } => {
                let (stream, seq) = (Arc::clone(self.stream), *seq);
                self.answers.push(Box::pin(out(message, seq, stream)));
            }
            FrameState::Rejected { .. } => self.stream.count_rejected(),
            _ => {}
        }
        self.outgoing
            .say(&PublishReply::Ack { message, state })
            .await
    }

    /// Tells the publisher when there is more room than it knows of.
    async fn grant(&mut self) -> Result<(), NotSent> {
        let credit = self.messages + self.publication.free_places() as u64;
        if credit <= self.credit {
            return Ok(());
        }
        self.credit = credit;
        self.outgoing.say(&PublishReply::Credit { credit }).await
    }
}

/// The first answer to a frame.
async fn accepted(message: u64, ticket: Ticket) -> Answer {
    let state = match ticket.accepted().await {
        Ok(accepted) if accepted.duplicate => FrameState::Duplicate { seq: accepted.seq },
        Ok(accepted) => FrameState::Accepted { seq: accepted.seq },
        Err(refused) => FrameState::Rejected {
            problem: Problem::from(refused).into_document(),
        },
    };
    Answer { message, state }
}

/// The second one, to a frame that was accepted.
async fn out(message: u64, seq: u64, stream: Arc<Stream>) -> Answer {
    let dropped = |reason| FrameState::Dropped { seq, reason };
    let state = match stream.outcome(seq).await {
        Some(Outcome::Delivered(_)) => FrameState::Published { seq },
        Some(Outcome::Lost(Loss::Overload)) => dropped(DropReason::Overload),
        Some(Outcome::Lost(Loss::Failed)) => dropped(DropReason::Failed),
        None => dropped(DropReason::Ended),
    };
    Answer { message, state }
}

/// A message over the limit is the publisher's mistake, anything else the network's.
fn broken(error: &axum::Error) -> Farewell {
    use std::error::Error;
    let mut cause = error.source();
    while let Some(error) = cause {
        if let Some(tungstenite::Error::Capacity(_)) = error.downcast_ref() {
            let reason = "a message over limits.body_bytes";
            return Farewell::Ours(close_code::SIZE, reason);
        }
        cause = error.source();
    }
    Farewell::Broken
}
