//! The arguments of the program `isotherm-emulator`.

use super::Emulator;
use super::plan::{FrameTarget, Plan};

/// How the program is called.
pub const USAGE: &str = "\
isotherm-emulator PROFILE [--rate HZ] --frames N [--first N] [--jitter-ms J] [--drop N,..] [--wrong N,..]
                  [--double N,..] [--noise BYTES@N,..] [--pause N:SECONDS,..] [--mute N:SECONDS,..]
                  [--stall N:SECONDS,..] [--swap-order N,..] [--change-rate N:HZ,..] [--counter frames|time]
                  [--reset N,..] [--reset-silence SECONDS] [--serial NUMBER] [--answers on|off] [--output set|new]
                  [--udp HOST:PORT | --tcp PORT]
                  [--drop-connection N:SECONDS,..] [--close-connection N:SECONDS,..]
                  [--wait SECONDS] [--log FILE] [--link PATH]
PROFILE  stim300, stim300-rate, kvh1750, vn100, mtdata2, arduino-mpu6050, or the path of such a file
rate     frames a second; that of the profile unless given. The device's clock runs at that of the profile
first    the number of the first frame, as of a device that was on before; 0 unless given
jitter   all frames of each J ms come together, as over USB
drop     these frames, numbered from 0, are not sent
wrong    one bit of them is wrong
double   they come twice
noise    so many bytes of noise before frame N
pause    so many seconds of silence before frame N; the device and its clock stand still, and no frame is lost
mute     from frame N on, the frames of so many seconds are lost; the device and its clock go on
stall    from frame N on, the frames of so many seconds come together at their end, as from an adapter that stalled
swap-order       frame N comes after frame N + 1
change-rate      from frame N on so many frames a second; the device's clock keeps its pace
counter          what the counter counts: frames, or time on the device's clock; as in the data sheet unless given
reset            the device starts again before frame N: its counter and its clock begin at 0, and it says what it says
                 when it was powered
reset-silence    how long that takes; 1 s unless given
serial   the device's serial number; one of the device's unless given
answers  whether the device answers what it is asked; on unless given
output   set: the device sends frames as the profile describes them; new: not before it is set up so
udp      each frame is a datagram to this address, and there is no terminal
tcp      a port of this machine that takes connections, one at a time, and there is no terminal; 0: any, see the output
drop-connection  at frame N the peer vanishes: the connection stays open, but nothing comes over it any more; for so
                 many seconds no other one is taken
close-connection the same, but the connection is closed
wait     so long a reader may take to open the terminal, or to connect; 20 s unless given
log      at the end, a line for each frame: its number, when it was written, when it was due [ns, CLOCK_MONOTONIC]
link     a symbolic link to the terminal, as long as the program runs";

impl Plan {
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
            "--pause" => self.pause = seconds(value).ok_or_else(wrong)?,
            "--mute" => self.mute = seconds(value).ok_or_else(wrong)?,
            "--stall" => self.stall = seconds(value).ok_or_else(wrong)?,
            "--swap-order" => self.swap = list(value).ok_or_else(wrong)?,
            "--change-rate" => {
                self.change_rate =
                    seconds(value).filter(|all| all.iter().all(|(_, hz)| *hz > 0.0)).ok_or_else(wrong)?;
                self.change_rate.sort_by_key(|(frame, _)| *frame);
            }
            "--counter" => self.counts_time = one_of(value, ["frames", "time"]).ok_or_else(wrong)?,
            "--reset" => self.reset = list(value).ok_or_else(wrong)?,
            "--reset-silence" => self.reset_silence_s = number()?,
            "--serial" => self.serial = value.into(),
            "--answers" => self.answers = one_of(value, ["off", "on"]).ok_or_else(wrong)?,
            "--output" => self.is_new = one_of(value, ["set", "new"]).ok_or_else(wrong)?,
            "--udp" => self.place = FrameTarget::Udp(value.into()),
            "--tcp" => self.place = FrameTarget::Tcp(value.parse().map_err(|_| wrong())?),
            "--drop-connection" | "--close-connection" => {
                let all = seconds(value).ok_or_else(wrong)?;
                let closes = name == "--close-connection";
                self.disconnect.extend(all.into_iter().map(|(frame, seconds)| (frame, seconds, closes)));
            }
            "--wait" => self.wait_s = number()?,
            "--log" => self.log = Some(value.into()),
            "--link" => self.place = FrameTarget::Terminal(Some(value.into())),
            _ => return Err(format!("there is no option {name}")),
        }
        Ok(())
    }
}

/// Whether a value is the second of two.
fn one_of(value: &str, [no, yes]: [&str; 2]) -> Option<bool> {
    [no, yes].contains(&value).then_some(value == yes)
}

/// Frames, each with a number that is no number of frames.
fn seconds(text: &str) -> Option<Vec<(u64, f64)>> {
    pairs(text, ':').filter(|all: &Vec<(u64, f64)>| all.iter().all(|(_, of)| of.is_finite() && *of >= 0.0))
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
        assert_eq!((plan.log, plan.place), (Some("l".into()), FrameTarget::Terminal(Some("p".into()))));
        let plan = parse(
            "vn100 --frames 9 --mute 3:0.5 --stall 4:1 --swap-order 6 --change-rate 8:100,7:200 --counter time --reset 5 \
             --reset-silence 2 --drop-connection 1:3 --close-connection 2:4 --tcp 0 --serial 7 --answers off --output new",
        )
        .unwrap();
        assert_eq!((&plan.mute, &plan.stall, &plan.swap), (&vec![(3, 0.5)], &vec![(4, 1.0)], &vec![6]));
        assert_eq!((&plan.change_rate, plan.counts_time), (&vec![(7, 200.0), (8, 100.0)], true));
        assert_eq!((&plan.reset, plan.reset_silence_s, &plan.place), (&vec![5], 2.0, &FrameTarget::Tcp(0)));
        assert_eq!((plan.serial.as_str(), plan.answers, plan.is_new), ("7", false, true));
        assert_eq!(plan.disconnect, [(1, 3.0, false), (2, 4.0, true)]);
        assert_eq!(parse("vn100 --frames 3 --udp a:1").unwrap().place, FrameTarget::Udp("a:1".into()));
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
            ("vn100 --frames 3 --mute 1:-1", "--mute cannot be 1:-1"),
            ("vn100 --frames 3 --change-rate 1:0", "--change-rate cannot be 1:0"),
            ("vn100 --frames 3 --counter x", "--counter cannot be x"),
            ("vn100 --frames 3 --tcp x", "--tcp cannot be x"),
            ("vn100 --frames 3 --speed 1", "there is no option --speed"),
        ] {
            assert_eq!(parse(text), Err(reason.to_owned()), "{text}");
        }
    }
}
