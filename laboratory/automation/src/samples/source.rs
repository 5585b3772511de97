//! Where raw samples come from: taps on the raw streams of a service.

use isotherm_client::{Options, Realtime, Tap, TapSettings};
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_shared::wire::{RawSample, StreamSample};
use std::io;
use std::mem;
use std::time::{Duration, Instant};

/// Pause of the tap when the stream is empty: at 2 kHz, a sixth of the queue is filled meanwhile.
const TAP_PAUSE: Duration = Duration::from_millis(5);
/// Capacity of the queue between tap and runner \[samples\]. Further samples are lost and count as a gap.
const TAP_DEPTH: usize = 1 << 16;
/// Pause before a tap that an error has ended is started again.
const TAP_RETRY: Duration = Duration::from_millis(500);

/// Where the raw samples of an IMU come from.
pub trait SampleSource {
    /// The next sample and the time of its reception, `CLOCK_MONOTONIC` \[ns\]; or the next error; `None` if there is
    /// neither.
    fn take_sample(&mut self) -> Option<Result<(RawSample, u64), String>>;
}

/// What starts the sources of samples.
pub trait SampleSources {
    /// Starts that of an IMU.
    ///
    /// # Errors
    /// If no thread can be started.
    fn start(&self, imu: &ImuId) -> io::Result<Box<dyn SampleSource>>;

    /// Where they come from, for messages: the service's domain.
    fn domain(&self) -> &str;
}

/// The raw streams of a service.
impl SampleSources for Options {
    fn start(&self, imu: &ImuId) -> io::Result<Box<dyn SampleSource>> {
        Ok(Box::new(SampleTap::start(imu.clone(), self.clone())?))
    }

    fn domain(&self) -> &str {
        self.domain.name()
    }
}

/// A tap on the IMU's raw stream for the whole campaign. Its errors are returned, and the tap is started again.
struct SampleTap {
    imu: ImuId,
    options: Options,
    tap: Tap,
    /// When a tap that an error has ended is started again; `None` while it runs.
    retry_at: Option<Instant>,
}

impl SampleTap {
    fn start(imu: ImuId, options: Options) -> io::Result<Self> {
        let tap = start_tap(&imu, &options)?;
        Ok(Self { imu, options, tap, retry_at: None })
    }
}

impl SampleSource for SampleTap {
    fn take_sample(&mut self) -> Option<Result<(RawSample, u64), String>> {
        while let Some(tapped) = self.tap.pop() {
            if let StreamSample::Raw(sample) = tapped.sample {
                return Some(Ok((sample, tapped.received_ns)));
            }
        }
        if let Some(warning) = self.tap.take_warning() {
            return Some(Err(warning));
        }
        if !self.tap.has_ended() {
            return None;
        }
        let now = Instant::now();
        match self.retry_at {
            Some(at) if now < at => None,
            Some(_) => {
                self.retry_at = None;
                match start_tap(&self.imu, &self.options) {
                    Ok(tap) => {
                        let ended = mem::replace(&mut self.tap, tap);
                        ended.finish().err().map(|error| Err(error.to_string()))
                    }
                    Err(error) => Some(Err(error.to_string())),
                }
            }
            None => {
                self.retry_at = Some(now + TAP_RETRY);
                None
            }
        }
    }
}

fn start_tap(imu: &ImuId, options: &Options) -> io::Result<Tap> {
    let settings = TapSettings { depth: TAP_DEPTH, pause: TAP_PAUSE, realtime: Realtime::default() };
    Tap::start(&[(imu.clone(), StreamKind::Raw)], options, settings)
}
