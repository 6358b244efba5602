//! Frames in, by WebSocket.

use std::sync::Arc;
use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, close_code};
use axum::response::Response;
use bytes::Bytes;
use futures_util::StreamExt;
use futures_util::future::BoxFuture;
use futures_util::stream::{FuturesUnordered, SplitStream};
use serde::Deserialize;
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::stream::{DropReason, FrameState, PublishReply, PublisherMessage};
use tokio::time::{Instant, sleep, timeout};
use tokio_tungstenite::tungstenite;

use crate::streams::{Loss, Outcome, Publication, Session, Stream, Submission, Ticket};

use super::access::Access;
use super::auth::Scope;
use super::connection::Link;
use super::error::Problem;
use super::extract::{Asking, Strict};
use super::ingest::{Stamps, sniffed_format, with_own_stamps};
use super::socket::{
    self, CLOSE_CHATTER, CLOSE_EXPIRED, CLOSE_SILENT, CLOSE_SUPERSEDED, Chatter, Handshake,
    NotSent, Outgoing, SILENCE,
};
use super::{App, Options};

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
    Extension(link): Extension<Link>,
    handshake: Handshake,
) -> Result<Response, Problem> {
    let access = app.authorize(&credential, Scope::Publish, &name)?;
    let handshake = socket::accept(handshake)?;
    let stream = app.registry.get_or_create(&name)?;
    let session = match arrival.session {
        Some(session) => Session::from_client(&session),
        None => new_session()?,
    };
    let publication = stream
        .publish(session, arrival.takeover)
        .map_err(|_| Problem::occupied())?;
    let (options, shared) = (app.options(), Arc::clone(&app));
    let limit = options.max_body_bytes;
    let serve = async move |socket, access| {
        link.count_against(&app.memory);
        let rig = Rig {
            stream,
            publication,
            access,
            link,
        };
        serve(socket, rig, &options).await;
    };
    Ok(socket::open(&shared, handshake, access, limit, serve))
}

fn new_session() -> Result<Session, Problem> {
    let mut random = [0; 16];
    getrandom::fill(&mut random)
        .map_err(|_| Problem::defect("the system has no random numbers to give"))?;
    Ok(Session::new(random))
}

/// A publisher that has been let in.
struct Rig {
    stream: Arc<Stream>,
    publication: Publication,
    access: Access,
    link: Link,
}

async fn serve(socket: WebSocket, rig: Rig, options: &Options) {
    let (sink, mut incoming) = socket.split();
    let mut connection = Connection {
        outgoing: Outgoing::new(sink, options.send_timeout),
        rig: &rig,
        body_timeout: options.body_timeout,
        messages: 0,
        credit: 0,
        stamps: Stamps::default(),
        is_rejected: false,
        answers: FuturesUnordered::new(),
    };
    let farewell = connection.run(&mut incoming).await;
    tracing::debug!(stream = %rig.stream.name(), ?farewell, "publisher leaves");
    match farewell {
        Farewell::Ours(code, reason) => {
            // What still comes is not kept.
            rig.link.stop_counting();
            socket::take_leave(&mut connection.outgoing, &mut incoming, (code, reason)).await;
        }
        Farewell::Theirs => connection.outgoing.finish().await,
        Farewell::Broken => {}
    }
    drop(connection);
    match farewell {
        Farewell::Broken => drop(rig.publication),
        Farewell::Ours(..) | Farewell::Theirs => rig.publication.end(),
    }
}

/// What has become of a frame so far.
struct Answer {
    message: u64,
    state: FrameState,
}

