//! The program `isotherm-exporter`: it reads the status of a domain's service as every client does, and the tallies of
//! the domain's acquisitions, and shows them to Prometheus over HTTP.
//!
//! One thread does all of it, so that nothing is shared: it takes the newest status off the stream, and answers.

mod metric;
mod page;
mod server;
mod service;
mod tallies;

use clap::{CommandFactory as _, FromArgMatches as _, Parser};
use isotherm_files::end_signals;
use isotherm_service::logging::{self, LogFormat};
use isotherm_service::{StatusSource, commands};
use isotherm_support::failure::{Exit, Failure};
pub use metric::Metric;
use page::MetricsPage;
use server::Server;
use std::net::{SocketAddr, TcpListener};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tracing::{info, warn};

/// Export metrics of a domain to Prometheus
///
/// The metrics of service and acquisitions are at http://ADDRESS/metrics. While no service is running, the answer is
/// 503. Ends on SIGTERM and SIGINT.
#[derive(Debug, Parser)]
#[command(
    name = "isotherm-exporter",
    version,
    after_help = "Examples:
  isotherm-exporter
  isotherm-exporter --listen 127.0.0.1:9465 --domain left"
)]
struct Exporter {
    /// Listen on this address and port
    ///
    /// Port 0 takes a free port, which the log shows
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:9464")]
    listen: SocketAddr,
    /// Join this domain of the service
    ///
    /// Default: the domain that ISOTHERM_DOMAIN names, or "default"
    #[arg(long, value_name = "NAME")]
    domain: Option<String>,
    /// Choose the format of log lines
    #[arg(long, value_enum, default_value_t, value_name = "FORMAT")]
    log_format: LogFormat,
}

impl Exporter {
    fn run(&self) -> Result<(), Failure> {
        let domain = commands::domain(self.domain.as_deref())?;
        logging::start(self.log_format);
        let end = Arc::new(AtomicBool::new(false));
        for signal in end_signals() {
            let registered = signal_hook::flag::register(signal, Arc::clone(&end));
            registered.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        let mut server = listen(self.listen)?;
        let mut page = MetricsPage::new(&domain, StatusSource::connect(domain.clone())?);
        while !end.load(Ordering::Relaxed) {
            server.turn(|| page.text());
            page.update();
        }
        info!("stopped");
        Ok(())
    }
}

fn listen(address: SocketAddr) -> Result<Server, Failure> {
    let server = TcpListener::bind(address).and_then(|listener| Ok((listener.local_addr()?, Server::new(listener)?)));
    let (address, server) = server.map_err(|error| {
        let remedy = "`ss -ltnp` lists who listens where; give a free port of this machine with --listen";
        Failure::new(Exit::Io, format!("listening on {address}: {error}; {remedy}"))
    })?;
    if !address.ip().is_loopback() {
        warn!("anybody who reaches {address} can read the metrics; there is no encryption and no password");
    }
    info!("metrics at http://{address}/metrics");
    Ok(server)
}

/// Every metric of the service and of acquisitions.
pub fn metrics() -> impl Iterator<Item = Metric> {
    service::metrics().chain(tallies::metrics())
}

/// The command line of the program, also for its manual page. `--version` prints `long_version` after the name.
#[must_use]
pub fn command(long_version: &'static str) -> clap::Command {
    commands::finish(Exporter::command().long_version(long_version), "isotherm-exporter")
}

/// The program `isotherm-exporter`: runs the process's command line.
#[must_use]
pub fn main(long_version: &'static str) -> ExitCode {
    commands::exit_code("isotherm-exporter", || {
        let matches = command(long_version).try_get_matches()?;
        Ok(Exporter::from_arg_matches(&matches)?.run())
    })
}
