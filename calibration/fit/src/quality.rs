//! The quality of a triad's calibration beyond its standard errors: lack of fit, outlying runs. A run is a dwell or a
//! turn.

use crate::sensor::{ReducedSensor, TriadUnits};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Fit, OrderTable, QUANTITIES, median, robust_sd};
use isotherm_support::finding::{Finding, Location, RunNumber, Severity, name};

/// Limit of a run's residual, in robust standard deviations of the residuals; a run over it is an outlier.
const OUTLIER: f64 = 6.0;
/// Largest part of the runs that can be outliers.
const MAX_OUTLIER_PART: f64 = 0.1;
/// Largest number of outliers.
const MAX_OUTLIERS: usize = 20;
/// Limits of the set points' scatter about their curve, in their own standard errors and in multiples of the smallest
/// effect that matters; beyond both the curve does not fit. Where the own errors are not known, the second decides.
const LACK_OF_FIT: [f64; 2] = [8.0, 10.0];
/// The limits if a higher order is better at set points left out: then no outlying dwell pulls the curve. A bar of the
/// report is about 2.4 own errors.
const ORDER_TOO_LOW: [f64; 2] = [6.0, 2.0];
/// A higher order is better if it leaves less than this part of the rms at set points left out.
const BETTER: f64 = 0.5;

/// Causes of a lack of fit, and remedies.
const CAUSES: &str = "the order is too low, there are too few set points for a higher one, or the IMU does not \
     repeat; take a higher --order, measure more set points, or look in the report for a set point that is off";

/// A triad after its fit.
pub(crate) struct FittedTriad<'a, P> {
    /// Which triad it is.
    pub(crate) units: &'static TriadUnits,
    /// The order tables, by sensor and quantity.
    pub(crate) orders: &'a [[OrderTable; 3]; AXES],
    /// The set points, each reduced by itself.
    pub(crate) set_points: Vec<[ReducedSensor<'a>; AXES]>,
    /// The position or turn of each run.
    pub(crate) places: Vec<P>,
    /// Residuals of each run.
    pub(crate) residuals: &'a [[f64; AXES]],
}

/// An outlying run, as it is shown.
pub(crate) struct Outlier {
    /// Its first line.
    pub(crate) line: u64,
    /// Its set point \[degC\].
    pub(crate) set_point_c: f64,
    /// Its position or turn.
    pub(crate) number: RunNumber,
    /// How far it is off the fit.
    pub(crate) off: String,
}

