//! A recording as a stream again: the messages of `subscribe`, at any speed and from any place.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use axum::extract::{Path, State};
use axum::response::Response;
use futures_util::StreamExt;
use serde::Deserialize;
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::recording::{PlayerMessage, RecordingState, Track};
use steadymesh_proto::stream::{ControlMessage, EndReason};
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Instant, sleep_until};

use crate::storage::{Cursor, ReadFailed, Recording, RecordingKey, Start, StoredFrame};

use super::App;
use super::access::Access;
use super::auth::Scope;
use super::error::Problem;
use super::extract::{Asking, Strict};
use super::recordings;
use super::socket::{
    self, CLOSE_CHATTER, CLOSE_EXPIRED, CLOSE_SILENT, CLOSE_TOO_FAR_BEHIND, Chatter, Handshake,
    NotSent, Outgoing, SILENCE,
};
use super::textures::{self, Sent, Textures};

/// Players say little.
const MAX_MESSAGE_BYTES: usize = 4096;
const MAX_SPEED: f64 = 100.0;
/// Slower than this is a pause.
const MIN_SPEED: f64 = 0.01;
/// Where nothing was captured for longer, or the rig's clock was set, the player waits no longer.
const MAX_PAUSE: Duration = Duration::from_secs(5);
/// A player that is further behind the recording's time does not catch up.
const MAX_BEHIND: Duration = Duration::from_secs(1);
/// How often it is looked at whether a recording that goes on has grown.
const LOOK_AGAIN: Duration = Duration::from_millis(500);

/// How a recording is to be played.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wishes {
    #[serde(default = "normal")]
    speed: f64,
    from_seq: Option<u64>,
    from_us: Option<u64>,
    /// How it wants to have images.
    #[serde(default)]
    textures: Textures,
    /// Has been read as a credential.
    #[serde(rename = "ticket")]
    _ticket: Option<String>,
}

fn normal() -> f64 {
    1.0
}

/// `GET /v1/recordings/{stream}/{id}/play`.
pub(super) async fn play(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id)): Path<(String, String)>,
    Strict(wishes): Strict<Wishes>,
    handshake: Handshake,
) -> Result<Response, Problem> {
    let access = app.authorize(&credential, Scope::Subscribe, &name)?;
    let start = recordings::start(wishes.from_seq, wishes.from_us)?;
    let speed = Speed::new(wishes.speed).ok_or_else(|| {
        Problem::bad_request(format!(
            "speed is {}: it must be from {MIN_SPEED} to {MAX_SPEED}, or 0 for as fast as it is taken",
            wishes.speed
        ))
    })?;
    // Before the handshake is judged, so that a plain GET learns whether it is there.
    let recording = app.recording(&name, &id).await?;
    let cursor = recording.cursor(Track::Output, start)?;
    let handshake = socket::accept(handshake)?;
    let Ok(place) = Arc::clone(&app.playbacks).try_acquire_owned() else {
        let limit = app.options().max_playbacks;
        return Err(Problem::over_limit(format!(
            "{limit} recordings are being played, which is limits.playbacks"
        )));
    };
    let player = Player {
        key: RecordingKey {
            stream: name.to_string(),
            id,
        },
        app: Arc::clone(&app),
        recording,
        cursor,
        clock: Clock::new(speed),
        next: None,
        start,
        last_seq: None,
        look_again: None,
        is_over: false,
        textures: wishes.textures,
        sent: Sent::default(),
        _place: place,
    };
    let shared = Arc::clone(&app);
    let serve = async move |socket, access| {
        shared.telemetry.connections.inc();
        serve(socket, player, &access).await;
        shared.telemetry.connections.dec();
    };
    Ok(socket::open(
        &app,
        handshake,
        access,
        MAX_MESSAGE_BYTES,
        serve,
    ))
}

/// How fast: a share of the speed at which it was captured, 0 for as fast as it is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Speed(f64);

