//! Where a request has its credential.

use axum::extract::FromRequestParts;
use axum::http::header;
use axum::http::request::Parts;
use std::convert::Infallible;
use std::fmt;

/// The subprotocol by which a browser sends its token: it can set no headers.
const PROTOCOL_PREFIX: &str = "bearer.";

/// What a request shows to be let in.
#[derive(Clone, PartialEq, Eq)]
pub(in crate::server) enum Credential {
    None,
    Token(String),
    Ticket(String),
}

/// Credentials do not get into the log by accident.
impl fmt::Debug for Credential {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "None",
            Self::Token(_) => "Token(…)",
            Self::Ticket(_) => "Ticket(…)",
        })
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Credential {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self::of(parts))
    }
}

impl Credential {
    fn of(parts: &Parts) -> Self {
        let header = |name| {
            let values = parts.headers.get_all(name).iter();
            values.filter_map(|value| value.to_str().ok())
        };
        for value in header(header::AUTHORIZATION) {
            if let Some((scheme, token)) = value.split_once(' ')
                && scheme.eq_ignore_ascii_case("bearer")
            {
                return Self::Token(token.trim().to_owned());
            }
        }
        let offered = header(header::SEC_WEBSOCKET_PROTOCOL).flat_map(|value| value.split(','));
        for protocol in offered {
            if let Some(token) = protocol.trim().strip_prefix(PROTOCOL_PREFIX) {
                return Self::Token(token.to_owned());
            }
        }
        let query = parts.uri.query().unwrap_or_default();
        let ticket = query
            .split('&')
            .find_map(|pair| pair.strip_prefix("ticket="));
        ticket.map_or(Self::None, |ticket| Self::Ticket(ticket.to_owned()))
    }
}

/// Whether an offered subprotocol is a credential rather than a protocol.
pub(in crate::server) fn is_credential(protocol: &str) -> bool {
    protocol.starts_with(PROTOCOL_PREFIX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::Request;

    fn of(name: &str, value: &str, uri: &str) -> Credential {
        let request = Request::builder()
            .uri(uri)
            .header(name, value)
            .body(())
            .unwrap();
        Credential::of(&request.into_parts().0)
    }

    #[test]
    fn a_credential_is_found_wherever_a_client_can_put_it() {
        let token = || Credential::Token("abc".to_owned());
        assert_eq!(of("authorization", "Bearer abc", "/"), token());
        assert_eq!(
            of("sec-websocket-protocol", "steadymesh.v1, bearer.abc", "/"),
            token()
        );
        let ticket = Credential::Ticket("t1".to_owned());
        assert_eq!(of("accept", "*/*", "/?seq=1&ticket=t1"), ticket);
        assert_eq!(of("authorization", "Basic abc", "/"), Credential::None);
    }

    #[test]
    fn a_credential_does_not_print_itself() {
        assert!(!format!("{:?}", of("authorization", "Bearer abc", "/")).contains("abc"));
    }
}
