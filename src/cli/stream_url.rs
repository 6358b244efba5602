//! The address of a stream, as people write it.

use reqwest::Url;

use crate::streams::StreamName;

const EXAMPLE: &str = "http://127.0.0.1:8080/v1/streams/demo";

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
    pub fn parse(text: &str) -> Result<Self, String> {
        let url = Url::parse(text).ok();
        let web = url.filter(|url| matches!(url.scheme(), "http" | "https"));
        let mut server = web.ok_or_else(|| {
            format!(
                "an address that begins with http:// or https:// is expected, such as {EXAMPLE}"
            )
        })?;
        let path = server.path().trim_matches('/').to_owned();
        let name = ["v1/streams/", "watch/"]
            .iter()
            .find_map(|prefix| path.strip_prefix(prefix))
            .unwrap_or(&path);
        let name = StreamName::parse(name)
            .map_err(|error| format!("it does not name a stream, as {EXAMPLE} does: {error}"))?;
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

    /// An address under the stream's own, such as `frames`.
    pub fn under(&self, part: &str) -> Url {
        let mut url = self.server.clone();
        url.set_path(&format!("/v1/streams/{}/{part}", self.name));
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
