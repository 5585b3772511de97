//! What an acquisition notes in the domain's folder for its successor: that this IMU has sent a sample since the machine
//! was started, and the lag of its temperatures.

use isotherm_client::{Domain, ImuId, Lag, Note, boot, monotonic_ns};
use isotherm_failure::tell;
use serde::{Deserialize, Serialize};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// The lag is noted so often at most, and so long the end waits for the disk.
const PAUSE: Duration = Duration::from_secs(1);
/// A lag that is older than this many time constants tells nothing: the temperatures may have done anything meanwhile.
const MOST_TIME_CONSTANTS: u64 = 10;

/// The note of one IMU.
///
/// The domain's folder may be on a disk, which may let a writer wait. So a thread of its own writes, and the sample path
/// hands it the newest content.
pub(crate) struct AcquisitionNote {
    domain: Domain,
    imu: ImuId,
    /// The machine's start; 0 = unknown.
    boot: u64,
    /// What is noted, if it is of this start of the machine.
    noted: Option<Content>,
    /// When something was handed to the thread.
    handed: Option<Instant>,
    writer: Option<Writer>,
}

/// What is in the file. It exists only if a sample was sent.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
struct Content {
    /// The machine's start, in which the sample was sent.
    boot: u64,
    /// The lag; `None` while the table has no time constant.
    lag: Option<Lag>,
}

struct Writer {
    contents: SyncSender<Content>,
    ended: Receiver<()>,
}

impl AcquisitionNote {
    /// Reads the note of this IMU. One that is damaged, is of another start of the machine, or belongs to neither this
    /// user nor the domain's group is none.
    pub(crate) fn load(domain: &Domain, imu: &ImuId) -> Self {
        let text = note(domain, imu).read_from_members(domain);
        let content = text.and_then(|text| serde_json::from_slice::<Content>(&text).ok());
        // A kernel that does not tell its start cannot be known to be the same.
        let boot = boot();
        let noted = content.filter(|content| content.boot != 0 && content.boot == boot);
        Self { domain: domain.clone(), imu: imu.clone(), boot, noted, handed: None, writer: None }
    }

    /// Whether this IMU has sent a sample to the service since the machine was started.
    pub(crate) const fn has_sent(&self) -> bool {
        self.noted.is_some()
    }

    /// The last lag, if it can be gone on with under this time constant \[ns\]: it has the same one, and is younger than
    /// ten of them. A sensor whose last reading is older has none.
    pub(crate) fn lag(&self, lag_ns: u64) -> Option<Lag> {
        young(&self.noted?.lag?, lag_ns, monotonic_ns())
    }

    /// Notes that a sample was sent, and the lag after it: at once the first time, then once a second at most and only
    /// if there is something new. Never waits; what the disk is too slow for is tried again with the next sample.
    pub(crate) fn keep(&mut self, lag: &Lag) {
        if self.handed.is_none_or(|handed| handed.elapsed() >= PAUSE) {
            self.hand_over(lag);
        }
    }

    /// Notes the last lag, if a sample was sent, and waits for the disk, for a second at most.
    pub(crate) fn end(&mut self, lag: &Lag) {
        if self.handed.is_some() {
            self.hand_over(lag);
        }
        if let Some(Writer { contents, ended }) = self.writer.take() {
            drop(contents);
            // The thread ends, or the disk hangs.
            let _ = ended.recv_timeout(PAUSE);
        }
    }

