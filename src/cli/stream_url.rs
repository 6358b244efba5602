//! The address of a stream or of a recording, as people write it.

use reqwest::Url;

use crate::storage::RecordingKey;
use crate::streams::StreamName;

const EXAMPLE: &str = "http://127.0.0.1:8080/v1/streams/demo";
const RECORDING_EXAMPLE: &str = "http://127.0.0.1:8080/v1/recordings/demo/20261129T215703Z-3f9a";
const RECORDINGS: &str = "v1/recordings/";

/// A stream on a server, or a recording of one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct StreamUrl {
    server: Url,
    name: StreamName,
    /// The recording's id, if it is one.
    recording: Option<String>,
}

impl StreamUrl {
    /// Reads `http://host:port/v1/streams/NAME`, the address of its page
    /// (`http://host:port/watch/NAME`), or just `http://host:port/NAME`.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (server, path) = split(text, EXAMPLE)?;
        let name = ["v1/streams/", "watch/"]
            .iter()
            .find_map(|prefix| path.strip_prefix(prefix))
            .unwrap_or(&path);
        let name = StreamName::parse(name)
            .map_err(|error| format!("it does not name a stream, as {EXAMPLE} does: {error}"))?;
        Ok(Self {
            server,
            name,
            recording: None,
        })
    }

    /// Reads `http://host:port/v1/recordings/NAME/ID`.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn parse_recording(text: &str) -> Result<Self, String> {
        let (server, path) = split(text, RECORDING_EXAMPLE)?;
        let parts = path
            .strip_prefix(RECORDINGS)
            .and_then(|rest| rest.split_once('/'));
        let named = parts.and_then(|(name, id)| {
            let name = StreamName::parse(name).ok()?;
            RecordingKey::is_id(id).then(|| (name, id.to_owned()))
        });
        let (name, id) = named
            .ok_or_else(|| format!("it does not name a recording, as {RECORDING_EXAMPLE} does"))?;
        Ok(Self {
            server,
            name,
            recording: Some(id),
        })
    }

    /// Reads either.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn parse_any(text: &str) -> Result<Self, String> {
        let is_recording = split(text, EXAMPLE).is_ok_and(|(_, path)| path.starts_with(RECORDINGS));
        if is_recording {
            Self::parse_recording(text)
        } else {
            Self::parse(text)
        }
    }

    /// Whether it is a recording.
    pub fn is_recording(&self) -> bool {
        self.recording.is_some()
    }

    /// The stream's name.
    pub fn name(&self) -> &StreamName {
        &self.name
    }

    /// The address of the stream's page.
    pub fn page(&self) -> String {
        format!("{}watch/{}", self.server, self.name)
    }

    /// An address under the stream's own, such as `frames`.
    pub fn under(&self, part: &str) -> Url {
        let mut url = self.server.clone();
        let slash = if part.is_empty() { "" } else { "/" };
        url.set_path(&match &self.recording {
            None => format!("/v1/streams/{}{slash}{part}", self.name),
            Some(id) => format!("/{RECORDINGS}{}/{id}{slash}{part}", self.name),
        });
        url
    }

    /// The address for a WebSocket under the stream's own, such as `subscribe`, with parameters.
    pub fn websocket_under(&self, part: &str, parameters: &[(&str, &str)]) -> String {
        let mut url = self.under(part);
        if !parameters.is_empty() {
            url.query_pairs_mut().extend_pairs(parameters);
        }
        url.to_string().replacen("http", "ws", 1)
    }

    /// The server's address, without a path.
    pub fn server(&self) -> String {
        self.server.origin().ascii_serialization()
    }
}

/// The server's address, and the path below it.
fn split(text: &str, example: &str) -> Result<(Url, String), String> {
    let url = Url::parse(text).ok();
    let web = url.filter(|url| matches!(url.scheme(), "http" | "https"));
    let mut server = web.ok_or_else(|| {
        format!("an address that begins with http:// or https:// is expected, such as {example}")
    })?;
    let path = server.path().trim_matches('/').to_owned();
    server.set_path("/");
    server.set_query(None);
    server.set_fragment(None);
    Ok((server, path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_of_writing_a_streams_address_means_the_same() {
        let expected = StreamUrl::parse("http://127.0.0.1:8080/v1/streams/demo").unwrap();
        for text in [
            "http://127.0.0.1:8080/v1/streams/demo/",
            "http://127.0.0.1:8080/watch/demo?wireframe=1",
            "http://127.0.0.1:8080/demo",
        ] {
            assert_eq!(StreamUrl::parse(text).unwrap(), expected, "{text}");
        }
        let frames = "http://127.0.0.1:8080/v1/streams/demo/frames";
        assert_eq!(expected.under("frames").as_str(), frames);
        assert_eq!(
            expected.websocket_under("subscribe", &[]),
            "ws://127.0.0.1:8080/v1/streams/demo/subscribe"
        );
        assert_eq!(
            expected.websocket_under("publish", &[("session", "a?b")]),
            "ws://127.0.0.1:8080/v1/streams/demo/publish?session=a%3Fb"
        );
    }

    #[test]
    fn a_recordings_address_is_one_of_its_own() {
        let recording = StreamUrl::parse_any(RECORDING_EXAMPLE).unwrap();
        assert_eq!(
            recording.under("play").as_str(),
            format!("{RECORDING_EXAMPLE}/play")
        );
        assert_eq!(recording.under("").as_str(), RECORDING_EXAMPLE);
        assert!(recording.is_recording() && !StreamUrl::parse_any(EXAMPLE).unwrap().is_recording());
        assert!(StreamUrl::parse(RECORDING_EXAMPLE).is_err());
        let error = StreamUrl::parse_any("http://h/v1/recordings/demo/latest").unwrap_err();
        assert!(error.contains(RECORDING_EXAMPLE), "{error}");
    }

    #[test]
    fn an_address_without_a_stream_is_refused_with_an_example() {
        for text in [
            "http://127.0.0.1:8080",
            "127.0.0.1:8080/demo",
            "localhost:8080/demo",
            "ftp://h/demo",
            "http://h/v1/streams/A",
            "demo",
        ] {
            let error = StreamUrl::parse(text).unwrap_err();
            assert!(
                error.contains("127.0.0.1:8080/v1/streams/demo"),
                "{text}: {error}"
            );
        }
    }
}
