//! The metrics in Prometheus's text format, version 0.0.4. Names and units follow its conventions: base units, and counters that
//! end in `_total`.

use isotherm_shared::status::{ImuStatus, LATENCY_BOUNDS_NS, ServiceStatus, TableChange, WorkerStatus};
use isotherm_shared::wire::AXES;
use rustix::process::{Resource, getrlimit};
use rustix::time::{ClockId, clock_gettime};
use std::fmt::{Display, Write as _};
use std::fs;

/// Type of a metric family.
#[derive(Clone, Copy)]
enum Kind {
    Counter,
    Gauge,
    Histogram,
}

/// A metric with one value for each worker: type, name, help text, value.
type WorkerMetric = (Kind, &'static str, &'static str, fn(&WorkerStatus) -> f64);
/// Chooses a sensor's telemetry value or one end of its range.
type ChooseValue = fn(Option<f64>, Option<[f64; 2]>) -> Option<f64>;
/// A metric with one value for each IMU: type, name, help text, value.
type ImuMetric = (Kind, &'static str, &'static str, fn(&ImuStatus) -> Option<f64>);

/// The metrics with one value for each IMU. An IMU without a value is left out.
const IMU_METRICS: [ImuMetric; 16] = [
    (Kind::Counter, "isotherm_samples_received_total", "Raw samples received.", |imu| count(imu.received)),
    (Kind::Counter, "isotherm_increments_total", "Increments published.", |imu| count(imu.compensated)),
    (Kind::Counter, "isotherm_samples_missing_total", "Raw samples that never came.", |imu| count(imu.missing)),
    (Kind::Counter, "isotherm_gaps_total", "Samples before which others were missing.", |imu| count(imu.gaps)),
    (Kind::Counter, "isotherm_samples_repeated_total", "Samples that came again.", |imu| count(imu.repeats)),
    (Kind::Counter, "isotherm_sessions_total", "Starts of an acquisition.", |imu| count(imu.sessions)),
    (Kind::Counter, "isotherm_transport_errors_total", "Failures of the transport.", |imu| count(imu.transport_errors)),
    (Kind::Counter, "isotherm_reloads_total", "Tables taken over after the first.", |imu| count(imu.reloads)),
    (Kind::Counter, "isotherm_reloads_refused_total", "Table files refused.", |imu| count(imu.refusals)),
    (Kind::Gauge, "isotherm_reload_failed", "Whether the table's file as it is now is not in force.", |imu| {
        count(imu.last_reload_error.is_some().into())
    }),
    (Kind::Gauge, "isotherm_table_taken_timestamp_seconds", "When the table in force was taken over.", |imu| {
        imu.table_taken_unix_s
    }),
    (
        Kind::Gauge,
        "isotherm_table_modified_timestamp_seconds",
        "When the file of the table in force was changed.",
        |imu| imu.table_modified_unix_s,
    ),
    (Kind::Gauge, "isotherm_acquisition_connected", "Whether an acquisition is connected.", |imu| {
        count(imu.acquisition_connected.into())
    }),
    (Kind::Gauge, "isotherm_readers", "Processes that read the increments.", |imu| count(imu.readers as u64)),
    (Kind::Gauge, "isotherm_closed_lost_periods", "Periods that the last acquisition to close had lost.", |imu| {
        imu.closed.as_ref().and_then(|closed| count(closed.lost))
    }),
    (Kind::Gauge, "isotherm_closed_unanswered_samples", "Samples that it had no answer to.", |imu| {
        imu.closed.as_ref().and_then(|closed| count(closed.unanswered))
    }),
];

const fn count(count: u64) -> Option<f64> {
    Some(count as f64)
}