impl Speed {
    fn new(speed: f64) -> Option<Self> {
        // A NaN is in no range.
        let is_usable = speed == 0.0 || (MIN_SPEED..=MAX_SPEED).contains(&speed);
        is_usable.then_some(Self(speed))
    }
}

/// When the next frame is due.
#[derive(Debug)]
struct Clock {
    speed: Speed,
    is_paused: bool,
    /// The last frame's time, and when it was due; none at the beginning and after a jump.
    last: Option<(u64, Instant)>,
}

impl Clock {
    fn new(speed: Speed) -> Self {
        Self {
            speed,
            is_paused: false,
            last: None,
        }
    }

    /// When a frame of this time is due; none while it is paused.
    fn due(&self, time_us: u64, now: Instant) -> Option<Instant> {
        let Some((last_us, last_due)) = self.last else {
            return Some(now);
        };
        if self.is_paused {
            return None;
        }
        if self.speed.0 == 0.0 {
            return Some(now);
        }
        let between = Duration::from_micros(time_us.saturating_sub(last_us)).min(MAX_PAUSE);
        Some(last_due + between.div_f64(self.speed.0))
    }

    /// A frame of this time, which was due then, has been sent.
    fn sent(&mut self, time_us: u64, due: Instant, now: Instant) {
        let is_behind = due + MAX_BEHIND < now;
        self.last = Some((time_us, if is_behind { now } else { due }));
    }

    fn pause(&mut self) {
        self.is_paused = true;
    }

    fn resume(&mut self, now: Instant) {
        if std::mem::take(&mut self.is_paused)
            && let Some((_, due)) = &mut self.last
        {
            *due = now;
        }
    }
}

/// What one player sees.
struct Player {
    key: RecordingKey,
    app: Arc<App>,
    recording: Arc<Recording>,
    cursor: Cursor,
    clock: Clock,
    /// The frame that is sent next.
    next: Option<StoredFrame>,
    /// Where it began, or jumped to.
    start: Start,
    /// The last frame that was sent since.
    last_seq: Option<u64>,
    /// When to look whether the recording has grown.
    look_again: Option<Instant>,
    /// There are no more frames; a player that is paused may still jump back.
    is_over: bool,
    textures: Textures,
    sent: Sent,
    _place: OwnedSemaphorePermit,
}

/// Why a connection ends.
#[derive(Debug, Clone, Copy)]
enum Farewell {
    /// Nothing more is to be sent.
    Finished,
    /// The server stops.
    Shutdown,
    /// The rest cannot be read.
    Unreadable,
    TooFarBehind,
    Silent,
    Chatter,
    /// The player has closed, or broken the protocol.
    Theirs,
    /// It has said what cannot be understood.
    Nonsense,
}

async fn serve(socket: WebSocket, mut player: Player, access: &Access) {
    let app = Arc::clone(&player.app);
    let send_timeout = app.options().send_timeout;
    let (sink, mut incoming) = socket.split();
    let mut outgoing = Outgoing::new(sink, send_timeout);
    let farewell = tokio::select! {
        farewell = player.run(&mut outgoing, &mut incoming) => farewell,
        () = app.stop.cancelled() => Farewell::Shutdown,
        () = access.expired() => {
            let leave = (CLOSE_EXPIRED, "the token has expired");
            return socket::take_leave(&mut outgoing, &mut incoming, leave).await;
        }
    };
    let leave = match farewell {
        Farewell::Finished | Farewell::Shutdown => {
            let reason = match farewell {
                Farewell::Shutdown => EndReason::Shutdown,
                _ => EndReason::Finished,
            };
            // Whether or not this gets through, it is over.
            outgoing.say(&ControlMessage::End { reason }).await.ok();
            socket::close_of(reason)
        }
        Farewell::Unreadable => (1011, "the recording cannot be read on"),
        Farewell::TooFarBehind => (CLOSE_TOO_FAR_BEHIND, "too far behind"),
        Farewell::Silent => (CLOSE_SILENT, "no sign of life"),
        Farewell::Chatter => (CLOSE_CHATTER, "too many messages"),
        Farewell::Nonsense => (1008, "a message that is not understood"),
        Farewell::Theirs => return outgoing.finish().await,
    };
    socket::take_leave(&mut outgoing, &mut incoming, leave).await;
}

