//! Removing what a domain leaves behind: a few small files that the transport keeps for the next start.

use crate::failure::{Exit, Failure};
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::{CallbackProgression, Node, NodeState, ipc};
use isotherm_client::{Domain, sweep_half_created};
use std::fs;
use std::io;
use std::path::Path;

/// Removes everything of `domain` from shared memory and its folder. Says how many objects there were.
///
/// # Errors
/// If a process of the domain is alive, or something cannot be removed.
pub fn clean(domain: &Domain) -> Result<usize, Failure> {
    sweep_half_created(domain);
    let config = domain.config().map_err(|error| Failure::new(Exit::Usage, error.to_string()))?;
    let mut alive = None;
    let listed = Node::<ipc::Service>::list(&config, |node| {
        match &node {
            NodeState::Alive(view) => {
                alive = Some(view.id().pid::<ipc::Service>().map(|pid| pid.value()).unwrap_or_default());
            }
            NodeState::Dead(_) | NodeState::Inaccessible(_) | NodeState::Undefined(_) => {}
        }
        CallbackProgression::Continue
    });
    if let Some(pid) = alive {
        let message = format!("cleaning domain {:?}: pid {pid} is using it; stop it first", domain.name());
        return Err(Failure::new(Exit::Failed, message));
    }
    listed.map_err(|error| {
        Failure::new(Exit::Failed, format!("listing the processes of domain {:?}: {error}", domain.name()))
    })?;

    let mut removed = 0;
    let prefix = domain.prefix();
    for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        if entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes()) {
            fs::remove_file(entry.path()).map_err(|error| Failure::io("removing", &entry.path(), &error))?;
            removed += 1;
        }
    }
    let root = Path::new(domain.root_path());
    match fs::remove_dir_all(root) {
        Ok(()) => removed += 1,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(Failure::io("removing", root, &error)),
    }
    Ok(removed)
}
