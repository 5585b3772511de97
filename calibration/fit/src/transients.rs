//! Transients: the lag of the sensing elements behind their temperature, estimated from ramps and written only where
//! the data show it.
//!
//! # Model
//! ```text
//! dL/dt = (U - L) / tau,   d = L - U,   A = p(U) + t d
//! ```
//! with the head temperature U, one time constant tau for the IMU and one transient t for each bias. Hysteresis parts
//! heating from cooling too, but it follows the temperature and not the time: its rival model is the play z =
//! min(max(z, U - w), U + w) with the column (z - U)/w, at three half widths w. A table never gets a play.
//!
//! # Steps
//! 1. [`RampRecording`] reduces a recording while it is read; `blocks` makes at most 400 means of it. Both temperatures
//!    are taken to the middle of a row, linearly between readings, and the filter runs on the readings, with the
//!    function that runs in flight.
//! 2. `blocks`: the columns of a bias are a constant for each recording, Chebyshev polynomials 1 to 3 of U, d, the
//!    decay of a start that was not soaked, the three plays, and time for each recording.
//! 3. `search`: tau is where the sum over the biases of n log(SSE/n) is least. A quarter of a sweep is left out at a
//!    time for the standard errors of log tau and t (jackknife): the residuals are correlated, so no F test holds. The
//!    stated error of t is that with the time constant of each replicate, and by halves of a sweep where it is larger.
//! 4. `prediction`: one sweep is left out at a time, and predicted by each model. Where there are over a hundred
//!    sweeps, some are left out together, here and in 3, so that the time rises with their number and not with its
//!    square.
//! 5. `decision`: what may be written, and why.
//! 6. `sweeps`: the band between the sweeps, each fitted separately, with what is written: the error of the curve.
//!    `steps`: what a bump leaves.
//!
//! With a time constant that is given there are no columns of plays, start and time: what comes before three time
//! constants is left out. One sweep each way is enough then; a quarter of a sweep is left out at a time to try the
//! prediction.

mod bins;
mod blocks;
mod decision;
mod equations;
mod options;
mod prediction;
mod readings;
mod recording;
mod result;
mod search;
mod steps;
mod sweeps;

pub(crate) use bins::{BinValue, bin_values};
pub use options::{CurveSource, LagChoice, TransientOptions, TransientsError};
pub(crate) use recording::Bin;
pub use recording::RampRecording;
pub use result::BiasTransient;
pub use result::Condition;
pub use result::Prediction;
pub(crate) use result::TimeConstantEstimate;
pub use result::TransientVerdict;
pub use result::Transients;
pub(crate) use steps::clock;

use blocks::{Bias, Column, Ramps};
use equations::Coefficients;
use isotherm_recording::Losses;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::units::SensorKind;
use isotherm_statistics::{LoopPoint, SweepValues};
use isotherm_support::finding::Finding;
use options::SOAK;
use search::{Errors, Grid, total};
use steps::Step;

/// A gap that is longer than this part of the time constant is warned of.
const GAP: f64 = 0.5;
/// An axis that carries more specific force feels its converter too \[g0\].
const CARRIED_G0: f64 = 0.1;

/// One fit of all biases: with a time constant that was searched for, or that is given.
struct Fit {
    time_constant: TimeConstantEstimate,
    conditions: Vec<Condition>,
    biases: Vec<BiasTransient>,
    /// Of constant, curve, transient and what is added to them, by bias.
    solutions: Vec<Coefficients>,
    /// Steps, by recording.
    steps: Vec<Vec<Step>>,
    /// What the ramps show, if the time constant is given.
    searched: Option<TimeConstantEstimate>,
}

