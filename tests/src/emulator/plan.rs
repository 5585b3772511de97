//! What the program `isotherm-emulator` sends, and when: the frames, and what goes wrong with them.

use super::Emulator;
use super::own::DeviceStamp;
use std::path::PathBuf;

/// Where the frames go.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum FrameTarget {
    /// A pseudo-terminal, with this symbolic link to it.
    Terminal(Option<PathBuf>),
    /// Datagrams to this address.
    Udp(String),
    /// A TCP port of this machine; 0: any.
    Tcp(u16),
}

/// What is sent, and when.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The device.
    pub emulator: Emulator,
    /// Frames a second.
    pub rate: f64,
    /// Frames in all.
    pub frames: u64,
    /// Number of the first frame.
    pub first: u64,
    /// All frames of each so many milliseconds come together; 0: each when it is due.
    pub jitter_ms: f64,
    /// Frames that are not sent.
    pub drop: Vec<u64>,
    /// Frames with a wrong bit.
    pub wrong: Vec<u64>,
    /// Frames that come twice.
    pub double: Vec<u64>,
    /// Bytes of noise before frames: frame, count.
    pub noise: Vec<(u64, usize)>,
    /// Silence before frames: frame, seconds. The device stands still.
    pub pause: Vec<(u64, f64)>,
    /// Silence from frames on: frame, seconds. The device goes on.
    pub mute: Vec<(u64, f64)>,
    /// Frames that are held back: frame, seconds.
    pub stall: Vec<(u64, f64)>,
    /// Frames that come after the next one.
    pub swap: Vec<u64>,
    /// Other rates: first frame, frames a second; in the order of the frames.
    pub change_rate: Vec<(u64, f64)>,
    /// Whether the counter counts the time on the device's clock, and not frames.
    pub counts_time: bool,
    /// Frames before which the device starts again.
    pub reset: Vec<u64>,
    /// How long a start takes \[s\].
    pub reset_silence_s: f64,
    /// The unit's serial number.
    pub serial: String,
    /// Whether it answers what it is asked.
    pub answers: bool,
    /// Whether it is as it left its factory: it does not send these frames until it is set up.
    pub is_new: bool,
    /// Ends of connections: frame, seconds without another one, whether it is closed.
    pub disconnect: Vec<(u64, f64, bool)>,
    /// How long a reader may take to come \[s\].
    pub wait_s: f64,
    /// The file for the times.
    pub log: Option<PathBuf>,
    /// Where the frames go.
    pub place: FrameTarget,
}

impl Plan {
    /// All frames of a device at its own rate.
    pub fn new(emulator: Emulator, frames: u64) -> Self {
        Self {
            emulator,
            rate: emulator.rate(),
            frames,
            first: 0,
            jitter_ms: 0.0,
            drop: Vec::new(),
            wrong: Vec::new(),
            double: Vec::new(),
            noise: Vec::new(),
            pause: Vec::new(),
            mute: Vec::new(),
            stall: Vec::new(),
            swap: Vec::new(),
            change_rate: Vec::new(),
            counts_time: emulator.counts_time(),
            reset: Vec::new(),
            reset_silence_s: 1.0,
            serial: emulator.serial().to_owned(),
            answers: true,
            is_new: false,
            disconnect: Vec::new(),
            wait_s: 20.0,
            log: None,
            place: FrameTarget::Terminal(None),
        }
    }

    /// The numbers of all frames.
    pub fn numbers(&self) -> std::ops::Range<u64> {
        self.first..self.first.saturating_add(self.frames)
    }

    /// The frame that is written at the place of frame `number`.
    pub fn in_place_of(&self, number: u64) -> u64 {
        match self.swapped(number) {
            true => number + 1,
            false if number > self.first && self.swapped(number - 1) => number - 1,
            false => number,
        }
    }

    /// Whether this frame comes after the next one.
    fn swapped(&self, number: u64) -> bool {
        self.swap.contains(&number) && self.numbers().contains(&(number + 1))
    }

