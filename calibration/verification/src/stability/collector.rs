//! Samples to windows, and windows to the stability of the output.
//!
//! Over 400 lines: one pass over the samples, from sums to figures.

use super::error::OTHER_ATTITUDE;
use crate::occupancy::{Bins, Occupancy};
use crate::stability::coverage::{Coverage, untouched};
use crate::stability::error::{Force, StabilityError};
use crate::stability::figures::{figures, median};
use crate::stability::gyroscopes::{Conditions, GyroscopeStability};
use crate::stability::loops::{Loops, SOAK, static_table};
use crate::stability::result::Stability;
use crate::stability::setup::Setup;
use crate::stability::stillness::{ACCELEROMETERS, LeftOut, PARTS, mark};
use crate::verdict::Verdict;
use crate::window::{MIN_WINDOWS, Window};
use isotherm_recording::{Continuity, MISSING, Marks, other_device};
use isotherm_shared::compensate::answer;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{AXIS_NAMES, Axis, CoefficientTable, Content, Gyroscopes};
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_shared::wire::{AXES, CompensatedIncrement, Flags, RawSample, Triad};
use isotherm_support::finding::Finding;
use nalgebra::{Matrix3, Vector3};
/// The flags that do not spoil a window.
const HARMLESS: Flags = Flags(Flags::TELEMETRY_STALE.0 | Flags::OTHER_DEVICE.0);

/// The flags that only a gyroscope can cause.
const OF_GYROSCOPES: Flags = Flags(Flags((1 << 18) - 1).of_gyroscopes().0 | Flags::G_UNKNOWN.0);

/// Sums over the samples of one window, those of the triads aside.
#[derive(Clone, Copy, Debug, Default)]
struct WindowSums {
    begin_s: f64,
    end_s: f64,
    seconds: f64,
    /// Time since the last complete part of the window \[s\].
    part_seconds: f64,
    /// Whether the lagged temperature has not forgotten yet how it began.
    unsettled: bool,
    /// Sums of the intervals and of the timestamps' steps, of samples with consecutive sequences \[s\].
    steps: [f64; 2],
}

/// The sums of one triad.
#[derive(Clone, Copy, Debug)]
struct TriadSums {
    positive: [f64; AXES],
    negative: [f64; AXES],
    head: [f64; AXES],
    board: [f64; AXES],
    /// Lowest and highest temperature: head and board, by axis; NaN before the first number.
    temperature: [[[f64; 2]; 2]; AXES],
    /// Which bins of the table's ranges the rows touch; as `temperature`.
    touched: [[Bins; 2]; AXES],
    /// Increments of the full model \[m/s or rad\].
    increment: [f64; AXES],
    /// Increments of the static model.
    static_increment: [f64; AXES],
    /// Increments of the full model since the last complete part.
    part: [f64; AXES],
    /// Lowest and highest mean of the complete parts; NaN before the first number.
    parts: [[f64; 2]; AXES],
    flagged: bool,
}

impl Default for TriadSums {
    fn default() -> Self {
        Self {
            positive: [0.0; AXES],
            negative: [0.0; AXES],
            head: [0.0; AXES],
            board: [0.0; AXES],
            temperature: [[[f64::NAN; 2]; 2]; AXES],
            touched: [[Bins::default(); 2]; AXES],
            increment: [0.0; AXES],
            static_increment: [0.0; AXES],
            part: [0.0; AXES],
            parts: [[f64::NAN; 2]; AXES],
            flagged: false,
        }
    }
}

/// Widens a span by a value; NaN widens nothing.
fn widen([low, high]: &mut [f64; 2], value: f64) {
    (*low, *high) = (low.min(value), high.max(value));
}

impl TriadSums {
    fn end_part(&mut self, seconds: f64) {
        let means = core::mem::take(&mut self.part).map(|increment| increment / seconds);
        self.parts.iter_mut().zip(means).for_each(|(span, mean)| widen(span, mean));
    }

    /// Largest difference of the means of the parts, in the base unit; `unit` is its size in that of the increments per
    /// second.
    fn spread(&self, unit: f64) -> [f64; AXES] {
        self.parts.map(|[low, high]| (high - low) / unit)
    }

