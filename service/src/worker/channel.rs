//! One IMU within the worker: its ports, its table, its gap detection.

use crate::config::Imu;
use crate::create::{CreateError, Creator};
use crate::leftovers::{ports_of, ports_of_event};
use crate::worker::counters::CounterWriter;
use crate::worker::listeners::WakePorts;
use iceoryx2::port::listener::ListenerCreateError;
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::port::subscriber::SubscriberCreateError;
use isotherm_client::transport::ports::{self, Incoming, Outgoing, Publisher, Subscriber};
use isotherm_client::transport::stream::{self, Event, Ipc, IpcNode, RAW_SUBSCRIBERS};
use isotherm_client::{Clock, Payload as _, Rehearsal, subscribers_of};
use isotherm_shared::compensate::{Compensator, answer_into};
use isotherm_shared::names::Domain;
use isotherm_shared::nominal::comparable;
use isotherm_shared::protocol::{Arrival, LastSession, SequenceTracker, queue_depth};
use isotherm_shared::sequence::{Period, Seen};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, Flags, RawSample};
use isotherm_support::failure::Failure;
use rtrb::Consumer;
use std::sync::Arc;

/// After an answer, this many polls that find no raw sample reclaim the samples that readers have returned.
const RECLAIM_POLLS: u32 = 16;

/// After a table of another nominal interval the answers are NaN, flagged `no-table`, for so long \[ns\]: until sources
/// of readings know the interval, their pulses are those of the table before.
const PULSES_CHANGE_NS: u64 = 1_000_000_000;
/// That time begins with the next sample.
const WITH_THE_NEXT_SAMPLE: u64 = u64::MAX;

/// The channel's ends of the queue and the counters that it shares with the control thread.
pub struct ChannelLink {
    /// The IMU.
    pub imu: Imu,
    /// New tables from the control thread; the newest is used.
    pub tables: Consumer<Arc<CoefficientTable>>,
    /// The channel's counters, which the control thread reads.
    pub counters: CounterWriter,
    /// The session that was served last, as the service before has noted it.
    pub before: Option<LastSession>,
    /// The table that was in force last, as the service before has kept it.
    pub table_before: Option<Arc<CoefficientTable>>,
}

/// One IMU's streams.
pub struct Channel {
    tables: Consumer<Arc<CoefficientTable>>,
    compensator: Option<Compensator>,
    /// The nominal interval of the last table that has one \[ns\], and until when answers are NaN \[ns\]; 0 for none.
    nominal_ns: u64,
    changes_until_ns: u64,
    counters: CounterWriter,
    budget_ns: u64,
    /// Polls of [`RECLAIM_POLLS`] that are left.
    reclaim_polls_left: u32,
    sequence: SequenceTracker,
    /// The last sample, copied out of shared memory.
    raw: RawSample,
    /// What is still to be done for the last sample, whose answer is published.
    unsettled: Option<Settlement>,
    /// Loaned in advance, so that the answer does not wait for the loan.
    spare: Option<Outgoing<CompensatedIncrement>>,
    publisher: Publisher<CompensatedIncrement>,
    subscriber: Subscriber<RawSample>,
    /// Notifies waiting readers that an increment is published.
    arrival: Notifier<Ipc>,
}

/// A sample whose answer is published, but which is not returned and not counted yet.
struct Settlement {
    /// Held until its place in shared memory may be used again.
    sample: Incoming<RawSample>,
    arrival: Arrival,
    flags: Flags,
    latency_ns: u64,
    published: bool,
}

