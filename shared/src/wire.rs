//! The two payloads that travel through shared memory, and the flags of an increment.
//!
//! Both are plain C structures of integers and doubles, native-endian, without padding, so that a process in any
//! language that has iceoryx2 can join. **Every bit pattern is a valid value.** A raw sample is treated as hostile
//! input: no value of it may cause a panic, and none is trusted because of its type.
//!
//! Over 400 lines: both payloads and the flags, of which other languages copy every offset and bit.

use core::mem::{align_of, offset_of, size_of};
use iceoryx2_bb_derive_macros::ZeroCopySend;
use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;
use sha2::{Digest as _, Sha256};

/// Number of sensors of a triad: A1, A2, A3 or G1, G2, G3, in this order wherever an array has three elements.
pub const AXES: usize = 3;
/// Number of sensors: A1, A2, A3, G1, G2, G3, in this order.
pub const SENSORS: usize = 2 * AXES;

/// Longest control period that can be compensated: one hour. A longer one, or 0, is flagged [`Flags::INTERVAL`].
pub const MAX_INTERVAL_NS: u64 = 3_600_000_000_000;

/// The bit of [`RawSample::telemetry_ns`] that marks temperature which the acquisition holds for stale. It is no part
/// of the time: no clock counts 2^63 ns.
const STALE_MARK: u64 = 1 << 63;

/// What three sensors of one kind, accelerometers or gyroscopes, have measured in a control period.
#[derive(Clone, Copy, Debug, Default, ZeroCopySend)]
#[repr(C)]
#[type_name("isotherm.Triad")]
pub struct Triad {
    /// Pulses of the positive channel in Ts (N+).
    pub positive_pulses: [u32; AXES],
    /// Pulses of the negative channel in Ts (N-), counted upwards from 0 like the positive ones.
    pub negative_pulses: [u32; AXES],
    /// Temperature of the sensing element, in the table's unit; it drives the bias.
    pub head_temperature: [f64; AXES],
    /// Temperature of the converter board, in the table's unit; it drives both scale factors.
    pub board_temperature: [f64; AXES],
    /// The head temperature behind a first-order lag of [`RawSample::lag_ns`], in the table's unit; unused if that is
    /// 0.
    pub head_lagged: [f64; AXES],
}

impl Triad {
    /// Sensors that the IMU does not have, or that nobody has filled in: no pulses, and temperature that is NaN. A
    /// table that has them gives NaN, flagged `not-finite`.
    pub const ABSENT: Self = Self {
        positive_pulses: [0; AXES],
        negative_pulses: [0; AXES],
        head_temperature: [f64::NAN; AXES],
        board_temperature: [f64::NAN; AXES],
        head_lagged: [0.0; AXES],
    };

    /// Whether this is the triad of an IMU without these sensors: no pulses, and all temperature NaN, as in
    /// [`ABSENT`](Self::ABSENT), or all +0, as in a zeroed structure of C.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        let temperature = [self.head_temperature, self.board_temperature];
        let all = |is: fn(f64) -> bool| temperature.as_flattened().iter().all(|&value| is(value));
        let unlagged = self.head_lagged.iter().all(|lagged| lagged.is_nan() || lagged.to_bits() == 0);
        let unused = self.positive_pulses == [0; AXES] && self.negative_pulses == [0; AXES] && unlagged;
        unused && (all(f64::is_nan) || all(|value| value.to_bits() == 0))
    }

    /// The same, but all 0 if it [is absent](Self::is_absent): for sums, which one NaN would spoil.
    #[must_use]
    pub fn or_zero(self) -> Self {
        if self.is_absent() { Self::default() } else { self }
    }
}

/// NaN, which is temperature that nobody has read, equals NaN.
impl PartialEq for Triad {
    fn eq(&self, other: &Self) -> bool {
        let same =
            |a: &[f64; AXES], b: &[f64; AXES]| a.iter().zip(b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()));
        self.positive_pulses == other.positive_pulses
            && self.negative_pulses == other.negative_pulses
            && same(&self.head_temperature, &other.head_temperature)
            && same(&self.board_temperature, &other.board_temperature)
            && same(&self.head_lagged, &other.head_lagged)
    }
}

