//! What both kinds of WebSocket connections need: the handshake, messages with a deadline, signs
//! of life, and taking leave.

use std::convert::Infallible;
use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::http::request::Parts;
use axum::response::Response;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use serde::Serialize;
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::stream::EndReason;
use tokio::time::{Instant, Interval, MissedTickBehavior, interval_at, timeout};
use tracing::{Instrument, Span};

use super::App;
use super::access::Access;
use super::auth::is_credential;
use super::error::Problem;
use super::request_log::LogSpan;

/// A client is asked for a sign of life this often,
const PING_EVERY: Duration = Duration::from_secs(20);
/// and is taken for gone when there has been none for so long.
pub(super) const SILENCE: Duration = Duration::from_secs(50);

/// How long a client may take to hear the last of it.
pub(super) const GOODBYE: Duration = Duration::from_secs(1);

/// Close codes of our own are 4000 and the HTTP status that means the same.
pub(super) const CLOSE_EXPIRED: u16 = 4401;
pub(super) const CLOSE_SILENT: u16 = 4408;
pub(super) const CLOSE_SUPERSEDED: u16 = 4409;
pub(super) const CLOSE_CHATTER: u16 = 4420;
pub(super) const CLOSE_TOO_FAR_BEHIND: u16 = 4429;

/// Pings and pongs that a client may send at once, and how many a second after that. Each ping
/// is answered, so that a client that floods and never reads would fill our memory with pongs.
const CHATTER_BURST: f64 = 50.0;
const CHATTER_PER_SECOND: f64 = 10.0;

/// Counts what a client says beside frames.
#[derive(Debug)]
pub(super) struct Chatter {
    allowance: f64,
    last: Instant,
}

impl Chatter {
    pub fn new() -> Self {
        Self {
            allowance: CHATTER_BURST,
            last: Instant::now(),
        }
    }

    /// Whether one more message is too much.
    pub fn is_too_much(&mut self) -> bool {
        let now = Instant::now();
        let earned = (now - self.last).as_secs_f64() * CHATTER_PER_SECOND;
        self.last = now;
        self.allowance = (self.allowance + earned).min(CHATTER_BURST) - 1.0;
        self.allowance < 0.0
    }
}

/// A request that may be a handshake.
pub(super) struct Handshake {
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
    /// Under which the connection is logged.
    span: Span,
}

/// A handshake that can be completed.
pub(super) struct Accepted {
    upgrade: WebSocketUpgrade,
    span: Span,
}

impl<S: Send + Sync> FromRequestParts<S> for Handshake {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Infallible> {
        let span = parts.extensions.get::<LogSpan>();
        Ok(Self {
            span: span.map_or_else(Span::none, |span| span.0.clone()),
            upgrade: WebSocketUpgrade::from_request_parts(parts, state).await,
        })
    }
}

