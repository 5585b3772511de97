//! Builds the status document and publishes it on `isotherm/status`.

use crate::create::{CreateError, Creator};
use crate::imu::ImuState;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_client::transport::ports::{publish_status, status_publisher};
use isotherm_client::transport::stream::{self, Ipc, IpcNode};
use isotherm_client::{StatusNote, named, pid_of, publisher_of};
use isotherm_shared::names::Domain;
use isotherm_shared::status::{GyroscopeStatus, ImuStatus, Ranges, ServiceStatus, TableChange};
use isotherm_shared::table::difference::Change;
use isotherm_shared::table::{CoefficientTable, PulseScale};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::Flags;
use isotherm_support::failure::Failure;

/// Room for the document before its shared memory must grow \[bytes\].
const INITIAL_BYTES: usize = 8 * 1024;

/// The status of one IMU.
pub(crate) fn imu_status(imu: &ImuState) -> ImuStatus {
    let counters = &imu.counters;
    let in_force = imu.in_force();
    let latency = counters.latency();
    let table = in_force.map(|sent| &*sent.table);
    let pulses = table.map(PulseScale::of);
    let [head_temperature, board_temperature] = counters.temperature(SensorKind::Accelerometer);
    let gyroscopes = |ranges| {
        let [head_temperature, board_temperature] = counters.temperature(SensorKind::Gyroscope);
        let pulse_angle = pulses.and_then(|pulses| pulses.angle).unwrap_or_default();
        GyroscopeStatus { ranges, head_temperature, board_temperature, pulse_angle }
    };
    let refused = imu.last_error.as_ref();
    let (kept, anchor) = (imu.kept(), imu.guard.anchor());
    let digits = |device: u64| format!("{device:016x}");
    let counted = |(bit, name): (u32, &str)| {
        let count = counters.flagged(bit);
        (count > 0 || may_flag(table, bit)).then(|| (name.to_owned(), count))
    };
    ImuStatus {
        id: imu.imu.id.to_string(),
        table: table.map(|table| table.digest().to_string()),
        table_file: imu.imu.table.display().to_string(),
        table_taken_unix_s: in_force.map(|sent| sent.taken_unix_s),
        table_modified_unix_s: in_force.and_then(|sent| sent.modified_unix_s),
        serial: table.and_then(|table| table.content().serial.clone()),
        device: table.map(CoefficientTable::device).filter(|device| *device != 0).map(digits),
        other_device: imu.other_device().map(digits),
        lag_s: table.and_then(|table| table.content().lag_s),
        sample_lag_s: Some(counters.lag_ns()).filter(|ns| *ns != 0).map(|ns| ns as f64 / 1e9),
        temperature_age_s: counters.temperature_age_s(),
        temperature_stale: counters.is_stale(),
        nominal_interval_s: table.and_then(|table| table.content().nominal_interval_s),
        pulse_velocity: pulses.map(|pulses| pulses.velocity),
        ranges: table.map(Ranges::of_accelerometers),
        head_temperature,
        board_temperature,
        gyroscopes: table.and_then(Ranges::of_gyroscopes).map(gyroscopes),
        received: counters.received(),
        rate_hz: imu.windows.samples(),
        last_sample_unix_s: imu.windows.last_sample_unix_s(),
        compensated: counters.compensated(),
        gaps: counters.gaps(),
        missing: counters.missing(),
        repeats: counters.repeats(),
        sessions: counters.sessions(),
        session_missing: counters.session_missing(),
        session_unknown: counters.session_unknown(),
        transport_errors: counters.transport_errors(),
        flagged: Flags::NAMES.into_iter().filter_map(counted).collect(),
        reloads: imu.reloads,
        refusals: imu.refusals,
        last_reload_error: refused.map(|refused| refused.text(&imu.imu.id)),
        waits_for_table: imu.waits_for_table(),
        refused_table: refused.and_then(|refused| Some(refused.table.as_ref()?.digest().to_string())),
        refused_unix_s: refused.map(|refused| refused.since_unix_s),
        table_changes: imu.guard.changes().iter().map(table_change).collect(),
        table_kept: kept.is_some_and(|kept| kept.error.is_none()),
        keep_error: kept.and_then(|kept| kept.error.clone()),
        anchor: anchor.as_ref().map(|(digest, _)| digest.to_string()),
        anchor_changes: anchor.iter().flat_map(|(_, changes)| changes).map(table_change).collect(),
        latency_ns: latency.summary(),
        latency_second_ns: imu.windows.second(),
        latency_minute_ns: imu.windows.minute(),
        latency_distribution: latency.distribution(),
        acquisition_connected: imu.raw.dynamic_config().number_of_publishers() > 0,
        readers: imu.increments.dynamic_config().number_of_subscribers(),
        closed: imu.closed.clone(),
    }
}

