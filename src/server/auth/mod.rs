//! Who may do what: tokens with scopes, for some streams, until some time.
//!
//! Without any token configured everybody may do everything, which is why such a server
//! listens on loopback only. A credential is looked for in `Authorization: Bearer`, for
//! browsers in a WebSocket subprotocol `bearer.TOKEN` or as a ticket in the query. None of them
//! is ever logged.

mod credential;
mod jwt;
mod scope;
mod ticket;
mod token;

use std::time::SystemTime;

pub(super) use credential::{Credential, is_credential};
pub use jwt::{JwtAlgorithm, JwtOptions, UnusableKey};
pub use scope::Scope;
pub(super) use ticket::{Claim, TICKET_LIFETIME, Tickets};
pub use token::{Expiry, InvalidHash, TokenHash, TokenOptions};

use serde::{Deserialize, Serialize};

use crate::streams::{StreamName, StreamPattern};
use jwt::JwtVerifier;
use token::Token;

/// What may be configured.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Tokens, of which the server knows the hashes only.
    pub tokens: Vec<TokenOptions>,
    /// How signed tokens are checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jwt: Option<JwtOptions>,
}

impl Options {
    /// Whether any credential is needed.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.tokens.is_empty() && self.jwt.is_none()
    }
}

/// Checks credentials.
#[derive(Debug, Default)]
pub(super) struct Auth {
    tokens: Vec<Token>,
    jwt: Option<JwtVerifier>,
}

/// What a credential opens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Grant {
    /// Whose it is, for the log.
    pub name: String,
    pub scopes: Vec<Scope>,
    pub streams: Vec<StreamPattern>,
    /// After this it opens nothing.
    pub expires: Option<SystemTime>,
}

/// Why a credential does not open something.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum Denied {
    #[error(
        "this server wants a token: send it as \"Authorization: Bearer TOKEN\", or from a \
         browser as the WebSocket subprotocol \"bearer.TOKEN\""
    )]
    Missing,
    #[error("the token is not known here")]
    Unknown,
    #[error("the token has expired")]
    Expired,
    #[error("the token does not have the scope {needed}")]
    Scope { needed: Scope },
    #[error("the token is not for the stream {stream}")]
    Stream { stream: StreamName },
}

impl Auth {
    /// # Errors
    ///
    /// [`UnusableKey`] if the key of signed tokens cannot be used.
    pub fn new(options: &Options) -> Result<Self, UnusableKey> {
        Ok(Self {
            tokens: options.tokens.iter().map(Token::new).collect(),
            jwt: options.jwt.as_ref().map(JwtVerifier::new).transpose()?,
        })
    }

    /// Finds out what a credential opens; none if no credential is needed here. A ticket comes
    /// with a claim on it, which is to be used up when it has opened something.
    ///
    /// # Errors
    ///
    /// [`Denied::Missing`], [`Denied::Unknown`] and [`Denied::Expired`].
    pub fn grant(
        &self,
        credential: &Credential,
        tickets: &Tickets,
        now: SystemTime,
    ) -> Result<Option<(Grant, Option<Claim>)>, Denied> {
        if self.tokens.is_empty() && self.jwt.is_none() {
            return Ok(None);
        }
        let (grant, claim) = match credential {
            Credential::None => return Err(Denied::Missing),
            Credential::Ticket(ticket) => {
                let (grant, claim) = tickets.claim(ticket, now).ok_or(Denied::Unknown)?;
                (grant, Some(claim))
            }
            Credential::Token(token) => (self.grant_of_token(token)?, None),
        };
        if grant.expires.is_some_and(|expires| expires <= now) {
            return Err(Denied::Expired);
        }
        Ok(Some((grant, claim)))
    }

    fn grant_of_token(&self, token: &str) -> Result<Grant, Denied> {
        let hash = TokenHash::of(token);
        // All of them are compared, so that the time does not tell which one is close.
        let mut found = None;
        for known in &self.tokens {
            if known.has_hash(&hash) {
                found = Some(known.grant());
            }
        }
        match (found, &self.jwt) {
            (Some(grant), _) => Ok(grant.clone()),
            (None, Some(jwt)) => jwt.grant(token),
            (None, None) => Err(Denied::Unknown),
        }
    }
}

