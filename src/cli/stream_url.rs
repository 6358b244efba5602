//! The address of a stream, as people write it.

use anyhow::{Context, bail};
use reqwest::Url;

use crate::streams::StreamName;

/// A stream on a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct StreamUrl {
    server: Url,
    name: StreamName,
}

impl StreamUrl {
    /// Reads `http://host:port/v1/streams/NAME`, the address of its page
    /// (`http://host:port/watch/NAME`), or just `http://host:port/NAME`.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let mut server = Url::parse(text).with_context(|| {
            format!("{text:?} is not the address of a stream, such as http://127.0.0.1:8080/v1/streams/demo")
        })?;
        if !matches!(server.scheme(), "http" | "https") {
            bail!(
                "{text:?} begins with {}://, not with http:// or https://",
                server.scheme()
            );
        }
        let path = server.path().trim_matches('/').to_owned();
        let name = ["v1/streams/", "watch/"]
            .iter()
            .find_map(|prefix| path.strip_prefix(prefix))
            .unwrap_or(&path);
        let name = StreamName::parse(name).with_context(|| {
            format!(
                "{text:?} does not name a stream, as http://127.0.0.1:8080/v1/streams/demo does"
            )
        })?;
        server.set_path("/");
        server.set_query(None);
        server.set_fragment(None);
        Ok(Self { server, name })
    }

    /// The stream's name.
    pub fn name(&self) -> &StreamName {
        &self.name
    }

    /// The address of the stream's page.
    pub fn page(&self) -> String {
        format!("{}watch/{}", self.server, self.name)
    }

    /// An address under the stream's own, such as `frames` or `publish?session=…`.
    pub fn under(&self, part: &str) -> Url {
        let (path, query) = match part.split_once('?') {
            Some((path, query)) => (path, Some(query)),
            None => (part, None),
        };
        let mut url = self.server.clone();
        url.set_path(&format!("/v1/streams/{}/{path}", self.name));
        url.set_query(query);
        url
    }

    /// The address for a WebSocket under the stream's own, such as `subscribe`.
    pub fn websocket_under(&self, part: &str) -> String {
        self.under(part).to_string().replacen("http", "ws", 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_stays_a_query() {
        let url = StreamUrl::parse("http://rig:8080/demo").unwrap();
        assert_eq!(
            url.websocket_under("publish?session=6f"),
            "ws://rig:8080/v1/streams/demo/publish?session=6f"
        );
    }

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
            expected.websocket_under("subscribe"),
            "ws://127.0.0.1:8080/v1/streams/demo/subscribe"
        );
    }

    #[test]
    fn an_address_without_a_stream_is_refused_with_an_example() {
        for text in [
            "http://127.0.0.1:8080",
            "127.0.0.1:8080/demo",
            "http://h/v1/streams/A",
            "demo",
        ] {
            let error = format!("{:#}", StreamUrl::parse(text).unwrap_err());
            assert!(
                error.contains("127.0.0.1:8080/v1/streams/demo"),
                "{text}: {error}"
            );
        }
    }
}
