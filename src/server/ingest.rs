//! Frames in, by POST.

use std::sync::Arc;
use std::time::Instant;

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::Deserialize;
use steadymesh_mesh_io::{Format, ReadError, sniff};
use steadymesh_proto::stream::Accepted;
use steadymesh_proto::{Bundle, NativeFrame, NativeStamps, metrics::FrameMetrics};

use crate::processing::NotAFrame;
use crate::streams::{Loss, Outcome, Refused, Stream, Submission};

use super::App;
use super::auth::Scope;
use super::body;
use super::error::Problem;
use super::extract::{Asking, Strict};
use super::multipart;
use super::prefer::Wait;

const TYPES: &str = "model/obj, model/ply, model/gltf-binary, model/gltf+json, \
                     application/vnd.draco, application/vnd.steadymesh.frame, \
                     application/vnd.steadymesh.bundle, multipart/form-data, or \
                     application/octet-stream to let the server find out";

/// 2^53 - 1, the largest number that players in every language can tell from its neighbours.
const MAX_NUMBER: u64 = (1 << 53) - 1;

/// What a rig may say about a frame beside its mesh.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Stamps {
    pub seq: Option<u64>,
    pub capture_time_us: Option<u64>,
    /// Whether a publisher by connection is to make way.
    #[serde(default)]
    takeover: bool,
}

impl Stamps {
    pub fn new(seq: Option<u64>, capture_time_us: Option<u64>) -> Self {
        Self {
            seq,
            capture_time_us,
            takeover: false,
        }
    }
}

/// `POST /v1/streams/{stream}/frames`.
pub(super) async fn post_frame(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    stamps: Result<Strict<Stamps>, Problem>,
    headers: HeaderMap,
    request_body: Body,
) -> Response {
    let prepared = stamps.and_then(|Strict(stamps)| {
        app.authorize(&credential, Scope::Publish, &name)?;
        Ok((stamps, app.registry.get_or_create(&name)?))
    });
    let (stamps, stream) = match prepared {
        Ok(prepared) => prepared,
        Err(problem) => {
            body::discard(request_body, &headers).await;
            return problem.into_response();
        }
    };
    match take_frame(&app, &stream, stamps, &headers, request_body).await {
        Ok(accepted) => answer(&stream, accepted, Wait::of(&headers)).await,
        Err(problem) => {
            if problem.is_rejection() {
                stream.count_rejected();
            }
            problem.into_response()
        }
    }
}

/// Reads the body and hands it in.
async fn take_frame(
    app: &App,
    stream: &Stream,
    stamps: Stamps,
    headers: &HeaderMap,
    request_body: Body,
) -> Result<Accepted, Problem> {
    let refuse = async |problem, request_body| {
        body::discard(request_body, headers).await;
        Err(problem)
    };
    let declared = match declared_format(headers) {
        Ok(declared) => declared,
        Err(problem) => return refuse(problem, request_body).await,
    };
    // Before the body is read, so that a full queue holds no bodies.
    if stream.is_full() {
        return refuse(Refused::QueueFull.into(), request_body).await;
    }
    let options = app.options();
    let limits = body::Limits {
        max_bytes: options.max_body_bytes,
        timeout: options.body_timeout,
    };
    let (bytes, _memory) = body::read(request_body, headers, limits, &app.memory).await?;
    // A place is taken once the frame is there: a rig whose network stalls holds none.
    let place = stream.reserve(stamps.takeover)?;
    let arrived = Instant::now();
    let (bytes, format) = match declared {
        Declared::Format(format) => (bytes, format),
        Declared::Nothing => {
            let format = sniffed_format(&bytes)?;
            (bytes, format)
        }
        Declared::Parts { boundary } => {
            let bytes = multipart::join(bytes, boundary).await?;
            let format = sniffed_format(&bytes)?;
            (bytes, format)
        }
    };
    let stamps = with_own_stamps(stamps, format, &bytes)?;
    let submission = Submission {
        bytes,
        format,
        seq: stamps.seq,
        capture_time_us: stamps.capture_time_us,
        arrived,
    };
    Ok(place.submit(submission)?.accepted().await?)
}

/// What the headers say of a body.
#[derive(Debug)]
enum Declared {
    Format(Format),
    /// The server is to find out.
    Nothing,
    Parts {
        boundary: String,
    },
}

