//! Emulated IMUs, one a protocol, written from the makers' data sheets and without code of the decoder. Frame number
//! `n` always has the same bytes, and what it says is known: pulses of a pattern, temperatures, counters that wrap
//! soon.
//!
//! Their outputs are those that the profiles of the same names in `examples/acquire` describe.

mod answers;
mod arduino;
pub mod arguments;
mod checksum;
pub mod device;
mod kvh1750;
mod mtdata2;
mod network;
pub mod output;
pub mod own;
mod pattern;
pub mod plan;
mod stim300;
mod terminal;
pub mod time;
mod vn100;

use own::DeviceStamp;
pub use pattern::Values;

/// An emulated IMU.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Emulator {
    /// Sensonor STIM300, increments, 1000 Hz.
    Stim300,
    /// The same bytes, understood as rates and accelerations.
    Stim300Rate,
    /// KVH 1750, 1000 Hz.
    Kvh1750,
    /// VectorNav VN-100, 400 Hz.
    Vn100,
    /// Xsens MTData2, 100 Hz, with a message of GNSS before every 25th sample.
    Mtdata2,
    /// An Arduino that prints an MPU-6050, 200 Hz.
    Arduino,
}

impl Emulator {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Stim300, Self::Stim300Rate, Self::Kvh1750, Self::Vn100, Self::Mtdata2, Self::Arduino];

    /// The name of its profile in `examples/acquire`, without `.toml`.
    pub fn profile(self) -> &'static str {
        match self {
            Self::Stim300 => "stim300",
            Self::Stim300Rate => "stim300-rate",
            Self::Kvh1750 => "kvh1750",
            Self::Vn100 => "vn100",
            Self::Mtdata2 => "mtdata2",
            Self::Arduino => "arduino-mpu6050",
        }
    }

    /// The emulator of a profile: its name, or the path of its file.
    pub fn of_profile(profile: &str) -> Option<Self> {
        let name = profile.rsplit('/').next().unwrap_or(profile);
        let name = name.strip_suffix(".toml").unwrap_or(name);
        Self::ALL.into_iter().find(|emulator| emulator.profile() == name)
    }

    /// Samples a second in the profile. The device's own clock runs at this rate.
    pub fn rate(self) -> f64 {
        match self {
            Self::Stim300 | Self::Stim300Rate | Self::Kvh1750 => 1000.0,
            Self::Vn100 => 400.0,
            Self::Mtdata2 => 100.0,
            Self::Arduino => 200.0,
        }
    }

    /// The serial number of a unit, unless another one is ordered; empty if it says none.
    pub fn serial(self) -> &'static str {
        match self {
            Self::Stim300 | Self::Stim300Rate => "N25582405002002",
            Self::Vn100 => "0100061897",
            Self::Mtdata2 => "03801ABC",
            Self::Kvh1750 | Self::Arduino => "",
        }
    }

    /// What a unit of this serial number sends when it was powered, before its first frame.
    pub fn greeting(self, serial: &str) -> Vec<u8> {
        match self {
            Self::Stim300 | Self::Stim300Rate => answers::stim300::greeting(serial),
            Self::Mtdata2 => mtdata2::xbus(0x3E, &[]),
            Self::Vn100 | Self::Kvh1750 | Self::Arduino => Vec::new(),
        }
    }

    /// Whether its counter counts time in the data sheet, and not frames.
    pub fn counts_time(self) -> bool {
        matches!(self, Self::Stim300 | Self::Stim300Rate)
    }

    /// The bytes of sample number `number` of a device that was never reset and always had one rate.
    pub fn frame(self, number: u64) -> Vec<u8> {
        self.frame_at(number, DeviceStamp::regular(number))
    }

    /// The bytes of sample number `number`, with a counter and a clock that say this.
    pub fn frame_at(self, number: u64, own: DeviceStamp) -> Vec<u8> {
        match self {
            Self::Stim300 | Self::Stim300Rate => stim300::frame(number, own),
            Self::Kvh1750 => kvh1750::frame(number, own),
            Self::Vn100 => vn100::frame(number, own),
            Self::Mtdata2 => mtdata2::frame(number, own),
            Self::Arduino => arduino::frame(number, own),
        }
    }

    /// What sample number `number` of a device that was never reset and always had one rate says.
    pub fn expected(self, number: u64) -> Values {
        match self {
            Self::Stim300 => stim300::increments(number),
            Self::Stim300Rate => stim300::rates(number),
            Self::Kvh1750 => kvh1750::expected(number),
            Self::Vn100 => vn100::expected(number),
            Self::Mtdata2 => mtdata2::expected(number),
            Self::Arduino => arduino::expected(number),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::pattern::{AXES, pulses};
    use super::*;

    #[test]
    fn profiles_have_emulators_and_frames_differ() {
        for emulator in Emulator::ALL {
            assert_eq!(Emulator::of_profile(emulator.profile()), Some(emulator));
            assert_eq!(Emulator::of_profile(&format!("examples/acquire/{}.toml", emulator.profile())), Some(emulator));
            assert_eq!(emulator.frame(7), emulator.frame(7));
            assert_ne!(emulator.frame(7), emulator.frame(8));
            let names: Vec<_> = emulator.expected(0).into_iter().map(|(name, _)| name).collect();
            assert!(AXES.iter().all(|axis| names.contains(axis)), "{names:?}");
        }
        assert_eq!(Emulator::of_profile("adis16505"), None);
    }

    #[test]
    fn the_pattern_sums_to_zero() {
        for axis in 0..6 {
            assert_eq!((0..4001).map(|number| pulses(number, axis)).sum::<i32>(), 0);
            assert_eq!(pulses(123_456_789_012, axis), pulses(123_456_789_012 % 4001, axis));
        }
    }

    /// The value of a name.
    pub(super) fn value(values: &Values, name: &str) -> f64 {
        values.iter().find(|(found, _)| *found == name).unwrap().1
    }
}
