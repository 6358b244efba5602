//! The task of a stream whose frames are processed elsewhere: it checks them and puts them on the
//! bus, one after the other. What becomes of them comes back by [`Stream::take_outcome`].

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use futures_util::StreamExt;
use futures_util::future::{BoxFuture, FutureExt};
use futures_util::stream::FuturesOrdered;
use steadymesh_mesh_io::Limits;
use steadymesh_proto::stream::{Accepted, DropReason, EndReason};
use tokio::sync::{mpsc, watch};

use crate::bus::{Bus, BusError, Frame, Outcome, Position, Predecessor, Processed, StreamRecord};
use crate::compute::{ComputePool, JobPanicked, Length};
use crate::processing::prepare;
use crate::stopwatch::microseconds;
use crate::storage::RawFrame;

use super::Refused;
use super::history::{Encoded, Loss};
use super::intake::Incoming;
use super::parts::Request;
use super::relayed::Claim;
use super::stream::Stream;

/// Frames that are being checked at a time.
const READING: usize = 4;
/// How long a publisher waits for a bus that is away, before it is told to come back.
const PATIENCE: Duration = Duration::from_secs(7);
/// Between two attempts to reach it.
const RETRY: Duration = Duration::from_millis(200);
/// How often it is looked whether a frame is gone whose outcome does not come.
const LOOK: Duration = Duration::from_secs(5);
/// A stream that is another gateway's is ended if that does not do it for so many times as long.
const OF_OTHERS: u32 = 4;
/// Between two attempts to be the next.
const CONFLICT: Duration = Duration::from_millis(5);

/// What the task works with.
#[derive(Debug)]
pub(super) struct Relay {
    pub stream: Arc<Stream>,
    pub bus: Bus,
    pub intake: mpsc::Receiver<Incoming>,
    pub pool: Arc<ComputePool>,
    pub limits: Limits,
    pub first_frame_timeout: Duration,
    pub idle_timeout: Duration,
    /// Whether other nodes know of it: it was heard of on the bus.
    pub is_known: bool,
}

/// A body that has been looked at.
struct Read {
    incoming: Incoming,
    checked: Result<(), Refused>,
}

/// The end of the stream's frames on the bus, as far as it is known here.
#[derive(Debug, Clone, Copy, Default)]
struct Last {
    /// The last frame, whatever stream of this name it is of.
    position: Option<Position>,
    /// The same if it is of this one.
    predecessor: Option<Predecessor>,
    /// Whether it has been looked at.
    is_known: bool,
    /// The bus did not answer for so long that nobody waits for it any more.
    is_away: bool,
    /// The bus has failed since other nodes were told of the stream.
    is_in_doubt: bool,
}

impl Relay {
    /// Runs until the stream ends.
    pub async fn run(mut self) {
        let mut requests = self.stream.requests();
        // One that came before this task did.
        requests.mark_changed();
        let reason = self.work(&mut requests).await;
        let requests = self.stream.requests();
        self.stream.counters.queued.store(0, Relaxed);
        // A server that stops leaves the stream to others.
        let is_known = *requests.borrow() == Request::Follow;
        if reason != EndReason::Shutdown && !is_known {
            self.announce(Some(reason)).await;
        }
        self.stream.end(reason);
        tracing::info!(stream = %self.stream.name(), ?reason, "stream ended");
        self.intake.close();
        while self.intake.recv().await.is_some() {}
    }