/// One control period as the acquisition saw it: the pulses of both channels and the latest temperature.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("isotherm.RawSample.v2")]
pub struct RawSample {
    /// Random number that the acquisition chooses each time it starts; a resent sample keeps it.
    pub session: u64,
    /// Rises by one with each sample of a session; the first may be any number.
    pub sequence: u64,
    /// End of the control period on the acquisition's clock \[ns\]; 0 = not given: then no time step is found, and
    /// what is missing between two sessions is not counted.
    pub timestamp_ns: u64,
    /// Control period Ts, the measured gate length \[ns\], 1..=[`MAX_INTERVAL_NS`].
    pub interval_ns: u64,
    /// `CLOCK_MONOTONIC` when the sample was sent \[ns\]; 0 = unknown.
    pub sent_ns: u64,
    /// When the temperatures were read, on the clock of `timestamp_ns` \[ns\]; 0 = unknown. The highest bit,
    /// 1 << 63, is no part of the time: it marks temperature that the acquisition holds for stale.
    pub telemetry_ns: u64,
    /// Time constant of the lagged temperature \[ns\]; 0 = there is none.
    pub lag_ns: u64,
    /// Which unit this is: [`device`] of its serial number; 0 = unknown.
    pub device: u64,
    /// A1, A2, A3.
    pub accelerometers: Triad,
    /// G1, G2, G3; where the IMU has none, no pulses and temperature NaN (or 0).
    pub gyroscopes: Triad,
}

/// All 0, but every head and board temperature NaN: [`Triad::ABSENT`]. A program that forgets a temperature gets NaN,
/// flagged `not-finite`, and not an increment of 0 V or 0 °C.
impl Default for RawSample {
    #[inline]
    fn default() -> Self {
        Self {
            session: 0,
            sequence: 0,
            timestamp_ns: 0,
            interval_ns: 0,
            sent_ns: 0,
            telemetry_ns: 0,
            lag_ns: 0,
            device: 0,
            accelerometers: Triad::ABSENT,
            gyroscopes: Triad::ABSENT,
        }
    }
}

/// The number of the device with this serial number: the first 8 bytes of the SHA-256 of its UTF-8, big-endian. Outer
/// blanks do not count; a serial number of nothing else is unknown, 0.
///
/// ```
/// use isotherm_shared::wire::device;
///
/// assert_eq!(device(" SN 42 "), device("SN 42"));
/// assert_ne!(device("SN 42"), device("SN 43"));
/// assert_eq!(device("  "), 0); // unknown
/// ```
#[must_use]
pub fn device(serial: &str) -> u64 {
    match serial.trim() {
        "" => 0,
        serial => Sha256::digest(serial).iter().take(8).fold(0, |number, &byte| number << 8 | u64::from(byte)),
    }
}

/// The compensated answer to one [`RawSample`].
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("isotherm.CompensatedIncrement.v2")]
pub struct CompensatedIncrement {
    /// Copied from the raw sample.
    pub session: u64,
    /// Copied from the raw sample.
    pub sequence: u64,
    /// Copied from the raw sample \[ns\].
    pub timestamp_ns: u64,
    /// Copied from the raw sample \[ns\].
    pub interval_ns: u64,
    /// Velocity increment over Ts \[m/s\]; NaN where it could not be computed, never a guess.
    pub velocity_increment: [f64; AXES],
    /// Angle increment over Ts \[rad\]; NaN where it could not be computed, and where the table has no gyroscopes.
    pub angle_increment: [f64; AXES],
    /// Which coefficients were used: the first 8 bytes of the table's digest, big-endian; 0 without a table.
    pub table: u64,
    /// See [`Flags`].
    pub flags: u64,
    /// Time from the raw sample's `sent_ns` to just before publishing \[ns\]. If `sent_ns` is unknown, the time counts
    /// from when the service found the sample.
    pub latency_ns: u64,
}

// Peers that do not use this crate depend on this layout.
const _: () = {
    assert!(size_of::<Triad>() == 96 && align_of::<Triad>() == 8);
    assert!(offset_of!(Triad, positive_pulses) == 0);
    assert!(offset_of!(Triad, negative_pulses) == 12);
    assert!(offset_of!(Triad, head_temperature) == 24);
    assert!(offset_of!(Triad, board_temperature) == 48);
    assert!(offset_of!(Triad, head_lagged) == 72);
    assert!(size_of::<RawSample>() == 256 && align_of::<RawSample>() == 8);
    assert!(offset_of!(RawSample, session) == 0);
    assert!(offset_of!(RawSample, sequence) == 8);
    assert!(offset_of!(RawSample, timestamp_ns) == 16);
    assert!(offset_of!(RawSample, interval_ns) == 24);
    assert!(offset_of!(RawSample, sent_ns) == 32);
    assert!(offset_of!(RawSample, telemetry_ns) == 40);
    assert!(offset_of!(RawSample, lag_ns) == 48);
    assert!(offset_of!(RawSample, device) == 56);
    assert!(offset_of!(RawSample, accelerometers) == 64);
    assert!(offset_of!(RawSample, gyroscopes) == 160);
    assert!(size_of::<CompensatedIncrement>() == 104 && align_of::<CompensatedIncrement>() == 8);
    assert!(offset_of!(CompensatedIncrement, session) == 0);
    assert!(offset_of!(CompensatedIncrement, sequence) == 8);
    assert!(offset_of!(CompensatedIncrement, timestamp_ns) == 16);
    assert!(offset_of!(CompensatedIncrement, interval_ns) == 24);
    assert!(offset_of!(CompensatedIncrement, velocity_increment) == 32);
    assert!(offset_of!(CompensatedIncrement, angle_increment) == 56);
    assert!(offset_of!(CompensatedIncrement, table) == 80);
    assert!(offset_of!(CompensatedIncrement, flags) == 88);
    assert!(offset_of!(CompensatedIncrement, latency_ns) == 96);
};