    fn add(
        &mut self,
        triad: &Triad,
        seconds: f64,
        increment: [f64; AXES],
        static_increment: [f64; AXES],
        flagged: bool,
        ranges: &[[Occupancy; 2]; AXES],
    ) {
        for (axis, increment) in increment.into_iter().enumerate() {
            self.positive[axis] += f64::from(triad.positive_pulses[axis]);
            self.negative[axis] += f64::from(triad.negative_pulses[axis]);
            self.head[axis] += triad.head_temperature[axis] * seconds;
            self.board[axis] += triad.board_temperature[axis] * seconds;
            self.increment[axis] += increment;
            self.static_increment[axis] += static_increment[axis];
            self.part[axis] += increment;
        }
        let rows = [0, 1, 2].map(|axis| [triad.head_temperature[axis], triad.board_temperature[axis]]);
        let spans = self.temperature.as_flattened_mut().iter_mut().zip(self.touched.as_flattened_mut());
        for (((span, touched), range), value) in spans.zip(ranges.as_flattened()).zip(rows.as_flattened()) {
            widen(span, *value);
            *touched = touched.and(range.touched_by(*value));
        }
        self.flagged |= flagged;
    }
}

/// Sums samples into windows. Memory does not grow with the sampling rate: each window takes 60 bytes, and each triad
/// in it 370.
#[derive(Clone, Debug)]
pub struct Collector<'a> {
    table: &'a CoefficientTable,
    /// The table without its transients, if it has a lag.
    static_table: Option<CoefficientTable>,
    /// The ranges of the table, of which nothing is touched: of the accelerometers and of the gyroscopes.
    ranges: [[[Occupancy; 2]; AXES]; 2],
    window_s: f64,
    /// Begin of the first sample; of a session whose clock begins anew as if it went on \[ns\].
    begin_ns: Option<i128>,
    open: (WindowSums, [TriadSums; 2]),
    windows: Vec<WindowSums>,
    /// The triads of each window. The second list is empty if the table has no gyroscopes.
    triads: [Vec<TriadSums>; 2],
    temperature: [[TemperatureStep; 2]; AXES],
    left_out: u64,
    other_device: u64,
    /// Whether a sample has gyroscopes.
    has_gyroscopes: bool,
    /// Session, sequence and timestamp of the last sample.
    last: Option<(u64, u64, u64)>,
    /// Session of the last sample, and when its lagged temperature has forgotten how it began \[ns\].
    settled: Option<(u64, u64)>,
    continuity: Continuity,
    marks: Marks,
}

/// Finds the smallest step of one temperature signal.
#[derive(Clone, Copy, Debug)]
struct TemperatureStep {
    last: f64,
    step: f64,
}

impl TemperatureStep {
    fn add(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        let step = (value - self.last).abs();
        // A smaller step is the rounding of decimals.
        if step > 1e-9 * value.abs() {
            self.step = self.step.min(step);
        }
        self.last = value;
    }
}

/// Middle of the range of the windows' mean temperature: head and board, by axis. Flagged windows are used only if all
/// are flagged, because one invalid reading would shift the middle.
fn middle(windows: &[WindowSums], triads: &[TriadSums]) -> [[f64; 2]; AXES] {
    let good = triads.iter().any(|triad| !triad.flagged);
    let used = || windows.iter().zip(triads).filter(move |(_, triad)| !(good && triad.flagged));
    let of = |temperature: &dyn Fn(&TriadSums) -> f64| {
        let (low, high) = used()
            .map(|(window, triad)| temperature(triad) / window.seconds)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), u| (low.min(u), high.max(u)));
        0.5 * (low + high)
    };
    [0, 1, 2].map(|axis| [of(&|sums| sums.head[axis]), of(&|sums| sums.board[axis])])
}

impl<'a> Collector<'a> {
    /// A collector for windows of `window_s` seconds.
    #[must_use]
    pub fn new(table: &'a CoefficientTable, window_s: f64) -> Self {
        let temperature = TemperatureStep { last: f64::NAN, step: f64::INFINITY };
        let temperature = [[temperature; 2]; 3];
        let Content { axes, gyroscopes, .. } = table.content();
        let (accelerometers, gyroscopes) = (untouched(axes), gyroscopes.as_ref());
        Self {
            table,
            static_table: static_table(table),
            ranges: [accelerometers, gyroscopes.map_or(accelerometers, |it| untouched(&it.axes))],
            window_s,
            begin_ns: None,
            open: Default::default(),
            windows: Vec::new(),
            triads: Default::default(),
            temperature,
            left_out: 0,
            other_device: 0,
            has_gyroscopes: false,
            last: None,
            settled: None,
            continuity: Continuity::default(),
            marks: Marks::default(),
        }
    }

