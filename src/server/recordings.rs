//! What has been recorded: lists, frames, and what they came from.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::Deserialize;
use steadymesh_mesh_io::Format;
use steadymesh_proto::recording::{RecordedFrames, RecordingList, RecordingSummary, Track};
use steadymesh_proto::{DeliveredFrame, FrameMetrics};

use crate::storage::{ReadFailed, Recording, RecordingKey, Recordings, Start, StoredFrame};
use crate::streams::StreamName;

use super::App;
use super::auth::{Credential, Scope};
use super::error::Problem;
use super::extract::{Asking, NoParameters, Strict};
use super::frames::{self, Frame};

/// Frames of one answer, if no fewer are asked for.
const MAX_FRAMES: usize = 1000;
/// A recorded frame never changes, and its recording's name does not come again; nor does an image
/// under its name.
pub(super) const MAX_AGE: &str = "max-age=31536000, immutable";

/// When a raw frame was captured, in microseconds since 1970.
pub(super) const CAPTURE_TIME: HeaderName = HeaderName::from_static("steadymesh-capture-time-us");

/// Whose recordings are wanted.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Whose {
    stream: Option<String>,
}

/// Which frames are wanted.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    #[serde(default = "output")]
    track: Track,
    from_seq: Option<u64>,
    from_us: Option<u64>,
    limit: Option<usize>,
}

fn output() -> Track {
    Track::Output
}

/// Where to begin, from two parameters of which one may be given.
pub(super) fn start(from_seq: Option<u64>, from_us: Option<u64>) -> Result<Start, Problem> {
    match (from_seq, from_us) {
        (Some(_), Some(_)) => Err(Problem::bad_request(
            "from_seq and from_us are both given: leave one of them out",
        )),
        (None, Some(time)) => Ok(Start::Time(time)),
        (seq, None) => Ok(Start::Seq(seq.unwrap_or(0))),
    }
}

impl App {
    /// The recordings.
    ///
    /// # Errors
    ///
    /// 404 if the server keeps none.
    pub fn recordings(&self) -> Result<&Arc<Recordings>, Problem> {
        self.registry.recordings().ok_or_else(|| {
            Problem::not_found(
                "this server keeps no recordings: that takes recordings.url in its configuration",
            )
        })
    }

    /// The recording that a path names.
    pub async fn recording(
        &self,
        stream: &StreamName,
        id: &str,
    ) -> Result<Arc<Recording>, Problem> {
        let found = self.recordings()?.find(&key(stream, id)).await;
        Ok(found?)
    }
}

fn key(stream: &StreamName, id: &str) -> RecordingKey {
    RecordingKey {
        stream: stream.to_string(),
        id: id.to_owned(),
    }
}

/// `GET /v1/recordings`.
pub(super) async fn list(
    State(app): State<Arc<App>>,
    credential: Credential,
    Strict(whose): Strict<Whose>,
) -> Result<Json<RecordingList>, Problem> {
    let grant = app.grant(&credential)?;
    let stream = whose.stream.as_deref().map(StreamName::parse).transpose()?;
    let stream = stream.as_ref().map(StreamName::as_str);
    let mut recordings = app.recordings()?.list(stream).await?;
    if let Some(grant) = grant {
        // Nobody learns of streams that are not theirs.
        recordings.retain(|recording| {
            StreamName::parse(&recording.stream).is_ok_and(|name| grant.is_for(&name))
        });
    }
    Ok(Json(RecordingList { recordings }))
}

/// `GET /v1/recordings/{stream}/{id}`.
pub(super) async fn get_recording(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id)): Path<(String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<Json<RecordingSummary>, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    Ok(Json(app.recording(&name, &id).await?.summary()))
}

/// `DELETE /v1/recordings/{stream}/{id}`.
pub(super) async fn delete_recording(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id)): Path<(String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<StatusCode, Problem> {
    app.authorize(&credential, Scope::Admin, &name)?;
    app.recordings()?.delete(&key(&name, &id)).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// `GET /v1/recordings/{stream}/{id}/frames`.
pub(super) async fn get_frames(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id)): Path<(String, String)>,
    Strict(wanted): Strict<Wanted>,
) -> Result<Json<RecordedFrames>, Problem> {
    app.authorize(&credential, scope(wanted.track), &name)?;
    let start = start(wanted.from_seq, wanted.from_us)?;
    let limit = wanted.limit.unwrap_or(MAX_FRAMES);
    if !(1..=MAX_FRAMES).contains(&limit) {
        return Err(Problem::bad_request(format!(
            "limit is {limit}: it must be from 1 to {MAX_FRAMES}"
        )));
    }
    let recording = app.recording(&name, &id).await?;
    let (frames, more) = recording.frames(wanted.track, start, limit).await?;
    Ok(Json(RecordedFrames { frames, more }))
}

