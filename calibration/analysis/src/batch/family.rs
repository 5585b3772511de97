//! The family curve: whether the mean curve of the other devices says how the curve of a device runs.

/// The family curve of one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Family {
    /// For each device, the rms of its curve less its mid value, in the quantity's unit.
    pub alone: Vec<f64>,
    /// For each device, the rms of what the mean of the others leaves of it.
    pub left: Vec<f64>,
}

impl Family {
    /// Of curves at the same points of the temperature, each less its own mid value. `None` under three devices, and
    /// where no curve changes.
    #[must_use]
    pub fn of(curves: &[Vec<f64>]) -> Option<Self> {
        let others = curves.len().checked_sub(1).filter(|others| *others >= 2)? as f64;
        let rms = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
            f64::sqrt(sum / count)
        };
        let points = curves.first()?.len();
        let total: Vec<f64> = (0..points).map(|i| curves.iter().map(|curve| curve[i]).sum()).collect();
        let left = |curve: &Vec<f64>| rms(&mut curve.iter().zip(&total).map(|(c, total)| c - (total - c) / others));
        let family = Self {
            alone: curves.iter().map(|curve| rms(&mut curve.iter().copied())).collect(),
            left: curves.iter().map(left).collect(),
        };
        family.alone.iter().any(|rms| *rms > 0.0).then_some(family)
    }

    /// What the others' mean leaves, over doing nothing: the ratio of the rms over all devices.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        let square = |all: &[f64]| all.iter().map(|rms| rms * rms).sum::<f64>();
        (square(&self.left) / square(&self.alone)).sqrt()
    }

    /// Devices for which the others' mean leaves less than doing nothing.
    #[must_use]
    pub fn gains(&self) -> usize {
        self.left.iter().zip(&self.alone).filter(|(left, alone)| left < alone).count()
    }

    /// Whether it is useful: the rms is halved, and three quarters of the devices gain.
    #[must_use]
    pub fn is_useful(&self) -> bool {
        self.ratio() <= 0.5 && 4 * self.gains() >= 3 * self.alone.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_the_others_is_judged() {
        let line = |slope: f64| (-2..=2).map(|i| slope * f64::from(i)).collect::<Vec<_>>();
        // One kind: all slopes about 10.
        let alike = Family::of(&[9.0, 10.0, 11.0, 10.5].map(line)).unwrap();
        assert!(alike.is_useful() && alike.gains() == 4 && (0.08..0.12).contains(&alike.ratio()), "{alike:?}");
        // The first against the mean of the others, 10.5; the rms of a line of slope 1 is sqrt(2).
        assert!((alike.left[0] - 1.5 * 2.0_f64.sqrt()).abs() < 1e-14);
        // No kind: the others' mean makes it worse.
        let apart = Family::of(&[-10.0, 10.0, -8.0, 9.0].map(line)).unwrap();
        assert!(!apart.is_useful() && apart.ratio() > 1.0, "{apart:?}");
        // Half of the devices gain, the others lose.
        let two = Family::of(&[100.0, 100.0, 0.1, 0.1].map(line)).unwrap();
        assert!(!two.is_useful() && two.gains() == 2);
        assert_eq!(Family::of(&[1.0, 1.0].map(line)), None);
        assert_eq!(Family::of(&[0.0; 5].map(line)), None);
    }
}
