//! A running `isotherm feed` that gets samples until the test has seen enough: it does not depend on any speed.

use isotherm_recording::RawCsvWriter;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::RawSample;
use isotherm_tests::{Process, TestDomain, recording};
use std::fs;
use std::io::{BufWriter, Write as _, pipe};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

/// The feed of `imu-a`, and the thread that writes samples into its stdin.
pub(crate) struct Feed {
    process: Process,
    enough: Arc<AtomicBool>,
    writer: JoinHandle<u64>,
    increments: PathBuf,
}

impl Feed {
    /// Starts it at a rate.
    pub(crate) fn start(domain: &TestDomain) -> Self {
        let (samples, sink) = pipe().unwrap();
        let mut command = domain.isotherm(&["feed", "--imu", "imu-a", "--rate", "1000", "-", "-o", "increments.csv"]);
        command.stdin(samples);
        let process = domain.start(command);
        let enough = Arc::<AtomicBool>::default();
        let stop = Arc::clone(&enough);
        let writer = thread::spawn(move || {
            let first = recording()[0];
            let mut writer = RawCsvWriter::new(BufWriter::new(sink), "", false).unwrap();
            let mut sequence = 0;
            // The pipe takes no more than the feed sends.
            while !stop.load(Ordering::Relaxed) {
                let timestamp_ns = first.timestamp_ns + sequence * first.interval_ns;
                writer.write("", &RawSample { sequence, timestamp_ns, ..first }).unwrap();
                sequence += 1;
            }
            writer.finish().unwrap().flush().unwrap();
            sequence
        });
        Self { process, enough, writer, increments: domain.path("increments.csv") }
    }

    /// Ends the samples, and asserts that each of them has its one increment, in order. Returns the tables of the
    /// increments: each whenever it is another one than before.
    pub(crate) fn end(self) -> Vec<u64> {
        self.enough.store(true, Ordering::Relaxed);
        let sent = self.writer.join().unwrap();
        let (status, log) = self.process.wait();
        assert!(status.success(), "{log}");
        let text = fs::read_to_string(self.increments).unwrap();
        let (header, rows) = text.split_once('\n').unwrap();
        let column = |name: &str| header.split(',').position(|column| column == name).unwrap();
        let [sequence, table] = ["sequence", "table"].map(column);
        let mut tables = Vec::new();
        let mut count = 0;
        for row in rows.lines() {
            let fields: Vec<_> = row.split(',').collect();
            assert_eq!(fields[sequence], count.to_string(), "a sample is lost or answered twice");
            tables.push(u64::from_str_radix(fields[table], 16).unwrap());
            count += 1;
        }
        assert_eq!(count, sent);
        tables.dedup();
        tables
    }
}

/// The ids of tables, as [`Feed::end`] returns them.
pub(crate) fn ids<const N: usize>(tables: [&CoefficientTable; N]) -> Vec<u64> {
    tables.map(CoefficientTable::id).to_vec()
}
