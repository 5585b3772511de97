//! A blocking Unix socket: what a service without shared memory does.

use crate::paths::Path;
use isotherm_benches::{BenchResult, TABLE, TIMEOUT};
use isotherm_client::{CompensatedIncrement, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::Triad;
use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::{Duration, Instant};

const RAW_BYTES: usize = size_of::<RawSample>();
const INCREMENT_BYTES: usize = size_of::<CompensatedIncrement>();

/// A blocking Unix socket with the kernel behind it.
pub(crate) struct Socket(UnixStream);

impl Socket {
    /// Connects to the [`socket_server`], which may not be ready yet.
    pub(crate) fn connect(path: &std::path::Path) -> BenchResult<Self> {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            match UnixStream::connect(path) {
                Ok(stream) => {
                    stream.set_read_timeout(Some(TIMEOUT))?;
                    return Ok(Self(stream));
                }
                Err(error) if Instant::now() > deadline => return Err(error.into()),
                Err(_) => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }
}

impl Path for Socket {
    fn round_trip(&mut self, sample: &RawSample) -> BenchResult<CompensatedIncrement> {
        self.0.write_all(&raw_bytes(sample))?;
        let mut bytes = [0; INCREMENT_BYTES];
        self.0.read_exact(&mut bytes)?;
        Ok(increment_of(&bytes))
    }
}

/// Answers every sample that comes through the socket at `path`.
pub(crate) fn socket_server(path: &str) -> BenchResult<()> {
    let table = CoefficientTable::from_toml(TABLE, None).map_err(|faults| faults.to_string())?;
    // Bound under another name first, so that a client that finds `path` can connect.
    let staged = format!("{path}.new");
    let listener = UnixListener::bind(&staged)?;
    fs::rename(&staged, path)?;
    let (mut stream, _) = listener.accept()?;
    let mut bytes = [0; RAW_BYTES];
    loop {
        stream.read_exact(&mut bytes)?;
        stream.write_all(&increment_bytes(&answer(Some(&table), &raw_of(&bytes))))?;
    }
}

/// Reads numbers from consecutive bytes, native-endian.
struct ByteReader<'a>(&'a [u8]);

impl ByteReader<'_> {
    fn word<const N: usize>(&mut self) -> [u8; N] {
        let (word, rest) = self.0.split_first_chunk().unwrap_or((&[0; N], &[]));
        self.0 = rest;
        *word
    }

    fn u64(&mut self) -> u64 {
        u64::from_ne_bytes(self.word())
    }

    fn u32s(&mut self) -> [u32; 3] {
        [(); 3].map(|()| u32::from_ne_bytes(self.word()))
    }

    fn f64s(&mut self) -> [f64; 3] {
        [(); 3].map(|()| f64::from_ne_bytes(self.word()))
    }

    fn triad(&mut self) -> Triad {
        Triad {
            positive_pulses: self.u32s(),
            negative_pulses: self.u32s(),
            head_temperature: self.f64s(),
            board_temperature: self.f64s(),
            head_lagged: self.f64s(),
        }
    }
}

/// Writes numbers into consecutive bytes.
struct ByteWriter<const N: usize>([u8; N], usize);

impl<const N: usize> ByteWriter<N> {
    const fn new() -> Self {
        Self([0; N], 0)
    }

    fn put(&mut self, bytes: &[u8]) {
        self.0[self.1..self.1 + bytes.len()].copy_from_slice(bytes);
        self.1 += bytes.len();
    }
}

fn raw_bytes(raw: &RawSample) -> [u8; RAW_BYTES] {
    let mut writer = ByteWriter::new();
    let times = [raw.timestamp_ns, raw.interval_ns, raw.sent_ns, raw.telemetry_ns, raw.lag_ns];
    for word in [raw.session, raw.sequence].iter().chain(&times).chain([&raw.device]) {
        writer.put(&word.to_ne_bytes());
    }
    for triad in [&raw.accelerometers, &raw.gyroscopes] {
        triad.positive_pulses.iter().chain(&triad.negative_pulses).for_each(|word| writer.put(&word.to_ne_bytes()));
        let temperature = [triad.head_temperature, triad.board_temperature, triad.head_lagged];
        temperature.as_flattened().iter().for_each(|word| writer.put(&word.to_ne_bytes()));
    }
    writer.0
}

fn raw_of(bytes: &[u8; RAW_BYTES]) -> RawSample {
    let mut reader = ByteReader(bytes);
    RawSample {
        session: reader.u64(),
        sequence: reader.u64(),
        timestamp_ns: reader.u64(),
        interval_ns: reader.u64(),
        sent_ns: reader.u64(),
        telemetry_ns: reader.u64(),
        lag_ns: reader.u64(),
        device: reader.u64(),
        accelerometers: reader.triad(),
        gyroscopes: reader.triad(),
    }
}

fn increment_bytes(increment: &CompensatedIncrement) -> [u8; INCREMENT_BYTES] {
    let mut writer = ByteWriter::new();
    for word in [increment.session, increment.sequence, increment.timestamp_ns, increment.interval_ns] {
        writer.put(&word.to_ne_bytes());
    }
    let triads = [increment.velocity_increment, increment.angle_increment];
    triads.as_flattened().iter().for_each(|word| writer.put(&word.to_ne_bytes()));
    for word in [increment.table, increment.flags, increment.latency_ns] {
        writer.put(&word.to_ne_bytes());
    }
    writer.0
}

fn increment_of(bytes: &[u8; INCREMENT_BYTES]) -> CompensatedIncrement {
    let mut reader = ByteReader(bytes);
    CompensatedIncrement {
        session: reader.u64(),
        sequence: reader.u64(),
        timestamp_ns: reader.u64(),
        interval_ns: reader.u64(),
        velocity_increment: reader.f64s(),
        angle_increment: reader.f64s(),
        table: reader.u64(),
        flags: reader.u64(),
        latency_ns: reader.u64(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::InProcess;

    #[test]
    fn the_socket_carries_the_payloads_unchanged() {
        let raw = RawSample {
            session: 1,
            sequence: 2,
            timestamp_ns: 3,
            sent_ns: 5,
            telemetry_ns: 6,
            device: 9,
            ..isotherm_benches::sample()
        };
        assert_eq!(raw_of(&raw_bytes(&raw)), raw);
        let increment = InProcess::new().unwrap().round_trip(&raw).unwrap();
        let increment = CompensatedIncrement { flags: 7, latency_ns: 8, ..increment };
        assert_eq!(increment_of(&increment_bytes(&increment)), increment);
    }
}