    /// Adds the next sample. A sample with an invalid interval has no velocity and is left out.
    pub fn add(&mut self, raw: &RawSample) {
        self.continuity.add(raw);
        self.marks.add(raw);
        let increment = answer(Some(self.table), raw);
        let flags = Flags(increment.flags);
        self.other_device += u64::from(flags.intersects(Flags::OTHER_DEVICE));
        self.has_gyroscopes |= !raw.gyroscopes.is_absent();
        let unsettled = self.is_unsettled(raw);
        if flags.intersects(Flags::INTERVAL) {
            self.left_out += 1;
            return;
        }
        let seconds = raw.interval_ns as f64 / 1e9;
        let end_s = self.end_s(raw);
        let (open, [accelerometers, gyroscopes]) = &mut self.open;
        if open.seconds == 0.0 {
            open.begin_s = end_s - seconds;
        }
        open.end_s = end_s;
        open.seconds += seconds;
        open.part_seconds += seconds;
        open.unsettled |= unsettled;
        let last = self.last.replace((raw.session, raw.sequence, raw.timestamp_ns));
        if let Some((session, sequence, timestamp_ns)) = last
            && (session, sequence.wrapping_add(1)) == (raw.session, raw.sequence)
        {
            open.steps[0] += seconds;
            open.steps[1] += raw.timestamp_ns.saturating_sub(timestamp_ns) as f64 / 1e9;
        }
        let spoiled = |some: Flags| flags.0 & some.0 & !HARMLESS.0 != 0;
        let of_static = self.static_table.as_ref().map_or(increment, |table| answer(Some(table), raw));
        let CompensatedIncrement { velocity_increment, angle_increment, .. } = increment;
        let (velocity, angle) = (of_static.velocity_increment, of_static.angle_increment);
        let of_accelerometers = spoiled(Flags(!OF_GYROSCOPES.0));
        let [ranges, gyroscope_ranges] = &self.ranges;
        accelerometers.add(&raw.accelerometers, seconds, velocity_increment, velocity, of_accelerometers, ranges);
        let of_gyroscopes = spoiled(OF_GYROSCOPES | Flags::LAG_UNKNOWN | Flags::INTERVAL_NOT_NOMINAL);
        gyroscopes.add(&raw.gyroscopes, seconds, angle_increment, angle, of_gyroscopes, gyroscope_ranges);
        if open.part_seconds + 0.5 * seconds >= self.window_s / PARTS {
            let seconds = core::mem::take(&mut open.part_seconds);
            accelerometers.end_part(seconds);
            gyroscopes.end_part(seconds);
        }
        for axis in 0..AXES {
            self.temperature[axis][0].add(raw.accelerometers.head_temperature[axis]);
            self.temperature[axis][1].add(raw.accelerometers.board_temperature[axis]);
        }
        // The window ends with the sample that brings it nearest to its nominal length.
        if open.seconds + 0.5 * seconds >= self.window_s {
            self.windows.push(core::mem::take(open));
            self.triads[0].push(core::mem::take(accelerometers));
            let gyroscopes = core::mem::take(gyroscopes);
            if self.table.content().gyroscopes.is_some() {
                self.triads[1].push(gyroscopes);
            }
        }
    }

    /// The end of a sample since the first one's begin \[s\]. A window ends with its session.
    fn end_s(&mut self, raw: &RawSample) -> f64 {
        let starts_ns = i128::from(raw.timestamp_ns.saturating_sub(raw.interval_ns));
        let begin_ns = self.begin_ns.get_or_insert(starts_ns);
        if let Some((session, _, last_ns)) = self.last
            && session != raw.session
        {
            self.open = Default::default();
            *begin_ns -= (i128::from(last_ns) - starts_ns).max(0);
        }
        (i128::from(raw.timestamp_ns) - *begin_ns).max(0) as f64 / 1e9
    }

