//! The functions of the acquisition.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::code::isotherm_code::{
    ISOTHERM_ERROR_LOANS, ISOTHERM_ERROR_MERGE, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_VALUE, ISOTHERM_LOST,
};
use crate::code::{CodedError, NONE, NULL, code, isotherm_code};
use crate::handle::{Handle, close, create, enter};
use crate::values::{domain, imu, lag_option, text, timeout};
use core::ffi::c_char;
use core::mem::{MaybeUninit, offset_of};
use core::ptr::{self, NonNull};
use core::time::Duration;
use isotherm_client::{
    Acquisition, ClosingNote, CompensateError, CompensatedIncrement, ExchangeError, KEPT_RANGE, Loan, Options,
    RawSample, Resolution, SendError,
};

/// Maximum number of samples on loan from one acquisition.
pub const ISOTHERM_LOANS: usize = 4;

/// Control periods that wait at most for a service that is away, unless `kept` in isotherm_options says otherwise: 30 s
/// at 546 Hz. They take 4.1 MiB.
pub const ISOTHERM_MOST_KEPT: u64 = 16384;
const _: () = assert!(ISOTHERM_MOST_KEPT == isotherm_client::MOST_KEPT as u64);

/// The one acquisition process of an IMU. It sends raw samples and receives their increments, each once and in the
/// order of sending.
#[derive(Debug)]
pub struct isotherm_acquisition(Handle<AcquisitionContent>);

/// An acquisition and the samples that C has on loan.
#[derive(Debug)]
pub(crate) struct AcquisitionContent {
    pub(crate) acquisition: Acquisition,
    loans: [Option<(NonNull<RawSample>, Loan)>; ISOTHERM_LOANS],
}

impl AcquisitionContent {
    #[inline]
    fn loan(&mut self) -> Result<NonNull<RawSample>, CodedError> {
        let entry = self.loans.iter_mut().find(|entry| entry.is_none()).ok_or(LOANS)?;
        Ok(put(entry, self.acquisition.loan()?))
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

    /// Adds a sample to another. If the later one is on loan, its loan is cancelled.
    ///
    /// # Safety
    /// The pointers are NULL or valid.
    unsafe fn merge(&mut self, sample: *mut RawSample, later: *const RawSample) -> Result<(), CodedError> {
        // SAFETY: the caller's contract.
        unsafe { merge(sample, later) }?;
        if let Ok(loan) = self.take(later.cast_mut()) {
            self.acquisition.cancel(loan);
        }
        Ok(())
    }

    /// What closing says: OK if nothing is lost.
    fn closing(&self) -> Result<(), CodedError> {
        let ClosingNote { lost, unanswered } = self.acquisition.closing();
        if lost == 0 && unanswered == 0 {
            return Ok(());
        }
        let text =
            format!("closed with {lost} control periods that were not sent, and {unanswered} unanswered samples");
        Err(CodedError::new(ISOTHERM_LOST, &text))
    }

    /// The error of a sample that was not sent. One that is still the caller's stays on loan.
    #[cold]
    fn unsent(&mut self, error: SendError) -> CodedError {
        let coded = CodedError::from(&error);
        if let SendError::Full(loan) | SendError::Sequence(loan) = error {
            self.give_back(loan);
        }
        coded
    }

    /// Keeps a sample that could not be sent on loan. There is a free entry, because [`take`](Self::take) has just
    /// emptied one.
    fn give_back(&mut self, loan: Loan) {
        if let Some(entry) = self.loans.iter_mut().find(|entry| entry.is_none()) {
            put(entry, loan);
        }
    }
}

/// Puts a loan into its place, and returns the pointer to its sample that C gets. It is taken of the loan in that
/// place: a sample may be in a `Box`, and a pointer into it is not valid any more when the `Box` moves.
#[inline]
fn put(entry: &mut Option<(NonNull<RawSample>, Loan)>, loan: Loan) -> NonNull<RawSample> {
    let (sample, loan) = entry.insert((NonNull::dangling(), loan));
    *sample = NonNull::from(&mut **loan);
    *sample
}

/// Adds a sample to another.
///
/// # Safety
/// The pointers are NULL or valid.
unsafe fn merge(sample: *mut RawSample, later: *const RawSample) -> Result<(), CodedError> {
    if sample.is_null() || later.is_null() {
        return Err(NULL);
    }
    if ptr::eq(sample, later) {
        return Err(SAME);
    }
    // SAFETY: not NULL, so they are readable, as the header requires.
    let (mut sum, later) = unsafe { (sample.read(), later.read()) };
    sum.merge(&later)?;
    // SAFETY: not NULL, so it is writable, as the header requires.
    unsafe { sample.write(sum) };
    Ok(())
}

const LOANS: CodedError =
    CodedError::fixed(ISOTHERM_ERROR_LOANS, c"4 samples are on loan already; send or discard one");
const SERIAL: CodedError =
    CodedError::fixed(ISOTHERM_ERROR_VALUE, c"the serial number is not UTF-8; give it as UTF-8 text");
const SIZE: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_VALUE,
    c"the size in isotherm_options is not that of this library; set it to sizeof(isotherm_options) or 0, with the header of this library",
);
const KEPT: CodedError =
    CodedError::fixed(ISOTHERM_ERROR_VALUE, c"`kept` in isotherm_options is above 1048576; give 1 to 1048576, or 0");