/// All metrics of a status and of this process, as text.
pub fn render(status: &ServiceStatus) -> String {
    let mut text = Text(String::with_capacity(16 * 1024));
    text.service(status);
    for (kind, name, help, value) in IMU_METRICS {
        text.family(kind, name, help);
        for imu in &status.imus {
            if let Some(value) = value(imu) {
                text.sample(name, &[("imu", &imu.id)], value);
            }
        }
    }
    text.flags(status);
    text.latency(status);
    text.tables(status);
    text.telemetry(status);
    text.workers(status);
    text.process(status.started_unix_s);
    text.0
}

/// The text so far. Writing to a `String` cannot fail.
struct Text(String);

impl Text {
    fn family(&mut self, kind: Kind, name: &str, help: &str) {
        let kind = match kind {
            Kind::Counter => "counter",
            Kind::Gauge => "gauge",
            Kind::Histogram => "histogram",
        };
        let _ = writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: impl Display) {
        self.0.push_str(name);
        for (index, (label, value)) in labels.iter().enumerate() {
            let begin = if index == 0 { '{' } else { ',' };
            let value = value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
            let _ = write!(self.0, "{begin}{label}=\"{value}\"");
        }
        let end = if labels.is_empty() { "" } else { "}" };
        let _ = writeln!(self.0, "{end} {value}");
    }

    /// A metric family with a single sample.
    fn single(&mut self, kind: Kind, name: &str, help: &str, value: impl Display) {
        self.family(kind, name, help);
        self.sample(name, &[], value);
    }

    fn service(&mut self, status: &ServiceStatus) {
        let name = "isotherm_build_info";
        self.family(Kind::Gauge, name, "Version of the service; always 1.");
        self.sample(name, &[("version", &status.version)], 1);
        let name = "isotherm_service_info";
        self.family(Kind::Gauge, name, "Domain and waiting strategy of the service; always 1.");
        self.sample(name, &[("domain", &status.domain.name), ("wait", &status.wait)], 1);
        let budget = format!("{:e}", status.budget_us / 1e6);
        self.single(Kind::Gauge, "isotherm_latency_budget_seconds", "Latency over which an increment is late.", budget);
        let locked = status.memory_locked_kb * 1024;
        self.single(Kind::Gauge, "isotherm_memory_locked_bytes", "Memory that is kept resident.", locked);
    }

    fn flags(&mut self, status: &ServiceStatus) {
        let name = "isotherm_flagged_total";
        self.family(Kind::Counter, name, "Increments that carried a flag.");
        for imu in &status.imus {
            for (flag, count) in &imu.flagged {
                self.sample(name, &[("imu", &imu.id), ("flag", flag)], count);
            }
        }
    }

    fn latency(&mut self, status: &ServiceStatus) {
        let name = "isotherm_latency_seconds";
        self.family(Kind::Histogram, name, "From sending a raw sample to just before publishing its increment.");
        for imu in &status.imus {
            let mut total = 0;
            for (index, count) in imu.latency_distribution.counts.iter().enumerate() {
                total += count;
                let bound = LATENCY_BOUNDS_NS
                    .get(index)
                    .map_or_else(|| "+Inf".to_owned(), |bound| format!("{:e}", *bound as f64 / 1e9));
                self.sample(&format!("{name}_bucket"), &[("imu", &imu.id), ("le", &bound)], total);
            }
            self.sample(&format!("{name}_sum"), &[("imu", &imu.id)], imu.latency_distribution.sum_s);
            self.sample(&format!("{name}_count"), &[("imu", &imu.id)], total);
        }
    }

    fn tables(&mut self, status: &ServiceStatus) {
        let name = "isotherm_table_info";
        self.family(Kind::Gauge, name, "Digest and file of the table in force; always 1.");
        for imu in &status.imus {
            if let Some(table) = &imu.table {
                self.sample(name, &[("imu", &imu.id), ("table", table), ("file", &imu.table_file)], 1);
            }
        }
        let name = "isotherm_table_change";
        self.family(Kind::Gauge, name, "Largest change of a curve by the table in force.");
        for imu in &status.imus {
            for TableChange { name: curve, size, unit } in &imu.table_changes {
                self.sample(name, &[("imu", &imu.id), ("curve", curve), ("unit", unit)], size);
            }
        }
    }

