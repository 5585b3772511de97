//! Which instrument is where: the `[chamber]` and `[table]` sections of a campaign plan.

use super::{Chamber, Fault, FaultKind, Table};
use isotherm_shared::document::Section;
use std::time::Duration;

/// A checked `[chamber]` section.
#[derive(Clone, Debug, PartialEq)]
pub struct ChamberConfig {
    /// Where it is.
    pub line: LineConfig,
}

/// A checked `[table]` section.
#[derive(Clone, Debug, PartialEq)]
pub struct TableConfig {
    /// Where it is.
    pub line: LineConfig,
}

/// A checked line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineConfig {
    /// `/dev/ttyUSB0` or `tcp://host:port`.
    pub port: String,
    /// Longest wait for a reply.
    pub timeout: Duration,
}

impl LineConfig {
    fn read(section: &Section<'_, '_>) -> Option<Self> {
        let port = section.string("port", "a device as /dev/ttyUSB0 or tcp://host:port")?;
        Some(Self { port: port.to_owned(), timeout: Duration::from_secs(1) })
    }
}

impl ChamberConfig {
    /// Asks for every key of a chamber's driver and line; faults go to the document. The caller asks for keys of its own, then finishes
    /// the section.
    #[must_use]
    pub fn read(section: &Section<'_, '_>) -> Option<Self> {
        section.ignore("driver");
        Some(Self { line: LineConfig::read(section)? })
    }

    pub(super) fn open(&self) -> Result<Box<dyn Chamber>, Fault> {
        let message = "no driver yet".to_owned();
        Err(Fault { kind: FaultKind::Line, instrument: format!("chamber at {}", self.line.port), message })
    }
}

impl TableConfig {
    /// Asks for every key of a table's driver and line; faults go to the document. The caller asks for keys of its own, then finishes
    /// the section.
    #[must_use]
    pub fn read(section: &Section<'_, '_>) -> Option<Self> {
        section.ignore("driver");
        Some(Self { line: LineConfig::read(section)? })
    }

    pub(super) fn open(&self) -> Result<Box<dyn Table>, Fault> {
        let message = "no driver yet".to_owned();
        Err(Fault { kind: FaultKind::Line, instrument: format!("table at {}", self.line.port), message })
    }
}