const SAME: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_MERGE,
    c"a sample cannot be added to itself; give the next control period's as the later one",
);
const NOT_ON_LOAN: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_NOT_ON_LOAN,
    c"the sample is not on loan from this acquisition; each is gone once it has been sent or discarded",
);

/// A call into an acquisition.
#[inline]
pub(crate) fn with(
    acquisition: *const isotherm_acquisition,
    work: impl FnOnce(&mut AcquisitionContent) -> Result<(), CodedError>,
) -> isotherm_code {
    // SAFETY: NULL or open, as the header requires.
    enter(unsafe { acquisition.as_ref() }.map(|handle| &handle.0), work)
}

/// How an acquisition reaches the service, and what it reports to it. A field that is 0 or NULL has its default, so
/// begin with `isotherm_options options = {0};`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct isotherm_options {
    /// sizeof(isotherm_options), or 0. A later version may add fields at the end: it reads only those that the size
    /// has, and with 0 those of this version.
    pub size: u64,
    /// Name of the service's domain. If it is NULL, the environment variable ISOTHERM_DOMAIN names the domain,
    /// otherwise it is "default".
    pub domain: *const c_char,
    /// How long connecting may take [ns]. This includes waiting for a service that has not started yet. 0 is the
    /// default, 5 s; ISOTHERM_NO_WAIT does not wait.
    pub timeout_ns: u64,
    /// Serial number of the device, in UTF-8; NULL if it is not known. The service flags samples of another device than
    /// the table's. Outer blanks do not count.
    pub serial: *const c_char,
    /// Time constant of the lagged temperature [s], 0.1 to 86400, or ISOTHERM_LAG_SERVICE or ISOTHERM_LAG_NONE.
    pub lag_s: f64,
    /// How many control periods wait at most for a service that has no room or is away, 1 to 2^20; 0 is the default,
    /// ISOTHERM_MOST_KEPT. Each takes 256 bytes, which are allocated when the acquisition connects.
    pub kept: u64,
    /// What one pulse of an accelerometer over the nominal interval of the table stands for [m/s2], 1e-15 to 1e6, such
    /// as 1e-6, if the samples are readings: then isotherm_fill makes their pulses. 0: they have pulses of their own.
    pub accelerometer_resolution: f64,
    /// The same of a gyroscope [rad/s], such as 1e-7, also if there is none.
    pub gyroscope_resolution: f64,
}

/// Connects as the acquisition of an IMU, waiting for the service if necessary.
///
/// `imu` is the IMU's name. If `options` is NULL, all have their defaults. The handle is written to
/// `*acquisition`; NULL is written if the call fails. Close the handle with isotherm_acquisition_close.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NAME, .._NO_SERVICE, .._NO_SUCH_IMU, .._OCCUPIED, .._NO_ROOM, .._PERMISSION,
/// .._EXHAUSTED, .._TRANSPORT, .._VALUE for a serial number that is not UTF-8, a `lag_s` that is no time constant, a
/// resolution whose pulses are not those of the table, or another `size`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_acquisition_connect(
    imu: *const c_char,
    options: *const isotherm_options,
    acquisition: *mut *mut isotherm_acquisition,
) -> isotherm_code {
    // SAFETY: the strings and pointers are NULL or valid, as the header requires.
    unsafe {
        create(acquisition, isotherm_acquisition, || {
            let acquisition = Acquisition::connect(&self::imu(imu)?, &self::options(options)?)?;
            Ok(AcquisitionContent { acquisition, loans: [const { None }; ISOTHERM_LOANS] })
        })
    }
}