impl Grant {
    /// Whether it opens `scope` for `stream`.
    ///
    /// # Errors
    ///
    /// [`Denied::Scope`] and [`Denied::Stream`].
    pub fn check(&self, scope: Scope, stream: &StreamName) -> Result<(), Denied> {
        if !self.scopes.iter().any(|has| has.includes(scope)) {
            return Err(Denied::Scope { needed: scope });
        }
        if !self.is_for(stream) {
            return Err(Denied::Stream {
                stream: stream.clone(),
            });
        }
        Ok(())
    }

    /// Whether it is for this stream at all.
    pub fn is_for(&self, stream: &StreamName) -> bool {
        self.streams.iter().any(|pattern| pattern.matches(stream))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn auth(expires: Option<&str>) -> Auth {
        let token = TokenOptions {
            name: "rig".to_owned(),
            hash: TokenHash::of("secret"),
            scopes: vec![Scope::Publish],
            streams: vec!["rig-*".parse().unwrap()],
            expires: expires.map(|text| humantime::parse_rfc3339(text).unwrap().into()),
        };
        Auth::new(&Options {
            tokens: vec![token],
            jwt: None,
        })
        .unwrap()
    }

    fn grant(auth: &Auth, token: &str) -> Result<Option<Grant>, Denied> {
        let credential = Credential::Token(token.to_owned());
        let granted = auth.grant(&credential, &Tickets::default(), SystemTime::now())?;
        Ok(granted.map(|(grant, _)| grant))
    }

    #[test]
    fn without_tokens_everybody_may_do_everything() {
        let auth = Auth::default();
        let granted = auth.grant(&Credential::None, &Tickets::default(), SystemTime::now());
        assert!(granted.is_ok_and(|granted| granted.is_none()));
    }

    #[test]
    fn a_token_opens_its_scopes_for_its_streams_and_nothing_else() {
        let auth = auth(None);
        let granted = grant(&auth, "secret").unwrap().unwrap();
        let stream = |name: &str| StreamName::parse(name).unwrap();
        assert_eq!(granted.check(Scope::Publish, &stream("rig-2")), Ok(()));
        assert_eq!(
            granted.check(Scope::Subscribe, &stream("rig-2")),
            Err(Denied::Scope {
                needed: Scope::Subscribe
            })
        );
        let other = stream("other");
        let denied = Denied::Stream {
            stream: other.clone(),
        };
        assert_eq!(granted.check(Scope::Publish, &other), Err(denied));
        assert_eq!(grant(&auth, "Secret"), Err(Denied::Unknown));
        let missing = auth.grant(&Credential::None, &Tickets::default(), SystemTime::now());
        assert_eq!(missing.err(), Some(Denied::Missing));
    }

    #[test]
    fn a_token_expires() {
        assert!(grant(&auth(Some("2999-01-01T00:00:00Z")), "secret").is_ok());
        let expired = grant(&auth(Some("2020-01-01T00:00:00Z")), "secret");
        assert_eq!(expired, Err(Denied::Expired));
    }

    #[test]
    fn a_ticket_opens_once_and_not_for_long() {
        let auth = auth(None);
        let granted = grant(&auth, "secret").unwrap().unwrap();
        let (tickets, now) = (Tickets::default(), SystemTime::now());
        let claim = |ticket: &str, now| {
            let credential = Credential::Ticket(ticket.to_owned());
            let granted = auth.grant(&credential, &tickets, now)?;
            Ok(granted.and_then(|(_, claim)| claim).unwrap())
        };
        let ticket = tickets.issue(granted.clone(), [1; 16], now).unwrap();
        claim(&ticket, now).unwrap().use_up();
        assert_eq!(claim(&ticket, now).err(), Some(Denied::Unknown));
        let late = tickets.issue(granted, [2; 16], now).unwrap();
        let denied = claim(&late, now + Duration::from_secs(60)).err();
        assert_eq!(denied, Some(Denied::Unknown));
    }

    #[test]
    fn a_ticket_whose_handshake_fails_opens_later_and_never_twice_at_once() {
        let grant = grant(&auth(None), "secret").unwrap().unwrap();
        let (tickets, now) = (Tickets::default(), SystemTime::now());
        let ticket = tickets.issue(grant.clone(), [1; 16], now).unwrap();
        let first = tickets.claim(&ticket, now);
        assert!(tickets.claim(&ticket, now).is_none());
        drop(first);
        let (granted, claim) = tickets.claim(&ticket, now).unwrap();
        assert_eq!(granted, grant);
        claim.use_up();
        assert!(tickets.claim(&ticket, now).is_none());
    }
}