    /// Intervals from frame `from` to frame `to`, each as long as `length` says of its rate.
    fn intervals(&self, from: u64, to: u64, length: impl Fn(f64) -> f64) -> f64 {
        let ends = self.change_rate.iter().map(|(frame, _)| *frame).chain([u64::MAX]);
        let rates = [(0, self.rate)].into_iter().chain(self.change_rate.iter().copied());
        let frames = |begin: u64, end: u64| end.min(to).saturating_sub(begin.max(from)) as f64;
        rates.zip(ends).map(|((begin, rate), end)| frames(begin, end) * length(rate)).sum()
    }

    /// When a frame is due, in nanoseconds from the first: when the device has sampled it.
    pub fn due_ns(&self, number: u64) -> u64 {
        let silence: f64 = self.pause.iter().filter(|(frame, _)| *frame <= number).map(|(_, seconds)| seconds).sum();
        let resets = self.reset.iter().filter(|frame| (self.first + 1..=number).contains(*frame)).count();
        let sampled = self.intervals(self.first, number, |rate| 1.0 / rate);
        ((sampled + silence + resets as f64 * self.reset_silence_s) * 1e9).round() as u64
    }

    /// When a frame is written: when it is due, or with all others of the same milliseconds at their end, or when its
    /// adapter no longer stalls, or after the next one.
    pub fn written_ns(&self, number: u64) -> u64 {
        let number = number + u64::from(self.swapped(number));
        let due = self.due_ns(number);
        let written = match (self.jitter_ms * 1e6) as u64 {
            0 => due,
            together => due.div_ceil(together) * together,
        };
        self.within(&self.stall, due).map_or(written, |end| end.max(written))
    }

    /// Whether a frame is lost in a silence.
    pub fn is_mute(&self, number: u64) -> bool {
        self.within(&self.mute, self.due_ns(number)).is_some()
    }

    /// The end of the period in which a moment is: one of those that begin with a frame and last so many seconds.
    fn within(&self, periods: &[(u64, f64)], moment_ns: u64) -> Option<u64> {
        let all = periods.iter().map(|(frame, seconds)| {
            let begin = self.due_ns(*frame);
            begin..begin + (seconds * 1e9) as u64
        });
        all.filter(|period| period.contains(&moment_ns)).map(|period| period.end).max()
    }

    /// What the device's counter and clock say with a frame.
    pub fn own(&self, number: u64) -> DeviceStamp {
        let reset = self.reset.iter().filter(|frame| **frame <= number).max();
        let powered = reset.copied().unwrap_or(0);
        DeviceStamp {
            frames: number - powered,
            intervals: self.intervals(powered, number, |rate| self.rate / rate),
            counts_time: self.counts_time,
            was_reset: reset.is_some(),
        }
    }

    /// What is written for a frame, noise before it included; nothing for one that is lost.
    pub fn bytes(&self, number: u64) -> Vec<u8> {
        if self.is_mute(number) {
            return Vec::new();
        }
        let mut bytes: Vec<u8> = self.noise.iter().filter(|(frame, _)| *frame == number).flat_map(noise).collect();
        if self.reset.contains(&number) {
            bytes.extend(self.emulator.greeting(&self.serial));
        }
        if self.drop.contains(&number) {
            return bytes;
        }
        let mut frame = self.emulator.frame_at(number, self.own(number));
        if self.wrong.contains(&number) {
            // In the last message of the frame, and in no line's end.
            let place = frame.len() - 8;
            frame[place] ^= 0x10;
        }
        let times = if self.double.contains(&number) { 2 } else { 1 };
        bytes.extend(frame.repeat(times));
        bytes
    }
}

