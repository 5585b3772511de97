//! A fault of an instrument or its line.

use std::fmt;

/// The kind of an [`InstrumentFault`].
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum FaultKind {
    /// The port is lost or refused.
    Line,
    /// No reply in time.
    NoReply,
    /// The reply is damaged, or does not belong to this request.
    Garbled,
    /// The line does not keep still: bytes arrive without a request, again and again.
    Babble,
    /// A signal asks to end: the request was not sent, or its reply not waited for.
    Stopped,
    /// The instrument refuses the request: `NA:`, a Modbus exception, an error reply.
    Refused,
    /// The instrument has an alarm or an internal fault and does not carry out the request.
    Alarm,
    /// The value that is read back differs from the value that was set.
    Mismatch,
}

/// A fault of an instrument or its line.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub struct InstrumentFault {
    /// Decides how a campaign reacts.
    pub kind: FaultKind,
    /// The instrument and its port.
    pub instrument: String,
    /// The request and its result.
    pub message: String,
}

/// Instrument, request and cause, remedy.
impl fmt::Display for InstrumentFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let remedy = match self.kind {
            FaultKind::Line => "check cable, power and the port's name, and that no other program has it",
            FaultKind::NoReply => "check power, address, line settings and timeout_s",
            FaultKind::Garbled => "check line settings, cable and shield, and the driver's keys",
            FaultKind::Babble => {
                "check that nothing else sends on this line, then the instrument (restart it), line settings and cable"
            }
            FaultKind::Stopped => "the instrument may be well",
            FaultKind::Refused => "check that the controller is in remote mode and allows this value",
            FaultKind::Alarm => "clear the cause at the instrument",
            FaultKind::Mismatch => "check the controller's limits and units and the driver's keys",
        };
        write!(f, "{}: {}; {remedy}", self.instrument, self.message)
    }
}
