//! Prometheus's text format, version 0.0.4. Names and units follow its conventions: base units, and counters that end
//! in `_total`.

use std::fmt::{Display, Write as _};

/// A metric family.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// counter, gauge or histogram.
    pub kind: &'static str,
    /// Its name.
    pub name: &'static str,
    /// The names of its labels.
    pub labels: &'static [&'static str],
    /// What it means: HELP on the page, and the text of `explain`.
    pub help: &'static str,
}

/// The text so far. Writing to a `String` cannot fail.
#[derive(Default)]
pub(crate) struct MetricsText(pub(crate) String);

impl MetricsText {
    /// The head of a family, before its samples.
    pub(crate) fn family(&mut self, Metric { kind, name, help, .. }: Metric) {
        let _ = writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    /// A value with its labels.
    pub(crate) fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: impl Display) {
        self.0.push_str(name);
        for (index, (label, value)) in labels.iter().enumerate() {
            let begin = if index == 0 { '{' } else { ',' };
            let value = value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
            let _ = write!(self.0, "{begin}{label}=\"{value}\"");
        }
        let end = if labels.is_empty() { "" } else { "}" };
        let _ = writeln!(self.0, "{end} {value}");
    }

    /// A family with a single sample, if there is a value.
    pub(crate) fn single(&mut self, metric: Metric, value: Option<impl Display>) {
        if let Some(value) = value {
            self.family(metric);
            self.sample(metric.name, &[], value);
        }
    }
}
