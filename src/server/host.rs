//! By which names the server may be asked.
//!
//! A page whose author controls its name can have that name point to this machine, and then talk
//! to a server here as if both were of one origin (DNS rebinding). The name that the page asked
//! for gives it away. A server that is open and listens on this machine alone takes its own names
//! only; any other does where the configuration says which.

use std::net::{IpAddr, Ipv6Addr};
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderValue, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::App;
use super::error::Problem;

/// Refuses requests for other hosts.
pub(super) async fn check(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let options = app.options();
    let listed = &options.allowed_hosts;
    let is_local_and_open = app.is_open() && app.listens_on.is_some_and(|at| at.ip().is_loopback());
    if listed.is_empty() && !is_local_and_open {
        return next.run(request).await;
    }
    // A request without a host is no browser's.
    let asked = request.headers().get_all(header::HOST).iter();
    let asked = asked.map(HeaderValue::as_bytes);
    let asked = asked.chain(request.uri().authority().map(|a| a.as_str().as_bytes()));
    for host in asked {
        if !is_allowed(host, listed) {
            let host = String::from_utf8_lossy(host);
            return Problem::misdirected(format!(
                "this server is not {host}: ask for localhost, or add the name to \
                 http.allowed_hosts in the configuration"
            ))
            .into_response();
        }
    }
    next.run(request).await
}

fn is_allowed(host: &[u8], listed: &[String]) -> bool {
    if listed.iter().any(|listed| listed == "*") {
        return true;
    }
    let Ok(authority) = Authority::try_from(host) else {
        return false;
    };
    // A name may end with the root's dot.
    let host = authority.host().trim_end_matches('.');
    is_loopback(host)
        || listed
            .iter()
            .any(|listed| listed.eq_ignore_ascii_case(host))
}

fn is_loopback(host: &str) -> bool {
    let host = host.to_ascii_lowercase();
    if host == "localhost" || host.ends_with(".localhost") {
        return true;
    }
    let in_brackets = host.strip_prefix('[').and_then(|h| h.strip_suffix(']'));
    let address = match in_brackets {
        Some(inner) => inner.parse().map(|v6: Ipv6Addr| IpAddr::V6(v6)),
        None => host.parse(),
    };
    address.is_ok_and(|address: IpAddr| address.to_canonical().is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_machine_and_listed_ones_are_allowed() {
        let listed = ["Rig.Example".to_owned()];
        for host in [
            "localhost",
            "LOCALHOST:8080",
            "localhost.",
            "page.localhost",
            "127.0.0.1:1",
            "127.9.9.9",
            "[::1]:8080",
            "[::ffff:127.0.0.1]",
            "rig.example:443",
            "rig.example.",
        ] {
            assert!(is_allowed(host.as_bytes(), &listed), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "localhost.evil.example",
            "notlocalhost",
            "127.0.0.1.evil.example",
            "192.168.1.9",
            "[::2]",
            "::1]",
            "evil.rig.example",
            "local host",
        ] {
            assert!(!is_allowed(host.as_bytes(), &listed), "{host}");
        }
        assert!(is_allowed(b"evil.example", &["*".to_owned()]));
    }
}
