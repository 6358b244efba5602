//! Errors as problem documents (RFC 9457) that say what to do.

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use steadymesh_mesh_io::ReadError;
use steadymesh_proto::stream;

use super::request_log::Report;
use crate::processing::NotAFrame;
use crate::streams::{InvalidStreamName, NotConfigured, Refused};

/// When a publisher whose stream is full may try again, in milliseconds: a frame or two later.
const NEXT_FRAME_MS: u64 = 100;
/// When anybody else may, in milliseconds.
const SOON_MS: u64 = 1000;

/// An answer from 400 on.
#[derive(Debug)]
pub(super) struct Problem {
    status: StatusCode,
    /// The last part of the problem's type, which stays the same.
    kind: &'static str,
    title: &'static str,
    detail: String,
    retry_after_ms: Option<u64>,
    is_logged: bool,
}

impl Problem {
    fn new(
        status: StatusCode,
        kind: &'static str,
        title: &'static str,
        detail: impl Into<String>,
    ) -> Self {
        Self {
            status,
            kind,
            title,
            detail: detail.into(),
            retry_after_ms: None,
            is_logged: false,
        }
    }

    /// Whoever found the defect has written it into the log.
    pub fn already_logged(mut self) -> Self {
        self.is_logged = true;
        self
    }

    fn retry_after(mut self, milliseconds: u64) -> Self {
        self.retry_after_ms = Some(milliseconds);
        self
    }

    /// A parameter, header or document that does not make sense.
    pub fn bad_request(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::BAD_REQUEST,
            "bad-request",
            "The request is wrong",
            detail,
        )
    }

    /// There is nothing under this address.
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
    }

    /// There is no stream of this name.
    pub fn no_stream(name: &crate::streams::StreamName) -> Self {
        Self::new(
            StatusCode::NOT_FOUND,
            "no-stream",
            "No such stream",
            format!(
                "there is no stream {name}: it begins with the first frame that is posted to \
                 /v1/streams/{name}/frames"
            ),
        )
    }

    /// No credential, or one that opens nothing.
    pub fn unauthorized(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::UNAUTHORIZED,
            "unauthorized",
            "A token is needed",
            detail,
        )
    }

    /// A credential that opens something else.
    pub fn forbidden(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, "forbidden", "Not allowed", detail)
    }

    /// The request is for another host.
    pub fn misdirected(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::MISDIRECTED_REQUEST,
            "wrong-host",
            "Not this host",
            detail,
        )
    }

    /// There are as many of something as there may be.
    pub fn over_limit(detail: impl Into<String>) -> Self {
        let status = StatusCode::SERVICE_UNAVAILABLE;
        Self::new(status, "over-limit", "Over a limit", detail).retry_after(SOON_MS)
    }

    /// The address is right and the method is not.
    pub fn method_not_allowed(detail: impl Into<String>) -> Self {
        let status = StatusCode::METHOD_NOT_ALLOWED;
        Self::new(status, "method-not-allowed", "Method not allowed", detail)
    }

    /// The body's type is not one that is read here.
    pub fn unsupported_type(detail: impl Into<String>) -> Self {
        let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
        Self::new(
            status,
            "unsupported-type",
            "Unsupported content type",
            detail,
        )
    }

    /// Something is larger than allowed.
    pub fn too_large(detail: impl Into<String>) -> Self {
        let status = StatusCode::PAYLOAD_TOO_LARGE;
        Self::new(status, "too-large", "Over a limit", detail)
    }

    /// The body did not come in time.
    pub fn too_slow(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::REQUEST_TIMEOUT,
            "too-slow",
            "The body took too long",
            detail,
        )
    }

    /// The server is about to stop.
    pub fn stopping() -> Self {
        let status = StatusCode::SERVICE_UNAVAILABLE;
        Self::new(
            status,
            "stopping",
            "Not available",
            "the server is stopping",
        )
        .retry_after(SOON_MS)
    }

    /// The stream has a publisher by connection.
    pub fn occupied() -> Self {
        Self::new(
            StatusCode::CONFLICT,
            "another-publisher",
            "Another publisher",
            "another publisher is connected to the stream, or expected back: wait until it has \
             left, or say ?takeover=true to end its connection",
        )
        .retry_after(SOON_MS)
    }

    /// An accepted frame did not come out.
    pub fn frame_lost(detail: impl Into<String>) -> Self {
        let status = StatusCode::SERVICE_UNAVAILABLE;
        Self::new(status, "frame-lost", "The frame did not come out", detail).retry_after(SOON_MS)
    }

    /// A recording that goes on cannot be taken away.
    pub fn goes_on(detail: impl Into<String>) -> Self {
        let title = "The recording goes on";
        Self::new(StatusCode::CONFLICT, "recording-goes-on", title, detail)
    }

    /// What was recorded is not what is there.
    pub fn damaged(detail: impl Into<String>) -> Self {
        let status = StatusCode::INTERNAL_SERVER_ERROR;
        Self::new(status, "damaged", "The recording is damaged", detail)
    }

    /// The store of recordings does not answer.
    pub fn storage(detail: impl Into<String>) -> Self {
        let status = StatusCode::SERVICE_UNAVAILABLE;
        Self::new(
            status,
            "storage",
            "The recordings cannot be reached",
            detail,
        )
        .retry_after(SOON_MS)
    }

    /// A defect of the server.
    pub fn defect(detail: impl Into<String>) -> Self {
        let status = StatusCode::INTERNAL_SERVER_ERROR;
        Self::new(status, "defect", "A defect of the server", detail)
    }

    /// Whether this refuses what the publisher sent, rather than telling it to wait.
    pub fn is_rejection(&self) -> bool {
        self.status.is_client_error() && self.status != StatusCode::TOO_MANY_REQUESTS
    }
}

