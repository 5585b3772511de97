//! `status`: shows the status of the running service.

use clap::Args;
use isotherm_client::transport::nodes::configuration_text;
use isotherm_client::{Domain, Options, check_room, fetch_status, service_pid, unix_s};
use isotherm_files::{print, print_data};
use isotherm_shared::status::{
    GyroscopeStatus, ImuStatus, LatencySummary, Ranges, ServiceStatus, TableChange, WorkerStatus,
};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure, one_line, tell};
use std::fmt::Write as _;
use std::time::Duration;

/// Show the running service
///
/// Shows counts, flags, latency and the table in force for each IMU.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm status\n  isotherm status --json | jq '.imus[] | {id, received, gaps}'\n  isotherm status --iceoryx2 > iceoryx2.toml"
)]
pub struct Status {
    /// Print one JSON document
    #[arg(long)]
    json: bool,
    /// Print the configuration for iceoryx2's own tools
    ///
    /// iceoryx2's tools join the domain with this configuration. A service need not be running.
    #[arg(long, conflicts_with = "json")]
    iceoryx2: bool,
}

impl Status {
    /// Prints the status.
    ///
    /// # Errors
    /// If no service answers.
    pub fn run(self, domain: Domain) -> Result<(), Failure> {
        if self.iceoryx2 {
            return print_data(&transport_config(&domain)?);
        }
        let status = fetch_status(&Options::new(domain, Duration::ZERO))?;
        if let Err(error) = check_room(0) {
            // The status shows nothing of it, and no other client connects.
            tell("isotherm", error);
        }
        if !self.json {
            return print(&describe(&status));
        }
        let text = serde_json::to_string_pretty(&status);
        let text = text.map_err(|error| Failure::new(Exit::Failed, format!("writing JSON: {error}")))?;
        print_data(&(text + "\n"))
    }
}

fn transport_config(domain: &Domain) -> Result<String, Failure> {
    let failed = |cause: String| Failure::new(Exit::Failed, format!("writing the configuration: {cause}"));
    configuration_text(domain).map_err(failed)
}

fn describe(status: &ServiceStatus) -> String {
    let mut text = format!(
        "isotherm {} in domain {}, {}, up {:.0} s, waiting: {}, latency budget {} us\n",
        status.version,
        status.domain.name,
        service_pid(status),
        status.uptime_s,
        status.wait,
        status.budget_us
    );
    if let (Some(file), Some(error)) = (&status.configuration_file, &status.configuration_error) {
        let _ = writeln!(
            text,
            "REFUSED      the configuration {}; the last one that worked is in use:\n             {}",
            one_line(file),
            error.replace('\n', "\n             ")
        );
    }
    if status.memory_locked_kb > 0 {
        let _ = writeln!(text, "memory locked: {} kB", status.memory_locked_kb);
    }
    for (index, worker) in status.workers.iter().enumerate() {
        let _ = describe_worker(&mut text, index, worker);
    }
    for imu in &status.imus {
        // Writing to a String cannot fail.
        let _ = describe_imu(&mut text, imu, status.budget_us);
    }
    text
}

fn describe_imu(text: &mut String, imu: &ImuStatus, budget_us: f64) -> std::fmt::Result {
    writeln!(text, "\n{}", imu.id)?;
    describe_table(text, imu)?;
    if let Some(ranges) = &imu.ranges {
        let temperature = [&imu.head_temperature, &imu.board_temperature];
        describe_triad(text, SensorKind::Accelerometer, ranges, temperature)?;
    }
    if let Some(GyroscopeStatus { ranges, head_temperature, board_temperature, .. }) = &imu.gyroscopes {
        describe_triad(text, SensorKind::Gyroscope, ranges, [head_temperature, board_temperature])?;
    }
    describe_samples(text, imu)?;
    if imu.flagged.get("late").is_some_and(|count| *count > 0) {
        writeln!(
            text,
            "               late: the increment is right, but it took longer than the budget of {budget_us} us"
        )?;
    }
    describe_latency(text, imu)
}

fn describe_table(text: &mut String, imu: &ImuStatus) -> std::fmt::Result {
    if imu.waits_for_table {
        let file = one_line(&imu.table_file);
        writeln!(text, "  table        waits for its first table ({file}); until it is there increments are NaN")?;
    } else {
        let table = imu.table.as_deref().unwrap_or("none");
        writeln!(text, "  table        {table} ({}), {} reloads", one_line(&imu.table_file), imu.reloads)?;
        if let Some(error) = &imu.last_reload_error {
            writeln!(text, "  REFUSED      {}", error.replace('\n', "\n               "))?;
        }
    }
    if let Some(changed) = changed(&imu.table_changes) {
        writeln!(text, "  changed      by the table in force, at most: {changed}")?;
    }
    describe_keeping(text, imu)?;
    if let Some(device) = &imu.other_device {
        let (own, serial) = (imu.device.as_deref().unwrap_or("-"), imu.serial.as_deref().unwrap_or_default());
        writeln!(
            text,
            "  OTHER DEVICE the samples are of device {device}, the table of {own}, serial number {serial:?}"
        )?;
    }
    let Some(lag_s) = imu.lag_s else { return Ok(()) };
    writeln!(text, "  lag          {lag_s} s")?;
    let Some(other) = imu.other_lag() else { return Ok(()) };
    writeln!(
        text,
        "  OTHER LAG    that of the samples is {other}: the transient terms are left out, flagged lag-unknown"
    )
}