impl<P: PartialEq> FittedTriad<'_, P> {
    /// The outlying runs, as index and axis, and what is to be said of the fit. `refit` gives the residuals of a fit
    /// without some runs, if there is one; `shown` an outlier as it is shown.
    pub(crate) fn findings(
        &self,
        refit: impl Fn(&[usize]) -> Option<Vec<[f64; AXES]>>,
        shown: impl Fn(usize, usize) -> Outlier,
    ) -> (Vec<(usize, usize)>, Vec<Finding>) {
        let (unfit, mut findings) = self.lack_of_fit();
        let mut outliers = self.outliers(refit);
        // Residuals about a curve that does not fit do not show outlying runs.
        outliers.retain(|(_, axis)| !unfit[*axis]);
        findings.extend(outliers.iter().map(|&(run, axis)| shown(run, axis).finding(self.units.names[axis])));
        findings.extend(self.of_orders());
        (outliers, findings)
    }

    /// A warning about the curves that miss their set points by much more than the set points' own uncertainty, and
    /// one about curves without degrees of freedom. The array marks the axes that have a curve of the first kind.
    fn lack_of_fit(&self) -> ([bool; AXES], Vec<Finding>) {
        let mut unfit = [false; AXES];
        let (mut missing, mut taking) = (Curves::default(), Curves::default());
        for (axis, quantity, curve) in self.curves() {
            let table = &self.orders[axis][quantity];
            let fit = &table.regression.fits()[table.choice.order];
            let of_sensor = || self.set_points.iter().map(|sensors| &sensors[axis]);
            let size = of_sensor().map(|sensor| sensor.values[quantity].abs()).fold(0.0, f64::max);
            let own: Vec<f64> = of_sensor().map(|sensor| sensor.standard_errors[quantity]).collect();
            match fit.residual_sd.map(|_| scatter(&table.regression.residuals(fit.order), &own, fit.df_residual)) {
                Some([sd, times]) if is_unfit(table, times, sd / self.effect(quantity, size)) => {
                    unfit[axis] = true;
                    let scatter = self.scatter_text(quantity, sd, size);
                    let order = fit.order;
                    let times_own = match times.is_nan() {
                        true => String::new(),
                        false => format!(", {times:.0} times what each is uncertain by"),
                    };
                    let text =
                        format!("the set points scatter by {scatter} about the curve of order {order}{times_own}");
                    missing.add(curve, times, text);
                }
                None => {
                    let (order, n) = (fit.order, self.set_points.len());
                    taking.add(
                        curve,
                        0.0,
                        format!("order {order} takes all {n} set points, so that nothing shows how good the curve is"),
                    );
                }
                _ => {}
            }
        }
        let missing = missing.finding(name::LACK_OF_FIT, CAUSES);
        let taking = taking.finding(name::NO_FREEDOM, "measure more set points, or take a lower order");
        (unfit, missing.into_iter().chain(taking).collect())
    }

    /// Axis, quantity and name of each curve.
    fn curves(&self) -> impl Iterator<Item = (usize, usize, String)> {
        let names = self.units.names;
        let quantities = (0..AXES).flat_map(|axis| (0..QUANTITIES.len()).map(move |quantity| (axis, quantity)));
        quantities.map(move |(axis, quantity)| (axis, quantity, format!("{} {}", names[axis], QUANTITIES[quantity])))
    }

    /// The smallest change that matters of a quantity of the size `size`.
    fn effect(&self, quantity: usize, size: f64) -> f64 {
        let [bias, scale_factor] = self.units.effects;
        if quantity == 0 { bias } else { scale_factor * size }
    }

    /// A scatter as text.
    fn scatter_text(&self, quantity: usize, sd: f64, size: f64) -> String {
        let TriadUnits { bias_factor, accuracy_decimals, behind_bias, .. } = self.units;
        match quantity {
            0 => format!("{:.accuracy_decimals$}{behind_bias}", sd * bias_factor),
            _ => format!("{:.2} ppm", sd * (1e6 / size)),
        }
    }

    /// Outlying runs, as index and axis. The worst is left out and the fit repeated, until no outlier is left.
    fn outliers(&self, refit: impl Fn(&[usize]) -> Option<Vec<[f64; AXES]>>) -> Vec<(usize, usize)> {
        let mut found: Vec<(usize, usize)> = Vec::new();
        let mut left_out: Vec<usize> = Vec::new();
        let mut residuals = self.residuals.to_vec();
        let most = MAX_OUTLIERS.min((MAX_OUTLIER_PART * self.places.len() as f64) as usize);
        while left_out.len() < most {
            let Some((run, axis)) = self.worst(&residuals, &left_out) else { break };
            found.push((run, axis));
            left_out.push(run);
            let Some(without) = refit(&left_out) else { break };
            residuals = without;
        }
        found
    }

    /// The run that exceeds its limit most, and the axis.
    fn worst(&self, residuals: &[[f64; AXES]], left_out: &[usize]) -> Option<(usize, usize)> {
        let mut worst: Option<(f64, usize, usize)> = None;
        for axis in 0..AXES {
            for Deviation { run, off, scale, .. } in deviations(&self.places, residuals, axis, left_out) {
                let ratio = off.abs() / (OUTLIER * scale + self.units.outlier_floor);
                if ratio > 1.0 && worst.is_none_or(|(most, ..)| ratio > most) {
                    worst = Some((ratio, run, axis));
                }
            }
        }
        worst.map(|(_, run, axis)| (run, axis))
    }

    /// The warnings of the order tables' diagnostics, with the name of the curve.
    fn of_orders(&self) -> impl Iterator<Item = Finding> {
        self.curves().flat_map(|(axis, quantity, curve)| {
            let warnings = self.orders[axis][quantity].diagnostics.warnings.iter();
            warnings.map(move |warning| Finding::warning(name::RESIDUALS, format!("{curve}: {warning}")))
        })
    }
}

