//! Frames between nodes: what gateways accept, workers process, and gateways hand out.
//!
//! There are three logs. *Frames* has every accepted frame until it and its successor have been
//! processed: appended means stored. *Outcomes* has what became of each, in the order of the
//! frames, each once. *Records* has the latest configuration of every stream.
//!
//! [`Bus::in_process`] keeps them in memory, for one process; [`Bus::jet_stream`] in NATS
//! JetStream. One contract holds for both, and `tests/bus.rs` is it. Nothing else knows NATS.

mod frame;
mod in_process;
mod jetstream;

pub use frame::{Frame, InvalidMessage, Outcome, Position, Predecessor, Processed, StreamRecord};
pub use jetstream::Options;

use in_process::InProcess;
use jetstream::JetStream;

use std::sync::Arc;
use std::time::Duration;

/// Why the bus did not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The servers of the bus cannot be reached, or do not answer.
    #[error("the bus cannot be reached: {0}")]
    Unavailable(String),
    /// Another frame of the stream was appended before.
    #[error("another frame of the stream was appended first")]
    Conflict,
    /// The log of frames is as large as it may be.
    #[error("the bus holds as many frames as it may")]
    Full,
    /// What was read is not what is written there.
    #[error(transparent)]
    Invalid(#[from] InvalidMessage),
}

/// Frames between nodes. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Bus(Kind);

#[derive(Debug, Clone)]
enum Kind {
    InProcess(InProcess),
    JetStream(Arc<JetStream>),
}

/// A frame to be processed. Dropped without an answer it comes again, to whoever asks, after a
/// while ([`Options::ack_wait`]).
#[derive(Debug)]
pub struct Job {
    /// The frame.
    pub frame: Frame,
    /// Where it is in the log.
    pub position: Position,
    /// How often it has been given out, this time included.
    pub deliveries: u64,
    ticket: Ticket,
}

#[derive(Debug)]
enum Ticket {
    InProcess(in_process::Ticket),
    JetStream(Box<jetstream::Ticket>),
}

/// Outcomes, in order for each stream.
#[derive(Debug)]
pub struct Outcomes(OutcomesKind);

#[derive(Debug)]
enum OutcomesKind {
    InProcess(in_process::Outcomes),
    JetStream(Box<jetstream::Outcomes>),
}

/// Records of streams, as they change.
#[derive(Debug)]
pub struct Records(RecordsKind);

#[derive(Debug)]
enum RecordsKind {
    InProcess(in_process::Records),
    JetStream(Box<jetstream::Records>),
}

impl Bus {
    /// In the memory of this process. Frames that are not answered for come again after `ack_wait`.
    #[must_use]
    pub fn in_process(ack_wait: Duration, max_frames: usize) -> Self {
        Self(Kind::InProcess(InProcess::new(ack_wait, max_frames)))
    }