/// Why two samples cannot be summed by [`RawSample::merge`]; neither has been changed.
#[derive(Clone, Copy, Debug, Eq, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// A channel's sum does not fit into 32 bits.
    #[error("the summed pulses of a channel exceed 32 bits; send the two as two samples")]
    Pulses,
    /// The summed period is over [`MAX_INTERVAL_NS`].
    #[error("the summed interval exceeds one hour; send the two as two samples")]
    Interval,
}

impl RawSample {
    /// When the temperatures were read, on the clock of `timestamp_ns` \[ns\]; 0 = unknown.
    ///
    /// ```
    /// use isotherm_shared::wire::RawSample;
    ///
    /// let mut raw = RawSample { telemetry_ns: 5_000_000_000, ..RawSample::default() };
    /// raw.mark_stale();
    /// assert!(raw.is_marked_stale());
    /// assert_eq!(raw.temperature_time_ns(), 5_000_000_000);
    /// ```
    #[must_use]
    #[inline]
    pub const fn temperature_time_ns(&self) -> u64 {
        self.telemetry_ns & !STALE_MARK
    }

    /// Whether the acquisition holds the temperature for stale.
    #[must_use]
    #[inline]
    pub const fn is_marked_stale(&self) -> bool {
        self.telemetry_ns & STALE_MARK != 0
    }

    /// Marks the temperature as stale: the increment is computed all the same, and flagged
    /// [`TELEMETRY_STALE`](Flags::TELEMETRY_STALE).
    #[inline]
    pub const fn mark_stale(&mut self) {
        self.telemetry_ns |= STALE_MARK;
    }

    /// Time between the reading of the temperatures and the end of the control period \[s\], whichever comes first: a
    /// reading of some later time is as far from this period as an old one, or is of another clock. 0 where one of the
    /// two is not given.
    #[must_use]
    #[inline]
    pub const fn temperature_age_s(&self) -> f64 {
        match (self.temperature_time_ns(), self.timestamp_ns) {
            (0, _) | (_, 0) => 0.0,
            (temperature_ns, timestamp_ns) => timestamp_ns.abs_diff(temperature_ns) as f64 / 1e9,
        }
    }

    /// Adds the next control period to this one: pulses and intervals are summed, timestamp, temperature and device
    /// become the later ones, session, sequence and `sent_ns` stay.
    ///
    /// An interval of 0 is not known, and so is a sum with it: it stays 0, flagged [`Flags::INTERVAL`]. Otherwise, the
    /// pulses of a period without a length would pass as those of the other one.
    ///
    /// The increments are linear in pulses and interval, so no velocity and no angle is lost if the temperature is the
    /// same in both periods. For a service that has no room, an acquisition's `keep` does this, and begins another sum
    /// where one ends.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_shared::wire::RawSample;
    ///
    /// let raw = RawSample { interval_ns: 2_500_000, ..RawSample::default() };
    /// let mut sum = RawSample { sequence: 7, timestamp_ns: 5_000_000, ..raw };
    /// sum.accelerometers.positive_pulses = [100, 0, 20];
    /// let mut later = RawSample { sequence: 8, timestamp_ns: 7_500_000, ..raw };
    /// later.accelerometers.positive_pulses = [90, 0, 30];
    /// sum.merge(&later)?;
    /// assert_eq!((sum.sequence, sum.timestamp_ns, sum.interval_ns), (7, 7_500_000, 5_000_000));
    /// assert_eq!(sum.accelerometers.positive_pulses, [190, 0, 50]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`MergeError`] when a sum would overflow; `self` is then unchanged.
    pub fn merge(&mut self, later: &Self) -> Result<(), MergeError> {
        let interval_ns = self
            .interval_ns
            .checked_add(later.interval_ns)
            .filter(|&interval| interval <= MAX_INTERVAL_NS)
            .ok_or(MergeError::Interval)?;
        let is_known = self.interval_ns != 0 && later.interval_ns != 0;
        *self = Self {
            session: self.session,
            sequence: self.sequence,
            sent_ns: self.sent_ns,
            interval_ns: if is_known { interval_ns } else { 0 },
            accelerometers: self.accelerometers.merged(&later.accelerometers)?,
            gyroscopes: self.gyroscopes.merged(&later.gyroscopes)?,
            ..*later
        };
        Ok(())
    }
}

