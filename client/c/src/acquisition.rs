//! The functions of the acquisition.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::code::isotherm_code::{ISOTHERM_ERROR_LOANS, ISOTHERM_ERROR_NOT_ON_LOAN};
use crate::code::{CodedError, NONE, NULL, isotherm_code};
use crate::handle::{Handle, close, create, enter};
use crate::values::{imu, options};
use core::ffi::c_char;
use core::ptr::NonNull;
use core::time::Duration;
use isotherm_client::{Acquisition, CompensateError, CompensatedIncrement, Loan, RawSample, SendError};

/// Maximum number of samples on loan from one acquisition.
pub const ISOTHERM_LOANS: usize = 4;

/// The one acquisition process of an IMU. It sends raw samples and receives their increments, each once and in the order of
/// sending.
#[derive(Debug)]
pub struct isotherm_acquisition(Handle<AcquisitionContent>);

/// An acquisition and the samples that C has on loan.
#[derive(Debug)]
struct AcquisitionContent {
    acquisition: Acquisition,
    loans: [Option<(NonNull<RawSample>, Loan)>; ISOTHERM_LOANS],
}

impl AcquisitionContent {
    #[inline]
    fn loan(&mut self) -> Result<NonNull<RawSample>, CodedError> {
        let entry = self.loans.iter_mut().find(|entry| entry.is_none()).ok_or(LOANS)?;
        let mut loan = self.acquisition.loan()?;
        let sample = NonNull::from(&mut *loan);
        *entry = Some((sample, loan));
        Ok(sample)
    }

    /// Takes out the loan that C has by this pointer.
    #[inline]
    fn take(&mut self, sample: *mut RawSample) -> Result<Loan, CodedError> {
        let known = |entry: &&mut Option<(NonNull<RawSample>, Loan)>| {
            entry.as_ref().is_some_and(|(known, _)| known.as_ptr() == sample)
        };
        let entry = if sample.is_null() { return Err(NULL) } else { self.loans.iter_mut().find(known) };
        Ok(entry.and_then(Option::take).ok_or(NOT_ON_LOAN)?.1)
    }

    /// Keeps a sample that could not be sent. There is a free entry, because [`take`](Self::take) has just emptied one.
    #[cold]
    fn give_back(&mut self, mut loan: Loan) {
        if let Some(entry) = self.loans.iter_mut().find(|entry| entry.is_none()) {
            *entry = Some((NonNull::from(&mut *loan), loan));
        }
    }
}

const LOANS: CodedError =
    CodedError::fixed(ISOTHERM_ERROR_LOANS, c"4 samples are on loan already; send or discard one");
const NOT_ON_LOAN: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_NOT_ON_LOAN,
    c"the sample is not on loan from this acquisition; each is gone once it has been sent or discarded",
);

/// A call into an acquisition.
#[inline]
fn with(
    acquisition: *const isotherm_acquisition,
    work: impl FnOnce(&mut AcquisitionContent) -> Result<(), CodedError>,
) -> isotherm_code {
    // SAFETY: NULL or open, as the header requires.
    enter(unsafe { acquisition.as_ref() }.map(|handle| &handle.0), work)
}

/// Connects as the acquisition of an IMU, waiting up to `timeout_ns` for the service if necessary.
///
/// `imu` is the IMU's name. `domain` is the name of the service's domain. If it is NULL, the environment variable
/// ISOTHERM_DOMAIN names the domain, else it is "default". The handle is written to `*acquisition`; NULL is written if the call
/// fails. Close the handle with isotherm_acquisition_close.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NAME, .._NO_SERVICE, .._NO_SUCH_IMU, .._OCCUPIED, .._NO_ROOM, .._PERMISSION, .._EXHAUSTED,
/// .._TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_acquisition_connect(
    imu: *const c_char,
    domain: *const c_char,
    timeout_ns: u64,
    acquisition: *mut *mut isotherm_acquisition,
) -> isotherm_code {
    // SAFETY: the strings and the pointer to the handle are NULL or valid, as the header requires.
    unsafe {
        create(acquisition, isotherm_acquisition, || {
            let acquisition = Acquisition::connect(&self::imu(imu)?, &options(domain, timeout_ns)?)?;
            Ok(AcquisitionContent { acquisition, loans: [const { None }; ISOTHERM_LOANS] })
        })
    }
}

/// Leaves the streams and frees the handle, with all samples that are on loan from it. NULL is allowed.
///
/// ISOTHERM_OK. After ISOTHERM_ERROR_BUSY and ISOTHERM_ERROR_FORKED the handle is still open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_acquisition_close(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    // SAFETY: NULL, or open and not used again, as the header requires.
    unsafe { close(acquisition, |handle| &handle.0) }
}

