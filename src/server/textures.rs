//! The images on frames: by their names, which never change, and by their frames.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::Deserialize;
use steadymesh_mesh_io::ImageFormat;
use steadymesh_proto::metrics::Texture;
use steadymesh_proto::recording::Track;
use steadymesh_proto::{DeliveredFrame, FrameMetrics};

use super::App;
use super::auth::Scope;
use super::error::Problem;
use super::extract::{Asking, NoParameters, Strict};
use super::{frames, recordings};

/// How a player wants to have images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Textures {
    /// By their names, which the metrics say.
    #[default]
    Reference,
    /// Behind the mesh, unless it has the same one already.
    Inline,
    /// Not at all: what comes is the same as by reference.
    None,
}

/// What a connection has been sent.
#[derive(Debug, Default)]
pub(super) struct Sent {
    /// The name of the last image.
    last: Option<String>,
}

impl Sent {
    /// Whether the image of this frame, if it has one, is another than the last; from now on it is
    /// the last.
    pub fn is_new(&mut self, metrics: &FrameMetrics) -> bool {
        let Some(texture) = &metrics.texture else {
            return false;
        };
        if self.last.as_ref() == Some(&texture.id) {
            return false;
        }
        self.last = Some(texture.id.clone());
        true
    }
}

/// A recorded message as this player wants it.
pub(super) fn recorded(message: Bytes, wishes: Textures, sent: &mut Sent) -> Bytes {
    let Ok(Some(image)) = DeliveredFrame::image_of(&message) else {
        // The player says what is wrong with one that cannot be read.
        return message;
    };
    let is_wanted = wishes == Textures::Inline
        && DeliveredFrame::decode(&message).is_ok_and(|frame| sent.is_new(&frame.metrics));
    if is_wanted {
        return message;
    }
    DeliveredFrame::without_image(&message, image).into()
}

/// `GET /v1/streams/{stream}/textures/{id}`.
pub(super) async fn get_texture(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id)): Path<(String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let stream = app.stream(&name)?;
    let found = stream.textured(&id).and_then(|frame| {
        let texture = frame.metrics.texture.clone()?;
        Some((texture, frame.image.clone()?))
    });
    let (texture, image) = found.ok_or_else(|| {
        Problem::not_found(format!(
            "no frame that the stream {name} remembers has the texture {id}: ask for those that \
             the frames' metrics name, while they are new"
        ))
    })?;
    Ok(answer(&app, &headers, &texture, image, recordings::MAX_AGE))
}

/// `GET /v1/streams/{stream}/frames/{seq|latest}/texture`.
pub(super) async fn get_frame_texture(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, seq)): Path<(String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let frame = frames::frame(&app, &name, &seq).await?;
    of_frame(&app, &headers, frame, frames::max_age(&seq))
}

/// `GET /v1/recordings/{stream}/{id}/frames/{seq}/texture`.
pub(super) async fn get_recorded_texture(
    State(app): State<Arc<App>>,
    Asking { name, credential }: Asking,
    Path((_, id, seq)): Path<(String, String, String)>,
    Strict(NoParameters {}): Strict<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    app.authorize(&credential, Scope::Subscribe, &name)?;
    let seq = recordings::number(&seq)?;
    let recording = app.recording(&name, &id).await?;
    let frame = recordings::frame(recording.frame(Track::Output, seq).await?)?;
    of_frame(&app, &headers, frame, recordings::MAX_AGE)
}

fn of_frame(
    app: &App,
    headers: &HeaderMap,
    frame: frames::Frame,
    max_age: &str,
) -> Result<Response, Problem> {
    match (&frame.metrics.texture, frame.image) {
        (Some(texture), Some(image)) => Ok(answer(app, headers, texture, image, max_age)),
        _ => {
            let seq = frame.metrics.seq;
            Err(Problem::not_found(format!("frame {seq} has no texture")))
        }
    }
}

fn answer(
    app: &App,
    headers: &HeaderMap,
    texture: &Texture,
    image: Bytes,
    max_age: &str,
) -> Response {
    let etag = format!("\"{}\"", texture.id);
    let cache = app.cache_control(max_age);
    let common = [(header::ETAG, etag.clone()), (header::CACHE_CONTROL, cache)];
    if frames::is_current(headers, &etag) {
        return (StatusCode::NOT_MODIFIED, common).into_response();
    }
    // From a recording, it may say anything.
    let media_type = ImageFormat::from_media_type(&texture.media_type);
    let media_type = media_type.map_or("application/octet-stream", ImageFormat::media_type);
    let typed = [
        (header::CONTENT_TYPE, HeaderValue::from_static(media_type)),
        (
            header::X_CONTENT_TYPE_OPTIONS,
            HeaderValue::from_static("nosniff"),
        ),
    ];
    (common, typed, image).into_response()
}
