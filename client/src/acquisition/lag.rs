//! What an acquisition reports to its lag.

use crate::lag::{AcquisitionLag, Sensor};
use isotherm_shared::lag::Lag;
use isotherm_shared::wire::{RawSample, SENSORS};

/// The lag of an acquisition's temperatures: [`Acquisition::lag`](crate::Acquisition::lag).
#[derive(Debug)]
pub struct LagAccess<'a> {
    pub(super) lag: &'a mut AcquisitionLag,
}

impl LagAccess<'_> {
    /// Takes a new reading of a sensor's head temperature, in the table's unit, measured at `time_ns` on the
    /// acquisition's clock. Every sample that is sent later carries the lagged temperatures of all readings so far.
    ///
    /// A reading is a new measurement: call this once for each, not for each sample. A value that is not finite, or has
    /// the time of the last reading, is none. [`isotherm_shared::lag`] has the formula. With [`LagOption::Service`], a
    /// value that no thermometer gives is none either, by the ranges of the table in force: see
    /// [`ReadingLimits`](isotherm_shared::lag::ReadingLimits).
    ///
    /// If the service has taken a table with another time constant, with [`LagOption::Service`], this call has the
    /// helper thread of the acquisition read the status, and a later call takes it. Increments are flagged
    /// [`LAG_UNKNOWN`](isotherm_shared::wire::Flags::LAG_UNKNOWN) until then. If readings are rare, give the last ones
    /// again while that is so: a reading with the time of the last is none, but it asks.
    ///
    /// [`LagOption::Service`]: crate::LagOption::Service
    pub fn read(&mut self, sensor: Sensor, temperature: f64, time_ns: u64) {
        self.lag.read(sensor as usize, temperature, time_ns);
    }

    /// Takes a new reading of one head temperature that all sensors share, as of an IMU with one thermometer: a
    /// [`read`](Self::read) of each of the six. Gyroscopes that the IMU does not have stay absent.
    pub fn reading_of_all(&mut self, temperature: f64, time_ns: u64) {
        (0..SENSORS).for_each(|sensor| self.lag.read(sensor, temperature, time_ns));
    }

    /// Takes the readings of a sample of which it is not known whether its temperatures are new, as in a recording: see
    /// [`Lag::follow`]. Call it before the sample is sent, instead of [`read`](Self::read).
    pub fn follow(&mut self, sample: &RawSample) {
        self.lag.follow(sample);
    }

    /// Its state: the time constant, 0 while there is none, and the readings so far. Save it with each reading if a
    /// successor of this process shall go on with it.
    #[must_use]
    pub const fn state(&self) -> &Lag {
        self.lag.state()
    }

    /// Goes on with the readings of a lag that was saved, on the same clock, as if the temperatures had gone straight
    /// on in the pause. Its time constant is not used. A sensor without a saved reading, or whose next reading is
    /// earlier than the saved one, which is then of another clock, is unknown as after [`forget`](Self::forget). So are
    /// all sensors of a lag that was saved before the machine was started anew. If your clock goes on over that, as one
    /// of the hardware may, set its `boot` to 0.
    pub fn restore(&mut self, saved: &Lag) {
        self.lag.restore(saved);
    }

    /// Informs the library that what the temperatures have been is not known. That is so already when the acquisition
    /// connects, and when it begins a session. Increments are flagged
    /// [`LAG_UNKNOWN`](isotherm_shared::wire::Flags::LAG_UNKNOWN), and computed without the transient terms, until the
    /// readings span three time constants: [`Lag::unknown`].
    pub fn forget(&mut self) {
        self.lag.reset();
    }

    /// Informs the library that the IMU is soaked: its temperatures have been those of the next readings for three time
    /// constants. Only what has just been powered, or has stood long enough, is. If it is not, the lagged temperature
    /// is wrong by the difference, which decays with the time constant, and no flag shows it.
    pub fn soaked(&mut self) {
        self.lag.soak();
    }
}
