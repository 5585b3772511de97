//! The processes at the other end of a stream.

use core::fmt;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::{
    CallbackProgression, IceoryxSend, MessagingPattern, Node, NodeState, PortFactory as _, ServiceName,
};
use iceoryx2::service::Service as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as StaticPattern;
use isotherm_shared::protocol::depth_in_flight;
use isotherm_shared::stream::{Ipc, IpcNode, RAW_DEPTH};
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

/// Whether the process of a stream's only publisher lives. The transport keeps a dead one listed until its remains are
/// removed.
pub(crate) fn publisher_is_alive<T: IceoryxSend + fmt::Debug>(
    node: &IpcNode,
    stream: &PortFactory<Ipc, T, ()>,
) -> bool {
    let (mut publisher, mut alive) = (None, false);
    stream.dynamic_config().list_publishers(|details| {
        publisher = Some(details.node_id);
        CallbackProgression::Stop
    });
    let listed = Node::<Ipc>::list(node.config(), |state| match state {
        NodeState::Alive(view) if Some(*view.id()) == publisher => {
            alive = true;
            CallbackProgression::Stop
        }
        _ => CallbackProgression::Continue,
    });
    alive && listed.is_ok()
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
            depth = depth_in_flight(details.buffer_size);
        }
        CallbackProgression::Continue
    });
    depth
}
