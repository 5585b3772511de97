//! The processes at the other end of a stream, and how this process can name them.

use crate::transport::stream::{Ipc, IpcNode, RAW_DEPTH};
use core::fmt;
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::{CallbackProgression, IceoryxSend, MessagingPattern, PortFactory as _, ServiceName};
use iceoryx2::service::Service as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as StaticPattern;
use isotherm_shared::names::Domain;
use isotherm_shared::protocol::depth_in_flight;
use isotherm_shared::status::ServiceStatus;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use rustix::process::{Flock, FlockType, fcntl_getlk};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The only publisher of a stream: its id, which is unique for ever, and its node.
pub fn publisher_of<T: IceoryxSend + fmt::Debug + ?Sized>(
    stream: &PortFactory<Ipc, T, ()>,
) -> Option<(u128, UniqueNodeId)> {
    let mut found = None;
    stream.dynamic_config().list_publishers(|details| {
        found = Some((details.publisher_id.value(), details.node_id));
        CallbackProgression::Stop
    });
    found
}

/// Who has the lock by which the transport knows that the process of a node lives.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum NodeHolder {
    /// Nobody: the process is dead.
    Nobody,
    /// The process with this id, as this process sees it.
    Process(i32),
    /// A process that this process cannot see: one of another pid namespace, or of a node that cannot be looked at, as
    /// where no more files may be opened.
    Elsewhere,
}

impl NodeHolder {
    /// Looks at the lock of the node with this number. The node must not be of this process: closing a file gives up
    /// all locks that the process has on it.
    #[must_use]
    pub fn of(domain: &Domain, number: u128) -> Self {
        let monitor = monitor(domain, number);
        let lock = File::open(monitor).and_then(|file| Ok(fcntl_getlk(&file, &Flock::from(FlockType::WriteLock))?));
        // The kernel gives the holder's id in the namespace of who asks, and 0 where it has none there.
        match lock {
            Ok(Some(Flock { pid: Some(pid), .. })) => Self::Process(pid.as_raw_nonzero().get()),
            Ok(None) => Self::Nobody,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Self::Nobody,
            Ok(Some(_)) | Err(_) => Self::Elsewhere,
        }
    }
}

/// The nodes that this process has made. Looking at the lock of one of them would release it.
static OWN_NODES: Mutex<BTreeSet<u128>> = Mutex::new(BTreeSet::new());

/// Notes that a node belongs to this process.
pub(crate) fn register_own(node: &IpcNode) {
    OWN_NODES.lock().unwrap_or_else(PoisonError::into_inner).insert(node.id().value());
}

/// Whether a node with this number belongs to this process.
pub(crate) fn is_own_node(number: u128) -> bool {
    OWN_NODES.lock().unwrap_or_else(PoisonError::into_inner).contains(&number)
}

/// Whether the process of the node with this number lives, by the identity and the lock of the node: it is this one, or
/// one that holds the lock. Numbers of processes say nothing, since in containers every program is process 1.
#[must_use]
pub fn is_alive(domain: &Domain, number: u128) -> bool {
    is_own_node(number) || NodeHolder::of(domain, number) != NodeHolder::Nobody
}

pub(crate) fn monitor(domain: &Domain, number: u128) -> PathBuf {
    Path::new(domain.root_path()).join("nodes").join(format!("{}{number}.node_monitor", domain.prefix()))
}

/// The process id of a node as this process sees it; `None` if the process is in another pid namespace.
pub fn pid_of(domain: &Domain, node: UniqueNodeId) -> Option<i32> {
    // In the namespace of the process.
    let own_view = node.pid::<Ipc>().ok()?.value();
    if is_own_node(node.value()) {
        return Some(own_view);
    }
    match NodeHolder::of(domain, node.value()) {
        NodeHolder::Nobody => Some(own_view),
        NodeHolder::Process(pid) => Some(pid),
        NodeHolder::Elsewhere => None,
    }
}

/// A process id in words; `None` is one in another pid namespace.
#[must_use]
pub fn named(pid: Option<i32>) -> String {
    pid.map_or_else(|| "in another pid namespace".to_owned(), |pid| format!("pid {pid}"))
}

/// The process id of a service in words, as its status has it.
#[must_use]
pub fn service_pid(status: &ServiceStatus) -> String {
    let ServiceStatus { pid, pid_namespace, .. } = status;
    let is_elsewhere = ![0, crate::peers::pid_namespace()].contains(pid_namespace);
    format!("pid {pid}{}", if is_elsewhere { " of another pid namespace" } else { "" })
}

/// The number of this process's pid namespace; 0 if the kernel does not report it.
#[must_use]
pub fn pid_namespace() -> u64 {
    fs::metadata("/proc/self/ns/pid").map_or(0, |namespace| namespace.ino())
}

/// The name of the payload type of a stream that exists.
#[must_use]
pub fn payload_of(node: &IpcNode, stream: &ServiceName) -> Option<String> {
    let details = Ipc::details(stream, node.config(), MessagingPattern::PublishSubscribe).ok()??;
    match details.static_details.messaging_pattern() {
        StaticPattern::PublishSubscribe(stream) => Some(stream.message_type_details().payload.type_name().to_string()),
        _ => None,
    }
}

/// Processes of a stream.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub struct Peers {
    /// Their process ids, as this process sees them.
    pub pids: Vec<i32>,
    /// How many more there are in other pid namespaces.
    pub elsewhere: usize,
}

impl fmt::Display for Peers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pids, elsewhere } = self;
        write!(f, "processes {pids:?}")?;
        if *elsewhere > 0 { write!(f, " and {elsewhere} in other pid namespaces") } else { Ok(()) }
    }
}

/// The processes that have subscribed to a stream of a domain.
pub fn subscribers_of<T: IceoryxSend + fmt::Debug + ?Sized>(
    domain: &Domain,
    stream: &PortFactory<Ipc, T, ()>,
) -> Peers {
    let mut nodes = Vec::new();
    stream.dynamic_config().list_subscribers(|details| {
        nodes.push(details.node_id);
        CallbackProgression::Continue
    });
    let mut peers = Peers::default();
    for node in nodes {
        match pid_of(domain, node) {
            Some(pid) => peers.pids.push(pid),
            None => peers.elsewhere += 1,
        }
    }
    peers.pids.sort_unstable();
    peers.pids.dedup();
    peers
}

/// How many raw samples may be unanswered: the service's queue of raw samples has a depth to match. The service's
/// subscriber belongs to the node that publishes the increments.
pub(crate) fn depth_of(
    raw: &PortFactory<Ipc, RawSample, ()>,
    increments: &PortFactory<Ipc, CompensatedIncrement, ()>,
) -> usize {
    let (mut service, mut depth) = (None, RAW_DEPTH);
    increments.dynamic_config().list_publishers(|details| {
        service = Some(details.node_id);
        CallbackProgression::Stop
    });
    raw.dynamic_config().list_subscribers(|details| {
        if Some(details.node_id) == service {
            depth = depth_in_flight(details.buffer_size).min(RAW_DEPTH);
        }
        CallbackProgression::Continue
    });
    depth
}
