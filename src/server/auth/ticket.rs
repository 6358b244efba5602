//! Short-lived tickets, for clients that can send nothing but an address.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use super::Grant;

/// Long enough to open a connection, and too short to be found in a history and used.
pub(in crate::server) const TICKET_LIFETIME: Duration = Duration::from_secs(30);
/// More are not out at a time.
const MAX_TICKETS: usize = 10_000;

/// Tickets that have been issued and not used. Each opens once.
#[derive(Debug, Clone, Default)]
pub(in crate::server) struct Tickets {
    issued: Arc<Mutex<HashMap<String, Issued>>>,
}

#[derive(Debug)]
struct Issued {
    grant: Grant,
    expires: SystemTime,
    /// Whether a handshake is going on with it.
    is_claimed: bool,
}

/// A ticket during a handshake, when it opens nothing else. Dropping the claim gives the ticket
/// back.
#[derive(Debug)]
pub(in crate::server) struct Claim {
    tickets: Tickets,
    ticket: String,
}

impl Tickets {
    /// Issues a ticket of these random bytes; none if too many are out.
    pub fn issue(&self, grant: Grant, random: [u8; 16], now: SystemTime) -> Option<String> {
        let mut issued = self.lock();
        issued.retain(|_, ticket| now < ticket.expires);
        if MAX_TICKETS <= issued.len() {
            return None;
        }
        let ticket: String = random.iter().map(|byte| format!("{byte:02x}")).collect();
        let entry = Issued {
            grant,
            expires: now + TICKET_LIFETIME,
            is_claimed: false,
        };
        issued.insert(ticket.clone(), entry);
        Some(ticket)
    }

    /// Claims a ticket for a handshake. A map's lookup is not constant in time, but a ticket is
    /// 128 random bits that live for seconds and open once.
    pub fn claim(&self, ticket: &str, now: SystemTime) -> Option<(Grant, Claim)> {
        let mut issued = self.lock();
        let entry = issued.get_mut(ticket)?;
        if entry.is_claimed || entry.expires <= now {
            return None;
        }
        entry.is_claimed = true;
        let claim = Claim {
            tickets: self.clone(),
            ticket: ticket.to_owned(),
        };
        Some((entry.grant.clone(), claim))
    }

    /// Nothing that panics is done under this lock.
    fn lock(&self) -> MutexGuard<'_, HashMap<String, Issued>> {
        self.issued.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Claim {
    /// The handshake has succeeded: the ticket is used up.
    pub fn use_up(self) {
        self.tickets.lock().remove(&self.ticket);
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // It is no longer there if it has been used up, or has expired.
        if let Some(entry) = self.tickets.lock().get_mut(&self.ticket) {
            entry.is_claimed = false;
        }
    }
}
