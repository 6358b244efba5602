//! Streams as such: make, change, list, inspect, end.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use steadymesh_proto::stream::{StreamConfig, StreamList, StreamSummary};

use super::App;
use super::error::Problem;
use super::extract::{JsonBody, Name, NoParameters, Strict};

/// `PUT /v1/streams/{stream}`.
pub(super) async fn put_stream(
    State(app): State<Arc<App>>,
    Name(name): Name,
    Strict(NoParameters {}): Strict<NoParameters>,
    JsonBody(config): JsonBody<StreamConfig>,
) -> Result<Response, Problem> {
    let (stream, is_new) = app.registry.configure(&name, &config)?;
    let summary = Json(stream.summary());
    if is_new {
        let location = format!("/v1/streams/{name}");
        return Ok((StatusCode::CREATED, [(header::LOCATION, location)], summary).into_response());
    }
    Ok(summary.into_response())
}

/// `GET /v1/streams`.
pub(super) async fn list_streams(
    State(app): State<Arc<App>>,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Json<StreamList> {
    let streams = app.registry.list();
    Json(StreamList { streams })
}

/// `GET /v1/streams/{stream}`.
pub(super) async fn get_stream(
    State(app): State<Arc<App>>,
    Name(name): Name,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<Json<StreamSummary>, Problem> {
    let stream = app
        .registry
        .get(&name)
        .ok_or_else(|| Problem::no_stream(&name))?;
    Ok(Json(stream.summary()))
}

/// `DELETE /v1/streams/{stream}`.
pub(super) async fn delete_stream(
    State(app): State<Arc<App>>,
    Name(name): Name,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<StatusCode, Problem> {
    if app.registry.delete(&name) {
        Ok(StatusCode::NO_CONTENT)
    } else {
        Err(Problem::no_stream(&name))
    }
}
