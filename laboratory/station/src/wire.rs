//! A device with its protocol: the bytes of requests go in, replies come out, as the injected faults make them. It
//! reads no clock and has no port.

use super::faults::InjectedFault;
use super::link::DeviceEvent;
use std::time::Duration;

/// Delay of a late reply: more than the plan's time-out, less than time-out plus `quiet_s`.
pub const LATE_REPLY: Duration = Duration::from_millis(1500);
/// How often a device that babbles sends.
pub const BABBLE_INTERVAL: Duration = Duration::from_millis(2);
/// What it sends.
pub const BABBLE: &[u8] = b"27182818284590452353602874713526";
/// Longest input without a complete request \[bytes\].
const MAX_INPUT: usize = 4096;

/// The physics of a device.
pub(crate) trait SimulatedDevice: Send {
    /// Advances to `now_s`; `active` has the faults that are active.
    fn advance(&mut self, now_s: f64, active: &[InjectedFault]);
    /// Takes the events since the last call.
    fn events(&mut self) -> Vec<(f64, DeviceEvent)>;
}

/// A device with its protocol.
pub trait Wire: Send {
    /// Brings the device to this simulated time \[s\]; `active` has the faults that are active.
    fn advance(&mut self, now_s: f64, active: &[InjectedFault]);

    /// The bytes that have arrived and are no complete request yet.
    fn input(&mut self) -> &mut Vec<u8>;

    /// Takes the first complete request out of the input.
    fn take_request(&mut self) -> Option<Vec<u8>>;

    /// Executes a request. Returns the bytes of the reply, none if none is sent.
    fn answer(&mut self, request: &[u8], active: &[InjectedFault]) -> Vec<u8>;

    /// What the device has begun since the last call, with the simulated times \[s\].
    fn events(&mut self) -> Vec<(f64, DeviceEvent)>;
}

/// A device, without a request yet.
pub(crate) fn of<M: SimulatedDevice + 'static>(device: M, protocol: Box<dyn Protocol<M>>) -> Box<dyn Wire> {
    Box::new(DeviceWire { device, protocol, input: Vec::new() })
}

/// The protocol of a device.
pub(crate) trait Protocol<M>: Send {
    /// Takes the first complete request out of the input: a line, without its end `\r`, `\n` or `\r\n`.
    fn take_request(&mut self, input: &mut Vec<u8>) -> Option<Vec<u8>> {
        let blank = input.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
        input.drain(..blank);
        let end = input.iter().position(|byte| matches!(byte, b'\r' | b'\n'))?;
        Some(input.drain(..=end).take(end).collect())
    }
    /// Executes a request and returns the reply; empty if there is no reply.
    fn answer(&mut self, request: &[u8], device: &mut M) -> Vec<u8>;
    /// The reply that refuses a request; empty if the protocol has none.
    fn refuse(&self, request: &[u8]) -> Vec<u8>;
}

struct DeviceWire<M> {
    device: M,
    protocol: Box<dyn Protocol<M>>,
    input: Vec<u8>,
}

impl<M: SimulatedDevice> Wire for DeviceWire<M> {
    fn advance(&mut self, now_s: f64, active: &[InjectedFault]) {
        self.device.advance(now_s, active);
    }

    fn input(&mut self) -> &mut Vec<u8> {
        &mut self.input
    }

    fn take_request(&mut self) -> Option<Vec<u8>> {
        let request = self.protocol.take_request(&mut self.input);
        if request.is_none() && self.input.len() > MAX_INPUT {
            self.input.clear();
        }
        request
    }

    fn answer(&mut self, request: &[u8], active: &[InjectedFault]) -> Vec<u8> {
        let is = |fault| active.contains(&fault);
        let mut reply = match is(InjectedFault::Na) {
            true => self.protocol.refuse(request),
            false => self.protocol.answer(request, &mut self.device),
        };
        if is(InjectedFault::Missing) || is(InjectedFault::Babble) {
            return Vec::new();
        }
        if is(InjectedFault::Garbled) {
            // Line ends are kept, so that it is still one reply.
            let bytes = reply.iter_mut().filter(|byte| !matches!(**byte, b'\r' | b'\n'));
            bytes.step_by(3).for_each(|byte| *byte = 0xff);
        }
        if is(InjectedFault::Duplicated) {
            reply.extend_from_within(..);
        }
        reply
    }

    fn events(&mut self) -> Vec<(f64, DeviceEvent)> {
        self.device.events()
    }
}
