//! One IMU within the worker: its ports, its table, its gap detection.

use crate::config::Imu;
use crate::create::{Trouble, create};
use crate::failure::{Exit, Failure};
use crate::leftovers::{ports_of, ports_of_event};
use crate::worker::counters::{Counters, add, bump};
use crate::worker::order::Order;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::listener::ListenerCreateError;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::sample_mut::SampleMut;
use isotherm_client::{Clock, subscribers_of};
use isotherm_shared::compensate::answer;
use isotherm_shared::stream::{self, Domain, Ipc, IpcNode, RAW_SUBSCRIBERS};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, Flags, RawSample};
use rtrb::Consumer;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

/// Looks in vain for a raw sample, after an answer, at which readers' returns are collected.
const COLLECT: u32 = 16;

type Answer = SampleMut<Ipc, CompensatedIncrement, ()>;

/// What the control thread shares with one channel.
pub struct Wiring {
    /// The IMU.
    pub imu: Imu,
    /// New tables come in here; the newest counts.
    pub tables: Consumer<Arc<CoefficientTable>>,
    /// What happens is counted here.
    pub counters: Arc<Counters>,
}

/// One IMU's streams.
pub struct Channel {
    tables: Consumer<Arc<CoefficientTable>>,
    table: Option<Arc<CoefficientTable>>,
    counters: Arc<Counters>,
    budget_ns: u64,
    /// Looks at which readers' returns are still to be collected.
    uncollected: u32,
    order: Order,
    /// Loaned ahead, so that loaning costs the answer no time.
    spare: Option<Answer>,
    publisher: Publisher<Ipc, CompensatedIncrement, ()>,
    raw: Subscriber<Ipc, RawSample, ()>,
}

impl Channel {
    /// Creates the streams of an IMU, and the listener that wakes the worker for it. The increment publisher comes last:
    /// clients take it for readiness.
    ///
    /// # Errors
    /// What stands in the way, for the operator.
    pub fn open(
        node: &IpcNode,
        domain: &Domain,
        wiring: Wiring,
        budget_ns: u64,
    ) -> Result<(Self, Listener<Ipc>), Failure> {
        let (id, depth) = (wiring.imu.id, wiring.imu.depth);
        let taken = || {
            Failure::new(
                Exit::Failed,
                format!(
                    "IMU {id} is already served in domain {:?}; stop the other service or use another --domain",
                    domain.name()
                ),
            )
        };
        let name = |stream: &str| format!("the {stream} of IMU {id}");
        let raw = create(node, domain, &name("raw stream"), Some(&id.raw()), taken, || {
            Ok(stream::raw(node, &id).open_or_create()?)
        })?;
        let increments = create(node, domain, &name("increment stream"), Some(&id.increment()), taken, || {
            Ok(stream::increment(node, &id).open_or_create()?)
        })?;
        let wake = create(node, domain, &name("wake-up event"), Some(&id.wake()), taken, || {
            Ok(stream::wake(node, &id).open_or_create()?)
        })?;
        let listener = create(node, domain, &name("listener"), None, taken, || {
            wake.listener_builder().create().map_err(|error| match error {
                ListenerCreateError::ExceedsMaxSupportedListeners => Trouble::Taken(ports_of_event(&wake)),
                other => Trouble::Other(other.to_string()),
            })
        })?;
        let crowded = || {
            Failure::new(
                Exit::Failed,
                format!(
                    "reading the raw stream of IMU {id}: all {RAW_SUBSCRIBERS} places are taken, by processes {:?}; stop one of them",
                    subscribers_of(&raw)
                ),
            )
        };
        let subscriber = create(node, domain, &name("raw subscriber"), None, crowded, || {
            raw.subscriber_builder().buffer_size(depth).create().map_err(|error| match error {
                SubscriberCreateError::ExceedsMaxSupportedSubscribers => Trouble::Taken(ports_of(&raw)),
                other => Trouble::Other(other.to_string()),
            })
        })?;
        let publisher = create(node, domain, &name("increment publisher"), None, taken, || {
            let publisher = increments.publisher_builder().max_loaned_samples(1).create();
            publisher.map_err(|error| Trouble::of_publisher(error, &increments))
        })?;
        let channel = Self {
            tables: wiring.tables,
            table: None,
            counters: wiring.counters,
            budget_ns,
            uncollected: 0,
            order: Order::default(),
            spare: publisher.loan().ok(),
            publisher,
            raw: subscriber,
        };
        Ok((channel, listener))
    }

    /// Takes over the newest table, if there is a new one. The control thread keeps every table until this side has let
    /// go of it, so nothing is freed here.
    #[inline]
    pub fn take_table(&mut self) {
        while let Ok(table) = self.tables.pop() {
            self.counters.table.store(table.id(), Relaxed);
            self.table = Some(table);
        }
    }

    /// Answers the next raw sample, if there is one, and gives the time just before publishing.
    #[inline]
    pub fn serve(&mut self, clock: &mut Clock) -> Option<u64> {
        let sample = match self.raw.receive() {
            Ok(Some(sample)) => sample,
            Ok(None) => {
                self.take_table();
                self.collect();
                return None;
            }
            Err(_) => {
                bump(&self.counters.transport_errors);
                return None;
            }
        };
        // Loaned ahead, so that loaning costs the answer no time; one is missing only after the transport has failed.
        let loan = self.spare.take().or_else(|| self.publisher.loan().ok());
        let Some(mut loan) = loan else {
            bump(&self.counters.transport_errors);
            return None;
        };
        // The one copy out of shared memory. The optimizer cannot see through `black_box`, so nothing below reads the
        // sender's memory again, whatever the sender does to it.
        let raw = core::hint::black_box(*sample);
        let since = if raw.sent_ns == 0 { clock.now() } else { raw.sent_ns };
        let arrival = self.order.note(raw.session, raw.sequence);
        let missing = arrival.missing;

        let increment = loan.payload_mut();
        *increment = answer(self.table.as_deref(), &raw);
        let now = clock.now_in_order();
        let latency = now.saturating_sub(since);
        let latency_ns = u32::try_from(latency).unwrap_or(u32::MAX);
        let delivery = (u32::from(missing > 0) * Flags::GAP.0) | (u32::from(latency > self.budget_ns) * Flags::LATE.0);
        let flags = Flags(increment.flags | delivery);
        increment.latency_ns = latency_ns;
        increment.flags = flags.0;
        let published = loan.send().is_ok();

        // Published; the rest is off the answer's path. Handing the sample back writes to memory that the sender reads, which costs
        // a trip between the cores.
        drop(sample);
        self.spare = self.publisher.loan().ok();
        self.uncollected = COLLECT;
        self.take_table();
        let counters = &*self.counters;
        bump(&counters.received);
        bump(if published { &counters.compensated } else { &counters.transport_errors });
        if missing > 0 {
            bump(&counters.gaps);
            add(&counters.missing, missing);
        }
        if arrival.repeated {
            bump(&counters.repeats);
        }
        if arrival.begins {
            bump(&counters.sessions);
        }
        counters.count_flags(flags);
        counters.keep_telemetry(&raw);
        counters.latency.record(latency_ns);
        Some(now)
    }

    /// Takes back what readers have returned, while there is nothing else to do.
    ///
    /// The transport does so before it sends, and there the answer would wait for two cache lines that the reader has
    /// just written: a sixth of a round trip. Asking for a loan more than there may be does nothing else.
    #[inline]
    fn collect(&mut self) {
        if self.uncollected > 0 && self.spare.is_some() {
            self.uncollected -= 1;
            let _ = self.publisher.loan_uninit();
        }
    }
}
