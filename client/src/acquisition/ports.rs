//! The ports of an acquisition: what it gets when it joins the streams of its IMU.

use crate::connect::{absent, unopened};
use crate::error::ConnectError;
use crate::loan::{TransportError, transport};
use crate::loss::{Loss, removed_object, taken_connection};
use crate::objects::refuse_foreign;
use crate::peers::{depth_of, pid_of, publisher_of};
use crate::rehearsal::Rehearsal;
use crate::transport::ports::{
    Incoming, Outgoing, Payload as _, Publisher, Subscriber, connect_listeners, notifier, notify,
};
use crate::transport::stream::{self, Ipc, IpcNode, Stream};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::protocol::queue_depth;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};

/// Samples that the caller may have on loan, not sent yet.
const LOANS: usize = 4;

/// The ports of an acquisition. They must be dropped before their node.
#[derive(Debug)]
pub(super) struct AcquisitionPorts {
    /// `None` if the service has no streams for it, as one of an earlier version, or if a dead predecessor's places did
    /// not get free.
    pub rehearsal: Option<Rehearsal<CompensatedIncrement, RawSample>>,
    /// Loaned in advance.
    pub spare: Option<Outgoing<RawSample>>,
    /// The last increment, which has been read but not returned.
    pub read: Option<Incoming<CompensatedIncrement>>,
    pub publisher: Publisher<RawSample>,
    pub subscriber: Subscriber<CompensatedIncrement>,
    pub notifier: Notifier<Ipc>,
    pub increments: Stream<CompensatedIncrement>,
}

/// The service at the other end.
#[derive(Clone, Copy, Debug)]
pub(super) struct ServiceEnd {
    /// The id of its publisher, which is unique for ever.
    pub id: u128,
    /// How many samples may be unanswered.
    pub depth: usize,
}

impl AcquisitionPorts {
    /// Takes the places of the acquisition of an IMU; does not wait.
    pub(super) fn attach(node: &IpcNode, domain: &Domain, imu: &ImuId) -> Result<(Self, ServiceEnd), ConnectError> {
        refuse_foreign(domain)?;
        let failed = |stream| move |error| unopened(node, domain, imu, stream, error);
        let (raw, increments) = (&stream::raw_name(imu), &stream::increment_name(imu));
        let raw = stream::open_raw(node, raw).map_err(failed(raw))?;
        let increments = stream::open_increment(node, increments).map_err(failed(increments))?;
        let wake = stream::open_event(node, &stream::wake_name(imu));
        let wake = wake.map_err(|error| ConnectError::transport("opening the wake-up event", error))?;
        // The service creates its increment publisher last. When it exists, the service is ready.
        let id = publisher_of(&increments).ok_or_else(|| absent(node, domain, imu))?.0;

        let publisher = RawSample::publisher(&raw, LOANS + 2).map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                // A dead acquisition occupies the only place until its node is cleaned up.
                node.try_cleanup_dead_nodes();
                let other = publisher_of(&raw).and_then(|(_, node)| pid_of(domain, node));
                ConnectError::Occupied { imu: imu.clone(), pid: other }
            }
            other => ConnectError::transport("creating the raw publisher", other),
        })?;
        let depth = depth_of(&raw, &increments);
        let subscriber = CompensatedIncrement::subscriber(&increments, Some(queue_depth(depth)));
        let subscriber = subscriber.map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                // Dead readers occupy their places until their nodes are cleaned up.
                node.try_cleanup_dead_nodes();
                ConnectError::no_room(domain, imu, &increments)
            }
            other => ConnectError::transport("subscribing to the increment stream", other),
        })?;
        let notifier = notifier(&wake).map_err(|error| ConnectError::transport("creating the notifier", error))?;
        let ports = Self { rehearsal: None, spare: None, read: None, publisher, subscriber, notifier, increments };
        Ok((ports, ServiceEnd { id, depth }))
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

    /// What has cut these ports off from the service, if anything is seen.
    pub(super) fn find_loss(&self, domain: &Domain) -> Option<Loss> {
        let ports = [self.publisher.id().value(), self.subscriber.id().value()];
        let removed = removed_object(domain).map(Loss::Removed);
        removed.or_else(|| taken_connection(domain, &ports).map(Loss::Taken))
    }
}