fn table_change(change: &Change) -> TableChange {
    let Change { name, size, unit, .. } = change;
    TableChange { name: name.clone(), size: *size, unit: (*unit).to_owned() }
}

/// Whether an increment under this table may have the flag of this bit. A flag that needs gyroscopes, a lag, a serial
/// number or a nominal interval is shown only where the table has them.
fn may_flag(table: Option<&CoefficientTable>, bit: u32) -> bool {
    /// The first flag of the gyroscopes.
    const G1: u32 = 32;
    match Flags(1 << bit) {
        Flags::LAG_UNKNOWN => table.is_some_and(|table| table.lag_ns() != 0),
        Flags::OTHER_DEVICE => table.is_some_and(|table| table.device() != 0),
        Flags::INTERVAL_NOT_NOMINAL => table.is_some_and(|table| table.nominal_ns() != 0),
        Flags::G_UNKNOWN => table.is_some_and(|table| table.content().gyroscopes.is_some()),
        _ => bit < G1 || table.is_some_and(|table| table.content().gyroscopes.is_some()),
    }
}

/// The publisher of the status stream. There can be only one: this keeps a second service out of a domain.
pub(crate) struct StatusPublisher {
    stream: PortFactory<Ipc, [u8], ()>,
    publisher: Publisher<Ipc, [u8], ()>,
    /// For readers that have no room to join.
    note: StatusNote,
}

impl StatusPublisher {
    /// Creates the stream and takes the place of its publisher.
    ///
    /// # Errors
    /// If another service has the place, or the stream cannot be created.
    pub(crate) fn create(node: &IpcNode, domain: &Domain) -> Result<Self, Failure> {
        let (name, creator) = ("the status stream", Creator::new(node, domain));
        let service = creator.stream(name, &stream::status_name(), || Ok(stream::create_status(node)?))?;
        let taken = || {
            let pid = publisher_of(&service).map(|(_, node)| format!(", {}", named(pid_of(domain, node))));
            let pid = pid.unwrap_or_default();
            let domain = domain.name();
            format!("another service is running in domain {domain:?}{pid}; stop it, or give this one another --domain")
        };
        let publisher = creator.port(name, taken, || {
            status_publisher(&service, INITIAL_BYTES).map_err(|error| CreateError::of_publisher(error, &service))
        })?;
        Ok(Self { stream: service, publisher, note: StatusNote::new(domain) })
    }

    /// Whether anybody has subscribed.
    pub(crate) fn has_readers(&self) -> bool {
        self.stream.dynamic_config().number_of_subscribers() > 0
    }

    /// Publishes a status, also where those who cannot join read it.
    ///
    /// # Errors
    /// The error of the transport, otherwise that of the file.
    pub(crate) fn publish(&mut self, status: &ServiceStatus) -> Result<(), String> {
        let document = serde_json::to_vec(status).map_err(|error| error.to_string())?;
        let noted = self.note.update(&document).map_err(|error| format!("in the domain's folder: {error}"));
        publish_status(&self.publisher, &document).and(noted)
    }
}
