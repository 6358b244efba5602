//! Frames out, by WebSocket.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::Response;
use futures_util::StreamExt;
use futures_util::stream::SplitStream;
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::stream::{ControlMessage, EndReason};
use tokio::time::timeout;

use crate::streams::{Delivery, Stream};

use super::App;
use super::error::Problem;
use super::extract::{Name, NoParameters, Strict};
use super::socket::{self, CLOSE_SILENT, CLOSE_TOO_FAR_BEHIND, NotSent, Outgoing, SILENCE};

/// Players say nothing but pongs and farewells.
const MAX_MESSAGE_BYTES: usize = 4096;
/// How long a player may take to say goodbye too.
const GOODBYE: Duration = Duration::from_secs(1);

/// Why a connection ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Farewell {
    Ended(EndReason),
    /// A message did not get through in time.
    TooFarBehind,
    /// No pong has come back for too long.
    Silent,
    /// The player has closed, or broken the protocol.
    Theirs,
}

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
    let upgrade = socket::accept(upgrade)?;
    let ongoing = app.sockets.token();
    Ok(upgrade
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
    let mut outgoing = Outgoing::new(sink, send_timeout);
    let farewell = tokio::select! {
        farewell = send_frames(&mut outgoing, stream) => farewell,
        farewell = listen(&mut incoming) => farewell,
    };
    tracing::debug!(stream = %stream.name(), ?farewell, "subscriber leaves");
    let (code, reason) = match farewell {
        Farewell::Ended(reason) => socket::close_of(reason),
        Farewell::TooFarBehind => (CLOSE_TOO_FAR_BEHIND, "too far behind"),
        Farewell::Silent => (CLOSE_SILENT, "no sign of life"),
        // The answer to a farewell is automatic.
        Farewell::Theirs => return,
    };
    if outgoing.close(code, reason).await.is_ok() {
        timeout(GOODBYE, listen(&mut incoming)).await.ok();
    }
}

async fn send_frames(outgoing: &mut Outgoing, stream: &Arc<Stream>) -> Farewell {
    let mut subscription = stream.subscribe();
    if outgoing.say(&hello(stream)).await.is_err() {
        return Farewell::TooFarBehind;
    }
    let mut pings = socket::pings();
    loop {
        let sent = tokio::select! {
            delivery = subscription.next() => {
                if let Delivery::End(reason) = delivery {
                    // Whether or not this gets through, it is over.
                    outgoing.say(&ControlMessage::End { reason }).await.ok();
                    return Farewell::Ended(reason);
                }
                deliver(outgoing, delivery).await
            }
            _ = pings.tick() => outgoing.ping().await,
        };
        if sent.is_err() {
            return Farewell::TooFarBehind;
        }
    }
}

async fn deliver(outgoing: &mut Outgoing, delivery: Delivery) -> Result<(), NotSent> {
    match delivery {
        Delivery::Frame(frame) => outgoing.send(Message::Binary(frame.message.clone())).await,
        Delivery::Skipped(missed) => outgoing.say(&ControlMessage::Skipped { missed }).await,
        Delivery::End(reason) => outgoing.say(&ControlMessage::End { reason }).await,
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
            Err(_) => return Farewell::Silent,
            Ok(None | Some(Err(_) | Ok(Message::Close(_)))) => return Farewell::Theirs,
            Ok(Some(Ok(_))) => {}
        }
    }
}
