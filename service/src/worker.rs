//! A worker thread: receives, compensates and publishes for its IMUs.
//!
//! # Contract
//! While samples flow the loop takes no lock, allocates nothing, logs nothing and, with `spin` and no reader that
//! waits, makes no system call (tests/tests/all/hot_loop.rs counts them). The other strategies only make the system
//! calls that sleeping and its events need.
//!
//! The worker never blocks on a peer: a reader that does not read loses its own increments. It takes one sample at a
//! time from each raw queue in turn, so that a flooded queue delays the sample of another IMU by the time of one
//! sample.
//!
//! `turns` has the order of turns. What an answer does not need is done when the IMU's queue is seen empty, or before
//! its next sample ([`Channel::settle`]). When no sample waits at all, the worker rehearses ([`rehearse`]).
//!
//! The control thread builds, checks and frees tables. The worker exchanges a pointer between two samples, so all
//! sensors of an increment come from one table.
//!
//! Readers that wait are notified after each round that has answered (`HotLoop::answered`), which takes a system call
//! for each reader that sleeps. While nobody waits, nothing is done for it.
//!
//! A wait is at most [`wait::BOUND_NS`] long, with every strategy and even if every notification is lost.

pub mod channel;
pub mod counters;
pub mod histogram;
mod listeners;
mod order;
pub mod rehearse;
mod turns;
pub mod wait;

use crate::config::{Config, Strategy};
use channel::{Channel, ChannelLink};
use counters::{HeartbeatReader, HeartbeatWriter, heartbeat};
use isotherm_client::transport::stream::RAW_DEPTH;
use isotherm_client::{Clock, Realtime, join};
use isotherm_shared::names::Domain;
use isotherm_shared::protocol::queue_depth;
use isotherm_support::failure::{Exit, Failure};
use listeners::{WakeListeners, WakePorts};
use order::{STOP, WorkerOrder};
use rehearse::Rehearsals;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use turns::{Idle, Queues, Turns};
use wait::{Wait, Waiter};

/// How long a worker may take to end after it was requested to stop.
const STOP_TIMEOUT: Duration = Duration::from_secs(4);

/// A running worker.
pub struct Worker {
    /// Its thread's id in the operating system.
    pub thread_id: i32,
    /// Counts the turns of its loop; a turn starts at least every [`wait::BOUND_NS`].
    pub heartbeat: HeartbeatReader,
    order: Arc<WorkerOrder>,
    thread: JoinHandle<()>,
}

