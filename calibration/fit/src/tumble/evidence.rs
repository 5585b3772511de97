//! What the residuals say against the model: groups that differ, a bias that walks, an element behind its temperature,
//! and residuals that no noise explains.
//!
//! Each is judged in M, the space that the unknowns and the offsets of every group leave, with w = M'f:
//!
//! ```text
//! groups: F = ((|N'f|^2 - |w|^2)/q)/(|w|^2/m)
//! walk:   w'Bw/w'w, B = M'(W_ij d_i.d_j)M, by the beta distribution with its exact mean, variance and range
//! lag:    b = z'w/z'z [s], F(1, m - 1)
//! ```

use super::choice::TumbleFit;
use super::covariance::{BIAS, GAIN, LAG_S, Shapes, WALK, beside, by_gain, slope_columns, within_groups};
use super::groups::Groups;
use super::reading::Reading;
use super::remainder::Remainder;
use super::weighted::WeightedFit;
use isotherm_campaign::joint_range;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{beta_tail, f_tail, largest};
use isotherm_support::finding::{Finding, name};

/// Probability that a warning has no cause.
pub(super) const SIGNIFICANCE: f64 = 0.01;
/// Residuals within the groups, over the noise of the static poses, that give a warning; twice as much is a fault.
const MISFIT: f64 = 10.0;
/// Residuals within the groups below this are no fault \[g0\].
const MISFIT_G0: f64 = 2e-3;
/// An error of the output beyond this makes no table \[g0\].
const WRONG_G0: f64 = 10e-3;
/// Gains of the groups that differ by more make no table.
const WRONG_GAIN: f64 = 0.01;
/// Scatter of the groups below this is none.
const UNSEEN: f64 = 1e-8;
/// Share of the variance that lags make beyond which it is said.
const MOSTLY_LAG: f64 = 0.5;

/// What the residuals say.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// Probability by chance of groups that differ as much.
    pub groups: f64,
    /// Of a bias that walks as much in the groups.
    pub walk: f64,
    /// Of a lag as long.
    pub lag: f64,
    /// The element's time behind the temperature \[s\].
    pub lag_s: f64,
    /// Residual within the groups, over the degrees of freedom that are left \[g0\].
    pub within: f64,
    /// The same over the noise of the static poses.
    pub noises: f64,
    /// Largest share in the variance of a bias of what an element up to 60 s behind its temperature makes.
    pub lag_share: f64,
    /// Scatter of the groups' biases \[g0\].
    pub group_bias: f64,
    /// Scatter of the groups' gains.
    pub group_gain: f64,
    /// Walk of the bias over a group \[g0\].
    pub walk_bias: f64,
    /// Most that temperature moves in a group.
    pub moved: f64,
}

impl Evidence {
    pub(super) fn of(weighted: &WeightedFit<'_>, groups: &Groups) -> Self {
        let WeightedFit { model, fit, residual, shapes, .. } = weighted;
        let n = residual.len();
        // Slopes are no reason to name a walk or a lag.
        let unknowns = beside(n, &[fit.jacobian.clone(), slope_columns(model, fit, groups)]);
        let offsets = [within_groups(&fit.by_force, groups), within_groups(&by_gain(fit), groups)];
        let all = [[unknowns.clone()].as_slice(), &offsets].concat();
        let outside = Remainder::of(&unknowns, shapes, residual);
        let within = Remainder::of(&beside(n, &all), shapes, residual);
        let (q, m, squares) = (outside.dimension() - within.dimension(), within.dimension(), within.squares());
        let between = outside.squares() - squares;
        let groups_p =
            if q > 0 && m > 1 { f_tail((between / q as f64) / (squares / m as f64), q as f64, m as f64) } else { 1.0 };
        let (lag, lag_s) = lag(&within, shapes);
        let temperature: Vec<f64> = model.readings().iter().map(Reading::temperature).collect();
        let root_mean = if m > 0 { (squares / m as f64).sqrt() } else { f64::NAN };
        let variances = &weighted.variances.values;
        Self {
            groups: groups_p,
            walk: walk(&within),
            lag,
            lag_s,
            within: root_mean,
            noises: root_mean / weighted.floor.sqrt(),
            lag_share: lag_share(weighted),
            group_bias: variances[BIAS].sqrt(),
            group_gain: variances[GAIN].sqrt(),
            walk_bias: variances[WALK].sqrt(),
            moved: groups.moved(&temperature),
        }
    }

