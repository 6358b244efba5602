//! Sends frames by WebSocket, as many ahead as the server gives credit for.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use futures_util::{FutureExt, SinkExt, StreamExt};
use steadymesh_proto::stream::{FrameState, PublishReply, PublisherMessage};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::{Message, Utf8Bytes};

use super::frame_source::SourceFrame;
use super::remote::{Refusal, Remote, Socket};

/// A server that restarts is back within this time; one that is not is given up.
const PATIENCE: Duration = Duration::from_secs(30);
const FIRST_RETRY: Duration = Duration::from_millis(200);
const MAX_RETRY: Duration = Duration::from_secs(5);

/// What has become of frames since the last question.
#[derive(Debug, Default)]
pub(super) struct Progress {
    /// Frames that the server has accepted.
    pub accepted: u64,
    /// Names of frames that it has refused, with its reasons.
    pub refused: Vec<(String, String)>,
    /// How often there was no credit.
    pub waits: u64,
}

/// A publisher of one stream.
pub(super) struct WebSocketPublisher {
    remote: Remote,
    session: Option<String>,
    socket: Socket,
    /// Frames sent on this connection.
    messages: u64,
    credit: u64,
    next_seq: u64,
    /// Frames that have not been accepted yet, in the order in which they were sent.
    unanswered: VecDeque<Unanswered>,
    progress: Progress,
}

struct Unanswered {
    message: u64,
    seq: u64,
    capture_time_us: Option<u64>,
    frame: SourceFrame,
}

impl WebSocketPublisher {
    /// Connects.
    ///
    /// # Errors
    ///
    /// If the server cannot be reached or refuses.
    pub async fn connect(remote: &Remote, takeover: bool) -> anyhow::Result<Self> {
        let parameters: &[_] = if takeover {
            &[("takeover", "true")]
        } else {
            &[]
        };
        let socket = remote.connect("publish", parameters).await;
        let socket = socket.map_err(explain)?;
        let mut publisher = Self {
            remote: remote.clone(),
            session: None,
            socket,
            messages: 0,
            credit: 0,
            next_seq: 0,
            unanswered: VecDeque::new(),
            progress: Progress::default(),
        };
        let latest = publisher.welcome().await?;
        publisher.next_seq = latest.map_or(0, |latest| latest + 1);
        Ok(publisher)
    }

    /// Sends a frame as soon as there is credit for it, on a new connection if the old one
    /// breaks.
    ///
    /// # Errors
    ///
    /// If the server stays away, or does not want this publisher any more.
    pub async fn send(&mut self, frame: SourceFrame) -> anyhow::Result<()> {
        self.read_what_is_there().await?;
        if self.credit <= self.messages {
            self.progress.waits += 1;
        }
        while self.credit <= self.messages {
            self.read_one().await?;
        }
        let seq = frame
            .recorded
            .map_or(self.next_seq, |recorded| recorded.seq);
        let unanswered = Unanswered {
            message: self.messages,
            seq,
            capture_time_us: frame.capture_time_us()?,
            frame,
        };
        self.next_seq = seq + 1;
        let sent = self.put(&unanswered).await;
        self.unanswered.push_back(unanswered);
        match sent {
            Ok(()) => Ok(()),
            Err(_) => self.reconnect().await,
        }
    }

    /// What has become of frames since this was asked last.
    pub fn progress(&mut self) -> Progress {
        std::mem::take(&mut self.progress)
    }

    /// Waits until all frames have been answered, and says goodbye.
    ///
    /// # Errors
    ///
    /// As [`WebSocketPublisher::send`].
    pub async fn finish(&mut self) -> anyhow::Result<()> {
        while !self.unanswered.is_empty() {
            self.read_one().await?;
        }
        // Everything has its place: whether the farewell arrives does not matter.
        self.socket.close(None).await.ok();
        Ok(())
    }

    async fn put(&mut self, unanswered: &Unanswered) -> anyhow::Result<()> {
        let about = serde_json::to_string(&PublisherMessage::Frame {
            seq: Some(unanswered.seq),
            capture_time_us: unanswered.capture_time_us,
        })?;
        self.messages += 1;
        self.socket
            .feed(Message::Text(Utf8Bytes::from(about)))
            .await?;
        let body = unanswered.frame.body.clone();
        self.socket.send(Message::Binary(body)).await?;
        Ok(())
    }