    /// Whether the lagged temperature of a sample has not forgotten yet that it began soaked: equal to the temperature,
    /// as it does where the recording of an acquisition begins, and where it is computed from a recording that has
    /// none.
    fn is_unsettled(&mut self, raw: &RawSample) -> bool {
        let lag_ns = self.table.lag_ns();
        if lag_ns == 0 {
            return false;
        }
        if self.settled.is_none_or(|(session, _)| session != raw.session) {
            let triads = [&raw.accelerometers, &raw.gyroscopes];
            let pairs = triads.into_iter().flat_map(|it| it.head_temperature.into_iter().zip(it.head_lagged));
            let soaked = raw.lag_ns != 0 && pairs.into_iter().all(|(head, lagged)| head == lagged || head.is_nan());
            let soak_ns = if soaked { SOAK.saturating_mul(lag_ns) } else { 0 };
            self.settled = Some((raw.session, raw.timestamp_ns.saturating_add(soak_ns)));
        }
        self.settled.is_some_and(|(_, settled_ns)| raw.timestamp_ns < settled_ns)
    }

    /// What is to be said of the times of the samples so far: see [`Continuity::findings`] and
    /// [`Continuity::not_nominal`].
    #[must_use]
    pub fn of_time(&self) -> Vec<Finding> {
        self.continuity.not_nominal(self.table).into_iter().chain(self.continuity.findings(MISSING)).collect()
    }

    /// What is missing in the samples so far.
    #[must_use]
    pub const fn continuity(&self) -> &Continuity {
        &self.continuity
    }

    /// The marks of the samples so far.
    #[must_use]
    pub const fn marks(&self) -> &Marks {
        &self.marks
    }

    /// Length of the output over gravity, of all samples, also of those in no complete window.
    fn length_ratio(&self, setup: &Setup) -> f64 {
        let (open, [accelerometers, _]) = &self.open;
        let seconds: f64 = self.windows.iter().chain([open]).map(|window| window.seconds).sum();
        let all = || self.triads[0].iter().chain([accelerometers]);
        let square = |axis: usize| all().map(|triad| triad.increment[axis]).sum::<f64>().powi(2);
        let gravity = setup.gravity.value().unwrap_or(self.table.content().gravity);
        (square(0) + square(1) + square(2)).sqrt() / seconds / gravity
    }

    /// The stability over all complete windows.
    ///
    /// # Errors
    /// If the samples are of another device, if there are too few windows, too few at the attitude, or an axis whose
    /// output is not a number.
    pub fn finish(self, setup: &Setup) -> Result<Stability, StabilityError> {
        let interval_ratio = self.checked(setup)?;
        let content = self.table.content();
        let middle = middle(&self.windows, &self.triads[0]);
        let mut windows = self.accelerometers(middle)?;
        let known = setup.gravity.value().map(|gravity| gravity / content.gravity);
        let gravity = |output: [f64; AXES]| known.unwrap_or_else(|| output.iter().map(|f| f * f).sum::<f64>().sqrt());
        let force =
            |output: [f64; AXES]| setup.attitude.map_or(output, |direction| direction.map(|f| f * gravity(output)));
        let stated = setup.attitude.is_some();
        let windows_left_out = self.mark(&mut windows, |output| stated.then(|| force(output)));
        let counted: Vec<_> = windows.iter().filter(|window| window.counts).collect();
        if counted.len() < MIN_WINDOWS {
            let output = [0, 1, 2].map(|axis| median(&windows, axis));
            let (counted, windows, force) = (counted.len(), windows.len(), Force(force(output)));
            return Err(StabilityError::OffAttitude { counted, windows, force, output: Force(output), stated });
        }
        // The windows that do not count are those of another output.
        let output = [0, 1, 2].map(|axis| isotherm_statistics::median(counted.iter().map(|window| window.after[axis])));
        let (specific_force, gravity) = (force(output), gravity(output));
        let axes = figures(&counted, specific_force);
        let covered = Coverage::of(&windows, SensorKind::Accelerometer, &content.axes, &content.temperature_unit);
        let unsettled: Vec<_> = self.windows.iter().map(|sums| sums.unsettled).collect();
        let static_output = self.static_output(&self.triads[0], content.gravity);
        let loops = Loops::of(&windows, static_output.as_deref(), &unsettled, specific_force, &content.axes);
        let soak_s = SOAK as f64 * self.table.lag_ns() as f64 / 1e9;
        Ok(Stability {
            windows_left_out,
            loops,
            unsettled_s: unsettled.contains(&true).then_some(soak_s),
            covered: covered.driven_by(specific_force),
            accepts_holes: false,
            interval_ratio: Some(interval_ratio).filter(|ratio| ratio.is_finite()),
            verdict: Verdict::of(&windows, specific_force, stated, known),
            gyroscopes: self.gyroscopes(setup, &windows),
            windows,
            specific_force,
            stated,
            axes,
            gravity,
            gravity_source: setup.gravity,
            resolution: self.temperature.map(|parts| parts.map(|t| Some(t.step).filter(|step| step.is_finite()))),
            left_out: self.left_out,
            middle,
            other_device: (self.other_device > 0).then(|| other_device(self.table, self.other_device)),
            losses: self.continuity.losses(),
            time_fault: self.continuity.fault(),
            made_the_table: false,
            of_time: self.of_time(),
        })
    }