    /// Whether groups differ, or the residuals are more than noise: a single mistake may explain it.
    pub(super) fn is_against(&self) -> bool {
        self.groups < SIGNIFICANCE || self.noises > MISFIT
    }

    /// Faults and warnings.
    /// `left` is the rms of the residuals of the table \[g0\].
    pub(super) fn findings(&self, fitted: &TumbleFit<'_>, groups: &Groups, left: f64) -> Vec<Finding> {
        let dilution = fitted.dilution.times_root_n / (groups.of.len() as f64).sqrt();
        // A constant over two temperatures is known to leave what differs between them: a line is asked for there.
        let left = if groups.levels == 2 && fitted.model.unknowns.order == 0 { 0.0 } else { left };
        let mut found: Vec<Finding> = self.misfit(dilution, left).into_iter().collect();
        found.extend(self.groups_differ(groups, fitted.model.unknowns.order));
        if self.walk < SIGNIFICANCE {
            let message = format!(
                "the bias walks by {:.0}e-6 g0 in a tumble (p {:.1e}): temperature or power that is not steady yet; the intervals are as \
                 wide as that asks for",
                self.walk_bias * 1e6,
                self.walk
            );
            found.push(Finding::warning(name::WALK, message));
        }
        if self.lag < SIGNIFICANCE {
            let (size, side) = (self.lag_s.abs(), if self.lag_s < 0.0 { "ahead of" } else { "behind" });
            let message = format!(
                "the accelerometers are {size:.0} s {side} their temperature (p {:.1e}), which moved by up to {:.2} in a tumble: wait until it \
                 stands still",
                self.lag, self.moved
            );
            found.push(Finding::warning(name::BEHIND_TEMPERATURE, message));
        }
        if self.lag_share > MOSTLY_LAG {
            let message = format!(
                "temperature moved by up to {:.2} in a tumble: most of the stated error is what an element up to {LAG_S} s behind it makes; wait \
                 until it stands still",
                self.moved
            );
            found.push(Finding::warning(name::TEMPERATURE_MOVES, message));
        }
        found
    }

    /// Residuals that the noise does not explain.
    fn misfit(&self, dilution: f64, left: f64) -> Option<Finding> {
        if left > WRONG_G0 {
            let message = format!(
                "the table leaves residuals of {:.1}e-3 g0 rms, over {:.0}e-3: it does not explain the static poses",
                left * 1e3,
                WRONG_G0 * 1e3
            );
            return Some(Finding::fault(name::LACK_OF_FIT, message));
        }
        let shown = format!(
            "within the files and temperatures the residuals are {:.0}e-6 g0, {:.0} times the noise of the static poses",
            self.within * 1e6,
            self.noises
        );
        if self.within * dilution > WRONG_G0 || (self.noises > 2.0 * MISFIT && self.within > MISFIT_G0) {
            let message = format!("{shown}: the model does not hold, and the output would be wrong by as much");
            return Some(Finding::fault(name::LACK_OF_FIT, message));
        }
        let message = format!("{shown}: a converter near its end, or ground that is not firm; look at the residuals");
        (self.noises > MISFIT).then(|| Finding::warning(name::LACK_OF_FIT, message))
    }

