//! The processes at the other end of a stream.

use core::fmt;
use iceoryx2::prelude::{CallbackProgression, IceoryxSend, PortFactory as _};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_shared::stream::{Ipc, RAW_DEPTH};
use isotherm_shared::wire::{CompensatedIncrement, RawSample};

/// The only publisher of a stream: its id, which is unique for ever, and its process id if known.
pub fn publisher_of<T: IceoryxSend + fmt::Debug + ?Sized>(
    stream: &PortFactory<Ipc, T, ()>,
) -> Option<(u128, Option<i32>)> {
    let mut found = None;
    stream.dynamic_config().list_publishers(|details| {
        let pid = details.node_id.pid::<Ipc>().ok().map(|pid| pid.value());
        found = Some((details.publisher_id.value(), pid));
        CallbackProgression::Stop
    });
    found
}

/// The processes that have subscribed to a stream.
pub fn subscribers_of<T: IceoryxSend + fmt::Debug + ?Sized>(stream: &PortFactory<Ipc, T, ()>) -> Vec<i32> {
    let mut pids = Vec::new();
    stream.dynamic_config().list_subscribers(|details| {
        pids.extend(details.node_id.pid::<Ipc>().ok().map(|pid| pid.value()));
        CallbackProgression::Continue
    });
    pids.sort_unstable();
    pids.dedup();
    pids
}

/// The depth of the service's queue of raw samples. The service's subscriber belongs to the node that publishes the
/// increments.
pub fn depth_of(
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
            depth = details.buffer_size;
        }
        CallbackProgression::Continue
    });
    depth
}