/// One publisher's connection.
struct Connection<'a> {
    outgoing: Outgoing,
    rig: &'a Rig,
    /// How long a frame may wait for memory while it is being received.
    body_timeout: Duration,
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
        self.credit = self.messages + self.rig.publication.free_places() as u64;
        // Where other nodes have it too, the bus is asked how far it has come.
        timeout(socket::GOODBYE, self.rig.stream.known()).await.ok();
        if self.outgoing.say(&self.welcome()).await.is_err() {
            return Farewell::Broken;
        }
        let mut chatter = Chatter::new();
        let mut pings = socket::pings();
        let ended = self.rig.stream.ended();
        let starved = self.rig.link.starved(self.body_timeout);
        let silence = sleep(SILENCE);
        tokio::pin!(ended, starved, silence);
        loop {
            let sent = tokio::select! {
                message = incoming.next() => match message {
                    None => return Farewell::Broken,
                    Some(Err(error)) => return broken(&error),
                    Some(Ok(Message::Close(_))) => return Farewell::Theirs,
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) if chatter.is_too_much() => {
                        return Farewell::Ours(CLOSE_CHATTER, "too many pings");
                    }
                    Some(Ok(message)) => {
                        silence.as_mut().reset(Instant::now() + SILENCE);
                        self.take(message).await
                    }
                },
                () = &mut silence => {
                    return Farewell::Ours(CLOSE_SILENT, "no sign of life");
                }
                () = &mut starved => {
                    return Farewell::Ours(
                        close_code::AGAIN,
                        "no memory for the frame: limits.memory_bytes",
                    );
                }
                Some(answer) = self.answers.next(), if !self.answers.is_empty() => {
                    self.answer(answer).await
                }
                () = self.rig.publication.superseded() => {
                    return Farewell::Ours(CLOSE_SUPERSEDED, "another publisher has taken over");
                }
                () = self.rig.access.expired() => {
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
        timeout(socket::GOODBYE, answering).await.ok();
    }

    fn welcome(&self) -> PublishReply {
        PublishReply::Welcome {
            protocol: SUBPROTOCOL.to_owned(),
            stream: self.rig.stream.name().to_string(),
            session: self.rig.publication.session().as_str().to_owned(),
            latest_seq: self.rig.stream.latest_accepted(),
            credit: self.credit,
            config: self.rig.stream.configured().config.clone(),
        }
    }

    async fn take(&mut self, message: Message) -> Result<(), NotSent> {
        let memory = self.rig.link.take_memory();
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
                let taken = memory.and_then(|memory| Ok((self.hand_in(stamps, bytes)?, memory)));
                match taken {
                    Ok((ticket, memory)) => {
                        let answer = async move {
                            let answer = accepted(number, ticket).await;
                            drop(memory);
                            answer
                        };
                        self.answers.push(Box::pin(answer));
                        Ok(())
                    }
                    Err(problem) => self.reject(number, problem).await,
                }
            }
            Message::Ping(_) | Message::Pong(_) | Message::Close(_) => Ok(()),
        }
    }

    fn hand_in(&self, stamps: Stamps, bytes: Bytes) -> Result<Ticket, Problem> {
        let place = self.rig.publication.reserve()?;
        let format = sniffed_format(&bytes)?;
        let stamps = with_own_stamps(stamps, format, &bytes)?;
        Ok(place.submit(Submission {
            bytes,
            format,
            seq: stamps.seq,
            capture_time_us: stamps.capture_time_us,
            arrived: std::time::Instant::now(),
        })?)
    }

    async fn reject(&mut self, message: u64, problem: Problem) -> Result<(), NotSent> {
        if problem.is_rejection() {
            self.rig.stream.count_rejected();
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
                let (stream, seq) = (Arc::clone(&self.rig.stream), *seq);
                self.answers.push(Box::pin(out(message, seq, stream)));
            }
            FrameState::Rejected { .. } => self.rig.stream.count_rejected(),
            _ => {}
        }
        self.outgoing
            .say(&PublishReply::Ack { message, state })
            .await
    }

    /// Tells the publisher when there is more room than it knows of.
    async fn grant(&mut self) -> Result<(), NotSent> {
        let credit = self.messages + self.rig.publication.free_places() as u64;
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
