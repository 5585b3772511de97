//! What the program `isotherm-emulator` sends, and when: the frames, and what goes wrong with them.

use super::Emulator;
use std::path::PathBuf;

/// How the program is called.
pub const USAGE: &str = "\
isotherm-emulator PROFILE [--rate HZ] --frames N [--first N] [--jitter-ms J] [--drop N,..] [--wrong N,..]
                  [--double N,..] [--noise BYTES@N,..] [--pause N:SECONDS,..] [--wait SECONDS] [--log FILE] [--link PATH]
PROFILE  stim300, stim300-rate, kvh1750, vn100, mtdata2, arduino-mpu6050, or the path of such a file
rate     frames a second; that of the profile unless given. The device's clock runs at that of the profile
first    the number of the first frame, as of a device that was on before; 0 unless given
jitter   all frames of each J ms come together, as over USB
drop     these frames, numbered from 0, are not sent
wrong    one bit of them is wrong
double   they come twice
noise    so many bytes of noise before frame N
pause    so many seconds of silence before frame N; no frame is lost
wait     so long a reader may take to open the terminal; 20 s unless given
log      at the end, a line for each frame: its number, when it was written, when it was due [ns, CLOCK_MONOTONIC]
link     a symbolic link to the terminal, as long as the program runs";

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
    /// Silence before frames: frame, seconds.
    pub pause: Vec<(u64, f64)>,
    /// How long a reader may take to come \[s\].
    pub wait_s: f64,
    /// The file for the times.
    pub log: Option<PathBuf>,
    /// The symbolic link.
    pub link: Option<PathBuf>,
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
            wait_s: 20.0,
            log: None,
            link: None,
        }
    }

    /// Reads the arguments of the program.
    ///
    /// # Errors
    ///
    /// What is wrong with them, as a sentence.
    pub fn parse(arguments: &[String]) -> Result<Self, String> {
        let Some((profile, options)) = arguments.split_first() else {
            return Err("a profile is missing".into());
        };
        let emulator = Emulator::of_profile(profile).ok_or_else(|| format!("no emulator has the profile {profile}"))?;
        let mut plan = Self::new(emulator, 0);
        for option in options.chunks(2) {
            let [name, value] = option else {
                return Err(format!("{} has no value", option[0]));
            };
            plan.set(name, value)?;
        }
        if plan.frames == 0 {
            return Err("--frames is missing, or 0".into());
        }
        Ok(plan)
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), String> {
        let wrong = || format!("{name} cannot be {value}");
        let number =
            || value.parse().ok().filter(|number: &f64| number.is_finite() && *number >= 0.0).ok_or_else(wrong);
        match name {
            "--rate" => self.rate = Some(number()?).filter(|rate| *rate > 0.0).ok_or_else(wrong)?,
            "--frames" => self.frames = value.parse().map_err(|_| wrong())?,
            "--first" => self.first = value.parse().map_err(|_| wrong())?,
            "--jitter-ms" => self.jitter_ms = number()?,
            "--drop" => self.drop = list(value).ok_or_else(wrong)?,
            "--wrong" => self.wrong = list(value).ok_or_else(wrong)?,
            "--double" => self.double = list(value).ok_or_else(wrong)?,
            "--noise" => {
                let pairs: Option<Vec<(usize, u64)>> = pairs(value, '@');
                self.noise = pairs.ok_or_else(wrong)?.into_iter().map(|(bytes, frame)| (frame, bytes)).collect();
            }
            "--pause" => self.pause = pairs(value, ':').ok_or_else(wrong)?,
            "--wait" => self.wait_s = number()?,
            "--log" => self.log = Some(value.into()),
            "--link" => self.link = Some(value.into()),
            _ => return Err(format!("there is no option {name}")),
        }
        Ok(())
    }

    /// The numbers of all frames.
    pub fn numbers(&self) -> std::ops::Range<u64> {
        self.first..self.first.saturating_add(self.frames)
    }

    /// When a frame is due, in nanoseconds from the first.
    pub fn due_ns(&self, number: u64) -> u64 {
        let silence: f64 = self.pause.iter().filter(|(frame, _)| *frame <= number).map(|(_, seconds)| seconds).sum();
        ((number.saturating_sub(self.first) as f64 / self.rate + silence) * 1e9).round() as u64
    }

    /// When a frame is written: when it is due, or with all others of the same milliseconds at their end.
    pub fn written_ns(&self, number: u64) -> u64 {
        let due = self.due_ns(number);
        match (self.jitter_ms * 1e6) as u64 {
            0 => due,
            together => due.div_ceil(together) * together,
        }
    }

    /// What is written for a frame, noise before it included.
    pub fn bytes(&self, number: u64) -> Vec<u8> {
        let mut bytes: Vec<u8> = self.noise.iter().filter(|(frame, _)| *frame == number).flat_map(noise).collect();
        if self.drop.contains(&number) {
            return bytes;
        }
        let mut frame = self.emulator.frame(number);
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

fn list(text: &str) -> Option<Vec<u64>> {
    text.split(',').map(|number| number.parse().ok()).collect()
}

fn pairs<A: std::str::FromStr, B: std::str::FromStr>(text: &str, separator: char) -> Option<Vec<(A, B)>> {
    let pair = |pair: &str| {
        let (first, second) = pair.split_once(separator)?;
        Some((first.parse().ok()?, second.parse().ok()?))
    };
    text.split(',').map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Plan, String> {
        Plan::parse(&text.split(' ').map(str::to_owned).collect::<Vec<_>>())
    }

    #[test]
    fn arguments_are_read() {
        let plan = parse(
            "examples/acquire/kvh1750.toml --frames 9 --first 5 --rate 500 --jitter-ms 4 --drop 1,2 --wrong 3 --double 4 --noise 7@5,9@6 \
             --pause 3:0.5 --wait 1 --log l --link p",
        )
        .unwrap();
        assert_eq!((plan.emulator, plan.frames, plan.rate, plan.wait_s), (Emulator::Kvh1750, 9, 500.0, 1.0));
        assert_eq!((plan.numbers(), plan.due_ns(6) - plan.due_ns(5)), (5..14, 2_000_000));
        assert_eq!((plan.drop, plan.wrong, plan.double), (vec![1, 2], vec![3], vec![4]));
        assert_eq!((plan.noise, plan.pause), (vec![(5, 7), (6, 9)], vec![(3, 0.5)]));
        assert_eq!((plan.log, plan.link), (Some("l".into()), Some("p".into())));
        assert_eq!(parse("vn100 --frames 3").unwrap(), Plan::new(Emulator::Vn100, 3));
    }

    #[test]
    fn wrong_arguments_are_named() {
        for (text, reason) in [
            ("", "no emulator has the profile "),
            ("bmi270", "no emulator has the profile bmi270"),
            ("vn100", "--frames is missing, or 0"),
            ("vn100 --frames", "--frames has no value"),
            ("vn100 --frames 3 --rate 0", "--rate cannot be 0"),
            ("vn100 --frames 3 --rate nan", "--rate cannot be nan"),
            ("vn100 --frames 3 --pause 4", "--pause cannot be 4"),
            ("vn100 --frames 3 --noise x@4", "--noise cannot be x@4"),
            ("vn100 --frames 3 --drop 1,", "--drop cannot be 1,"),
            ("vn100 --frames 3 --speed 1", "there is no option --speed"),
        ] {
            assert_eq!(parse(text), Err(reason.to_owned()), "{text}");
        }
    }

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
}
