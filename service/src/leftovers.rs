//! What killed clients leave behind and the transport does not clear away.
//!
//! The transport cleans up after a dead process as long as it finds what that one was doing. Killed while it joined, a process leaves files that
//! say nothing; killed while it made a port, it can leave that port listed for ever, with its place taken. Both are looked for once a second, and
//! removed when their process has been dead for [`PASSES`] such looks, which leaves the transport its turn.

use iceoryx2::config::Config;
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::{
    CallbackProgression, FilePath, IceoryxSend, Node, NodeState, PortFactory as _, SemanticString as _,
};
use iceoryx2::service::internal::ServiceInternal as _;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use iceoryx2::service::service_hash::ServiceHash;
use isotherm_client::{check_room, in_mode};
use isotherm_shared::stream::{CREATION_TIMEOUT, Domain, Ipc, IpcNode};
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::process::{Flock, FlockType, fcntl_getlk};
use std::collections::{BTreeSet, HashMap};
use std::fmt;
use std::fs::{self, File};
use std::io::Write as _;
use std::os::fd::AsRawFd as _;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;
use tracing::{debug, error, info};

/// Looks in a row that must have found a process dead before what it left is removed.
const PASSES: u32 = 3;

/// Has the transport take the domain's configuration for that of dead processes that have left none. It would read one from the current
/// directory otherwise, look in another domain, and leave what is there.
pub fn adopt_domain(domain: &Domain) {
    let adopt = || -> Option<()> {
        let text = toml::to_string(&domain.config().ok()?).ok()?;
        // A file, since nothing else is taken, but one that nobody else sees.
        let mut file = File::from(memfd_create("isotherm", MemfdFlags::CLOEXEC).ok()?);
        file.write_all(text.as_bytes()).ok()?;
        let path = format!("/proc/self/fd/{}", file.as_raw_fd());
        Config::setup_global_config_from_file(&FilePath::new(path.as_bytes()).ok()?).ok()?;
        Some(())
    };
    if adopt().is_none() {
        debug!("the transport keeps its own configuration for dead processes that have left none");
    }
}

/// Where there is no room for a service of `imus` IMUs, has what its predecessor has left cleared away. That is not gone at the first try: its
/// nodes go one after the other.
pub fn make_room(domain: &Domain, imus: usize) {
    for _ in 0..10 {
        if check_room(imus).is_ok() {
            return;
        }
        clear_dead(domain);
        thread::sleep(Duration::from_millis(20));
    }
}

/// Has the transport clear away what dead processes have left, without joining the domain.
fn clear_dead(domain: &Domain) {
    let Ok(config) = domain.config() else { return };
    let listed = Node::<Ipc>::list(&config, |node| {
        if let NodeState::Dead(view) = node {
            // Another process may be at it.
            let _ = view.try_remove_stale_resources();
        }
        CallbackProgression::Continue
    });
    if let Err(error) = listed {
        debug!("listing dead processes: {error}");
    }
}

/// What has been found so far.
#[derive(Debug)]
pub struct Leftovers {
    nodes: PathBuf,
    prefix: String,
    own: u32,
    told_of_removal: bool,
    /// Dead nodes by number, with the looks that have found them.
    dead: HashMap<u128, u32>,
}

impl Leftovers {
    /// Of the domain that `node` is in.
    pub fn new(domain: &Domain, node: &IpcNode) -> Self {
        let nodes = Path::new(domain.root_path()).join("nodes");
        Self {
            nodes,
            prefix: domain.prefix(),
            own: pid(node.id().value()),
            told_of_removal: false,
            dead: HashMap::new(),
        }
    }

    /// Looks once, and removes what has been dead for long enough; `ports` are those of all streams.
    pub fn sweep(&mut self, node: &IpcNode, ports: &[Port]) {
        let removed = !self.nodes.exists();
        if removed && !self.told_of_removal {
            error!(
                "{} has been removed under the running service: clients that are connected go on, no other can connect; restart the service, and \
                 keep domains in /run/isotherm, where nobody tidies up",
                self.nodes.display()
            );
        }
        self.told_of_removal = removed;
        for (path, age) in in_mode("/dev/shm", &self.prefix, 0o200) {
            if age.is_some_and(|age| age > 2 * CREATION_TIMEOUT) {
                let _ = fs::remove_file(path);
            }
        }
        // Should the numbers ever be made otherwise, nothing more is done.
        if self.own != std::process::id() {
            return;
        }
        let mut numbers = self.numbers();
        numbers.extend(ports.iter().map(|(node, _)| node.value()));
        numbers.retain(|number| !self.lives(*number));
        self.dead.retain(|number, _| numbers.contains(number));
        for number in numbers {
            let looks = self.dead.entry(number).or_default();
            *looks += 1;
            if *looks < PASSES {
                continue;
            }
            let mut removed = true;
            for (port, service) in ports.iter().filter(|(port, _)| port.value() == number) {
                let result = Ipc::__internal_remove_node_from_service(port, service, node.config());
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

    /// The nodes that have a folder or a file.
    fn numbers(&self) -> BTreeSet<u128> {
        let names = fs::read_dir(&self.nodes).into_iter().flatten().flatten();
        let names = names.filter_map(|entry| entry.file_name().into_string().ok());
        names
            .filter_map(|name| name.strip_prefix(&self.prefix).unwrap_or(&name).split('.').next()?.parse().ok())
            .collect()
    }

    /// Whether the process of a node may be alive. One that cannot be seen from here still holds its lock.
    fn lives(&self, number: u128) -> bool {
        let pid = pid(number);
        if pid == self.own || Path::new(&format!("/proc/{pid}")).exists() {
            return true;
        }
        let monitor = self.nodes.join(format!("{}{number}.node_monitor", self.prefix));
        let lock = File::open(monitor).and_then(|file| Ok(fcntl_getlk(&file, &Flock::from(FlockType::WriteLock))?));
        lock.is_ok_and(|holder| holder.is_some())
    }

    /// Removes the files of a dead node.
    fn remove(&self, number: u128) {
        let folder = self.nodes.join(number.to_string());
        let inner = fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let outer = ["node_monitor", "node_monitor_context", "node_monitor_owner_lock"];
        let outer = outer.map(|name| self.nodes.join(format!("{}{number}.{name}", self.prefix)));
        for path in inner.chain(outer) {
            // Most are not there.
            let _ = fs::remove_file(path);
        }
        let _ = fs::remove_dir(folder);
    }
}

/// The process of a node, which is part of its number.
const fn pid(number: u128) -> u32 {
    (number >> 64) as u32
}

/// A port that is listed: its node, and the service that lists it.
pub type Port = (UniqueNodeId, ServiceHash);

/// The ports of a stream.
pub fn ports_of<T: IceoryxSend + fmt::Debug + ?Sized>(
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
pub fn ports_of_event(event: &event::PortFactory<Ipc>) -> Vec<Port> {
    let mut ports = Vec::new();
    let mut note = |node: UniqueNodeId| {
        ports.push((node, *event.service_hash()));
        CallbackProgression::Continue
    };
    event.dynamic_config().list_notifiers(|port| note(port.node_id));
    event.dynamic_config().list_listeners(|port| note(port.node_id));
    ports
}

/// Removes those ports whose process is dead.
pub fn remove_dead(domain: &Domain, node: &IpcNode, ports: &[Port]) {
    let dead = Leftovers::new(domain, node);
    for (port, service) in ports.iter().filter(|(port, _)| !dead.lives(port.value())) {
        let result = Ipc::__internal_remove_node_from_service(port, service, node.config());
        debug!("removing a port of dead process {}: {result:?}", pid(port.value()));
    }
}
