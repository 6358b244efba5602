//! Frames out, by WebSocket.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{Message, WebSocket};
use axum::response::Response;
use futures_util::StreamExt;
use futures_util::stream::SplitStream;
use serde::Deserialize;
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::stream::{ControlMessage, EndReason};
use tokio::time::timeout;

use crate::streams::{Delivery, Seat, Stream, Subscription};

use super::App;
use super::access::Access;
use super::auth::Scope;
use super::error::Problem;
use super::extract::{Asking, Strict};
use super::socket::{
    self, CLOSE_CHATTER, CLOSE_EXPIRED, CLOSE_SILENT, CLOSE_TOO_FAR_BEHIND, Chatter, Handshake,
    NotSent, Outgoing, SILENCE, text_of,
};
use super::textures::{Sent, Textures};

/// Players say nothing but pongs and farewells.
const MAX_MESSAGE_BYTES: usize = 4096;
/// Frames that are sent with one flush, at most.
const MAX_BATCH: usize = 16;

/// What a player may wish for.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wishes {
    /// At most so many frames a second; the newest ones.
    max_fps: Option<f64>,
    /// How it wants to have images.
    #[serde(default)]
    textures: Textures,
    /// Has been read as a credential.
    #[serde(rename = "ticket")]
    _ticket: Option<String>,
}

impl Wishes {
    /// The least time between two frames.
    fn pace(&self) -> Result<Duration, Problem> {
        match self.max_fps {
            None => Ok(Duration::ZERO),
            Some(fps) if (0.01..=1000.0).contains(&fps) => Ok(Duration::from_secs_f64(1.0 / fps)),
            Some(fps) => Err(Problem::bad_request(format!(
                "max_fps is {fps}: it must be from 0.01 to 1000"
            ))),
        }
    }
}

/// Why a connection ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Farewell {
    Ended(EndReason),
    /// A message did not get through in time.
    TooFarBehind,
    /// The token is no longer good.
    Expired,
    /// No pong has come back for too long.
    Silent,
    /// It floods us with pings.
    Chatter,
    /// The player has closed, or broken the protocol.
    Theirs,
}

/// `GET /v1/streams/{stream}/subscribe`.
pub(super) async fn subscribe(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(wishes): Strict<Wishes>,
    handshake: Handshake,
) -> Result<Response, Problem> {
    let access = app.authorize(&credential, Scope::Subscribe, &name)?;
    let (pace, textures) = (wishes.pace()?, wishes.textures);
    // Before the handshake is judged, so that a plain GET learns whether the stream is there.
    let stream = app.stream(&name)?;
    let handshake = socket::accept(handshake)?;
    let limit = app.options().max_subscribers;
    let Some(seat) = stream.take_seat(limit) else {
        return Err(Problem::over_limit(format!(
            "the stream has {limit} players, which is limits.subscribers_per_stream"
        )));
    };
    let shared = Arc::clone(&app);
    let serve = async move |socket, access| {
        app.telemetry.connections.inc();
        let reader = Reader {
            seat,
            access,
            pace,
            textures,
        };
        serve(socket, &reader, app.options().send_timeout).await;
        app.telemetry.connections.dec();
    };
    let limit = MAX_MESSAGE_BYTES;
    Ok(socket::open(&shared, handshake, access, limit, serve))
}

/// A player that has been let in.
struct Reader {
    seat: Seat,
    access: Access,
    /// The least time between two frames.
    pace: Duration,
    textures: Textures,
}

/// Sends frames until one side has enough.
async fn serve(socket: WebSocket, reader: &Reader, send_timeout: Duration) {
    let (sink, mut incoming) = socket.split();
    let mut outgoing = Outgoing::new(sink, send_timeout);
    let farewell = tokio::select! {
        farewell = send_frames(&mut outgoing, reader) => farewell,
        farewell = listen(&mut incoming) => farewell,
        () = reader.access.expired() => Farewell::Expired,
    };
    tracing::debug!(stream = %reader.seat.stream().name(), ?farewell, "subscriber leaves");
    let leave = match farewell {
        Farewell::Ended(reason) => socket::close_of(reason),
        Farewell::TooFarBehind => (CLOSE_TOO_FAR_BEHIND, "too far behind"),
        Farewell::Expired => (CLOSE_EXPIRED, "the token has expired"),
        Farewell::Silent => (CLOSE_SILENT, "no sign of life"),
        Farewell::Chatter => (CLOSE_CHATTER, "too many pings"),
        Farewell::Theirs => return outgoing.finish().await,
    };
    socket::take_leave(&mut outgoing, &mut incoming, leave).await;
}

async fn send_frames(outgoing: &mut Outgoing, reader: &Reader) -> Farewell {
    let mut subscription = reader.seat.subscribe();
    if outgoing.say(&hello(reader.seat.stream())).await.is_err() {
        return Farewell::TooFarBehind;
    }
    let mut pings = socket::pings();
    let mut images = (reader.textures, Sent::default());
    loop {
        let sent = tokio::select! {
            delivery = subscription.next_paced(reader.pace) => {
                if let Delivery::End(reason) = delivery {
                    // Whether or not this gets through, it is over.
                    outgoing.say(&ControlMessage::End { reason }).await.ok();
                    return Farewell::Ended(reason);
                }
                deliver(outgoing, &delivery, &mut subscription, &mut images).await
            }
            _ = pings.tick() => outgoing.ping().await,
        };
        if sent.is_err() {
            return Farewell::TooFarBehind;
        }
    }
}

/// Sends a delivery and what else is there already, with one flush for all of it: a reader that
/// is behind costs less than one that is not.
async fn deliver(
    outgoing: &mut Outgoing,
    first: &Delivery,
    subscription: &mut Subscription,
    images: &mut (Textures, Sent),
) -> Result<(), NotSent> {
    outgoing.feed(message_of(first, images)?).await?;
    for _ in 1..MAX_BATCH {
        let Some(next) = subscription.next_if_there() else {
            break;
        };
        outgoing.feed(message_of(&next, images)?).await?;
    }
    outgoing.flush().await
}

fn message_of(
    delivery: &Delivery,
    (wishes, sent): &mut (Textures, Sent),
) -> Result<Message, NotSent> {
    match delivery {
        Delivery::Frame(frame) if *wishes == Textures::Inline && sent.is_new(&frame.metrics) => {
            Ok(Message::Binary(frame.message_with_image()))
        }
        Delivery::Frame(frame) => Ok(Message::Binary(frame.message.clone())),
        Delivery::Skipped(missed) => text_of(&ControlMessage::Skipped { missed: *missed }),
        Delivery::End(reason) => text_of(&ControlMessage::End { reason: *reason }),
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
    let mut chatter = Chatter::new();
    loop {
        match timeout(SILENCE, incoming.next()).await {
            Err(_) => return Farewell::Silent,
            Ok(None | Some(Err(_) | Ok(Message::Close(_)))) => return Farewell::Theirs,
            Ok(Some(Ok(_))) if chatter.is_too_much() => return Farewell::Chatter,
            Ok(Some(Ok(_))) => {}
        }
    }
}
