//! Single frames and their metrics, out of what a stream remembers.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use steadymesh_mesh_io::glb::DracoPart;
use steadymesh_mesh_io::{Format, ImageFormat, Limits, drc, glb, ply};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::recording::Track;

use crate::compute::Length;
use crate::storage::ReadFailed;
use crate::streams::{Delivered, Loss, Outcome, Stream, StreamName};

use super::auth::Scope;
use super::error::Problem;
use super::extract::{Asking, NoParameters, Strict};
use super::{App, recordings};

/// A frame does not change, but its number comes again when the stream is deleted and begun
/// anew: caches are asked to look again after a minute.
const MAX_AGE: &str = "max-age=60";

/// Of what changes with the next frame.
pub(super) const ASK_AGAIN: &str = "no-cache";

/// Which frames' metrics are wanted.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Range {
    /// How many of the newest; all that are remembered if it is left out.
    last: Option<usize>,
}

/// The answer to `GET /v1/streams/{stream}/metrics`.
#[derive(Debug, Serialize)]
pub(super) struct MetricsList {
    stream: String,
    frames: Vec<FrameMetrics>,
}

/// Which frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Which {
    Latest,
    Number(u64),
}

/// `GET /v1/streams/{stream}/frames/{seq|latest}.drc|.glb|.ply`.
pub(super) async fn get_frame(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, file)): Path<(String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let (which, format) = parse_file(&file).ok_or_else(|| {
        Problem::not_found(format!(
            "there is no {file}: ask for a frame's number or \"latest\", with .drc, .glb or .ply"
        ))
    })?;
    let stream = app.stream(&name)?;
    let frame = find(&app, &stream, which).await?;
    let seq = frame.metrics.seq;
    let etag = format!("\"{:x}-{seq}-{}\"", stream.created_us(), format.extension());
    let location = format!("/v1/streams/{name}/frames/{seq}.{}", format.extension());
    let common = [
        (header::ETAG, etag.clone()),
        (header::CACHE_CONTROL, app.cache_control(which.max_age())),
        (header::CONTENT_LOCATION, location),
    ];
    if is_current(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    let bytes = match format {
        Format::Drc => frame.mesh,
        _ => convert(&app, frame, format).await?,
    };
    let content_type = HeaderValue::from_static(format.content_type());
    Ok((common, [(header::CONTENT_TYPE, content_type)], bytes).into_response())
}

/// `GET /v1/streams/{stream}/frames/{seq|latest}/metrics`.
pub(super) async fn get_frame_metrics(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, seq)): Path<(String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let frame = frame(&app, &name, &seq).await?;
    Ok(([(header::CACHE_CONTROL, ASK_AGAIN)], Json(&frame.metrics)).into_response())
}

/// `GET /v1/streams/{stream}/metrics?last=N`.
pub(super) async fn get_metrics(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Strict(range): Strict<Range>,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let stream = app.stream(&name)?;
    let frames = stream.last(range.last.unwrap_or(usize::MAX));
    let list = MetricsList {
        stream: name.to_string(),
        frames: frames.iter().map(|frame| frame.metrics.clone()).collect(),
    };
    Ok(([(header::CACHE_CONTROL, ASK_AGAIN)], Json(list)).into_response())
}

impl App {
    /// A stream that there is.
    ///
    /// # Errors
    ///
    /// 404.
    pub fn stream(&self, name: &StreamName) -> Result<Arc<Stream>, Problem> {
        let stream = self.registry.get(name);
        stream.ok_or_else(|| Problem::no_stream(name))
    }

    /// Who may keep what is good for `max_age`.
    pub fn cache_control(&self, max_age: &str) -> String {
        match max_age {
            ASK_AGAIN => max_age.to_owned(),
            _ if self.is_open() => format!("public, {max_age}"),
            // What a token opened is nobody else's.
            _ => format!("private, {max_age}"),
        }
    }
}

/// A frame that is out.
pub(super) struct Frame {
    pub metrics: FrameMetrics,
    /// The Draco bytes.
    pub mesh: Bytes,
    /// The image on it.
    pub image: Option<Bytes>,
}

/// The frame that `seq` in a path, a number or "latest", says.
pub(super) async fn frame(app: &App, name: &StreamName, seq: &str) -> Result<Frame, Problem> {
    let which = parse_which(seq).ok_or_else(|| {
        Problem::not_found(format!(
            "there is no frame {seq}: ask for a number or \"latest\""
        ))
    })?;
    let stream = app.stream(name)?;
    find(app, &stream, which).await
}

/// How long what belongs to the frame that `seq` in a path says may be kept.
pub(super) fn max_age(seq: &str) -> &'static str {
    parse_which(seq).map_or(ASK_AGAIN, Which::max_age)
}

impl Which {
    fn max_age(self) -> &'static str {
        match self {
            Self::Latest => ASK_AGAIN,
            Self::Number(_) => MAX_AGE,
        }
    }
}

impl From<Arc<Delivered>> for Frame {
    fn from(frame: Arc<Delivered>) -> Self {
        Self {
            metrics: frame.metrics.clone(),
            mesh: frame.mesh.clone(),
            image: frame.image.clone(),
        }
    }
}

