//! The status document, which the service publishes as JSON on the stream `isotherm/status`.

use crate::names::Domain;
use crate::nominal::nominal_ns;
use crate::table::{Axis, CoefficientTable, PulseScale};
use crate::wire::AXES;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Declares a part of the status. The documentation of each field is also its meaning in `FIELDS`, for `isotherm
/// explain`.
macro_rules! described {
    (
        $(#[$outer:meta])*
        pub struct $name:ident {
            $($(#[doc = $meaning:literal])+ $(#[serde $serde:tt])? pub $field:ident: $kind:ty,)+
        }
    ) => {
        $(#[$outer])*
        pub struct $name {
            $($(#[doc = $meaning])+ $(#[serde $serde])? pub $field: $kind,)+
        }

        impl $name {
            /// Name and meaning of each field.
            const FIELDS: &[(&str, &str)] = &[$((stringify!($field), concat!($($meaning),+))),+];
        }
    };
}

/// Path, as for jq, and meaning of every field of the status.
#[must_use]
pub fn fields() -> Vec<(String, &'static str)> {
    let parts = [
        ("", ServiceStatus::FIELDS),
        ("domain.", DomainStatus::FIELDS),
        ("workers[].", WorkerStatus::FIELDS),
        ("imus[].", ImuStatus::FIELDS),
        ("imus[].ranges.", Ranges::FIELDS),
        ("imus[].gyroscopes.", GyroscopeStatus::FIELDS),
        ("imus[].table_changes[].", TableChange::FIELDS),
        ("imus[].latency_ns.", LatencySummary::FIELDS),
        ("imus[].latency_distribution.", LatencyDistribution::FIELDS),
        ("imus[].closed.", ClosedStatus::FIELDS),
    ];
    parts
        .iter()
        .flat_map(|(path, fields)| fields.iter().map(move |(name, meaning)| (format!("{path}{name}"), *meaning)))
        .collect()
}

described! {
/// Status of the running service.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct ServiceStatus {
    /// The domain, with all that another process needs to join it.
    pub domain: DomainStatus,
    /// The file of the configuration; null without one.
    #[serde(default)]
    pub configuration_file: Option<String>,
    /// Why that file was refused at the start, so that the last configuration with which the service has started is in
    /// use; null if the file is.
    #[serde(default)]
    pub configuration_error: Option<String>,
    /// Process id of the service, in its pid namespace.
    pub pid: u32,
    /// Number of the service's pid namespace, as `ls -l /proc/self/ns/pid` shows it; 0 if it is not known.
    #[serde(default)]
    pub pid_namespace: u64,
    /// How far `CLOCK_MONOTONIC` of the service's time namespace is ahead of the machine's \[ns\]; not 0 in some
    /// containers.
    #[serde(default)]
    pub clock_offset_ns: i64,
    /// How far Unix time is ahead of `CLOCK_MONOTONIC` of the service \[ns\], measured once a second: a `timestamp_ns`
    /// of that clock and this give the time of day.
    #[serde(default)]
    pub unix_offset_ns: i64,
    /// By how much that offset may be off, a bound \[ns\]; 0 from a service that does not report it.
    #[serde(default)]
    pub unix_offset_uncertainty_ns: u64,
    /// Steps of that offset since the service started: Unix time was set, or had a leap second.
    #[serde(default)]
    pub unix_steps: u64,
    /// Version of the service.
    pub version: String,
    /// Seconds since it started.
    pub uptime_s: f64,
    /// When it started, Unix time \[s\].
    pub started_unix_s: f64,
    /// `CLOCK_MONOTONIC` when this was written \[ns\].
    pub taken_ns: u64,
    /// How the workers wait: spin, anticipate or block.
    pub wait: String,
    /// Latency over which an increment is flagged `late` \[us\].
    pub budget_us: f64,
    /// The worker threads.
    pub workers: Vec<WorkerStatus>,
    /// Memory of the process that is locked, and so kept resident: `[realtime] lock_memory` \[kB\].
    pub memory_locked_kb: u64,
    /// Processor time of the process since its start \[s\].
    #[serde(default)]
    pub cpu_s: f64,
    /// Memory of the process that is resident \[kB\].
    #[serde(default)]
    pub memory_resident_kb: u64,
    /// Descriptors that the process has open; null if the kernel does not report it.
    #[serde(default)]
    pub open_descriptors: Option<u64>,
    /// Descriptors that the process may open; null without a limit.
    #[serde(default)]
    pub max_descriptors: Option<u64>,
    /// The IMUs that are served.
    pub imus: Vec<ImuStatus>,
}
}

described! {
/// One worker thread; the figures are the operating system's.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct WorkerStatus {
    /// Thread id.
    pub thread: i32,
    /// The IMUs that it serves.
    pub imus: Vec<String>,
    /// The cores that it may use, for example `0-1`.
    pub cores: String,
    /// `SCHED_FIFO` priority; null without one.
    pub priority: Option<u32>,
    /// Timer slack: how much later than requested a sleep may end \[ns\]; null if the kernel does not report it.
    pub timer_slack_ns: Option<u64>,
    /// Processor time in the last second, in percent of one core \[%\].
    pub cpu_percent: f64,
    /// Processor time since the thread's start \[s\].
    pub cpu_s: f64,
    /// Time since the thread's start in which it was ready to run but did not run \[s\].
    pub held_back_s: f64,
    /// Time in the last second in which it was ready to run but did not run, because other threads ran or the kernel
    /// throttled it \[ms\]. With a real-time priority over 10 ms are logged once.
    pub held_back_ms: f64,
    /// `CLOCK_MONOTONIC` when its loop was last seen to have turned; looked at 20 times a second \[ns\].
    #[serde(default)]
    pub heartbeat_ns: u64,
    /// Whether its loop has made no turn for a second, so that its IMUs are not served: it is traced, its core is held
    /// by another, or it hangs. `STANDS STILL` for people; restart the service if it stays so.
    pub stands_still: bool,
}
}

described! {
/// A domain, in the terms of iceoryx2's configuration.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct DomainStatus {
    /// Name, as for `--domain`.
    pub name: String,
    /// `global.prefix`.
    pub prefix: String,
    /// `global.root-path`.
    pub root_path: String,
}
}

described! {
/// Status of one IMU.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct ImuStatus {
    /// Name of the IMU.
    pub id: String,
    /// Digest of the table in force; null without one.
    pub table: Option<String>,
    /// The watched table file.
    pub table_file: String,
    /// When the service began to use the table in force, Unix time \[s\]; null without one.
    pub table_taken_unix_s: Option<f64>,
    /// When the table's file was last changed, Unix time \[s\].
    pub table_modified_unix_s: Option<f64>,
    /// Serial number in the table in force; null without one.
    pub serial: Option<String>,
    /// Number of the device that the table in force belongs to, 16 hexadecimal digits; null without a serial number.
    pub device: Option<String>,
    /// Number of the device that the last sample came from, if it was answered with the table in force and that is not
    /// the table's device; otherwise null. `OTHER DEVICE` for people.
    pub other_device: Option<String>,
    /// Time constant of the lagged temperature in the table in force \[s\]; null without one.
    pub lag_s: Option<f64>,
    /// Time constant of the lagged temperature of the last sample \[s\]; null if it has none, or before the first
    /// sample. If it is not `lag_s`, increments are flagged `lag-unknown`: `OTHER LAG` for people.
    pub sample_lag_s: Option<f64>,
    /// Time between the reading of the temperature and the end of the last sample \[s\]; null if the acquisition does
    /// not give it, or before the first sample. `age not given` for people.
    #[serde(default)]
    pub temperature_age_s: Option<f64>,
    /// Whether the last increment was flagged `telemetry-stale`: its temperature is too old. `STALE` for people.
    #[serde(default)]
    pub temperature_stale: bool,
    /// Nominal interval that the scale factors of the table in force are of \[s\]; null without one, as of counts.
    #[serde(default)]
    pub nominal_interval_s: Option<f64>,
    /// What one pulse of A1 to A3 stands for by the table in force, g0 / K+ in the middle of the range \[m/s\]; null
    /// without a table. A source of readings makes its pulses for the nominal interval, and compares them with this.
    #[serde(default)]
    pub pulse_velocity: Option<[f64; AXES]>,
    /// The temperature that its polynomials were calibrated over; null without a table.
    pub ranges: Option<Ranges>,
    /// Head temperature of the last sample, A1 to A3, in the table's unit; null if it is not finite, or before the
    /// first sample.
    pub head_temperature: [Option<f64>; AXES],
    /// Board temperature of the last sample, as for the heads.
    pub board_temperature: [Option<f64>; AXES],
    /// The gyroscopes; absent where the table in force has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyroscopes: Option<GyroscopeStatus>,
    /// Raw samples received.
    pub received: u64,
    /// Raw samples received in the last whole second \[Hz\].
    #[serde(default)]
    pub rate_hz: u64,
    /// When a sample came last, within a second \[s since 1970\]; null before the first.
    #[serde(default)]
    pub last_sample_unix_s: Option<f64>,
    /// Increments published.
    pub compensated: u64,
    /// Samples with missing samples of the same session directly before them; as many have the flag `gap`.
    pub gaps: u64,
    /// Missing samples in total.
    pub missing: u64,
    /// Samples received again, whose sequence did not rise: resends.
    pub repeats: u64,
    /// Acquisition sessions that have sent samples.
    pub sessions: u64,
    /// Control periods between two sessions, in sum over all changes of session after which they are known: where both
    /// sessions have timestamps of the same clock. Such a change is flagged `session`.
    #[serde(default)]
    pub session_missing: u64,
    /// Changes of session after which the number of control periods between is unknown.
    #[serde(default)]
    pub session_unknown: u64,
    /// Receiving or publishing failed; should be 0.
    pub transport_errors: u64,
    /// Increments with each flag, by the flag's name; `other-device` since the table in force was taken. Absent are the
    /// flags that the table in force cannot give and no table has given.
    pub flagged: BTreeMap<String, u64>,
    /// Tables loaded after the first.
    pub reloads: u64,
    /// Refused table files; a missing file counts as refused.
    pub refusals: u64,
    /// Why the table file in its present state is not in force; null if it is in force. `REFUSED` for people.
    pub last_reload_error: Option<String>,
    /// Whether no table has been in force yet, and there is no file, as `--allow-uncalibrated` allows. Increments are
    /// NaN, flagged `no-table`, until there is one.
    #[serde(default)]
    pub waits_for_table: bool,
    /// Digest of the table file's table, if that is valid but changes too much to be taken; otherwise null.
    #[serde(default)]
    pub refused_table: Option<String>,
    /// Since when the table file has not been in force, Unix time \[s\]; null if it is in force.
    pub refused_unix_s: Option<f64>,
    /// The largest change of each curve by the table in force; empty if it was compared with none, or is the one from
    /// before the start.
    #[serde(default)]
    pub table_changes: Vec<TableChange>,
    /// Whether the table in force is kept in the state folder, so that the next start knows it. False while a disk
    /// takes its time, and where it cannot be kept.
    #[serde(default)]
    pub table_kept: bool,
    /// Why the table in force cannot be kept; null if it is kept, or a disk takes its time. `NOT KEPT` for people.
    #[serde(default)]
    pub keep_error: Option<String>,
    /// Digest of the anchor: the table of the first start, the first calibration after a nominal table, or the last one
    /// that was accepted. No table may differ from it by more than three times its limits. Null without a table.
    #[serde(default)]
    pub anchor: Option<String>,
    /// The largest change of each curve from the anchor to the table in force.
    #[serde(default)]
    pub anchor_changes: Vec<TableChange>,
    /// Latency since the start, from `sent_ns` to just before publishing, to within 3 %; null before the first sample.
    pub latency_ns: Option<LatencySummary>,
    /// Latency in the last second, with the same fields; null without a sample in it.
    pub latency_second_ns: Option<LatencySummary>,
    /// Latency in the last minute, with the same fields.
    pub latency_minute_ns: Option<LatencySummary>,
    /// Latency since the start, by buckets.
    pub latency_distribution: LatencyDistribution,
    /// Whether an acquisition process is connected. A dead process counts until its remains are removed, within a
    /// second or so.
    pub acquisition_connected: bool,
    /// Processes that read the increments, the acquisition included.
    pub readers: usize,
    /// What the last acquisition that closed with a loss had lost; null if none did. `LOST` for people.
    #[serde(default)]
    pub closed: Option<ClosedStatus>,
}
}

described! {
/// The largest change of one curve, transient, g-sensitivity or alignment from one table to the next.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct TableChange {
    /// Sensor and quantity, as `A1 bias`, or the alignment.
    pub name: String,
    /// Its size, in `unit`.
    pub size: f64,
    /// ug0, ppm, deg/h or mrad.
    pub unit: String,
}
}

described! {
/// What an acquisition had lost when it closed.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct ClosedStatus {
    /// Its last session, 16 hexadecimal digits.
    pub session: String,
    /// Control periods, of all its sessions, that were measured and not sent.
    pub lost: u64,
    /// Samples that it had sent and whose increments it had not received.
    pub unanswered: u64,
    /// When it closed, Unix time \[s\].
    pub unix_s: f64,
}
}