/// The options of C.
///
/// # Safety
/// `options` is NULL, or has the fields that its size says, and its strings are NULL or valid.
unsafe fn options(options: *const isotherm_options) -> Result<Options, CodedError> {
    const ALL: usize = size_of::<isotherm_options>();
    /// Without the fields that came later.
    const FIRST: usize = offset_of!(isotherm_options, kept);
    if options.is_null() {
        return Ok(Options::from_environment()?);
    }
    // SAFETY: not NULL, and the size is always there.
    let size = match unsafe { (*options).size } as usize {
        0 => ALL,
        size if (FIRST..=ALL).contains(&size) && size.is_multiple_of(8) => size,
        _ => return Err(SIZE),
    };
    let mut given = MaybeUninit::<isotherm_options>::zeroed();
    // SAFETY: a program with this size has so many bytes, and all fields of 0 are valid, NULL included.
    let given = unsafe {
        ptr::copy_nonoverlapping(options.cast::<u8>(), given.as_mut_ptr().cast::<u8>(), size);
        given.assume_init()
    };
    let isotherm_options { timeout_ns, lag_s, kept: periods, .. } = given;
    let (accelerometer, gyroscope) = (given.accelerometer_resolution, given.gyroscope_resolution);
    let resolution = (accelerometer != 0.0 || gyroscope != 0.0).then_some(Resolution { accelerometer, gyroscope });
    let (name, serial) = (given.domain, given.serial);
    // SAFETY: the caller's contract.
    let (domain, serial) = unsafe { (domain(name)?, text(serial)) };
    let serial = serial.map(|serial| String::from_utf8(serial).map_err(|_| SERIAL)).transpose()?;
    let options = Options::new(domain, timeout(timeout_ns));
    let kept = if periods == 0 { options.kept } else { kept(periods)? };
    Ok(Options { serial, lag: lag_option(lag_s)?, kept, resolution, ..options })
}

/// How many periods wait at most.
fn kept(given: u64) -> Result<usize, CodedError> {
    usize::try_from(given).ok().filter(|kept| KEPT_RANGE.contains(kept)).ok_or(KEPT)
}

/// Leaves the streams and frees the handle, with all samples that are on loan from it, which count as lost. NULL is
/// allowed.
///
/// ISOTHERM_OK; ISOTHERM_LOST if control periods were not sent (isotherm_lost) or samples are unanswered
/// (isotherm_in_flight): the handle is closed all the same. After ISOTHERM_ERROR_BUSY and ISOTHERM_ERROR_FORKED the
/// handle is still open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_acquisition_close(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    // SAFETY: NULL, or open and not used again, as the header requires.
    unsafe { close(acquisition, |handle| &handle.0, AcquisitionContent::closing) }
}

/// Loans a sample in shared memory, to be filled in; sending does not copy it. `*sample` is yours until it is sent or
/// discarded, or until the handle is closed. At most ISOTHERM_LOANS samples may be on loan at once.
///
/// `session` and `sequence` are set already, every head and board temperature is NaN, all other fields are 0. Set them,
/// except `sent_ns`, `device` and what isotherm_reading is for: `lag_ns` and `head_lagged`. A temperature that is not
/// set gives NaN for its sensor, flagged ISOTHERM_FLAG_A1_NOT_FINITE and so on. `sequence` is one above the highest
/// that was loaned or sent in the session: a sample that is discarded leaves its sequence out, and the service flags
/// the gap. If periods were lost before they could be loaned, raise `sequence` by their number.
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

/// Gives a sample back without sending it: its control period is lost. Its sequence is left out, so that the service
/// flags the gap.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_discard(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
) -> isotherm_code {
    with(acquisition, |content| content.take(sample).map(drop))
}