    async fn work(&mut self, requests: &mut watch::Receiver<Request>) -> EndReason {
        if self.is_known {
            self.look_how_far().await;
        } else if let Err(reason) = self.begin().await {
            return reason;
        }
        let mut reading: FuturesOrdered<BoxFuture<'static, Read>> = FuturesOrdered::new();
        let mut last = Last::default();
        let mut looks = tokio::time::interval(LOOK);
        looks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let idle = tokio::time::sleep(self.first_frame_timeout);
        tokio::pin!(idle);
        let mut closed = false;
        let stream = Arc::clone(&self.stream);
        loop {
            tokio::select! {
                biased;
                Ok(()) = requests.changed() => match *requests.borrow() {
                    Request::Run => {}
                    Request::Drain => self.intake.close(),
                    Request::Delete | Request::Follow => return EndReason::Deleted,
                    Request::Abandon => return EndReason::Shutdown,
                },
                () = stream.changed() => self.announce(None).await,
                Some(read) = reading.next(), if !reading.is_empty() => {
                    if self.admit(read, &mut last).await {
                        idle.as_mut().reset(tokio::time::Instant::now() + self.idle_timeout);
                    }
                }
                incoming = self.intake.recv(), if !closed && reading.len() < READING => {
                    match incoming {
                        Some(incoming) => reading.push_back(self.read(incoming)),
                        None => closed = true,
                    }
                }
                () = stream.relayed().all_settled(), if closed && reading.is_empty() => {
                    return EndReason::Shutdown;
                }
                _ = looks.tick() => self.look_for_lost().await,
                () = &mut idle, if reading.is_empty() && stream.relayed().len() == 0 => {
                    match self.is_idle(&last).await {
                        Ok(()) => return EndReason::Idle,
                        Err(left) => idle.as_mut().reset(tokio::time::Instant::now() + left),
                    }
                }
            }
        }
    }

    /// Whether the stream is to end for lack of frames, or when to look again. A gateway ends what
    /// came through itself, and what is another's only if that does not for a long time.
    async fn is_idle(&self, last: &Last) -> Result<(), Duration> {
        let again = Err(self.idle_timeout.max(RETRY));
        let stream = &self.stream;
        if stream.has_publisher() || !self.bus.is_connected() {
            return again;
        }
        let Ok(found) = self.bus.last(stream.name().as_str()).await else {
            return again;
        };
        let own = found.filter(|(_, found)| found.instance == stream.created_us());
        if let Some((_, frame)) = &own
            && stream.newest_outcome() < Some(frame.seq)
        {
            // It waits for a worker.
            return again;
        }
        let is_ours = match own {
            Some((position, _)) => last.position == Some(position),
            None => !self.is_known || last.position.is_some(),
        };
        let timeout = if is_ours {
            self.idle_timeout
        } else {
            self.idle_timeout * OF_OTHERS
        };
        let quiet = stream.quiet_for().unwrap_or_else(|| stream.age());
        match timeout.checked_sub(quiet) {
            None | Some(Duration::ZERO) => Ok(()),
            // A first frame that was refused has made it: nobody waits for another.
            Some(_) if is_ours && stream.is_unused() => Ok(()),
            Some(left) => Err(left.max(RETRY)),
        }
    }

    /// Gives up the oldest frame that waits for an outcome, if it is on the bus no more: nobody has
    /// processed it in the time for which it is kept, or the bus has lost it.
    async fn look_for_lost(&self) {
        let Some((seq, position)) = self.stream.relayed().overdue(LOOK) else {
            return;
        };
        if let Ok(None) = self.bus.frame(position).await {
            // Its outcome may be on its way.
            tokio::time::sleep(RETRY).await;
            let stream = &self.stream;
            if stream.newest_outcome() < Some(seq) {
                tracing::error!(stream = %stream.name(), seq, "frame lost: it is on the bus no more");
                // As if a worker had said so.
                stream.take_outcome(Processed {
                    stream: stream.name().to_string(),
                    instance: stream.created_us(),
                    seq,
                    outcome: Outcome::Lost(DropReason::Failed),
                });
            }
        }
    }

    /// Tells other nodes that the stream begins. If one of them was faster, this one ends before it
    /// has taken a frame: its publishers are told to come again, and find the other.
    async fn begin(&mut self) -> Result<(), EndReason> {
        let record = self.record(None);
        let began = Instant::now();
        loop {
            match self.bus.begin(self.stream.name().as_str(), &record).await {
                Ok(()) => {
                    self.stream.is_known_to(None);
                    return Ok(());
                }
                Err(BusError::Conflict) => {
                    self.stream.request(Request::Follow);
                    return Err(EndReason::Deleted);
                }
                Err(error) => {
                    // Whoever waits for so long shall not wait for longer.
                    while PATIENCE < began.elapsed()
                        && let Ok(incoming) = self.intake.try_recv()
                    {
                        let refused = Refused::BusAway(error.to_string());
                        incoming.reply.send(Err(refused)).ok();
                    }
                    tokio::time::sleep(RETRY).await;
                }
            }
            if *self.stream.requests().borrow() != Request::Run {
                return Err(EndReason::Shutdown);
            }
        }
    }