impl Fit {
    /// Writes the transients whose conditions are met; the other axes have the curve of the static model on all rows.
    fn write(&mut self, ramps: &Ramps, table: &CoefficientTable, still: &[Coefficients], written: bool) {
        let tau_s = self.time_constant.value_s;
        for (i, (bias, of)) in self.biases.iter_mut().zip(&ramps.biases).enumerate() {
            let rows = ramps.rows(of, tau_s);
            if written && decision::met(&bias.conditions) {
                bias.transient = bias.estimate;
                // The lagged temperature begins soaked; where that leaves too little, the start counts too.
                let of_soak = |soak_s| {
                    sweeps::curve_error(&sweeps_without(ramps, of, &rows, soak_s, &self.solutions[i]), of.range)
                };
                bias.curve_error = of_soak(SOAK * tau_s).or_else(|| of_soak(0.0));
            } else {
                bias.curve = curve(ramps, of, &still[i], coefficients(table, of));
                bias.curve_error = sweeps::curve_error(&sweeps_without(ramps, of, &rows, 0.0, &still[i]), of.range);
            }
        }
    }

    /// What a bias's curves span, over the range of the ramps.
    fn spans(&self, ramps: &Ramps, table: &CoefficientTable, curves: CurveSource) -> Vec<f64> {
        let of_bias = |(bias, of): (&BiasTransient, &Bias)| match curves {
            CurveSource::Ramps => sweeps::span(&bias.curve, of.range),
            CurveSource::Campaign => {
                let axis = coefficients(table, of);
                sweeps::span(&axis.bias, of.range) * axis.bias_unit.factor()
            }
        };
        self.biases.iter().zip(&ramps.biases).map(of_bias).collect()
    }

    /// What is wrong with the sweeps. `still` are the static models.
    fn findings(
        &self,
        ramps: &Ramps,
        recordings: &[RampRecording],
        still: &[Coefficients],
        spans: &[f64],
    ) -> Vec<Finding> {
        let tau_s = self.time_constant.value_s;
        let of_model = |soak_s: f64, solutions: &[Coefficients]| -> Vec<Vec<SweepValues>> {
            let of_bias = |(of, solution)| sweeps_without(ramps, of, &ramps.rows(of, tau_s), soak_s, solution);
            ramps.biases.iter().zip(solutions).map(of_bias).collect()
        };
        // Plays and time would take what a lag explains, and leave as much of the opposite sign.
        let lag_alone = |of: &Bias| {
            let columns = ramps.columns_of(&[Column::Constant, Column::Curve, Column::Transient]);
            total(ramps, &ramps.equations(&ramps.rows(of, tau_s))).solve(&columns)
        };
        let lagged: Vec<_> = ramps.biases.iter().map(lag_alone).collect();
        let models = [of_model(0.0, still), of_model(SOAK * tau_s, &lagged)];
        sweeps::findings(ramps, recordings, &self.steps, &self.biases, &models, spans)
    }

    fn words(&self, verdict: TransientVerdict, lag: LagChoice, stepped: bool) -> Vec<String> {
        match lag {
            _ if stepped => vec![decision::STEPPED.to_owned()],
            LagChoice::None => vec!["no transient is written, as asked for".to_owned()],
            _ => decision::words(verdict, &self.time_constant, &self.conditions, &self.biases),
        }
    }

    fn warnings(&self, recordings: &[RampRecording]) -> Vec<String> {
        let time_constant_s = self.time_constant.value_s;
        let mut warnings = self.searched.as_ref().map_or_else(Vec::new, |searched| {
            decision::warnings(searched, &self.conditions, &self.biases, time_constant_s)
        });
        warnings.extend(recordings.iter().filter_map(|recording| gap(recording, time_constant_s)));
        warnings.extend(carried(&self.biases));
        warnings
    }
}