/// Gives a sample back that stands for no control period, as at the end of a recording, and takes its sequence back.
/// Only that of the last loan: the sequence of an earlier one stays left out.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_cancel(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
) -> isotherm_code {
    with(acquisition, |content| {
        let loan = content.take(sample)?;
        content.acquisition.cancel(loan);
        Ok(())
    })
}

/// Adds the next control period to a sample: pulses and intervals are summed, timestamp, temperature and device become
/// the later ones, session, sequence and `sent_ns` stay. An `interval_ns` of 0, which is not known, stays 0, and the
/// sum is flagged ISOTHERM_FLAG_INTERVAL. If `later` is on loan from this acquisition, its loan is cancelled, as by
/// isotherm_cancel: its pointer must not be used any more. Otherwise, it does not change. Either may be a sample of
/// your own; `acquisition` may be NULL if both are.
///
/// The increments are linear in pulses and interval, so no velocity and no angle is lost if the temperature is the same
/// in both periods. If the sum is dropped, that is one sequence, whatever it holds. This is for devices that sum by
/// themselves: periods for which the service has no room wait as they are (isotherm_exchange, isotherm_keep).
///
/// ISOTHERM_OK; ISOTHERM_ERROR_MERGE, after which neither has changed, and a loan is still yours.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_merge(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
    later: *const RawSample,
) -> isotherm_code {
    // SAFETY: the pointers are NULL or valid, as the header requires.
    unsafe {
        match acquisition.is_null() {
            true => code(merge(sample, later)),
            false => with(acquisition, |content| content.merge(sample, later)),
        }
    }
}

/// Serves a control period: sends all that waits, oldest first, then `sample`, waits up to `timeout_ns` for its
/// increment, and writes **all** increments that have arrived to `increments`, each once and in the order of sending.
/// `*count` is how many. At most `capacity` are written; the others come with the next call.
///
/// What the service has no room for waits in the memory of this process (isotherm_kept), and a later call sends it: 256
/// samples at once, then 16 in a millisecond, which readers and recorders can take. So a loop of only this call loses
/// no control period while the service stalls, is away for as many periods as may be kept, or is replaced. Then fewer
/// increments come, or none, which is no error, and later more than one.
///
/// Give a time-out that is shorter than the control period; 0 does not wait. `increments` may be NULL if `capacity` is
/// 0.
///
/// After ISOTHERM_OK the sample's pointer must not be used any more. After ISOTHERM_ERROR_SEQUENCE and
/// ISOTHERM_ERROR_FORKED the sample is still yours.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_exchange(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
    timeout_ns: u64,
    increments: *mut CompensatedIncrement,
    capacity: usize,
    count: *mut usize,
) -> isotherm_code {
    with(acquisition, |content| {
        let output = NonNull::new(count).ok_or(NULL)?;
        if increments.is_null() && capacity > 0 {
            return Err(NULL);
        }
        let loan = content.take(sample)?;
        let mut written = 0;
        let exchanged =
            content.acquisition.exchange_each(loan, Duration::from_nanos(timeout_ns), capacity, |increment| {
                // SAFETY: at most `capacity` increments come, for which there is room, as the header requires.
                unsafe { increments.add(written).write(increment) };
                written += 1;
            });
        exchanged.map_err(|error| {
            let coded = CodedError::from(&error);
            let (ExchangeError::Sequence(loan) | ExchangeError::Forked(loan)) = error;
            content.give_back(loan);
            coded
        })?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(written) };
        Ok(())
    })
}

/// Sends a sample and wakes the service, after all that is kept. Never waits, and the transport never copies the
/// sample. `device` is set, and `lag_ns` with the lagged temperature, where they are 0.
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
        content.acquisition.send(loan).map_err(|error| content.unsent(error))
    })
}

/// Keeps a control period that isotherm_send or isotherm_compensate has handed back (ISOTHERM_FULL), or any other: it
/// waits in memory of this process, as it is, and is sent before all that comes later. The loan is free again. Nothing
/// is allocated. isotherm_exchange does this by itself.
///
/// At most `kept` of isotherm_options periods wait. Beyond that the oldest is dropped and counts as lost
/// (isotherm_lost): a gap for every reader. `sent_ns` and the lagged temperature are those of the time of this call.
///
/// After ISOTHERM_OK the sample's pointer must not be used any more. After ISOTHERM_ERROR_SEQUENCE, for a sequence that
/// is not above the last one sent or kept, the sample is still yours.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_keep(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
) -> isotherm_code {
    with(acquisition, |content| {
        let loan = content.take(sample)?;
        content.acquisition.keep(loan).map_err(|error| content.unsent(error))
    })
}