impl Player {
    async fn run(
        &mut self,
        outgoing: &mut Outgoing,
        incoming: &mut futures_util::stream::SplitStream<WebSocket>,
    ) -> Farewell {
        if outgoing.say(&self.hello()).await.is_err() {
            return Farewell::TooFarBehind;
        }
        let (mut pings, mut chatter) = (socket::pings(), Chatter::new());
        let mut silence = Instant::now() + SILENCE;
        loop {
            if let Err(farewell) = self.fetch().await {
                return farewell;
            }
            let due = self.due();
            let wait = async {
                match due {
                    Some(due) => sleep_until(due).await,
                    None => std::future::pending().await,
                }
            };
            let sent = tokio::select! {
                () = wait => match self.next.take() {
                    Some(frame) => self.send(outgoing, frame, due).await,
                    None => Ok(()),
                },
                _ = pings.tick() => outgoing.ping().await,
                () = sleep_until(silence) => return Farewell::Silent,
                message = incoming.next() => {
                    silence = Instant::now() + SILENCE;
                    match message {
                        None | Some(Err(_) | Ok(Message::Close(_))) => return Farewell::Theirs,
                        Some(Ok(_)) if chatter.is_too_much() => return Farewell::Chatter,
                        Some(Ok(Message::Text(text))) => match self.hear(&text) {
                            Ok(()) => Ok(()),
                            Err(farewell) => return farewell,
                        },
                        Some(Ok(_)) => Ok(()),
                    }
                }
            };
            if sent.is_err() {
                return Farewell::TooFarBehind;
            }
        }
    }

    fn hello(&self) -> ControlMessage {
        let summary = self.recording.summary();
        ControlMessage::Hello {
            protocol: SUBPROTOCOL.to_owned(),
            stream: summary.stream,
            latest_seq: summary.output.and_then(|output| output.last_seq),
            config: summary.config,
        }
    }

    /// Reads the next frame if it has not been read; what is damaged is left out.
    async fn fetch(&mut self) -> Result<(), Farewell> {
        let is_early = self.look_again.is_some_and(|at| Instant::now() < at);
        if self.next.is_some() || is_early {
            return Ok(());
        }
        if self.is_over {
            return match self.clock.is_paused {
                true => Ok(()),
                false => Err(Farewell::Finished),
            };
        }
        if self.look_again.take().is_some() {
            self.reopen().await?;
        }
        // As many as there are: each attempt goes on behind the damaged one.
        loop {
            match self.cursor.next().await {
                Ok(Some(frame)) => {
                    self.next = Some(frame);
                    return Ok(());
                }
                Ok(None) if self.recording.summary().state == RecordingState::Recording => {
                    self.look_again = Some(Instant::now() + LOOK_AGAIN);
                    return Ok(());
                }
                Ok(None) if self.clock.is_paused => {
                    self.is_over = true;
                    return Ok(());
                }
                Ok(None) => return Err(Farewell::Finished),
                Err(ReadFailed::Damaged { object, reason }) => {
                    tracing::error!(object, reason, "a recording is damaged");
                }
                // Its time has come while it was played.
                Err(ReadFailed::Gone { .. }) => {}
                Err(error) => {
                    tracing::warn!(%error, "a recording cannot be read on");
                    return Err(Farewell::Unreadable);
                }
            }
        }
    }

