//! Loaned samples, and the errors of sending and receiving.

use crate::transport::ports::Outgoing;
use core::fmt;
use isotherm_shared::wire::{MergeError, RawSample};
#[cfg(feature = "failure")]
use isotherm_support::failure::{Exit, Failure};
use std::rc::Rc;

/// A raw sample, in shared memory if a service is there, which the caller owns until it is sent. Dereferences to
/// [`RawSample`].
///
/// `session` and `sequence` are set already. A loan stands for a control period: if it is dropped, its sequence is left
/// out, and the service flags the gap. [`Acquisition::cancel`](crate::Acquisition::cancel) gives back one that stands
/// for none. If periods were lost before they could be loaned, raise `sequence` by their number.
///
/// One that the service has no room for is kept: [`Acquisition::keep`](crate::Acquisition::keep).
pub struct Loan {
    pub(crate) place: LoanPlace,
    /// Session and number that it was loaned with; `None` if it has the sequence of a record.
    pub(crate) number: Option<(u64, u64)>,
}

/// Where a loaned sample is.
pub(crate) enum LoanPlace {
    /// In the shared memory of the acquisition's ports.
    Shared {
        /// The sample.
        sample: Outgoing<RawSample>,
        /// Of the ports. A sample of earlier ports is copied when it is sent.
        generation: Rc<()>,
    },
    /// In private memory, while the acquisition is cut off from the streams.
    Private(Box<RawSample>),
}

impl core::ops::Deref for Loan {
    type Target = RawSample;
    #[inline]
    fn deref(&self) -> &RawSample {
        match &self.place {
            LoanPlace::Shared { sample, .. } => sample.payload(),
            LoanPlace::Private(sample) => sample,
        }
    }
}

impl core::ops::DerefMut for Loan {
    #[inline]
    fn deref_mut(&mut self) -> &mut RawSample {
        match &mut self.place {
            LoanPlace::Shared { sample, .. } => sample.payload_mut(),
            LoanPlace::Private(sample) => sample,
        }
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
    /// As many samples are unanswered as may be, or others are kept, which go first and for which there is no room
    /// either, or the service's queue may be full. Keep the sample
    /// ([`Acquisition::keep`](crate::Acquisition::keep)), wait and send it again, or drop it, which is a gap.
    #[error("the service's queue is full, or samples that are kept go first; keep this one too")]
    Full(Loan),
    /// The sequence is not above the last one sent or kept in this session. After the highest sequence, 2^64-1, only a
    /// new session can begin. The sample is handed back.
    #[error("the sequence does not rise above the last one sent")]
    Sequence(Loan),
    /// The transport failed. The sample is lost, and the service will flag the gap.
    #[error("transport: sending a raw sample: {0}")]
    Transport(String),
}

/// Why [`Acquisition::exchange`](crate::Acquisition::exchange) has not taken a sample, which is handed back.
#[derive(Debug, thiserror::Error)]
pub enum ExchangeError {
    /// The sequence is not above the last one sent or kept in this session, as [`SendError::Sequence`].
    #[error("the sequence does not rise above the last one sent")]
    Sequence(Loan),
    /// This process is a child of the one that connected. It must connect by itself.
    #[error("the acquisition is of the process that this one was forked from; connect again in the child")]
    Forked(Loan),
}

/// The transport failed.
#[derive(Debug, thiserror::Error)]
#[error("transport: {phase}: {cause}")]
pub struct TransportError {
    phase: &'static str,
    cause: String,
}

#[cfg(feature = "failure")]
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
    /// No answer in time. The sample stays in flight: it is sent again when a new service has started. Its late answer
    /// is kept for [`receive`](crate::Acquisition::receive).
    #[error("no answer from the service in time; `isotherm status` shows whether it runs")]
    Timeout,
    /// The transport failed.
    #[error(transparent)]
    Receive(#[from] TransportError),
}

/// Why two loans were not merged. Neither has changed, and `later` is still on loan.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct LoanMergeError {
    /// What does not fit.
    pub error: MergeError,
    /// The later loan.
    pub later: Loan,
}

/// This many samples of the current session are unanswered, or kept.
#[derive(Clone, Copy, Debug, Eq, PartialEq, thiserror::Error)]
#[error("{0} samples of this session are unanswered or kept; send and receive them first")]
pub struct InFlight(pub usize);

pub(crate) fn transport(phase: &'static str, cause: impl ToString) -> TransportError {
    TransportError { phase, cause: cause.to_string() }
}
