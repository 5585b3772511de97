//! The acquisition.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::code::isotherm_code::{ISOTHERM_ERROR_LOANS, ISOTHERM_ERROR_NOT_ON_LOAN};
use crate::code::{Failure, NONE, NULL, isotherm_code};
use crate::handle::{Handle, close, create, enter};
use crate::values::{imu, options};
use core::ffi::c_char;
use core::ptr::NonNull;
use core::time::Duration;
use isotherm_client::{Acquisition, CompensateError, CompensatedIncrement, Loan, RawSample, SendError};

/// Samples that may be on loan from an acquisition at once.
pub const ISOTHERM_LOANS: usize = 4;

/// The one acquisition process of an IMU: sends raw samples, receives their increments, each once and in the order of
/// sending.
#[derive(Debug)]
pub struct isotherm_acquisition(Handle<Session>);

/// An acquisition and the samples that are in C's hands.
#[derive(Debug)]
struct Session {
    acquisition: Acquisition,
    loans: [Option<(NonNull<RawSample>, Loan)>; ISOTHERM_LOANS],
}

impl Session {
    #[inline]
    fn loan(&mut self) -> Result<NonNull<RawSample>, Failure> {
        let place = self.loans.iter_mut().find(|place| place.is_none()).ok_or(LOANS)?;
        let mut loan = self.acquisition.loan()?;
        let sample = NonNull::from(&mut *loan);
        *place = Some((sample, loan));
        Ok(sample)
    }

    /// The loan that C knows by this pointer.
    #[inline]
    fn take(&mut self, sample: *mut RawSample) -> Result<Loan, Failure> {
        let known = |place: &&mut Option<(NonNull<RawSample>, Loan)>| {
            place.as_ref().is_some_and(|(known, _)| known.as_ptr() == sample)
        };
        let place = if sample.is_null() { return Err(NULL) } else { self.loans.iter_mut().find(known) };
        Ok(place.and_then(Option::take).ok_or(NOT_ON_LOAN)?.1)
    }

    /// Where a sample goes back to that could not be sent; there is room, since it has just been taken out.
    #[cold]
    fn give_back(&mut self, mut loan: Loan) {
        if let Some(place) = self.loans.iter_mut().find(|place| place.is_none()) {
            *place = Some((NonNull::from(&mut *loan), loan));
        }
    }
}

const LOANS: Failure = Failure::fixed(ISOTHERM_ERROR_LOANS, c"4 samples are on loan already; send or discard one");
const NOT_ON_LOAN: Failure = Failure::fixed(
    ISOTHERM_ERROR_NOT_ON_LOAN,
    c"the sample is not on loan from this acquisition; each is gone once it has been sent or discarded",
);

/// A call into an acquisition.
#[inline]
fn with(
    acquisition: *const isotherm_acquisition,
    work: impl FnOnce(&mut Session) -> Result<(), Failure>,
) -> isotherm_code {
    // SAFETY: NULL or open, as the header asks for.
    enter(unsafe { acquisition.as_ref() }.map(|handle| &handle.0), work)
}

/// Connects as the acquisition of an IMU, waiting up to `timeout_ns` for the service if need be.
///
/// `imu` is the IMU's name. `domain` is the name of the service's domain; NULL takes the one that the environment variable
/// ISOTHERM_DOMAIN names, or "default". The handle is written to `*acquisition`, NULL if there is none. Close it with
/// isotherm_acquisition_close.
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
    // SAFETY: strings and the place of the handle are NULL or valid, as the header asks for.
    unsafe {
        create(acquisition, isotherm_acquisition, || {
            let acquisition = Acquisition::connect(&self::imu(imu)?, &options(domain, timeout_ns)?)?;
            Ok(Session { acquisition, loans: [const { None }; ISOTHERM_LOANS] })
        })
    }
}

/// Leaves the streams and frees the handle, with all samples that are on loan from it. NULL is allowed.
///
/// ISOTHERM_OK; with ISOTHERM_ERROR_BUSY and ISOTHERM_ERROR_FORKED it is still open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_acquisition_close(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    // SAFETY: NULL, or open and not used again, as the header asks for.
    unsafe { close(acquisition, |handle| &handle.0) }
}

/// Loans a sample to fill in where it lies, in shared memory: nothing is copied from here on. `*sample` is yours until it is sent
/// or discarded, and ends with the handle. Up to ISOTHERM_LOANS at once.
///
/// All fields are 0 but `session` and `sequence`, which are filled in. Set the others but `sent_ns`. `sequence` may be
/// raised, to tell of samples that were lost before they could be sent; the service then flags the gap.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_LOANS, ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_loan(
    acquisition: *mut isotherm_acquisition,
    sample: *mut *mut RawSample,
) -> isotherm_code {
    with(acquisition, |session| {
        let place = NonNull::new(sample).ok_or(NULL)?;
        let sample = session.loan()?;
        // SAFETY: not NULL, so it can be written, as the header asks for.
        unsafe { place.write(sample.as_ptr()) };
        Ok(())
    })
}

