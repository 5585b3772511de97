//! The ports of a reader, and how its [helper thread](crate::helper) gets them: looking for what cuts the reader off,
//! leaving and joining may wait.

use crate::arrival::ArrivalEvent;
use crate::connect::{join_existing, unopened};
use crate::error::ConnectError;
use crate::helper::{Helper, MovedPorts};
use crate::loss::OwnObjects;
use crate::objects::refuse_foreign;
use crate::transport::ports::{Payload, Subscriber};
use crate::transport::stream::IpcNode;
use crate::warning::warn;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::PortFactory as _;
use isotherm_shared::names::{Domain, ImuId};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Pause between two attempts to find the service.
pub(super) const RETRY: Duration = Duration::from_millis(20);

/// What a reader has while it is connected. Fields are dropped in this order: the ports before their node.
#[derive(Debug)]
pub(super) struct ReaderPorts<T: Payload> {
    pub arrival: Option<ArrivalEvent>,
    pub subscriber: Subscriber<T>,
    pub objects: Arc<OwnObjects>,
    pub node: IpcNode,
}

impl<T: Payload> ReaderPorts<T> {
    /// Subscribes to the stream of an IMU, with this node, or one that it makes: where an attempt fails, the next one
    /// has it. Does not wait.
    pub(super) fn attach(kept_node: &mut Option<IpcNode>, domain: &Domain, imu: &ImuId) -> Result<Self, ConnectError> {
        let node = match kept_node.take() {
            Some(node) => node,
            None => join_existing(domain)?,
        };
        match Self::subscribe(&node, domain, imu) {
            Ok((subscriber, objects)) => Ok(Self { arrival: None, subscriber, objects: Arc::new(objects), node }),
            Err(error) => {
                *kept_node = Some(node);
                Err(error)
            }
        }
    }

    fn subscribe(node: &IpcNode, domain: &Domain, imu: &ImuId) -> Result<(Subscriber<T>, OwnObjects), ConnectError> {
        refuse_foreign(domain)?;
        let name = T::stream(imu);
        let stream = T::open(node, &name);
        let stream = stream.map_err(|error| unopened(node, domain, imu, &name, error))?;
        let subscriber = T::subscriber(&stream, None).map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => ConnectError::no_room(domain, imu, &stream),
            other => ConnectError::transport("subscribing to the stream", other),
        })?;
        let objects = OwnObjects::of(domain, node, &[stream.service_hash()], vec![subscriber.id().value()]);
        Ok((subscriber, objects))
    }

    /// Opens the event of the stream, if it has one.
    pub(super) fn listen(&mut self, imu: &ImuId) -> Result<(), ConnectError> {
        if self.arrival.is_none() && T::HAS_EVENT {
            self.arrival = ArrivalEvent::open(&self.node, imu)?;
        }
        Ok(())
    }
}

/// What the helper thread is asked for.
#[derive(Debug)]
pub(super) enum Question<T: Payload> {
    /// Whether the reader is cut off from its stream.
    Loss(Arc<OwnObjects>),
    /// To give these ports up, and to subscribe as soon as a service is there, with the event if the reader `listens`.
    Ports { old: Option<MovedPorts<ReaderPorts<T>>>, listens: bool },
}

/// What it answers.
#[derive(Debug)]
pub(super) enum Answer<T: Payload> {
    Loss(bool),
    /// The error is one that waiting does not resolve; `None` if the reader is closing.
    Ports(Result<Option<MovedPorts<ReaderPorts<T>>>, ConnectError>),
}

pub(super) type ReaderHelper<T> = Helper<Question<T>, Answer<T>>;

/// Starts the helper thread of a reader.
pub(super) fn start_helper<T: Payload>(imu: &ImuId, domain: &Domain) -> std::io::Result<ReaderHelper<T>> {
    let (imu, domain) = (imu.clone(), domain.clone());
    Helper::start(move |question, is_closing: &dyn Fn() -> bool| match question {
        Question::Loss(objects) => {
            let loss = objects.loss(&domain);
            if let Some(loss) = &loss {
                warn(&imu, format_args!("a reader is cut off from the service: {loss}; joining the stream again"));
            }
            Answer::Loss(loss.is_some())
        }
        Question::Ports { old, listens } => {
            drop(old);
            Answer::Ports(join(&imu, &domain, listens, is_closing).map(|ports| ports.map(MovedPorts::new)))
        }
    })
}

fn join<T: Payload>(
    imu: &ImuId,
    domain: &Domain,
    listens: bool,
    is_closing: &dyn Fn() -> bool,
) -> Result<Option<ReaderPorts<T>>, ConnectError> {
    let mut node = None;
    while !is_closing() {
        match ReaderPorts::attach(&mut node, domain, imu) {
            Ok(mut ports) => {
                if listens {
                    // Without it the reader polls.
                    let _ = ports.listen(imu);
                }
                return Ok(Some(ports));
            }
            Err(error) if may_pass(&error) => thread::sleep(RETRY),
            Err(error) => return Err(error),
        }
    }
    Ok(None)
}

/// Whether a reader that is not connected may be so later.
pub(super) const fn may_pass(error: &ConnectError) -> bool {
    matches!(
        error,
        ConnectError::NoService(_)
            | ConnectError::NoSuchImu { .. }
            | ConnectError::Foreign(_)
            | ConnectError::Transport { .. }
    )
}
