//! Devices, transports and outages on a virtual clock: where frames are placed, against what is true.

use crate::frames::FrameArrival;
use crate::timeline::{Counter, DeviceClock, FrameObservation, FramePlace, FramePlacement, Timeline};

/// A generator of numbers that seem random: the same for the same seed.
#[derive(Clone)]
pub(super) struct Random(pub(super) u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// From 0 to 1.
    pub(super) fn part(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.part()
    }
}

/// How a device numbers its frames.
#[derive(Clone, Copy, Debug)]
pub(super) enum Numbers {
    /// A counter of so many bits that rises by the step every described interval of true time.
    CountsTime(u32, u64),
    /// A counter of so many bits that rises by 1 with each frame.
    CountsFrames(u32),
    /// A clock of this unit \[ns\].
    Clock(u64),
    Nothing,
}

/// How bytes come to the reader.
#[derive(Clone, Copy, Debug)]
pub(super) enum Transport {
    /// Late by up to so much \[ns\].
    Late(f64),
    /// At the next multiple of so much \[ns\].
    Bursts(f64),
}

impl Transport {
    /// The jitter \[ns\].
    fn jitter(self) -> f64 {
        match self {
            Self::Late(limit) | Self::Bursts(limit) => limit,
        }
    }
}

/// What happens to the frames.
#[derive(Clone, Copy, Debug)]
pub(super) enum Event {
    /// Nothing.
    Nothing,
    /// They are sampled and lost for so long \[s\].
    Silence(f64),
    /// As `Silence`, and the device was away.
    Unplugged(f64),
    /// The reader does not read for so long \[s\]; the line holds so many frames.
    Stalled(f64, usize),
    /// The adapter delivers nothing for so long \[s\], and then all.
    Delayed(f64),
    /// From then on another rate: so many described intervals a frame.
    Rate(f64),
    /// The device starts again after so long \[s\].
    Reset(f64),
    /// A datagram overtakes the one before, every so many frames.
    Overtaken(u64),
    /// One frame of so many is lost.
    Lossy(u64),
}

pub(super) struct World {
    pub(super) numbers: Numbers,
    pub(super) transport: Transport,
    pub(super) event: Event,
    pub(super) interval_ns: f64,
    pub(super) seed: u64,
}

/// A frame and where it was placed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Result {
    /// When it was sampled \[ns\].
    pub(super) time: f64,
    /// Its number, in described intervals since the beginning.
    pub(super) number: f64,
    /// How long it waited \[ns\].
    pub(super) waited: f64,
    pub(super) after: bool,
    pub(super) placed: FramePlacement,
}

impl World {
    /// The jitter of the whole way \[ns\].
    pub(super) fn jitter(&self) -> f64 {
        self.transport.jitter() + SCHEDULED_NS
    }

    /// Runs it: 4 to 5 s before the event, and 4 s after it.
    pub(super) fn run(&self) -> Vec<Result> {
        let mut random = Random(self.seed);
        let drift = 1.0 + random.between(-50e-6, 50e-6);
        let before_ns = 4e9 + random.between(0.0, 1e9);
        let frames = self.frames(&mut random, drift, before_ns);
        let read = self.read(&mut random, frames, before_ns);
        self.place(&read)
    }

    /// The frames of the device.
    fn frames(&self, random: &mut Random, drift: f64, before_ns: f64) -> Vec<Frame> {
        let begin = 5e9 + random.between(0.0, 1e9);
        let mut frames = Vec::new();
        let (mut time, mut started, mut frame_number, mut ratio) = (begin, begin - 3e9, 0u64, 1.0);
        let mut is_after = false;
        let counter = random.next();
        while time < begin + before_ns + 4e9 + self.length() * 1e9 {
            if !is_after && time >= begin + before_ns {
                is_after = true;
                match self.event {
                    Event::Rate(of) => ratio = of,
                    Event::Reset(seconds) => {
                        time += seconds * 1e9 + random.part() * self.interval_ns;
                        (started, frame_number) = (time, 0);
                    }
                    _ => {}
                }
            }
            let passed = (time - started) / drift;
            let (counter, clock_ns) = match self.numbers {
                Numbers::CountsTime(bits, step) => {
                    let count = (passed / self.interval_ns * step as f64).round() as u64;
                    let offset = if started < begin { counter / step * step } else { 0 };
                    (Some(wrap(count.wrapping_add(offset), bits)), None)
                }
                Numbers::CountsFrames(bits) => {
                    let offset = if started < begin { counter } else { 0 };
                    (Some(wrap(frame_number.wrapping_add(offset), bits)), None)
                }
                Numbers::Clock(unit) => (None, Some((passed as u64) / unit * unit)),
                Numbers::Nothing => (None, None),
            };
            let number = (time - begin) / drift / self.interval_ns;
            frames.push(Frame {
                time,
                number,
                counter,
                clock_ns,
                is_after,
                damaged: 0,
                is_lost: false,
                after_outage: false,
            });
            frame_number += 1;
            time += self.interval_ns * ratio * drift;
        }
        self.lose(random, &mut frames, begin + before_ns);
        frames
    }