/// `GET /v1/recordings/{stream}/{id}/frames/{seq}.drc|.glb|.ply`.
pub(super) async fn get_frame(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id, file)): Path<(String, String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let parsed = file.rsplit_once('.').and_then(|(seq, extension)| {
        Some((
            frames::parse_number(seq)?,
            frames::parse_extension(extension)?,
        ))
    });
    let (seq, format) = parsed.ok_or_else(|| {
        Problem::not_found(format!(
            "there is no {file}: ask for a frame's number, with .drc, .glb or .ply"
        ))
    })?;
    let etag = format!("\"{id}-{seq}-{}\"", format.extension());
    let common = [
        (header::ETAG, etag.clone()),
        (header::CACHE_CONTROL, app.cache_control(MAX_AGE)),
    ];
    let recording = app.recording(&name, &id).await?;
    let frame = frame(recording.frame(Track::Output, seq).await?)?;
    if frames::is_current(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    let bytes = match format {
        Format::Drc => frame.mesh,
        _ => frames::convert(&app, frame, format).await?,
    };
    let content_type = [(header::CONTENT_TYPE, format.content_type())];
    Ok((common, content_type, bytes).into_response())
}

/// `GET /v1/recordings/{stream}/{id}/frames/{seq}/metrics`.
pub(super) async fn get_frame_metrics(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id, seq)): Path<(String, String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<Json<FrameMetrics>, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let seq = number(&seq)?;
    let recording = app.recording(&name, &id).await?;
    Ok(Json(
        frame(recording.frame(Track::Output, seq).await?)?.metrics,
    ))
}

/// `GET /v1/recordings/{stream}/{id}/raw/{seq}`: the body as the rig sent it.
pub(super) async fn get_raw_frame(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id, seq)): Path<(String, String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<Response, Problem> {
    app.authorize(&credential, scope(Track::Raw), &name)?;
    let seq = number(&seq)?;
    let recording = app.recording(&name, &id).await?;
    let StoredFrame { frame, body } = recording.frame(Track::Raw, seq).await?;
    let content_type = [(header::CONTENT_TYPE, frame.content_type)];
    let common = [(header::CACHE_CONTROL, app.cache_control(MAX_AGE))];
    let mut response = (common, content_type, body).into_response();
    if let Some(time) = frame.capture_time_us {
        response.headers_mut().insert(CAPTURE_TIME, time.into());
    }
    Ok(response)
}

/// What a rig sent is for those who may send.
fn scope(track: Track) -> Scope {
    match track {
        Track::Raw => Scope::Publish,
        Track::Output => Scope::Subscribe,
    }
}

pub(super) fn number(text: &str) -> Result<u64, Problem> {
    frames::parse_number(text)
        .ok_or_else(|| Problem::not_found(format!("there is no frame {text}: ask for a number")))
}

/// What a recorded message says.
pub(super) fn frame(stored: StoredFrame) -> Result<Frame, Problem> {
    let body: Bytes = stored.body;
    let decoded = DeliveredFrame::decode(&body);
    // Its checksum was right: it was written like this.
    let decoded = decoded.map_err(|error| Problem::defect(format!("a recorded frame: {error}")))?;
    Ok(Frame {
        mesh: body.slice_ref(decoded.mesh),
        image: decoded.image.map(|image| body.slice_ref(image)),
        metrics: decoded.metrics,
    })
}

impl From<ReadFailed> for Problem {
    fn from(error: ReadFailed) -> Self {
        let detail = error.to_string();
        match &error {
            ReadFailed::NoRecording { .. }
            | ReadFailed::NoTrack { .. }
            | ReadFailed::NoFrame { .. } => Self::not_found(detail),
            ReadFailed::Gone { .. } => {
                Self::not_found("it has been taken away: it was too old, or somebody deleted it")
            }
            ReadFailed::GoesOn => Self::goes_on(detail),
            ReadFailed::Damaged { .. } => Self::damaged(detail),
            // What a store says is for operators: it may have paths and addresses.
            _ => {
                tracing::warn!(%error, "recordings cannot be read");
                Self::storage("the store of recordings does not answer as it should")
            }
        }
    }
}
