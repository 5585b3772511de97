//! Loaned samples, and the errors of sending and receiving.

use core::fmt;
use iceoryx2::sample_mut::SampleMut;
use isotherm_failure::{Exit, Failure};
use isotherm_shared::stream::Ipc;
use isotherm_shared::wire::RawSample;

/// A raw sample in shared memory, which the caller owns until it is sent. Dereferences to [`RawSample`].
///
/// `session` and `sequence` are set already. If samples were lost before they could be sent, raise `sequence` by their
/// number; the service then flags the gap.
pub struct Loan(pub(crate) SampleMut<Ipc, RawSample, ()>);

impl core::ops::Deref for Loan {
    type Target = RawSample;
    fn deref(&self) -> &RawSample {
        self.0.payload()
    }
}

impl core::ops::DerefMut for Loan {
    fn deref_mut(&mut self) -> &mut RawSample {
        self.0.payload_mut()
    }
}

impl fmt::Debug for Loan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Loan").field(&**self).finish()
    }
}

/// Why a sample was not sent. Contains the sample if the caller can still use it.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// As many samples are unanswered as may be, or the service's queue may be full: [`Acquisition::is_full`](crate::Acquisition::is_full). Wait and send the sample again, drop it, or add the next
    /// sample to it with [`RawSample::merge`].
    #[error("the service's queue is full of unanswered samples")]
    Full(Loan),
    /// The sequence is not above the last one sent in this session. After the highest sequence, 2^64-1, only a new session can
    /// begin.
    #[error("the sequence does not rise above the last one sent")]
    Sequence(Loan),
    /// The transport failed. The sample is lost, and the service will flag the gap.
    #[error("transport: sending a raw sample: {0}")]
    Transport(String),
}

/// The transport failed.
#[derive(Debug, thiserror::Error)]
#[error("transport: {phase}: {cause}")]
pub struct TransportError {
    phase: &'static str,
    cause: String,
}

impl From<TransportError> for Failure {
    fn from(error: TransportError) -> Self {
        Self::new(Exit::Failed, error.to_string())
    }
}

/// Why a round trip gave no increment.
#[derive(Debug, thiserror::Error)]
pub enum CompensateError {
    /// The sample could not be sent.
    #[error(transparent)]
    Send(#[from] SendError),
    /// No answer in time. The sample stays in flight: it is sent again when a new service has started, and a later
    /// [`receive`](crate::Acquisition::receive) may still return its answer.
    #[error("no answer from the service in time; `isotherm status` shows whether it runs")]
    Timeout,
    /// The transport failed.
    #[error(transparent)]
    Receive(#[from] TransportError),
}

/// This many samples of the current session are unanswered.
#[derive(Clone, Copy, Debug, Eq, PartialEq, thiserror::Error)]
#[error("{0} samples of this session are unanswered; receive their answers first")]
pub struct InFlight(pub usize);

pub(crate) fn transport(phase: &'static str, cause: impl ToString) -> TransportError {
    TransportError { phase, cause: cause.to_string() }
}