    fn length(&self) -> f64 {
        match self.event {
            Event::Silence(s) | Event::Unplugged(s) | Event::Stalled(s, _) | Event::Delayed(s) | Event::Reset(s) => s,
            _ => 0.0,
        }
    }

    fn lose(&self, random: &mut Random, frames: &mut [Frame], at: f64) {
        let end = at + self.length() * 1e9;
        for (index, frame) in frames.iter_mut().enumerate() {
            frame.is_lost = match self.event {
                Event::Silence(_) | Event::Unplugged(_) => (at..end).contains(&frame.time),
                Event::Lossy(one_in) => frame.is_after && random.next().is_multiple_of(one_in),
                _ => false,
            };
            // The end of the beginning.
            frame.is_lost |= index == 0;
        }
        if let (Event::Unplugged(_), Some(first)) = (self.event, frames.iter_mut().find(|frame| frame.time >= end)) {
            first.after_outage = true;
        }
    }

    /// The frames as the reader sees them.
    fn read(&self, random: &mut Random, frames: Vec<Frame>, before_ns: f64) -> Vec<(Frame, FrameArrival)> {
        let begin = frames[0].time;
        let at = begin + before_ns;
        let (mut arrived, mut latest) = (Vec::new(), 0.0f64);
        for frame in frames.into_iter().filter(|frame| !frame.is_lost) {
            let mut arrival = match self.transport {
                Transport::Late(limit) => frame.time + random.part() * limit,
                Transport::Bursts(each) => (frame.time / each).ceil() * each,
            };
            if let Event::Delayed(seconds) = self.event
                && (at..at + seconds * 1e9).contains(&arrival)
            {
                arrival = at + seconds * 1e9;
            }
            latest = latest.max(arrival);
            arrived.push((frame, latest));
        }
        if let Event::Overtaken(each) = self.event {
            for pair in arrived.chunks_exact_mut(each as usize) {
                let arrivals = [pair[0].1, pair[1].1];
                pair.swap(0, 1);
                (pair[0].1, pair[1].1) = (arrivals[0], arrivals[1]);
            }
        }
        let mut read = Vec::new();
        let (mut empty, mut index, mut held) = (begin, 0, 0usize);
        while let Some((_, arrival)) = arrived.get(index) {
            let mut now = arrival.max(empty) + random.part() * random.part() * SCHEDULED_NS;
            let mut room = usize::MAX;
            if let Event::Stalled(seconds, limit) = self.event
                && (at..at + seconds * 1e9).contains(&now)
            {
                (now, room) = (at + seconds * 1e9, limit);
            } else {
                // It looks every 20 ms, and before that.
                empty = empty.max(arrival - random.part() * 20e6);
            }
            let mut is_first_lost = false;
            while let Some((frame, _)) = arrived.get(index).filter(|(_, arrival)| *arrival <= now) {
                if held < room {
                    let damaged = u64::from(std::mem::take(&mut is_first_lost) && random.next().is_multiple_of(2));
                    read.push((
                        Frame { damaged, ..*frame },
                        FrameArrival { after_ns: empty as u64, by_ns: now as u64 },
                    ));
                } else {
                    is_first_lost = true;
                }
                held += 1;
                index += 1;
            }
            (empty, held) = (now, 0);
        }
        read
    }

