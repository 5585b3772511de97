//! One IMU within the worker: its ports, its table, its gap detection.

use crate::config::Imu;
use crate::create::{Trouble, create};
use crate::failure::{Exit, Failure};
use crate::worker::counters::{Counters, add, bump};
use core::mem::MaybeUninit;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::listener::ListenerCreateError;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::ipc;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use isotherm_client::monotonic_ns;
use isotherm_shared::compensate::answer;
use isotherm_shared::stream::{self, Domain, IpcNode};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, Flags, RawSample};
use rtrb::Consumer;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

type Answer = SampleMutUninit<ipc::Service, MaybeUninit<CompensatedIncrement>, ()>;

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
    /// Session and highest sequence of the last samples.
    last: Option<(u64, u64)>,
    /// Loaned ahead, so that loaning costs the answer no time.
    spare: Option<Answer>,
    publisher: Publisher<ipc::Service, CompensatedIncrement, ()>,
    raw: Subscriber<ipc::Service, RawSample, ()>,
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
    ) -> Result<(Self, Listener<ipc::Service>), Failure> {
        let id = wiring.imu.id;
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
        let raw = create(node, domain, &name("raw stream"), taken, || Ok(stream::raw(node, &id).open_or_create()?))?;
        let increments = create(node, domain, &name("increment stream"), taken, || {
            Ok(stream::increment(node, &id).open_or_create()?)
        })?;
        let wake =
            create(node, domain, &name("wake-up event"), taken, || Ok(stream::wake(node, &id).open_or_create()?))?;
        let listener = create(node, domain, &name("listener"), taken, || {
            wake.listener_builder().create().map_err(|error| match error {
                ListenerCreateError::ExceedsMaxSupportedListeners => Trouble::Taken,
                other => Trouble::Other(other.to_string()),
            })
        })?;
        let subscriber = create(node, domain, &name("raw subscriber"), taken, || {
            raw.subscriber_builder().create().map_err(|error| match error {
                SubscriberCreateError::ExceedsMaxSupportedSubscribers => Trouble::Taken,
                other => Trouble::Other(other.to_string()),
            })
        })?;
        let publisher = create(node, domain, &name("increment publisher"), taken, || {
            Ok(increments.publisher_builder().max_loaned_samples(2).create()?)
        })?;
        let channel = Self {
            tables: wiring.tables,
            table: None,
            counters: wiring.counters,
            budget_ns,
            last: None,
            spare: publisher.loan_uninit().ok(),
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
    pub fn serve(&mut self) -> Option<u64> {
        let sample = match self.raw.receive() {
            Ok(sample) => sample?,
            Err(_) => {
                bump(&self.counters.transport_errors);
                return None;
            }
        };
        // The one copy out of shared memory. The optimizer cannot see through `black_box`, so nothing below reads the
        // sender's memory again, whatever the sender does to it.
        let raw = core::hint::black_box(*sample);
        let since = if raw.sent_ns == 0 { monotonic_ns() } else { raw.sent_ns };
        self.take_table();

        let mut increment = answer(self.table.as_deref(), &raw);
        let missing = self.note(&raw);
        let now = monotonic_ns();
        let latency = now.saturating_sub(since);
        increment.latency_ns = u32::try_from(latency).unwrap_or(u32::MAX);
        increment.flags |= if missing > 0 { Flags::GAP.0 } else { 0 };
        increment.flags |= if latency > self.budget_ns { Flags::LATE.0 } else { 0 };
        let published = match self.spare.take() {
            Some(loan) => loan.write_payload(increment).send().is_ok(),
            None => self.publisher.send_copy(increment).is_ok(),
        };

        // Published; the rest is off the answer's path. Handing the sample back writes to memory that the sender reads, which costs
        // a trip between the cores.
        drop(sample);
        self.spare = self.publisher.loan_uninit().ok();
        let counters = &*self.counters;
        bump(&counters.received);
        bump(if published { &counters.compensated } else { &counters.transport_errors });
        if missing > 0 {
            bump(&counters.gaps);
            add(&counters.missing, missing);
        }
        counters.count_flags(Flags(increment.flags));
        counters.latency.record(increment.latency_ns);
        Some(now)
    }

    /// How many samples of its session are missing before this one.
    #[inline]
    fn note(&mut self, raw: &RawSample) -> u64 {
        let (missing, highest) = match self.last {
            Some((session, highest)) if session == raw.session => {
                if raw.sequence <= highest {
                    bump(&self.counters.repeats);
                }
                (raw.sequence.saturating_sub(highest).saturating_sub(1), highest.max(raw.sequence))
            }
            _ => {
                bump(&self.counters.sessions);
                (0, raw.sequence)
            }
        };
        self.last = Some((raw.session, highest));
        missing
    }
}