impl Channel {
    /// Creates the streams of an IMU, and the ports of the event that wakes the worker for it. The increment publisher
    /// is created last: clients take it as the sign that the service is ready.
    ///
    /// # Errors
    /// Why a stream or port could not be created, as a message for the operator.
    pub fn open(
        node: &IpcNode,
        domain: &Domain,
        link: ChannelLink,
        budget_ns: u64,
    ) -> Result<(Self, WakePorts), Failure> {
        let (id, depth) = (link.imu.id, link.imu.depth);
        let creator = Creator::new(node, domain);
        let name = |stream: &str| format!("the {stream} of IMU {id}");
        let raw = creator.stream(&name("raw stream"), &stream::raw_name(&id), || Ok(stream::create_raw(node, &id)?))?;
        let increments = creator.stream(&name("increment stream"), &stream::increment_name(&id), || {
            Ok(stream::create_increment(node, &id, false)?)
        })?;
        let wake =
            creator.stream(&name("wake-up event"), &stream::wake_name(&id), || Ok(stream::create_wake(node, &id)?))?;
        let served = || {
            let domain = domain.name();
            format!("IMU {id} is already served in domain {domain:?}; stop the other service or use another --domain")
        };
        let arrival = creator.stream(&name("event of the increments"), &stream::arrival_name(&id), || {
            Ok(stream::create_arrival(node, &id)?)
        })?;
        let announcer = creator.port(&name("event of the increments"), served, || notifier(&arrival))?;
        let listener = creator.port(&name("listener"), served, || {
            ports::listener(&wake).map_err(|error| match error {
                ListenerCreateError::ExceedsMaxSupportedListeners => CreateError::Taken(ports_of_event(&wake)),
                other => CreateError::Other(other.to_string()),
            })
        })?;
        let crowd =
            || format!("notifying the worker of IMU {id}: all places of its wake-up event are taken; stop a sender");
        let notifier = creator.port(&name("notifier"), crowd, || notifier(&wake))?;
        let crowded = || {
            let readers = subscribers_of(domain, &raw);
            format!(
                "reading the raw stream of IMU {id}: all {RAW_SUBSCRIBERS} places are taken, by {readers}; stop one of them"
            )
        };
        let subscriber = creator.port(&name("raw subscriber"), crowded, || {
            RawSample::subscriber(&raw, Some(queue_depth(depth))).map_err(|error| match error {
                SubscriberCreateError::ExceedsMaxSupportedSubscribers => CreateError::Taken(ports_of(&raw)),
                other => CreateError::Other(other.to_string()),
            })
        })?;
        // The last one: clients take it for readiness.
        let publisher = creator.port(&name("increment publisher"), served, || {
            let publisher = CompensatedIncrement::publisher(&increments, 1);
            publisher.map_err(|error| CreateError::of_publisher(error, &increments))
        })?;
        let channel = Self {
            tables: link.tables,
            compensator: None,
            nominal_ns: link.table_before.map_or(0, |table| table.nominal_ns()),
            changes_until_ns: 0,
            counters: link.counters,
            budget_ns,
            reclaim_polls_left: 0,
            sequence: SequenceTracker::after(link.before),
            raw: RawSample::default(),
            unsettled: None,
            spare: CompensatedIncrement::loan(&publisher).ok(),
            publisher,
            subscriber,
            arrival: announcer,
        };
        Ok((channel, WakePorts { listener, notifier }))
    }

    /// Takes the newest table, if there is a new one. The control thread keeps every table until the worker has
    /// released it, so nothing is freed here.
    #[inline]
    pub fn take_table(&mut self) {
        while let Ok(table) = self.tables.pop() {
            self.counters.table_taken(table.id());
            self.note_interval(table.nominal_ns());
            self.compensator = Some(Compensator::new(table));
        }
    }

    /// Begins the time without answers if a table has another nominal interval than the one before.
    fn note_interval(&mut self, nominal_ns: u64) {
        if nominal_ns == 0 {
            return;
        }
        let before = std::mem::replace(&mut self.nominal_ns, nominal_ns);
        let [old, new] = [before, nominal_ns].map(|ns| ns as f64);
        if before != 0 && !comparable(Some(old), Some(new)) {
            self.changes_until_ns = WITH_THE_NEXT_SAMPLE;
        }
    }

    /// Ends the time without answers when it has passed.
    #[cold]
    const fn pass_change(&mut self, now_ns: u64) {
        if self.changes_until_ns == WITH_THE_NEXT_SAMPLE {
            self.changes_until_ns = now_ns + PULSES_CHANGE_NS;
        } else if now_ns >= self.changes_until_ns {
            self.changes_until_ns = 0;
        }
    }

