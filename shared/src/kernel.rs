//! A table as the kernel reads it: arrays over all sensors of the IMU.
//!
//! A compensation needs bias, K+ and K- of every sensor. Here they are computed two sensors at once (SSE2, NEON), and
//! their coefficients are in few cache lines. Every value comes from the same operations in the same order as
//! [`Polynomial::at`], so it is the same to the last bit: a polynomial of lower order has zeros as its highest
//! coefficients, and `0 * x + c` is `c` for the finite `x` inside a range. (The sign of a bias that is 0 may differ. It
//! changes no increment while K+ is positive, which is checked for each sample.)
//!
//! All functions of a sample's way are inlined into one of [`compensate`](crate::compensate), and all their
//! loops are over indices: a generic function of the standard library that is not marked for inlining would be a call,
//! for each number, where the compiler splits this crate.
#![expect(clippy::needless_range_loop, reason = "loops over indices are inlined by every profile")]

use crate::polynomial::{MAX_ORDER, Polynomial};
use crate::table::content::{Axis, Content, Gyroscopes};
use crate::units::ARCSEC;
use crate::wire::{AXES, RawSample};
use nalgebra::Matrix3;
use wide::f64x2;

/// Pairs of sensors: A1 with A2, A3 with itself.
const ACCELEROMETERS: usize = 2;
/// Pairs of sensors: A1 with A2, A3 with G1, G2 with G3.
const WHOLE: usize = 3;

/// A number of every sensor.
type Pairs<const P: usize> = [f64x2; P];
/// A number of each axis: 1 and 2, then 3 twice.
type Axes = Pairs<2>;

/// Bias, K+ and K-.
const QUANTITIES: usize = 3;

/// The columns of a 3x3 matrix.
type Columns = [Axes; AXES];

/// What the kernel reads of a table.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    /// Time constant of the lagged temperature \[ns\]; 0 without lag.
    pub lag_ns: u64,
    /// The control period that the scale factors are of \[ns\]; 0 if they are of none.
    pub nominal_ns: u64,
    /// The unit that the table belongs to; 0 = unknown.
    pub device: u64,
    /// Temperature older than this is flagged \[s\]; infinite without a limit.
    pub max_age_s: f64,
    /// Whether any bias has a transient term.
    pub has_transients: bool,
    /// The value of 1 g0 \[m/s2\].
    gravity: f64x2,
    /// Columns of the accelerometers' alignment.
    alignment: Option<Columns>,
    sensors: Sensors,
}

#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a table has one; a pointer would be a line more on a sample's way")]
enum Sensors {
    Accelerometers(Lanes<ACCELEROMETERS>),
    Whole(Lanes<WHOLE>, GyroscopeTerms),
}

/// What only gyroscopes have.
#[derive(Clone, Debug)]
struct GyroscopeTerms {
    /// Columns of the g-sensitivity \[deg/h/g0\]: by axis of the IMU, then by gyroscope. `None` if no gyroscope has
    /// one.
    g_sensitivity: Option<Columns>,
    /// All bits for the gyroscopes that have one.
    has_g_sensitivity: Axes,
    /// Columns of the gyroscopes' alignment.
    alignment: Option<Columns>,
}

impl Kernel {
    /// The kernel's form of a valid content.
    pub(crate) fn new(content: &Content, [lag_ns, nominal_ns]: [u64; 2], device: u64) -> Self {
        let [a1, a2, a3] = &content.axes;
        let (sensors, g_transients) = match &content.gyroscopes {
            None => (Sensors::Accelerometers(Lanes::new([[a1, a2], [a3, a3]])), false),
            Some(gyroscopes) => {
                let [g1, g2, g3] = &gyroscopes.axes;
                let lanes = Lanes::new([[a1, a2], [a3, g1], [g2, g3]]);
                (Sensors::Whole(lanes, GyroscopeTerms::new(gyroscopes)), gyroscopes.axes.iter().any(has_transient))
            }
        };
        Self {
            lag_ns,
            nominal_ns,
            device,
            max_age_s: content.max_age_s.unwrap_or(f64::INFINITY),
            has_transients: content.axes.iter().any(has_transient) || g_transients,
            gravity: f64x2::splat(content.gravity),
            alignment: content.alignment.map(columns),
            sensors,
        }
    }