/// Checks the handshake and the subprotocol. A client that offers none gets the only one.
///
/// # Errors
///
/// 400 if the request is no handshake, or offers other subprotocols only.
pub(super) fn accept(Handshake { upgrade, span }: Handshake) -> Result<Accepted, Problem> {
    let upgrade = upgrade.map_err(|error| {
        Problem::bad_request(format!(
            "this address speaks WebSocket, subprotocol {SUBPROTOCOL}: {}",
            error.body_text()
        ))
    })?;
    let offered: Vec<String> = upgrade
        .requested_protocols()
        .filter_map(|protocol| protocol.to_str().ok().map(str::to_owned))
        .collect();
    // A credential among them is none of the protocols, and is not repeated to anybody.
    let offered: Vec<_> = offered
        .iter()
        .filter(|protocol| !is_credential(protocol))
        .collect();
    if !offered.is_empty() && !offered.iter().any(|protocol| *protocol == SUBPROTOCOL) {
        return Err(Problem::bad_request(format!(
            "of the subprotocols {} none is spoken here: offer {SUBPROTOCOL}",
            offered
                .iter()
                .map(|p| p.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        )));
    }
    Ok(Accepted {
        upgrade: upgrade.protocols([SUBPROTOCOL]),
        span,
    })
}

/// Completes a handshake that has been accepted, and then serves the connection. The server waits
/// for it when it stops.
pub(super) fn open<S, F>(
    app: &App,
    Accepted { upgrade, span }: Accepted,
    mut access: Access,
    max_message_bytes: usize,
    serve: S,
) -> Response
where
    S: FnOnce(WebSocket, Access) -> F + Send + 'static,
    F: Future<Output = ()> + Send,
{
    let ongoing = app.sockets.token();
    upgrade
        .max_message_size(max_message_bytes)
        .max_frame_size(max_message_bytes)
        .on_upgrade(move |socket| async move {
            access.begin();
            serve(socket, access).instrument(span).await;
            drop(ongoing);
        })
}

/// Says why a connection ends, and reads on for a moment until the client has closed too: one that
/// is dropped with messages in flight is reset, and the client would not learn why.
pub(super) async fn take_leave(
    outgoing: &mut Outgoing,
    incoming: &mut SplitStream<WebSocket>,
    (code, reason): (u16, &'static str),
) {
    if outgoing.close(code, reason).await.is_err() {
        return;
    }
    let theirs = async { while let Some(Ok(_)) = incoming.next().await {} };
    timeout(GOODBYE, theirs).await.ok();
}

/// When to ask for signs of life.
pub(super) fn pings() -> Interval {
    let mut pings = interval_at(Instant::now() + PING_EVERY, PING_EVERY);
    pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
    pings
}

/// The close code and reason for the end of a stream.
pub(super) fn close_of(reason: EndReason) -> (u16, &'static str) {
    match reason {
        EndReason::Deleted => (close_code::NORMAL, "the stream was deleted"),
        EndReason::Idle => (close_code::NORMAL, "the stream ended for lack of frames"),
        EndReason::Shutdown => (close_code::AWAY, "the server is stopping"),
        EndReason::Finished => (close_code::NORMAL, "the recording is over"),
    }
}

/// The message did not get through in time, or the connection is broken.
#[derive(Debug, Clone, Copy)]
pub(super) struct NotSent;

/// The way to one client. What waits here is a batch of messages at most, and what the operating
/// system buffers.
pub(super) struct Outgoing {
    sink: SplitSink<WebSocket, Message>,
    send_timeout: Duration,
}

impl Outgoing {
    pub fn new(sink: SplitSink<WebSocket, Message>, send_timeout: Duration) -> Self {
        Self { sink, send_timeout }
    }

    pub async fn say(&mut self, message: &impl Serialize) -> Result<(), NotSent> {
        self.send(text_of(message)?).await
    }

    pub async fn ping(&mut self) -> Result<(), NotSent> {
        self.send(Message::Ping(bytes::Bytes::new())).await
    }

    async fn close(&mut self, code: u16, reason: &'static str) -> Result<(), NotSent> {
        let reason = Utf8Bytes::from_static(reason);
        self.send(Message::Close(Some(CloseFrame { code, reason })))
            .await
    }

    pub async fn send(&mut self, message: Message) -> Result<(), NotSent> {
        self.feed(message).await?;
        self.flush().await
    }

    /// Lets the answer to the client's own farewell out.
    pub async fn finish(&mut self) {
        // The client may have gone without waiting for it.
        in_time(self.send_timeout, self.sink.close()).await.ok();
    }

    /// Hands a message in that a later flush sends.
    pub async fn feed(&mut self, message: Message) -> Result<(), NotSent> {
        in_time(self.send_timeout, self.sink.feed(message)).await
    }

    pub async fn flush(&mut self) -> Result<(), NotSent> {
        in_time(self.send_timeout, self.sink.flush()).await
    }
}

/// A text message.
pub(super) fn text_of(message: &impl Serialize) -> Result<Message, NotSent> {
    // Plain names and numbers always serialize.
    let text = serde_json::to_string(message).map_err(|_| NotSent)?;
    Ok(Message::Text(text.into()))
}

async fn in_time(
    patience: Duration,
    sent: impl Future<Output = Result<(), axum::Error>>,
) -> Result<(), NotSent> {
    match timeout(patience, sent).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) | Err(_) => Err(NotSent),
    }
}