fn declared_format(headers: &HeaderMap) -> Result<Declared, Problem> {
    if let Some(encoding) = headers.get(header::CONTENT_ENCODING)
        && !encoding.as_bytes().eq_ignore_ascii_case(b"identity")
    {
        return Err(Problem::unsupported_type(format!(
            "the body has the Content-Encoding {}: send it as it is, since Draco and native \
             frames do not become smaller by it",
            String::from_utf8_lossy(encoding.as_bytes())
        )));
    }
    let Some(content_type) = headers.get(header::CONTENT_TYPE) else {
        return Ok(Declared::Nothing);
    };
    let text = String::from_utf8_lossy(content_type.as_bytes());
    if let Some(boundary) = multipart::boundary(&text)? {
        return Ok(Declared::Parts { boundary });
    }
    let essence = text.split(';').next().unwrap_or_default().trim();
    // The second is what curl says unless it is told otherwise.
    let says_nothing = [
        "application/octet-stream",
        "application/x-www-form-urlencoded",
    ];
    if says_nothing
        .iter()
        .any(|name| essence.eq_ignore_ascii_case(name))
    {
        return Ok(Declared::Nothing);
    }
    match Format::from_content_type(essence) {
        Some(format) => Ok(Declared::Format(format)),
        None => Err(Problem::unsupported_type(format!(
            "the Content-Type is {essence}: send {TYPES}"
        ))),
    }
}

/// The format that the body begins like.
pub(super) fn sniffed_format(bytes: &Bytes) -> Result<Format, Problem> {
    if bytes.is_empty() {
        return Err(Refused::from(NotAFrame::from(ReadError::EmptyBody)).into());
    }
    sniff(bytes).ok_or_else(|| {
        Problem::unsupported_type(format!(
            "the body begins like none of OBJ, PLY, GLB, Draco, native frames and bundles: send \
             one of these, and say which by its Content-Type: {TYPES}"
        ))
    })
}

/// A native frame or a bundle says itself which one it is; what is said beside it has the last word.
pub(super) fn with_own_stamps(
    stamps: Stamps,
    format: Format,
    bytes: &Bytes,
) -> Result<Stamps, Problem> {
    let mut stamps = stamps;
    let own = own_stamps(format, bytes);
    let own = own.map_err(|error| Refused::from(NotAFrame::from(error)))?;
    stamps.seq = stamps.seq.or(own.seq);
    stamps.capture_time_us = stamps.capture_time_us.or(own.capture_time_us);
    for (name, value) in [
        ("seq", stamps.seq),
        ("capture_time_us", stamps.capture_time_us),
    ] {
        if value.is_some_and(|value| MAX_NUMBER < value) {
            return Err(Problem::bad_request(format!(
                "{name} is over {MAX_NUMBER}, beyond which a JavaScript player cannot count"
            )));
        }
    }
    Ok(stamps)
}

/// What a body says of itself: a bundle, and in its place the native frame in it.
fn own_stamps(format: Format, bytes: &[u8]) -> Result<NativeStamps, ReadError> {
    if bytes.is_empty() {
        return Ok(NativeStamps::default());
    }
    match format {
        Format::Native => Ok(NativeFrame::stamps(bytes)?),
        Format::Bundle => {
            let bundle = Bundle::decode(bytes)?;
            let own = match sniff(bundle.mesh) {
                Some(Format::Native) => NativeFrame::stamps(bundle.mesh)?,
                _ => NativeStamps::default(),
            };
            Ok(NativeStamps {
                seq: bundle.seq.or(own.seq),
                capture_time_us: bundle.capture_time_us.or(own.capture_time_us),
            })
        }
        _ => Ok(NativeStamps::default()),
    }
}

/// 202 at once, or 200 with the frame's metrics once it is out.
async fn answer(stream: &Stream, accepted: Accepted, wait: Wait) -> Response {
    let outcome = match wait {
        Wait::No => return (StatusCode::ACCEPTED, Json(accepted)).into_response(),
        Wait::UntilDone => stream.outcome(accepted.seq).await,
        Wait::AtMost(patience) => {
            match tokio::time::timeout(patience, stream.outcome(accepted.seq)).await {
                Ok(outcome) => outcome,
                Err(_) => return (StatusCode::ACCEPTED, Json(accepted)).into_response(),
            }
        }
    };
    match outcome {
        Some(Outcome::Delivered(frame)) => waited_for(stream, &frame.metrics),
        Some(Outcome::Lost(Loss::Overload)) => Problem::frame_lost(format!(
            "frame {} gave way to a newer one, as the stream's overload setting (live) asks for",
            accepted.seq
        ))
        .into_response(),
        Some(Outcome::Lost(Loss::Failed)) => {
            let detail = format!("frame {} could not be processed", accepted.seq);
            Problem::defect(detail).already_logged().into_response()
        }
        None => Problem::frame_lost(format!(
            "the stream ended before frame {} was out, or has forgotten it",
            accepted.seq
        ))
        .into_response(),
    }
}

fn waited_for(stream: &Stream, metrics: &FrameMetrics) -> Response {
    let location = format!("/v1/streams/{}/frames/{}.drc", stream.name(), metrics.seq);
    let mut response = Json(metrics).into_response();
    let headers = response.headers_mut();
    let applied = HeaderName::from_static("preference-applied");
    headers.insert(applied, HeaderValue::from_static("wait"));
    // A name and a number are always a valid header.
    if let Ok(location) = HeaderValue::from_str(&location) {
        headers.insert(header::CONTENT_LOCATION, location);
    }
    response
}