    /// Velocity increments \[m/s\] and angle increments \[rad\] over Ts \[s\], which must be valid. `lagged` states
    /// whether the lagged temperature counts.
    ///
    /// `None` for the unusual: unless every temperature is inside the range of every polynomial that it drives, and
    /// therefore finite, every difference of the lagged temperature can be used, every scale factor and result is
    /// finite, and no pulse rate is near its limit.
    #[inline(always)]
    pub(crate) fn usual(
        &self,
        evaluation: &mut Evaluation,
        raw: &RawSample,
        lagged: bool,
        ts: f64,
    ) -> Option<([f64; AXES], [f64; AXES])> {
        let ts = f64x2::splat(ts);
        match &self.sensors {
            Sensors::Accelerometers(lanes) => {
                let ([a12, a33], check) = lanes.indicated(evaluation, raw, lagged, ts);
                let dv = self.velocity([a12, a33]);
                check.passed(dv).then(|| (array(dv), [f64::NAN; AXES]))
            }
            Sensors::Whole(lanes, terms) => {
                let ([a12, a3g1, g23], check) = lanes.indicated(evaluation, raw, lagged, ts);
                let ([a3, g1], [g2, g3]) = (a3g1.to_array(), g23.to_array());
                let dv = self.velocity([a12, f64x2::splat(a3)]);
                let da = terms.angle(axes(&[g1, g2, g3]), [dv[0] / self.gravity, dv[1] / self.gravity]);
                check.passed([dv[0] + da[0], dv[1] + da[1]]).then(|| (array(dv), array(da)))
            }
        }
    }

    /// Velocity increments \[m/s\], for what the accelerometers indicate \[g0*s\].
    #[inline(always)]
    fn velocity(&self, indicated: Axes) -> Axes {
        let dv = [self.gravity * indicated[0], self.gravity * indicated[1]];
        match &self.alignment {
            Some(matrix) => product(matrix, dv),
            None => dv,
        }
    }
}

impl GyroscopeTerms {
    fn new(gyroscopes: &Gyroscopes) -> Self {
        let has = gyroscopes.g_sensitivity.map(|terms| terms.is_some());
        let rows = gyroscopes.g_sensitivity.map(Option::unwrap_or_default);
        let columns_of = || core::array::from_fn(|axis| axes(&rows.map(|row| row[axis])));
        Self {
            g_sensitivity: has.contains(&true).then(columns_of),
            has_g_sensitivity: axes(&has.map(|has| if has { f64::from_bits(u64::MAX) } else { 0.0 })),
            alignment: gyroscopes.alignment.map(columns),
        }
    }

    /// Angle increments \[rad\], for what the gyroscopes indicate \[arcsec\] and the velocity increments \[g0*s\].
    #[inline(always)]
    fn angle(&self, mut angles: Axes, q: Axes) -> Axes {
        if let Some(matrix) = &self.g_sensitivity {
            let g = product(matrix, q);
            // An angle without a g-sensitivity is less +0, which changes no number, not even the sign of a zero.
            angles[0] -= g[0] & self.has_g_sensitivity[0];
            angles[1] -= g[1] & self.has_g_sensitivity[1];
        }
        if let Some(matrix) = &self.alignment {
            angles = product(matrix, angles);
        }
        let unit = f64x2::splat(ARCSEC);
        [angles[0] * unit, angles[1] * unit]
    }
}

/// A matrix times a vector, each component a sum from left to right.
#[inline(always)]
fn product(matrix: &Columns, vector: Axes) -> Axes {
    let ([v1, v2], [v3, _]) = (vector[0].to_array(), vector[1].to_array());
    let (v1, v2, v3) = (f64x2::splat(v1), f64x2::splat(v2), f64x2::splat(v3));
    let [c1, c2, c3] = matrix;
    [(c1[0] * v1 + c2[0] * v2) + c3[0] * v3, (c1[1] * v1 + c2[1] * v2) + c3[1] * v3]
}

/// Whether a sample is a usual one.
struct Check {
    /// Negative for the unusual.
    signs: f64x2,
    /// Infinite or NaN for the unusual.
    sum: f64x2,
}

impl Check {
    #[inline(always)]
    fn passed(&self, results: Axes) -> bool {
        let [first, second] = (self.sum + (results[0] + results[1])).to_array();
        self.signs.to_bitmask() == 0 && (first + second).is_finite()
    }
}

fn columns(matrix: Matrix3<f64>) -> Columns {
    <[[f64; AXES]; AXES]>::from(matrix).map(|column| axes(&column))
}

/// The numbers of three axes.
#[inline(always)]
fn axes(numbers: &[f64; AXES]) -> Axes {
    [f64x2::new([numbers[0], numbers[1]]), f64x2::splat(numbers[2])]
}

/// The numbers of three axes as an array.
#[inline(always)]
fn array([first, second]: Axes) -> [f64; AXES] {
    let ([n1, n2], [n3, _]) = (first.to_array(), second.to_array());
    [n1, n2, n3]
}