impl Triad {
    /// The pulses of both periods, and the temperature of the later one.
    fn merged(&self, later: &Self) -> Result<Self, MergeError> {
        let sum = |a: [u32; AXES], b: [u32; AXES]| -> Result<[u32; AXES], MergeError> {
            let mut total = a;
            for (total, added) in total.iter_mut().zip(b) {
                *total = total.checked_add(added).ok_or(MergeError::Pulses)?;
            }
            Ok(total)
        };
        Ok(Self {
            positive_pulses: sum(self.positive_pulses, later.positive_pulses)?,
            negative_pulses: sum(self.negative_pulses, later.negative_pulses)?,
            ..*later
        })
    }
}

/// Flags of a sample and of its delivery: the bits of [`CompensatedIncrement::flags`].
///
/// Bits 0 to 23 and 32 to 50 are **sample flags**, a pure function of raw sample and table; 32 to 49 are the flags of
/// the gyroscopes, as bits 0 to 17 are those of the accelerometers. Bits 24 to 27 are **delivery flags**, which the
/// service adds. A later service may set bits that have no name today: who compares flags masks them.
///
/// ```
/// use isotherm_shared::wire::Flags;
///
/// let flags = Flags::GAP | Flags::LATE;
/// assert_eq!(flags.to_string(), "gap|late");
/// assert!(flags.intersects(Flags::LOST) && !flags.intersects(Flags::INVALID));
/// assert_eq!(flags.only(Flags::INFORMATION), Flags::LATE);
/// ```
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
#[repr(transparent)]
pub struct Flags(pub u64);