/// Loans a sample in shared memory, to be filled in; sending does not copy it. `*sample` is yours until it is sent or discarded,
/// or until the handle is closed. At most ISOTHERM_LOANS samples may be on loan at once.
///
/// `session` and `sequence` are set already; all other fields are 0. Set them, except `sent_ns`. If samples were lost before they
/// could be sent, raise `sequence` by their number; the service then flags the gap.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_LOANS, ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_loan(
    acquisition: *mut isotherm_acquisition,
    sample: *mut *mut RawSample,
) -> isotherm_code {
    with(acquisition, |content| {
        let output = NonNull::new(sample).ok_or(NULL)?;
        let sample = content.loan()?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(sample.as_ptr()) };
        Ok(())
    })
}

/// Gives a sample back without sending it. The next loaned sample has the same sequence.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_discard(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
) -> isotherm_code {
    with(acquisition, |content| content.take(sample).map(drop))
}

/// Sends a sample and wakes the service. Never waits, and the transport never copies the sample.
///
/// After ISOTHERM_OK and ISOTHERM_ERROR_TRANSPORT the sample's pointer must not be used any more.
/// After ISOTHERM_FULL and ISOTHERM_ERROR_SEQUENCE the sample is still yours.
///
/// ISOTHERM_OK, ISOTHERM_FULL, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE, ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_send(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
) -> isotherm_code {
    with(acquisition, |content| {
        let loan = content.take(sample)?;
        content.acquisition.send(loan).map_err(|error| {
            let coded = CodedError::from(&error);
            if let SendError::Full(loan) | SendError::Sequence(loan) = error {
                content.give_back(loan);
            }
            coded
        })
    })
}

/// The increment of the oldest unanswered sample, if it has come. Does not wait.
///
/// While samples are unanswered it also checks, about every 5 ms, whether the service has been replaced. If so, it
/// sends the unanswered samples again. So call it repeatedly while you wait.
///
/// ISOTHERM_OK, ISOTHERM_NONE, ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_receive(
    acquisition: *mut isotherm_acquisition,
    increment: *mut CompensatedIncrement,
) -> isotherm_code {
    with(acquisition, |content| {
        let output = NonNull::new(increment).ok_or(NULL)?;
        let increment = content.acquisition.receive()?.ok_or(NONE)?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(increment) };
        Ok(())
    })
}

/// As isotherm_receive, but waits up to `timeout_ns`: it spins for the first 100 us, then sleeps for short times.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_receive_timeout(
    acquisition: *mut isotherm_acquisition,
    timeout_ns: u64,
    increment: *mut CompensatedIncrement,
) -> isotherm_code {
    with(acquisition, |content| {
        let output = NonNull::new(increment).ok_or(NULL)?;
        let increment = content.acquisition.receive_timeout(Duration::from_nanos(timeout_ns))?.ok_or(NONE)?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(increment) };
        Ok(())
    })
}

/// The round trip in one call: sends a sample and waits up to `timeout_ns` for its increment. Answers to samples sent
/// earlier are discarded.
///
/// After ISOTHERM_FULL and ISOTHERM_ERROR_SEQUENCE the sample is still yours. After ISOTHERM_OK, ISOTHERM_TIMEOUT and
/// ISOTHERM_ERROR_TRANSPORT its pointer must not be used any more.
///
/// ISOTHERM_OK, ISOTHERM_FULL, ISOTHERM_TIMEOUT, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE,
/// ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_compensate(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
    timeout_ns: u64,
    increment: *mut CompensatedIncrement,
) -> isotherm_code {
    with(acquisition, |content| {
        let output = NonNull::new(increment).ok_or(NULL)?;
        let loan = content.take(sample)?;
        let answer = content.acquisition.compensate(loan, Duration::from_nanos(timeout_ns));
        let increment = answer.map_err(|error| {
            let coded = CodedError::from(&error);
            if let CompensateError::Send(SendError::Full(loan) | SendError::Sequence(loan)) = error {
                content.give_back(loan);
            }
            coded
        })?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(increment) };
        Ok(())
    })
}

/// Reads a number of an acquisition; 0 if the handle cannot be used.
fn number<T: Default>(acquisition: *const isotherm_acquisition, read: impl FnOnce(&Acquisition) -> T) -> T {
    let mut number = T::default();
    with(acquisition, |content| {
        number = read(&content.acquisition);
        Ok(())
    });
    number
}

/// The most samples that can be unanswered at once: the depth of the service's queue. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_depth(acquisition: *const isotherm_acquisition) -> usize {
    number(acquisition, Acquisition::depth)
}

/// Samples that have been sent and whose increments have not been received. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_in_flight(acquisition: *const isotherm_acquisition) -> usize {
    number(acquisition, Acquisition::in_flight)
}

/// The session of all samples; a new random number for each connection. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_session(acquisition: *const isotherm_acquisition) -> u64 {
    number(acquisition, Acquisition::session)
}

/// Begins a new session: the next sample may have any sequence.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_IN_FLIGHT if samples are unanswered.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_begin_session(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    with(acquisition, |content| Ok(content.acquisition.begin_session()?))
}