    fn record(&self, ended: Option<EndReason>) -> StreamRecord {
        StreamRecord {
            instance: self.stream.created_us(),
            revision: self.stream.revision(),
            config: self.stream.configured().config.clone(),
            ended,
        }
    }

    /// Finds out how far other nodes have come with the stream.
    async fn look_how_far(&self) {
        let began = Instant::now();
        loop {
            match self.bus.last(self.stream.name().as_str()).await {
                Ok(last) => {
                    let own = last.filter(|(_, last)| last.instance == self.stream.created_us());
                    return self.stream.is_known_to(own.map(|(_, last)| last.seq));
                }
                // Frames that come meanwhile wait for the bus anyway.
                Err(_) if PATIENCE < began.elapsed() => return,
                Err(_) => tokio::time::sleep(RETRY).await,
            }
        }
    }

    /// Looks at a body on the pool: what is wrong with it its publisher hears.
    fn read(&self, incoming: Incoming) -> BoxFuture<'static, Read> {
        let name = self.stream.name().as_str();
        incoming.span.record("stream", name);
        let body = incoming.submission.bytes.clone();
        let (format, limits) = (incoming.submission.format, self.limits);
        let pool = Arc::clone(&self.pool);
        async move {
            let checked = pool
                .run(Length::Short, move || {
                    prepare(&body, format, &limits).map(drop)
                })
                .await;
            let checked = match checked {
                Ok(checked) => checked.map_err(Refused::from),
                Err(JobPanicked) => Err(Refused::Panicked),
            };
            Read { incoming, checked }
        }
        .boxed()
    }

    /// Puts a frame on the bus and answers its publisher; false if it is refused.
    async fn admit(&self, read: Read, last: &mut Last) -> bool {
        let Incoming {
            submission,
            reply,
            place,
            span,
        } = read.incoming;
        if let Err(refused) = read.checked {
            reply.send(Err(refused)).ok();
            return false;
        }
        let stream = &self.stream;
        let received = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let mut frame = Frame {
            stream: stream.name().to_string(),
            instance: stream.created_us(),
            seq: 0,
            capture_time_us: submission.capture_time_us,
            received_us: microseconds(received.unwrap_or_default()),
            content_type: submission.format.content_type().to_owned(),
            predecessor: None,
            body: submission.bytes.clone(),
        };
        let arrived = submission.arrived;
        let claim = (arrived, place);
        let stored = self.store(&mut frame, submission.seq, last, claim).await;
        let answer = match stored {
            Ok(is_new) => {
                span.record("seq", frame.seq);
                if is_new {
                    stream.count_received(frame.seq, frame.body.len(), arrived);
                    stream.record_raw(RawFrame {
                        seq: frame.seq,
                        capture_time_us: frame.capture_time_us,
                        content_type: submission.format.content_type(),
                        body: submission.bytes,
                    });
                }
                let queued = stream.relayed().len();
                stream.show_queued(queued);
                Ok(Accepted {
                    seq: frame.seq,
                    queued,
                    duplicate: !is_new,
                })
            }
            Err(refused) => Err(refused),
        };
        let is_accepted = answer.is_ok();
        // Whoever has left does not want to know.
        reply.send(answer).ok();
        is_accepted
    }

    /// Stores a frame behind the stream's last one, whichever gateway that came through. False if
    /// it has been stored before.
    async fn store(
        &self,
        frame: &mut Frame,
        asked: Option<u64>,
        last: &mut Last,
        claim: Claim,
    ) -> Result<bool, Refused> {
        let (began, mut claim) = (Instant::now(), Some(claim));
        // Chosen once: an attempt whose answer was lost must not become two frames.
        let mut chosen = asked;
        loop {
            match self.try_store(frame, chosen, last, &mut claim).await {
                Ok(is_new) => {
                    last.is_away = false;
                    if std::mem::take(&mut last.is_in_doubt) {
                        // The bus may have lost what it was told.
                        self.announce(None).await;
                    }
                    return Ok(is_new);
                }
                Err(Attempt::Refused(refused)) => return Err(refused),
                // Others were faster: behind them.
                Err(Attempt::Bus(BusError::Conflict)) if began.elapsed() < PATIENCE => {
                    (last.is_known, chosen) = (false, asked);
                    tokio::time::sleep(CONFLICT).await;
                }
                Err(Attempt::Bus(BusError::Full)) => return Err(Refused::QueueFull),
                Err(Attempt::Bus(error)) => {
                    last.is_in_doubt = true;
                    if last.is_away || PATIENCE < began.elapsed() {
                        (last.is_known, last.is_away) = (false, true);
                        return Err(Refused::BusAway(error.to_string()));
                    }
                    chosen = chosen.or(Some(frame.seq).filter(|_| last.is_known));
                    tokio::time::sleep(RETRY).await;
                }
            }
        }
    }

    async fn try_store(
        &self,
        frame: &mut Frame,
        asked: Option<u64>,
        last: &mut Last,
        claim: &mut Option<Claim>,
    ) -> Result<bool, Attempt> {
        if !last.is_known {
            let found = self.bus.last(&frame.stream).await.map_err(Attempt::Bus)?;
            last.position = found.as_ref().map(|(position, _)| *position);
            let own = found.filter(|(_, found)| found.instance == frame.instance);
            last.predecessor = own.map(|(position, found)| Predecessor {
                position,
                seq: found.seq,
            });
            last.is_known = true;
        }
        // The bus may have forgotten a frame that has been out for long.
        let latest = last.predecessor.map(|before| before.seq);
        let latest = latest.max(self.stream.latest_accepted());
        let seq = asked.unwrap_or_else(|| latest.map_or(0, |latest| latest.saturating_add(1)));
        if let Some(latest) = latest.filter(|latest| seq <= *latest) {
            // Sent again because an answer was lost, ours or the bus's: it is in already.
            if seq == latest {
                frame.seq = seq;
                return Ok(false);
            }
            return Err(Attempt::Refused(Refused::SeqGoesBack { seq, latest }));
        }
        frame.seq = seq;
        frame.predecessor = last.predecessor;
        // Before it is there: its outcome may be faster than the bus's answer.
        let relayed = self.stream.relayed();
        if let Some(claim) = claim.take() {
            relayed.push(seq, claim);
        }
        let appended = self.bus.append(frame, last.position).await;
        let position = appended.map_err(|error| {
            *claim = relayed.take_back(seq);
            Attempt::Bus(error)
        })?;
        relayed.stored(seq, position);
        last.position = Some(position);
        last.predecessor = Some(Predecessor { position, seq });
        Ok(true)
    }

    /// Tells other nodes how the stream is configured, or that it has ended.
    async fn announce(&self, ended: Option<EndReason>) {
        let record = self.record(ended);
        let began = Instant::now();
        while let Err(error) = self
            .bus
            .announce(self.stream.name().as_str(), &record)
            .await
        {
            if PATIENCE < began.elapsed() {
                tracing::warn!(stream = %self.stream.name(), %error, "other nodes could not be told of the stream");
                return;
            }
            tokio::time::sleep(RETRY).await;
        }
    }
}

/// Why a frame was not stored at once.
enum Attempt {
    Refused(Refused),
    Bus(BusError),
}

impl Stream {
    /// Takes what became of a frame that was on the bus.
    pub(super) fn take_outcome(&self, processed: Processed) {
        let seq = processed.seq;
        if processed.instance != self.created_us() || Some(seq) <= self.newest_outcome() {
            return;
        }
        // Those of other gateways too.
        self.is_known_to(Some(seq));
        let arrived = self.relayed().settle(seq);
        self.show_queued(self.relayed().len());
        let loss = match processed.outcome {
            Outcome::Delivered(message) => match Encoded::read(message) {
                Ok(frame) => return self.deliver_relayed(frame, arrived.is_some()),
                Err(error) => {
                    tracing::error!(stream = %self.name(), seq, %error, "an outcome cannot be read");
                    Loss::Failed
                }
            },
            Outcome::Lost(DropReason::Overload) => Loss::Overload,
            Outcome::Lost(_) => Loss::Failed,
        };
        self.lose(seq, loss, arrived.map(|arrived| arrived.elapsed()));
    }
}