/// Whether the table is kept, and how far it is from the anchor.
fn describe_keeping(text: &mut String, imu: &ImuStatus) -> std::fmt::Result {
    if let Some(error) = &imu.keep_error {
        writeln!(text, "  NOT KEPT     {error}")?;
    } else if imu.table.is_some() && !imu.table_kept {
        writeln!(text, "  not kept yet the disk of the state folder takes its time")?;
    }
    let (Some(anchor), Some(table)) = (&imu.anchor, &imu.table) else { return Ok(()) };
    if anchor == table {
        return Ok(());
    }
    let changed = changed(&imu.anchor_changes).unwrap_or_else(|| "nothing".to_owned());
    writeln!(text, "  anchor       {anchor}; changed since then, at most: {changed}")?;
    writeln!(text, "               `reload --imu {} --accept {table}` makes the table in force the anchor", imu.id)
}

fn describe_samples(text: &mut String, imu: &ImuStatus) -> std::fmt::Result {
    let acquisition = if imu.acquisition_connected { "connected" } else { "not connected" };
    let last = imu.last_sample_unix_s.map(|at| format!(", the last sample {:.0} s ago", (unix_s() - at).max(0.0)));
    writeln!(text, "  acquisition  {acquisition}, {} sessions, {} readers", imu.sessions, imu.readers)?;
    writeln!(text, "  rate         {} Hz in the last second{}", imu.rate_hz, last.unwrap_or_default())?;
    match (imu.temperature_age_s, imu.temperature_stale) {
        (age_s, true) => {
            let age = age_s.map_or("too long".to_owned(), |age_s| format!("{age_s:.1} s"));
            writeln!(
                text,
                "  STALE        the temperature was read {age} before the last sample: is the thermometer alive?"
            )?;
        }
        (Some(age_s), false) => writeln!(text, "  temperature  read {age_s:.1} s before the last sample")?,
        (None, false) if imu.received > 0 => writeln!(text, "  temperature  age not given")?,
        (None, false) => {}
    }
    writeln!(
        text,
        "  samples      {} received, {} answered, {} missing in {} gaps, {} repeated",
        imu.received, imu.compensated, imu.missing, imu.gaps, imu.repeats
    )?;
    if imu.session_missing > 0 || imu.session_unknown > 0 {
        let (missing, unknown) = (imu.session_missing, imu.session_unknown);
        writeln!(text, "  between      sessions: {missing} periods missing, and {unknown} times an unknown number")?;
    }
    if let Some(closed) = &imu.closed {
        writeln!(
            text,
            "  LOST         when session {} closed, {:.0} s ago: {} periods not sent since it connected, {} samples unanswered",
            closed.session,
            unix_s() - closed.unix_s,
            closed.lost,
            closed.unanswered
        )?;
    }
    let flagged: Vec<_> =
        imu.flagged.iter().filter(|(_, count)| **count > 0).map(|(name, count)| format!("{name} {count}")).collect();
    writeln!(text, "  flagged      {}", if flagged.is_empty() { "none".to_owned() } else { flagged.join(", ") })
}

fn describe_latency(text: &mut String, imu: &ImuStatus) -> std::fmt::Result {
    writeln!(text, "  latency [us]        p50       p99     p99.9       max     count")?;
    for (name, summary) in
        [("second", imu.latency_second_ns), ("minute", imu.latency_minute_ns), ("all", imu.latency_ns)]
    {
        let Some(LatencySummary { count, p50, p99, p999, max }) = summary else {
            writeln!(text, "    {name:<8} no samples")?;
            continue;
        };
        let [p50, p99, p999, max] = [p50, p99, p999, max].map(|ns| ns as f64 / 1e3);
        writeln!(text, "    {name:<8} {p50:>9.2} {p99:>9.2} {p999:>9.2} {max:>9.2} {count:>9}")?;
    }
    Ok(())
}

/// The largest change of each unit; `None` if nothing has changed.
fn changed(changes: &[TableChange]) -> Option<String> {
    let largest = |unit: &str| {
        let of_unit = changes.iter().filter(|change| change.unit == unit && change.size > 0.0);
        let TableChange { name, size, unit } = of_unit.max_by(|a, b| a.size.total_cmp(&b.size))?;
        Some(format!("{size:.3} {unit} ({name})"))
    };
    let all: Vec<_> = ["ug0", "ppm", "deg/h", "mrad"].into_iter().filter_map(largest).collect();
    (!all.is_empty()).then(|| all.join(", "))
}

/// The last temperature of a triad's heads and boards, with the ranges that its table is for.
fn describe_triad(
    text: &mut String,
    kind: SensorKind,
    Ranges { unit, head, board }: &Ranges,
    [heads, boards]: [&[Option<f64>; AXES]; 2],
) -> std::fmt::Result {
    let place = |value: Option<f64>, [low, high]: [f64; 2]| {
        let value = value.map_or("none".to_owned(), |value| format!("{value:.4}"));
        format!("{value} in {low} .. {high} {unit}")
    };
    for (axis, name) in kind.names().into_iter().enumerate() {
        let (head, board) = (place(heads[axis], head[axis]), place(boards[axis], board[axis]));
        writeln!(text, "  {name}           head {head}, board {board}")?;
    }
    Ok(())
}

fn describe_worker(text: &mut String, index: usize, worker: &WorkerStatus) -> std::fmt::Result {
    let priority =
        worker.priority.map_or_else(|| "no real-time priority".to_owned(), |priority| format!("FIFO {priority}"));
    writeln!(
        text,
        "worker {index}: {}; cores {}, {priority}; in the last second {:.1} % of a core, held back {:.1} ms",
        worker.imus.join(", "),
        worker.cores,
        worker.cpu_percent,
        worker.held_back_ms
    )?;
    if worker.stands_still { writeln!(text, "  STANDS STILL: its IMUs are not served") } else { Ok(()) }
}