impl ImuStatus {
    /// Id of the table in force, as in the increments: the first 8 bytes of its digest, big-endian; 0 without a table.
    #[must_use]
    pub fn table_id(&self) -> u64 {
        let digits = self.table.as_deref().and_then(|digest| digest.strip_prefix("sha256:")?.get(..16));
        digits.and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or(0)
    }

    /// The nominal interval of the table in force, and what one pulse stands for; `None` without a table.
    #[must_use]
    pub fn pulse_scale(&self) -> Option<PulseScale> {
        Some(PulseScale {
            nominal_ns: self.nominal_interval_s.map_or(0, nominal_ns),
            velocity: self.pulse_velocity?,
            angle: self.gyroscopes.as_ref().map(|gyroscopes| gyroscopes.pulse_angle),
        })
    }

    /// Which time constant the last sample has, in words, if that is not the one of the table in force. The transient
    /// terms are then left out, and the increments flagged `lag-unknown`.
    #[must_use]
    pub fn other_lag(&self) -> Option<String> {
        let ns = |seconds: f64| (seconds * 1e9).round() as u64;
        let flagged = self.flagged.get("lag-unknown").is_some_and(|count| *count > 0);
        let other = self.lag_s.is_some_and(|lag_s| self.sample_lag_s.map(ns) != Some(ns(lag_s)));
        (flagged && other).then(|| self.sample_lag_s.map_or("none".to_owned(), |seconds| format!("{seconds} s")))
    }
}

