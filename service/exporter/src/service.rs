//! The metrics of the service, from its status.

use crate::metric::{Metric, MetricsText};
use isotherm_shared::status::{ImuStatus, LATENCY_BOUNDS_NS, ServiceStatus, TableChange, WorkerStatus};
use isotherm_shared::wire::AXES;

/// A metric with one value for each IMU; an IMU without a value is left out.
type ImuMetric = (Metric, fn(&ImuStatus) -> Option<f64>);
/// A metric with one value for each worker.
type WorkerMetric = (Metric, fn(&WorkerStatus) -> f64);
/// Chooses a sensor's temperature value or one end of its range.
type ChooseValue = fn(Option<f64>, Option<[f64; 2]>) -> Option<f64>;

/// Declares every metric once: those of an IMU with their values, and a constant of each other.
macro_rules! metrics {
    (
        $($imu_kind:ident $imu_name:literal = $value:expr, $imu_help:literal;)+
        ---
        $($constant:ident = $kind:ident $name:literal [$($label:ident),*] $help:literal;)+
    ) => {
        const IMU_METRICS: &[ImuMetric] = &[$((
            Metric { kind: stringify!($imu_kind), name: $imu_name, labels: &["imu"], help: $imu_help },
            $value,
        )),+];
        $(const $constant: Metric = Metric {
            kind: stringify!($kind),
            name: $name,
            labels: &[$(stringify!($label)),*],
            help: $help,
        };)+
        const OTHER_METRICS: &[Metric] = &[$($constant),+];
    };
}