/// Estimates lag and transients from ramps. `table` gives the scale factors, and the bias curves of a campaign.
///
/// # Errors
/// If there is no recording, or if one is too short or has no change of temperature.
pub fn fit(
    recordings: &[RampRecording],
    table: &CoefficientTable,
    options: &TransientOptions,
) -> Result<Transients, TransientsError> {
    if recordings.is_empty() {
        return Err(TransientsError::Empty);
    }
    let mut ramps = Ramps::new(recordings, table, options.curves)?;
    let outside = outside(&ramps, options.curves);
    let still: Vec<_> = ramps.biases.iter().map(|of| static_model(&ramps, of)).collect();
    let mut fit = match options.lag {
        LagChoice::Search | LagChoice::None => search(&ramps, table, options.predecessor_s),
        LagChoice::Given(tau_s) => given(&mut ramps, table, tau_s)?,
    };
    fit.conditions.insert(0, decision::both_directions(ramps.shared));
    let spans = fit.spans(&ramps, table, options.curves);
    let stepped = fit.steps.iter().any(|steps| sweeps::spoils(steps, &spans));
    let written = options.lag != LagChoice::None && !stepped && decision::met(&fit.conditions);
    fit.write(&ramps, table, &still, written);
    // A step parts sweeps as hysteresis does.
    let verdict = match stepped {
        true => TransientVerdict::Undetermined,
        false => decision::verdict(fit.time_constant.given, &fit.biases),
    };
    let findings = fit.findings(&ramps, recordings, &still, &spans);
    let warnings = fit.warnings(recordings).into_iter().chain(outside).collect();
    Ok(Transients {
        options: *options,
        verdict,
        words: fit.words(verdict, options.lag, stepped),
        time_constant: fit.time_constant,
        conditions: fit.conditions,
        biases: fit.biases,
        warnings,
        findings,
        losses: recordings.iter().map(|ramp| ramp.continuity().losses()).fold(Losses::default(), Losses::and),
    })
}

/// The fit with the time constant that the ramps show.
fn search(ramps: &Ramps, table: &CoefficientTable, predecessor_s: Option<f64>) -> Fit {
    use Column::{Constant, Curve, Plays, Start, Time, Transient};
    let grid = Grid::new(ramps, None);
    let used = ramps.columns_of(&[Constant, Curve, Transient, Start, Plays, Time]);
    let best = grid.minimum(&used, &[]);
    let errors = grid.jackknife(&used, best.tau_s);
    let ends = [grid.taus_s[0], grid.taus_s[grid.taus_s.len() - 1]];
    let interval_s = [-2.0, 2.0].map(|sign: f64| best.tau_s * libm::exp(sign * errors.log_tau));
    let conditions = decision::of_search(best.tau_s, interval_s, ends).to_vec();
    let kept = predecessor_s.filter(|tau_s| (interval_s[0]..=interval_s[1]).contains(tau_s));
    // Milliseconds: more digits than the data have.
    let value_s = kept.unwrap_or((best.tau_s * 1e3).round() / 1e3);
    let time_constant = TimeConstantEstimate {
        value_s,
        interval_s,
        given: false,
        kept: kept.is_some(),
        at_end: best.at_end,
        search: grid.taus_s.iter().copied().zip(best.objective).collect(),
    };
    let predictions = prediction::predictions(ramps, &grid, None);
    let (biases, solutions) = estimates(ramps, table, value_s, &used, &errors, &predictions);
    let residuals: Vec<Vec<f64>> =
        ramps.biases.iter().zip(&solutions).map(|(of, it)| left_over(ramps, of, value_s, it)).collect();
    let steps = steps::steps(ramps, &residuals);
    Fit { time_constant, conditions, biases, solutions, steps, searched: None }
}

/// The fit with a time constant that is given. What the search says of it is reported, but does not decide.
///
/// Its start is known to be soaked after some time constants, and what comes before is left out: how the start decays
/// need not be assumed.
fn given(ramps: &mut Ramps, table: &CoefficientTable, tau_s: f64) -> Result<Fit, TransientsError> {
    use Column::{Constant, Curve, Transient};
    let searched = search(ramps, table, None);
    ramps.leave_out_start(SOAK * tau_s);
    if ramps.inside() < blocks::FEWEST_BLOCKS {
        return Err(TransientsError::TooLong(tau_s));
    }
    let ramps = &*ramps;
    let grid = Grid::new(ramps, Some(tau_s));
    let used = ramps.columns_of(&[Constant, Curve, Transient]);
    let errors = grid.jackknife(&used, tau_s);
    let predictions = prediction::predictions(ramps, &grid, Some(tau_s));
    let (mut biases, solutions) = estimates(ramps, table, tau_s, &used, &errors, &predictions);
    for (bias, other) in biases.iter_mut().zip(&searched.biases) {
        for (condition, other) in bias.conditions.iter_mut().zip(&other.conditions) {
            if condition.name == "lag-not-hysteresis" {
                *condition = Condition { decides: false, ..other.clone() };
            }
        }
    }
    let conditions = searched.conditions.into_iter().map(|condition| Condition { decides: false, ..condition });
    let time_constant = TimeConstantEstimate {
        value_s: tau_s,
        interval_s: [tau_s; 2],
        given: true,
        kept: false,
        at_end: false,
        search: searched.time_constant.search.clone(),
    };
    let conditions = conditions.collect();
    Ok(Fit {
        time_constant,
        conditions,
        biases,
        solutions,
        steps: searched.steps,
        searched: Some(searched.time_constant),
    })
}

