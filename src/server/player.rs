//! The page that shows streams, embedded in the binary.

use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use rust_embed::{EmbeddedFile, RustEmbed};

use super::error::Problem;
use super::extract::{File, Name};
use super::frames::is_current;

/// What `npm run build` makes. A binary that was built without it says so instead.
#[derive(RustEmbed)]
#[folder = "web/dist"]
#[allow_missing = true]
struct Dist;

/// The page loads nothing from anywhere else, and runs in nobody else's frame.
const POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src blob:; \
                      connect-src 'self'; style-src 'self'; img-src 'self'; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";

/// `GET /`.
pub(super) async fn index(headers: HeaderMap) -> Response {
    page(&headers)
}

/// `GET /watch/{stream}`: the same page, which reads the name from its address.
pub(super) async fn watch(name: Result<Name, Problem>, headers: HeaderMap) -> Response {
    match name {
        Ok(_) => page(&headers),
        Err(problem) => problem.into_response(),
    }
}

/// `GET /assets/{file}`: names contain a hash of the content.
pub(super) async fn asset(File(file): File, headers: HeaderMap) -> Response {
    file_response(
        &format!("assets/{file}"),
        "public, max-age=31536000, immutable",
        &headers,
    )
}

/// `GET /draco/{file}`: the decoder, whose names stay the same.
pub(super) async fn decoder(File(file): File, headers: HeaderMap) -> Response {
    file_response(&format!("draco/{file}"), "no-cache", &headers)
}

fn page(headers: &HeaderMap) -> Response {
    if Dist::get("index.html").is_none() {
        return (
            StatusCode::SERVICE_UNAVAILABLE,
            "This server was built without its page: run `npm ci && npm run build` in web/, and \
             build it again. The API under /v1 works.\n",
        )
            .into_response();
    }
    let mut response = file_response("index.html", "no-cache", headers);
    let policy = HeaderValue::from_static(POLICY);
    response
        .headers_mut()
        .insert(header::CONTENT_SECURITY_POLICY, policy);
    response
}

fn file_response(path: &str, cache: &'static str, headers: &HeaderMap) -> Response {
    let Some(EmbeddedFile { data, metadata }) = Dist::get(path) else {
        return Problem::not_found(format!("there is no /{path}")).into_response();
    };
    let hash = metadata.sha256_hash();
    let etag: String = hash[..16]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let etag = format!("\"{etag}\"");
    let common = [
        (header::ETAG, etag.clone()),
        (header::CACHE_CONTROL, cache.to_owned()),
        (
            HeaderName::from_static("x-content-type-options"),
            "nosniff".to_owned(),
        ),
    ];
    if is_current(headers, &etag) {
        return (StatusCode::NOT_MODIFIED, common).into_response();
    }
    let content_type = [(header::CONTENT_TYPE, content_type(path))];
    (common, content_type, data).into_response()
}

fn content_type(path: &str) -> &'static str {
    match path.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        "wasm" => "application/wasm",
        "json" => "application/json",
        _ => "application/octet-stream",
    }
}