metrics! {
    counter "isotherm_samples_received_total" = |imu| count(imu.received), "Raw samples received.";
    gauge "isotherm_sample_rate_hz" = |imu| count(imu.rate_hz), "Raw samples received in the last second [Hz].";
    gauge "isotherm_last_sample_timestamp_seconds" = |imu| imu.last_sample_unix_s,
        "Unix time of the last sample, to within a second; absent before the first.";
    counter "isotherm_increments_total" = |imu| count(imu.compensated), "Increments published.";
    counter "isotherm_samples_missing_total" = |imu| count(imu.missing), "Raw samples that never came.";
    counter "isotherm_gaps_total" = |imu| count(imu.gaps), "Samples before which others of their session were missing.";
    counter "isotherm_samples_repeated_total" = |imu| count(imu.repeats),
        "Samples whose sequence did not rise: resends.";
    counter "isotherm_sessions_total" = |imu| count(imu.sessions), "Starts of an acquisition.";
    counter "isotherm_session_missing_periods_total" = |imu| count(imu.session_missing),
        "Control periods between two sessions, where both have timestamps of the same clock.";
    counter "isotherm_session_unknown_total" = |imu| count(imu.session_unknown),
        "Changes of session with an unknown number of control periods between.";
    counter "isotherm_transport_errors_total" = |imu| count(imu.transport_errors),
        "Failures of receiving or publishing; should be 0.";
    counter "isotherm_reloads_total" = |imu| count(imu.reloads), "Tables taken over after the first.";
    counter "isotherm_reloads_refused_total" = |imu| count(imu.refusals),
        "Table files refused, missing files included.";
    gauge "isotherm_reload_failed" = |imu| count(imu.last_reload_error.is_some().into()),
        "Whether the current file of the table is not in force: 0 or 1.";
    gauge "isotherm_table_kept" = |imu| imu.table.as_ref().and_then(|_| count(imu.table_kept.into())),
        "Whether the table in force is kept for the next start: 0 or 1; absent without a table.";
    gauge "isotherm_table_taken_timestamp_seconds" = |imu| imu.table_taken_unix_s,
        "When the table in force was taken over, Unix time.";
    gauge "isotherm_table_modified_timestamp_seconds" = |imu| imu.table_modified_unix_s,
        "When the file of the table in force was changed, Unix time.";
    gauge "isotherm_acquisition_connected" = |imu| count(imu.acquisition_connected.into()),
        "Whether an acquisition is connected: 0 or 1.";
    gauge "isotherm_readers" = |imu| count(imu.readers as u64),
        "Processes that read the increments, the acquisition among them.";
    gauge "isotherm_closed_lost_periods" = |imu| imu.closed.as_ref().and_then(|closed| count(closed.lost)),
        "Control periods that the last acquisition to close with a loss had not sent; absent if none did.";
    gauge "isotherm_closed_unanswered_samples" = |imu| imu.closed.as_ref().and_then(|closed| count(closed.unanswered)),
        "Samples that the last acquisition to close with a loss had sent without getting their increments.";
    ---
    BUILD = gauge "isotherm_build_info" [version] "Version of the service; always 1.";
    SERVICE = gauge "isotherm_service_info" [domain, wait] "Domain and waiting strategy of the service; always 1.";
    BUDGET = gauge "isotherm_latency_budget_seconds" [] "Latency over which an increment is flagged late.";
    LOCKED = gauge "isotherm_memory_locked_bytes" [] "Memory of the service that is kept resident.";
    CONFIGURATION = gauge "isotherm_configuration_refused" []
        "Whether the file of the configuration was refused at the start, so that the last one that worked is in use: 0 or 1.";
    FLAGGED = counter "isotherm_flagged_total" [imu, flag]
        "Increments that carried a flag, other-device since the table in force was taken. Absent are flags that the table in \
         force cannot give and no table has given.";
    LATENCY = histogram "isotherm_latency_seconds" [imu, le]
        "From sending a raw sample (sent_ns) to just before publishing its increment. Buckets end at 1, 2 and 5 times \
         powers of ten, from 0.2 us to 1 s. Up to 3 % below a bound a value may count above it, never the reverse; the \
         sum is right to within 1.6 %.";
    TABLE = gauge "isotherm_table_info" [imu, table, file]
        "Digest and file of the table in force; always 1, absent without one.";
    TABLE_CHANGE = gauge "isotherm_table_change" [imu, curve, unit]
        "Largest change of a curve by the table in force, in the label unit; absent if there was none before.";
    TEMPERATURE = gauge "isotherm_telemetry" [imu, axis, place]
        "Temperature of the last sample, in the table's unit, by axis (a1 to a3; g1 to g3 where the table \
         has gyroscopes) and place (head, board); absent where it is not finite.";
    RANGE_LOW = gauge "isotherm_telemetry_range_low" [imu, axis, place]
        "Where the table's calibrated range begins, in its unit.";
    RANGE_HIGH = gauge "isotherm_telemetry_range_high" [imu, axis, place]
        "Where the table's calibrated range ends, in its unit.";
    WORKER_CPU = counter "isotherm_worker_cpu_seconds_total" [worker] "Processor time of a worker.";
    WORKER_HELD_BACK = counter "isotherm_worker_held_back_seconds_total" [worker]
        "Time in which a worker was ready to run but did not run.";
    WORKER_STANDS_STILL = gauge "isotherm_worker_stands_still" [worker]
        "Whether a worker's loop has not turned for a second, so that its IMUs are not served: 0 or 1.";
    PROCESS_CPU = counter "process_cpu_seconds_total" [] "Processor time of the service.";
    PROCESS_RESIDENT = gauge "process_resident_memory_bytes" [] "Resident memory of the service.";
    PROCESS_OPEN = gauge "process_open_fds" [] "Descriptors that the service has open.";
    PROCESS_LIMIT = gauge "process_max_fds" [] "Descriptors that the service may open.";
    PROCESS_START = gauge "process_start_time_seconds" [] "When the service began, Unix time.";
}

const fn count(count: u64) -> Option<f64> {
    Some(count as f64)
}

/// Every metric of the service.
pub(crate) fn metrics() -> impl Iterator<Item = Metric> {
    IMU_METRICS.iter().map(|(metric, _)| *metric).chain(OTHER_METRICS.iter().copied())
}

/// Writes all metrics of a status.
pub(crate) fn render(text: &mut MetricsText, status: &ServiceStatus) {
    service(text, status);
    for (metric, value) in IMU_METRICS {
        text.family(*metric);
        for imu in &status.imus {
            if let Some(value) = value(imu) {
                text.sample(metric.name, &[("imu", &imu.id)], value);
            }
        }
    }
    flags(text, status);
    latency(text, status);
    tables(text, status);
    temperature(text, status);
    workers(text, status);
    process(text, status);
}

