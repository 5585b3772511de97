//! `relay`: hands increments on into another domain.

use super::common::options;
use clap::Args;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::BackpressureStrategy;
use isotherm_client::transport::nodes;
use isotherm_client::transport::stream::{INCREMENT_DEPTH, Ipc, IpcNode, create_increment, increment_name};
use isotherm_client::{CompensatedIncrement, Domain, ImuId, IncrementReader, join, removed_object};
use isotherm_service::create::{CreateError, Creator};
use isotherm_service::logging::{self, LogFormat};
use isotherm_support::failure::{Exit, Failure, shown};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tracing::{info, warn};

/// Pause between two polls of the streams. A tunnel polls less often.
const PAUSE: Duration = Duration::from_micros(500);
/// How often dead peers are cleaned up and losses are logged.
const HOUSEKEEPING: Duration = Duration::from_secs(1);

/// Relay increments into another domain
///
/// From that domain, a tunnel carries them to other machines.
///
/// The relay is a reader like any other: it cannot disturb the service, and nothing returns from the other domain. It
/// can be started before the service, and continues after restarts of the service. Ends on SIGTERM or SIGINT.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm relay --imu imu-a --to net\n  isotherm --domain bench relay --imu imu-a --imu imu-b --to bench-net"
)]
pub(crate) struct Relay {
    /// Relay the increments of this IMU
    ///
    /// Can be repeated.
    #[arg(long, value_name = "ID", required = true)]
    imu: Vec<ImuId>,
    /// Relay into this domain
    ///
    /// A domain without a service, for tunnels.
    #[arg(long, value_name = "NAME")]
    to: String,
    /// Choose the format of log lines
    #[arg(long, value_enum, default_value_t, value_name = "FORMAT")]
    log_format: LogFormat,
}

impl Relay {
    pub(crate) fn run(self, from: &Domain) -> Result<(), Failure> {
        let usage = |message: String| Failure::new(Exit::Usage, message);
        let to = isotherm_service::commands::domain(Some(&self.to))?;
        if to == *from {
            return Err(usage(format!(
                "increments come from domain {0:?} and cannot go into it; name another one with --to",
                to.name()
            )));
        }
        if let Some((_, imu)) = self.imu.iter().enumerate().find(|(index, imu)| self.imu[..*index].contains(imu)) {
            return Err(usage(format!("IMU {imu} is given twice; give every IMU once")));
        }
        logging::start(self.log_format);
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            let handled = signal_hook::flag::register(signal, Arc::clone(&stop));
            handled.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        let node = join(&to)?;
        let imus: Result<Vec<_>, _> = self.imu.into_iter().map(|imu| RelayedImu::open(imu, from, &to, &node)).collect();
        let mut imus = imus?;
        info!(from = from.name(), to = to.name(), prefix = to.prefix(), root_path = to.root_path(), "ready");
        let mut due = Instant::now() + HOUSEKEEPING;
        while !stop.load(Ordering::Relaxed) {
            for imu in &mut imus {
                imu.hand_on()?;
            }
            if Instant::now() >= due {
                if let Some(object) = removed_object(&to) {
                    let message = format!(
                        "{} was removed under the relay, so no process can join domain {:?} any more; restart the \
                         relay and the tunnel",
                        shown(&object),
                        to.name()
                    );
                    return Err(Failure::new(Exit::Io, message));
                }
                nodes::clean(&node);
                imus.iter_mut().for_each(RelayedImu::log);
                due += HOUSEKEEPING;
            }
            std::thread::sleep(PAUSE);
        }
        Ok(())
    }
}

fn broken(phase: &str, cause: impl Display) -> Failure {
    Failure::new(
        Exit::Failed,
        format!("{phase}: {cause}; stop all processes of the domain that increments go into, and restart the relay"),
    )
}

fn taken(to: &Domain) -> String {
    let domain = to.name();
    format!("both places of publishers in domain {domain:?} are taken, by other relays or tunnels; stop one of them")
}

/// An IMU whose increments are handed on.
struct RelayedImu {
    imu: ImuId,
    reader: IncrementReader,
    publisher: Publisher<Ipc, CompensatedIncrement, ()>,
    connected: bool,
    last: Option<(u64, u64)>,
    missing: u64,
}

impl RelayedImu {
    fn open(imu: ImuId, from: &Domain, to: &Domain, node: &IpcNode) -> Result<Self, Failure> {
        let name = |what: &str| format!("the {what} of IMU {imu} in domain {}", to.name());
        let creator = Creator::new(node, to);
        let stream = creator
            .stream(&name("increment stream"), &increment_name(&imu), || Ok(create_increment(node, &imu, true)?))?;
        let publisher = creator.port(
            &name("increment publisher"),
            || taken(to),
            || {
                let publisher = stream.publisher_builder().backpressure_strategy(BackpressureStrategy::DiscardData);
                publisher.create().map_err(|error| CreateError::of_publisher(error, &stream))
            },
        )?;
        let reader = IncrementReader::new(imu.clone(), &options(from.clone(), Duration::ZERO));
        Ok(Self { imu, reader, publisher, connected: false, last: None, missing: 0 })
    }

    /// Hands on the increments that have come, at most a queue's depth.
    fn hand_on(&mut self) -> Result<(), Failure> {
        for _ in 0..INCREMENT_DEPTH {
            let Some(increment) = self.reader.receive()? else { break };
            // A slow reader loses its own oldest increments; publishing does not fail for it.
            self.publisher.send_copy(increment).map_err(|error| broken("publishing an increment", error))?;
            let next =
                self.last.filter(|(session, _)| *session == increment.session).map(|(_, last)| last.wrapping_add(1));
            self.missing += next.map_or(0, |next| increment.sequence.saturating_sub(next));
            self.last = Some((increment.session, increment.sequence));
        }
        Ok(())
    }

    fn log(&mut self) {
        if self.reader.is_connected() != self.connected {
            self.connected = true;
            info!(imu = %self.imu, "connected");
        }
        if self.missing > 0 {
            warn!(imu = %self.imu, missing = self.missing, "increments did not come: they were never sent, or this process was held up");
            self.missing = 0;
        }
    }
}
