//! The ports of an acquisition: what it gets when it joins the streams of its IMU.

use crate::connect::{absent, join_existing, unopened};
use crate::error::ConnectError;
use crate::loan::{TransportError, transport};
use crate::loss::OwnObjects;
use crate::objects::refuse_foreign;
use crate::peers::{depth_of, pid_of, publisher_of};
use crate::rehearsal::Rehearsal;
use crate::transport::ports::{
    Incoming, Outgoing, Payload as _, Publisher, Subscriber, connect_listeners, notifier, notify,
};
use crate::transport::stream::{self, Ipc, IpcNode, RAW_DEPTH, Stream};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::PortFactory as _;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::protocol::queue_depth;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use std::rc::Rc;
use std::sync::Arc;

/// Samples that the caller may have on loan, not sent yet.
const LOANS: usize = 4;

/// The ports of an acquisition, and their node.
#[derive(Debug)]
pub(super) struct AcquisitionPorts {
    pub rehearsal: Rehearsal<CompensatedIncrement, RawSample>,
    /// Loaned in advance.
    pub spare: Option<Outgoing<RawSample>>,
    /// The last increment, which has been read but not returned.
    pub read: Option<Incoming<CompensatedIncrement>>,
    pub publisher: Publisher<RawSample>,
    pub subscriber: Subscriber<CompensatedIncrement>,
    pub notifier: Notifier<Ipc>,
    pub raw: Stream<RawSample>,
    pub increments: Stream<CompensatedIncrement>,
    /// Of these ports: each loan of them has it too.
    pub generation: Rc<()>,
    pub objects: Arc<OwnObjects>,
    /// Dropped last.
    _node: Option<IpcNode>,
}

impl AcquisitionPorts {
    /// Takes the places of the acquisition of an IMU, with this node, or one that it makes: where an attempt fails, the
    /// next one has it. Does not wait.
    pub(super) fn attach(kept_node: &mut Option<IpcNode>, domain: &Domain, imu: &ImuId) -> Result<Self, ConnectError> {
        let node = match kept_node.take() {
            Some(node) => node,
            None => join_existing(domain)?,
        };
        let node = &*kept_node.insert(node);
        refuse_foreign(domain)?;
        let failed = |stream| move |error| unopened(node, domain, imu, stream, error);
        let (raw, increments) = (&stream::raw_name(imu), &stream::increment_name(imu));
        let raw = stream::open_raw(node, raw).map_err(failed(raw))?;
        let increments = stream::open_increment(node, increments).map_err(failed(increments))?;
        let wake = stream::open_event(node, &stream::wake_name(imu));
        let wake = wake.map_err(|error| ConnectError::transport("opening the wake-up event", error))?;
        // The service creates its increment publisher last. When it exists, the service is ready.
        publisher_of(&increments).ok_or_else(|| absent(node, domain, imu))?;

        let publisher = RawSample::publisher(&raw, LOANS + 2).map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                let other = publisher_of(&raw).and_then(|(_, node)| pid_of(domain, node));
                ConnectError::Occupied { imu: imu.clone(), pid: other }
            }
            other => ConnectError::transport("creating the raw publisher", other),
        })?;
        // Enough for each service that may come.
        let subscriber = CompensatedIncrement::subscriber(&increments, Some(queue_depth(RAW_DEPTH)));
        let subscriber = subscriber.map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => ConnectError::no_room(domain, imu, &increments),
            other => ConnectError::transport("subscribing to the increment stream", other),
        })?;
        let notifier = notifier(&wake).map_err(|error| ConnectError::transport("creating the notifier", error))?;
        let rehearsal = Rehearsal::open(node)?;
        let streams = [raw.service_hash(), increments.service_hash(), wake.service_hash()];
        let objects = OwnObjects::of(domain, node, &streams, vec![publisher.id().value(), subscriber.id().value()]);
        Ok(Self {
            rehearsal,
            spare: None,
            read: None,
            publisher,
            subscriber,
            notifier,
            raw,
            increments,
            generation: Rc::new(()),
            objects: Arc::new(objects),
            _node: kept_node.take(),
        })
    }

    /// The service at the other end: the id of its publisher, which is unique for ever, and how many samples may be
    /// unanswered.
    pub(super) fn service(&self) -> Option<(u128, usize)> {
        publisher_of(&self.increments).map(|(id, _)| (id, depth_of(&self.raw, &self.increments)))
    }

    #[inline]
    pub(super) fn take_spare(&mut self) -> Result<Outgoing<RawSample>, TransportError> {
        match self.spare.take() {
            Some(sample) => Ok(sample),
            None => self.loan(),
        }
    }

    #[inline]
    pub(super) fn loan(&self) -> Result<Outgoing<RawSample>, TransportError> {
        RawSample::loan(&self.publisher).map_err(|error| transport("loaning a raw sample", error))
    }

    /// Wakes the service. That is cheap if it does not sleep; if it fails, the service finds the sample at the end of
    /// its bounded wait.
    #[inline]
    pub(super) fn wake(&self) {
        notify(&self.notifier);
    }

    /// Connects whoever has come, and looks where a sample will go and its increment will come.
    pub(super) fn connect(&self) {
        RawSample::connect(&self.publisher);
        connect_listeners(&self.notifier);
        CompensatedIncrement::waits(&self.subscriber);
    }
}
