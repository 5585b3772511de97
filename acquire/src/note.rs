//! What an acquisition notes in the domain's folder for its successor: that this IMU has sent a sample since the
//! machine was started, and the lag of its temperatures.

use crate::note_writer::NoteWriter;
use isotherm_client::{Domain, ImuId, Lag, Note, RawSample, boot};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// The lag is noted so often at most.
const PAUSE: Duration = Duration::from_secs(1);
/// What is lost where the folder does not take the note.
const LOSS: &str = "the next acquisition will not know the lag";
/// A lag that is older than this many time constants shows nothing: the temperatures may have done anything meanwhile.
const MOST_TIME_CONSTANTS: u64 = 10;
/// Clocks that differ by less since the last reading are the same one \[ns\]: samples may wait for the service.
const SAME_CLOCK_NS: u128 = 2_000_000_000;

/// The note of one IMU.
///
/// The sample path hands the newest content to a thread that writes it.
pub(crate) struct AcquisitionNote {
    domain: Domain,
    imu: ImuId,
    /// The machine's start; 0 = unknown.
    boot: u64,
    /// What is noted, if it is of this start of the machine.
    noted: Option<NoteContent>,
    /// When something was handed to the thread.
    handed: Option<Instant>,
    writer: Option<NoteWriter>,
}

/// What is in the file. It exists only if a sample was sent.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
struct NoteContent {
    /// The machine's start, in which the sample was sent.
    boot: u64,
    /// The lag; `None` while the table has no time constant.
    lag: Option<KeptLag>,
}

/// A lag, and when it was the present one.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub(crate) struct KeptLag {
    pub(crate) lag: Lag,
    /// Time of the last sample \[ns\], on the clock of the readings: that of this machine, or one of the device, which
    /// may begin anew.
    pub(crate) sample_ns: u64,
    /// When that sample was sent, on `CLOCK_MONOTONIC` \[ns\].
    pub(crate) sent_ns: u64,
}

impl KeptLag {
    /// The lag with which a session goes on whose first sample is `first`, at `now_ns` and under the time constant
    /// `lag_ns` \[ns\]; `None` if that is another one, or ten of them have passed.
    pub(crate) fn resumed(&self, first: &RawSample, lag_ns: u64, now_ns: u64) -> Option<Lag> {
        let passed = now_ns.saturating_sub(self.sent_ns);
        let has_readings = self.lag.sensors.iter().any(Option::is_some);
        let is_young = passed < lag_ns.saturating_mul(MOST_TIME_CONSTANTS);
        if !has_readings || lag_ns == 0 || self.lag.lag_ns != lag_ns || !is_young {
            return None;
        }
        let on_this = i128::from(first.timestamp_ns) - i128::from(self.sample_ns);
        if on_this.abs_diff(passed.into()) <= SAME_CLOCK_NS {
            return Some(self.lag);
        }
        // Another clock: as much time has passed as on that of this machine. The first reading of the new one is taken
        // here, at the time that it would have had on the old one.
        let first_ns = match first.temperature_time_ns() {
            0 => first.timestamp_ns,
            temperature_ns => temperature_ns,
        };
        let age = first.timestamp_ns.saturating_sub(first_ns);
        let on_old = self.sample_ns.saturating_add(passed).saturating_sub(age);
        let mut lag = self.lag;
        lag.follow(&RawSample { telemetry_ns: on_old, ..*first });
        for reading in &mut lag.sensors {
            *reading = reading.filter(|reading| reading.time_ns == on_old);
            if let Some(reading) = reading {
                reading.time_ns = first_ns;
            }
        }
        Some(lag)
    }
}

impl AcquisitionNote {
    /// Reads the note of this IMU. One that is damaged, is of another start of the machine, or does not belong to
    /// this user is none.
    pub(crate) fn load(domain: &Domain, imu: &ImuId) -> Self {
        let text = note(domain, imu).read();
        let content = text.and_then(|text| serde_json::from_slice::<NoteContent>(&text).ok());
        // A kernel that does not report its start cannot be known to be the same.
        let boot = boot();
        let noted = content.filter(|content| content.boot != 0 && content.boot == boot);
        Self { domain: domain.clone(), imu: imu.clone(), boot, noted, handed: None, writer: None }
    }

    /// Whether this IMU has sent a sample to the service since the machine was started.
    pub(crate) const fn has_sent(&self) -> bool {
        self.noted.is_some()
    }

    /// The last lag.
    pub(crate) fn lag(&self) -> Option<KeptLag> {
        self.noted?.lag
    }

    /// Notes that a sample was sent, and the lag after it: at once the first time, then once a second at most and only
    /// if there is something new. Never waits; what the disk is too slow for is tried again with the next sample.
    pub(crate) fn keep(&mut self, lag: &KeptLag) {
        if self.handed.is_none_or(|handed| handed.elapsed() >= PAUSE) {
            self.hand_over(lag);
        }
    }

    /// Notes the last lag, if a sample was sent, and waits for the disk, for a second at most.
    pub(crate) fn end(&mut self, lag: &KeptLag) {
        if self.handed.is_some() {
            self.hand_over(lag);
        }
        if let Some(writer) = self.writer.take() {
            writer.end();
        }
    }

