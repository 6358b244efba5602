//! A stream on a server, and the ways to it.

use std::time::Duration;

use anyhow::anyhow;
use clap::Args;
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::{Client, StatusCode};
use steadymesh_proto::SUBPROTOCOL;
use steadymesh_proto::stream::Problem;
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Error;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

use super::stream_url::StreamUrl;

/// A server that does not answer within this time is not there.
const PATIENCE: Duration = Duration::from_secs(30);

/// A connection by WebSocket.
pub(super) type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

#[derive(Debug, Args)]
pub(super) struct TokenArgument {
    /// The token, where the server wants one.
    #[arg(long, env = "STEADYMESH_TOKEN", hide_env_values = true)]
    token: Option<String>,
}

impl TokenArgument {
    /// The token, if there is one.
    pub fn get(&self) -> Option<&str> {
        self.token.as_deref()
    }
}

/// A stream on a server.
#[derive(Debug, Clone)]
pub(super) struct Remote {
    pub url: StreamUrl,
    authorization: Option<HeaderValue>,
}

impl Remote {
    /// The stream that was named; a token that cannot be sent is wrong usage.
    pub fn new(url: &StreamUrl, token: &TokenArgument) -> Self {
        Self::with_token(url, token.get())
    }

    /// The same with a token from elsewhere.
    pub fn with_token(url: &StreamUrl, token: Option<&str>) -> Self {
        let authorization = token.map(|token| {
            let value = HeaderValue::from_str(&format!("Bearer {token}"));
            // Not refused by the parser, which would show it.
            let mut value = value.unwrap_or_else(|_| {
                super::wrong_usage("the token has characters that no token can have")
            });
            value.set_sensitive(true);
            value
        });
        Self {
            url: url.clone(),
            authorization,
        }
    }

    /// A client that sends the token with every request.
    ///
    /// # Errors
    ///
    /// If the system's certificates cannot be read.
    pub fn http_client(&self) -> anyhow::Result<Client> {
        let mut headers = HeaderMap::new();
        if let Some(authorization) = &self.authorization {
            headers.insert(AUTHORIZATION, authorization.clone());
        }
        let client = Client::builder().timeout(PATIENCE).default_headers(headers);
        Ok(client.build()?)
    }

    /// Finds out whether there is a server at all, before work is done for it.
    ///
    /// # Errors
    ///
    /// Nobody answers.
    pub async fn reach(&self) -> anyhow::Result<()> {
        let answer = self.http_client()?.get(self.url.under("")).send().await;
        match answer {
            Ok(_) => Ok(()),
            Err(error) => Err(self.unreachable(&error)),
        }
    }

    /// Says that the server does not answer, and why.
    pub fn unreachable(&self, error: &reqwest::Error) -> anyhow::Error {
        anyhow!("{} cannot be reached: {}", self.url.server(), cause(error))
    }

    /// Connects to an address under the stream's own, such as `publish`, with parameters.
    ///
    /// # Errors
    ///
    /// The server's own words if it has some.
    pub async fn connect(&self, part: &str, parameters: &[(&str, &str)]) -> anyhow::Result<Socket> {
        let address = self.url.websocket_under(part, parameters);
        let mut request = address.as_str().into_client_request()?;
        let headers = request.headers_mut();
        headers.insert(
            "sec-websocket-protocol",
            HeaderValue::from_static(SUBPROTOCOL),
        );
        if let Some(authorization) = &self.authorization {
            headers.insert(AUTHORIZATION, authorization.clone());
        }
        let connected = timeout(PATIENCE, tokio_tungstenite::connect_async(request)).await;
        let server = self.url.server();
        let connected = connected.map_err(|_| anyhow!("{server} does not answer"))?;
        Ok(connected.map_err(|error| explain(&error, &server))?.0)
    }
}

/// What is at the bottom of an error; the layers above it say the same again, or nothing.
pub(super) fn cause(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(below) = cause.source() {
        cause = below;
    }
    cause.to_string()
}

/// The server's refusal, by its status and in its own words.
#[derive(Debug, thiserror::Error)]
#[error("the server answers {status}{}", words(.problem.as_deref()))]
pub(super) struct Refusal {
    status: StatusCode,
    problem: Option<Box<Problem>>,
}

impl Refusal {
    /// What an answer of `status` and `body` says.
    pub fn of(status: StatusCode, body: &[u8]) -> Self {
        Self {
            status,
            problem: serde_json::from_slice(body).ok(),
        }
    }

    /// Whether the same request may be answered otherwise a moment later.
    pub fn may_pass(&self) -> bool {
        matches!(
            self.status,
            StatusCode::REQUEST_TIMEOUT | StatusCode::TOO_MANY_REQUESTS
        ) || self.status.is_server_error()
    }

    /// The same for somebody who publishes, and can say so on the command line.
    pub fn into_publisher_error(self) -> anyhow::Error {
        let problem = self.problem.as_ref();
        if problem.is_some_and(|problem| problem.r#type == OCCUPIED) {
            return anyhow!(
                "another publisher is connected to the stream, or expected back: wait until it \
                 has left, or end its connection with --takeover"
            );
        }
        self.into()
    }
}

/// The type of the problem that another publisher is there.
const OCCUPIED: &str = "urn:steadymesh:problem:another-publisher";

fn words(problem: Option<&Problem>) -> String {
    problem.map_or_else(String::new, |problem| format!(": {}", problem.detail))
}

fn explain(error: &Error, server: &str) -> anyhow::Error {
    if let Error::Http(response) = error {
        let body = response.body().as_deref().unwrap_or_default();
        return Refusal::of(response.status(), body).into();
    }
    anyhow!("{server} cannot be reached: {}", cause(error))
}