    /// Refuses samples that cannot be judged. The ratio of the intervals to the time that passed.
    fn checked(&self, setup: &Setup) -> Result<f64, StabilityError> {
        if self.other_device > 0 && !setup.other_device {
            let serial = self.table.content().serial.as_deref().unwrap_or_default().trim().to_owned();
            return Err(StabilityError::OtherDevice { samples: self.other_device, serial });
        }
        // A window without consecutive sequences has 0/0, which the median leaves out.
        let windows = self.windows.iter().chain([&self.open.0]);
        let ratio = isotherm_statistics::median(windows.map(|sums| sums.steps[0] / sums.steps[1]));
        if let Some(fault) = self.continuity.interval() {
            return Err(StabilityError::Interval(fault));
        }
        if self.windows.len() < MIN_WINDOWS {
            let (windows, window_s) = (self.windows.len(), self.window_s);
            return Err(StabilityError::TooShort { windows, window_s, ratio: self.length_ratio(setup) });
        }
        Ok(ratio)
    }

    /// The windows of the accelerometers, with outputs that are numbers.
    fn accelerometers(&self, middle: [[f64; 2]; AXES]) -> Result<Vec<Window>, StabilityError> {
        let content = self.table.content();
        let frozen = FrozenCoefficients::new(&content.axes, content.alignment, middle);
        let window = |(sums, triad): (&WindowSums, &TriadSums)| {
            let before = frozen.output(triad, sums.seconds, [0.0; AXES]);
            sums.window(triad, before, content.gravity)
        };
        let windows: Vec<_> = self.windows.iter().zip(&self.triads[0]).map(window).collect();
        let no_number =
            |axis: &usize| median(&windows, *axis).is_nan() || windows.iter().all(|w| w.after[*axis].is_nan());
        match (0..AXES).find(no_number) {
            Some(axis) => Err(StabilityError::NotANumber { axis: AXIS_NAMES[axis], index: axis + 1 }),
            None => Ok(windows),
        }
    }

    /// Marks the windows at the attitude. `stated` gives the specific force of a stated attitude from an output.
    fn mark(&self, windows: &mut [Window], stated: impl Fn([f64; AXES]) -> Option<[f64; AXES]>) -> LeftOut {
        let stated = stated([0, 1, 2].map(|axis| median(windows, axis)));
        let gravity = self.table.content().gravity;
        let spreads: Vec<_> = self.triads[0].iter().map(|triad| triad.spread(gravity)).collect();
        mark(windows, &spreads, &ACCELEROMETERS, |middle| {
            stated.is_none_or(|force| (0..AXES).all(|axis| (middle[axis] - force[axis]).abs() < OTHER_ATTITUDE))
        })
    }

    /// The outputs of the static model in all windows, if the table has a lag; `unit` is the size of the base unit in
    /// that of the increments per second.
    fn static_output(&self, triads: &[TriadSums], unit: f64) -> Option<Vec<[f64; AXES]>> {
        self.static_table.as_ref()?;
        let output =
            |(window, triad): (&WindowSums, &TriadSums)| triad.static_increment.map(|sum| sum / window.seconds / unit);
        Some(self.windows.iter().zip(triads).map(output).collect())
    }

