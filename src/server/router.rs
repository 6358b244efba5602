//! The public route table.

use std::sync::Arc;

use axum::Router;
use axum::extract::{DefaultBodyLimit, Request};
use axum::middleware;
use axum::response::IntoResponse;
use axum::routing::{get, post, put};
use tower_http::catch_panic::CatchPanicLayer;

use super::error::Problem;
use super::{
    App, access, control, description, frames, host, ingest, origin, playback, player, publish,
    recordings, request_log, subscribe, textures,
};

/// A configuration is a few hundred bytes.
const MAX_DOCUMENT_BYTES: usize = 64 << 10;

/// Everything that the public listener answers.
pub(super) fn router(app: Arc<App>) -> Router {
    let stream = put(control::put_stream)
        .get(control::get_stream)
        .delete(control::delete_stream);
    let frame_metrics = get(frames::get_frame_metrics);
    let frame_texture = get(textures::get_frame_texture);
    let texture = get(textures::get_texture);
    let tape = put(control::put_recording).delete(control::delete_recording);
    Router::new()
        .route("/", get(player::index))
        .route("/watch/{stream}", get(player::watch))
        .route("/assets/{file}", get(player::asset))
        .route("/draco/{file}", get(player::decoder))
        .route("/v1/openapi.json", get(description::get_description))
        .route("/v1/tickets", post(access::post_ticket))
        .route("/v1/streams", get(control::list_streams))
        .route("/v1/streams/{stream}", stream)
        .route("/v1/streams/{stream}/frames", post(ingest::post_frame))
        .route("/v1/streams/{stream}/frames/{file}", get(frames::get_frame))
        .route("/v1/streams/{stream}/frames/{seq}/metrics", frame_metrics)
        .route("/v1/streams/{stream}/frames/{seq}/texture", frame_texture)
        .route("/v1/streams/{stream}/textures/{id}", texture)
        .route("/v1/streams/{stream}/metrics", get(frames::get_metrics))
        .route("/v1/streams/{stream}/publish", get(publish::publish))
        .route("/v1/streams/{stream}/subscribe", get(subscribe::subscribe))
        .route("/v1/streams/{stream}/recording", tape)
        .route("/v1/recordings", get(recordings::list))
        .nest("/v1/recordings/{stream}/{id}", recording())
        .fallback(not_found)
        .method_not_allowed_fallback(method_not_allowed)
        .layer(middleware::from_fn_with_state(
            Arc::clone(&app),
            origin::check,
        ))
        .layer(origin::cors(Arc::clone(&app)))
        .layer(middleware::from_fn_with_state(
            Arc::clone(&app),
            host::check,
        ))
        .layer(DefaultBodyLimit::max(MAX_DOCUMENT_BYTES))
        .layer(CatchPanicLayer::custom(
            |_: Box<dyn std::any::Any + Send>| {
                let problem = Problem::defect("the request could not be answered");
                // By whoever hears of panics.
                problem.already_logged().into_response()
            },
        ))
        .layer(middleware::from_fn(request_log::log))
        .with_state(app)
}

/// What is under a recording.
fn recording() -> Router<Arc<App>> {
    let one = get(recordings::get_recording).delete(recordings::delete_recording);
    Router::new()
        .route("/", one)
        .route("/frames", get(recordings::get_frames))
        .route("/frames/{file}", get(recordings::get_frame))
        .route("/frames/{seq}/metrics", get(recordings::get_frame_metrics))
        .route("/frames/{seq}/texture", get(textures::get_recorded_texture))
        .route("/raw/{seq}", get(recordings::get_raw_frame))
        .route("/play", get(playback::play))
}

async fn not_found(request: Request) -> Problem {
    Problem::not_found(format!(
        "there is nothing at {}: streams are under /v1/streams, the player is at /",
        request.uri().path()
    ))
}

async fn method_not_allowed(request: Request) -> Problem {
    let path = request.uri().path();
    Problem::method_not_allowed(format!("{path} does not answer to {}", request.method()))
}
