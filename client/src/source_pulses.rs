//! What the pulses of a source are, so that they can be those of the table in force.

use isotherm_shared::readings::{Readings, Resolution};
use isotherm_shared::table::{PulseMismatch, PulseScale};
use isotherm_shared::wire::RawSample;

/// What the pulses of an acquisition's samples are: readings for an interval, increments, or counts of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourcePulses {
    /// The nominal interval of the source \[ns\]; 0 if it has none of its own.
    pub interval_ns: u64,
    /// Whether they are counts whose scale factors hold for that interval only.
    pub are_counts: bool,
    /// Whether accelerometers and gyroscopes are readings: their pulses are made for the interval of a table.
    pub are_readings: [bool; 2],
    /// What one pulse stands for, where it is known: of readings over their interval \[m/s2 and rad/s\], of others
    /// \[m/s and rad\].
    pub resolution: [Option<f64>; 2],
}

impl SourcePulses {
    /// Those of readings.
    #[must_use]
    pub const fn of_readings(resolution: Resolution) -> Self {
        let Resolution { accelerometer, gyroscope } = resolution;
        let resolution = [Some(accelerometer), Some(gyroscope)];
        Self { interval_ns: 0, are_counts: false, are_readings: [true; 2], resolution }
    }

    /// The interval for which readings become pulses of the table \[ns\]; that of counts and increments is their own.
    pub(crate) fn interval_for(&self, table: &PulseScale) -> Result<u64, PulseMismatch> {
        if self.are_counts {
            table.check_counts(self.interval_ns)?;
        }
        let interval_ns = match table.nominal_ns {
            nominal_ns if nominal_ns != 0 && !self.are_counts => nominal_ns,
            _ if self.interval_ns == 0 => return Err(PulseMismatch::NoNominal),
            _ => self.interval_ns,
        };
        let weight = |of: usize| {
            self.resolution[of].map(|one| if self.are_readings[of] { one * interval_ns as f64 / 1e9 } else { one })
        };
        table.check([weight(0), weight(1)])?;
        Ok(interval_ns)
    }

    /// Turns the pulses of readings for one interval into those for another one \[ns\].
    pub fn rescale(&self, sample: &mut RawSample, from_ns: u64, to_ns: u64) {
        let triads = [&mut sample.accelerometers, &mut sample.gyroscopes];
        for (triad, _) in triads.into_iter().zip(self.are_readings).filter(|(_, are_readings)| *are_readings) {
            triad.rescale(from_ns as f64 / to_ns as f64);
        }
    }
}

/// What the pulses of an acquisition are.
#[derive(Debug)]
pub(crate) struct SamplePulses {
    pub source: SourcePulses,
    /// The interval for which readings become pulses \[ns\]; 0 while no table says it.
    pub interval_ns: u64,
    /// Whether they are not those of the table in force, so that samples are invalid.
    pub is_unfit: bool,
    /// Of an acquisition whose pulses are made by [`Acquisition::fill`](crate::Acquisition::fill).
    pub readings: Option<Readings>,
}

impl SamplePulses {
    /// Those of readings of this resolution, or of this source; `None` if nothing is known of them.
    pub(crate) fn new(resolution: Option<Resolution>, source: Option<SourcePulses>) -> Option<Self> {
        let readings = |resolution: Resolution| Readings::new(resolution, 0);
        let source = resolution.map(SourcePulses::of_readings).or(source)?;
        let readings = resolution.map(readings);
        Some(Self { source, interval_ns: 0, is_unfit: true, readings })
    }

    /// Forgets what rounding has left.
    pub(crate) const fn reset(&mut self) {
        if let Some(readings) = &mut self.readings {
            readings.reset();
        }
    }
}
