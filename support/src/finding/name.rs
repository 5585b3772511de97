//! The names of findings, for `--accept` and for scripts, with what each means and what to do: `isotherm explain` and
//! docs/findings.md print it.

/// What a finding of a name can be.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Rank {
    /// A fault that cannot be accepted: it leaves nothing to fit.
    Final,
    /// A fault.
    Fault,
    /// A fault, or a warning beyond a lower limit.
    FaultOrWarning,
    /// A warning.
    Warning,
}

impl Rank {
    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Final => "fault, cannot be accepted",
            Self::Fault => "fault",
            Self::FaultOrWarning => "fault or warning",
            Self::Warning => "warning",
        }
    }
}

/// What a name means, and what to do.
#[derive(Clone, Copy, Debug)]
pub struct Explanation {
    /// The name.
    pub name: &'static str,
    /// How bad it is.
    pub rank: Rank,
    /// What the data look like, and the usual causes.
    pub meaning: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

/// Names of one subject.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// Its heading.
    pub title: &'static str,
    /// What holds for all of its names; may be empty.
    pub introduction: &'static str,
    /// The names.
    pub names: &'static [Explanation],
}

/// Declares the names. The documentation of a constant is also the meaning in [`SUBJECTS`].
macro_rules! findings {
    ($($title:literal $introduction:literal {
        $($(#[doc = $meaning:literal])+ $constant:ident = $name:literal, $rank:ident, $remedy:literal;)+
    })+) => {
        $($(
            $(#[doc = $meaning])+
            pub const $constant: &str = $name;
        )+)+

        /// Every name, by subject.
        pub const SUBJECTS: &[Subject] = &[$(Subject {
            title: $title,
            introduction: $introduction,
            names: &[$(Explanation {
                name: $constant,
                rank: Rank::$rank,
                meaning: concat!($($meaning),+),
                remedy: $remedy,
            }),+],
        }),+];
    };
}

findings! {
    "What is there" "" {
        /// A position of the campaign file is missing at a set point. It was not measured, or the file is cut.
        MISSING_POSITION = "missing-position", Final,
            "Measure it, leave it out with `--exclude SET_POINT/POSITION`, or remove it from the campaign file.";
        /// There are fewer than two set points.
        SET_POINTS = "set-points", Final, "Measure at more temperatures.";
        /// An accelerometer gives no pulses on the channel of its direction. The channel is dead, or channels or signs
        /// are exchanged.
        NO_PULSES = "no-pulses", Final, "Correct the cable, the columns or the positions.";
        /// A recording, or a part of it, is given twice. The copy adds no information, and would halve the stated
        /// errors.
        SAME_RECORDING = "same-recording", Final, "Name every recording once.";
        /// Rows come from another device than `serial` says, or from two devices. They may also come from another IMU
        /// of the vehicle than the log that the table was made from. `replay` only warns of it.
        OTHER_DEVICE = "other-device", FaultOrWarning,
            "Give the samples of this device, or correct `serial`; for a log, correct `--instance`. `--other-device` \
             makes the table anyway, as `--accept other-device` does.";
    }
    "Time" "" {
        /// `interval_ns` differs by more than 1 % from the time between rows, or the intervals add up to more than 1.01
        /// of the elapsed time. The time between rows is the median over consecutive sequences, of all dwells or of
        /// one. The column may be in microseconds, hold the interval of a single sample next to sums, or hold a nominal
        /// interval. It is a warning, with the error of the scale factors, if all dwells differ by more than 200 ppm
        /// and 5 standard errors.
        INTERVAL = "interval", FaultOrWarning, "Give the measured time of each row, in nanoseconds.";
        /// The rows have another interval than the readings that the table is made for. The median of their intervals
        /// is not within 1 % of 1 to 64 times the table's `nominal_interval_s`. `replay` only warns of it. Readings of
        /// other programs are not judged, because they become pulses of the table.
        INTERVAL_NOT_NOMINAL = "interval-not-nominal", FaultOrWarning,
            "Give the table for this interval, or the rows that it was made for: docs/table.md#readings-format-3.";
        /// More than 1 % of the rows are missing, by sequence or by time. `replay` reports any missing row. `noise`
        /// bridges gaps of up to 16 rows, and reports it. If it bridges more than 2 %, or if longer gaps leave less
        /// than half of the rows, it writes no file for Kalibr.
        MISSING_ROWS = "missing-rows", Warning,
            "Give all pieces of the recording. If they are all there, find out what loses the rows.";
        /// Time is lost or counted twice within a dwell or a ramp, without a gap in `sequence`. In a turn this is
        /// `turn-gap`.
        TIME_STEP = "time-step", Warning,
            "Find out where the acquisition loses time: docs/recordings.md#missing-rows-and-lost-time.";
        /// A dwell is shorter than 0.6 of the usual length.
        SHORT_DWELL = "short-dwell", Warning, "Check whether the file is cut.";
        /// The time between two set points is shorter than `soak_s`. If `soak_s` is not given, less than 3600 s is a
        /// warning.
        SOAK = "soak", FaultOrWarning, "Soak longer.";
        /// Positions that are more than 45 degrees apart follow each other within 0.2 s. All times are in microseconds,
        /// or they were made up.
        IMPOSSIBLE_MOTION = "impossible-motion", Fault, "Give the true times, in nanoseconds.";
        /// From one set point to the next the temperature changes by more than 1 degC/s (median). The times are in
        /// microseconds, or they were made up.
        IMPOSSIBLE_RAMP = "impossible-ramp", Fault, "Give the true times, in nanoseconds.";
        /// The samples have no common clock for the whole campaign. They are files by position with a clock each, or
        /// means. The message lists what is not checked: soak, fast motions and drift; for means also motion and noise
        /// within a dwell.
        NO_TIMES = "no-times", Warning, "Give files with date and time, or rows instead of means.";
        /// The campaign seems to last more than 100 days.
        DURATION = "duration", Warning, "Give the times in nanoseconds.";
    }
    "Temperature" "" {
        /// The temperature is the same in every row of every set point. The sensor is not connected.
        TEMPERATURE_CONSTANT = "temperature-constant", Final, "Connect the sensor and measure again.";
        /// The temperature of a row is outside the span of all set points by more than 10 times that span. The reading
        /// is broken.
        TEMPERATURE_READING = "temperature-reading", Final, "Correct the row, or leave the dwell out with `--exclude`.";
        /// The temperature has the same digits in two dwells at two set points, although its digits differ between set
        /// points elsewhere. The sensor was lost.
        TEMPERATURE_REPEATED = "temperature-repeated", Fault, "Measure again.";
        /// The temperature changes too much within a dwell. It changes by more than half the distance to the
        /// neighbouring set points, and by more than 3 times what is usual in a dwell. A reading is broken, or the soak
        /// was too short. More than a tenth of that distance at one set point is a warning. So is any such change if
        /// set points are not further apart than noise and digits, as with an oven or few digits.
        TEMPERATURE_DRIFT = "temperature-drift", FaultOrWarning, "Correct or exclude the rows, or soak longer.";
        /// A temperature in `degC` or `K` changes by more than 1.5 for each degC of the set points, which span 15 degC
        /// or more. A temperature in Fahrenheit changes by 1.8.
        TEMPERATURE_SLOPE = "temperature-slope", Fault, "Convert the temperature, or state its unit.";
        /// A temperature in `degC` or `K` is more than 150 degC away from the set points. Kelvin is labelled as degC,
        /// or the reverse. More than 30 degC is a warning, since an IMU may have an oven.
        TEMPERATURE_OFFSET = "temperature-offset", FaultOrWarning, "State the unit of the temperature.";
        /// The temperature is on the wrong side of a neighbouring set point, by more than half a step. The message
        /// names two set points that look exchanged.
        TEMPERATURE_ORDER = "temperature-order", Warning,
            "Correct the column `set_point_c` of the samples, or the temperature columns if they are another sensor's.";
        /// Two set points have the same temperature.
        SET_POINT = "set-point", Warning, "Check whether the set point was reached.";
    }
    "Pulses and positions" "" {
        /// A channel is saturated. It is at `max_rate`, or its converter is full: it has the same rate in every part of
        /// dwells at two set points, and nowhere more. At least 20 parts are needed, with more than a million pulses in
        /// each dwell. With fewer pulses it is a warning.
        SATURATED = "saturated", FaultOrWarning, "Use a larger range, or leave the set points out.";
        /// A counter wraps within a row. Its channel counts more than 1.25 times as much in short rows, such as those
        /// of turns, as in longer ones.
        COUNTER_WRAPS = "counter-wraps", Fault, "Record short rows throughout.";
        /// A dwell differs by more than 0.1 g0 from what its position asks for. It has another position, or the
        /// turntable moved. In a ramp, an accelerometer differs on average by more than 0.1 g0 from the
        /// `specific_force` of the ramp.
        WRONG_POSITION = "wrong-position", Fault,
            "Correct the rows, or leave the dwell out with `--exclude`. For a ramp, correct `specific_force`, or leave \
             it out.";
        /// A position contradicts the other positions. It differs by more than 1e-3 g0, 20 of its own standard errors,
        /// and 5 times the residuals of the others (scaled by what their errors grow to in this position). An angle is
        /// wrong, or pulses were lost.
        POSITION_OFF = "position-off", Fault,
            "Correct the angles by the measured direction, which the message gives, or measure again.";
        /// A part of a dwell differs by more than 0.02 g0 from the rest. The IMU moved, or a channel was disturbed. It
        /// is a warning from 10 of the dwell's own standard deviations, and pulses, upward.
        NOT_STILL = "not-still", FaultOrWarning, "Leave the dwell out with `--exclude`.";
        /// K+ and |K-| of one accelerometer differ by more than a factor of 1.5. One channel is divided, or it loses
        /// pulses.
        CHANNELS_DIFFER = "channels-differ", Fault, "Correct the channel and measure again.";
        /// Local gravity differs by more than 0.002 m/s2 from normal gravity at the stated latitude and height. All
        /// scale factors are wrong in the same proportion.
        LOCAL_GRAVITY = "local-gravity", Warning, "Look up local gravity; state the height in metres.";
        /// The scale factors of a triad, or K+ and K- of a sensor, differ by more than a factor of 2.
        AXES_DIFFER = "axes-differ", Warning, "Look for a lost digit, or for pulses that are divided.";
        /// Counts look like rates, or rates look like counts. The scale factors, which gravity gives, differ from
        /// `nominal_scale_factor` by more than a factor of 2; or the specific force of a dwell is a multiple of gravity
        /// where other dwells have gravity. It is a warning if only the numbers show it: all rates are whole numbers,
        /// or they are not whole pulses in the gate.
        COUNTS_OR_RATES = "counts-or-rates", FaultOrWarning,
            "State `kind` and `gate_s` as the numbers are; give files of one kind.";
    }
    "The fit" "" {
        /// One position has a residual at all temperatures that a tilt does not explain, or a level error is not
        /// estimated and may not cancel. If it does not cancel, no accuracy is stated.
        LEVEL = "level", Warning,
            "Correct the angles or the number of the position, or measure it again. Otherwise, state all angles, or \
             measure pairs of opposite headings.";
        /// Set points scatter about a curve by more than 8 times their own errors. The limit is 6 times where a higher
        /// order predicts the set points left out better. One line names the worst curve and the number of others.
        LACK_OF_FIT = "lack-of-fit", Warning,
            "Use a higher `--order`, measure more set points, or look in the report for a set point that stands out.";
        /// A curve has as many coefficients as there are set points. Its errors are not known.
        NO_FREEDOM = "no-freedom", Warning, "Measure more set points, or use a lower `--order`.";
        /// A dwell is more than 6 standard deviations away from the fit. It is kept.
        OUTLIER = "outlier", Warning, "Look for the cause; `--exclude` leaves the dwell out.";
        /// The residuals of a curve are not independent, or heating and cooling differ. F and standard errors are not
        /// reliable.
        RESIDUALS = "residuals", Warning, "Soak longer, or record ramps: docs/temperature-in-motion.md.";
    }
    "Diagnoses" "A single mistake that explains the data is printed first. It explains them if the residuals fall to \
        a tenth or less without it. The mistakes below are tried, and also one wrong position and intervals that are \
        not those of the rows. If a position is wrong because the IMU moved, the motion is the diagnosis. Up to three \
        mistakes that explain the data equally well are named; if there are more, none is. A diagnosis changes \
        nothing, and no table is made. The faults that a diagnosis explains keep their own names. With `--accept` the \
        last line of a refusal lists all names that must be accepted. Missing or dead channels and times in a wrong \
        unit are found without a trial." {
        /// Two positions are exchanged, everywhere or at some set points, or all numbers are shifted.
        POSITIONS_EXCHANGED = "positions-exchanged", Fault, "Correct the numbers as the message shows.";
        /// Two accelerometers or two gyroscopes are exchanged, or the IMU is mounted in another way.
        AXES_EXCHANGED = "axes-exchanged", Fault, "Correct columns or positions as the message shows.";
        /// Channels or a sign are exchanged. They are the two channels of one accelerometer, one channel of each of
        /// two, or a sign of the specific force.
        CHANNELS_EXCHANGED = "channels-exchanged", Fault, "Correct columns or signs as the message shows.";
        /// The misalignments change at a set point, while each set point agrees with itself. From there on it is
        /// another device, or the IMU was turned on its fixture.
        DEVICE_CHANGED = "device-changed", Fault, "Remove the rows before or after the change, or measure again.";
        /// The IMU is turned against the campaign file, or `outer_deg` or `inner_deg` of all positions is wrong by 90
        /// or 180 degrees.
        HEADING = "heading", Fault, "Correct the positions as the message shows.";
    }
    "Gyroscopes" "A mistake in a turn that occurs at every set point is printed in one line." {
        /// A turn of the campaign file is missing at a set point. It was not made, or the file is cut.
        MISSING_TURN = "missing-turn", Final,
            "Make it, or leave it out with `--exclude SET_POINT/TURN` if another turn drives the same channel.";
        /// A turn does not begin or end at rest. Its first or last half second, or its first or last row if that is
        /// longer, differs by 0.02 deg/s from the dwells. Rows before or after the turn have no number.
        TURN_REST = "turn-rest", Fault, "Number the rows from rest to rest.";
        /// Samples of a turn are lost, and with them the angle of that time. Steps of `sequence` differ within the
        /// turn, or its intervals differ by more than 0.1 ms from its time.
        TURN_GAP = "turn-gap", Fault, "Make the turn again.";
        /// A row of a turn spans more than 30 deg, as rows of 10 s do.
        TURN_ROWS = "turn-rows", Fault, "Record shorter rows.";
        /// The pulses of a turn show the opposite direction, or an angle that differs by more than 2 % from that of the
        /// gyroscope's other turns. Axis, sign or angle is wrong (such as 720 deg for 360), or channels are exchanged.
        TURN_ANGLE = "turn-angle", Fault, "Correct the campaign file.";
        /// Earth's horizontal rate differs from that at `latitude_deg` by more than 0.02 deg/h and 5 of its errors. The
        /// latitude is wrong, or all scale factors are wrong alike. It is a warning if the g-sensitivities look like
        /// those of the other hemisphere.
        LATITUDE = "latitude", FaultOrWarning, "State the latitude, north positive.";
        /// Without angles, a part of Earth's horizontal rate does not cancel. The message gives its size.
        EARTH_RATE = "earth-rate", Warning,
            "Measure each direction in two headings 180 degrees apart, turn about the vertical, or state the angles.";
        /// The samples have gyroscopes, but the campaign file has no `[[turn]]`. Only the accelerometers are
        /// calibrated.
        NO_TURNS = "no-turns", Warning, "Make turns, for a table with gyroscopes.";
    }
    "Ramps" "" {
        /// A bias steps within a ramp. The IMU was bumped, or a sensor jumps. It is a warning up to a fifth of the span
        /// of the bias curve.
        RAMP_STEP = "ramp-step", FaultOrWarning,
            "Record the ramp again with the IMU held fast, or give the part before or after it as a ramp of its own.";
        /// The IMU moved or was bumped, or its vehicle was armed or flew. These rows are left out. The stretches at
        /// rest are used, and those at different attitudes get a constant each. It is a fault if every stretch is too
        /// short.
        MOTION = "motion", FaultOrWarning,
            "Do nothing if the used stretches cover the temperatures. Otherwise, record the warm-up disarmed, on firm \
             ground.";
        /// Rows hold values that no sensor measured. Examples are markers such as 0 or -32768, spikes, values that are
        /// not numbers, temperatures that no IMU has, and values that never change. Rows of a text and chunks of MCAP
        /// may also be cut or corrupt, as a disk leaves them. All of them are left out. More than 5 % of the rows is a
        /// fault; a text of another program with more than 1 % is refused.
        BAD_ROWS = "bad-rows", FaultOrWarning, "Check the sensor, its cable, its logger and the disk.";
        /// The thermometer stops changing while the biases continue to move. These rows are left out.
        TEMPERATURE_STUCK = "temperature-stuck", Warning,
            "Check the thermometer and its driver; record again if the remaining temperatures do not suffice.";
        /// A ramp has another shape than the others, while its own sweeps agree. It is from another device.
        RAMP_DEVICE = "ramp-device", Fault, "Give the ramps of one device.";
        /// Sweeps differ by more than 4 of their jackknife errors, and by more than a lag explains.
        RAMP_SWEEPS = "ramp-sweeps", Warning,
            "Allow for the stated error of the curves; hold the IMU and its fixture steadier, and begin soaked.";
        /// No ramp heats and cools over half of the range. The error of its curves is not known, and those of `curves`
        /// depend on temperature, or have an error. It is a warning for recordings at one attitude.
        ONE_DIRECTION = "one-direction", FaultOrWarning,
            "Heat and cool in one recording. `--replace-curves` makes the table anyway.";
        /// A transient is written to the table although other causes are possible. The ramps have specific force along
        /// the axis, so that a converter that lags its thermometer would look the same; or the time constant was given,
        /// and the ramps would not show it.
        TRANSIENT = "transient", Warning,
            "Record the axis horizontal; verify with a run at another rate: docs/temperature-in-motion.md.";
        /// A gyroscope indicates more than 10 deg/s on average, in a recording at rest.
        RATE_AT_REST = "rate-at-rest", Fault, "Give the readings in rad/s; keep the IMU at rest.";
        /// The temperature never settles. The curve therefore contains the lag of the element everywhere.
        NOT_SETTLED = "not-settled", Warning, "Warm up more slowly, or wait at the end of each sweep.";
        /// The parameters that `--beside` names leave smaller residuals than the table. On the same rows, the cubic of
        /// an autopilot, or parameters that are on board, leave less than 0.9 of what the table leaves.
        BESIDE_LEAVES_LESS = "beside-leaves-less", Warning,
            "Compare the residuals in the report, or give `--order 3`.";
        /// Only one of ramps and table has gyroscopes.
        RAMP_GYROSCOPES = "ramp-gyroscopes", Warning, "Record ramps of the same IMU, with all of its columns.";
    }
    "Without a turntable" "`interval`, `lack-of-fit`, `no-freedom`, `outlier` and other findings above occur here, \
        too." {
        /// The rates of an accelerometer lie about a centre of more than 1 g0. They still contain the offset of an
        /// unsigned count.
        COUNT_OFFSET = "count-offset", Fault,
            "Subtract it with `isotherm convert`, with `offset` in the mapping file.";
        /// The bias of exactly one accelerometer is gravity. A self-calibration at one attitude took gravity for a
        /// bias.
        GRAVITY_ZEROED = "gravity-zeroed", Final, "Undo the self-calibration of the device, and record again.";
        /// All static poses have one attitude, or the IMU was turned about only one axis.
        NEVER_TURNED = "never-turned", Final, "Put the IMU down on its faces, edges and corners.";
        /// The attitudes separate the parameters badly. D sqrt(n) is more than 20, so an error of a static pose is
        /// amplified strongly.
        ATTITUDES = "attitudes", Warning, "Put the IMU down in the attitudes that the message names.";
        /// The data have only two temperatures. They differ, but cannot show a curvature, so the table has their mean.
        TEMPERATURES = "temperatures", Warning, "Measure at a third temperature, or ask for a line: `--order 1`.";
        /// Files, power-ups or temperatures differ by more than temperature explains. The intervals include what they
        /// share.
        GROUPS_DIFFER = "groups-differ", FaultOrWarning,
            "Check whether a file is from another device, or whether the thermometer is far from the element. If \
             neither is so, record more files.";
        /// The bias walks while the IMU is put down in its attitudes. The intervals include it.
        WALK = "walk", Warning, "Wait until temperature and power are steady, then tumble without a pause.";
        /// The accelerometers lag or lead their temperature.
        BEHIND_TEMPERATURE = "behind-temperature", Warning, "Wait until the temperature settles, then tumble.";
        /// The temperature moved so much in a tumble that an element with a lag of up to 60 s makes most of the error.
        TEMPERATURE_MOVES = "temperature-moves", Warning, "Wait until the temperature settles, then tumble.";
        /// The range of the table is far wider than the measured temperatures. Its intervals are valid only for the
        /// measured ones.
        UNMEASURED = "unmeasured", Warning, "Tumble at other temperatures, too, or give a narrower `--temperature-range`.";
        /// A reading of the temperature contradicts the others of its static pose, such as the error codes 85, -127 and
        /// 0. It is left out of means and ranges; a static pose with many is left out.
        TEMPERATURE_GLITCH = "temperature-glitch", Warning, "Check the cable of the thermometer.";
        /// An axis does not feel gravity in one file or at one temperature.
        DEAD_AXIS = "dead-axis", Fault, "Check its column and its converter.";
        /// The scale of an axis differs by a factor in one file or at one temperature.
        SCALE_CHANGED = "scale-changed", Fault, "Give all files in one unit, of one IMU and with one range.";
        /// The IMU turned within static poses, which makes their specific force too small. They are left out.
        TURNED = "turned", Warning, "Put the IMU on firm ground.";
    }
    "Recordings" "`verify`, `noise` and `convert` report these, and also `interval`, `missing-rows`, `time-step`, \
        `bad-rows` and `other-device`." {
        /// The end of a file is missing. Its writer was killed, or the copy is not complete.
        TRUNCATED = "truncated", Warning, "Copy the file again; what it has is used.";
        /// Only one of recording and table has gyroscopes. They are left out.
        NO_GYROSCOPES = "no-gyroscopes", Warning, "Give the table and the recording of the same IMU.";
        /// The data have no temperature, or none at their beginning. A placeholder or the first temperature is used
        /// instead.
        NO_TEMPERATURE = "no-temperature", Warning, "Give `--temperature`, or a source that has one.";
        /// All rows of third-party data, of more than 60 s, have one and the same measured temperature. The thermometer
        /// is dead or coarse, or its stamps are not of the clock of the rows.
        ONE_TEMPERATURE = "one-temperature", Warning,
            "Check the thermometer and its stamps. Do nothing if the temperature was that steady.";
        /// The IMU and the thermometer of a bag are stamped by clocks that are apart, so that rows have the temperature
        /// of another time. Messages that were recorded at the same time have stamps that differ by more than 1 s, and
        /// by more than twice the time between two temperatures. It is a fault in `calibrate`, and a warning elsewhere.
        CLOCKS_APART = "clocks-apart", FaultOrWarning,
            "Set the clocks and record again, or give `--time log`, which takes the times of recording for both.";
        /// Rows of a log cannot be used, and are left out. Their times do not follow those of the others, a value is
        /// not a number, or a temperature is missing. The log is damaged, or its driver was not ready.
        ROWS_LEFT_OUT = "rows-left-out", Warning,
            "Copy the log again. If that does not help, look at the rows around the place that the message names.";
        /// A sensor of a log repeats the same sample. Its driver or its bus had stopped. These rows are left out.
        STALLED = "stalled", Warning, "Check the sensor and its bus; the other rows are used.";
        /// All accelerometers are 0 in some rows. No attitude gives that, so values were lost.
        ZEROS = "zeros", Warning, "Check the logger; leave these rows out.";
        /// Counts jump by their whole range, there and back. A counter wraps, or signed counts were read as unsigned.
        WRAPPED = "wrapped", Fault, "Use a larger range, or convert the data again with the right type.";
        /// The order of bytes is wrong. With the two bytes of each count exchanged, the counts change far less from row
        /// to row.
        BYTE_ORDER = "byte-order", Fault, "Convert the data again with the other order of bytes.";
        /// Stamps of third-party data cannot be right: they do not rise, or are off the line through the rows around
        /// them. Their rows are left out and are missing, and the message has their number and their share. `noise`
        /// refuses more than 5 %. Stamps that jitter or come in bursts are those of arrival: their rows are put on an
        /// even clock. In a bag, each row has the last temperature that was recorded before it if fewer than a tenth of
        /// the rows are stamped between the first and the last temperature, or if the stamps of a topic do not rise.
        STAMPS = "stamps", Warning,
            "Stamp the samples where they are taken, or give `interval_s`. Stamp the temperatures of a bag with the \
             clock of its IMU.";
        /// The clock of third-party data starts again. A logger was restarted, or its clock was set back. The rows
        /// after that are another session.
        NEW_SESSION = "new-session", Warning, "Do nothing if the logger was restarted there.";
        /// A counter of the time rolled over, and was joined.
        ROLLOVER = "rollover", Warning, "Do nothing if the recording is as long as that.";
        /// The IMU itself reports errors in some rows.
        IMU_ERROR = "imu-error", Warning, "Check the IMU; leave these rows out.";
    }
    "Verification" "" {
        /// The table was made from this recording, or from rows of it. It fits them in whatever state the IMU is now.
        OWN_RECORDING = "own-recording", Warning, "Verify with a recording that the table was not made from.";
        /// The magnitude of the specific force at rest differs by more than 2 % from gravity, or too many windows of a
        /// run differ. Nothing is claimed.
        NOT_GRAVITY = "not-gravity", FaultOrWarning, "Keep the IMU at rest; give the table and the intervals of this IMU.";
        /// Too many windows are left out. Nothing is claimed of the whole run.
        UNJUDGED = "unjudged", Warning, "Keep the IMU at one attitude; look at the windows that the message counts.";
        /// The judged windows leave a gap of more than a tenth of the range of a curve. No bound is met over that gap.
        NOT_COVERED = "not-covered", Fault, "Record over the whole range of the table, or accept that the gap is not judged.";
        /// The output differs on average by more than 0.005 g0 from the stated attitude.
        ATTITUDE_OFF = "attitude-off", Warning, "State the attitude of the run, or look for the error of the table.";
    }
    "Noise at rest" "" {
        /// The counts of a sensor never change.
        RATE_CONSTANT = "rate-constant", Warning, "Check the sensor and its cable.";
        /// A rate jumped permanently. The IMU was knocked, or the sensor jumped. The curve is computed without the
        /// jump, and K is not given.
        NOISE_STEP = "noise-step", Warning, "Record again without knocks, or leave it out with `--from` and `--to`.";
        /// Rows correlate more than the noise model allows. A low-pass filter or vibration does that. N is then the one
        /// at longer tau, and Q is not given.
        NOISE_FILTERED = "noise-filtered", Warning, "Use N above the tau that the message gives, or turn the filter off.";
        /// Each value appears in several rows, regularly. The sensor gives fewer values than there are rows.
        REPEATED = "repeated", Warning, "Record each value once, at the rate that the message gives.";
        /// The noise of a row is smaller than a step of the counts. The counts repeat a pattern, so Q and N are not
        /// those of the sensor.
        LIMIT_CYCLE = "limit-cycle", Warning, "Record with a longer interval.";
        /// The model of Q, N, B and K does not describe the data, or cannot be fitted. No ranges are given.
        NOISE_MODEL = "noise-model", Warning, "Look at the curve: the model covers no knock, filter or pattern.";
        /// From some tau on, the temperature explains the Allan deviation.
        NOISE_TEMPERATURE = "noise-temperature", Warning, "Record at a steadier temperature.";
    }
    "Instruments" "`campaign check` and `campaign run` report these." {
        /// The alarms of the chamber are not read. An alarm is then seen only when the chamber leaves its set point.
        ALARMS_NOT_READ = "alarms-not-read", Warning, "Give the key of the driver that the message names.";
        /// The faults of the turntable are not read. A fault is then seen only when the turntable does not arrive.
        FAULTS_NOT_READ = "faults-not-read", Warning, "Give the key of the driver that the message names.";
    }
    "Tables" "`compare` and the statistics of a batch report these." {
        /// A provenance has no errors. Nothing shows whether a difference exceeds them.
        ERRORS_UNKNOWN = "errors-unknown", Warning, "Make the table again with `calibrate`, which writes them.";
        /// A part is not compared, because not all tables have it. In a campaign, the table in force cannot judge a
        /// verification run, so nothing shows that the new one is not worse.
        NOT_COMPARED = "not-compared", FaultOrWarning,
            "Give tables that have the part; move a table away that cannot judge the IMU.";
        /// Two tables have the same coefficients, whatever their names, or they were made from the same rows. Their
        /// differences do not show what the IMU does.
        SAME_TABLE = "same-table", Warning, "Give tables of two campaigns.";
        /// The serial numbers of the tables differ.
        SERIALS = "serials", Warning, "Give the tables of one device.";
        /// The new table is older than the old one, by its date.
        DATES = "dates", Warning, "Give the old table first.";
    }
}

/// Every name with its explanation.
pub fn explanations() -> impl Iterator<Item = &'static Explanation> {
    SUBJECTS.iter().flat_map(|subject| subject.names)
}

/// The name of a finding that the user accepts.
///
/// # Errors
/// If no finding has this name, or if a fault of this name leaves nothing to fit. The message lists the names.
pub fn acceptable(text: &str) -> Result<&'static str, String> {
    match explanations().find(|known| known.name == text) {
        Some(Explanation { name, rank: Rank::Final, remedy, .. }) => {
            Err(format!("{name} cannot be accepted, because nothing is left to fit. {remedy}"))
        }
        Some(known) => Ok(known.name),
        None => {
            let names = explanations().filter(|known| known.rank != Rank::Final).map(|known| known.name);
            Err(format!("give the name of a finding: {}", names.collect::<Vec<_>>().join(", ")))
        }
    }
}
