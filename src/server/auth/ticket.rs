//! Short-lived tickets, for clients that can send nothing but an address.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use super::Grant;

/// Long enough to open a connection, and too short to be found in a history and used.
pub(in crate::server) const TICKET_LIFETIME: Duration = Duration::from_secs(30);
/// More are not out at a time.
const MAX_TICKETS: usize = 10_000;

/// Tickets that have been issued and not redeemed. Each opens once.
#[derive(Debug, Default)]
pub(in crate::server) struct Tickets {
    issued: Mutex<HashMap<String, (Grant, SystemTime)>>,
}

impl Tickets {
    /// Issues a ticket of these random bytes; none if too many are out.
    pub fn issue(&self, grant: Grant, random: [u8; 16], now: SystemTime) -> Option<String> {
        let mut issued = self.issued.lock().unwrap_or_else(PoisonError::into_inner);
        issued.retain(|_, (_, expires)| now < *expires);
        if MAX_TICKETS <= issued.len() {
            return None;
        }
        let ticket: String = random.iter().map(|byte| format!("{byte:02x}")).collect();
        issued.insert(ticket.clone(), (grant, now + TICKET_LIFETIME));
        Some(ticket)
    }

    /// Redeems a ticket. A map's lookup is not constant in time, but a ticket is 128 random bits
    /// that live for seconds and open once.
    pub fn redeem(&self, ticket: &str, now: SystemTime) -> Option<Grant> {
        let mut issued = self.issued.lock().unwrap_or_else(PoisonError::into_inner);
        let (grant, expires) = issued.remove(ticket)?;
        (now < expires).then_some(grant)
    }
}