    fn hand_over(&mut self, lag: &KeptLag) {
        let lag = (lag.lag.lag_ns != 0).then_some(*lag);
        let is_new = self.noted.is_none_or(|noted| noted.lag.map(|kept| kept.lag) != lag.map(|kept| kept.lag));
        if is_new {
            let content = NoteContent { boot: self.boot, lag };
            let start = || NoteWriter::start(note(&self.domain, &self.imu), LOSS);
            if !self.writer.get_or_insert_with(start).write(&content) {
                return;
            }
            self.noted = Some(content);
        }
        self.handed = Some(Instant::now());
    }
}

fn note(domain: &Domain, imu: &ImuId) -> Note {
    Note::new(domain, &format!("acquired-{imu}.json"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_client::{LaggedReading, Triad};

    const SECOND: u64 = 1_000_000_000;
    const TAU: u64 = 240 * SECOND;

    fn kept(at_s: u64) -> KeptLag {
        let mut lag = Lag { boot: boot(), ..Lag::new(TAU) };
        lag.sensors = [Some(LaggedReading { time_ns: 100 * SECOND, temperature: 25.3, lagged: 25.1 }); 6];
        KeptLag { lag, sample_ns: at_s * SECOND, sent_ns: at_s * SECOND }
    }

    fn sample(second: u64, temperature: f64) -> RawSample {
        let triad = Triad { head_temperature: [temperature; 3], ..Triad::default() };
        RawSample {
            timestamp_ns: second * SECOND,
            telemetry_ns: second * SECOND,
            accelerometers: triad,
            gyroscopes: triad,
            ..RawSample::default()
        }
    }

    #[test]
    fn only_a_young_lag_with_the_same_time_constant_is_gone_on_with() {
        let resumed = |lag_ns, second: u64| kept(100).resumed(&sample(second, 26.0), lag_ns, second * SECOND);
        assert_eq!([101, 2499].map(|second| resumed(TAU, second)), [Some(kept(100).lag); 2]);
        assert_eq!(resumed(TAU, 2500), None);
        assert_eq!([0, TAU + SECOND].map(|lag_ns| resumed(lag_ns, 101)), [None; 2]);
        let without = KeptLag { lag: Lag::new(TAU), ..kept(100) };
        assert_eq!(without.resumed(&sample(101, 26.0), TAU, 101 * SECOND), None);
    }

    /// 60 s pass, and 30 s after them, on the same clock and on one that began in between or ran on.
    #[test]
    fn a_clock_that_began_anew_changes_nothing() {
        let after = |first_s: u64| {
            let mut lag = kept(100).resumed(&sample(first_s, 26.0), TAU, 160 * SECOND).unwrap();
            lag.follow(&sample(first_s, 26.0));
            lag.follow(&sample(first_s + 30, 26.5));
            lag.sensors.map(|reading| reading.unwrap().lagged)
        };
        let same = after(160);
        assert!(same[0] > 25.2 && same[0] < 26.0, "{same:?}");
        for other in [1, 90, 4000].map(after) {
            assert!(other.iter().zip(&same).all(|(one, other)| (one - other).abs() < 1e-12), "{other:?} {same:?}");
        }
        // Temperature that comes every 50 s is on the same clock.
        let mut slow = kept(100);
        (slow.sample_ns, slow.sent_ns) = (149 * SECOND, 149 * SECOND);
        assert_eq!(slow.resumed(&sample(160, 26.0), TAU, 160 * SECOND), Some(slow.lag));
        // A sensor without a reading at the change is not known.
        let mut first = sample(1, 26.0);
        first.gyroscopes.head_temperature[2] = f64::NAN;
        let lag = kept(100).resumed(&first, TAU, 160 * SECOND).unwrap();
        assert_eq!(lag.sensors.map(|reading| reading.is_some()), [true, true, true, true, true, false]);
    }

    #[test]
    fn a_successor_finds_what_was_noted_and_nothing_that_is_damaged_or_of_another_start() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("root");
        std::fs::create_dir(&root).unwrap();
        let domain = Domain::new("note", root.to_str().unwrap()).unwrap();
        let imu: ImuId = "imu-a".parse().unwrap();
        let load = || AcquisitionNote::load(&domain, &imu);
        let mut first = load();
        assert!(!first.has_sent());
        // The end of an acquisition that has sent nothing is no note.
        first.end(&kept(100));
        assert!(!load().has_sent());
        let without = KeptLag { lag: Lag::default(), ..kept(100) };
        first.keep(&without);
        first.end(&without);
        assert!(load().has_sent() && load().lag().is_none());
        let mut second = load();
        let mut lag = kept(100);
        lag.lag.sensors[0] = Some(LaggedReading { time_ns: 7, temperature: 0.1 + 0.2, lagged: 1.0 / 3.0 });
        second.keep(&lag);
        second.end(&lag);
        let of_first = load().lag().unwrap().lag.sensors[0].unwrap();
        assert!((of_first.temperature - 0.3).abs() < 1e-15 && (of_first.lagged - 1.0 / 3.0).abs() < 1e-15);
        let path = note(&domain, &imu).path();
        let text = std::fs::read_to_string(&path).unwrap();
        let of_other_start = text.replace(&boot().to_string(), &(boot() ^ 1).to_string());
        for damaged in ["", "{", &of_other_start, &text[..text.len() / 2]] {
            std::fs::write(&path, damaged).unwrap();
            assert!(!load().has_sent() && load().lag().is_none(), "{damaged}");
        }
        // By the beginning of its name `isotherm clean` finds it.
        assert!(path.file_name().unwrap().to_str().unwrap().starts_with(&domain.prefix()));
    }
}