described! {
/// Temperature of the gyroscopes, in the same form as that of the accelerometers.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct GyroscopeStatus {
    /// The temperature that their polynomials were calibrated over.
    pub ranges: Ranges,
    /// Head temperature of the last sample, G1 to G3, in the table's unit; null if it is not finite, or before the
    /// first sample.
    pub head_temperature: [Option<f64>; AXES],
    /// Board temperature of the last sample, as for the heads.
    pub board_temperature: [Option<f64>; AXES],
    /// What one pulse of G1 to G3 stands for by the table in force, 1 arcsec / K+ in the middle of the range \[rad\].
    #[serde(default)]
    pub pulse_angle: [f64; AXES],
}
}

described! {
/// The temperature that the sensors of a triad were calibrated over.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Ranges {
    /// Unit of the temperature, a label.
    pub unit: String,
    /// Lower and upper end of the bias's range of head temperature, of the three sensors.
    pub head: [[f64; 2]; AXES],
    /// Lower and upper end of the board temperature that is in the ranges of both K+ and K-, of the three sensors.
    pub board: [[f64; 2]; AXES],
}
}

impl Ranges {
    /// The ranges of a table's accelerometers.
    #[must_use]
    pub fn of_accelerometers(table: &CoefficientTable) -> Self {
        Self::new(table, &table.content().axes)
    }

