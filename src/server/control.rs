//! Streams as such: make, change, list, inspect, end.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use steadymesh_proto::recording::Record;
use steadymesh_proto::stream::{StreamConfig, StreamList, StreamSummary};

use crate::streams::StreamName;

use super::App;
use super::auth::{Credential, Scope};
use super::error::Problem;
use super::extract::{Asking, JsonBody, NoParameters, Strict};

/// `PUT /v1/streams/{stream}`.
pub(super) async fn put_stream(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(NoParameters {}): Strict<NoParameters>,
    JsonBody(config): JsonBody<StreamConfig>,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Publish, &name)?;
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
    credential: Credential,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<Json<StreamList>, Problem> {
    let grant = app.grant(&credential)?;
    let mut streams = app.registry.list();
    if let Some(grant) = grant {
        // Nobody learns of streams that are not theirs.
        streams.retain(|stream| {
            StreamName::parse(&stream.stream).is_ok_and(|name| grant.is_for(&name))
        });
    }
    Ok(Json(StreamList { streams }))
}

/// `GET /v1/streams/{stream}`.
pub(super) async fn get_stream(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<Json<StreamSummary>, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let stream = app.stream(&name)?;
    Ok(Json(stream.summary()))
}

/// `DELETE /v1/streams/{stream}`.
pub(super) async fn delete_stream(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<StatusCode, Problem> {
    app.authorize(&credential, Scope::Admin, &name)?;
    if app.registry.delete(&name) {
        Ok(StatusCode::NO_CONTENT)
    } else {
        Err(Problem::no_stream(&name))
    }
}

/// The body of `PUT /v1/streams/{stream}/recording`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Recorded {
    record: Record,
}

/// `PUT /v1/streams/{stream}/recording`.
pub(super) async fn put_recording(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(NoParameters {}): Strict<NoParameters>,
    JsonBody(Recorded { record }): JsonBody<Recorded>,
) -> Result<Json<StreamSummary>, Problem> {
    app.authorize(&credential, Scope::Publish, &name)?;
    let stream = app.registry.record(&name, record)?;
    let stream = stream.ok_or_else(|| Problem::no_stream(&name))?;
    Ok(Json(stream.summary()))
}

/// `DELETE /v1/streams/{stream}/recording`: what has been recorded stays.
pub(super) async fn delete_recording(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<StatusCode, Problem> {
    app.authorize(&credential, Scope::Publish, &name)?;
    let stream = app.registry.record(&name, Record::Off)?;
    stream.ok_or_else(|| Problem::no_stream(&name))?;
    Ok(StatusCode::NO_CONTENT)
}
