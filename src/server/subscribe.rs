//! Frames out, by WebSocket.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::response::Response;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::stream::{ControlMessage, EndReason};
use tokio::time::{Instant, MissedTickBehavior, interval_at, timeout};

use crate::streams::{Delivery, Stream};

use super::App;
use super::error::Problem;
use super::extract::{Name, NoParameters, Strict};

/// Players say nothing but pongs and farewells.
const MAX_MESSAGE_BYTES: usize = 4096;
/// A player is asked for a sign of life this often,
const PING_EVERY: Duration = Duration::from_secs(20);
/// and is taken for gone when there has been none for so long.
const SILENCE: Duration = Duration::from_secs(50);

/// Why a connection ends from our side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Farewell {
    Ended(EndReason),
    /// No message gets through, or no pong comes back.
    Gone,
    /// The player has closed, or broken the protocol.
    Theirs,
}

type Sink = SplitSink<WebSocket, Message>;

/// `GET /v1/streams/{stream}/subscribe`.
pub(super) async fn subscribe(
    State(app): State<Arc<App>>,
    Name(name): Name,
    Strict(NoParameters {}): Strict<NoParameters>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    // Before the handshake is judged, so that a plain GET learns whether the stream is there.
    let stream = app
        .registry
        .get(&name)
        .ok_or_else(|| Problem::no_stream(&name))?;
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
    // A client that names no subprotocol gets the only one there is.
    if !offered.is_empty() && !offered.iter().any(|protocol| protocol == SUBPROTOCOL) {
        return Err(Problem::bad_request(format!(
            "of the subprotocols {} none is spoken here: offer {SUBPROTOCOL}",
            offered.join(", ")
        )));
    }
    let ongoing = app.sockets.token();
    Ok(upgrade
        .protocols([SUBPROTOCOL])
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_frame_size(MAX_MESSAGE_BYTES)
        .on_upgrade(move |socket| async move {
            app.telemetry.connections.inc();
            serve(socket, &stream, app.options.send_timeout).await;
            app.telemetry.connections.dec();
            drop(ongoing);
        }))
}

/// Sends frames until one side has enough.
async fn serve(socket: WebSocket, stream: &Arc<Stream>, send_timeout: Duration) {
    let (sink, mut incoming) = socket.split();
    let mut outgoing = Outgoing { sink, send_timeout };
    let farewell = tokio::select! {
        farewell = send_frames(&mut outgoing, stream) => farewell,
        farewell = listen(&mut incoming) => farewell,
    };
    tracing::debug!(stream = %stream.name(), ?farewell, "subscriber leaves");
    let code = match farewell {
        Farewell::Ended(EndReason::Shutdown) => close_code::AWAY,
        Farewell::Ended(EndReason::Deleted | EndReason::Idle) => close_code::NORMAL,
        // The connection is closed by dropping it; the answer to a farewell is automatic.
        Farewell::Gone | Farewell::Theirs => return,
    };
    let reason = Utf8Bytes::from_static("the stream has ended");
    if outgoing
        .send(Message::Close(Some(CloseFrame { code, reason })))
        .await
        .is_ok()
    {
        // Gives the player the time to say goodbye too.
        timeout(
            send_timeout.min(Duration::from_secs(1)),
            listen(&mut incoming),
        )
        .await
        .ok();
    }
}

async fn send_frames(outgoing: &mut Outgoing, stream: &Arc<Stream>) -> Farewell {
    let mut subscription = stream.subscribe();
    if outgoing.say(&hello(stream)).await.is_err() {
        return Farewell::Gone;
    }
    let mut pings = interval_at(Instant::now() + PING_EVERY, PING_EVERY);
    pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let sent = tokio::select! {
            delivery = subscription.next() => {
                if let Delivery::End(reason) = delivery {
                    // Whether or not this gets through, it is over.
                    outgoing.say(&ControlMessage::End { reason }).await.ok();
                    return Farewell::Ended(reason);
                }
                outgoing.deliver(delivery).await
            }
            _ = pings.tick() => outgoing.send(Message::Ping(bytes::Bytes::new())).await,
        };
        if sent.is_err() {
            return Farewell::Gone;
        }
    }
}

fn hello(stream: &Stream) -> ControlMessage {
    ControlMessage::Hello {
        protocol: SUBPROTOCOL.to_owned(),
        stream: stream.name().to_string(),
        latest_seq: stream.newest().map(|frame| frame.metrics.seq),
        config: stream.configured().config.clone(),
    }
}

/// Hears the player until it leaves, breaks the protocol, or falls silent. What it says is not
/// of interest; pings are answered and pongs received underneath.
async fn listen(incoming: &mut SplitStream<WebSocket>) -> Farewell {
    loop {
        match timeout(SILENCE, incoming.next()).await {
            Err(_) => return Farewell::Gone,
            Ok(None | Some(Err(_) | Ok(Message::Close(_)))) => return Farewell::Theirs,
            Ok(Some(Ok(_))) => {}
        }
    }
}

/// The way to one player. Each message is flushed before the next one is taken, so that what
/// waits here is one message and the operating system's buffer.
struct Outgoing {
    sink: Sink,
    send_timeout: Duration,
}

/// The message did not get through.
struct NotSent;

impl Outgoing {
    async fn deliver(&mut self, delivery: Delivery) -> Result<(), NotSent> {
        match delivery {
            Delivery::Frame(frame) => self.send(Message::Binary(frame.message.clone())).await,
            Delivery::Skipped(missed) => self.say(&ControlMessage::Skipped { missed }).await,
            Delivery::End(reason) => self.say(&ControlMessage::End { reason }).await,
        }
    }

    async fn say(&mut self, message: &ControlMessage) -> Result<(), NotSent> {
        // Plain names and numbers always serialize.
        let text = serde_json::to_string(message).map_err(|_| NotSent)?;
        self.send(Message::Text(text.into())).await
    }

    async fn send(&mut self, message: Message) -> Result<(), NotSent> {
        match timeout(self.send_timeout, self.sink.send(message)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) | Err(_) => Err(NotSent),
        }
    }
}
