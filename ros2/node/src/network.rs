//! The network: a participant of DDS with one node of ROS 2.

use isotherm_ros2::{Discovery, NetworkSettings, QueueSettings};
use isotherm_support::failure::{Exit, Failure};
use ros2_client::dds::rustdds::{DomainParticipantBuilder, Topic};
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, Subscription};
use serde::Serialize;
use std::fmt::Display;
use std::net::Ipv4Addr;
use std::thread;

/// A node in the network.
pub(crate) struct Network {
    context: Context,
    node: Node,
}

impl Network {
    /// Joins the network.
    ///
    /// # Errors
    /// If the network or the name does not allow it.
    pub(crate) fn open(name: &str, settings: NetworkSettings) -> Result<Self, Failure> {
        let participant = DomainParticipantBuilder::new(settings.domain_id);
        let participant = match settings.discovery {
            Discovery::Localhost => participant.with_only_networks([Ipv4Addr::LOCALHOST]),
            Discovery::Subnet => participant,
        };
        let remedy = "are the ports of DDS from 7400 on free, and is the network up?";
        let failed = |cause: &dyn Display| Failure::new(Exit::Io, format!("joining the network: {cause}; {remedy}"));
        let participant = participant.build().map_err(|error| failed(&error))?;
        let context = Context::from_domain_participant(participant).map_err(|error| failed(&error))?;
        let name = NodeName::new("/", name);
        let name = name.map_err(|error| Failure::new(Exit::Config, format!("name of the node: {error}")))?;
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let node = context.new_node(name, options).map_err(|error| failed(&error))?;
        Ok(Self { context, node })
    }

    /// A publisher of a topic.
    ///
    /// # Errors
    /// If the transport refuses it.
    pub(crate) fn publisher<M: Serialize>(
        &mut self,
        topic: &str,
        (package, message): (&str, &str),
        queue: QueueSettings,
    ) -> Result<Publisher<M>, Failure> {
        let created = self.topic(topic, package, message, queue)?;
        self.node.create_publisher(&created, None).map_err(|error| refused("publishing", topic, &error))
    }

    /// A subscription to a topic.
    ///
    /// # Errors
    /// If the transport refuses it.
    pub(crate) fn subscription<M: 'static>(
        &mut self,
        topic: &str,
        (package, message): (&str, &str),
        queue: QueueSettings,
    ) -> Result<Subscription<M>, Failure> {
        let created = self.topic(topic, package, message, queue)?;
        self.node.create_subscription(&created, None).map_err(|error| refused("subscribing to", topic, &error))
    }

    fn topic(&self, topic: &str, package: &str, message: &str, queue: QueueSettings) -> Result<Topic, Failure> {
        let name = Name::parse(topic).map_err(|error| refused("naming", topic, &error))?;
        let qos =
            QosProfile::default().durability(Durability::Volatile).history(History::KeepLast { depth: queue.depth });
        // A subscriber that does not keep up must not hold up the others.
        let qos =
            if queue.is_reliable { qos.reliability_reliable(WhenFull::Fail) } else { qos.reliability_best_effort() };
        let created = self.node.create_topic(&name, MessageTypeName::new(package, message), &qos);
        created.map_err(|error| refused("making", topic, &error))
    }

    /// Begins to keep the list of subscribers.
    ///
    /// # Errors
    /// If the transport or the operating system refuses it.
    pub(crate) fn watch(&mut self) -> Result<(), Failure> {
        let spinner = self.node.spinner().map_err(|error| refused("watching", "the graph", &error))?;
        let body = move || {
            // It ends with the node.
            let _ = futures::executor::block_on(spinner.spin());
        };
        let thread = thread::Builder::new().name("graph".to_owned()).spawn(body);
        thread.map(drop).map_err(|error| Failure::new(Exit::Failed, format!("starting a thread: {error}")))
    }

    /// The type under which others use a topic, if that is not this one: then nothing of theirs comes.
    pub(crate) fn other_type(&self, topic: &str, (package, message): (&str, &str)) -> Option<String> {
        let own = MessageTypeName::new(package, message).dds_msg_type();
        let topics = self.context.discovered_topics().into_iter();
        let others = topics.filter(|found| found.name.strip_prefix("rt") == Some(topic) && found.type_name != own);
        others.map(|found| found.type_name).next()
    }

    /// Whether others have a topic.
    pub(crate) fn has_topic(&self, topic: &str) -> bool {
        self.context.discovered_topics().iter().any(|found| found.name.strip_prefix("rt") == Some(topic))
    }

    /// How many subscribers a topic has.
    pub(crate) fn subscribers(&self, topic: &str) -> usize {
        self.node.subscription_count(topic)
    }
}

fn refused(phase: &str, topic: &str, error: &dyn Display) -> Failure {
    Failure::new(Exit::Io, format!("{phase} {topic}: {error}"))
}