    /// Answers the next raw sample, if there is one, and returns the time just before publishing \[ns\].
    ///
    /// What the answer does not need is left for [`settle`](Self::settle), so that the samples of other IMUs, sent at
    /// the same moment, do not wait for it.
    #[inline]
    pub fn serve(&mut self, clock: &mut Clock) -> Option<u64> {
        let sample = match RawSample::receive(&self.subscriber) {
            Ok(Some(sample)) => sample,
            Ok(None) => {
                self.settle();
                self.take_table();
                self.reclaim();
                return None;
            }
            Err(_) => {
                self.counters.transport_failed();
                return None;
            }
        };
        self.settle();
        // There is a spare loan unless the transport failed to give one.
        let loan = self.spare.take().or_else(|| CompensatedIncrement::loan(&self.publisher).ok());
        let Some(mut loan) = loan else {
            self.counters.transport_failed();
            return None;
        };
        // The only copy out of shared memory. The optimizer must take it for changed by `black_box`, so no code below
        // reads shared memory again: a later change by the sender has no effect.
        self.raw = *sample;
        core::hint::black_box(&mut self.raw);
        let since = if self.raw.sent_ns == 0 { clock.now() } else { self.raw.sent_ns };
        let arrival = self.sequence.note(Seen { period: Period::from(&self.raw), at_ns: since });

        let increment = loan.payload_mut();
        if self.changes_until_ns != 0 {
            self.pass_change(clock.now());
        }
        match self.compensator.as_mut().filter(|_| self.changes_until_ns == 0) {
            Some(compensator) => compensator.answer_into(&self.raw, increment),
            None => answer_into(None, &self.raw, increment),
        }
        let now = clock.now();
        let latency_ns = now.saturating_sub(since);
        let flags = Flags(increment.flags) | arrival.flags(latency_ns, self.budget_ns);
        increment.latency_ns = latency_ns;
        increment.flags = flags.0;
        let published = CompensatedIncrement::publish(loan).is_ok();
        self.unsettled = Some(Settlement { sample, arrival, flags, latency_ns, published });
        Some(now)
    }

    /// Notifies the waiting readers that an increment is published.
    pub fn announce(&self) {
        // A reader that misses it looks by itself, after 20 ms at most.
        ports::notify(&self.arrival);
    }

    /// Whether no raw sample waits.
    #[inline]
    pub fn is_empty(&self) -> bool {
        !RawSample::waits(&self.subscriber)
    }

    /// Does what is left to do for the last sample that was served: returns it, counts it, and loans the next
    /// increment.
    #[inline]
    pub fn settle(&mut self) {
        let Some(Settlement { sample, arrival, flags, latency_ns, published }) = self.unsettled.take() else { return };
        RawSample::give_back(sample);
        self.spare = CompensatedIncrement::loan(&self.publisher).ok();
        self.reclaim_polls_left = RECLAIM_POLLS;
        self.counters.answered(&self.raw, arrival, flags, latency_ns, published);
        // Not before: what is counted is of the table that the sample was answered with.
        self.take_table();
    }

    /// Informs the control thread which sample was the last, when no more are served.
    pub fn end(&mut self) {
        if let Some(last) = self.sequence.last() {
            self.counters.ended(last);
        }
    }

    /// Rehearses the next sample with the last one, and touches what only this IMU's next sample will need. A reader
    /// that has come is connected on this occasion, and not when the next sample is on its way.
    pub fn rehearse(&mut self, rehearsal: &mut Rehearsal<RawSample, CompensatedIncrement>, clock: &mut Clock) {
        rehearsal.go(&self.raw, |raw, increment| {
            // The polynomials too: the next sample may have another temperature.
            answer_into(self.compensator.as_ref().map(Compensator::table), raw, increment);
            if let Some(compensator) = &mut self.compensator {
                compensator.answer_into(raw, increment);
            }
            increment.latency_ns = clock.now();
        });
        if let Some(spare) = &mut self.spare {
            *spare.payload_mut() = CompensatedIncrement::default();
        }
        CompensatedIncrement::connect(&self.publisher);
    }

    /// Reclaims the samples that readers have returned, while there is nothing else to do.
    ///
    /// The transport would do so before it sends, and the answer would then wait for two cache lines that the reader
    /// has just written: a sixth of a round trip.
    #[inline]
    fn reclaim(&mut self) {
        if self.reclaim_polls_left > 0 && self.spare.is_some() {
            self.reclaim_polls_left -= 1;
            CompensatedIncrement::reclaim(&self.publisher);
        }
    }
}

fn notifier(event: &Event) -> Result<Notifier<Ipc>, CreateError> {
    ports::notifier(event).map_err(|error| match error {
        NotifierCreateError::ExceedsMaxSupportedNotifiers => CreateError::Taken(ports_of_event(event)),
        other => CreateError::Other(other.to_string()),
    })
}