    fn place(&self, read: &[(Frame, FrameArrival)]) -> Vec<Result> {
        let counter = match self.numbers {
            Numbers::CountsTime(bits, step) => Some(Counter { bits, step }),
            Numbers::CountsFrames(bits) => Some(Counter { bits, step: 1 }),
            _ => None,
        };
        let clock = matches!(self.numbers, Numbers::Clock(_)).then_some(DeviceClock { turn_ns: None });
        let mut timeline = Timeline::new(self.interval_ns as u64, counter, clock);
        if matches!(self.event, Event::Overtaken(_)) {
            timeline = timeline.of_datagrams();
        }
        let mut results = Vec::new();
        let mut collect = |timeline: &mut Timeline<(Frame, u64)>, now: u64| {
            while let Some((placed, (frame, by_ns))) = timeline.next() {
                let Frame { time, number, is_after, .. } = frame;
                results.push(Result { time, number, waited: (now - by_ns) as f64, after: is_after, placed });
            }
        };
        let mut now = 0;
        for (frame, arrival) in read {
            // The loop looks at least so often.
            while now > 0 && now + 20_000_000 < arrival.by_ns && timeline.is_waiting() {
                now += 20_000_000;
                timeline.look(now);
                collect(&mut timeline, now);
            }
            now = arrival.by_ns;
            if frame.after_outage {
                timeline.settle_all();
                collect(&mut timeline, now);
            }
            let observed = FrameObservation {
                arrival: Some(*arrival),
                counter: frame.counter,
                clock_ns: frame.clock_ns,
                damaged: frame.damaged,
                after_outage: frame.after_outage,
                is_same: false,
            };
            timeline.push(observed, (*frame, now));
            collect(&mut timeline, now);
        }
        timeline.settle_all();
        collect(&mut timeline, now);
        results
    }
}

/// How late the reader is at most \[ns\].
const SCHEDULED_NS: f64 = 400e3;

#[derive(Clone, Copy, Debug)]
struct Frame {
    time: f64,
    number: f64,
    counter: Option<u64>,
    clock_ns: Option<u64>,
    is_after: bool,
    damaged: u64,
    is_lost: bool,
    after_outage: bool,
}

fn wrap(count: u64, bits: u32) -> u64 {
    if bits >= 64 { count } else { count & ((1 << bits) - 1) }
}

/// What a run shows.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    /// Largest error of a stamp, over an interval and the jitter \[ns\].
    pub(super) stamp: f64,
    /// Gaps of a wrong length that are not said to be uncertain.
    pub(super) wrong: u64,
    pub(super) ambiguous: u64,
    pub(super) sessions: u64,
    /// Stamps that are not an interval after the one before, though none is missing.
    pub(super) steps: u64,
    pub(super) gaps: u64,
    pub(super) longest_wait: f64,
    /// Frames after the event of which the interval is wrong by a factor, though it is said to be certain.
    pub(super) false_interval: u64,
    pub(super) uncertain: u64,
    pub(super) repeated: u64,
}

impl World {
    /// Compares where frames were placed with what is true.
    pub(super) fn seen(&self) -> Seen {
        let results = self.run();
        let mut seen = Seen::default();
        let has_clock = matches!(self.numbers, Numbers::Clock(_));
        let (mut before, mut base) = (None::<Result>, 0.0);
        for result in results {
            let placed = result.placed;
            let stamp = placed.timestamp_ns as f64;
            seen.longest_wait = seen.longest_wait.max(if before.is_some_and(|before| before.number > 100.0) {
                result.waited
            } else {
                0.0
            });
            match placed.place {
                FramePlace::Repeated => {
                    seen.repeated += 1;
                    continue;
                }
                FramePlace::First => {
                    seen.sessions += 1;
                    base = if has_clock { stamp - result.time } else { 0.0 };
                }
                FramePlace::Next { periods, is_ambiguous } => {
                    let Some(before) = before else { panic!("no first frame") };
                    let interval = placed.interval_ns as f64;
                    let truth = (result.time - before.time) / interval;
                    seen.gaps += u64::from(periods > 1);
                    seen.ambiguous += u64::from(is_ambiguous);
                    seen.wrong += u64::from(!is_ambiguous && (periods as f64 - truth).abs() > 0.6);
                    let step = stamp - before.placed.timestamp_ns as f64;
                    seen.steps += u64::from(periods == 1 && (2.0 * (step - interval)).abs() > interval);
                }
            }
            let error = (stamp - base - result.time).abs();
            let allowed = self.interval_ns.max(placed.interval_ns as f64) + self.jitter();
            seen.stamp = seen.stamp.max(error - allowed);
            if let (true, Event::Rate(ratio)) = (result.after, self.event) {
                let is_other = (placed.interval_ns as f64 / self.interval_ns / ratio - 1.0).abs() > 0.06;
                seen.false_interval += u64::from(is_other && placed.is_certain);
            }
            seen.uncertain += u64::from(!placed.is_certain);
            before = Some(result);
        }
        seen
    }
}
