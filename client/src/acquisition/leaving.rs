//! How an acquisition finds out that it is cut off from its streams, and joins them anew, without waiting.

use super::joining::{Answer, Question};
use super::{Acquisition, REJOIN_NS};
use crate::helper::MovedPorts;
use crate::peers::publisher_of;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// After this silence the acquisition looks whether it was cut off from the service, and then again after the same time
/// \[ns\].
const LOOK_NS: u64 = 250_000_000;
/// The longest silence before it does so \[ns\].
const MAX_REJOIN_NS: u64 = 64_000_000_000;
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
            Some(Answer::Status(Some(status))) => self.learn_in_flight(&status),
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
        // While it leaves, another look would put that off.
        let Some(ports) = self.ports.as_ref().filter(|_| self.leaves_by_ns.is_none()) else { return };
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

    /// Has the helper thread read the status, if another table is in force than the one that is known.
    pub(super) fn renew(&mut self) {
        if !self.helper.is_free() {
            let now = self.clock.now();
            self.take_answer(now);
        }
        if self.helper.is_free() && self.watch.asks() {
            self.helper.ask(Question::Status);
        }
    }
}
