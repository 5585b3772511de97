//! The nodes of a domain, as the transport finds them in its files. Reading and writing these takes much generic code,
//! which is compiled only here: no function is generic.

use super::stream::{Ipc, IpcNode, configuration};
use core::time::Duration;
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::{CallbackProgression, Node, NodeState};
use iceoryx2::service::internal::ServiceInternal as _;
use iceoryx2::service::service_hash::ServiceHash;
use isotherm_shared::names::Domain;

/// The transport's configuration in a domain, as the text of its configuration file.
///
/// # Errors
/// Why there is none.
pub fn configuration_text(domain: &Domain) -> Result<String, String> {
    let config = configuration(domain).map_err(|error| error.to_string())?;
    toml::to_string(&config).map_err(|error| error.to_string())
}

/// Removes what dead processes have left, without joining the domain.
///
/// # Errors
/// Why the nodes cannot be listed.
pub fn clear_dead(domain: &Domain) -> Result<(), String> {
    let config = configuration(domain).map_err(|error| error.to_string())?;
    let listed = Node::<Ipc>::list(&config, |node| {
        if let NodeState::Dead(view) = node {
            // This fails if another process is already removing them.
            let _ = view.try_remove_stale_resources();
        }
        CallbackProgression::Continue
    });
    listed.map_err(|error| error.to_string())
}

/// Removes what dead processes have left in the domain of this node, as far as that is possible at once.
pub fn clean(node: &IpcNode) {
    node.try_cleanup_dead_nodes();
}

/// As [`clean`], but waits up to `timeout` for other processes that do the same.
pub fn clean_within(node: &IpcNode, timeout: Duration) {
    node.blocking_cleanup_dead_nodes(timeout);
}

/// Removes the ports that a dead process's node has in a stream or an event.
///
/// # Errors
/// Why they cannot be removed.
pub fn remove_ports(node: &IpcNode, dead: &UniqueNodeId, service: &ServiceHash) -> Result<(), String> {
    let removed = Ipc::__internal_remove_node_from_service(dead, service, node.config());
    removed.map_err(|error| format!("{error:?}"))
}
