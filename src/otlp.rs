//! Sends traces to a collector by OTLP over HTTP, if the usual `OTEL_*` variables ask for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytes::Bytes;
use futures_util::future::BoxFuture;
use opentelemetry::trace::TracerProvider;
use opentelemetry::{Key, KeyValue};
use opentelemetry_http::{HttpClient, HttpError, Request, Response};
use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{SdkTracer, SdkTracerProvider};
use tokio::runtime::Handle;

const NAME: &str = "steadymesh";
const HTTP_PROTOBUF: &str = "http/protobuf";
const SERVICE_NAME: Key = Key::from_static_str("service.name");
/// How long the last spans may take to be delivered when the server stops.
const FAREWELL: Duration = Duration::from_secs(3);
/// A collector has nothing long to say.
const MAX_ANSWER_BYTES: usize = 64 << 10;
/// How long the collector may take unless `OTEL_EXPORTER_OTLP_TIMEOUT` says otherwise.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Delivers spans in the background. What does not fit into its queue (`OTEL_BSP_MAX_QUEUE_SIZE`)
/// is dropped: nobody waits for a collector.
#[derive(Debug)]
pub struct Traces {
    provider: SdkTracerProvider,
}

/// The variables ask for something that is not there.
#[derive(Debug, thiserror::Error)]
#[error("traces cannot be exported as the OTEL_ variables ask for: {0}")]
pub struct NotExported(String);

impl Traces {
    /// What the environment asks for: nothing without `OTEL_EXPORTER_OTLP_ENDPOINT` or
    /// `OTEL_EXPORTER_OTLP_TRACES_ENDPOINT`, or with `OTEL_SDK_DISABLED=true`. Requests are made
    /// on `runtime`.
    ///
    /// # Errors
    ///
    /// [`NotExported`].
    pub fn from_environment(runtime: &Handle) -> Result<Option<Self>, NotExported> {
        if !is_asked_for(|name| std::env::var(name).ok()) {
            return Ok(None);
        }
        let protocol = protocol(|name| std::env::var(name).ok());
        if protocol
            .as_ref()
            .is_some_and(|protocol| protocol != HTTP_PROTOBUF)
        {
            return Err(NotExported(format!(
                "the protocol is to be {}, but only {HTTP_PROTOBUF} is spoken here",
                protocol.unwrap_or_default()
            )));
        }
        let client = Collector {
            client: reqwest::Client::builder()
                .redirect(reqwest::redirect::Policy::none())
                .timeout(timeout(|name| std::env::var(name).ok()))
                .build()
                .map_err(|error| NotExported(error.to_string()))?,
            runtime: runtime.clone(),
            is_failing: Arc::default(),
        };
        let exporter = SpanExporter::builder()
            .with_http()
            .with_protocol(Protocol::HttpBinary)
            .with_http_client(client)
            .build()
            .map_err(|error| NotExported(error.to_string()))?;
        let provider = SdkTracerProvider::builder()
            .with_batch_exporter(exporter)
            .with_resource(resource())
            .build();
        Ok(Some(Self { provider }))
    }

    /// Makes spans.
    #[must_use]
    pub fn tracer(&self) -> SdkTracer {
        self.provider.tracer(NAME)
    }

    /// Delivers what is left, within a few seconds. It blocks: the runtime must go on elsewhere.
    pub fn shut_down(self) {
        if self.provider.shutdown_with_timeout(FAREWELL).is_err() {
            tracing::warn!("the last traces were not delivered");
        }
    }
}

/// Whether the variables ask for traces.
fn is_asked_for(variable: impl Fn(&str) -> Option<String>) -> bool {
    let is = |name, value: &str| {
        variable(name).is_some_and(|found| found.trim().eq_ignore_ascii_case(value))
    };
    let has = |name| variable(name).is_some_and(|found| !found.trim().is_empty());
    let is_off = is("OTEL_SDK_DISABLED", "true") || is("OTEL_TRACES_EXPORTER", "none");
    !is_off && (has("OTEL_EXPORTER_OTLP_ENDPOINT") || has("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"))
}

