//! From the columns of a row to a raw sample.

use crate::number::Value;
use isotherm_client::{RawSample, ReadingError, Resolution};
use isotherm_recording_formats::convert::Linear;
use isotherm_shared::readings::Readings;
use isotherm_shared::wire::AXES;

/// The columns of three sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Axes {
    /// Their places in a row.
    pub(crate) columns: [usize; AXES],
    /// Taken off each number first, in the column's unit.
    pub(crate) offset: f64,
    /// 1, or -1 for an axis that points the other way.
    pub(crate) sign: [f64; AXES],
    /// Whether a number is a mean over the sample's interval, and not what has summed up in it.
    pub(crate) is_reading: bool,
}

impl Axes {
    /// The readings of a row, in the columns' unit and for the nominal interval, with the signs of the axes; `None` if
    /// one is not a finite number. A sample has `ratio` nominal intervals.
    fn readings(&self, row: &[Value], ratio: f64) -> Option<[f64; AXES]> {
        let ratio = if self.is_reading { ratio } else { 1.0 };
        let mut readings = [0.0; AXES];
        for ((reading, column), sign) in readings.iter_mut().zip(self.columns).zip(self.sign) {
            *reading = (row.get(column)?.number - self.offset) * sign * ratio;
        }
        readings.iter().all(|reading| reading.is_finite()).then_some(readings)
    }
}

/// Where the temperature comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TemperatureColumns {
    /// Places in a row of the heads A1 to G3, and of the boards.
    Columns {
        /// Of the heads.
        head: [usize; 2 * AXES],
        /// Of the boards.
        board: [usize; 2 * AXES],
        /// What makes temperature of the numbers.
        linear: Linear,
    },
    /// The same in all samples.
    Constant(f64),
}

/// Most numbers of a status.
pub(crate) const MAX_STATUS: usize = 8;

/// When a device is healthy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Status {
    /// The places of its numbers in a row, repeated if there are fewer.
    pub(crate) columns: [usize; MAX_STATUS],
    /// The bits that count.
    pub(crate) mask: u64,
    /// What they are when it is healthy.
    pub(crate) healthy: u64,
    /// For each number the bits of A1 to G3; 0 for sensors that have none in it.
    pub(crate) bits: [[u64; 2 * AXES]; MAX_STATUS],
}

impl Status {
    /// The sensors that are not healthy, one bit each, A1 first. A number says it of the sensors whose bits are wrong;
    /// if only others are, of all sensors that have bits in it; of all six if none has.
    fn unhealthy(&self, row: &[Value]) -> u8 {
        let of_number = |(column, bits): (&usize, &[u64; 2 * AXES])| {
            let sensors = |counts: &dyn Fn(u64) -> bool| {
                let all = bits.iter().enumerate().filter(|(_, bits)| counts(**bits));
                all.fold(0, |all, (sensor, _)| all | 1u8 << sensor)
            };
            let whole = row.get(*column).and_then(|value| value.whole);
            // A number that is not there is a bad sign.
            let wrong = whole.map_or(u64::MAX, |whole| (whole ^ self.healthy) & self.mask);
            let (own, of_any) = (sensors(&|bits| bits & wrong != 0), sensors(&|bits| bits != 0));
            [own, of_any, ALL].into_iter().find(|sensors| *sensors != 0).filter(|_| wrong != 0).unwrap_or(0)
        };
        self.columns.iter().zip(&self.bits).map(of_number).fold(0, |all, sensors| all | sensors)
    }
}

/// All sensors, one bit each.
pub(crate) const ALL: u8 = (1 << (2 * AXES)) - 1;

/// What the columns of a row are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Columns {
    /// The accelerometers.
    pub(crate) accelerometer: Axes,
    /// The gyroscopes, if there are any.
    pub(crate) gyroscope: Option<Axes>,
    /// The temperature.
    pub(crate) temperature: TemperatureColumns,
    /// The status.
    pub(crate) status: Option<Status>,
    /// One pulse, in the columns' units.
    pub(crate) resolution: Resolution,
    /// The nominal interval \[ns\].
    pub(crate) interval_ns: u64,
    /// The number of the device; 0 = unknown.
    pub(crate) device: u64,
}

impl Columns {
    /// Whether samples of another interval than the nominal one are right: increments are, and readings. Counts of a
    /// reading have scale factors for one interval.
    pub(crate) fn adopts(&self) -> bool {
        let of = |axes: &Axes, resolution: f64| !axes.is_reading || resolution != 1.0;
        let Self { accelerometer, gyroscope, resolution, .. } = self;
        of(accelerometer, resolution.accelerometer)
            && gyroscope.as_ref().is_none_or(|axes| of(axes, resolution.gyroscope))
    }
}

/// Why a row is no sample.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum NoSample {
    /// It has not all columns of the sensors, or one that is not finite.
    Incomplete,
    /// There has been no temperature yet.
    NoTemperature,
    /// A number is more pulses than a sample can have.
    OutOfRange(ReadingError),
}