/// The estimates of all biases at a time constant, none of them written yet, with the solutions.
fn estimates(
    ramps: &Ramps,
    table: &CoefficientTable,
    tau_s: f64,
    used: &[usize],
    errors: &Errors,
    predictions: &[Option<Prediction>],
) -> (Vec<BiasTransient>, Vec<Coefficients>) {
    let one = |((of, number), prediction): ((&Bias, usize), &Option<Prediction>)| {
        let rows = ramps.rows(of, tau_s);
        let equations = total(ramps, &ramps.equations(&rows));
        let whole = equations.solve(used);
        let still = equations.solve(&ramps.columns_of(&[Column::Constant, Column::Curve]));
        let transient = ramps.columns(Column::Transient).start;
        let differences: Vec<f64> = rows.iter().map(|row| row[transient]).collect();
        let mut bias = BiasTransient {
            kind: of.kind,
            axis: of.axis,
            transient: 0.0,
            estimate: whole.values[transient],
            standard_error: errors.own[number],
            error_at_time_constant: errors.at_tau[number],
            prediction: *prediction,
            conditions: Vec::new(),
            before: residual_loop(ramps, of, &rows, tau_s, &still),
            after: residual_loop(ramps, of, &rows, tau_s, &whole),
            curve: curve(ramps, of, &whole, coefficients(table, of)),
            curve_error: None,
            carried_g0: of.carried_g0,
        };
        bias.conditions = decision::of_bias(&bias, standard_deviation(&differences));
        (bias, whole)
    };
    ramps.biases.iter().zip(0..).zip(predictions).map(one).unzip()
}

/// What constant, curve and transient of a solution leave over, after the soak.
fn residual_loop(ramps: &Ramps, of: &Bias, rows: &[Vec<f64>], tau_s: f64, solution: &Coefficients) -> Vec<LoopPoint> {
    loop_points(ramps, of, SOAK * tau_s, residual(ramps, of, rows, solution))
}

/// What constant, curve and transient of a solution leave over, by block.
fn residual<'a>(
    ramps: &Ramps,
    of: &'a Bias,
    rows: &'a [Vec<f64>],
    solution: &'a Coefficients,
) -> impl Fn(usize) -> f64 + 'a {
    let columns = ramps.columns_of(&[Column::Constant, Column::Curve, Column::Transient]);
    move |block| {
        let explained = columns.iter().map(|column| solution.values[*column] * rows[block][*column]).sum::<f64>();
        of.values[block] - explained
    }
}

/// The same by sweep, after `soak_s`.
fn sweeps_without(
    ramps: &Ramps,
    of: &Bias,
    rows: &[Vec<f64>],
    soak_s: f64,
    solution: &Coefficients,
) -> Vec<SweepValues> {
    sweeps::values(ramps, of, soak_s, residual(ramps, of, rows, solution))
}

/// What all columns of a solution leave over, by block.
fn left_over(ramps: &Ramps, of: &Bias, tau_s: f64, solution: &Coefficients) -> Vec<f64> {
    of.values.iter().zip(ramps.rows(of, tau_s)).map(|(value, row)| value - solution.of(&row)).collect()
}

