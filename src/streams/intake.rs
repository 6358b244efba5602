//! The way into a stream: a place in its queue, then a frame, then an answer.

use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use steadymesh_mesh_io::Format;
use steadymesh_proto::stream::Accepted;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc, oneshot};
use tracing::Span;
use tracing::field::Empty;

use crate::processing::NotAFrame;
use crate::telemetry::traces;

use super::Occupied;

/// A frame's body on its way in.
#[derive(Debug)]
pub struct Submission {
    /// The body.
    pub bytes: Bytes,
    /// What it is.
    pub format: Format,
    /// The frame's number, if the rig counts.
    pub seq: Option<u64>,
    /// When it was captured, in microseconds since 1970, if the rig says so.
    pub capture_time_us: Option<u64>,
    /// When the whole body was there.
    pub arrived: Instant,
}

/// Why a frame did not get into the stream.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Refused {
    /// As many frames as the stream may hold are waiting already.
    #[error("the stream's queue is full: frames come faster than they are processed")]
    QueueFull,
    /// The stream has a publisher by connection.
    #[error(transparent)]
    Occupied(#[from] Occupied),
    /// The stream has ended or is about to.
    #[error("the stream has ended")]
    Ended,
    /// The body is not a usable mesh in this format, or too large a one.
    #[error(transparent)]
    NotAFrame(#[from] NotAFrame),
    /// Numbers ascend.
    #[error("the frame's number is {seq}, but frame {latest} has already been accepted")]
    SeqGoesBack {
        /// The frame's number.
        seq: u64,
        /// The newest accepted one.
        latest: u64,
    },
    /// The bus, on which frames are stored, does not take any.
    #[error("the bus does not take frames: {0}")]
    BusAway(String),
    /// A defect.
    #[error("the frame could not be read because of a defect of the server")]
    Panicked,
}

/// A submission with the way back to whoever sent it.
#[derive(Debug)]
pub(super) struct Incoming {
    pub submission: Submission,
    pub reply: oneshot::Sender<Result<Accepted, Refused>>,
    pub place: OwnedSemaphorePermit,
    /// What the frame's way through the stream is part of.
    pub span: Span,
}

/// Where frames are handed in. There are as many places as the channel holds, and each frame
/// has one, so that the channel itself is never full.
#[derive(Debug)]
pub(super) struct Intake {
    sender: mpsc::Sender<Incoming>,
    places: Arc<Semaphore>,
}

/// A place in a stream's queue, taken before the body is read.
#[derive(Debug)]
pub struct Place {
    place: OwnedSemaphorePermit,
    sender: mpsc::Sender<Incoming>,
}

/// The answer to a frame that was handed in.
#[derive(Debug)]
pub struct Ticket(oneshot::Receiver<Result<Accepted, Refused>>);

impl Intake {
    /// An intake with this many places, and the end that the stream's task reads.
    pub fn new(places: usize) -> (Self, mpsc::Receiver<Incoming>) {
        let (sender, receiver) = mpsc::channel(places.max(1));
        let places = Arc::new(Semaphore::new(places.max(1)));
        (Self { sender, places }, receiver)
    }

    /// Takes a place.
    pub fn reserve(&self) -> Result<Place, Refused> {
        if self.sender.is_closed() {
            return Err(Refused::Ended);
        }
        let place = Arc::clone(&self.places).try_acquire_owned();
        Ok(Place {
            place: place.map_err(|_| Refused::QueueFull)?,
            sender: self.sender.clone(),
        })
    }

    /// How many places are free at this moment.
    pub fn free_places(&self) -> usize {
        if self.sender.is_closed() {
            return 0;
        }
        self.places.available_permits()
    }
}

impl Place {
    /// Hands in a frame. Frames are taken in the order of these calls.
    ///
    /// # Errors
    ///
    /// [`Refused::Ended`].
    pub fn submit(self, submission: Submission) -> Result<Ticket, Refused> {
        let (reply, answer) = oneshot::channel();
        let incoming = Incoming {
            submission,
            reply,
            place: self.place,
            span: frame_span(),
        };
        let sent = self.sender.try_send(incoming);
        sent.map(|()| Ticket(answer)).map_err(|_| Refused::Ended)
    }
}

impl Ticket {
    /// Waits until the frame has been accepted or refused.
    ///
    /// # Errors
    ///
    /// [`Refused`] says why the frame does not take part.
    pub async fn accepted(self) -> Result<Accepted, Refused> {
        // A task that ends drops what it has not answered.
        self.0.await.unwrap_or(Err(Refused::Ended))
    }
}

/// The frame's own span if traces are collected, else the one of the request that it came with.
fn frame_span() -> Span {
    let span = tracing::info_span!(target: traces::TARGET, "frame", stream = Empty, seq = Empty, lost = Empty);
    if span.is_disabled() {
        return Span::current();
    }
    span
}
