//! One IMU within the worker: its ports, its table, its gap detection.

use crate::config::Imu;
use crate::create::{CreateError, Creator};
use crate::leftovers::{ports_of, ports_of_event};
use crate::worker::counters::CounterWriter;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::listener::ListenerCreateError;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::sample_mut::SampleMut;
use isotherm_client::{Clock, subscribers_of};
use isotherm_failure::Failure;
use isotherm_shared::compensate::answer;
use isotherm_shared::protocol::{SequenceTracker, queue_depth};
use isotherm_shared::stream::{self, Domain, Ipc, IpcNode, RAW_SUBSCRIBERS};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, Flags, RawSample};
use rtrb::Consumer;
use std::sync::Arc;

/// After an answer, this many polls that find no raw sample reclaim the samples that readers have returned.
const RECLAIM_POLLS: u32 = 16;

type LoanedIncrement = SampleMut<Ipc, CompensatedIncrement, ()>;

/// The channel's ends of the queue and the counters that it shares with the control thread.
pub struct ChannelLink {
    /// The IMU.
    pub imu: Imu,
    /// New tables from the control thread; the newest is used.
    pub tables: Consumer<Arc<CoefficientTable>>,
    /// The channel's counters, which the control thread reads.
    pub counters: CounterWriter,
}

/// One IMU's streams.
pub struct Channel {
    tables: Consumer<Arc<CoefficientTable>>,
    table: Option<Arc<CoefficientTable>>,
    counters: CounterWriter,
    budget_ns: u64,
    /// Polls of [`RECLAIM_POLLS`] that are left.
    reclaim_polls_left: u32,
    sequence: SequenceTracker,
    /// Loaned in advance, so that the answer does not wait for the loan.
    spare: Option<LoanedIncrement>,
    publisher: Publisher<Ipc, CompensatedIncrement, ()>,
    raw: Subscriber<Ipc, RawSample, ()>,
}

impl Channel {
    /// Creates the streams of an IMU, and the listener that wakes the worker for it. The increment publisher is created last:
    /// clients take it as the sign that the service is ready.
    ///
    /// # Errors
    /// Why a stream or port could not be created, as a message for the operator.
    pub fn open(
        node: &IpcNode,
        domain: &Domain,
        link: ChannelLink,
        budget_ns: u64,
    ) -> Result<(Self, Listener<Ipc>), Failure> {
        let (id, depth) = (link.imu.id, link.imu.depth);
        let creator = Creator::new(node, domain);
        let name = |stream: &str| format!("the {stream} of IMU {id}");
        let raw = creator.stream(&name("raw stream"), &id.raw(), || Ok(stream::raw(node, &id).open_or_create()?))?;
        let increments = creator.stream(&name("increment stream"), &id.increment(), || {
            Ok(stream::increment(node, &id).open_or_create()?)
        })?;
        let wake =
            creator.stream(&name("wake-up event"), &id.wake(), || Ok(stream::wake(node, &id).open_or_create()?))?;
        let served = || {
            let domain = domain.name();
            format!("IMU {id} is already served in domain {domain:?}; stop the other service or use another --domain")
        };
        let listener = creator.port(&name("listener"), served, || {
            wake.listener_builder().create().map_err(|error| match error {
                ListenerCreateError::ExceedsMaxSupportedListeners => CreateError::Taken(ports_of_event(&wake)),
                other => CreateError::Other(other.to_string()),
            })
        })?;
        let crowded = || {
            let pids = subscribers_of(&raw);
            format!(
                "reading the raw stream of IMU {id}: all {RAW_SUBSCRIBERS} places are taken, by processes {pids:?}; stop one of them"
            )
        };
        let subscriber = creator.port(&name("raw subscriber"), crowded, || {
            raw.subscriber_builder().buffer_size(queue_depth(depth)).create().map_err(|error| match error {
                SubscriberCreateError::ExceedsMaxSupportedSubscribers => CreateError::Taken(ports_of(&raw)),
                other => CreateError::Other(other.to_string()),
            })
        })?;
        let publisher = creator.port(&name("increment publisher"), served, || {
            let publisher = increments.publisher_builder().max_loaned_samples(1).create();
            publisher.map_err(|error| CreateError::of_publisher(error, &increments))
        })?;
        let channel = Self {
            tables: link.tables,
            table: None,
            counters: link.counters,
            budget_ns,
            reclaim_polls_left: 0,
            sequence: SequenceTracker::default(),
            spare: publisher.loan().ok(),
            publisher,
            raw: subscriber,
        };
        Ok((channel, listener))
    }

    /// Takes the newest table, if there is a new one. The control thread keeps every table until the worker has released it, so
    /// nothing is freed here.
    #[inline]
    pub fn take_table(&mut self) {
        while let Ok(table) = self.tables.pop() {
            self.counters.table_taken(table.id());
            self.table = Some(table);
        }
    }

    /// Answers the next raw sample, if there is one, and returns the time just before publishing \[ns\].
    #[inline]
    pub fn serve(&mut self, clock: &mut Clock) -> Option<u64> {
        let sample = match self.raw.receive() {
            Ok(Some(sample)) => sample,
            Ok(None) => {
                self.take_table();
                self.reclaim();
                return None;
            }
            Err(_) => {
                self.counters.transport_failed();
                return None;
            }
        };
        // There is a spare loan unless the transport failed to give one.
        let loan = self.spare.take().or_else(|| self.publisher.loan().ok());
        let Some(mut loan) = loan else {
            self.counters.transport_failed();
            return None;
        };
        // The only copy out of shared memory. The optimizer cannot see through `black_box`, so no code below reads shared memory
        // again: a later change by the sender has no effect.
        let raw = core::hint::black_box(*sample);
        let since = if raw.sent_ns == 0 { clock.now() } else { raw.sent_ns };
        let arrival = self.sequence.note(raw.session, raw.sequence);

        let increment = loan.payload_mut();
        *increment = answer(self.table.as_deref(), &raw);
        let now = clock.now_in_order();
        let latency_ns = now.saturating_sub(since);
        let flags = Flags(increment.flags) | arrival.flags(latency_ns, self.budget_ns);
        increment.latency_ns = latency_ns;
        increment.flags = flags.0;
        let published = loan.send().is_ok();

        // The increment is published: nothing below delays it. Returning the sample writes to memory that the sender reads, which
        // costs a round trip between the cores.
        drop(sample);
        self.spare = self.publisher.loan().ok();
        self.reclaim_polls_left = RECLAIM_POLLS;
        self.take_table();
        self.counters.answered(&raw, arrival, flags, latency_ns, published);
        Some(now)
    }

    /// Reclaims the samples that readers have returned, while there is nothing else to do.
    ///
    /// The transport would do so before it sends, and the answer would then wait for two cache lines that the reader has just
    /// written: a sixth of a round trip. This requests a loan over the limit on purpose: it fails, but the transport first
    /// reclaims returned samples.
    #[inline]
    fn reclaim(&mut self) {
        if self.reclaim_polls_left > 0 && self.spare.is_some() {
            self.reclaim_polls_left -= 1;
            let _ = self.publisher.loan_uninit();
        }
    }
}