    /// The gyroscopes, or why they are not judged; `None` if there are none. `windows` are those of the accelerometers.
    fn gyroscopes(&self, setup: &Setup, windows: &[Window]) -> Option<Result<GyroscopeStability, String>> {
        let content = self.table.content();
        let gyroscopes = match (&content.gyroscopes, self.has_gyroscopes) {
            (Some(gyroscopes), true) => gyroscopes,
            (Some(_), false) => return Some(Err("the table has gyroscopes, the recording has none".to_owned())),
            (None, true) => return Some(Err("the recording has gyroscopes, the table has none".to_owned())),
            (None, false) => return None,
        };
        let Gyroscopes { axes, g_sensitivity, alignment } = gyroscopes;
        let triads = &self.triads[1];
        let middle = middle(&self.windows, triads);
        let frozen = FrozenCoefficients::new(axes, *alignment, middle);
        let of_windows = self.windows.iter().zip(triads).zip(windows);
        let windows = of_windows.map(|((sums, triad), of_accelerometers)| {
            let force = of_accelerometers.before;
            let by_force = g_sensitivity.map(|s| s.map_or(0.0, |s| (0..AXES).map(|axis| s[axis] * force[axis]).sum()));
            let before = frozen.output(triad, sums.seconds, by_force);
            let window = sums.window(triad, before, ARCSEC);
            Window { counts: of_accelerometers.counts, still: of_accelerometers.still, ..window }
        });
        let conditions = Conditions {
            earth_rate: setup.earth_rate,
            has_turntable: self.table.turntable().is_some(),
            axes,
            unit: &content.temperature_unit,
            aligned: alignment.is_some(),
            middle,
            spreads: triads.iter().map(|triad| triad.spread(ARCSEC)).collect(),
            static_output: self.static_output(triads, ARCSEC),
            unsettled: self.windows.iter().map(|sums| sums.unsettled).collect(),
        };
        Some(GyroscopeStability::of(windows.collect(), &conditions))
    }
}

/// Bias, K+ and K- of each sensor of a triad at mid temperature, in the triad's base unit; and the alignment.
struct FrozenCoefficients {
    values: [[f64; 3]; AXES],
    alignment: Option<Matrix3<f64>>,
}

impl FrozenCoefficients {
    fn new(axes: &[Axis; AXES], alignment: Option<Matrix3<f64>>, middle: [[f64; 2]; AXES]) -> Self {
        let clamped = |polynomial: &Polynomial, temperature: f64| polynomial.at(polynomial.clamp(temperature));
        let values = [0, 1, 2].map(|index| {
            let (axis, [head, board]) = (&axes[index], middle[index]);
            [
                clamped(&axis.bias, head) * axis.bias_unit.factor(),
                clamped(&axis.positive_scale_factor, board),
                clamped(&axis.negative_scale_factor, board),
            ]
        });
        Self { values, alignment }
    }

    /// Output over a window of `seconds`, less `also`, in the base unit.
    fn output(&self, sums: &TriadSums, seconds: f64, also: [f64; AXES]) -> [f64; AXES] {
        let output = [0, 1, 2].map(|axis| {
            let [bias, k_plus, k_minus] = self.values[axis];
            (sums.positive[axis] / k_plus + sums.negative[axis] / k_minus) / seconds - bias - also[axis]
        });
        self.alignment.map_or(output, |matrix| (matrix * Vector3::from(output)).into())
    }
}

impl WindowSums {
    /// The window of one triad; `unit` is the size of the base unit in that of the increments per second.
    fn window(&self, triad: &TriadSums, before: [f64; AXES], unit: f64) -> Window {
        let mean = |values: [f64; AXES]| values.map(|value| value / self.seconds);
        Window {
            time_s: 0.5 * (self.begin_s + self.end_s),
            seconds: self.seconds,
            before,
            after: mean(triad.increment).map(|rate| rate / unit),
            head: mean(triad.head),
            board: mean(triad.board),
            temperature: triad.temperature,
            touched: triad.touched,
            flagged: triad.flagged,
            counts: true,
            still: true,
        }
    }
}