impl Worker {
    /// Starts worker `index` and waits until its streams exist. Returns `None` if `give_up` returns true before that.
    ///
    /// # Errors
    /// Why it did not start.
    pub fn start(
        domain: &Domain,
        config: &Config,
        index: usize,
        links: Vec<ChannelLink>,
        mut give_up: impl FnMut() -> bool,
    ) -> Result<Option<Self>, Failure> {
        let order = Arc::<WorkerOrder>::default();
        let (beat, heartbeat) = heartbeat();
        let (ready, started) = mpsc::sync_channel(1);
        let body = {
            let (order, domain, config) = (Arc::clone(&order), domain.clone(), config.clone());
            move || run(&domain, &config, index, links, (&order, beat), &ready)
        };
        let thread = thread::Builder::new().name(format!("worker-{index}")).spawn(body);
        let thread =
            thread.map_err(|error| Failure::new(Exit::Failed, format!("starting the worker thread: {error}")))?;
        loop {
            match started.recv_timeout(Duration::from_millis(20)) {
                Ok(Ok(thread_id)) => return Ok(Some(Self { thread_id, heartbeat, order, thread })),
                Ok(Err(failure)) => return Err(failure),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Failure::new(Exit::Failed, "the worker thread died while it started"));
                }
                Err(RecvTimeoutError::Timeout) if give_up() => {
                    order.give(STOP);
                    // It ends before the process does, so that what it has created is removed. If it hangs, the next
                    // service removes it.
                    let _ = Self { thread_id: 0, heartbeat, order, thread }.join();
                    return Ok(None);
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Whether the thread has ended. It ends only after [`request_stop`](Self::request_stop) or a panic.
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }

    /// Requests that the worker answers the samples that have arrived, then ends.
    pub fn request_stop(&self) {
        self.order.give(STOP);
    }

    /// Orders for which of its IMUs the worker notifies readers that wait, in the order of its links; before
    /// [`request_stop`](Self::request_stop).
    pub fn announce(&self, awaited: impl Iterator<Item = bool>) {
        let bit = |(index, awaited): (u32, bool)| u64::from(awaited) << index;
        self.order.give((0..).zip(awaited).map(bit).sum());
    }

    /// Waits until the thread has ended, after [`request_stop`](Self::request_stop).
    ///
    /// # Errors
    /// If it panicked, or does not end in time.
    pub fn join(self) -> Result<(), Failure> {
        let begun = Instant::now();
        while !self.thread.is_finished() {
            if begun.elapsed() > STOP_TIMEOUT {
                return Err(Failure::new(
                    Exit::Failed,
                    format!("a worker thread does not end within {} s", STOP_TIMEOUT.as_secs()),
                ));
            }
            thread::sleep(Duration::from_millis(1));
        }
        self.thread.join().map_err(|panic| {
            let cause = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let cause = cause.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            Failure::new(
                Exit::Failed,
                format!("a worker thread panicked ({cause}); restart the service and report this"),
            )
        })
    }
}

fn run(
    domain: &Domain,
    config: &Config,
    index: usize,
    links: Vec<ChannelLink>,
    (order, beat): (&WorkerOrder, HeartbeatWriter),
    ready: &mpsc::SyncSender<Result<i32, Failure>>,
) {
    let (mut channels, ports, rehearsals) = match open(domain, config, index, links, order) {
        Ok(opened) => opened,
        Err(failure) => {
            let _ = ready.send(Err(failure));
            return;
        }
    };
    let _ = ready.send(Ok(rustix::thread::gettid().as_raw_nonzero().get()));
    HotLoop::new(&mut channels, &ports, rehearsals, config.strategy, beat).run(order);
}

fn open(
    domain: &Domain,
    config: &Config,
    index: usize,
    links: Vec<ChannelLink>,
    order: &WorkerOrder,
) -> Result<(Vec<Channel>, Vec<WakePorts>, Rehearsals), Failure> {
    let settings = Realtime {
        core: config.realtime.cores.get(index).copied(),
        priority: config.realtime.priority,
        timer_slack_ns: Some(config.realtime.timer_slack_ns),
        ..Realtime::default()
    };
    settings.apply().map_err(|error| Failure::new(Exit::Config, format!("realtime.{error}")))?;
    let node = join(domain)?;
    let budget_ns = (config.budget_us * 1e3) as u64;
    // Before the channels: when these are open, clients take the service for ready.
    let rehearsals = Rehearsals::open(&node, links.len())?;
    let (mut channels, mut ports) = (Vec::with_capacity(links.len()), Vec::with_capacity(links.len()));
    for link in links.into_iter().take_while(|_| order.present() != STOP) {
        let (mut channel, wake) = Channel::open(&node, domain, link, budget_ns)?;
        channel.take_table();
        channels.push(channel);
        ports.push(wake);
    }
    Ok((channels, ports, rehearsals))
}

/// The hot loop with what lasts from one turn to the next.
struct HotLoop<'a> {
    channels: &'a mut [Channel],
    rehearsals: Rehearsals,
    strategy: Strategy,
    beat: HeartbeatWriter,
    clock: Clock,
    waiter: Waiter,
    wake: WakeListeners<'a>,
    /// Which channels have answered since their readers were notified.
    news: Vec<bool>,
}

impl<'a> HotLoop<'a> {
    fn new(
        channels: &'a mut [Channel],
        ports: &'a [WakePorts],
        rehearsals: Rehearsals,
        strategy: Strategy,
        beat: HeartbeatWriter,
    ) -> Self {
        let (imus, clock, wake) = (channels.len(), Clock::new(), WakeListeners::new(ports));
        let (waiter, news) = (Waiter::new(strategy, imus), vec![false; imus]);
        Self { channels, rehearsals, strategy, beat, clock, waiter, wake, news }
    }

    /// Serves until the order is to stop. Whether readers are notified is compiled into the loop: where nobody waits it
    /// costs no instruction.
    fn run(&mut self, order: &WorkerOrder) {
        loop {
            match order.present() {
                STOP => break,
                0 => self.serve::<false>(order, 0),
                awaited => {
                    // Nobody was notified of what came before this order.
                    self.channels.iter().for_each(Channel::announce);
                    self.serve::<true>(order, awaited);
                }
            }
        }
        // Answer what has arrived, at most one queue for each IMU: a sender that keeps sending must not delay the end.
        for channel in self.channels.iter_mut() {
            (0..queue_depth(RAW_DEPTH)).take_while(|_| channel.serve(&mut self.clock).is_some()).count();
            channel.settle();
            channel.announce();
            channel.end();
        }
    }

    /// Serves as long as the order is `current`. With `ANNOUNCE` it notifies the readers of the IMUs whose bits are
    /// set.
    fn serve<const ANNOUNCE: bool>(&mut self, order: &WorkerOrder, current: u64) {
        let (mut turns, mut idle) = (Turns::default(), Idle::default());
        loop {
            self.beat.beat();
            let served = turns.round(&mut HotQueues::<ANNOUNCE> { hot: self, current });
            if order.present() != current {
                return;
            }
            idle = if served { self.answered::<ANNOUNCE>() } else { self.rest(idle) };
        }
    }