impl Outlier {
    fn finding(self, sensor: &str) -> Finding {
        let Self { line, set_point_c, number, off } = self;
        let message = format!(
            "{sensor} is {off} off the fit, far more than elsewhere; kept, leave it out with --exclude {set_point_c}/{} \
             if it is known to be bad",
            number.value()
        );
        let place = Some(Location::SetPoint(set_point_c, Some(number)));
        Finding { severity: Severity::Warning, name: name::OUTLIER, line: Some(line), place, message }
    }
}

/// Whether the scatter of set points shows that their curve does not fit: so many own errors, not a number where these
/// are not known, and so many effects that matter.
fn is_unfit(table: &OrderTable, times: f64, effects: f64) -> bool {
    let beyond = |[own, effect]: [f64; 2]| (times.is_nan() || times > own) && effects > effect;
    let left = |fit: &Fit| fit.leave_one_out_rms;
    let higher = table.regression.fits()[table.choice.order + 1..].iter().filter_map(left);
    let is_better =
        left(table.chosen()).is_some_and(|rms| higher.min_by(f64::total_cmp).is_some_and(|it| it < BETTER * rms));
    beyond(LACK_OF_FIT) || (is_better && !times.is_nan() && beyond(ORDER_TOO_LOW))
}

/// The scatter of set points about a curve, in its unit and in their own errors. The robust scatter ignores a few
/// outliers, which are found elsewhere.
fn scatter(residuals: &[f64], own: &[f64], freedom: usize) -> [f64; 2] {
    let sd = robust_sd(residuals) * (residuals.len() as f64 / freedom as f64).sqrt();
    [sd, sd / median(own.iter().copied())]
}

/// Curves with the same fault: how bad the worst is, what is said about it, and the number of curves.
#[derive(Default)]
struct Curves {
    worst: f64,
    text: String,
    count: usize,
}

impl Curves {
    fn add(&mut self, curve: String, size: f64, text: String) {
        if self.count == 0 || size > self.worst {
            (self.worst, self.text) = (size, format!("{curve}: {text}"));
        }
        self.count += 1;
    }

    /// One line, about the worst.
    fn finding(self, name: &'static str, remedy: &str) -> Option<Finding> {
        let others = match self.count {
            0 => return None,
            1 => String::new(),
            2 => ", and so it is with one more curve".to_owned(),
            n => format!(", and so it is with {} more curves", n - 1),
        };
        Some(Finding::warning(name, format!("{}{others}: {remedy}", self.text)))
    }
}

/// The residual of a run and those of its place.
pub(crate) struct Deviation {
    /// Index of the run.
    pub(crate) run: usize,
    /// Median of the place.
    pub(crate) usual: f64,
    /// Residual less that median.
    pub(crate) off: f64,
    /// Robust standard deviation of these differences in the place.
    pub(crate) scale: f64,
}

/// The deviation of each run that is not left out. Each place has its own level error, if no tilt was estimated, and
/// its own scatter, because the turntable's repeatability acts differently on the axes.
pub(crate) fn deviations<P: PartialEq>(
    places: &[P],
    residuals: &[[f64; AXES]],
    axis: usize,
    left_out: &[usize],
) -> Vec<Deviation> {
    let kept: Vec<usize> = (0..places.len()).filter(|run| !left_out.contains(run)).collect();
    let same = |run: usize| kept.iter().copied().filter(move |other| places[*other] == places[run]);
    let usual = |run: usize| median(same(run).map(|other| residuals[other][axis]));
    let medians: Vec<f64> = (0..places.len()).map(usual).collect();
    let off = |run: usize| residuals[run][axis] - medians[run];
    let scatter = |runs: &mut dyn Iterator<Item = usize>| robust_sd(&runs.map(off).collect::<Vec<_>>());
    // A few runs in a place can agree by chance, so the scatter over all places is the lower limit.
    let least = scatter(&mut kept.iter().copied());
    let deviation = |&run: &usize| {
        let scale = least.max(scatter(&mut same(run)));
        Deviation { run, usual: medians[run], off: off(run), scale }
    };
    kept.iter().map(deviation).collect()
}