/// Sends what is kept, oldest first, as far as the service takes it now: until isotherm_depth samples are unanswered,
/// and after an outage no faster than readers and recorders take it (256 samples at once, then 16 in a millisecond).
/// Never waits. Every sending call begins with it. Without anything kept it does nothing.
///
/// ISOTHERM_OK, also if some or all go on to wait: isotherm_kept shows it. ISOTHERM_ERROR_TRANSPORT: the period that
/// was being sent counts as unanswered, and will be sent again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_send_kept(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    with(acquisition, |content| Ok(content.acquisition.send_kept()?))
}

/// Control periods that wait: they are kept, and not sent yet. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_kept(acquisition: *const isotherm_acquisition) -> u64 {
    number(acquisition, Acquisition::kept)
}

/// Goes through the motions of sending a sample and receiving its increment, so that the next sample finds its way
/// warm. Nobody else sees anything of it. Call it while you wait for the end of a control period, some tens of
/// microseconds before it; it takes about a microsecond, in cold caches some ten.
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_prepare(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    with(acquisition, |content| {
        content.acquisition.prepare();
        Ok(())
    })
}

/// The increment of the oldest unanswered sample, if it has come. Does not wait. First come the late increments that
/// isotherm_compensate has kept aside.
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

/// As isotherm_receive, but waits up to `timeout_ns`: it spins for the first 100 us, then sleeps for short times, and
/// sends what is kept.
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

/// The round trip of one sample, for programs that send one now and then: sends it and waits up to `timeout_ns` for its
/// increment, which comes before those of earlier samples whose time-out has passed. These are kept aside for
/// isotherm_receive: at most isotherm_depth, then the oldest is dropped. They count neither as in flight nor for a full
/// queue. A time-out of 0 does not wait. Where order matters, as for angles, use isotherm_exchange.
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
        let increment = answer.map_err(|error| match error {
            CompensateError::Send(error) => content.unsent(error),
            other => CodedError::from(&other),
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

/// The most samples that can be unanswered at once. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_depth(acquisition: *const isotherm_acquisition) -> usize {
    number(acquisition, Acquisition::depth)
}

/// Samples that have been sent and whose increments have not been received. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_in_flight(acquisition: *const isotherm_acquisition) -> usize {
    number(acquisition, Acquisition::in_flight)
}

/// Control periods, of all sessions of this connection, that have a sequence and are gone: samples that were discarded
/// or are still on loan, sequences that were left out, periods for which the waiting line had no room, and samples
/// whose sending has failed. What waits is not lost: isotherm_kept. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_lost(acquisition: *const isotherm_acquisition) -> u64 {
    number(acquisition, Acquisition::lost)
}

/// Late increments that were dropped because isotherm_depth of them waited for isotherm_receive already. 0 for a handle
/// that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_dropped_answers(acquisition: *const isotherm_acquisition) -> u64 {
    let mut dropped = 0;
    with(acquisition, |content| {
        dropped = content.acquisition.late().dropped();
        Ok(())
    });
    dropped
}

/// The session of all samples; a new random number for each connection. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_session(acquisition: *const isotherm_acquisition) -> u64 {
    number(acquisition, Acquisition::session)
}

/// Begins a new session: the next sample may have any sequence. What the temperatures have been is not known then,
/// unless isotherm_restore_lag or isotherm_soaked follows.
///
/// It fails while samples are unanswered or kept. If the device resets meanwhile, with a clock or counter that begins
/// anew, go on with isotherm_send_kept and isotherm_receive until isotherm_in_flight and isotherm_kept are 0, hold the
/// new samples back until then, and begin the session for the first of them. If the service does not come back, close
/// the handle, which reports what is lost, and connect again: that begins a session too.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_IN_FLIGHT if samples are unanswered or kept.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_begin_session(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    with(acquisition, |content| Ok(content.acquisition.begin_session()?))
}