/// Makes raw samples of rows.
#[derive(Debug)]
pub(crate) struct Assembler {
    columns: Columns,
    readings: Readings,
    heads: [f64; 2 * AXES],
    boards: [f64; 2 * AXES],
    telemetry_ns: u64,
    /// The interval of the samples \[ns\].
    interval_ns: u64,
    /// The interval for which the pulses of readings are made \[ns\]: that of the table.
    pulse_ns: u64,
}

impl Assembler {
    /// An assembler without temperature, unless that is constant.
    #[must_use]
    pub(crate) const fn new(columns: Columns) -> Self {
        let readings = Readings::new(columns.resolution, columns.interval_ns);
        let constant = match columns.temperature {
            TemperatureColumns::Constant(constant) => [constant; 2 * AXES],
            TemperatureColumns::Columns { .. } => [f64::NAN; 2 * AXES],
        };
        Self {
            columns,
            readings,
            heads: constant,
            boards: constant,
            telemetry_ns: 0,
            interval_ns: columns.interval_ns,
            pulse_ns: columns.interval_ns,
        }
    }

    /// Forgets what rounding has left: for a new session, and after a gap.
    pub(crate) const fn reset(&mut self) {
        self.readings.reset();
    }

    /// Forgets the temperature, too: for a device that was away.
    pub(crate) const fn forget(&mut self) {
        *self = Self { interval_ns: self.interval_ns, pulse_ns: self.pulse_ns, ..Self::new(self.columns) };
    }

    /// Takes this interval for that of the samples \[ns\].
    pub(crate) const fn set_interval(&mut self, interval_ns: u64) {
        self.interval_ns = interval_ns;
    }

    /// Makes the pulses of readings for this interval from now on \[ns\].
    pub(crate) const fn set_pulse_interval(&mut self, pulse_ns: u64) {
        if self.pulse_ns != pulse_ns {
            self.pulse_ns = pulse_ns;
            self.readings.reset();
        }
    }

    /// A raw sample of a row that was sampled at this time. Session and sequence are not set. Returns also the sensors
    /// that are not healthy, one bit each, A1 first.
    ///
    /// Their temperature is NaN, so that the increment is flagged.
    ///
    /// # Errors
    /// [`NoSample`]: the control period is missing.
    pub(crate) fn sample(&mut self, row: &[Value], timestamp_ns: u64) -> Result<(RawSample, u8), NoSample> {
        self.take_temperature(row, timestamp_ns);
        let ratio = self.interval_ns as f64 / self.pulse_ns as f64;
        let accelerometer = self.columns.accelerometer.readings(row, ratio).ok_or(NoSample::Incomplete)?;
        let gyroscope =
            self.columns.gyroscope.as_ref().map(|axes| axes.readings(row, ratio).ok_or(NoSample::Incomplete));
        let gyroscope = gyroscope.transpose()?;
        if self.heads.iter().chain(&self.boards).any(|temperature| temperature.is_nan()) {
            return Err(NoSample::NoTemperature);
        }
        let mut raw = RawSample {
            timestamp_ns,
            telemetry_ns: self.telemetry_ns,
            interval_ns: self.columns.interval_ns,
            device: self.columns.device,
            ..RawSample::default()
        };
        self.readings.fill(&mut raw, accelerometer, gyroscope).map_err(NoSample::OutOfRange)?;
        raw.interval_ns = self.interval_ns;
        let unhealthy = self.columns.status.map_or(0, |status| status.unhealthy(row));
        let of = |all: &[f64; 2 * AXES]| {
            let of_sensor = |sensor: usize| if unhealthy & 1 << sensor == 0 { all[sensor] } else { f64::NAN };
            [0, AXES].map(|first| std::array::from_fn(|axis| of_sensor(first + axis)))
        };
        let ([a_head, g_head], [a_board, g_board]) = (of(&self.heads), of(&self.boards));
        (raw.accelerometers.head_temperature, raw.accelerometers.board_temperature) = (a_head, a_board);
        if self.columns.gyroscope.is_some() {
            (raw.gyroscopes.head_temperature, raw.gyroscopes.board_temperature) = (g_head, g_board);
        }
        Ok((raw, unhealthy))
    }

    /// Whether a row has all accelerometers and gyroscopes.
    pub(crate) fn has_sensors(&self, row: &[Value]) -> bool {
        let has = |axes: &Axes| axes.readings(row, 1.0).is_some();
        has(&self.columns.accelerometer) && self.columns.gyroscope.as_ref().is_none_or(has)
    }

    /// Takes the temperature of a row that has some; otherwise that of the last row stays.
    pub(crate) fn take_temperature(&mut self, row: &[Value], timestamp_ns: u64) {
        let TemperatureColumns::Columns { head, board, linear } = self.columns.temperature else { return };
        let mut is_new = false;
        for (last, column) in self.heads.iter_mut().chain(&mut self.boards).zip(head.iter().chain(&board)) {
            let temperature = row.get(*column).map_or(f64::NAN, |value| value.number * linear.scale + linear.offset);
            if temperature.is_finite() {
                *last = temperature;
                is_new = true;
            }
        }
        if is_new {
            self.telemetry_ns = timestamp_ns;
        }
    }
}
