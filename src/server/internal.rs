//! What operators' tools ask for, on a listener of its own.

use std::sync::Arc;

use axum::Router;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

use super::App;
use super::error::Problem;

/// The whole route table.
pub(super) fn router(app: Arc<App>) -> Router {
    Router::new()
        .route("/metrics", get(metrics))
        .route("/livez", get(alive))
        .route("/readyz", get(ready))
        .fallback(async || Problem::not_found("there are /metrics, /livez and /readyz"))
        .method_not_allowed_fallback(async || {
            Problem::method_not_allowed("these addresses answer to GET")
        })
        .with_state(app)
}

async fn metrics(State(app): State<Arc<App>>) -> Response {
    let (text, content_type) = app.telemetry.scrape();
    ([(header::CONTENT_TYPE, content_type)], text).into_response()
}

async fn alive() -> &'static str {
    "alive\n"
}

/// Not ready while stopping or cut off, so that nobody is sent here any more.
async fn ready(State(app): State<Arc<App>>) -> Response {
    if app.is_stopping() {
        return (StatusCode::SERVICE_UNAVAILABLE, "stopping\n").into_response();
    }
    if app.bus.as_ref().is_some_and(|bus| !bus.is_connected()) {
        let reason = "the bus cannot be reached\n";
        return (StatusCode::SERVICE_UNAVAILABLE, reason).into_response();
    }
    "ready\n".into_response()
}
