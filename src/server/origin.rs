//! Pages of other origins: let in by configuration only.
//!
//! A browser lets any page open a WebSocket to a server on the same machine, and send frames
//! to it. So a request that names an origin must come from our own page or a configured one.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tower_http::cors::{AllowOrigin, CorsLayer};

use super::App;
use super::error::Problem;
use super::recordings::CAPTURE_TIME;
use super::request_log::REQUEST_ID;

/// Refuses requests of other origins.
pub(super) async fn check(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let Some(origin) = headers.get(header::ORIGIN) else {
        return next.run(request).await;
    };
    if is_same(origin, headers) || is_allowed(&app, origin) {
        return next.run(request).await;
    }
    let origin = String::from_utf8_lossy(origin.as_bytes());
    Problem::forbidden(format!(
        "pages of {origin} may not use this server: add it to http.allowed_origins in the \
         configuration if they are to"
    ))
    .into_response()
}

/// Tells browsers that pages of configured origins may read the answers.
pub(super) fn cors(app: Arc<App>) -> CorsLayer {
    CorsLayer::new()
        .allow_origin(AllowOrigin::predicate(move |origin, _| {
            is_allowed(&app, origin)
        }))
        .allow_methods([Method::GET, Method::POST, Method::PUT, Method::DELETE])
        .allow_headers([
            header::AUTHORIZATION,
            header::CONTENT_TYPE,
            header::IF_NONE_MATCH,
            HeaderName::from_static("prefer"),
            HeaderName::from_static("traceparent"),
            HeaderName::from_static("tracestate"),
            REQUEST_ID,
        ])
        .expose_headers([
            header::CONTENT_LOCATION,
            header::ETAG,
            header::LOCATION,
            header::RETRY_AFTER,
            header::WWW_AUTHENTICATE,
            HeaderName::from_static("preference-applied"),
            CAPTURE_TIME,
            REQUEST_ID,
        ])
}

fn is_allowed(app: &App, origin: &HeaderValue) -> bool {
    let options = app.options();
    let mut allowed = options.allowed_origins.iter();
    allowed.any(|allowed| allowed == "*" || allowed.as_bytes() == origin.as_bytes())
}

/// Whether the page came from the host that is asked now.
fn is_same(origin: &HeaderValue, headers: &HeaderMap) -> bool {
    let authority = || {
        let uri: Uri = origin.to_str().ok()?.parse().ok()?;
        uri.authority().map(ToString::to_string)
    };
    let host = headers
        .get(header::HOST)
        .and_then(|host| host.to_str().ok());
    match (authority(), host) {
        (Some(authority), Some(host)) => authority.eq_ignore_ascii_case(host),
        _ => false,
    }
}