/// A frame that the stream remembers, or that its recording has.
async fn find(app: &App, stream: &Stream, which: Which) -> Result<Frame, Problem> {
    let name = stream.name();
    let seq = match which {
        Which::Latest => {
            return stream.newest().map(Frame::from).ok_or_else(|| {
                Problem::not_found(format!("no frame of the stream {name} is out yet"))
            });
        }
        Which::Number(seq) => seq,
    };
    match stream.find(seq) {
        Some(Outcome::Delivered(frame)) => Ok(frame.into()),
        Some(Outcome::Lost(loss)) => Err(Problem::not_found(format!(
            "frame {seq} of the stream {name} did not come out: {}",
            match loss {
                Loss::Overload => "it gave way to a newer one",
                Loss::Failed => "it could not be processed",
            }
        ))),
        None => match recorded(app, stream, seq).await? {
            Some(frame) => Ok(frame),
            None => Err(Problem::not_found(not_there(stream, name, seq))),
        },
    }
}

/// An older frame than the stream remembers, if it is being recorded.
async fn recorded(app: &App, stream: &Stream, seq: u64) -> Result<Option<Frame>, Problem> {
    let is_older = stream.remembered().is_some_and(|(oldest, _)| seq < oldest);
    let (Some(key), Ok(recordings)) = (stream.recording().key(), app.recordings()) else {
        return Ok(None);
    };
    if !is_older {
        return Ok(None);
    }
    let found = match recordings.find(&key).await {
        Ok(recording) => recording.frame(Track::Output, seq).await,
        Err(error) => Err(error),
    };
    match found {
        Ok(stored) => recordings::frame(stored).map(Some),
        Err(
            ReadFailed::NoRecording { .. }
            | ReadFailed::Gone { .. }
            | ReadFailed::NoTrack { .. }
            | ReadFailed::NoFrame { .. },
        ) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

fn not_there(stream: &Stream, name: &StreamName, seq: u64) -> String {
    match stream.remembered() {
        Some((oldest, newest)) => format!(
            "there is no frame {seq} in the stream {name}: it remembers frames {oldest} to {newest}"
        ),
        None => format!("no frame of the stream {name} is out yet"),
    }
}

/// Writes a frame in another format than Draco, on the pool.
pub(super) async fn convert(app: &App, frame: Frame, format: Format) -> Result<Bytes, Problem> {
    let job = move || -> Option<Bytes> {
        let bytes = match format {
            Format::Glb => to_glb(&frame)?,
            _ => ply::write(&drc::read(&frame.mesh, &Limits::NONE).ok()?),
        };
        Some(Bytes::from(bytes))
    };
    let converted = app.pool.run(Length::Short, job).await.ok().flatten();
    converted.ok_or_else(|| Problem::defect("the frame could not be converted"))
}

fn to_glb(frame: &Frame) -> Option<Vec<u8>> {
    let parts = DracoPart::split(&frame.mesh, &Limits::NONE).ok()?;
    let texture = frame.metrics.texture.as_ref();
    let format = texture.and_then(|texture| ImageFormat::from_media_type(&texture.media_type));
    let image = format.zip(frame.image.as_deref());
    let mut infos = parts.iter().map(|part| &part.info);
    if image.is_none() && infos.any(|info| info.texture_coordinate_id.is_some()) {
        // In a Draco file v points up, and without an image glTF has no means to say so.
        return Some(glb::write(
            &drc::read(&frame.mesh, &Limits::NONE).ok()?,
            None,
        ));
    }
    Some(glb::wrap_draco(&parts, image))
}

fn parse_file(file: &str) -> Option<(Which, Format)> {
    let (which, extension) = file.rsplit_once('.')?;
    let format = parse_extension(extension)?;
    Some((parse_which(which)?, format))
}

/// The formats in which frames can be had.
pub(super) fn parse_extension(extension: &str) -> Option<Format> {
    let formats = [Format::Drc, Format::Glb, Format::Ply];
    formats
        .into_iter()
        .find(|format| format.extension() == extension)
}

fn parse_which(text: &str) -> Option<Which> {
    match text {
        "latest" => Some(Which::Latest),
        _ => parse_number(text).map(Which::Number),
    }
}

/// A frame's number as it stands in a path.
pub(super) fn parse_number(text: &str) -> Option<u64> {
    // A plus sign, which `parse` would take, is not part of a number here.
    let is_number = text.bytes().all(|b| b.is_ascii_digit());
    is_number.then(|| text.parse().ok()).flatten()
}

/// Whether the client has this version already (RFC 9110, 13.1.2).
pub(super) fn is_current(headers: &HeaderMap, etag: &str) -> bool {
    headers
        .get_all(header::IF_NONE_MATCH)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .any(|tag| tag == "*" || tag.trim_start_matches("W/") == etag)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_a_number_or_latest_and_an_extension() {
        assert_eq!(parse_file("41.drc"), Some((Which::Number(41), Format::Drc)));
        assert_eq!(parse_file("latest.glb"), Some((Which::Latest, Format::Glb)));
        for file in [
            "41", "41.stl", ".drc", "-1.drc", "+1.drc", "4 1.drc", "latest",
        ] {
            assert_eq!(parse_file(file), None, "{file}");
        }
    }
}