    /// Groups whose biases and gains differ. What differs as an element behind its temperature does is said there.
    fn groups_differ(&self, groups: &Groups, order: usize) -> Option<Finding> {
        let unseen = self.group_bias < UNSEEN && self.group_gain < UNSEEN;
        if groups.count < 2 || self.groups >= SIGNIFICANCE || (unseen && self.lag_share > MOSTLY_LAG) {
            return None;
        }
        let what = if groups.count == 2 { "the two groups of static poses" } else { "the groups of static poses" };
        let message = format!(
            "{what}, by file, power-up and temperature, differ by {:.0}e-6 g0 in their biases and {:.0} ppm in their \
             scale factors beyond what temperature explains (p {:.1e}): power-ups that differ, another device in \
             one, an order that is too low, or temperature that is not the element's",
            self.group_bias * 1e6,
            self.group_gain * 1e6,
            self.groups
        );
        // A constant over two temperatures is known to be that: a line is asked for there.
        let constant = order == 0 && groups.levels == 2;
        let wrong = !constant && (self.group_bias > WRONG_G0 || self.group_gain > WRONG_GAIN);
        let make = if wrong { Finding::fault } else { Finding::warning };
        Some(make(name::GROUPS_DIFFER, message))
    }
}

/// The probability by chance of a walk as large.
fn walk(within: &Remainder) -> f64 {
    let m = within.dimension() as f64;
    let columns = &within.shapes.columns[WALK];
    if m <= 2.0 || columns.ncols() == 0 {
        return 1.0;
    }
    let mut values: Vec<f64> = (columns * columns.transpose()).symmetric_eigenvalues().iter().copied().collect();
    if within.others > 0 {
        values.push(0.0);
    }
    let [low, high] = joint_range(values.iter().map(|value| [*value; 2]));
    let range = high - low;
    if range <= 0.0 {
        return 1.0;
    }
    let sum = values.iter().sum::<f64>();
    let squares = values.iter().map(|value| value * value).sum::<f64>();
    let middle = (sum / m - low) / range;
    let variance = 2.0 * (m * squares - sum * sum) / (m * m * (m + 2.0)) / (range * range);
    let shape = middle * (1.0 - middle) / variance - 1.0;
    let [a, b] = [middle * shape, (1.0 - middle) * shape];
    if !(a > 0.0 && b > 0.0) {
        return 1.0;
    }
    let ratio = (columns.tr_mul(&within.right).norm_squared() / within.squares() - low) / range;
    let p = beta_tail(ratio, a, b);
    if p.is_nan() { 1.0 } else { p }
}

/// The probability by chance of a lag as long, and the lag \[s\].
fn lag(within: &Remainder, shapes: &Shapes) -> (f64, f64) {
    /// Share of z that must be left next to the unknowns.
    const LEFT: f64 = 1e-18;
    let known = shapes.known.column(0);
    let z = within.shapes.known.column(0) / (LAG_S / 3.0_f64.sqrt());
    let (m, left) = (within.dimension() as f64, z.norm_squared());
    if m <= 2.0 || left <= LEFT * known.norm_squared().max(f64::MIN_POSITIVE) {
        return (1.0, 0.0);
    }
    let seconds = z.dot(&within.right) / left;
    let explained = seconds * seconds * left;
    let rest = ((within.squares() - explained) / (m - 1.0)).max(f64::MIN_POSITIVE);
    (f_tail(explained / rest, 1.0, m - 1.0), seconds)
}

/// The largest share of lags in the variance of a bias, at lowest, mean and highest temperature.
fn lag_share(weighted: &WeightedFit<'_>) -> f64 {
    let readings = weighted.model.readings();
    let of = |axis: usize| {
        let [low, high] = joint_range(readings.iter().map(|reading| [reading.head[axis]; 2]));
        let mean = readings.iter().map(|reading| reading.head[axis]).sum::<f64>() / readings.len() as f64;
        [low, mean, high].map(|temperature| weighted.error(&weighted.model.gradient(axis, 0, temperature)).lag_share)
    };
    largest((0..AXES).flat_map(of))
}