/// The polynomials and limits of `P` pairs of sensors.
#[derive(Clone, Debug)]
struct Lanes<const P: usize> {
    /// c0 of every bias, K+ and K-, then c1, and so on.
    coefficients: [[Pairs<P>; QUANTITIES]; MAX_ORDER + 1],
    /// The highest order of any polynomial.
    order: usize,
    /// Whether every polynomial has centre 0 and scale 1.
    plain: bool,
    center: [Pairs<P>; QUANTITIES],
    scale: [Pairs<P>; QUANTITIES],
    /// Between these head temperature is inside the range of the bias.
    head: [Pairs<P>; 2],
    /// Between these board temperature is inside the ranges of both scale factors.
    board: [Pairs<P>; 2],
    /// The bias's unit in g0 or deg/h.
    bias_unit: Pairs<P>,
    /// Transient coefficients, in the unit of the bias; 0 for none.
    transient: Pairs<P>,
    /// [`max_lag_difference`].
    max_lag_difference: Pairs<P>,
    /// A little below the limit of the pulse rate \[pulse/s\]; infinite without one.
    rate: Pairs<P>,
}

/// Largest difference of the lagged temperature that is used; any finite one where there is no transient term to use
/// it.
fn max_lag_difference(axis: &Axis) -> f64 {
    let [low, high] = axis.bias.range();
    if axis.transient == 0.0 { f64::MAX } else { high - low }
}

/// Relative distance from a limit of the pulse rate below which a product is not trusted to decide.
const RATE_MARGIN: f64 = 1e-12;

impl<const P: usize> Lanes<P> {
    fn new(sensors: [[&Axis; 2]; P]) -> Self {
        let of = |number: &dyn Fn(&Axis) -> f64| sensors.map(|pair| f64x2::new(pair.map(number)));
        let bound = |bound: fn(f64, f64) -> f64, end: usize| {
            of(&|axis| bound(axis.positive_scale_factor.range()[end], axis.negative_scale_factor.range()[end]))
        };
        // A constant does not depend on x. Its centre and scale could make x infinite, and 0 * x would be NaN then.
        let constant = |polynomial: &Polynomial| polynomial.coefficients().len() == 1;
        let center = |polynomial: &Polynomial| if constant(polynomial) { 0.0 } else { polynomial.center() };
        let scale = |polynomial: &Polynomial| if constant(polynomial) { 1.0 } else { polynomial.scale() };
        let quantities = || sensors.as_flattened().iter().flat_map(|axis| polynomials(axis));
        Self {
            coefficients: core::array::from_fn(|power| {
                let coefficient = |polynomial: &Polynomial| polynomial.coefficients().get(power).copied();
                QUANTITY.map(|of_axis| of(&|axis| coefficient(of_axis(axis)).unwrap_or_default()))
            }),
            order: quantities().map(|polynomial| polynomial.coefficients().len() - 1).max().unwrap_or_default(),
            plain: quantities().all(|polynomial| center(polynomial) == 0.0 && scale(polynomial) == 1.0),
            center: QUANTITY.map(|of_axis| of(&|axis| center(of_axis(axis)))),
            scale: QUANTITY.map(|of_axis| of(&|axis| scale(of_axis(axis)))),
            head: [0, 1].map(|end| of(&|axis| axis.bias.range()[end])),
            board: [bound(f64::max, 0), bound(f64::min, 1)],
            bias_unit: of(&|axis| axis.bias_unit.factor()),
            transient: of(&|axis| axis.transient),
            max_lag_difference: of(&max_lag_difference),
            rate: of(&|axis| axis.max_rate.map_or(f64::INFINITY, |limit| limit * (1.0 - RATE_MARGIN))),
        }
    }

    /// What the sensors indicate over Ts \[s\] less the bias, `(N+/K+ + N-/K-) - bias * Ts`, in g0*s or arcsec; right
    /// if the check passes.
    #[inline(always)]
    fn indicated(&self, evaluation: &mut Evaluation, raw: &RawSample, lagged: bool, ts: f64x2) -> (Pairs<P>, Check) {
        let (a, g) = (&raw.accelerometers, &raw.gyroscopes);
        let positive: Pairs<P> = pulses(&a.positive_pulses, &g.positive_pulses);
        let negative: Pairs<P> = pulses(&a.negative_pulses, &g.negative_pulses);
        let head: Pairs<P> = all_sensors(&a.head_temperature, &g.head_temperature);
        let board: Pairs<P> = all_sensors(&a.board_temperature, &g.board_temperature);
        if !evaluation.is_of(&head, &board) {
            self.evaluate(evaluation, &head, &board);
        }
        let (a, g) = if lagged { (&a.head_lagged, &g.head_lagged) } else { (&a.head_temperature, &g.head_temperature) };
        let lagged: Pairs<P> = all_sensors(a, g);
        let ([bias, k_plus, k_minus], mut signs) = (&evaluation.values, evaluation.signs);
        let mut indicated = positive;
        for i in 0..P {
            let difference = lagged[i] - head[i];
            signs |= self.max_lag_difference[i] - difference.abs();
            signs |= self.rate[i] * ts - (positive[i] + negative[i]);
            let bias = (bias[i] + self.transient[i] * difference) * self.bias_unit[i];
            indicated[i] = (positive[i] / k_plus[i] + negative[i] / k_minus[i]) - bias * ts;
        }
        (indicated, Check { signs, sum: evaluation.sum })
    }