/// The protocol that is asked for, if any is.
fn protocol(variable: impl Fn(&str) -> Option<String>) -> Option<String> {
    let names = [
        "OTEL_EXPORTER_OTLP_TRACES_PROTOCOL",
        "OTEL_EXPORTER_OTLP_PROTOCOL",
    ];
    let found = names.iter().find_map(|name| variable(name));
    found
        .map(|found| found.trim().to_owned())
        .filter(|found| !found.is_empty())
}

/// The exporter does not tell a client that is not its own.
fn timeout(variable: impl Fn(&str) -> Option<String>) -> Duration {
    let names = [
        "OTEL_EXPORTER_OTLP_TRACES_TIMEOUT",
        "OTEL_EXPORTER_OTLP_TIMEOUT",
    ];
    let milliseconds = names
        .iter()
        .find_map(|name| variable(name)?.trim().parse().ok());
    milliseconds.map_or(TIMEOUT, Duration::from_millis)
}

/// Who we are: what `OTEL_SERVICE_NAME` and `OTEL_RESOURCE_ATTRIBUTES` say, else our own name.
fn resource() -> Resource {
    let version = KeyValue::new("service.version", env!("CARGO_PKG_VERSION"));
    let found = Resource::builder().build();
    let name = found.get_ref(&SERVICE_NAME).map(ToString::to_string);
    let is_ours = name.is_none_or(|name| name.starts_with("unknown_service"));
    let builder = Resource::builder().with_attribute(version);
    if is_ours {
        builder.with_service_name(NAME).build()
    } else {
        builder.build()
    }
}

/// The way to the collector. The exporter has a thread of its own; requests need the runtime.
#[derive(Debug)]
struct Collector {
    client: reqwest::Client,
    runtime: Handle,
    is_failing: Arc<AtomicBool>,
}

impl HttpClient for Collector {
    fn send_bytes<'life, 'future>(
        &'life self,
        request: Request<Bytes>,
    ) -> BoxFuture<'future, Result<Response<Bytes>, HttpError>>
    where
        'life: 'future,
        Self: 'future,
    {
        let (client, is_failing) = (self.client.clone(), Arc::clone(&self.is_failing));
        let sent = self.runtime.spawn(async move {
            let outcome = send(&client, request).await;
            let fails = !matches!(&outcome, Ok(answer) if answer.status().is_success());
            // Said when it changes: a collector that is away would fill the log.
            if fails != is_failing.swap(fails, Ordering::Relaxed) {
                if fails {
                    tracing::warn!("the collector does not take traces");
                } else {
                    tracing::info!("the collector takes traces again");
                }
            }
            outcome
        });
        Box::pin(async move { sent.await? })
    }
}

async fn send(
    client: &reqwest::Client,
    request: Request<Bytes>,
) -> Result<Response<Bytes>, HttpError> {
    let request = reqwest::Request::try_from(request)?;
    let mut answer = client.execute(request).await?;
    let mut response = Response::builder().status(answer.status());
    if let Some(headers) = response.headers_mut() {
        *headers = std::mem::take(answer.headers_mut());
    }
    let mut body = Vec::new();
    while let Some(chunk) = answer.chunk().await? {
        if MAX_ANSWER_BYTES < body.len() + chunk.len() {
            return Err("the collector's answer is too long".into());
        }
        body.extend_from_slice(&chunk);
    }
    Ok(response.body(Bytes::from(body))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(variables: &[(&str, &str)]) -> bool {
        is_asked_for(|name| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn traces_are_exported_only_if_the_environment_asks_for_it() {
        let endpoint = ("OTEL_EXPORTER_OTLP_ENDPOINT", "http://localhost:4318");
        let traces = (
            "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT",
            "http://localhost:4318/v1/traces",
        );
        assert!(asked(&[endpoint]) && asked(&[traces]));
        assert!(!asked(&[]) && !asked(&[("OTEL_EXPORTER_OTLP_ENDPOINT", "")]));
        assert!(!asked(&[endpoint, ("OTEL_SDK_DISABLED", "TRUE")]));
        assert!(!asked(&[endpoint, ("OTEL_TRACES_EXPORTER", "none")]));
    }
}