/// Declares the flags. The documentation of each, with its remedy, is what [`Flags::text`] gives to `isotherm explain`.
macro_rules! flags {
    (
        of_an_axis { $($(#[doc = $axis_meaning:literal])+ $function:ident = $first:literal, $axis_remedy:literal;)+ }
        of_a_sample { $($(#[doc = $meaning:literal])+ $constant:ident = $bit:literal, $remedy:literal;)+ }
    ) => {
        impl Flags {
            $(
                #[doc = "Of `axis`, 0 to 2:"]
                $(#[doc = $axis_meaning])+
                #[must_use]
                #[inline]
                pub const fn $function(axis: usize) -> Self {
                    Self(1 << ($first + axis))
                }
            )+
            $(
                $(#[doc = $meaning])+
                pub const $constant: Self = Self(1 << $bit);
            )+

            /// Meaning and remedy of the flag with this bit, of [`NAMES`](Self::NAMES).
            #[must_use]
            pub fn text(bit: u32) -> Option<[&'static str; 2]> {
                match bit {
                    $($bit => Some([concat!($($meaning),+), $remedy]),)+
                    _ => match bit % Self::GYROSCOPES / 3 * 3 {
                        $($first => Some([concat!($($axis_meaning),+), $axis_remedy]),)+
                        _ => None,
                    },
                }
            }
        }
    };
}

flags! {
    of_an_axis {
        /// The head temperature is below the bias range. The increment follows the table's `out_of_range`: it is
        /// computed at the end of the range (clamp), computed by extrapolation, or NaN (reject).
        head_below = 0, "Calibrate over the temperatures of the mission.";
        /// The head temperature is above the bias range. The increment follows the table's `out_of_range`: it is
        /// computed at the end of the range (clamp), computed by extrapolation, or NaN (reject).
        head_above = 3, "Calibrate over the temperatures of the mission.";
        /// The board temperature is below the range of K+ or K-. The increment follows the table's `out_of_range`: it
        /// is computed at the end of the range (clamp), computed by extrapolation, or NaN (reject).
        board_below = 6, "Calibrate over the temperatures of the mission.";
        /// The board temperature is above the range of K+ or K-. The increment follows the table's `out_of_range`: it
        /// is computed at the end of the range (clamp), computed by extrapolation, or NaN (reject).
        board_above = 9, "Calibrate over the temperatures of the mission.";
        /// The temperature is NaN or infinite. The increment is NaN under any policy. With an alignment matrix, all
        /// axes of the triad are NaN.
        not_finite = 12,
            "Look for a dead thermistor or a reading that the acquisition has not filled in; use the other axes.";
        /// Both channels together have more pulses per second than the table's `max_rate`. The increment is computed.
        rate = 15,
            "The converter may be saturated: trust this axis less, and look for shock, or for counters that were \
             read twice.";
    }
    of_a_sample {
        /// The interval is 0 or longer than an hour. The increments are NaN.
        INTERVAL = 18, "Give the measured control period in `interval_ns`, in nanoseconds.";
        /// The IMU is served without a table (`--allow-uncalibrated`), or its table has another nominal interval than
        /// the one before, and sources learn that for a second. The increments are NaN.
        NO_TABLE = 19,
            "After a second it ends by itself if there is a table. Otherwise `status` says why: the file is absent or refused, and no table from before is kept. Install a good file, which is loaded without a \
             restart, or accept the file that is there with `reload`.";
        /// The temperature is older than the table's `max_age_s`, or newer than the end of the control period by as
        /// much; or `isotherm acquire` or the node of ROS 2 holds it for stale. It is not flagged by its age if that is
        /// unknown. The increment is computed.
        TELEMETRY_STALE = 20,
            "Check whether the thermometer is still read, or read it more often. The log of the acquisition has age \
             and limit, and `temperature_max_age_s` in its description sets the limit. A temperature that is newer \
             than its period comes from another clock: give `telemetry_ns` on that of `timestamp_ns`.";
        /// The transient term of a bias is missing: the time constant of the sample is not that of the table, the
        /// sample has none, or the lag difference is not finite or larger than the bias's range. The increment is
        /// computed without that term.
        LAG_UNKNOWN = 21,
            "It ends automatically after a start, a new table or a fault of the thermometer. If it persists, feed \
             `reading` with each temperature, and let the lag follow the table's: docs/temperature-in-motion.md.";
        /// The sample comes from a device other than that of the table. It is not flagged if either is unknown. The
        /// increment is computed with that table.
        OTHER_DEVICE = 22, "Give the device its own table, or correct the serial number that the acquisition sends.";
        /// A velocity increment is NaN, so that an angle was computed without its g-sensitivity.
        G_UNKNOWN = 23, "Fix what makes the velocity increment NaN: another flag shows that.";
        /// Samples of this session are missing before this one. The increment is computed.
        GAP = 24,
            "Time is missing before it: restart navigation. The acquisition should keep what a full queue hands \
             back, and skip no sequence.";
        /// The latency exceeded the configured budget. The increment is valid; on a desktop most are late.
        LATE = 25, "Do nothing, or give the worker a core and a priority: docs/operate.md#real-time.";
        /// No sequence is missing before this sample, and its `timestamp_ns` is not one `interval_ns` after that of the
        /// sample before: the step differs from the interval by more than half of it. Time was lost, or the interval is
        /// wrong. The increment is computed.
        TIME_STEP = 26,
            "Time is missing before it, or the clock was set: look at the acquisition's clock and interval.";
        /// The sample is the first of a new session: the acquisition, or its device, was restarted. The session differs
        /// from the last one that was served for this IMU since boot, by this service or by the one before it. The
        /// increment is computed.
        SESSION = 27,
            "Time may be missing before it: restart navigation, or continue over the number of periods that \
             `lost_before` of a reader counts. Find out why the acquisition was restarted, or why its device was \
             away.";
        /// The table has a nominal interval, and the interval of the sample is not within 1 % of 1 to 64 times that. It
        /// is not flagged if the interval itself is invalid (`interval`). The increment is computed, with scale factors
        /// for another interval.
        INTERVAL_NOT_NOMINAL = 50,
            "Give the interval that the readings have, in nanoseconds, or a table of that interval. Readings whose \
             pulses are those of the sample's own interval, as `Readings` makes them, are still right: \
             docs/table.md#readings-format-3.";
    }
}

impl Flags {
    /// Distance from a bit of the accelerometers to that of the gyroscopes.
    const GYROSCOPES: u32 = 32;
    /// All sample flags.
    pub const SAMPLE: Self =
        Self(((1 << 24) - 1) | (((1 << 18) - 1) << Self::GYROSCOPES) | Self::INTERVAL_NOT_NOMINAL.0);
    /// All delivery flags.
    pub const DELIVERY: Self = Self(Self::GAP.0 | Self::LATE.0 | Self::TIME_STEP.0 | Self::SESSION.0);

    /// Bits 0 to 17 of the accelerometers, with those of the gyroscopes.
    const fn of_both(accelerometers: u64) -> u64 {
        accelerometers | accelerometers << Self::GYROSCOPES
    }
    /// Mask: an increment could not be computed and is NaN, on one axis or on all. `interval`, `no-table`,
    /// `.._not-finite`.
    pub const INVALID: Self = Self(Self::INTERVAL.0 | Self::NO_TABLE.0 | Self::of_both(0b111 << 12));
    /// Mask: computed, outside of what the calibration covers or without a part of it; the ranges give NaN where the
    /// table's policy is `reject`. Ranges, `rate`, `telemetry-stale`, `lag-unknown`, `other-device`, `g-unknown`,
    /// `interval-not-nominal`.
    pub const DEGRADED: Self = Self(
        Self::of_both(0b111 << 15 | 0xfff)
            | Self::TELEMETRY_STALE.0
            | Self::LAG_UNKNOWN.0
            | Self::OTHER_DEVICE.0
            | Self::G_UNKNOWN.0
            | Self::INTERVAL_NOT_NOMINAL.0,
    );
    /// Mask: time is missing before this increment, or may be. `gap`, `time-step`, `session`.
    pub const LOST: Self = Self(Self::GAP.0 | Self::TIME_STEP.0 | Self::SESSION.0);
    /// Mask: says nothing against the increment. `late`.
    pub const INFORMATION: Self = Self(Self::LATE.0);

    /// Bit and name of every flag, lowest bit first.
    pub const NAMES: [(u32, &'static str); 47] = [
        (0, "a1-head-below"),
        (1, "a2-head-below"),
        (2, "a3-head-below"),
        (3, "a1-head-above"),
        (4, "a2-head-above"),
        (5, "a3-head-above"),
        (6, "a1-board-below"),
        (7, "a2-board-below"),
        (8, "a3-board-below"),
        (9, "a1-board-above"),
        (10, "a2-board-above"),
        (11, "a3-board-above"),
        (12, "a1-not-finite"),
        (13, "a2-not-finite"),
        (14, "a3-not-finite"),
        (15, "a1-rate"),
        (16, "a2-rate"),
        (17, "a3-rate"),
        (18, "interval"),
        (19, "no-table"),
        (20, "telemetry-stale"),
        (21, "lag-unknown"),
        (22, "other-device"),
        (23, "g-unknown"),
        (24, "gap"),
        (25, "late"),
        (26, "time-step"),
        (27, "session"),
        (32, "g1-head-below"),
        (33, "g2-head-below"),
        (34, "g3-head-below"),
        (35, "g1-head-above"),
        (36, "g2-head-above"),
        (37, "g3-head-above"),
        (38, "g1-board-below"),
        (39, "g2-board-below"),
        (40, "g3-board-below"),
        (41, "g1-board-above"),
        (42, "g2-board-above"),
        (43, "g3-board-above"),
        (44, "g1-not-finite"),
        (45, "g2-not-finite"),
        (46, "g3-not-finite"),
        (47, "g1-rate"),
        (48, "g2-rate"),
        (49, "g3-rate"),
        (50, "interval-not-nominal"),
    ];

    /// The same flags of the gyroscopes, for flags of the accelerometers: bits 0 to 17.
    #[must_use]
    #[inline]
    pub const fn of_gyroscopes(self) -> Self {
        Self(self.0 << Self::GYROSCOPES)
    }

    /// Whether any bit of `other` is set.
    #[must_use]
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// The bits that are also in `mask`.
    #[must_use]
    pub const fn only(self, mask: Self) -> Self {
        Self(self.0 & mask.0)
    }
}

impl core::ops::BitOrAssign for Flags {
    #[inline]
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl core::ops::BitOr for Flags {
    type Output = Self;
    #[inline]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// `-`, or the names joined by `|`, lowest bit first; bits without a name are left out.
impl core::fmt::Display for Flags {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut separator = "";
        for (bit, name) in Self::NAMES {
            if self.0 & (1 << bit) != 0 {
                write!(f, "{separator}{name}")?;
                separator = "|";
            }
        }
        if separator.is_empty() {
            f.write_str("-")?;
        }
        Ok(())
    }
}

/// A sample of one of an IMU's two streams.
#[derive(Clone, Copy, Debug)]
pub enum StreamSample {
    /// From the raw stream.
    Raw(RawSample),
    /// From the increment stream.
    Increment(CompensatedIncrement),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> RawSample {
        RawSample {
            session: 7,
            sequence: 3,
            timestamp_ns: 1_000,
            interval_ns: 400,
            sent_ns: 5,
            telemetry_ns: 900,
            lag_ns: 30,
            device: 40,
            accelerometers: Triad {
                positive_pulses: [1, 2, u32::MAX - 1],
                negative_pulses: [4, 5, 6],
                head_temperature: [1.0, 2.0, 3.0],
                board_temperature: [4.0, 5.0, 6.0],
                head_lagged: [7.0, 8.0, 9.0],
            },
            gyroscopes: Triad { negative_pulses: [u32::MAX - 3, 8, 9], ..Triad::default() },
        }
    }

    #[test]
    fn a_sample_has_no_temperature_and_no_gyroscopes_unless_they_are_filled_in() {
        let raw = RawSample::default();
        for triad in [raw.accelerometers, raw.gyroscopes] {
            let temperature = [triad.head_temperature, triad.board_temperature];
            assert!(triad.is_absent() && temperature.as_flattened().iter().all(|value| value.is_nan()));
            assert_eq!(triad.head_lagged.map(f64::to_bits), [0; AXES]);
        }
        assert!(raw == RawSample::default() && Triad::default().is_absent() && Triad::ABSENT != Triad::default());
        let one = Triad { head_temperature: [f64::NAN, 2.5, f64::NAN], ..Triad::ABSENT };
        let pulse = Triad { positive_pulses: [0, 1, 0], ..Triad::ABSENT };
        let minus_zero = Triad { board_temperature: [0.0, 0.0, -0.0], ..Triad::default() };
        assert!([one, pulse, minus_zero].iter().all(|triad| !triad.is_absent()));
    }

    #[test]
    fn merging_sums_pulses_and_intervals_and_takes_the_later_temperature() {
        let mut first = sample();
        let later = RawSample {
            session: 7,
            sequence: 4,
            timestamp_ns: 1_400,
            interval_ns: 401,
            sent_ns: 0,
            telemetry_ns: 1_300,
            lag_ns: 31,
            device: 41,
            accelerometers: Triad {
                positive_pulses: [10, 20, 1],
                negative_pulses: [40, 50, 60],
                head_temperature: [1.5, 2.5, 3.5],
                board_temperature: [4.5, 5.5, 6.5],
                head_lagged: [7.5, 8.5, 9.5],
            },
            gyroscopes: Triad { negative_pulses: [3, 2, 1], head_temperature: [1.0, 2.0, 3.0], ..Triad::default() },
        };
        first.merge(&later).unwrap();
        assert_eq!(
            first,
            RawSample {
                session: 7,
                sequence: 3,
                sent_ns: 5,
                interval_ns: 801,
                accelerometers: Triad {
                    positive_pulses: [11, 22, u32::MAX],
                    negative_pulses: [44, 55, 66],
                    ..later.accelerometers
                },
                gyroscopes: Triad { negative_pulses: [u32::MAX, 10, 10], ..later.gyroscopes },
                ..later
            }
        );
    }

    #[test]
    fn an_interval_that_is_not_known_stays_unknown_in_a_sum() {
        for (first, later) in [(0, 400), (400, 0), (0, 0)] {
            let mut sum = RawSample { interval_ns: first, accelerometers: Triad::default(), ..RawSample::default() };
            let next = RawSample { interval_ns: later, sequence: 4, ..sum };
            sum.merge(&next).unwrap();
            assert_eq!(sum.interval_ns, 0, "{first} and {later}");
            sum.merge(&RawSample { interval_ns: 400, ..next }).unwrap();
            assert_eq!(sum.interval_ns, 0, "{first} and {later}, then 400");
        }
    }

    #[test]
    fn a_merge_that_overflows_changes_nothing() {
        let mut first = sample();
        assert_eq!(first.merge(&sample()), Err(MergeError::Pulses));
        assert_eq!(first, sample());
        let mut later = sample();
        later.accelerometers.positive_pulses = [0; AXES];
        assert_eq!(first.merge(&later), Err(MergeError::Pulses));
        assert_eq!(first, sample());
        later.gyroscopes.negative_pulses = [0; AXES];
        for interval_ns in [MAX_INTERVAL_NS - 399, u64::MAX] {
            later.interval_ns = interval_ns;
            assert_eq!(first.merge(&later), Err(MergeError::Interval));
            assert_eq!(first, sample());
        }
        later.interval_ns = MAX_INTERVAL_NS - 400;
        assert_eq!(first.merge(&later), Ok(()));
    }

    #[test]
    fn flags_print_by_name_lowest_bit_first() {
        assert_eq!(Flags::default().to_string(), "-");
        let mut flags = Flags::LATE | Flags::GAP | Flags::INTERVAL;
        flags |= Flags::head_below(0) | Flags::rate(2);
        assert_eq!(flags.to_string(), "a1-head-below|a3-rate|interval|gap|late");
        assert_eq!(flags.only(Flags::SAMPLE).to_string(), "a1-head-below|a3-rate|interval");
        assert_eq!(flags.only(Flags::DELIVERY).to_string(), "gap|late");
    }

    #[test]
    fn a_device_is_the_hash_of_its_serial_number_without_outer_blanks() {
        // printf 'SN 42' | sha256sum
        assert_eq!(device("SN 42"), 0x46a7_426e_f29c_c83b);
        assert_eq!(device("\t SN 42 \n"), 0x46a7_426e_f29c_c83b);
        assert_eq!((device(""), device("  ")), (0, 0));
    }

    #[test]
    fn every_flag_is_in_one_mask() {
        let masks = [Flags::INVALID, Flags::DEGRADED, Flags::LOST, Flags::INFORMATION];
        assert_eq!(masks.iter().fold(0, |all, mask| all | mask.0), Flags::SAMPLE.0 | Flags::DELIVERY.0);
        assert_eq!(masks.iter().map(|mask| mask.0.count_ones()).sum::<u32>() as usize, Flags::NAMES.len());
        assert_eq!(Flags::INVALID.to_string().matches("not-finite").count(), 2 * AXES);
        assert_eq!(Flags::INVALID.only(Flags((1 << 24) - 1)).0, 0b111 << 12 | 1 << 18 | 1 << 19);
        assert_eq!([Flags::LOST.to_string(), Flags::INFORMATION.to_string()], ["gap|time-step|session", "late"]);
    }

    #[test]
    fn every_flag_has_the_bit_that_its_name_says() {
        let named = |name: &str| Flags::NAMES.iter().find(|(_, n)| *n == name).map(|(bit, _)| Flags(1 << bit)).unwrap();
        for axis in 0..AXES {
            let n = axis + 1;
            assert_eq!(named(&format!("a{n}-head-below")), Flags::head_below(axis));
            assert_eq!(named(&format!("a{n}-head-above")), Flags::head_above(axis));
            assert_eq!(named(&format!("a{n}-board-below")), Flags::board_below(axis));
            assert_eq!(named(&format!("a{n}-board-above")), Flags::board_above(axis));
            assert_eq!(named(&format!("a{n}-not-finite")), Flags::not_finite(axis));
            assert_eq!(named(&format!("a{n}-rate")), Flags::rate(axis));
            assert_eq!(named(&format!("g{n}-head-below")), Flags::head_below(axis).of_gyroscopes());
            assert_eq!(named(&format!("g{n}-rate")), Flags::rate(axis).of_gyroscopes());
        }
        assert_eq!(named("lag-unknown"), Flags::LAG_UNKNOWN);
        assert_eq!(named("other-device"), Flags::OTHER_DEVICE);
        assert_eq!(named("g-unknown"), Flags::G_UNKNOWN);
        assert_eq!(named("interval-not-nominal"), Flags::INTERVAL_NOT_NOMINAL);
        assert!(Flags::NAMES.is_sorted_by_key(|(bit, _)| bit));
        let all = Flags::NAMES.iter().fold(0, |all, (bit, _)| all | 1_u64 << bit);
        assert_eq!(all, Flags::SAMPLE.0 | Flags::DELIVERY.0);
        assert_eq!(named("interval"), Flags::INTERVAL);
        assert_eq!(named("no-table"), Flags::NO_TABLE);
        assert_eq!(named("telemetry-stale"), Flags::TELEMETRY_STALE);
        assert_eq!(named("gap"), Flags::GAP);
        assert_eq!(named("late"), Flags::LATE);
        assert_eq!(named("time-step"), Flags::TIME_STEP);
        assert_eq!(named("session"), Flags::SESSION);
        assert_eq!(Flags::LOST.0, 0xd00_0000);
        for (bit, name) in Flags::NAMES {
            let [meaning, remedy] = Flags::text(bit).unwrap();
            assert!(meaning.ends_with('.') && remedy.ends_with('.'), "{name}");
        }
        assert_eq!([28, 31, 51, 63].map(Flags::text), [None; 4]);
    }
}
