//! Spans for a collector of traces. Where none is asked for they do not exist, and cost nothing.

use std::sync::OnceLock;
use std::time::{Duration, SystemTime};

use opentelemetry::propagation::{Extractor, TextMapPropagator};
use opentelemetry::trace::{Span as _, TraceContextExt, Tracer};
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::SdkTracer;
use tracing::{Level, Metadata, Span, Subscriber};
use tracing_opentelemetry::OpenTelemetrySpanExt;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::registry::LookupSpan;

/// The target of spans that are for the collector. Others are for the log.
pub const TARGET: &str = "traces";

/// Makes spans whose beginning is past. Set if traces are collected.
static TRACER: OnceLock<SdkTracer> = OnceLock::new();

/// Whether a span or event is for the collector only.
pub(super) fn is_trace(metadata: &Metadata<'_>) -> bool {
    metadata.target() == TARGET
}

/// What hands spans to `tracer`, and what is logged within them.
pub(super) fn layer<S>(tracer: SdkTracer) -> impl Layer<S>
where
    S: Subscriber + for<'span> LookupSpan<'span>,
{
    TRACER.get_or_init(|| tracer.clone());
    let is_wanted = |metadata: &Metadata<'_>| {
        let is_logged = metadata.is_event()
            && *metadata.level() <= Level::INFO
            && metadata.target().starts_with("steadymesh");
        is_trace(metadata) || is_logged
    };
    tracing_opentelemetry::layer()
        .with_tracer(tracer)
        .with_location(false)
        .with_threads(false)
        .with_target(false)
        .with_tracked_inactivity(false)
        // Nobody looks for it: parents are found among the spans.
        .with_context_activation(false)
        .with_filter(filter_fn(is_wanted).with_max_level_hint(LevelFilter::INFO))
}

/// Adds a stage that has just ended to the current span.
pub fn stage(name: &'static str, elapsed: Duration) {
    let Some(tracer) = TRACER.get() else { return };
    let context = Span::current().context();
    if !context.span().span_context().is_sampled() {
        return;
    }
    let end = SystemTime::now();
    let builder = tracer.span_builder(name).with_start_time(end - elapsed);
    tracer
        .build_with_context(builder, &context)
        .end_with_timestamp(end);
}

/// Makes a span, which must not have been entered, part of the trace that a client says it is
/// part of (W3C Trace Context). `header` finds a header by its name.
pub fn join(span: &Span, header: impl Fn(&str) -> Option<String>) {
    if TRACER.get().is_none() || span.is_disabled() {
        return;
    }
    let headers = Headers(["traceparent", "tracestate"].map(|name| (name, header(name))));
    let context = TraceContextPropagator::new().extract(&headers);
    if context.span().span_context().is_valid() {
        // Fails only for a span that has been entered, or is for the log.
        span.set_parent(context).ok();
    }
}

struct Headers([(&'static str, Option<String>); 2]);

impl Extractor for Headers {
    fn get(&self, key: &str) -> Option<&str> {
        let found = self.0.iter().find(|(name, _)| *name == key);
        found.and_then(|(_, value)| value.as_deref())
    }

    fn keys(&self) -> Vec<&str> {
        self.0.iter().map(|(name, _)| *name).collect()
    }
}
