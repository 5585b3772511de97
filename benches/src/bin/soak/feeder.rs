//! An acquisition and a reader that know every correct answer, because each sample is a function of its sequence
//! number.

use isotherm_benches::{BenchResult, IMU, LAG_NS, TABLE, TIMEOUT};
use isotherm_client::{Acquisition, CompensatedIncrement, IncrementReader, Options, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::Triad;
use std::collections::HashSet;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::thread;
use std::time::{Duration, Instant};

/// Samples in flight at most.
const WINDOW: usize = 16;
/// Longest time in which a killed service must return.
pub(crate) const RETURN_TIMEOUT: Duration = Duration::from_secs(15);

/// The text of table `number` for an IMU: each has a gravity of its own.
pub(crate) fn table_text(imu: &str, number: u32) -> String {
    let gravity = format!("{:.4}", 9.8 + f64::from(number) * 1e-4);
    TABLE.replace("9.8015", &gravity).replace(&format!("\"{IMU}\""), &format!("\"{imu}\""))
}

/// Tables 0 to `count` - 1 of an IMU.
pub(crate) fn tables(imu: &str, count: u32) -> BenchResult<Vec<CoefficientTable>> {
    (0..count).map(|number| Ok(CoefficientTable::from_toml(&table_text(imu, number), None)?)).collect()
}

fn sample(sequence: u64) -> RawSample {
    let mix = |salt: u64| {
        let mixed = (sequence ^ salt).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40
    };
    let volts = |salt| 0.9 + mix(salt) as f64 * (3.3 / f64::from(1 << 24));
    let triad = |first: u64| {
        let salts = |part: u64| [0, 1, 2].map(|axis| first + 3 * part + axis);
        Triad {
            positive_pulses: salts(0).map(|salt| (mix(salt) % 100_000) as u32),
            negative_pulses: salts(1).map(|salt| (mix(salt) % 100_000) as u32),
            head_temperature: salts(2).map(volts),
            board_temperature: salts(3).map(volts),
            head_lagged: salts(4).map(volts),
        }
    };
    RawSample {
        sequence,
        timestamp_ns: sequence * 500_000,
        interval_ns: 500_000,
        lag_ns: LAG_NS,
        accelerometers: triad(1),
        gyroscopes: triad(101),
        ..RawSample::default()
    }
}

/// Whether an increment is, bit for bit, that of its sample under the table that it names.
pub(crate) fn is_exact(increment: &CompensatedIncrement, tables: &[CoefficientTable]) -> bool {
    let Some(table) = tables.iter().find(|table| table.id() == increment.table) else { return false };
    let raw = RawSample { session: increment.session, ..sample(increment.sequence) };
    let expected = answer(Some(table), &raw);
    let bits = |increment: &CompensatedIncrement| {
        [increment.velocity_increment, increment.angle_increment].map(|triad| triad.map(f64::to_bits))
    };
    bits(increment) == bits(&expected) && increment.timestamp_ns == expected.timestamp_ns
}

/// The progress of a feed. Other threads may read it meanwhile.
#[derive(Debug, Default)]
pub(crate) struct FeedProgress {
    pub sent: AtomicU64,
    pub answered: AtomicU64,
    pub wrong: AtomicU64,
    /// Answers to another sample than the next one: an answer was lost or repeated.
    pub disorder: AtomicU64,
    /// Id of the table of the last answer.
    pub table: AtomicU64,
}

/// The counts of several feeds together: samples sent, answers, wrong ones, and those out of order or repeated.
fn counts(feeds: &[FeedProgress]) -> [u64; 4] {
    let of = |feed: &FeedProgress| [&feed.sent, &feed.answered, &feed.wrong, &feed.disorder].map(|it| it.load(Relaxed));
    feeds.iter().map(of).fold([0; 4], |sum, counts| std::array::from_fn(|index| sum[index] + counts[index]))
}

/// What feeds have come to.
pub(crate) fn describe(name: &str, feeds: &[FeedProgress]) -> String {
    let [sent, answered, wrong, disorder] = counts(feeds);
    format!(
        "{name}: {sent} samples sent, {answered} increments checked, {wrong} wrong, {disorder} out of order or repeated, {} lost",
        sent - answered
    )
}

/// How many samples of feeds were lost, or have a wrong or repeated answer.
pub(crate) fn failures(feeds: &[FeedProgress]) -> u64 {
    let [sent, answered, wrong, disorder] = counts(feeds);
    sent - answered + wrong + disorder
}

/// Fails if anything failed.
pub(crate) fn check(failures: u64) -> BenchResult<()> {
    if failures > 0 { Err("something was lost, repeated or wrong".into()) } else { Ok(()) }
}

/// Sends a sample every `period` until `stop` is set, then waits for the answers that are missing.
pub(crate) fn feed(
    imu: &str,
    options: &Options,
    period: Duration,
    tables: &[CoefficientTable],
    progress: &FeedProgress,
    stop: &AtomicBool,
) -> BenchResult<()> {
    let mut acquisition = Acquisition::connect(&imu.parse()?, &Options { timeout: RETURN_TIMEOUT, ..options.clone() })?;
    let (mut due, mut expected) = (Instant::now(), 0);
    let mut take = |acquisition: &mut Acquisition, wait: Duration| -> BenchResult<bool> {
        let Some(increment) = acquisition.receive_timeout(wait)? else { return Ok(false) };
        progress.wrong.fetch_add(u64::from(!is_exact(&increment, tables)), Relaxed);
        progress.disorder.fetch_add(u64::from(increment.sequence != expected), Relaxed);
        expected = increment.sequence + 1;
        progress.table.store(increment.table, Relaxed);
        progress.answered.fetch_add(1, Relaxed);
        Ok(true)
    };
    while !stop.load(Relaxed) {
        due += period;
        while Instant::now() < due || acquisition.in_flight() >= WINDOW || acquisition.is_full() {
            take(&mut acquisition, due.saturating_duration_since(Instant::now()).min(Duration::from_millis(1)))?;
            if stop.load(Relaxed) {
                break;
            }
        }
        if acquisition.in_flight() >= WINDOW || acquisition.is_full() {
            break;
        }
        // Samples that were delayed because the service was away are not sent faster afterwards.
        due = due.max(Instant::now() - period);
        let mut loan = acquisition.loan()?;
        let (session, sequence) = (loan.session, loan.sequence);
        *loan = RawSample { session, ..sample(sequence) };
        acquisition.send(loan)?;
        progress.sent.fetch_add(1, Relaxed);
    }
    let deadline = Instant::now() + RETURN_TIMEOUT;
    while acquisition.in_flight() > 0 && Instant::now() < deadline {
        take(&mut acquisition, Duration::from_millis(1))?;
    }
    Ok(())
}

/// Reads for `time`. Returns how many increments came, how many were wrong, and how many came twice.
pub(crate) fn read(imu: &str, options: &Options, time: Duration, tables: &[CoefficientTable]) -> BenchResult<[u64; 3]> {
    let mut reader = IncrementReader::connect(imu.parse()?, options)?;
    let (started, mut known, mut counts) = (Instant::now(), HashSet::new(), [0; 3]);
    while started.elapsed() < time {
        if let Some(increment) = reader.receive_timeout(Duration::from_millis(1))? {
            counts[0] += 1;
            counts[1] += u64::from(!is_exact(&increment, tables));
            counts[2] += u64::from(!known.insert((increment.session, increment.sequence)));
        }
    }
    Ok(counts)
}

/// Role of a child process: an acquisition that sends until it is killed.
pub(crate) fn send_for_ever(imu: &str, options: &Options) -> BenchResult<()> {
    let mut acquisition = Acquisition::connect(&imu.parse()?, options)?;
    loop {
        let mut loan = acquisition.loan()?;
        let (session, sequence) = (loan.session, loan.sequence);
        *loan = RawSample { session, ..sample(sequence) };
        acquisition.compensate(loan, TIMEOUT)?;
        thread::sleep(Duration::from_micros(500));
    }
}

/// Role of a child process: a reader that reads until it is killed.
pub(crate) fn read_for_ever(imu: &str, options: &Options) -> BenchResult<()> {
    let mut reader = IncrementReader::connect(imu.parse()?, options)?;
    loop {
        reader.receive_timeout(Duration::from_millis(10))?;
    }
}
