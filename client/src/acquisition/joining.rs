//! How an acquisition finds out that it is cut off from its streams, and joins them anew. Whatever of that may wait is
//! done by its [helper thread](crate::helper): looking for removed objects, leaving, joining, reading the status.
use super::Acquisition;
use super::ports::AcquisitionPorts;
use crate::connect::Options;
use crate::error::ConnectError;
use crate::helper::{Helper, MovedPorts};
use crate::loss::{Loss, OwnObjects};
use crate::peers::{is_alive, publisher_of};
use crate::status::fetch_status;
use crate::warning::warn;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::status::ServiceStatus;
use std::rc::Rc;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// After this silence the acquisition looks whether it was cut off from the service, and then again after the same time
/// \[ns\].
const LOOK_NS: u64 = 250_000_000;
/// After this silence of a service that lives the acquisition joins the streams anew; then after twice as long, and so
/// on \[ns\].
pub(super) const REJOIN_NS: u64 = 2_000_000_000;
/// The longest silence before it does so \[ns\].
const MAX_REJOIN_NS: u64 = 64_000_000_000;
/// Pause between two attempts to join the streams anew.
const JOIN_PAUSE: Duration = Duration::from_millis(20);

/// What the helper thread is asked for.
#[derive(Debug)]
pub(super) enum Question {
    /// What has cut the ports off. `silence` is there if it has been long, with the node of the service: one that lives
    /// should have answered.
    Loss { objects: Arc<OwnObjects>, silence: Option<(Duration, u128)> },
    /// To give these ports up, and to join the streams anew as soon as a service is there.
    Ports(Option<MovedPorts<AcquisitionPorts>>),
    /// The status of the service.
    Status,
}

/// What it answers.
#[derive(Debug)]
pub(super) enum Answer {
    /// Whether the ports are cut off.
    Loss(bool),
    /// `None` if the acquisition is closing.
    Ports(Option<MovedPorts<AcquisitionPorts>>),
    /// `None` if it cannot be read.
    Status(Option<Box<ServiceStatus>>),
}

/// Starts the helper thread of an acquisition.
pub(super) fn start_helper(imu: &ImuId, domain: &Domain) -> Result<Helper<Question, Answer>, ConnectError> {
    let (imu, domain) = (imu.clone(), domain.clone());
    let helper = Helper::start(move |question, is_closing: &dyn Fn() -> bool| match question {
        Question::Loss { objects, silence } => Answer::Loss(is_cut_off(&imu, &domain, &objects, silence)),
        Question::Ports(old) => {
            drop(old);
            Answer::Ports(join(&imu, &domain, is_closing).map(MovedPorts::new))
        }
        Question::Status => {
            let status = fetch_status(&Options::new(domain.clone(), Duration::ZERO));
            Answer::Status(status.ok().map(Box::new))
        }
    });
    helper.map_err(|error| ConnectError::Exhausted(format!("starting the helper thread of an acquisition: {error}")))
}

fn is_cut_off(imu: &ImuId, domain: &Domain, objects: &OwnObjects, silence: Option<(Duration, u128)>) -> bool {
    let silent = || silence.filter(|(_, node)| is_alive(domain, *node)).map(|(silence, _)| Loss::Silence(silence));
    let loss = objects.loss(domain).or_else(silent);
    if let Some(loss) = &loss {
        warn(imu, format_args!("cut off from the service: {loss}; joining the streams again"));
    }
    loss.is_some()
}

fn join(imu: &ImuId, domain: &Domain, is_closing: &dyn Fn() -> bool) -> Option<AcquisitionPorts> {
    let (mut node, mut last_cause) = (None, String::new());
    while !is_closing() {
        match AcquisitionPorts::attach(&mut node, domain, imu, Instant::now()) {
            Ok(ports) => {
                // Here, so that the first sample has nothing to connect.
                ports.connect();
                warn(imu, "the streams are joined again");
                return Some(ports);
            }
            Err(error) => {
                let cause = error.to_string();
                if cause != last_cause {
                    warn(imu, format_args!("joining the streams again: {cause}"));
                }
                last_cause = cause;
            }
        }
        thread::sleep(JOIN_PAUSE);
    }
    None
}

impl Acquisition {
    /// Takes what the helper thread has answered. `now` is `CLOCK_MONOTONIC` \[ns\].
    pub(super) fn take_answer(&mut self, now: u64) {
        match self.helper.answer() {
            // Answers may have come meanwhile.
            Some(Answer::Loss(true)) if self.state.silence_ns(now) >= LOOK_NS => {
                self.rejoin_after_ns = (2 * self.rejoin_after_ns).min(MAX_REJOIN_NS);
                self.leaves_by_ns = Some(now + LOOK_NS);
            }
            Some(Answer::Ports(Some(ports))) => {
                self.ports = Some(ports.take());
                self.state.rejoined(now);
            }
            Some(Answer::Status(Some(status))) => self.lag.learn(&status, &self.imu),
            Some(Answer::Loss(_) | Answer::Ports(None) | Answer::Status(None)) | None => {}
        }
        self.leave(now);
    }

    /// Has the helper thread look, after a silence, whether the ports are cut off.
    pub(super) fn look_for_loss(&mut self, now: u64) {
        let silence_ns = self.state.silence_ns(now);
        if silence_ns < LOOK_NS {
            self.rejoin_after_ns = REJOIN_NS;
            return;
        }
        let Some(ports) = &self.ports else { return };
        if now >= self.next_look_ns && self.helper.is_free() {
            self.next_look_ns = now + LOOK_NS;
            let service = publisher_of(&ports.increments).filter(|_| silence_ns >= self.rejoin_after_ns);
            let silence = service.map(|(_, node)| (Duration::from_nanos(silence_ns), node.value()));
            self.helper.ask(Question::Loss { objects: Arc::clone(&ports.objects), silence });
        }
    }

    /// Gives the ports up if they are cut off, and has the streams joined as long as there are none. Samples that are
    /// unanswered stay, and are sent again then.
    ///
    /// What is on loan shares counts with the ports. So they wait until nothing is, which a loop of `exchange` reaches
    /// in each call. A program that always has a loan leaves them in its own thread.
    pub(super) fn leave(&mut self, now: u64) {
        if !self.helper.is_free() {
            return;
        }
        if let Some(by_ns) = self.leaves_by_ns {
            let moves = self.ports.as_ref().is_none_or(|ports| Rc::strong_count(&ports.generation) == 1);
            if !moves && now < by_ns {
                return;
            }
            self.leaves_by_ns = None;
            let old = self.ports.take().filter(|_| moves).map(MovedPorts::new);
            self.helper.ask(Question::Ports(old));
        } else if self.ports.is_none() {
            self.helper.ask(Question::Ports(None));
        }
    }

    /// Has the helper thread read the status, if the lag needs it.
    pub(super) fn renew_lag(&mut self) {
        if !self.helper.is_free() {
            let now = self.clock.now();
            self.take_answer(now);
        }
        if self.helper.is_free() && self.lag.asks() {
            self.helper.ask(Question::Status);
        }
    }
}
