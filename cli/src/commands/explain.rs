//! What `explain` has in addition to the names of the offline commands: metrics, and states of `top`.

use crate::top;
use isotherm_command::explain::Topic;
use isotherm_exporter::{Metric, metrics};

/// Metrics and states.
pub(super) fn live_topics() -> Vec<Topic> {
    let state = |(name, meaning): &(&str, &str)| Topic::new("state of top", *name, String::new(), meaning, "");
    let metric = |metric: Metric| {
        let labels = if metric.labels.is_empty() { "no labels".to_owned() } else { metric.labels.join(", ") };
        Topic::new("metric", metric.name, format!("{}; {labels}", metric.kind), metric.help, "")
    };
    metrics().map(metric).chain(top::STATES.iter().map(state)).collect()
}