fn service(text: &mut MetricsText, status: &ServiceStatus) {
    text.family(BUILD);
    text.sample(BUILD.name, &[("version", &status.version)], 1);
    text.family(SERVICE);
    text.sample(SERVICE.name, &[("domain", &status.domain.name), ("wait", &status.wait)], 1);
    text.single(BUDGET, Some(format!("{:e}", status.budget_us / 1e6)));
    text.single(LOCKED, Some(status.memory_locked_kb * 1024));
    text.single(CONFIGURATION, Some(u8::from(status.configuration_error.is_some())));
}

fn flags(text: &mut MetricsText, status: &ServiceStatus) {
    text.family(FLAGGED);
    for imu in &status.imus {
        for (flag, count) in &imu.flagged {
            text.sample(FLAGGED.name, &[("imu", &imu.id), ("flag", flag)], count);
        }
    }
}

fn latency(text: &mut MetricsText, status: &ServiceStatus) {
    text.family(LATENCY);
    let name = LATENCY.name;
    for imu in &status.imus {
        let mut total = 0;
        for (index, count) in imu.latency_distribution.counts.iter().enumerate() {
            total += count;
            let bound = LATENCY_BOUNDS_NS
                .get(index)
                .map_or_else(|| "+Inf".to_owned(), |bound| format!("{:e}", *bound as f64 / 1e9));
            text.sample(&format!("{name}_bucket"), &[("imu", &imu.id), ("le", &bound)], total);
        }
        text.sample(&format!("{name}_sum"), &[("imu", &imu.id)], imu.latency_distribution.sum_s);
        text.sample(&format!("{name}_count"), &[("imu", &imu.id)], total);
    }
}

fn tables(text: &mut MetricsText, status: &ServiceStatus) {
    text.family(TABLE);
    for imu in &status.imus {
        if let Some(table) = &imu.table {
            text.sample(TABLE.name, &[("imu", &imu.id), ("table", table), ("file", &imu.table_file)], 1);
        }
    }
    text.family(TABLE_CHANGE);
    for imu in &status.imus {
        for TableChange { name: curve, size, unit } in &imu.table_changes {
            text.sample(TABLE_CHANGE.name, &[("imu", &imu.id), ("curve", curve), ("unit", unit)], size);
        }
    }
}

/// The table gives the unit of temperature, so the metric's name has none. An IMU without gyroscopes has no series of
/// them.
fn temperature(text: &mut MetricsText, status: &ServiceStatus) {
    let families: [(Metric, ChooseValue); 3] = [
        (TEMPERATURE, |value, _| value),
        (RANGE_LOW, |_, range| Some(range?[0])),
        (RANGE_HIGH, |_, range| Some(range?[1])),
    ];
    for (metric, choose) in families {
        text.family(metric);
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
                            text.sample(metric.name, &[("imu", &imu.id), ("axis", &axis), ("place", place)], value);
                        }
                    }
                }
            }
        }
    }
}

fn workers(text: &mut MetricsText, status: &ServiceStatus) {
    let families: [WorkerMetric; 3] = [
        (WORKER_CPU, |worker| worker.cpu_s),
        (WORKER_HELD_BACK, |worker| worker.held_back_s),
        (WORKER_STANDS_STILL, |worker| f64::from(u8::from(worker.stands_still))),
    ];
    for (metric, value) in families {
        text.family(metric);
        for (index, worker) in status.workers.iter().enumerate() {
            text.sample(metric.name, &[("worker", &index.to_string())], value(worker));
        }
    }
}

/// The process metrics of the service, under the names that all exporters use.
fn process(text: &mut MetricsText, status: &ServiceStatus) {
    text.single(PROCESS_CPU, Some(status.cpu_s));
    text.single(PROCESS_RESIDENT, Some(status.memory_resident_kb * 1024));
    text.single(PROCESS_OPEN, status.open_descriptors);
    text.single(PROCESS_LIMIT, status.max_descriptors);
    text.single(PROCESS_START, Some(status.started_unix_s));
}