    /// The ranges of a table's gyroscopes, if it has any.
    #[must_use]
    pub fn of_gyroscopes(table: &CoefficientTable) -> Option<Self> {
        table.content().gyroscopes.as_ref().map(|gyroscopes| Self::new(table, &gyroscopes.axes))
    }

    fn new(table: &CoefficientTable, axes: &[Axis; AXES]) -> Self {
        let board = |axis: usize| {
            let [positive, negative] =
                [axes[axis].positive_scale_factor.range(), axes[axis].negative_scale_factor.range()];
            [positive[0].max(negative[0]), positive[1].min(negative[1])]
        };
        let head = |axis: usize| axes[axis].bias.range();
        let unit = table.content().temperature_unit.clone();
        Self { unit, head: core::array::from_fn(head), board: core::array::from_fn(board) }
    }
}

impl From<&Domain> for DomainStatus {
    fn from(domain: &Domain) -> Self {
        Self { name: domain.name().to_owned(), prefix: domain.prefix(), root_path: domain.root_path().to_owned() }
    }
}

described! {
/// Percentiles of the latency \[ns\].
#[derive(Clone, Copy, Debug, Eq, PartialEq, Deserialize, Serialize)]
pub struct LatencySummary {
    /// Number of values.
    pub count: u64,
    /// Median.
    pub p50: u64,
    /// 99th percentile.
    pub p99: u64,
    /// 99.9th percentile.
    pub p999: u64,
    /// Largest value.
    pub max: u64,
}
}

/// Upper bounds of the buckets of a [`LatencyDistribution`] \[ns\]; one more bucket has the values above the last
/// bound.
pub const LATENCY_BOUNDS_NS: [u64; 21] = {
    let mut bounds = [0; 21];
    let mut index = 0;
    while index < bounds.len() {
        bounds[index] = [2, 5, 10][index % 3] * 100 * 10u64.pow((index / 3) as u32);
        index += 1;
    }
    bounds
};

const _: () = {
    assert!(LATENCY_BOUNDS_NS[0] == 200 && LATENCY_BOUNDS_NS[7] == 50_000 && LATENCY_BOUNDS_NS[20] == 1_000_000_000);
    let mut index = 1;
    while index < LATENCY_BOUNDS_NS.len() {
        assert!(LATENCY_BOUNDS_NS[index - 1] < LATENCY_BOUNDS_NS[index]);
        index += 1;
    }
};

described! {
/// Histogram of the latency.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct LatencyDistribution {
    /// Number of values in each bucket since the start: up to 0.2, 0.5, 1, 2, 5 us and so on to 1 s
    /// ([`LATENCY_BOUNDS_NS`]), each above the bound before; then above the last.
    pub counts: Vec<u64>,
    /// Sum of the values \[s\], to within 1.6 %.
    pub sum_s: f64,
}
}
