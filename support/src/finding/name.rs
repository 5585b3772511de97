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
        /// A position of the campaign file is missing at a set point: it was not measured, or the file is cut.
        MISSING_POSITION = "missing-position", Final,
            "Measure it, leave it out with `--exclude SET_POINT/POSITION`, or take it out of the campaign file.";
        /// There are fewer than two set points.
        SET_POINTS = "set-points", Final, "Measure more.";
        /// An accelerometer gives no pulses on the channel of its direction: a dead channel, exchanged channels or
        /// signs.
        NO_PULSES = "no-pulses", Final, "Fix the cable, the columns or the positions.";
        /// A recording, or a part of it, is there twice: the second shows nothing, and would halve the errors.
        SAME_RECORDING = "same-recording", Final, "Name every recording once.";
        /// Rows are of another device than that of `serial`, or of two devices; or they are of another IMU of a vehicle
        /// than the log that made the table, by number or device. Of `replay` and `noise` a warning.
        OTHER_DEVICE = "other-device", FaultOrWarning,
            "Give the samples of this unit, or correct `serial`; of a log, `--instance`. `--other-device` makes the \
             table all the same, as `--accept other-device` does.";
    }
    "Time" "" {
        /// `interval_ns` differs by over 1 % from the time from row to row (the median over rows with consecutive
        /// sequences, of all dwells or of one), or the intervals add up to over 1.01 of the elapsed time: microseconds,
        /// the interval of a single sample under sums, or a nominal interval. A warning, with the error of the scale
        /// factors, if in all dwells by over 200 ppm and 5 standard errors.
        INTERVAL = "interval", FaultOrWarning, "Give the measured time of each row, in nanoseconds.";
        /// The interval of the rows, the median, is not within 1 % of 1 to 64 times the `nominal_interval_s` of the
        /// table: its scale factors are of readings at another interval. Of `replay` a warning.
        INTERVAL_NOT_NOMINAL = "interval-not-nominal", FaultOrWarning,
            "Give the table of this interval, or the rows that it is of: docs/table.md#readings-format-3.";
        /// Over 1 % of the rows are missing, by sequence or time; of `replay` any. `noise` bridges gaps of up to 16
        /// rows, and says so. Over 2 %, or where longer gaps leave less than half of the rows, it writes no file for
        /// Kalibr.
        MISSING_ROWS = "missing-rows", Warning, "Give all pieces of the recording; else look for what loses them.";
        /// Time is lost, or counted twice, within a dwell or a ramp, without a hole in `sequence`. In a turn it is
        /// `turn-gap`.
        TIME_STEP = "time-step", Warning,
            "Look for time that the acquisition loses: docs/recordings.md#missing-rows-and-lost-time.";
        /// A dwell is shorter than 0.6 of the usual.
        SHORT_DWELL = "short-dwell", Warning, "Look whether the file is cut.";
        /// There are less than `soak_s` between two set points. A warning below 3600 s if `soak_s` is not given.
        SOAK = "soak", FaultOrWarning, "Soak longer.";
        /// Positions over 45 degrees apart follow each other within 0.2 s: all times are in microseconds, or were made
        /// up.
        IMPOSSIBLE_MOTION = "impossible-motion", Fault, "Give the true times, in nanoseconds.";
        /// From set point to set point the temperature changes by over 1 degC/s (median): times in microseconds, or
        /// made up.
        IMPOSSIBLE_RAMP = "impossible-ramp", Fault, "Give the true times, in nanoseconds.";
        /// The samples have no times that hold for the whole campaign: files by position with clocks of their own, or
        /// means. The message says what is not looked at: soak, fast motions, drift, and of means also motion and noise
        /// within a dwell.
        NO_TIMES = "no-times", Warning, "Give files with date and time, or rows in place of means.";
        /// The campaign seems to last over 100 days.
        DURATION = "duration", Warning, "Give the times in nanoseconds.";
    }
    "Temperature" "" {
        /// Temperature is the same in every row of every set point: the sensor is not connected.
        TEMPERATURE_CONSTANT = "temperature-constant", Final, "Fix it and measure again.";
        /// Temperature of a row is over 10 times the span of all set points beyond them: a broken reading.
        TEMPERATURE_READING = "temperature-reading", Final, "Fix the row, or leave the dwell out with `--exclude`.";
        /// Temperature has the same digits in two dwells at two set points, which its digits tell apart elsewhere: the
        /// sensor was lost.
        TEMPERATURE_REPEATED = "temperature-repeated", Fault, "Measure again.";
        /// Temperature changes within a dwell by over half the distance to the neighbouring set points, and over 3
        /// times as much as is usual in a dwell: a broken reading, or too short a soak. A warning if by over a tenth at
        /// one set point, or if set points are not further apart than noise and digits: an oven, or few digits.
        TEMPERATURE_DRIFT = "temperature-drift", FaultOrWarning, "Fix or exclude the rows; soak longer.";
        /// Temperature in `degC` or `K` changes by over 1.5 for each degC of set points that span 15 degC or more.
        /// Fahrenheit has 1.8.
        TEMPERATURE_SLOPE = "temperature-slope", Fault, "Convert it, or state its unit.";
        /// Temperature in `degC` or `K` is over 150 degC off the set points: kelvin as degC, or the reverse. A warning
        /// over 30 degC: an IMU with an oven.
        TEMPERATURE_OFFSET = "temperature-offset", FaultOrWarning, "State its unit.";
        /// Temperature is over half a step on the wrong side of a neighbouring set point. Two set points that look
        /// exchanged are named.
        TEMPERATURE_ORDER = "temperature-order", Warning,
            "Fix the samples' column `set_point_c`, or the columns of temperature if they are of another sensor.";
        /// Two set points have the same temperature.
        SET_POINT = "set-point", Warning, "Look whether the set point was reached.";
    }
    "Pulses and positions" "" {
        /// A channel is at `max_rate`; or it has the same rate in every part of dwells at two set points (20 parts or
        /// more, of over a million pulses a dwell) and nowhere more: the converter is full. A warning with fewer
        /// pulses.
        SATURATED = "saturated", FaultOrWarning, "Take a larger range, or leave the set points out.";
        /// A channel counts over 1.25 times as much in short rows, such as those of turns, as in longer ones: its
        /// counter wraps within a row.
        COUNTER_WRAPS = "counter-wraps", Fault, "Record short rows throughout.";
        /// A dwell is over 0.1 g0 off what its position asks for: another position, or a table that moved. Of a ramp:
        /// an accelerometer indicates over 0.1 g0 more or less, on average, than the `specific_force` of the ramp says.
        WRONG_POSITION = "wrong-position", Fault,
            "Fix the rows, or leave the dwell out with `--exclude`. Of a ramp: correct `specific_force`, or state \
             none.";
        /// A position is over 1e-3 g0 off what the other positions say, over 20 of its own standard errors, and over 5
        /// times the others' residuals (times what their errors grow to in this position): a wrong angle, or pulses
        /// that were lost.
        POSITION_OFF = "position-off", Fault,
            "The line has the measured direction: correct the angles, or measure again.";
        /// A part of a dwell is over 0.02 g0 off the rest: motion, or a disturbed channel. A warning from 10 of the
        /// dwell's own standard deviations, and pulses, on.
        NOT_STILL = "not-still", FaultOrWarning, "Leave the dwell out with `--exclude`.";
        /// K+ and |K-| of one accelerometer differ by over a factor of 1.5: one channel is divided, or loses pulses.
        CHANNELS_DIFFER = "channels-differ", Fault, "Fix it and measure again.";
        /// Local gravity is over 0.002 m/s2 off normal gravity at the stated latitude and height. It is in proportion
        /// in all scale factors.
        LOCAL_GRAVITY = "local-gravity", Warning, "Look up local gravity; state the height in metres.";
        /// Scale factors of a triad, or K+ and K- of a sensor, differ by over a factor of 2.
        AXES_DIFFER = "axes-differ", Warning, "Look for a lost digit, or for pulses that are divided.";
        /// Counts look like rates, or rates like counts: the scale factors, which gravity gives, are over a factor of 2
        /// off `nominal_scale_factor`; or the specific force of a dwell is a multiple of gravity, where others have
        /// gravity. A warning if the numbers alone say so: rates that are all whole, or that are no whole pulses in the
        /// gate.
        COUNTS_OR_RATES = "counts-or-rates", FaultOrWarning,
            "Give `kind` and `gate_s` as the numbers are; give files of one kind.";
    }
    "The fit" "" {
        /// A residual in one position at all temperatures that no tilt explains; or a level error that is not estimated
        /// and may not cancel. Where it does not cancel, no accuracy is stated.
        LEVEL = "level", Warning,
            "Correct the angles or the number of the position, or measure it again; state all angles, or measure \
             pairs of \
             opposite headings.";
        /// Set points scatter about a curve by over 8 times their own errors, or by over 6 times where a higher order
        /// is better at set points left out. One line names the worst curve and the number of others.
        LACK_OF_FIT = "lack-of-fit", Warning,
            "Take a higher `--order`, measure more set points, or look in the report for one that is off.";
        /// A curve has as many coefficients as there are set points: its errors are not known.
        NO_FREEDOM = "no-freedom", Warning, "Measure more set points, or take a lower `--order`.";
        /// A dwell is over 6 standard deviations off the fit. It is kept.
        OUTLIER = "outlier", Warning, "Look for its cause; `--exclude` leaves it out.";
        /// The residuals of a curve are not independent, or heating and cooling differ: F and standard errors are not
        /// reliable.
        RESIDUALS = "residuals", Warning, "Soak longer, or record ramps: docs/temperature-in-motion.md.";
    }
    "Diagnoses" "A single mistake that explains the data, because residuals fall to a tenth or less, is printed \
        first. Tried are those below, one position that is off, and intervals that are not the rows'. If a \
        position is off where the IMU moved, the motion is the diagnosis. Up to three mistakes that explain \
        the data equally well are named; of more, none. A diagnosis fixes nothing: no table is made. Faults \
        that it explains have their own names; with `--accept` the last line of a refusal lists all that \
        must be accepted. What is missing or dead everywhere, and times in a wrong unit, are found without a \
        trial." {
        /// Two positions are exchanged, everywhere or at some set points, or all numbers are shifted.
        POSITIONS_EXCHANGED = "positions-exchanged", Fault, "Correct the numbers, as the line says.";
        /// Two accelerometers or gyroscopes are exchanged, or the IMU is mounted otherwise.
        AXES_EXCHANGED = "axes-exchanged", Fault, "Correct columns or positions, as the line says.";
        /// The channels of an accelerometer are exchanged, or one with one of another, or a sign of the specific force.
        CHANNELS_EXCHANGED = "channels-exchanged", Fault, "Correct columns or signs, as the line says.";
        /// From a set point on the misalignments are others, while each set point agrees with itself: another unit, or
        /// an IMU that was turned on its fixture.
        DEVICE_CHANGED = "device-changed", Fault, "Take out the rows of one, or measure again.";
        /// The IMU is turned against the campaign file, or `outer_deg` or `inner_deg` of all positions is off by 90 or
        /// 180.
        HEADING = "heading", Fault, "Correct the positions, as the line says.";
    }
    "Gyroscopes" "What is wrong with a turn at every set point has one line." {
        /// A turn of the campaign file is missing at a set point: it was not taken, or the file is cut.
        MISSING_TURN = "missing-turn", Final,
            "Take it, or leave it out with `--exclude SET_POINT/TURN`, if another turn drives the same channel.";
        /// The first or last half second of a turn, or its first or last row if that is longer, is 0.02 deg/s off the
        /// dwells: rows before or after the turn have no number.
        TURN_REST = "turn-rest", Fault, "Number the rows from rest to rest.";
        /// Steps of `sequence` differ within a turn, or the intervals differ from its time by over 0.1 ms: samples are
        /// lost, and the angle of that time with them.
        TURN_GAP = "turn-gap", Fault, "Take the turn again.";
        /// A row of a turn has over 30 deg, as rows of 10 s have.
        TURN_ROWS = "turn-rows", Fault, "Record shorter rows.";
        /// The pulses of a turn say the other direction, or an angle over 2 % from that of the gyroscope's other turns:
        /// axis, sign or angle, exchanged channels, 720 deg for 360.
        TURN_ANGLE = "turn-angle", Fault, "Correct the campaign file.";
        /// Earth's horizontal rate is over 0.02 deg/h, and 5 of its errors, off that of `latitude_deg`: a wrong
        /// latitude, or all scale factors wrong alike. A warning if the g-sensitivities look like the other hemisphere.
        LATITUDE = "latitude", FaultOrWarning, "State the latitude, north positive.";
        /// Without angles, a part of Earth's horizontal rate does not cancel. The line has its size.
        EARTH_RATE = "earth-rate", Warning,
            "Measure each direction in two headings 180 degrees apart, turn about the vertical, or state the angles.";
        /// The samples have gyroscopes, but the campaign file has no `[[turn]]`: only the accelerometers are
        /// calibrated.
        NO_TURNS = "no-turns", Warning, "Take turns, for a table with gyroscopes.";
    }
    "Ramps" "" {
        /// A bias steps within a ramp: the IMU was bumped, or a sensor jumps. A warning up to a fifth of what its curve
        /// spans.
        RAMP_STEP = "ramp-step", FaultOrWarning,
            "Record the ramp again with the IMU held fast, or give the part before or after it as a ramp of its own.";
        /// The IMU moved, was bumped, or its vehicle was armed or flew: these rows are left out, and the stretches at
        /// rest are used, those of different attitudes with a constant each. A fault if no stretch is long enough.
        MOTION = "motion", FaultOrWarning,
            "Nothing, if what is used covers the temperatures; else record the warm-up disarmed, on firm ground.";
        /// Rows hold values that no sensor measured: markers such as 0 or -32768, spikes, numbers that are none,
        /// temperatures that no IMU has, values that stand still. Or rows of a text are cut or spoilt. All are left
        /// out. A fault over 5 % of the rows; over 1 % a text is refused.
        BAD_ROWS = "bad-rows", FaultOrWarning, "Look at the sensor, its cable and its logger.";
        /// The thermometer stands still while the biases go on: these rows are left out.
        TEMPERATURE_STUCK = "temperature-stuck", Warning,
            "Look at the thermometer and its driver; record again if the temperatures that are left do not suffice.";
        /// A ramp has another shape than the others, while the sweeps of each agree: it is of another device.
        RAMP_DEVICE = "ramp-device", Fault, "Give the ramps of one device.";
        /// Sweeps differ by over 4 of their jackknife errors, and by more than a lag explains.
        RAMP_SWEEPS = "ramp-sweeps", Warning,
            "Allow for the error of the curves that is stated; hold the IMU and its fixture steadier, begin soaked.";
        /// No ramp heats and cools over half of the range: the error of its curves is not known, and those of `curves`
        /// depend on temperature, or have an error. A warning at one attitude.
        ONE_DIRECTION = "one-direction", FaultOrWarning,
            "Heat and cool in one recording. `--replace-curves` makes the table all the same.";
        /// About a transient that is written: the ramps have specific force along the axis, so that a converter behind
        /// its thermometer would look the same; or the time constant was given, and the ramps would not show it.
        TRANSIENT = "transient", Warning,
            "Record the axis horizontal; verify with a run of another rate: docs/temperature-in-motion.md.";
        /// A gyroscope indicates over 10 deg/s on average, in a recording at one attitude or of `noise`.
        RATE_AT_REST = "rate-at-rest", Fault, "Give the readings in rad/s; keep the IMU at rest.";
        /// The temperature never settles: what is behind it by a lag is in the curve everywhere.
        NOT_SETTLED = "not-settled", Warning, "Warm up more slowly, or wait at the end of each sweep.";
        /// With `--beside`: the cubic of an autopilot, or parameters that are on board, leave less than 0.9 of what the
        /// table leaves of the same rows.
        BESIDE_LEAVES_LESS = "beside-leaves-less", Warning, "Look at the residuals in the report, or give --order 3.";
        /// Only one of ramps and table has gyroscopes.
        RAMP_GYROSCOPES = "ramp-gyroscopes", Warning, "Record ramps of the same IMU, with all of its columns.";
    }
    "Without a turntable" "`interval`, `lack-of-fit`, `no-freedom`, `outlier` and others above are found there too." {
        /// The rates of an accelerometer lie about a centre of over 1 g0: the offset of an unsigned count is left in.
        COUNT_OFFSET = "count-offset", Fault, "Take it off with `isotherm convert`, `offset` in the mapping file.";
        /// The bias of one accelerometer alone is gravity: a self-calibration at one attitude took gravity for a bias.
        GRAVITY_ZEROED = "gravity-zeroed", Final, "Undo the self-calibration of the device, and record again.";
        /// All static poses are one attitude, or the IMU was turned about one axis alone.
        NEVER_TURNED = "never-turned", Final, "Put the IMU down on its faces, edges and corners.";
        /// The attitudes tell the parameters apart badly: D sqrt(n) is over 20, an error of a static pose comes out
        /// much larger.
        ATTITUDES = "attitudes", Warning, "Put the IMU down in the attitudes that the line names.";
        /// Two temperatures differ, but show no curvature: the table has their mean.
        TEMPERATURES = "temperatures", Warning, "Measure at a third temperature, or ask for a line: `--order 1`.";
        /// Files, power-ups or temperatures differ beyond what temperature explains. The intervals hold what they
        /// share.
        GROUPS_DIFFER = "groups-differ", FaultOrWarning,
            "Look whether a file is of another device, or the temperature not the element's; else take more files.";
        /// The bias walks while the IMU is put down in its attitudes. The intervals hold it.
        WALK = "walk", Warning, "Wait until temperature and power are steady, then tumble without a pause.";
        /// The accelerometers are behind their temperature, or ahead of it.
        BEHIND_TEMPERATURE = "behind-temperature", Warning, "Wait until the temperature stands still, then tumble.";
        /// Temperature moved so much in a tumble that an element up to 60 s behind it is most of the error.
        TEMPERATURE_MOVES = "temperature-moves", Warning, "Wait until the temperature stands still, then tumble.";
        /// The range of the table is far wider than the temperature that was measured: its intervals hold in that
        /// alone.
        UNMEASURED = "unmeasured", Warning, "Tumble at other temperatures, too, or take a narrower `--temperature-range`.";
        /// Readings of the temperature that the static pose's others exclude, such as the error codes 85, -127 and 0.
        /// They are out of means and ranges; a static pose of many is left out.
        TEMPERATURE_GLITCH = "temperature-glitch", Warning, "Look at the thermometer's cable.";
        /// An axis does not feel gravity in one file or temperature.
        DEAD_AXIS = "dead-axis", Fault, "Look at its column and its converter.";
        /// An axis counts by another factor in one file or temperature.
        SCALE_CHANGED = "scale-changed", Fault, "Give all files in one unit, of one IMU and one range.";
        /// The IMU turned within static poses, which makes their specific force too short: they are left out.
        TURNED = "turned", Warning, "Put the IMU on firm ground.";
    }
    "Recordings" "Of `verify`, `noise` and `convert`, with `interval`, `missing-rows`, `time-step`, `bad-rows` and \
                  `other-device`." {
        /// The end of a file is missing: its writer was killed, or the copy is not complete.
        TRUNCATED = "truncated", Warning, "Copy the file again; what is there is used.";
        /// Only one of recording and table has gyroscopes: they are left out.
        NO_GYROSCOPES = "no-gyroscopes", Warning, "Give the table and the recording of the same IMU.";
        /// The data have no temperature, or none at their beginning: a placeholder, or the first one, stands there.
        NO_TEMPERATURE = "no-temperature", Warning, "Give `--temperature`, or a source that has one.";
        /// Rows of a log cannot be used, and are left out: their times do not follow those of the others, a value is no
        /// number, a temperature is missing. A log is damaged, or its driver was not ready.
        ROWS_LEFT_OUT = "rows-left-out", Warning, "Copy the log again; else look at what is around the place that is named.";
        /// A sensor of a log gives the same sample again and again: its driver or its bus stood still. These rows are
        /// left out.
        STALLED = "stalled", Warning, "Look at the sensor and its bus; what is there of the other rows is used.";
        /// All accelerometers are 0 at once in some rows, which no attitude gives: values were lost.
        ZEROS = "zeros", Warning, "Look at the logger; leave these rows out.";
        /// Counts jump by their whole range, there and back: a counter wraps, or signed counts were read as unsigned.
        WRAPPED = "wrapped", Fault, "Take a larger range, or convert the data anew with the right type.";
        /// With the two bytes of each count exchanged, the counts change far less from row to row.
        BYTE_ORDER = "byte-order", Fault, "Convert the data anew with the other order of bytes.";
        /// The stamps of foreign data jitter, or come in bursts: their rows are put on an even clock. Rows that are
        /// lost cannot be told there. Or up to 1 % of the stamps are bad: they are fixed, or their rows are left out.
        STAMPS = "stamps", Warning, "Stamp the samples where they are taken, or give `interval_s`.";
        /// The clock of foreign data starts again: a logger was restarted, or its clock was set back. The rows behind
        /// it are another session.
        NEW_SESSION = "new-session", Warning, "Nothing, if the logger was started again there.";
        /// A counter of the time rolled over, and was joined.
        ROLLOVER = "rollover", Warning, "Nothing, if the recording is as long as that.";
        /// The IMU itself reports errors in some rows.
        IMU_ERROR = "imu-error", Warning, "Look at the IMU; leave these rows out.";
    }
    "Verification" "" {
        /// The table was made from this recording, or from rows that are in it: it fits, whatever the IMU does now.
        OWN_RECORDING = "own-recording", Warning, "Verify with a recording that the table was not made from.";
        /// The length of the specific force at rest is over 2 % off gravity, or of a run in too many windows: nothing
        /// is claimed.
        NOT_GRAVITY = "not-gravity", FaultOrWarning, "Keep the IMU at rest; give the table and the intervals of this IMU.";
        /// Too many windows are left out: nothing is claimed of the whole run.
        UNJUDGED = "unjudged", Warning, "Keep the IMU at one attitude; look at the windows that the line counts.";
        /// The judged windows leave a hole of over a tenth of the range of a curve: no bound is met over it.
        NOT_COVERED = "not-covered", Fault, "Record over the whole range of the table, or accept that the hole is not judged.";
        /// The output is on average over 5 mg0 off the stated attitude.
        ATTITUDE_OFF = "attitude-off", Warning, "State the attitude of the run, or look for the table's error.";
    }
    "Noise at rest" "" {
        /// The counts of a sensor never change.
        RATE_CONSTANT = "rate-constant", Warning, "Look at the sensor and its cable.";
        /// A rate moved at once and for good: a knock, or a jump of the sensor. The curve is without it, K is not
        /// given.
        NOISE_STEP = "noise-step", Warning, "Record again without knocks, or leave it out with `--from` and `--to`.";
        /// Rows correlate by more than noise of the model: a low-pass, or vibration. N is that of longer tau, Q is not
        /// given.
        NOISE_FILTERED = "noise-filtered", Warning, "Take N above the tau that the line gives, or turn the filter off.";
        /// Values stand in several rows, regularly: the sensor gives fewer than there are rows.
        REPEATED = "repeated", Warning, "Record each value once, at the rate that the line gives.";
        /// The noise of a row is smaller than a step of the counts: they repeat a pattern, so Q and N are not the
        /// sensor's.
        LIMIT_CYCLE = "limit-cycle", Warning, "Record with a longer interval.";
        /// The model of Q, N, B and K does not hold, or cannot be fitted: no ranges are given.
        NOISE_MODEL = "noise-model", Warning, "Look at the curve: a knock, a filter or a pattern is no noise of the model.";
        /// From some tau on the temperature explains the Allan deviation.
        NOISE_TEMPERATURE = "noise-temperature", Warning, "Record at a steadier temperature.";
    }
    "Instruments" "Of `campaign check` and `campaign run`." {
        /// Nobody reads the alarms of the chamber: one that has an alarm is seen only when it leaves its set point.
        ALARMS_NOT_READ = "alarms-not-read", Warning, "Give the key of the driver that the line names.";
        /// Nobody reads the faults of the turntable: one that has a fault is seen only when it does not arrive.
        FAULTS_NOT_READ = "faults-not-read", Warning, "Give the key of the driver that the line names.";
    }
    "Tables" "Of `compare` and of the statistics of a batch." {
        /// A provenance has no errors: nothing says whether a difference is more than the errors.
        ERRORS_UNKNOWN = "errors-unknown", Warning, "Make the table again with `calibrate`, which writes them.";
        /// A part is not compared, because not all tables have it. In a campaign: the table in force cannot judge a
        /// verification run, so nothing shows that the new one is not worse.
        NOT_COMPARED = "not-compared", FaultOrWarning, "Give tables that have it; move a table away that cannot judge the IMU.";
        /// Two tables have the same coefficients, under whatever name; or they were made from the same rows, so that
        /// what differs is not the IMU.
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

/// Former names of findings, and today's.
const RENAMED: [(&str, &str); 12] = [
    ("telemetry-constant", TEMPERATURE_CONSTANT),
    ("telemetry-reading", TEMPERATURE_READING),
    ("telemetry-stuck", TEMPERATURE_REPEATED),
    ("telemetry-drift", TEMPERATURE_DRIFT),
    ("telemetry-slope", TEMPERATURE_SLOPE),
    ("telemetry-offset", TEMPERATURE_OFFSET),
    ("telemetry-order", TEMPERATURE_ORDER),
    ("telemetry-moves", TEMPERATURE_MOVES),
    ("telemetry-glitch", TEMPERATURE_GLITCH),
    ("behind-telemetry", BEHIND_TEMPERATURE),
    ("other-unit", DEVICE_CHANGED),
    ("ramp-unit", RAMP_DEVICE),
];

/// The name of a finding that the user accepts.
///
/// # Errors
/// If no finding has this name, which may be a former one, or if a fault of this name leaves nothing to fit. The
/// message lists the names.
pub fn acceptable(text: &str) -> Result<&'static str, String> {
    match explanations().find(|known| known.name == text) {
        Some(Explanation { name, rank: Rank::Final, remedy, .. }) => {
            Err(format!("{name} cannot be accepted, because nothing is left to fit. {remedy}"))
        }
        Some(known) => Ok(known.name),
        None => {
            if let Some((_, new)) = RENAMED.iter().find(|(old, _)| *old == text) {
                return Err(format!("the finding {text} is called {new} now"));
            }
            let names = explanations().filter(|known| known.rank != Rank::Final).map(|known| known.name);
            Err(format!("give the name of a finding: {}", names.collect::<Vec<_>>().join(", ")))
        }
    }
}
