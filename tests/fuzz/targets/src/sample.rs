//! Input: a series of samples with any bits, as a peer may write them into shared memory. `checked` must accept the
//! answer to each sample with a table of every policy and without a table. The tracked order of sessions and sequence
//! numbers must agree with direct counting. Merging two samples must add them or change nothing.

use crate::{SAMPLE, checked, sample};
use isotherm_shared::protocol::{Arrival, SequenceTracker};
use isotherm_shared::sequence::{Period, Seen};
use isotherm_shared::table::{CoefficientTable, OutOfRange};
use isotherm_shared::wire::{MAX_INTERVAL_NS, RawSample};
use std::sync::LazyLock;

/// Four tables with each policy: one plain, one with an alignment and limits, one of a whole IMU, one with a nominal
/// interval.
static TABLES: LazyLock<Vec<CoefficientTable>> = LazyLock::new(|| {
    let texts = [
        include_str!("../../../data/imu-a.toml"),
        include_str!("../../../../examples/tables/imu-b.toml"),
        include_str!("../../../../examples/tables/imu-whole.toml"),
        include_str!("../../../../examples/tables/imu-mems.toml"),
    ];
    let contents = texts.map(|text| CoefficientTable::from_toml(text, None).expect("a valid table").content().clone());
    let with = |(out_of_range, _): (OutOfRange, _)| {
        contents.clone().map(|mut content| {
            content.out_of_range = out_of_range;
            CoefficientTable::new(content).expect("a valid table")
        })
    };
    OutOfRange::NAMES.into_iter().flat_map(with).collect()
});

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let (chunks, _) = bytes.as_chunks::<SAMPLE>();
    let samples: Vec<_> = chunks.iter().map(sample).collect();
    for raw in &samples {
        for table in TABLES.iter().map(Some).chain([None]) {
            checked(table, raw);
        }
    }
    track(&samples);
    samples.windows(2).for_each(|pair| merge(&pair[0], &pair[1]));
}

/// Compares the tracked order with counting.
fn track(samples: &[RawSample]) {
    let mut tracker = SequenceTracker::default();
    // The last four sessions, the last sample's last; of each its sequence numbers so far, how many were missing, and
    // how many new.
    let mut sessions = Vec::<(u64, Vec<u64>, u128, u128)>::new();
    let mut last_seen = None;
    for raw in samples {
        let known = sessions.iter().position(|(session, ..)| *session == raw.session);
        let session = known.map_or((raw.session, Vec::new(), 0, 0), |place| sessions.remove(place));
        sessions.push(session);
        if sessions.len() > 4 {
            sessions.remove(0);
        }
        let Some((_, sequences, missing, new)) = sessions.last_mut() else { continue };
        let is_first = last_seen.replace(raw).is_none();
        let arrival = tracker.note(Seen { period: Period::from(raw), at_ns: raw.sent_ns });
        let repeated = sequences.iter().any(|sequence| *sequence >= raw.sequence);
        let Arrival { missing: before, time_step, change, .. } = arrival;
        assert_eq!(arrival, Arrival { missing: before, repeated, begins: sequences.is_empty(), time_step, change });
        assert_eq!(change.is_some(), arrival.begins && !is_first);
        assert!(!repeated || before == 0);
        // Only the next sample of a session can have one.
        let is_next = sequences.iter().max().and_then(|highest| highest.checked_add(1)) == Some(raw.sequence);
        assert!(!time_step || is_next && raw.timestamp_ns != 0);
        sequences.push(raw.sequence);
        *missing += u128::from(arrival.missing);
        *new += u128::from(!repeated);
        // Every number from the first to the highest has come or counts as missing.
        let highest = sequences.iter().max().expect("not empty");
        assert_eq!(*missing + *new, u128::from(highest - sequences[0]) + 1);
    }
}

fn pulses(raw: &RawSample) -> Vec<u64> {
    let triads = [&raw.accelerometers, &raw.gyroscopes];
    let counts = triads.map(|triad| [triad.positive_pulses, triad.negative_pulses]);
    counts.as_flattened().as_flattened().iter().map(|n| u64::from(*n)).collect()
}

/// Merges two samples: they are added, or nothing changes.
fn merge(first: &RawSample, later: &RawSample) {
    let mut sum = *first;
    let merged = sum.merge(later).is_ok();
    let added: Vec<_> = pulses(first).iter().zip(pulses(later)).map(|(a, b)| a + b).collect();
    let interval = u128::from(first.interval_ns) + u128::from(later.interval_ns);
    let fits = added.iter().all(|n| *n <= u64::from(u32::MAX)) && interval <= u128::from(MAX_INTERVAL_NS);
    assert_eq!(merged, fits);
    if merged {
        // An unknown interval stays unknown.
        let known = first.interval_ns != 0 && later.interval_ns != 0;
        assert_eq!((pulses(&sum), u128::from(sum.interval_ns)), (added, if known { interval } else { 0 }));
        assert_eq!(
            (sum.session, sum.sequence, sum.lag_ns, sum.device),
            (first.session, first.sequence, later.lag_ns, later.device)
        );
    } else {
        assert_eq!((pulses(&sum), sum.interval_ns), (pulses(first), first.interval_ns));
    }
}
