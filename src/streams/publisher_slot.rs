//! Who may publish by connection: one at a time, and one that vanished may come back.

use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

/// Names a publisher's connection and those that continue it; whoever knows it may continue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Session(String);

/// The stream has another publisher.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the stream has another publisher")]
pub struct Occupied;

/// The place of a stream's publisher. Without a clock or chance of its own: both are passed in.
#[derive(Debug, Default)]
pub(super) struct PublisherSlot {
    holder: Option<Holder>,
}

#[derive(Debug)]
struct Holder {
    session: Session,
    /// Cancelled when another publisher takes over.
    superseded: CancellationToken,
    /// Set once the connection has broken.
    kept_until: Option<Instant>,
}

impl Session {
    /// A session of these random bytes.
    #[must_use]
    pub fn new(random: [u8; 16]) -> Self {
        Self(random.iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// What a client sent. Anything may be tried; only a known one opens.
    #[must_use]
    pub fn from_client(text: &str) -> Self {
        Self(text.to_owned())
    }

    /// The text that clients get.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl PublisherSlot {
    /// Takes the place for `session`, which is the holder's if it comes back. The token is
    /// cancelled when somebody takes over.
    pub fn claim(
        &mut self,
        session: Session,
        takeover: bool,
        now: Instant,
    ) -> Result<CancellationToken, Occupied> {
        if let Some(holder) = self.current(now) {
            if holder.session != session && !takeover {
                return Err(Occupied);
            }
            // Also if a publisher comes back before its broken connection was noticed.
            holder.superseded.cancel();
        }
        let superseded = CancellationToken::new();
        self.holder = Some(Holder {
            session,
            superseded: superseded.clone(),
            kept_until: None,
        });
        Ok(superseded)
    }

    /// Makes way for frames that come without a connection.
    pub fn pass(&mut self, takeover: bool, now: Instant) -> Result<(), Occupied> {
        match self.current(now) {
            None => Ok(()),
            Some(_) if !takeover => Err(Occupied),
            Some(holder) => {
                holder.superseded.cancel();
                self.holder = None;
                Ok(())
            }
        }
    }

    /// Gives the place of the connection with this token up, or keeps it for a while if the
    /// connection broke. Does nothing if somebody else has it by now.
    pub fn release(&mut self, token: &CancellationToken, keep: Option<Duration>, now: Instant) {
        // A token that has been cancelled is no longer the holder's.
        if token.is_cancelled() {
            return;
        }
        match (&mut self.holder, keep) {
            (Some(holder), Some(keep)) => holder.kept_until = Some(now + keep),
            (holder, _) => {
                *holder = None;
                // Whatever this connection still says is not about its successor's place.
                token.cancel();
            }
        }
    }

    /// Whether a publisher is connected or expected back.
    pub fn is_held(&mut self, now: Instant) -> bool {
        self.current(now).is_some()
    }

    fn current(&mut self, now: Instant) -> Option<&Holder> {
        let is_over = |holder: &mut Holder| holder.kept_until.is_some_and(|until| until <= now);
        self.holder.take_if(is_over);
        self.holder.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINGER: Duration = Duration::from_secs(5);

    fn session(byte: u8) -> Session {
        Session::new([byte; 16])
    }

    #[test]
    fn a_second_publisher_is_refused_unless_it_takes_over() {
        let (mut slot, now) = (PublisherSlot::default(), Instant::now());
        let first = slot.claim(session(1), false, now).unwrap();
        assert!(slot.claim(session(2), false, now).is_err());
        assert!(slot.pass(false, now).is_err());
        let second = slot.claim(session(2), true, now).unwrap();
        assert!(first.is_cancelled());
        // The first one's farewell does not take the place from the second.
        slot.release(&first, None, now);
        assert!(slot.is_held(now));
        slot.pass(true, now).unwrap();
        assert!(second.is_cancelled());
        assert!(!slot.is_held(now));
    }

    #[test]
    fn a_publisher_that_vanished_finds_its_place_for_a_while() {
        let (mut slot, now) = (PublisherSlot::default(), Instant::now());
        let token = slot.claim(session(1), false, now).unwrap();
        slot.release(&token, Some(LINGER), now);
        let soon = now + LINGER / 2;
        assert!(slot.claim(session(2), false, soon).is_err());
        let token = slot.claim(session(1), false, soon).unwrap();
        slot.release(&token, Some(LINGER), soon);
        assert!(slot.claim(session(2), false, soon + LINGER).is_ok());
    }

    #[test]
    fn a_publisher_that_comes_back_early_ends_its_old_connection() {
        let (mut slot, now) = (PublisherSlot::default(), Instant::now());
        let old = slot.claim(session(1), false, now).unwrap();
        slot.claim(session(1), false, now).unwrap();
        assert!(old.is_cancelled());
    }

    #[test]
    fn a_publisher_that_says_goodbye_gives_its_place_up() {
        let (mut slot, now) = (PublisherSlot::default(), Instant::now());
        let token = slot.claim(session(1), false, now).unwrap();
        slot.release(&token, None, now);
        assert!(slot.claim(session(2), false, now).is_ok());
    }
}
