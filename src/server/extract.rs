//! What handlers take from a request's path, query and body, with errors that help.

use std::error::Error;
use std::time::Duration;

use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::StatusCode;
use axum::http::request::Parts;
use bytes::Bytes;
use serde::de::DeserializeOwned;

use crate::streams::StreamName;

use tokio::time::timeout;

use super::auth::Credential;
use super::error::Problem;

/// A document is a few hundred bytes.
const DOCUMENT_TIMEOUT: Duration = Duration::from_secs(10);

/// The name of the stream in the path.
#[derive(Debug)]
pub(super) struct Name(pub StreamName);

impl<S: Send + Sync> FromRequestParts<S> for Name {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let path = Path::<Vec<(String, String)>>::from_request_parts(parts, state).await;
        let Path(values) = path.map_err(|error| Problem::bad_request(error.body_text()))?;
        let name = values.iter().find(|(key, _)| key == "stream");
        let name = name.map_or("", |(_, value)| value);
        Ok(Self(StreamName::parse(name)?))
    }
}

/// The stream in the path, and who asks.
#[derive(Debug)]
pub(super) struct Asking {
    pub name: StreamName,
    pub credential: Credential,
}

impl<S: Send + Sync> FromRequestParts<S> for Asking {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let Name(name) = Name::from_request_parts(parts, state).await?;
        let Ok(credential) = Credential::from_request_parts(parts, state).await;
        Ok(Self { name, credential })
    }
}

/// A file's name, the last part of the path.
#[derive(Debug)]
pub(super) struct File(pub String);

impl<S: Send + Sync> FromRequestParts<S> for File {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let path = Path::<String>::from_request_parts(parts, state).await;
        let Path(file) = path.map_err(|error| Problem::bad_request(error.body_text()))?;
        Ok(Self(file))
    }
}

/// The query, in which nothing may be unknown.
#[derive(Debug)]
pub(super) struct Strict<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for Strict<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let query = Query::<T>::from_request_parts(parts, state).await;
        let Query(query) = query.map_err(|error| {
            // The cause names the parameter; what is around it says nothing more.
            let cause = error
                .source()
                .map_or_else(|| error.body_text(), ToString::to_string);
            Problem::bad_request(format!("the query: {cause}"))
        })?;
        Ok(Self(query))
    }
}

/// No parameters at all.
#[derive(Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoParameters {}

/// A JSON body, whatever its `Content-Type` says: nothing else is taken in its place.
#[derive(Debug)]
pub(super) struct JsonBody<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for JsonBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let reading = timeout(DOCUMENT_TIMEOUT, Bytes::from_request(request, state)).await;
        let read = reading.map_err(|_| {
            let seconds = DOCUMENT_TIMEOUT.as_secs();
            Problem::too_slow(format!("the document was not complete after {seconds} s"))
        })?;
        let bytes = read.map_err(|error| {
            let detail = error.body_text();
            if error.status() == StatusCode::PAYLOAD_TOO_LARGE {
                return Problem::too_large(format!("the document: {detail}"));
            }
            Problem::bad_request(format!("the document could not be read: {detail}"))
        })?;
        // serde takes an array for an object whose fields are in order; nobody means that.
        if bytes.trim_ascii_start().first() != Some(&b'{') {
            return Err(Problem::bad_request(
                "the document: a JSON object is expected",
            ));
        }
        let parsed = serde_json::from_slice(&bytes);
        parsed
            .map(Self)
            .map_err(|error| Problem::bad_request(format!("the document: {error}")))
    }
}