    /// After a round that has answered samples.
    #[inline]
    fn answered<const ANNOUNCE: bool>(&mut self) -> Idle {
        if ANNOUNCE {
            let news = self.channels.iter().zip(&mut self.news);
            news.filter_map(|(channel, news)| core::mem::take(news).then_some(channel)).for_each(Channel::announce);
        }
        Idle::Settle
    }

    /// After a round that has found no sample.
    #[inline]
    fn rest(&mut self, idle: Idle) -> Idle {
        match idle {
            Idle::Settle => self.channels.iter_mut().for_each(Channel::settle),
            Idle::Expect => {
                let now = self.clock.now();
                self.waiter.expected(now).for_each(|imu| self.rehearsals.expect(imu));
            }
            Idle::Wait => return self.wait(),
        }
        Idle::Wait
    }

    /// Rehearses when it is time to, otherwise waits.
    #[inline]
    fn wait(&mut self) -> Idle {
        let now = match self.strategy {
            Strategy::Spin => 0,
            Strategy::Anticipate | Strategy::Block => self.clock.now(),
        };
        // A worker that blocks does not know when to: it would sleep after a rehearsal.
        if self.strategy != Strategy::Block
            && let Some(imu) = self.rehearsals.due()
        {
            self.rehearse(imu, now);
            return Idle::Wait;
        }
        match self.waiter.next(now) {
            Wait::Spin => core::hint::spin_loop(),
            // A sample that came while the event was raised is found by the next poll.
            Wait::Sleep(_) if self.wake.lower() => {}
            Wait::Sleep(time) => {
                self.wake.sleep(now, time);
                self.waiter.woke(self.clock.now());
                if self.strategy == Strategy::Anticipate {
                    return Idle::Expect;
                }
            }
        }
        Idle::Wait
    }

    fn rehearse(&mut self, imu: usize, now: u64) {
        let anticipates = self.strategy == Strategy::Anticipate;
        if anticipates {
            self.wake.raise(imu);
        }
        self.rehearsals.rehearse(self.channels, imu, &mut self.clock);
        if anticipates {
            self.waiter.rehearsed(self.clock.now().saturating_sub(now));
        }
    }
}

/// The channels of a hot loop while it serves under an order. With `ANNOUNCE` the order names the readers that are
/// notified.
struct HotQueues<'l, 'a, const ANNOUNCE: bool> {
    hot: &'l mut HotLoop<'a>,
    current: u64,
}

impl<const ANNOUNCE: bool> Queues for HotQueues<'_, '_, ANNOUNCE> {
    #[inline]
    fn count(&self) -> usize {
        self.hot.channels.len()
    }

    #[inline]
    fn serve(&mut self, channel: usize) -> bool {
        let HotLoop { channels, clock, waiter, rehearsals, news, .. } = self.hot;
        let Some(now) = channels[channel].serve(clock) else { return false };
        waiter.arrived(channel, now);
        rehearsals.served(channel);
        if ANNOUNCE {
            news[channel] = self.current >> channel & 1 == 1;
        }
        true
    }

    #[inline]
    fn is_empty(&self, channel: usize) -> bool {
        self.hot.channels[channel].is_empty()
    }

    #[inline]
    fn settle(&mut self, channel: usize) {
        self.hot.channels[channel].settle();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worker(body: impl FnOnce(&WorkerOrder) + Send + 'static) -> Worker {
        let order = Arc::<WorkerOrder>::default();
        let thread = {
            let order = Arc::clone(&order);
            thread::spawn(move || body(&order))
        };
        Worker { thread_id: 0, heartbeat: heartbeat().1, order, thread }
    }

    #[test]
    fn a_panic_becomes_the_failure_that_ends_the_process() {
        let failed = worker(|_| panic!("index out of bounds")).join().unwrap_err();
        assert_eq!(failed.exit, Exit::Failed);
        assert!(failed.message.contains("a worker thread panicked (index out of bounds)"), "{failed}");
    }

    #[test]
    fn join_gives_up_on_a_thread_that_does_not_end() {
        let (release, released) = mpsc::channel::<()>();
        let stuck = worker(move |_| _ = released.recv());
        stuck.request_stop();
        assert!(stuck.join().unwrap_err().message.contains("does not end within"));
        drop(release);
        let obedient = worker(|order| {
            while order.present() != STOP {
                thread::yield_now();
            }
        });
        obedient.request_stop();
        obedient.join().unwrap();
    }
}
