//! Scans as they are handed out.

use rustix::io::Errno;

use super::error::IioError;
use super::temperature::{Temperature, celsius};

/// One sample of all wanted channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan<'a> {
    /// Raw numbers in the order of [`IioSettings::columns`](super::IioSettings::columns).
    pub values: &'a [i64],
    /// Temperatures in the order of [`IioSettings::temperature`](super::IioSettings::temperature) \[degC\].
    pub temperatures: &'a [f64],
    /// When all polled temperatures were last read \[ns\], in the caller's time, 0 before the first call of
    /// [`IioSource::read`](super::IioSource::read); `None` if none is polled.
    pub polled_ns: Option<u64>,
    /// When the sample was taken \[ns\], on [`IioSource::clock`](super::IioSource::clock); of two devices, that of the
    /// first. `None` without a clock.
    pub timestamp_ns: Option<i64>,
}

/// What was counted since [`open`](super::open).
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct IioCounters {
    /// Scans handed out.
    pub scans: u64,
    /// Scans of one of two devices for which the other had none within half an interval. A few are usual at the start:
    /// the devices start one after the other.
    pub unpaired: u64,
    /// Polls of a temperature that failed: the last one stays.
    pub failed_polls: u64,
}

/// What a scan is made of.
pub(super) struct Output {
    /// The columns, then the scanned temperatures.
    numbers: Box<[i64]>,
    columns: usize,
    temperatures: Box<[Temperature]>,
    celsius: Box<[f64]>,
    pub(super) polled_ns: Option<u64>,
    pub(super) counters: IioCounters,
}

impl Output {
    /// Reads the polled temperatures once: what cannot be read while the buffers run is found here.
    pub(super) fn new(numbers: usize, columns: usize, temperatures: Vec<Temperature>) -> Result<Self, IioError> {
        let mut celsius = vec![f64::NAN; temperatures.len()];
        let mut polled_ns = None;
        for (place, temperature) in celsius.iter_mut().zip(&temperatures) {
            if let Temperature::Polled(polled) = temperature {
                *place = polled.read().map_err(|error| polled.failed(&error))?;
                polled_ns = Some(0);
            }
        }
        Ok(Self {
            numbers: vec![0; numbers].into_boxed_slice(),
            columns,
            temperatures: temperatures.into_boxed_slice(),
            celsius: celsius.into_boxed_slice(),
            polled_ns,
            counters: IioCounters::default(),
        })
    }

    /// Polls the temperatures; one that fails stays.
    pub(super) fn poll(&mut self, now_ns: u64) -> Result<(), IioError> {
        let failed = self.counters.failed_polls;
        for (place, temperature) in self.celsius.iter_mut().zip(&self.temperatures) {
            let Temperature::Polled(polled) = temperature else { continue };
            match polled.read() {
                Ok(celsius) => *place = celsius,
                Err(error) if error.raw_os_error() == Some(Errno::NODEV.raw_os_error()) => {
                    return Err(polled.failed(&error));
                }
                Err(_) => self.counters.failed_polls += 1,
            }
        }
        if failed == self.counters.failed_polls {
            self.polled_ns = Some(now_ns);
        }
        Ok(())
    }

    pub(super) fn put(&mut self, slots: &[usize], numbers: impl Iterator<Item = i64>) {
        for (slot, number) in slots.iter().zip(numbers) {
            if let Some(place) = self.numbers.get_mut(*slot) {
                *place = number;
            }
        }
    }

    pub(super) fn give(&mut self, timestamp_ns: Option<i64>, sink: &mut dyn FnMut(Scan<'_>)) {
        for (place, temperature) in self.celsius.iter_mut().zip(&self.temperatures) {
            if let Temperature::Scanned { slot, scale, offset } = temperature {
                *place = self.numbers.get(*slot).map_or(f64::NAN, |raw| celsius(*raw, *scale, *offset));
            }
        }
        self.counters.scans += 1;
        sink(Scan {
            values: self.numbers.get(..self.columns).unwrap_or_default(),
            temperatures: &self.celsius,
            polled_ns: self.polled_ns,
            timestamp_ns,
        });
    }
}
