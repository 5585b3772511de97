//! Where the bytes come from.

use isotherm_serial::{Parity, Serial};
use isotherm_shared::document::Section;
use isotherm_support::failure::shown;
use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

/// Where bytes come from.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) enum Port {
    /// A serial line; best by its name under `/dev/serial/by-id`, which stays after it was unplugged.
    Serial(Serial),
    /// A TCP connection to this host and port.
    Tcp(String),
    /// UDP datagrams to this local address and port. Each has whole frames or lines.
    Udp(Udp),
    /// A file, or a device that gives bytes; `pace`: at the rate of the frames.
    File {
        /// Its path.
        path: PathBuf,
        /// Whether it is read at the rate of the frames.
        pace: bool,
    },
    /// The standard input.
    Stdin,
}

/// Where datagrams come from.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) struct Udp {
    /// The local address and port.
    pub(crate) address: String,
    /// The sender; `None`: anybody, as `peer = "any"` says.
    pub(crate) peer: Option<Peer>,
}

/// A sender of datagrams.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct Peer {
    /// Its address.
    pub(crate) ip: IpAddr,
    /// Its port; `None`: any.
    pub(crate) port: Option<u16>,
}

impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(serial) => write!(f, "{} at {} Bd", shown(&serial.path), serial.baud),
            Self::Tcp(address) => write!(f, "tcp {address}"),
            Self::Udp(udp) => write!(f, "udp {}", udp.address),
            Self::File { path, .. } => write!(f, "{}", shown(path)),
            Self::Stdin => write!(f, "stdin"),
        }
    }
}

const ONE: &str = "give one of serial, tcp, udp and file";
/// The value of `peer` with which datagrams of every sender are taken.
const ANY: &str = "any";
const SENDER: &str = "give the address of the device, as 192.168.1.10, or with a port; \"any\" takes the datagrams of \
                      everybody who reaches this machine";

/// Reads the keys of `[source]` that say where bytes come from.
pub(super) fn read(section: &Section<'_, '_>) -> Option<Port> {
    let path = |key| section.optional_string(key);
    let (serial, tcp, udp, file) = (path("serial"), path("tcp"), path("udp"), path("file"));
    let baud = section.optional_integer("baud", 50..=20_000_000);
    let parity = section.optional_choice("parity", &Parity::NAMES).unwrap_or(Parity::None);
    let stop_bits = section.optional_integer("stop_bits", 1..=2).unwrap_or(1) as u8;
    let pace = section.optional_bool("pace");
    if serial.is_none() {
        section.forbid(&["baud", "parity", "stop_bits"], "is for a serial line; leave it out");
    }
    let peer = section.optional_string("peer");
    let sender = match peer {
        None | Some(ANY) => None,
        Some(peer) => {
            let address = peer.parse::<SocketAddr>().map(|from| Peer { ip: from.ip(), port: Some(from.port()) });
            let found = address.or_else(|_| peer.parse().map(|ip| Peer { ip, port: None })).ok();
            section.refuse("peer", found.is_none().then(|| format!("is {peer:?}; {SENDER}")));
            found
        }
    };
    section.refuse("peer", (udp.is_some() && !section.has("peer")).then(|| format!("missing; {SENDER}")));
    section.fault_if(udp.is_none() && section.has("peer"), "peer", "is for udp; leave it out");
    if file.is_none() && section.has("pace") {
        section.fault("pace", "is for a file; leave it out");
    }
    let given = ["serial", "tcp", "udp", "file"].into_iter().filter(|key| section.has(key)).count();
    match (given, serial, tcp, udp, file) {
        (1, Some(path), ..) => {
            let missing = !section.has("baud");
            section.fault_if(missing, "baud", "missing; give the rate of the line in Bd");
            section.fault_if(path.is_empty(), "serial", "is empty; give the device");
            Some(Port::Serial(Serial { path: path.into(), baud: baud? as u32, data_bits: 8, parity, stop_bits }))
        }
        (1, _, Some(address), ..) => host_and_port(section, "tcp", address).map(Port::Tcp),
        (1, _, _, Some(address), _) => {
            host_and_port(section, "udp", address).map(|address| Port::Udp(Udp { address, peer: sender }))
        }
        (1, .., Some("-")) => Some(Port::Stdin),
        (1, .., Some(path)) => Some(Port::File { path: path.into(), pace: pace.unwrap_or_default() }),
        (0, ..) => {
            section.fault("serial", format!("missing; {ONE}"));
            None
        }
        (1, ..) => None,
        _ => {
            section.fault("", format!("has {given} sources; {ONE}"));
            None
        }
    }
}

/// After what silence a device is opened again: 10 s unless given. `None`: never.
pub(super) fn reopen_after(section: &Section<'_, '_>, port: &Port) -> Option<Duration> {
    let is_line = matches!(port, Port::Serial(_) | Port::Tcp(_));
    if !is_line && section.has("reopen_after_s") {
        section.fault("reopen_after_s", "is for a serial line or TCP; leave it out");
    }
    let seconds = section.optional_number("reopen_after_s").unwrap_or(REOPEN_S);
    let is_right = seconds == 0.0 || (1.0..=86_400.0).contains(&seconds);
    section.fault_if(!is_right, "reopen_after_s", "give 1 to 86400 s, or 0 for never");
    (is_line && is_right && seconds > 0.0).then(|| Duration::from_secs_f64(seconds))
}

/// A silence after which a device is opened again \[s\].
const REOPEN_S: f64 = 10.0;

fn host_and_port(section: &Section<'_, '_>, key: &str, address: &str) -> Option<String> {
    let parts = address.rsplit_once(':').filter(|(host, _)| !host.is_empty());
    let right = parts.and_then(|(_, port)| port.parse::<u16>().ok()).is_some();
    section.refuse(key, (!right).then(|| format!("is {address:?}, give host and port, as in \"192.168.1.10:4000\"")));
    right.then(|| address.to_owned())
}