    fn hand_over(&mut self, lag: &Lag) {
        let content = Content { boot: self.boot, lag: (lag.lag_ns != 0).then_some(*lag) };
        if self.noted != Some(content) {
            let writer = self.writer.get_or_insert_with(|| Writer::start(&self.domain, &self.imu));
            if let Err(TrySendError::Full(_)) = writer.contents.try_send(content) {
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

/// The sensors of a lag whose last reading is young enough at `now_ns`; `None` if there is none, or its time constant is
/// another one.
pub(crate) fn young(lag: &Lag, lag_ns: u64, now_ns: u64) -> Option<Lag> {
    let longest = lag_ns.saturating_mul(MOST_TIME_CONSTANTS);
    let mut young = *lag;
    for reading in &mut young.sensors {
        *reading = reading.filter(|reading| now_ns.saturating_sub(reading.time_ns) < longest);
    }
    (lag.lag_ns == lag_ns && young.sensors.iter().any(Option::is_some)).then_some(young)
}

impl Writer {
    /// Starts the thread. Without it nothing is noted, which is told.
    fn start(domain: &Domain, imu: &ImuId) -> Self {
        let (contents, received) = sync_channel(1);
        let (end, ended) = sync_channel(1);
        let (domain, note) = (domain.clone(), note(domain, imu));
        let body = move || {
            write(&domain, &note, &received);
            let _ = end.send(());
        };
        if let Err(error) = thread::Builder::new().name("note".to_owned()).spawn(body) {
            refused(&error);
        }
        Self { contents, ended }
    }
}

fn write(domain: &Domain, note: &Note, contents: &Receiver<Content>) {
    let mut is_told = false;
    for content in contents {
        let text = serde_json::to_vec(&content).map_err(std::io::Error::from);
        match text.and_then(|text| note.write(&text)) {
            Ok(()) => note.open_to_members(domain),
            Err(error) if !is_told => {
                is_told = true;
                refused(&error);
            }
            Err(_) => {}
        }
    }
}

fn refused(error: &std::io::Error) {
    let message = "the domain's folder does not take the note for the next acquisition, which will not know the lag";
    tell("isotherm", format!("warning: {message}: {error}"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_client::LaggedReading;

    const SECOND: u64 = 1_000_000_000;

    fn lag(boot: u64) -> Lag {
        let mut lag = Lag { boot, ..Lag::new(240 * SECOND) };
        lag.sensors = [Some(LaggedReading { time_ns: 100 * SECOND, telemetry: 25.3, lagged: 25.1 }); 6];
        lag
    }

    #[test]
    fn only_young_readings_under_the_same_time_constant_are_gone_on_with() {
        let mut of_two = lag(1);
        of_two.sensors[3] = Some(LaggedReading { time_ns: 2000 * SECOND, telemetry: 30.0, lagged: 29.0 });
        assert_eq!(young(&of_two, 240 * SECOND, 2499 * SECOND), Some(of_two));
        let later = young(&of_two, 240 * SECOND, 2501 * SECOND).unwrap();
        assert_eq!(later.sensors.map(|reading| reading.is_some()), [false, false, false, true, false, false]);
        assert_eq!(young(&of_two, 240 * SECOND, 5000 * SECOND), None);
        assert_eq!([0, 241 * SECOND].map(|lag_ns| young(&of_two, lag_ns, 101 * SECOND)), [None; 2]);
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
        first.end(&lag(boot()));
        assert!(!load().has_sent());
        let without = Lag { boot: boot(), ..Lag::default() };
        first.keep(&without);
        first.end(&without);
        assert!(load().has_sent() && load().lag(0).is_none());
        let (mut second, now) = (load(), monotonic_ns());
        let mut young = lag(boot());
        young.sensors[0] = Some(LaggedReading { time_ns: now, telemetry: 0.1 + 0.2, lagged: 1.0 / 3.0 });
        second.keep(&young);
        second.end(&young);
        let kept = load().lag(240 * SECOND).unwrap();
        let of_first = kept.sensors[0].unwrap();
        assert!((of_first.telemetry - 0.3).abs() < 1e-15 && (of_first.lagged - 1.0 / 3.0).abs() < 1e-15, "{kept:?}");
        assert_eq!(load().lag(241 * SECOND), None);
        let path = note(&domain, &imu).path();
        let text = std::fs::read_to_string(&path).unwrap();
        for damaged in ["", "{", &text.replace(&boot().to_string(), &(boot() ^ 1).to_string()), &text[..text.len() / 2]]
        {
            std::fs::write(&path, damaged).unwrap();
            assert!(!load().has_sent() && load().lag(240 * SECOND).is_none(), "{damaged}");
        }
        // By the names of all files of the domain `isotherm clean` finds them.
        assert!(path.file_name().unwrap().to_str().unwrap().starts_with(&domain.prefix()));
    }
}