/// Noise: the same for the same frame.
fn noise(&(frame, count): &(u64, usize)) -> Vec<u8> {
    let mut state = frame.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    (0..count)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u8
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_due_at_the_rate_and_come_in_bursts() {
        let mut plan = Plan::new(Emulator::Vn100, 100);
        assert_eq!([0, 1, 40].map(|number| plan.due_ns(number)), [0, 2_500_000, 100_000_000]);
        assert_eq!(plan.written_ns(7), plan.due_ns(7));
        plan.jitter_ms = 16.0;
        assert_eq!([0, 1, 6, 7].map(|number| plan.written_ns(number)), [0, 16_000_000, 16_000_000, 32_000_000]);
        plan.pause = vec![(2, 1.0)];
        assert_eq!([1, 2].map(|number| plan.due_ns(number)), [2_500_000, 1_005_000_000]);
    }

    #[test]
    fn faults_are_where_they_were_ordered() {
        for emulator in Emulator::ALL {
            let mut plan = Plan::new(emulator, 10);
            (plan.drop, plan.wrong, plan.double, plan.noise) = (vec![1], vec![2], vec![3], vec![(4, 1000), (1, 5)]);
            let good = |number| emulator.frame(number);
            assert_eq!(plan.bytes(0), good(0));
            assert_eq!(plan.bytes(1).len(), 5);
            let differ = plan.bytes(2).iter().zip(good(2)).filter(|(a, b)| **a != *b).count();
            assert_eq!((plan.bytes(2).len(), differ), (good(2).len(), 1));
            assert_eq!(plan.bytes(3), good(3).repeat(2));
            assert_eq!(plan.bytes(4)[1000..], good(4));
            assert_eq!(plan.bytes(4), plan.bytes(4));
        }
    }

    #[test]
    fn the_device_goes_on_while_its_adapter_stalls_or_nothing_comes() {
        let mut plan = Plan::new(Emulator::Vn100, 1000);
        (plan.mute, plan.stall) = (vec![(10, 0.0125)], vec![(100, 0.0125)]);
        let lost: Vec<_> = plan.numbers().filter(|number| plan.bytes(*number).is_empty()).collect();
        assert_eq!(lost, [10, 11, 12, 13, 14]);
        assert_eq!(plan.bytes(15), Emulator::Vn100.frame(15));
        assert_eq!(plan.due_ns(101), 252_500_000);
        assert_eq!(
            [99, 100, 104, 105].map(|number| plan.written_ns(number)),
            [247_500_000, 262_500_000, 262_500_000, 262_500_000]
        );
        assert_eq!(plan.written_ns(106), plan.due_ns(106));
    }

    #[test]
    fn a_pair_is_exchanged() {
        let mut plan = Plan::new(Emulator::Vn100, 6);
        plan.swap = vec![2, 5];
        assert_eq!(plan.numbers().map(|number| plan.in_place_of(number)).collect::<Vec<_>>(), [0, 1, 3, 2, 4, 5]);
        assert_eq!(plan.written_ns(2), plan.written_ns(3));
        assert_eq!(plan.written_ns(5), plan.due_ns(5));
    }

    #[test]
    fn clock_and_counter_keep_their_pace_when_the_rate_changes() {
        let mut plan = Plan::new(Emulator::Stim300, 100);
        plan.change_rate = vec![(10, 250.0), (20, 1000.0)];
        let counters = [0, 9, 10, 11, 20, 21].map(|number| plan.bytes(number)[35]);
        assert_eq!(counters, [0, 18, 20, 28, 100, 102]);
        assert_eq!(
            [10, 11, 20, 21].map(|number| plan.due_ns(number)),
            [10_000_000, 14_000_000, 50_000_000, 51_000_000]
        );
        plan.counts_time = false;
        assert_eq!([9, 10, 11, 20].map(|number| plan.bytes(number)[35]), [18, 20, 22, 40]);
        let mut plan = Plan::new(Emulator::Vn100, 100);
        plan.change_rate = vec![(0, 200.0)];
        let time = |number| u64::from_le_bytes(plan.bytes(number)[6..14].try_into().unwrap());
        assert_eq!([0, 1, 3].map(time), [1_000_000_000, 1_005_000_000, 1_015_000_000]);
    }

    #[test]
    fn after_a_reset_counter_and_clock_begin_at_0() {
        let mut plan = Plan::new(Emulator::Arduino, 100);
        (plan.reset, plan.reset_silence_s) = (vec![50], 0.5);
        let line = |number| String::from_utf8(plan.bytes(number)).unwrap();
        assert!(line(49).starts_with("$IMU,13,113928,"), "{}", line(49));
        assert!(line(50).starts_with("$IMU,0,0,") && line(51).starts_with("$IMU,1,5000,"), "{}", line(51));
        assert_eq!(plan.due_ns(50) - plan.due_ns(49), 505_000_000);
        for emulator in Emulator::ALL {
            let mut plan = Plan::new(emulator, 100);
            plan.reset = vec![50];
            assert!(plan.bytes(50).starts_with(&emulator.greeting(emulator.serial())));
            assert_ne!(plan.bytes(50), emulator.frame(50), "{emulator:?}");
        }
    }
}
