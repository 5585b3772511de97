//! The worker thread: receive, compensate, publish.
//!
//! # Contract
//! While samples flow the loop takes no lock, logs nothing and makes no system call of its own (with `spin` none at all);
//! the transport allocates once an answer, when the next one is loaned, after publishing. It never blocks on a peer:
//! a reader that does not read loses its own increments, and a raw queue is emptied one sample an IMU in turn, so that a
//! flood on one does not keep the others waiting. Tables are built, checked and freed by the control thread; here a
//! pointer is exchanged between two samples, so all three axes of an increment come from one table.
//!
//! Waiting is bounded by [`wait::BOUND_NS`], under every strategy and even if every notification is lost.

pub mod channel;
pub mod counters;
pub mod wait;

use crate::config::{Config, Strategy};
use crate::failure::{Exit, Failure};
use crate::realtime::{self, Bells};
use channel::{Channel, Wiring};
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::ipc;
use isotherm_client::{join, monotonic_ns};
use isotherm_shared::stream::{Domain, RAW_DEPTH};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use wait::{Wait, Waiter};

/// A running worker.
pub struct Worker {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Worker {
    /// Starts the worker and waits until its streams are there; `None` if `give_up` says so first.
    ///
    /// # Errors
    /// What kept it from starting.
    pub fn start(
        domain: &Domain,
        config: &Config,
        wirings: Vec<Wiring>,
        mut give_up: impl FnMut() -> bool,
    ) -> Result<Option<Self>, Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        let (ready, started) = mpsc::sync_channel(1);
        let body = {
            let (stop, domain, config) = (Arc::clone(&stop), domain.clone(), config.clone());
            move || run(&domain, &config, wirings, &stop, &ready)
        };
        let thread = thread::Builder::new().name("worker".to_owned()).spawn(body);
        let thread =
            thread.map_err(|error| Failure::new(Exit::Failed, format!("starting the worker thread: {error}")))?;
        loop {
            match started.recv_timeout(Duration::from_millis(20)) {
                Ok(Ok(())) => return Ok(Some(Self { stop, thread })),
                Ok(Err(failure)) => return Err(failure),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Failure::new(Exit::Failed, "the worker thread died while it started"));
                }
                Err(RecvTimeoutError::Timeout) if give_up() => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Whether it has ended, which it does only after [`stop`](Self::stop) or a panic.
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }

    /// Lets it answer what has arrived and end.
    ///
    /// # Errors
    /// If it had panicked.
    pub fn stop(self) -> Result<(), Failure> {
        self.stop.store(true, Relaxed);
        self.thread.join().map_err(|panic| {
            let cause = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let cause = cause.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            Failure::new(
                Exit::Failed,
                format!("the worker thread panicked ({cause}); restart the service and report this"),
            )
        })
    }
}

fn run(
    domain: &Domain,
    config: &Config,
    wirings: Vec<Wiring>,
    stop: &AtomicBool,
    ready: &mpsc::SyncSender<Result<(), Failure>>,
) {
    let (mut channels, listeners) = match open(domain, config, wirings) {
        Ok(opened) => opened,
        Err(failure) => {
            let _ = ready.send(Err(failure));
            return;
        }
    };
    let _ = ready.send(Ok(()));
    serve(&mut channels, &listeners, config, stop);
}

fn open(
    domain: &Domain,
    config: &Config,
    wirings: Vec<Wiring>,
) -> Result<(Vec<Channel>, Vec<Listener<ipc::Service>>), Failure> {
    realtime::apply(&config.realtime).map_err(|message| Failure::new(Exit::Config, message))?;
    let node = join(domain)?;
    let budget_ns = (config.budget_us * 1e3) as u64;
    let (mut channels, mut listeners) = (Vec::with_capacity(wirings.len()), Vec::with_capacity(wirings.len()));
    for wiring in wirings {
        let (mut channel, listener) = Channel::open(&node, domain, wiring, budget_ns)?;
        channel.take_table();
        channels.push(channel);
        listeners.push(listener);
    }
    Ok((channels, listeners))
}

/// The hot loop.
fn serve(channels: &mut [Channel], listeners: &[Listener<ipc::Service>], config: &Config, stop: &AtomicBool) {
    let mut waiter = Waiter::new(config.strategy, channels.len());
    let mut bells = Bells::new(listeners);
    loop {
        let mut served = false;
        for (index, channel) in channels.iter_mut().enumerate() {
            if let Some(now) = channel.serve() {
                waiter.arrived(index, now);
                served = true;
            }
        }
        if stop.load(Relaxed) {
            // What has arrived by now is answered; a sender that goes on regardless cannot keep us.
            for channel in channels.iter_mut() {
                (0..RAW_DEPTH).take_while(|_| channel.serve().is_some()).count();
            }
            return;
        }
        if served {
            continue;
        }
        for channel in channels.iter_mut() {
            channel.take_table();
        }
        let now = match config.strategy {
            Strategy::Spin => 0,
            _ => monotonic_ns(),
        };
        match waiter.next(now) {
            Wait::Spin => core::hint::spin_loop(),
            Wait::Sleep(time) => {
                let timed_out = bells.sleep(time);
                if timed_out && time < wait::BOUND_NS {
                    waiter.overslept(now + time, monotonic_ns());
                }
                // After every sleep: a notification that was lost would suppress all later ones.
                for listener in listeners {
                    let _ = listener.try_wait(|_| {});
                }
            }
        }
    }
}