/// Gives a sample back unsent. The next one loaned has its sequence.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_discard(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
) -> isotherm_code {
    with(acquisition, |session| session.take(sample).map(drop))
}

/// Sends a sample and wakes the service. Never waits, and never copies the sample through the transport.
///
/// After ISOTHERM_OK and ISOTHERM_ERROR_TRANSPORT the sample is gone: its pointer must not be used any more.
/// After ISOTHERM_FULL and ISOTHERM_ERROR_SEQUENCE it is still yours.
///
/// ISOTHERM_OK, ISOTHERM_FULL, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE, ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_send(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
) -> isotherm_code {
    with(acquisition, |session| {
        let loan = session.take(sample)?;
        session.acquisition.send(loan).map_err(|error| {
            let failure = Failure::from(&error);
            if let SendError::Full(loan) | SendError::Sequence(loan) = error {
                session.give_back(loan);
            }
            failure
        })
    })
}

/// The increment of the oldest unanswered sample, if it has come. Does not wait.
///
/// While something is unanswered this also looks, about every 5 ms, whether the service has been replaced, and sends the
/// unanswered samples again if so: whoever waits calls it again and again.
///
/// ISOTHERM_OK, ISOTHERM_NONE, ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_receive(
    acquisition: *mut isotherm_acquisition,
    increment: *mut CompensatedIncrement,
) -> isotherm_code {
    with(acquisition, |session| {
        let place = NonNull::new(increment).ok_or(NULL)?;
        let increment = session.acquisition.receive()?.ok_or(NONE)?;
        // SAFETY: not NULL, so it can be written, as the header asks for.
        unsafe { place.write(increment) };
        Ok(())
    })
}

/// As isotherm_receive, waiting up to `timeout_ns`: spinning for the first 100 us, then in short sleeps.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_receive_timeout(
    acquisition: *mut isotherm_acquisition,
    timeout_ns: u64,
    increment: *mut CompensatedIncrement,
) -> isotherm_code {
    with(acquisition, |session| {
        let place = NonNull::new(increment).ok_or(NULL)?;
        let increment = session.acquisition.receive_timeout(Duration::from_nanos(timeout_ns))?.ok_or(NONE)?;
        // SAFETY: not NULL, so it can be written, as the header asks for.
        unsafe { place.write(increment) };
        Ok(())
    })
}

/// The round trip in one call: sends a sample and waits up to `timeout_ns` for its increment. Answers to samples sent
/// earlier, whose callers have given up on them, are passed over.
///
/// After ISOTHERM_FULL and ISOTHERM_ERROR_SEQUENCE the sample is still yours, after ISOTHERM_OK, ISOTHERM_TIMEOUT and
/// ISOTHERM_ERROR_TRANSPORT it is gone.
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
    with(acquisition, |session| {
        let place = NonNull::new(increment).ok_or(NULL)?;
        let loan = session.take(sample)?;
        let answer = session.acquisition.compensate(loan, Duration::from_nanos(timeout_ns));
        let increment = answer.map_err(|error| {
            let failure = Failure::from(&error);
            if let CompensateError::Send(SendError::Full(loan) | SendError::Sequence(loan)) = error {
                session.give_back(loan);
            }
            failure
        })?;
        // SAFETY: not NULL, so it can be written, as the header asks for.
        unsafe { place.write(increment) };
        Ok(())
    })
}

/// A number that an acquisition has; 0 if the handle cannot be used.
fn number<T: Default>(acquisition: *const isotherm_acquisition, read: impl FnOnce(&Acquisition) -> T) -> T {
    let mut number = T::default();
    with(acquisition, |session| {
        number = read(&session.acquisition);
        Ok(())
    });
    number
}

/// The most samples that can be unanswered at once: the depth of the service's queue. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_depth(acquisition: *const isotherm_acquisition) -> usize {
    number(acquisition, Acquisition::depth)
}

/// Samples sent whose increments have not been received. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_in_flight(acquisition: *const isotherm_acquisition) -> usize {
    number(acquisition, Acquisition::in_flight)
}

/// The session that all samples carry, random for each connection. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_session(acquisition: *const isotherm_acquisition) -> u64 {
    number(acquisition, Acquisition::session)
}

/// Begins a new session: the next sample may have any sequence.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_IN_FLIGHT while samples are unanswered.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_begin_session(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    with(acquisition, |session| Ok(session.acquisition.begin_session()?))
}
