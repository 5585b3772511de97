//! When a worker that waits rehearses, so that the next sample finds its way warm. The rehearsal itself is
//! [`isotherm_client::Rehearsal`], with the kernel and the table of the IMU ([`Channel::rehearse`]).
//!
//! A worker rehearses when `IDLE_POLLS` polls in a row have found nothing, and, if it expects a sample, at once when a
//! sleep ends. It polls all IMUs between two rehearsals, so a sample that comes meanwhile waits for one rehearsal at
//! most.

use super::channel::Channel;
use isotherm_client::transport::stream::IpcNode;
use isotherm_client::{Clock, Rehearsal};
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use isotherm_support::failure::Failure;

/// So many polls in a row that find nothing lie between two rehearsals of a worker that spins: some tens of
/// microseconds.
const IDLE_POLLS: usize = 1024;

/// The rehearsals of a worker.
pub struct Rehearsals {
    ports: Rehearsal<RawSample, CompensatedIncrement>,
    idle_polls: usize,
    /// The IMU that is next.
    next: usize,
    /// IMUs whose samples are expected, and for which the worker has not rehearsed since it woke.
    expected: Vec<bool>,
}

impl Rehearsals {
    /// Those of a worker with this node and so many IMUs.
    ///
    /// # Errors
    /// Why a stream or port could not be created, as a message for the operator.
    pub fn open(node: &IpcNode, imus: usize) -> Result<Self, Failure> {
        Ok(Self { ports: Rehearsal::open(node)?, idle_polls: 0, next: 0, expected: vec![false; imus] })
    }

    /// The sample of this IMU is expected: it is the next to rehearse for.
    pub fn expect(&mut self, imu: usize) {
        self.expected[imu] = true;
    }

    /// The sample of this IMU was served: its way is warm.
    #[inline]
    pub fn served(&mut self, imu: usize) {
        self.idle_polls = 0;
        self.expected[imu] = false;
    }

    /// A poll of all IMUs has found nothing: the IMU to rehearse for, if it is time to.
    #[inline]
    pub fn due(&mut self) -> Option<usize> {
        self.idle_polls += self.expected.len();
        let expected = self.expected.iter().position(|expected| *expected);
        expected.or_else(|| (self.idle_polls >= IDLE_POLLS).then_some(self.next))
    }

    /// Rehearses for an IMU.
    #[inline(never)]
    pub fn rehearse(&mut self, channels: &mut [Channel], imu: usize, clock: &mut Clock) {
        self.idle_polls = 0;
        self.expected[imu] = false;
        self.next = (imu + 1) % channels.len();
        channels[imu].rehearse(&mut self.ports, clock);
    }
}
