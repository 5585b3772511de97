//! Increments of the selected IMU, as means over a tick.

use isotherm_client::{CompensatedIncrement, ConnectError, ImuId, IncrementReader, Options};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use std::time::{Duration, Instant};

/// Most increments that are read at a tick; a queue holds fewer.
const MAX_INCREMENTS: usize = 4096;
/// Pause after a failed attempt to connect or read.
const RETRY: Duration = Duration::from_secs(2);

/// Means over the increments of one tick, of both triads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CurvePoint {
    /// Of A1 to A3 \[m/s, m/s2\].
    accelerometers: Means,
    /// Of G1 to G3 \[rad, rad/s\]; NaN where the table has no gyroscopes.
    gyroscopes: Means,
}

/// Means of three sensors; NaN if one of the increments is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Means {
    /// The increment of one sample.
    pub increment: [f64; AXES],
    /// The increments divided by their time \[1/s\].
    pub rate: [f64; AXES],
}

impl CurvePoint {
    /// The means of `increments`; `None` if there are none.
    pub(super) fn of(increments: &[CompensatedIncrement]) -> Option<Self> {
        let time = increments.iter().map(|increment| increment.interval_ns as f64 * 1e-9).sum::<f64>();
        let count = increments.len() as f64;
        let means = |triad: fn(&CompensatedIncrement) -> [f64; AXES]| {
            let sums: [f64; AXES] =
                core::array::from_fn(|axis| increments.iter().map(|increment| triad(increment)[axis]).sum());
            Means { increment: sums.map(|sum| sum / count), rate: sums.map(|sum| sum / time) }
        };
        (!increments.is_empty()).then(|| Self {
            accelerometers: means(|increment| increment.velocity_increment),
            gyroscopes: means(|increment| increment.angle_increment),
        })
    }

    /// The means of a triad.
    pub(super) const fn of_triad(&self, kind: SensorKind) -> &Means {
        match kind {
            SensorKind::Accelerometer => &self.accelerometers,
            SensorKind::Gyroscope => &self.gyroscopes,
        }
    }
}

/// The reader of one IMU's increments.
pub(super) struct Increments {
    options: Options,
    reader: Option<(String, IncrementReader)>,
    not_before: Option<Instant>,
    read: Vec<CompensatedIncrement>,
}

impl Increments {
    /// A reader that is not connected yet.
    pub(super) const fn new(options: Options) -> Self {
        Self { options, reader: None, not_before: None, read: Vec::new() }
    }

    /// Drops the connection. The next [`read`](Self::read) makes a new one.
    pub(super) fn disconnect(&mut self) {
        self.reader = None;
    }

    /// The means over the increments since the last call.
    ///
    /// # Errors
    /// Why no increments can be read.
    pub(super) fn read(&mut self, id: Option<&str>, now: Instant) -> Result<Option<CurvePoint>, ConnectError> {
        if self.not_before.is_some_and(|time| now < time) {
            return Ok(None);
        }
        let Some(imu) = id.and_then(ImuId::new) else {
            self.reader = None;
            return Ok(None);
        };
        let reader = match &mut self.reader {
            Some((known, reader)) if known == imu.as_str() => reader,
            _ => &mut self.reader.insert((imu.to_string(), IncrementReader::new(imu, &self.options))).1,
        };
        self.read.clear();
        let result = loop {
            match reader.receive() {
                Ok(Some(increment)) if self.read.len() < MAX_INCREMENTS => self.read.push(increment),
                Ok(_) => break Ok(CurvePoint::of(&self.read)),
                Err(error) => break Err(error),
            }
        };
        self.not_before = result.is_err().then(|| now + RETRY);
        if result.is_err() {
            self.reader = None;
        }
        result
    }
}
