//! What `status` says, as diagnostics of ROS 2.

use crate::message::{
    DiagnosticArrayMessage, DiagnosticLevel, DiagnosticMessage, HeaderMessage, KeyValueMessage, TimeMessage,
};
use crate::output::OutputCounts;
use crate::stamps::StampState;
use isotherm_client::{ImuId, UnixOffset};
use isotherm_shared::status::{ImuStatus, ServiceStatus};
use std::fmt::Display;

/// How the publication of an IMU goes.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputReport {
    /// The IMU.
    pub imu: ImuId,
    /// What became of its increments.
    pub counts: OutputCounts,
    /// What is known of its clock.
    pub stamps: StampState,
    /// By how much its times may be off \[ns\].
    pub uncertainty_ns: u64,
    /// The temperature \[degC\] that is taken for its own, where nobody measures it.
    pub assumed_temperature: Option<f64>,
}

/// The diagnostics of a node: of the service, and of each IMU that is published. `before` is the status of the
/// diagnostics before: what has changed since then is a warning.
#[must_use]
pub fn diagnostics(
    status: Option<&ServiceStatus>,
    before: Option<&ServiceStatus>,
    reports: &[OutputReport],
    offset: UnixOffset,
    stamp: TimeMessage,
) -> DiagnosticArrayMessage {
    let of_imu = |report: &OutputReport| {
        let find =
            |status: Option<&ServiceStatus>| status?.imus.iter().find(|imu| imu.id == report.imu.as_str()).cloned();
        imu(report, find(status).as_ref(), find(before).as_ref())
    };
    let header = HeaderMessage { stamp, frame_id: String::new() };
    let all = [service(status, offset)].into_iter().chain(reports.iter().map(of_imu)).collect();
    DiagnosticArrayMessage { header, status: all }
}

/// Values with their names, and the worst that was found.
struct Findings {
    level: DiagnosticLevel,
    messages: Vec<String>,
    values: Vec<KeyValueMessage>,
}

impl Findings {
    const fn new() -> Self {
        Self { level: DiagnosticLevel::Ok, messages: Vec::new(), values: Vec::new() }
    }

    fn value(&mut self, key: &str, value: impl Display) {
        self.values.push(KeyValueMessage { key: key.to_owned(), value: value.to_string() });
    }

    fn find(&mut self, level: DiagnosticLevel, message: impl Into<String>) {
        self.level = self.level.max(level);
        self.messages.push(message.into());
    }

    fn message(self, name: String, hardware_id: String) -> DiagnosticMessage {
        let Self { level, messages, values } = self;
        let message = if messages.is_empty() { "as it should be".to_owned() } else { messages.join("; ") };
        DiagnosticMessage { level: level as u8, name, message, hardware_id, values }
    }
}

fn service(status: Option<&ServiceStatus>, offset: UnixOffset) -> DiagnosticMessage {
    let mut found = Findings::new();
    found.value("unix_offset_ns", offset.offset_ns);
    found.value("unix_offset_uncertainty_ns", offset.uncertainty_ns);
    let name = "isotherm: service".to_owned();
    let Some(status) = status else {
        found.find(DiagnosticLevel::Error, "no status: the service does not run, or hangs");
        return found.message(name, String::new());
    };
    found.value("domain", &status.domain.name);
    found.value("version", &status.version);
    found.value("uptime_s", status.uptime_s.round());
    for worker in status.workers.iter().filter(|worker| worker.stands_still) {
        found.find(DiagnosticLevel::Error, format!("the worker of {} stands still", worker.imus.join(", ")));
    }
    found.message(name, status.domain.name.clone())
}

fn imu(report: &OutputReport, status: Option<&ImuStatus>, before: Option<&ImuStatus>) -> DiagnosticMessage {
    let mut found = Findings::new();
    of_output(&mut found, report);
    let name = format!("isotherm: {}", report.imu);
    let Some(status) = status else {
        found.find(DiagnosticLevel::Stale, "no status of this IMU: it is not served");
        return found.message(name, String::new());
    };
    of_table(&mut found, status);
    of_samples(&mut found, status, before);
    of_temperature(&mut found, status, report.assumed_temperature);
    found.message(name, status.serial.clone().unwrap_or_default())
}

fn of_output(found: &mut Findings, report: &OutputReport) {
    let OutputCounts { published, invalid, missing, untimed, untaken } = report.counts;
    found.value("published", published);
    found.value("invalid", invalid);
    found.value("missing_before_publication", missing);
    found.value("untimed", untimed);
    found.value("untaken", untaken);
    found.value("stamp_uncertainty_ns", report.uncertainty_ns);
    match report.stamps {
        StampState::Refused(delay_ns) => {
            let seconds = delay_ns as f64 / 1e9;
            let message =
                format!("timestamps are {seconds:.1} s from now, so not of CLOCK_MONOTONIC: give clock = \"other\"");
            found.value("clock", "refused");
            found.find(DiagnosticLevel::Error, message);
        }
        StampState::Unknown => found.value("clock", "unknown"),
        StampState::Monotonic => found.value("clock", "monotonic"),
        StampState::Other => found.value("clock", "other"),
    }
}

