//! Which unit of a batch stands out, and how far off a device must be to be found.

use isotherm_statistics::student_quantile_of;

/// Fewest devices that anything is said of.
pub(crate) const FEWEST_DEVICES: usize = 5;
/// Probability that any device stands out where all are of one kind; it is shared among all devices and quantities.
const FALSE_ALARM: f64 = 0.05;
/// Probability that a device is found, for the size that is reported.
pub(super) const POWER: f64 = 0.9;

/// A device that differs from the others in a quantity by more than chance makes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StandOut {
    /// Index of the unit.
    pub unit: usize,
    /// Index of the quantity.
    pub quantity: usize,
    /// The unit's value less the mean of the others, over the standard deviation of such a difference.
    pub t: f64,
    /// The size of t that had to be exceeded.
    pub limit: f64,
}

/// The size of Student's t, with `devices - 2` degrees of freedom, that any of `devices` times `quantities` values
/// exceeds with 5 % at most. `None` under 5 devices or without quantities.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::limit;
///
/// // Among more devices less is enough.
/// let few = limit(5, 9).ok_or("no quantities")?;
/// assert!((few - 12.5).abs() < 0.05 && limit(16, 9).is_some_and(|many| many < few));
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn limit(devices: usize, quantities: usize) -> Option<f64> {
    (devices >= FEWEST_DEVICES && quantities > 0)
        .then(|| student_quantile_of(1.0 - FALSE_ALARM / (devices * quantities) as f64, (devices - 2) as f64))
}