    async fn read_what_is_there(&mut self) -> anyhow::Result<()> {
        while let Some(message) = self.socket.next().now_or_never() {
            self.take(message).await?;
        }
        Ok(())
    }

    async fn read_one(&mut self) -> anyhow::Result<()> {
        let message = timeout(PATIENCE, self.socket.next()).await;
        let message = message.context("the server has said nothing for half a minute")?;
        self.take(message).await
    }

    async fn take(
        &mut self,
        message: Option<tokio_tungstenite::tungstenite::Result<Message>>,
    ) -> anyhow::Result<()> {
        match message {
            Some(Ok(Message::Text(text))) => {
                self.hear(&text);
                Ok(())
            }
            Some(Ok(Message::Close(Some(close)))) if u16::from(close.code) != 1001 => {
                bail!(
                    "the server ends the connection ({}): {}",
                    u16::from(close.code),
                    close.reason
                )
            }
            Some(Ok(Message::Close(_))) | Some(Err(_)) | None => self.reconnect().await,
            Some(Ok(_)) => Ok(()),
        }
    }

    fn hear(&mut self, text: &str) {
        match serde_json::from_str(text) {
            Ok(PublishReply::Credit { credit }) => self.credit = credit,
            Ok(PublishReply::Ack { message, state }) => self.answered(message, state),
            // Messages of a newer server that are not known here.
            Ok(PublishReply::Welcome { .. }) | Err(_) => {}
        }
    }

    fn answered(&mut self, message: u64, state: FrameState) {
        let refusal = match state {
            FrameState::Accepted { .. } | FrameState::Duplicate { .. } => None,
            FrameState::Rejected { problem } => Some(problem.detail),
            // Whether an accepted frame comes out is between the server and its log.
            FrameState::Published { .. } | FrameState::Dropped { .. } => return,
        };
        let Some(index) = self
            .unanswered
            .iter()
            .position(|frame| frame.message == message)
        else {
            return;
        };
        let Some(Unanswered { frame, .. }) = self.unanswered.remove(index) else {
            return;
        };
        match refusal {
            None => self.progress.accepted += 1,
            Some(reason) => self.progress.refused.push((frame.name, reason)),
        }
    }

    /// Comes back, and sends again what the server has not accepted.
    async fn reconnect(&mut self) -> anyhow::Result<()> {
        let (started, mut delay) = (Instant::now(), FIRST_RETRY);
        let latest = loop {
            self.progress.waits += 1;
            let session = self.session.as_deref().unwrap_or_default();
            let parameters = [("session", session)];
            match self.remote.connect("publish", &parameters).await {
                Ok(socket) => {
                    self.socket = socket;
                    self.messages = 0;
                    break self.welcome().await?;
                }
                Err(error) if is_final(&error) || PATIENCE < started.elapsed() => {
                    return Err(explain(error));
                }
                Err(_) => {
                    tokio::time::sleep(delay).await;
                    delay = (delay * 2).min(MAX_RETRY);
                }
            }
        };
        for mut frame in std::mem::take(&mut self.unanswered) {
            if latest.is_some_and(|latest| frame.seq <= latest) {
                self.progress.accepted += 1;
                continue;
            }
            frame.message = self.messages;
            // No more than were in flight before; the next answer tells if this one breaks too.
            self.put(&frame).await.ok();
            self.unanswered.push_back(frame);
        }
        Ok(())
    }

    /// Reads the first message of a connection; gives the newest accepted number.
    async fn welcome(&mut self) -> anyhow::Result<Option<u64>> {
        let message = timeout(PATIENCE, self.socket.next()).await;
        let Ok(Some(Ok(Message::Text(text)))) = message else {
            bail!("the server does not welcome a publisher");
        };
        match serde_json::from_str(&text).context("the server's welcome cannot be read")? {
            PublishReply::Welcome {
                session,
                latest_seq,
                credit,
                ..
            } => {
                self.session = Some(session);
                self.credit = credit;
                Ok(latest_seq)
            }
            _ => bail!("the server does not welcome a publisher"),
        }
    }
}

/// Whether the server has refused for good.
fn is_final(error: &anyhow::Error) -> bool {
    let refusal = error.downcast_ref::<Refusal>();
    refusal.is_some_and(|refusal| !refusal.may_pass())
}

fn explain(error: anyhow::Error) -> anyhow::Error {
    match error.downcast::<Refusal>() {
        Ok(refusal) => refusal.into_publisher_error(),
        Err(error) => error,
    }
}
