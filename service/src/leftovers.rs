//! Removing what killed clients leave behind and the transport does not remove.
//!
//! The transport cleans up after a dead process as long as it finds a record of what the process was doing. A process
//! that is killed while it joins leaves files without such a record. A process that is killed while it creates a port
//! can leave the port listed for ever, with its place taken. The control thread searches for both once a second. It
//! removes them when [`PASSES`] searches in a row have found the process dead, so that the transport can remove them
//! first.

use iceoryx2::config::Config;
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::{CallbackProgression, FilePath, IceoryxSend, PortFactory as _, SemanticString as _};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use iceoryx2::service::service_hash::ServiceHash;
use isotherm_client::transport::nodes;
use isotherm_client::transport::stream::{CREATION_TIMEOUT, Ipc, IpcNode};
use isotherm_client::{check_room, domain_files, is_alive};
use isotherm_shared::names::Domain;
use rustix::fs::{MemfdFlags, memfd_create};
use std::collections::{BTreeSet, HashMap};
use std::fs::{self, File};
use std::io::Write as _;
use std::os::fd::AsRawFd as _;
use std::path::{Path, PathBuf};
use std::time::Duration;
use std::{fmt, thread};
use tracing::{debug, info};

/// So many searches in a row must find a process dead before its leftovers are removed.
const PASSES: u32 = 3;

/// Makes the transport use the domain's configuration for dead processes whose own configuration file is missing.
/// Otherwise, the transport would read a configuration from the current directory, search another domain, and not clean
/// up this one.
pub(crate) fn use_domain_config(domain: &Domain) {
    let set = || -> Option<()> {
        let text = nodes::configuration_text(domain).ok()?;
        // The transport only accepts a file; an anonymous one in memory is visible to this process only.
        let mut file = File::from(memfd_create("isotherm", MemfdFlags::CLOEXEC).ok()?);
        file.write_all(text.as_bytes()).ok()?;
        let path = format!("/proc/self/fd/{}", file.as_raw_fd());
        Config::setup_global_config_from_file(&FilePath::new(path.as_bytes()).ok()?).ok()?;
        Some(())
    };
    if set().is_none() {
        debug!("the transport keeps its own configuration for dead processes that have left none");
    }
}

/// If there is no room for a service of `imus` IMUs, removes what dead processes, such as a previous service, have
/// left. This needs several tries: their nodes are removed one after the other.
pub(crate) fn make_room(domain: &Domain, imus: usize) {
    for _ in 0..10 {
        if check_room(imus).is_ok() {
            return;
        }
        clear_dead(domain);
        thread::sleep(Duration::from_millis(20));
    }
}

/// Makes the transport remove what dead processes have left, without joining the domain.
fn clear_dead(domain: &Domain) {
    if let Err(error) = nodes::clear_dead(domain) {
        debug!("listing dead processes: {error}");
    }
}

/// The state of the search for leftovers.
#[derive(Debug)]
pub(crate) struct Leftovers {
    nodes: PathBuf,
    domain: Domain,
    /// Dead nodes by number, with how many searches in a row have found them dead.
    dead: HashMap<u128, u32>,
}

impl Leftovers {
    /// For this domain.
    pub(crate) fn new(domain: &Domain) -> Self {
        Self { nodes: nodes(domain), domain: domain.clone(), dead: HashMap::new() }
    }

    /// Searches once, and removes the leftovers of processes that have been dead for long enough. `ports` are the ports
    /// of all streams.
    pub(crate) fn sweep(&mut self, node: &IpcNode, ports: &[Port]) {
        for file in domain_files(&self.domain) {
            file.close_to_others();
            let is_left = file.is_half_created() && file.age().is_some_and(|age| age > 2 * CREATION_TIMEOUT);
            if is_left || file.is_half_written() {
                let _ = fs::remove_file(file.path);
            }
        }
        let mut numbers = node_numbers(&self.domain);
        numbers.extend(ports.iter().map(|(node, _)| node.value()));
        numbers.retain(|number| !is_alive(&self.domain, *number));
        self.dead.retain(|number, _| numbers.contains(number));
        for number in numbers {
            let passes = self.dead.entry(number).or_default();
            *passes += 1;
            if *passes < PASSES {
                continue;
            }
            let mut removed = true;
            for (port, service) in ports.iter().filter(|(port, _)| port.value() == number) {
                let result = nodes::remove_ports(node, port, service);
                debug!("removing a port of dead process {}: {result:?}", pid(number));
                removed &= result.is_ok();
            }
            if removed {
                info!(pid = pid(number), "removed what a killed process had left half-made");
                self.remove(number);
                self.dead.remove(&number);
            }
        }
    }

    /// Removes the files of a dead node.
    fn remove(&self, number: u128) {
        let folder = self.nodes.join(number.to_string());
        let inner = fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let outer = ["node_monitor", "node_monitor_context", "node_monitor_owner_lock"];
        let prefix = self.domain.prefix();
        let outer = outer.map(|name| self.nodes.join(format!("{prefix}{number}.{name}")));
        for path in inner.chain(outer) {
            // Most of these files do not exist.
            let _ = fs::remove_file(path);
        }
        let _ = fs::remove_dir(folder);
    }
}

/// The numbers of the nodes of a domain that have a folder or a file.
fn node_numbers(domain: &Domain) -> BTreeSet<u128> {
    let names = fs::read_dir(nodes(domain)).into_iter().flatten().flatten();
    let names = names.filter_map(|entry| entry.file_name().into_string().ok());
    let prefix = domain.prefix();
    names.filter_map(|name| name.strip_prefix(&prefix).unwrap_or(&name).split('.').next()?.parse().ok()).collect()
}

/// The numbers of the nodes whose processes live.
pub(crate) fn living_nodes(domain: &Domain) -> impl Iterator<Item = u128> {
    node_numbers(domain).into_iter().filter(|number| is_alive(domain, *number))
}

fn nodes(domain: &Domain) -> PathBuf {
    Path::new(domain.root_path()).join("nodes")
}

/// The process id of a node, which is part of its number.
const fn pid(number: u128) -> u32 {
    (number >> 64) as u32
}

/// A listed port: its node, and the service that lists it.
pub(crate) type Port = (UniqueNodeId, ServiceHash);

/// The ports of a stream.
pub(crate) fn ports_of<T: IceoryxSend + fmt::Debug + ?Sized>(
    stream: &publish_subscribe::PortFactory<Ipc, T, ()>,
) -> Vec<Port> {
    let mut ports = Vec::new();
    let mut note = |node: UniqueNodeId| {
        ports.push((node, *stream.service_hash()));
        CallbackProgression::Continue
    };
    stream.dynamic_config().list_publishers(|port| note(port.node_id));
    stream.dynamic_config().list_subscribers(|port| note(port.node_id));
    ports
}

/// The ports of a wake-up event.
pub(crate) fn ports_of_event(event: &event::PortFactory<Ipc>) -> Vec<Port> {
    let mut ports = Vec::new();
    let mut note = |node: UniqueNodeId| {
        ports.push((node, *event.service_hash()));
        CallbackProgression::Continue
    };
    event.dynamic_config().list_notifiers(|port| note(port.node_id));
    event.dynamic_config().list_listeners(|port| note(port.node_id));
    ports
}

/// Removes the ports whose process is dead.
pub(crate) fn remove_dead(domain: &Domain, node: &IpcNode, ports: &[Port]) {
    for (port, service) in ports.iter().filter(|(port, _)| !is_alive(domain, port.value())) {
        let result = nodes::remove_ports(node, port, service);
        debug!("removing a port of dead process {}: {result:?}", pid(port.value()));
    }
}