    /// Sees what has been added to the recording.
    async fn reopen(&mut self) -> Result<(), Farewell> {
        let opened = match self.app.recordings() {
            Ok(recordings) => recordings.find(&self.key).await,
            Err(_) => return Err(Farewell::Unreadable),
        };
        let recording = opened.map_err(|_| Farewell::Unreadable)?;
        let behind = |last: u64| Start::Seq(last.saturating_add(1));
        let start = self.last_seq.map_or(self.start, behind);
        let cursor = recording.cursor(Track::Output, start);
        self.cursor = cursor.map_err(|_| Farewell::Unreadable)?;
        self.recording = recording;
        Ok(())
    }

    fn due(&self) -> Option<Instant> {
        match &self.next {
            Some(frame) => self.clock.due(frame.frame.time_us(), Instant::now()),
            None => self.look_again,
        }
    }

    async fn send(
        &mut self,
        outgoing: &mut Outgoing,
        frame: StoredFrame,
        due: Option<Instant>,
    ) -> Result<(), NotSent> {
        let now = Instant::now();
        let time = frame.frame.time_us();
        self.last_seq = Some(frame.frame.seq);
        let message = textures::recorded(frame.body, self.textures, &mut self.sent);
        outgoing.feed(Message::Binary(message)).await?;
        outgoing.flush().await?;
        self.clock.sent(time, due.unwrap_or(now), now);
        Ok(())
    }

    fn hear(&mut self, text: &str) -> Result<(), Farewell> {
        let message = serde_json::from_str(text).map_err(|_| Farewell::Nonsense)?;
        match message {
            PlayerMessage::Pause {} => self.clock.pause(),
            PlayerMessage::Resume {} => self.clock.resume(Instant::now()),
            PlayerMessage::Speed { speed } => {
                self.clock.speed = Speed::new(speed).ok_or(Farewell::Nonsense)?;
            }
            PlayerMessage::Seek { seq, time_us } => {
                let start = match (seq, time_us) {
                    (Some(seq), None) => Start::Seq(seq),
                    (None, Some(time)) => Start::Time(time),
                    _ => return Err(Farewell::Nonsense),
                };
                let cursor = self.recording.cursor(Track::Output, start);
                self.cursor = cursor.map_err(|_| Farewell::Unreadable)?;
                self.clock.last = None;
                (self.next, self.look_again) = (None, None);
                (self.start, self.last_seq, self.is_over) = (start, None, false);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(speed: f64) -> (Clock, Instant) {
        let (mut clock, now) = (Clock::new(Speed::new(speed).unwrap()), Instant::now());
        assert_eq!(clock.due(7, now), Some(now), "the first frame at once");
        clock.sent(1_000_000, now, now);
        (clock, now)
    }

    #[test]
    fn frames_are_as_far_apart_as_they_were_captured() {
        let later = Duration::from_millis(100);
        let (normal, now) = clock(1.0);
        assert_eq!(normal.due(1_100_000, now), Some(now + later));
        let (double, now) = clock(2.0);
        assert_eq!(double.due(1_100_000, now), Some(now + later / 2));
        let (fast, now) = clock(0.0);
        assert_eq!(fast.due(9_000_000, now), Some(now));
    }

    #[test]
    fn a_clock_that_was_set_does_not_stop_the_player() {
        let (clock, now) = clock(1.0);
        assert_eq!(clock.due(0, now), Some(now));
        let next_year = 1_000_000 + 31_536_000_000_000;
        assert_eq!(clock.due(next_year, now), Some(now + MAX_PAUSE));
    }

    #[test]
    fn while_paused_only_a_jump_shows_a_frame() {
        let (mut clock, now) = clock(1.0);
        clock.pause();
        assert_eq!(clock.due(1_100_000, now), None);
        clock.last = None;
        assert_eq!(clock.due(5, now), Some(now));
        clock.sent(5, now, now);
        assert_eq!(clock.due(6, now), None);
        let later = now + Duration::from_secs(60);
        clock.resume(later);
        let due = clock.due(1_000_005, later).unwrap();
        assert_eq!(due, later + Duration::from_secs(1));
    }
}
