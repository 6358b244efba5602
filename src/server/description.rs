//! The description of the API, in OpenAPI, for programs that read such.

use std::sync::LazyLock;

use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use sha2::{Digest, Sha256};

use super::frames::is_current;

/// Written by hand; `tests/descriptions.rs` holds it against the code.
const YAML: &str = include_str!("../../proto/openapi.yaml");

/// Made when it is first asked for.
static DESCRIPTION: LazyLock<Description> = LazyLock::new(|| Description::of(YAML));

struct Description {
    json: Bytes,
    etag: String,
}

impl Description {
    fn of(yaml: &str) -> Self {
        let description: serde_json::Value = serde_yaml_ng::from_str(yaml)
            .expect("the description is part of the program, and the test below reads it");
        let json = description.to_string();
        let hash: [u8; 32] = Sha256::digest(json.as_bytes()).into();
        let etag: String = hash[..16]
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        Self {
            json: Bytes::from(json),
            etag: format!("\"{etag}\""),
        }
    }
}

/// `GET /v1/openapi.json`: for everybody, like the page.
pub(super) async fn get_description(headers: HeaderMap) -> Response {
    let Description { json, etag } = &*DESCRIPTION;
    let common = [
        (header::ETAG, etag.clone()),
        (header::CACHE_CONTROL, "no-cache".to_owned()),
    ];
    if is_current(&headers, etag) {
        return (StatusCode::NOT_MODIFIED, common).into_response();
    }
    let content_type = [(header::CONTENT_TYPE, "application/json")];
    (common, content_type, json.clone()).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_description_is_json_and_of_this_version() {
        let description: serde_json::Value = serde_json::from_slice(&DESCRIPTION.json).unwrap();
        assert_eq!(description["info"]["version"], env!("CARGO_PKG_VERSION"));
    }
}