fn of_table(found: &mut Findings, status: &ImuStatus) {
    match &status.table {
        Some(table) => found.value("table", table),
        None => found.find(DiagnosticLevel::Error, "no table: increments are not computed"),
    }
    found.value("table_file", &status.table_file);
    found.value("reloads", status.reloads);
    found.value("refusals", status.refusals);
    if let Some(error) = &status.last_reload_error {
        found.find(DiagnosticLevel::Warn, format!("the table's file is refused: {error}"));
    }
    if let Some(device) = &status.other_device {
        found.find(DiagnosticLevel::Error, format!("the samples are of another device, {device}"));
    }
    if let Some(lag) = status.other_lag() {
        found.find(DiagnosticLevel::Warn, format!("the lag of the samples is {lag}, not the table's"));
    }
    if let Some(error) = &status.keep_error {
        found.find(DiagnosticLevel::Warn, format!("the table cannot be kept: {error}"));
    }
}

fn of_samples(found: &mut Findings, status: &ImuStatus, before: Option<&ImuStatus>) {
    found.value("rate_hz", status.rate_hz);
    found.value("received", status.received);
    found.value("compensated", status.compensated);
    found.value("missing", status.missing);
    found.value("sessions", status.sessions);
    if !status.acquisition_connected {
        found.find(DiagnosticLevel::Warn, "no acquisition is connected");
    } else if status.rate_hz == 0 {
        found.find(DiagnosticLevel::Warn, "no sample has come in the last second");
    }
    // After a restart of the service everything has begun at 0 again.
    let before = before.filter(|before| before.received <= status.received);
    let new = |now: u64, before: Option<u64>| now.saturating_sub(before.unwrap_or(0));
    let missing = new(status.missing, before.map(|before| before.missing));
    if missing > 0 {
        found.find(DiagnosticLevel::Warn, format!("{missing} samples are missing"));
    }
    for (flag, count) in status.flagged.iter().filter(|(_, count)| **count > 0) {
        found.value(&format!("flag {flag}"), count);
        let new = new(*count, before.and_then(|before| before.flagged.get(flag).copied()));
        // A gap was reported as missing samples.
        if new > 0 && flag != "gap" {
            found.find(DiagnosticLevel::Warn, format!("{new} increments flagged {flag}"));
        }
    }
    if let Some(latency) = status.latency_second_ns {
        found.value("latency_p50_us", latency.p50 as f64 / 1e3);
        found.value("latency_p99_us", latency.p99 as f64 / 1e3);
        found.value("latency_max_us", latency.max as f64 / 1e3);
    }
}

fn of_temperature(found: &mut Findings, status: &ImuStatus, assumed: Option<f64>) {
    if let Some(assumed) = assumed {
        found.value("temperature", format!("taken to be {assumed} degC: there is no thermometer"));
        return;
    }
    match status.temperature_age_s {
        Some(age_s) => found.value("temperature_age_s", age_s),
        None if status.received > 0 => found.value("temperature_age_s", "not given"),
        None => {}
    }
    if status.temperature_stale {
        let age = status.temperature_age_s.map_or("too old".to_owned(), |age_s| format!("{age_s:.1} s old"));
        found.find(DiagnosticLevel::Warn, format!("the temperature is {age}: is the thermometer alive?"));
    }
    for (axis, temperature) in status.head_temperature.iter().enumerate() {
        if let Some(temperature) = temperature {
            found.value(&format!("temperature_a{}", axis + 1), temperature);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> OutputReport {
        OutputReport {
            imu: "imu-a".parse().unwrap(),
            counts: OutputCounts { published: 7, ..OutputCounts::default() },
            stamps: StampState::Monotonic,
            uncertainty_ns: 40,
            assumed_temperature: None,
        }
    }

    const OFFSET: UnixOffset = UnixOffset { offset_ns: 5, uncertainty_ns: 1 };

    #[test]
    fn without_a_service_that_is_said() {
        let array = diagnostics(None, None, &[report()], OFFSET, TimeMessage::default());
        let [service, imu] = array.status.as_slice() else { panic!("{array:?}") };
        assert_eq!((service.level, service.name.as_str()), (DiagnosticLevel::Error as u8, "isotherm: service"));
        assert_eq!(imu.level, DiagnosticLevel::Stale as u8);
        assert!(imu.values.contains(&KeyValueMessage { key: "published".to_owned(), value: "7".to_owned() }));
    }

    #[test]
    fn a_temperature_that_is_stale_is_a_warning_and_one_without_a_time_is_told() {
        use crate::output::tests::status;
        let found = |age_s, is_stale| {
            let mut findings = Findings::new();
            of_temperature(&mut findings, &status(1, age_s, is_stale), None);
            let value = findings.values.iter().find(|value| value.key == "temperature_age_s").unwrap().value.clone();
            (findings.level, value, findings.messages.join(""))
        };
        assert_eq!(found(Some(0.25), false), (DiagnosticLevel::Ok, "0.25".to_owned(), String::new()));
        assert_eq!(found(None, false), (DiagnosticLevel::Ok, "not given".to_owned(), String::new()));
        let (level, _, message) = found(Some(92.0), true);
        assert!(level == DiagnosticLevel::Warn && message.contains("92.0 s old"), "{message}");
    }

    #[test]
    fn a_wrong_clock_is_an_error() {
        let report = OutputReport { stamps: StampState::Refused(7_000_000_000), ..report() };
        let array = diagnostics(None, None, &[report], OFFSET, TimeMessage::default());
        assert!(array.status[1].message.contains("7.0 s from now"), "{array:?}");
    }
}