    /// The table gives the unit of telemetry, so the metric's name has none. An IMU without gyroscopes has no series of them.
    fn telemetry(&mut self, status: &ServiceStatus) {
        let families: [(&str, &str, ChooseValue); 3] = [
            ("isotherm_telemetry", "Temperature telemetry of the last sample, in the table's unit.", |value, _| value),
            ("isotherm_telemetry_range_low", "Where the table's calibrated range begins.", |_, range| Some(range?[0])),
            ("isotherm_telemetry_range_high", "Where the table's calibrated range ends.", |_, range| Some(range?[1])),
        ];
        for (name, help, choose) in families {
            self.family(Kind::Gauge, name, help);
            for imu in &status.imus {
                let accelerometers = ("a", imu.ranges.as_ref(), imu.head_temperature, imu.board_temperature);
                let gyroscopes = imu.gyroscopes.as_ref();
                let gyroscopes = gyroscopes.map(|g| ("g", Some(&g.ranges), g.head_temperature, g.board_temperature));
                for (letter, ranges, head, board) in [accelerometers].into_iter().chain(gyroscopes) {
                    let places = [
                        ("head", head, ranges.map(|ranges| ranges.head)),
                        ("board", board, ranges.map(|ranges| ranges.board)),
                    ];
                    for (place, values, ranges) in places {
                        for axis in 0..AXES {
                            if let Some(value) = choose(values[axis], ranges.map(|ranges| ranges[axis])) {
                                let axis = format!("{letter}{}", axis + 1);
                                self.sample(name, &[("imu", &imu.id), ("axis", &axis), ("place", place)], value);
                            }
                        }
                    }
                }
            }
        }
    }

    fn workers(&mut self, status: &ServiceStatus) {
        let families: [WorkerMetric; 3] = [
            (Kind::Counter, "isotherm_worker_cpu_seconds_total", "Processor time of a worker.", |worker| worker.cpu_s),
            (
                Kind::Counter,
                "isotherm_worker_held_back_seconds_total",
                "Time in which a worker could have run and did not.",
                |worker| worker.held_back_s,
            ),
            (Kind::Gauge, "isotherm_worker_stands_still", "Whether a worker's IMUs are not served.", |worker| {
                f64::from(u8::from(worker.stands_still))
            }),
        ];
        for (kind, name, help, value) in families {
            self.family(kind, name, help);
            for (index, worker) in status.workers.iter().enumerate() {
                self.sample(name, &[("worker", &index.to_string())], value(worker));
            }
        }
    }

    /// The process metrics, under the names that all exporters use.
    fn process(&mut self, started_unix_s: f64) {
        let cpu = clock_gettime(ClockId::ProcessCPUTime);
        let cpu = cpu.tv_sec as f64 + cpu.tv_nsec as f64 * 1e-9;
        self.single(Kind::Counter, "process_cpu_seconds_total", "Processor time of the service.", cpu);
        let resident = isotherm_client::process_kb("VmRSS").map(|kb| kb * 1024);
        let name = "process_resident_memory_bytes";
        self.optional(Kind::Gauge, name, "Resident memory of the service.", resident);
        let open = fs::read_dir("/proc/self/fd").ok().map(Iterator::count);
        self.optional(Kind::Gauge, "process_open_fds", "Open descriptors of the service.", open);
        let most = getrlimit(Resource::Nofile).current;
        self.optional(Kind::Gauge, "process_max_fds", "Most descriptors that it may open.", most);
        let name = "process_start_time_seconds";
        self.single(Kind::Gauge, name, "When the service began, Unix time.", started_unix_s);
    }

    fn optional(&mut self, kind: Kind, name: &str, help: &str, value: Option<impl Display>) {
        if let Some(value) = value {
            self.single(kind, name, help, value);
        }
    }
}