    /// In NATS JetStream, whose logs are made if they are not there.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn jet_stream(options: Options) -> Result<Self, BusError> {
        let bus = JetStream::connect(options).await?;
        Ok(Self(Kind::JetStream(Arc::new(bus))))
    }

    /// Whether its servers can be reached at this moment.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        match &self.0 {
            Kind::InProcess(_) => true,
            Kind::JetStream(bus) => bus.is_connected(),
        }
    }

    /// Stores a frame behind the stream's last one, of whatever instance that is. The same frame
    /// appended again is stored once.
    ///
    /// # Errors
    ///
    /// [`BusError::Conflict`] if `behind` is not the last one, [`BusError::Full`] and
    /// [`BusError::Unavailable`], after which the frame may be stored or not.
    pub async fn append(
        &self,
        frame: &Frame,
        behind: Option<Position>,
    ) -> Result<Position, BusError> {
        match &self.0 {
            Kind::InProcess(bus) => bus.append(frame, behind),
            Kind::JetStream(bus) => bus.append(frame, behind).await,
        }
    }

    /// The last frame of a stream that is in the log, without its body.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn last(&self, stream: &str) -> Result<Option<(Position, Frame)>, BusError> {
        match &self.0 {
            Kind::InProcess(bus) => Ok(bus.last(stream)),
            Kind::JetStream(bus) => bus.last(stream).await,
        }
    }

    /// Waits for a frame to be processed, in the order in which they were appended but for those
    /// that come again; none if there is none for a few seconds. Not cancel safe: a frame that is on
    /// its way comes again after a while.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn pull(&self) -> Result<Option<Job>, BusError> {
        match &self.0 {
            Kind::InProcess(bus) => Ok(bus.pull().await),
            Kind::JetStream(bus) => bus.pull().await,
        }
    }

    /// The frame at a position; none if it is not there any more.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn frame(&self, position: Position) -> Result<Option<Frame>, BusError> {
        match &self.0 {
            Kind::InProcess(bus) => Ok(bus.frame(position)),
            Kind::JetStream(bus) => bus.frame(position).await,
        }
    }

    /// Takes a frame out of the log: its successor has been processed.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn forget(&self, position: Position) -> Result<(), BusError> {
        match &self.0 {
            Kind::InProcess(bus) => {
                bus.forget(position);
                Ok(())
            }
            Kind::JetStream(bus) => bus.forget(position).await,
        }
    }

    /// Tells what became of a frame. Told again it is told once.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn publish(&self, processed: &Processed) -> Result<(), BusError> {
        match &self.0 {
            Kind::InProcess(bus) => {
                bus.publish(processed);
                Ok(())
            }
            Kind::JetStream(bus) => bus.publish(processed).await,
        }
    }

    /// Listens to outcomes: the last of every stream, then what comes.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn outcomes(&self) -> Result<Outcomes, BusError> {
        Ok(Outcomes(match &self.0 {
            Kind::InProcess(bus) => OutcomesKind::InProcess(bus.outcomes()),
            Kind::JetStream(bus) => OutcomesKind::JetStream(Box::new(bus.outcomes().await?)),
        }))
    }

    /// Says that a stream begins.
    ///
    /// # Errors
    ///
    /// [`BusError::Conflict`] if there is one of its name that another node began, and
    /// [`BusError::Unavailable`].
    pub async fn begin(&self, stream: &str, record: &StreamRecord) -> Result<(), BusError> {
        match &self.0 {
            Kind::InProcess(bus) => bus.begin(stream, record),
            Kind::JetStream(bus) => bus.begin(stream, record).await,
        }
    }

    /// Says how a stream is configured, or that it has ended. What is older than what is known is not
    /// heard.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn announce(&self, stream: &str, record: &StreamRecord) -> Result<(), BusError> {
        match &self.0 {
            Kind::InProcess(bus) => {
                bus.announce(stream, record);
                Ok(())
            }
            Kind::JetStream(bus) => bus.announce(stream, record).await,
        }
    }

    /// Listens to records: the latest of every stream, then what comes.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`].
    pub async fn records(&self) -> Result<Records, BusError> {
        Ok(Records(match &self.0 {
            Kind::InProcess(bus) => RecordsKind::InProcess(bus.records()),
            Kind::JetStream(bus) => RecordsKind::JetStream(Box::new(bus.records().await?)),
        }))
    }

    /// Frames that wait to be given out, if it can be told.
    pub async fn waiting(&self) -> Option<u64> {
        match &self.0 {
            Kind::InProcess(bus) => Some(bus.waiting()),
            Kind::JetStream(bus) => bus.waiting().await,
        }
    }
}

impl Job {
    /// The frame has been processed, and its outcome is stored.
    ///
    /// # Errors
    ///
    /// [`BusError::Unavailable`]: it may come again.
    pub async fn done(self) -> Result<(), BusError> {
        match self.ticket {
            Ticket::InProcess(ticket) => {
                ticket.done();
                Ok(())
            }
            Ticket::JetStream(ticket) => ticket.done().await,
        }
    }

    /// Gives it back: it comes again, after `delay`.
    pub async fn put_back(self, delay: Duration) {
        match self.ticket {
            Ticket::InProcess(ticket) => ticket.put_back(delay),
            Ticket::JetStream(ticket) => ticket.put_back(delay).await,
        }
    }

    /// Says that it is being worked on, so that it does not come again.
    pub async fn keep(&self) {
        match &self.ticket {
            Ticket::InProcess(ticket) => ticket.keep(),
            Ticket::JetStream(ticket) => ticket.keep().await,
        }
    }
}

impl Outcomes {
    /// Waits for the next one. When the bus is away it waits until it is back, and misses nothing
    /// that is still in the log.
    ///
    /// Cancel safe.
    pub async fn next(&mut self) -> Processed {
        match &mut self.0 {
            OutcomesKind::InProcess(outcomes) => outcomes.next().await,
            OutcomesKind::JetStream(outcomes) => outcomes.next().await,
        }
    }
}

impl Records {
    /// Waits for the next one, as [`Outcomes::next`] does.
    ///
    /// Cancel safe.
    pub async fn next(&mut self) -> (String, StreamRecord) {
        match &mut self.0 {
            RecordsKind::InProcess(records) => records.next().await,
            RecordsKind::JetStream(records) => records.next().await,
        }
    }
}