/// For each value, how far it is from the mean of the others:
///
/// ```text
/// t = (x - mean of the others) / (s of the others * sqrt(1 + 1/(n-1)))
/// ```
/// If all devices are of one kind, it follows Student's t with n - 2 degrees of freedom. `None` under 3 values, and
/// where the others are all the same.
#[must_use]
pub fn leave_one_out(values: &[f64]) -> Vec<Option<f64>> {
    let count = values.len() as f64;
    let t = |left_out: usize| {
        let others = || values.iter().enumerate().filter(|(index, _)| *index != left_out).map(|(_, value)| *value);
        let n = count - 1.0;
        let mean = others().sum::<f64>() / n;
        let s = (others().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let rounding = 1e-12 * others().fold(0.0, |most: f64, value| most.max(value.abs()));
        (n > 1.0 && s > rounding).then(|| (values[left_out] - mean) / (s * (1.0 + 1.0 / n).sqrt()))
    };
    (0..values.len()).map(t).collect()
}

/// The devices that stand out, the farthest first. `quantities` has the values of all devices for each quantity.
///
/// The unit with the largest t is taken out if it exceeds the [`limit`], with all quantities in which it does; then the
/// others are looked at again. At most a quarter of the devices is taken out: of more, none is the odd one. `None`
/// under 5 devices.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::stand_outs;
///
/// // A quantity of eight devices; the sixth is far from the others.
/// let bias = vec![10.1, 9.8, 10.3, 9.9, 10.0, 14.0, 10.2, 9.7];
/// let found = stand_outs(&[bias]).ok_or("fewer than five devices")?;
/// assert_eq!((found.len(), found[0].unit), (1, 5));
/// assert!(found[0].t > found[0].limit);
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn stand_outs(quantities: &[Vec<f64>]) -> Option<Vec<StandOut>> {
    let devices = quantities.first().map_or(0, Vec::len);
    limit(devices, quantities.len())?;
    let (mut kept, mut found): (Vec<usize>, _) = ((0..devices).collect(), Vec::new());
    for _ in 0..devices / 4 {
        let Some(limit) = limit(kept.len(), quantities.len()) else { break };
        let scores = quantities.iter().enumerate().flat_map(|(quantity, values)| {
            let values: Vec<f64> = kept.iter().map(|unit| values[*unit]).collect();
            let scores = leave_one_out(&values).into_iter().zip(&kept);
            let score = |(t, unit): (Option<f64>, &usize)| Some(StandOut { unit: *unit, quantity, t: t?, limit });
            scores.filter_map(score).collect::<Vec<_>>()
        });
        let over: Vec<_> = scores.filter(|score| score.t.abs() > limit).collect();
        let Some(farthest) = over.iter().max_by(|a, b| a.t.abs().total_cmp(&b.t.abs())).copied() else { break };
        let mut of_unit: Vec<_> = over.into_iter().filter(|score| score.unit == farthest.unit).collect();
        of_unit.sort_by(|a, b| b.t.abs().total_cmp(&a.t.abs()));
        found.extend(of_unit);
        kept.retain(|unit| *unit != farthest.unit);
    }
    Some(found)
}

/// How many standard deviations of the devices a device must be off in one quantity, so that it is found with a
/// probability of 90 %. `None` under 5 devices.
///
/// Then t follows the noncentral t distribution with the noncentrality `off * sqrt((n-1)/n)`.
#[must_use]
pub fn least_found(devices: usize, quantities: usize) -> Option<f64> {
    let limit = limit(devices, quantities)?;
    let to_mean = ((devices - 1) as f64 / devices as f64).sqrt();
    let (mut low, mut high) = (0.0, 1.0);
    while exceeds(limit, devices - 2, high * to_mean) < POWER {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if exceeds(limit, devices - 2, middle * to_mean) < POWER { low = middle } else { high = middle }
    }
    Some(high)
}

/// Probability that noncentral t is over `limit`: that of z + noncentrality > limit s, with z normal, and s the root of
/// chi square over its degrees of freedom, whose density is proportional to s^(freedom - 1) exp(-freedom s^2/2).
fn exceeds(limit: f64, freedom: usize, noncentrality: f64) -> f64 {
    const STEPS: u32 = 2000;
    // Beyond 5 the density is nothing, also with 3 degrees of freedom.
    let steps = (0..STEPS).map(|i| 5.0 * (f64::from(i) + 0.5) / f64::from(STEPS));
    let n = freedom as f64;
    let density = |s: f64| libm::exp((n - 1.0) * libm::log(s) - n * s * s / 2.0 + n / 2.0);
    let normal = |z: f64| 0.5 * libm::erfc(-z / core::f64::consts::SQRT_2);
    let (sum, total) = steps
        .fold((0.0, 0.0), |(sum, total), s| (sum + density(s) * normal(noncentrality - limit * s), total + density(s)));
    sum / total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_found_is_that_of_the_noncentral_t_distribution() {
        // From an independent computation (SciPy's nct), for 30 quantities.
        for (devices, right_limit, right) in
            [(5, 18.708_878, 30.282_4), (8, 7.965_969, 11.617_0), (16, 5.340_838, 7.301_6), (32, 4.714_695, 6.275_3)]
        {
            assert!((limit(devices, 30).unwrap() - right_limit).abs() < 1e-5);
            assert!((least_found(devices, 30).unwrap() - right).abs() < 1e-3, "{:?}", least_found(devices, 30));
        }
        assert_eq!((limit(4, 30), least_found(4, 30), stand_outs(&vec![vec![0.0; 4]; 30])), (None, None, None));
    }

    #[test]
    fn values_that_are_the_same_say_nothing() {
        assert_eq!(leave_one_out(&[1.0, 1.0, 1.0, 1.0, 5.0])[4], None);
        assert_eq!(leave_one_out(&[0.1 + 0.2, 0.3, 0.3, 0.3, 0.7])[4], None);
        assert_eq!(leave_one_out(&[1.0, 2.0]), [None, None]);
        let t = leave_one_out(&[0.0, 1.0, 2.0, 4.0]);
        // (4 - 1)/(1 * sqrt(4/3))
        assert!((t[3].unwrap() - 3.0 / (4.0_f64 / 3.0).sqrt()).abs() < 1e-15);
    }
}