/// The residuals of the blocks after `soak_s`, with their direction.
fn loop_points(ramps: &Ramps, of: &Bias, soak_s: f64, residual: impl Fn(usize) -> f64) -> Vec<LoopPoint> {
    let of_sweep = |sweep: &blocks::RampSweep| {
        let heating = sweep.heating;
        sweep.pieces.iter().flat_map(Clone::clone).map(move |block| (block, heating)).collect::<Vec<_>>()
    };
    let soaked = |block: &blocks::Block| block.age_s > soak_s && block.is_fitted();
    let shown = ramps.sweeps.iter().flat_map(of_sweep).filter(|(block, _)| soaked(&ramps.blocks[*block]));
    shown
        .map(|(block, heating)| LoopPoint { temperature: of.temperature[block], residual: residual(block), heating })
        .collect()
}

/// The static model on all blocks that are fitted now.
fn static_model(ramps: &Ramps, of: &Bias) -> Coefficients {
    let equations = total(ramps, &ramps.equations(&ramps.rows(of, ramps.least_tau_s)));
    equations.solve(&ramps.columns_of(&[Column::Constant, Column::Curve]))
}

/// The fitted curve over the range of the temperature \[g0 or deg/h\], shifted so that it is the axis's own at mid
/// range.
fn curve(ramps: &Ramps, of: &Bias, coefficients: &Coefficients, axis: &Axis) -> Polynomial {
    let first = ramps.columns(Column::Curve).start;
    let [one, two, three] = core::array::from_fn(|k| coefficients.values[first + k]);
    let [low, high] = of.range;
    let (center, scale) = (low.midpoint(high), (high - low) / 2.0);
    // Chebyshev polynomials as powers; at the centre only the constant is left.
    let constant = axis.bias_at(axis.bias.clamp(center)).0;
    let powers = [constant, one - 3.0 * three, 2.0 * two, 4.0 * three];
    Polynomial::new(&powers, center, scale, of.range).unwrap_or(axis.bias)
}

/// The coefficients of a sensor in the table.
fn coefficients<'a>(table: &'a CoefficientTable, of: &Bias) -> &'a Axis {
    let content = table.content();
    match (of.kind, &content.gyroscopes) {
        (SensorKind::Gyroscope, Some(gyroscopes)) => &gyroscopes.axes[of.axis],
        _ => &content.axes[of.axis],
    }
}

/// The warning that a transient may be the converter's.
fn carried(biases: &[BiasTransient]) -> Option<String> {
    let carrying = biases.iter().filter(|bias| bias.transient != 0.0 && bias.carried_g0 > CARRIED_G0);
    let axes: Vec<_> = carrying.map(|bias| format!("{} {:.2} g0", bias.name(), bias.carried_g0)).collect();
    let message = "a converter behind its thermometer gives the same transient as the sensor; record ramps with these axes horizontal, or do not \
                   use the table where they carry another specific force";
    (!axes.is_empty()).then(|| format!("the ramps have specific force along {}: {message}", axes.join(", ")))
}

/// The warning that a recording has a gap that matters to the lag.
fn gap(recording: &RampRecording, tau_s: f64) -> Option<String> {
    let (at_s, gap_s) = recording.largest_gap_s();
    (gap_s > GAP * tau_s).then(|| {
        format!(
            "{}: no rows for {gap_s:.0} s, {at_s:.0} s after its begin; the temperature is taken to change evenly there",
            recording.name()
        )
    })
}

/// The warning that the table does not reach as far as the ramps.
fn outside(ramps: &Ramps, curves: CurveSource) -> Option<String> {
    let part = 1.0 - ramps.inside() as f64 / ramps.blocks.len() as f64;
    let remedy = match curves {
        CurveSource::Campaign => "record the static positions over the range of the ramps",
        CurveSource::Ramps => "take curves whose scale factors reach as far",
    };
    let message = format!("the temperature goes beyond the range of the table's polynomials there; {remedy}");
    (part > 0.0).then(|| format!("{:.1} % of the ramps are left out: {message}", 100.0 * part))
}

fn standard_deviation(values: &[f64]) -> f64 {
    let mean = isotherm_statistics::mean(values);
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}
