//! The series of one endpoint that is told what happens to streams.

use prometheus::{IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry};

/// Every metric that has the label `endpoint`: the endpoint's name, never its address.
#[derive(Debug, Clone)]
pub(super) struct Families {
    delivered: IntCounterVec,
    failed: IntCounterVec,
    dropped: IntCounterVec,
    queued: IntGaugeVec,
}

/// The series of one endpoint, which end when this is dropped.
#[derive(Debug)]
pub struct EndpointMetrics {
    /// Messages that were taken.
    pub delivered: IntCounter,
    /// Messages that were not, however often they were sent.
    pub failed: IntCounter,
    /// Messages that were not sent for lack of room or time.
    pub dropped: IntCounter,
    /// Messages that wait.
    pub queued: IntGauge,
    families: Families,
    name: String,
}

impl Families {
    pub fn register(registry: &Registry) -> prometheus::Result<Self> {
        let label = &["endpoint"][..];
        let counter = |name: &str, help: &str| {
            let opts = Opts::new(format!("steadymesh_webhooks_{name}_total"), help);
            let family = IntCounterVec::new(opts, label)?;
            registry.register(Box::new(family.clone())).map(|()| family)
        };
        let queued = IntGaugeVec::new(
            Opts::new(
                "steadymesh_webhooks_queued",
                "Webhooks that wait to be delivered.",
            ),
            label,
        )?;
        registry.register(Box::new(queued.clone()))?;
        Ok(Self {
            delivered: counter("delivered", "Webhooks that the endpoint took.")?,
            failed: counter(
                "failed",
                "Webhooks that the endpoint did not take, however often they were sent.",
            )?,
            dropped: counter(
                "dropped",
                "Webhooks that were given up for newer ones, or when the server stopped.",
            )?,
            queued,
        })
    }
}

impl EndpointMetrics {
    pub(super) fn new(families: &Families, name: &str) -> Self {
        let label = &[name];
        Self {
            delivered: families.delivered.with_label_values(label),
            failed: families.failed.with_label_values(label),
            dropped: families.dropped.with_label_values(label),
            queued: families.queued.with_label_values(label),
            families: families.clone(),
            name: name.to_owned(),
        }
    }
}

impl Drop for EndpointMetrics {
    fn drop(&mut self) {
        let label = &[self.name.as_str()];
        let Families {
            delivered,
            failed,
            dropped,
            queued,
        } = &self.families;
        // A series that is not there is not missed.
        for family in [delivered, failed, dropped] {
            family.remove_label_values(label).ok();
        }
        queued.remove_label_values(label).ok();
    }
}
