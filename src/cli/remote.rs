//! A stream on a server, and the ways to it.

use std::time::Duration;

use anyhow::Context;
use clap::Args;
use reqwest::Client;
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
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
pub(super) struct RemoteArguments {
    /// The stream, such as `http://127.0.0.1:8080/v1/streams/demo`.
    url: String,
    /// The token, where the server wants one.
    #[arg(long, env = "STEADYMESH_TOKEN", hide_env_values = true)]
    token: Option<String>,
}

/// A stream on a server.
#[derive(Debug, Clone)]
pub(super) struct Remote {
    pub url: StreamUrl,
    authorization: Option<HeaderValue>,
}

impl Remote {
    /// # Errors
    ///
    /// An address that is none, or a token that cannot be sent.
    pub fn new(arguments: &RemoteArguments) -> anyhow::Result<Self> {
        let authorization = arguments.token.as_ref().map(|token| {
            let mut value = HeaderValue::from_str(&format!("Bearer {token}"))?;
            value.set_sensitive(true);
            anyhow::Ok(value)
        });
        Ok(Self {
            url: StreamUrl::parse(&arguments.url)?,
            authorization: authorization
                .transpose()
                .context("the token cannot be sent")?,
        })
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

    /// Connects to an address under the stream's own, such as `publish?session=…`.
    ///
    /// # Errors
    ///
    /// The server's own words if it has some.
    pub async fn connect(&self, part: &str) -> anyhow::Result<Socket> {
        let address = self.url.websocket_under(part);
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
        let connected = connected.with_context(|| format!("{address} does not answer"))?;
        Ok(connected.map_err(|error| explain(error, &address))?.0)
    }
}

fn explain(error: Error, address: &str) -> anyhow::Error {
    if let Error::Http(response) = &error {
        let body = response.body().as_deref().unwrap_or_default();
        let detail = serde_json::from_slice::<Problem>(body).map(|problem| problem.detail);
        let status = response.status();
        return anyhow::anyhow!(
            "the server answers {status}: {}",
            detail.unwrap_or_default()
        );
    }
    anyhow::Error::new(error).context(format!("{address} cannot be reached"))
}