    /// Evaluates the polynomials.
    #[inline(always)]
    fn evaluate(&self, evaluation: &mut Evaluation, head: &Pairs<P>, board: &Pairs<P>) {
        // Differences of which none is negative if all is usual: their signs show it. A NaN can have any sign: the sum
        // below or the results show it.
        let (mut signs, mut sum) = (f64x2::ZERO, f64x2::ZERO);
        let mut x = [*head, *board, *board];
        if !self.plain {
            for quantity in 0..QUANTITIES {
                for i in 0..P {
                    x[quantity][i] = (x[quantity][i] - self.center[quantity][i]) / self.scale[quantity][i];
                }
            }
        }
        let order = self.order.min(MAX_ORDER);
        let mut values = self.coefficients[order];
        for power in (0..order).rev() {
            let row = &self.coefficients[power];
            for quantity in 0..QUANTITIES {
                for i in 0..P {
                    values[quantity][i] = values[quantity][i] * x[quantity][i] + row[quantity][i];
                }
            }
        }
        for i in 0..P {
            signs |= (head[i] - self.head[0][i]) | (self.head[1][i] - head[i]);
            signs |= (board[i] - self.board[0][i]) | (self.board[1][i] - board[i]);
            signs |= values[1][i];
            sum += (values[1][i] - values[2][i]) + (head[i] + board[i]);
            (evaluation.head[i], evaluation.board[i]) = (head[i], board[i]);
            for quantity in 0..QUANTITIES {
                evaluation.values[quantity][i] = values[quantity][i];
            }
        }
        (evaluation.signs, evaluation.sum) = (signs, sum);
    }
}

/// Bias, K+ and K- of every sensor at the temperatures of a sample, for the next sample of the same temperatures: a
/// thermometer gives one value for many samples. It is of one table.
#[derive(Clone, Debug)]
pub(crate) struct Evaluation {
    head: Pairs<WHOLE>,
    board: Pairs<WHOLE>,
    values: [Pairs<WHOLE>; QUANTITIES],
    /// The parts of the [`Check`] that temperatures decide.
    signs: f64x2,
    sum: f64x2,
}

impl Default for Evaluation {
    /// An evaluation that no sample has.
    fn default() -> Self {
        let none = [f64x2::splat(f64::from_bits(u64::MAX)); WHOLE];
        Self { head: none, board: none, values: [none; QUANTITIES], signs: none[0], sum: none[0] }
    }
}

impl Evaluation {
    /// Whether it is of these temperatures, bit for bit.
    #[inline(always)]
    fn is_of<const P: usize>(&self, head: &Pairs<P>, board: &Pairs<P>) -> bool {
        let mut differs = f64x2::ZERO;
        for i in 0..P {
            differs |= (head[i] ^ self.head[i]) | (board[i] ^ self.board[i]);
        }
        differs.to_array().map(f64::to_bits) == [0; 2]
    }
}

fn has_transient(axis: &Axis) -> bool {
    axis.transient != 0.0
}

/// Bias, K+ and K-, which is their order everywhere.
const QUANTITY: [fn(&Axis) -> &Polynomial; QUANTITIES] =
    [|axis| &axis.bias, |axis| &axis.positive_scale_factor, |axis| &axis.negative_scale_factor];

fn polynomials(axis: &Axis) -> [&Polynomial; QUANTITIES] {
    QUANTITY.map(|of_axis| of_axis(axis))
}

/// A number of all sensors.
#[inline(always)]
fn all_sensors<const P: usize>(a: &[f64; AXES], g: &[f64; AXES]) -> Pairs<P> {
    let mut all = [f64x2::new([a[0], a[1]]); P];
    if P == WHOLE {
        all[1] = f64x2::new([a[2], g[0]]);
        all[2] = f64x2::new([g[1], g[2]]);
    } else {
        all[1] = f64x2::splat(a[2]);
    }
    all
}

/// The pulses of all sensors.
#[inline(always)]
fn pulses<const P: usize>(a: &[u32; AXES], g: &[u32; AXES]) -> Pairs<P> {
    let double = |pulses: &[u32; AXES]| [pulses[0] as f64, pulses[1] as f64, pulses[2] as f64];
    all_sensors(&double(a), &double(g))
}