impl Problem {
    /// The document itself, for messages.
    pub fn into_document(self) -> stream::Problem {
        stream::Problem {
            r#type: format!("urn:steadymesh:problem:{}", self.kind),
            title: self.title.to_owned(),
            status: self.status.as_u16(),
            detail: self.detail,
            retry_after_ms: self.retry_after_ms,
        }
    }
}

impl From<InvalidStreamName> for Problem {
    fn from(error: InvalidStreamName) -> Self {
        Self::bad_request(error.to_string())
    }
}

impl From<NotConfigured> for Problem {
    fn from(error: NotConfigured) -> Self {
        let detail = error.to_string();
        match error {
            NotConfigured::Invalid(_) => Self::bad_request(detail),
            NotConfigured::Stopping => Self::stopping(),
            NotConfigured::TooManyStreams { .. } => Self::new(
                StatusCode::TOO_MANY_REQUESTS,
                "too-many-streams",
                "Over a limit",
                format!("{detail}: delete one, or raise streams.max in the configuration"),
            )
            .retry_after(SOON_MS),
        }
    }
}

impl From<Refused> for Problem {
    fn from(refused: Refused) -> Self {
        let detail = refused.to_string();
        let unusable = |detail| {
            let title = "Not a usable mesh";
            Self::new(
                StatusCode::UNPROCESSABLE_ENTITY,
                "unusable-mesh",
                title,
                detail,
            )
        };
        match refused {
            Refused::QueueFull => {
                let title = "The stream's queue is full";
                Self::new(StatusCode::TOO_MANY_REQUESTS, "queue-full", title, detail)
                    .retry_after(NEXT_FRAME_MS)
            }
            Refused::Occupied(_) => Self::occupied(),
            Refused::Ended => Self::new(
                StatusCode::SERVICE_UNAVAILABLE,
                "stream-ended",
                "The stream has ended",
                "the stream ended while the frame was on its way: send it again to begin anew",
            )
            .retry_after(SOON_MS),
            Refused::NotAFrame(NotAFrame::Unreadable(ReadError::LimitExceeded {
                what, ..
            })) => Self::too_large(format!(
                "{detail}: send a smaller mesh, or raise limits.{what} in the configuration"
            )),
            Refused::NotAFrame(NotAFrame::Unreadable(ReadError::OutOfMemory { .. })) => {
                Self::too_large(format!(
                    "{detail}: send a smaller mesh, or raise limits.decode_memory_bytes in the \
                 configuration"
                ))
            }
            Refused::NotAFrame(_) => unusable(detail),
            Refused::BusAway(_) => Self::new(
                StatusCode::SERVICE_UNAVAILABLE,
                "bus-away",
                "The bus does not take frames",
                detail,
            )
            .retry_after(SOON_MS),
            Refused::SeqGoesBack { .. } => Self::new(
                StatusCode::CONFLICT,
                "seq-goes-back",
                "Numbers ascend",
                format!("{detail}: go on from there, or delete the stream to begin anew"),
            ),
            Refused::Panicked => Self::defect(detail).already_logged(),
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let (status, retry_after_ms) = (self.status, self.retry_after_ms);
        let is_unheard_defect = status == StatusCode::INTERNAL_SERVER_ERROR && !self.is_logged;
        let report = Report {
            kind: self.kind,
            defect: is_unheard_defect.then(|| self.detail.clone()),
        };
        let mut response = (status, Json(self.into_document())).into_response();
        response.extensions_mut().insert(report);
        let headers = response.headers_mut();
        let problem_json = HeaderValue::from_static("application/problem+json");
        headers.insert(header::CONTENT_TYPE, problem_json);
        if status == StatusCode::UNAUTHORIZED {
            let challenge = HeaderValue::from_static("Bearer realm=\"steadymesh\"");
            headers.insert(header::WWW_AUTHENTICATE, challenge);
        }
        if let Some(milliseconds) = retry_after_ms {
            let seconds = milliseconds.div_ceil(1000);
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}
