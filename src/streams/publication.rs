//! One publisher's hold on a stream.

use std::sync::Arc;

use tokio_util::sync::CancellationToken;

use super::{Place, Refused, Session, Stream};

/// A publisher's connection to a stream, which nobody else has at the same time.
///
/// Dropping it says that the connection broke: the place is kept for a while.
#[derive(Debug)]
pub struct Publication {
    stream: Arc<Stream>,
    session: Session,
    claim: CancellationToken,
}

impl Publication {
    pub(super) fn new(stream: Arc<Stream>, session: Session, claim: CancellationToken) -> Self {
        Self {
            stream,
            session,
            claim,
        }
    }

    /// What the publisher presents to come back.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Waits until another publisher has taken over.
    pub async fn superseded(&self) {
        self.claim.cancelled().await;
    }

    /// Takes a place in the queue.
    ///
    /// # Errors
    ///
    /// [`Refused::QueueFull`] and [`Refused::Ended`].
    pub fn reserve(&self) -> Result<Place, Refused> {
        self.stream.intake().reserve()
    }

    /// How many frames there is room for at this moment.
    #[must_use]
    pub fn free_places(&self) -> usize {
        self.stream.intake().free_places()
    }

    /// Gives the place up: the publisher does not want to come back.
    pub fn end(self) {
        self.stream.release_publisher(&self.claim, false);
    }
}

impl Drop for Publication {
    fn drop(&mut self) {
        // Has no effect after `end` or after somebody has taken over.
        self.stream.release_publisher(&self.claim, true);
    }
}
