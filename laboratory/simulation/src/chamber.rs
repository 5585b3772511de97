//! The temperature chamber, the sensor heads and converter boards that follow it, and the sensing elements that follow
//! the heads.
//!
//! # Equations
//! The air temperature u is a ramp or a hold, u0 + r t \[degC\], plus a slow oscillation a sin(w t + phi). The
//! temperature T of a head or a board follows it with the time constant tau \[s\]: dT/dt = (u - T) / tau. The equation
//! is linear, so the responses to ramp and oscillation have closed forms, which are exact for any step h \[s\]:
//!
//! ```text
//! ramp:         T(t + h) = u(t + h) - r tau + (T(t) - u(t) + r tau) exp(-h / tau)
//! oscillation:  a / sqrt(1 + (w tau)^2) * sin(w t + phi - atan(w tau))                 (steady state)
//! ```
//! The thermometer is on the head, which is the case of the sensor. The sensing element inside follows the head with
//! its own time constant sigma \[s\], dL/dt = (T - L) / sigma. With the two exponentials' divided difference q, which
//! is finite for equal time constants,
//!
//! ```text
//! q    = (exp(-h / tau) - exp(-h / sigma)) / (1 / sigma - 1 / tau)                                          [s]
//! ramp:         L(t + h) = u(t + h) - r (tau + sigma) + (T(t) - u(t) + r tau) q / sigma
//!                          + (L(t) - u(t) + r (tau + sigma)) exp(-h / sigma)
//! oscillation:  that of the head, through the second lag
//! ```
//! The integral of L - T over a time is -sigma times the change of L.

use super::chain::Chain;
use super::random::RandomGenerator;
use core::f64::consts::TAU;

/// Random stream of the oscillation's phase, which is its first number, and of the offsets of each visit.
pub(super) const SLOW_STREAM: u64 = 1;

/// A part that follows the temperature of the chamber's air.
#[derive(Clone, Copy, Debug)]
struct FirstOrderLag {
    tau_s: f64,
    /// Without the oscillation \[degC\].
    temperature_c: f64,
    /// Amplitude of its oscillation \[degC\], and delay behind the oscillation of the air \[rad\].
    amplitude_c: f64,
    delay: f64,
}

impl FirstOrderLag {
    fn new(tau_s: f64, temperature_c: f64, chain: &Chain) -> Self {
        let angle = TAU / chain.oscillation_s * tau_s;
        Self {
            tau_s,
            temperature_c,
            amplitude_c: chain.oscillation_c / libm::hypot(angle, 1.0),
            delay: libm::atan(angle),
        }
    }

    /// Advances by `time_s`, in which the air goes from `from` to `to` \[degC\] at `rate` \[degC/s\].
    fn advance(&mut self, from: f64, to: f64, rate: f64, time_s: f64) {
        let lag_c = rate * self.tau_s;
        self.temperature_c = to - lag_c + (self.temperature_c - from + lag_c) * libm::exp(-time_s / self.tau_s);
    }

    /// A lag behind `self` with the time constant `tau_s`, in equilibrium.
    fn followed_by(&self, tau_s: f64, chain: &Chain) -> Self {
        let angle = TAU / chain.oscillation_s * tau_s;
        Self {
            tau_s,
            amplitude_c: self.amplitude_c / libm::hypot(angle, 1.0),
            delay: self.delay + libm::atan(angle),
            ..*self
        }
    }

    /// As [`advance`](Self::advance), for a lag that follows `head`. `head` is still at the beginning of the time.
    fn advance_behind(&mut self, head: &Self, from: f64, to: f64, rate: f64, time_s: f64) {
        let (head_lag_c, lag_c) = (rate * head.tau_s, rate * (head.tau_s + self.tau_s));
        let (fast, slow) = (self.tau_s.min(head.tau_s), self.tau_s.max(head.tau_s));
        let x = time_s / fast - time_s / slow;
        let ratio = if x == 0.0 { 1.0 } else { -libm::expm1(-x) / x };
        let difference_s = time_s * libm::exp(-time_s / slow) * ratio;
        self.temperature_c = to - lag_c
            + (head.temperature_c - from + head_lag_c) * (difference_s / self.tau_s)
            + (self.temperature_c - from + lag_c) * libm::exp(-time_s / self.tau_s);
    }

    fn at(&self, phase: f64) -> f64 {
        self.temperature_c + self.amplitude_c * libm::sin(phase - self.delay)
    }
}

/// The chamber, with the heads and boards in it, and the sensing elements in the heads.
///
/// ```
/// use isotherm_simulation::{Chain, SimulatedChamber};
///
/// let chain = Chain { oscillation_c: 0.0, ..Chain::default() };
/// let mut chamber = SimulatedChamber::new(&chain, 20.0, 1);
/// chamber.go_to(30.0, 0.1); // degC, degC/s
/// chamber.wait(100.0);
/// assert!((chamber.air_c() - 30.0).abs() < 1e-9);
/// let (head, _) = chamber.head_and_board_c();
/// assert!(head < 30.0); // the heads follow
/// chamber.wait(20.0 * chain.head_lag_s);
/// assert!((chamber.head_and_board_c().0 - 30.0).abs() < 1e-4);
/// ```
#[derive(Clone, Debug)]
pub struct SimulatedChamber {
    /// Temperature of the air, without the oscillation \[degC\].
    air_c: f64,
    target_c: f64,
    /// Magnitude of the ramp's rate \[degC/s\].
    ramp_c_per_s: f64,
    head: FirstOrderLag,
    board: FirstOrderLag,
    /// `None` where the elements have the temperature of their heads.
    element: Option<FirstOrderLag>,
    time_s: f64,
    period_s: f64,
    phase: f64,
}

impl SimulatedChamber {
    /// A chamber in equilibrium at `temperature_c` \[degC\]. The seed determines the phase of the oscillation; a
    /// [`SimulatedImu`](crate::imu::SimulatedImu) of the same seed has the same phase.
    #[must_use]
    pub fn new(chain: &Chain, temperature_c: f64, seed: u64) -> Self {
        Self::with_phase(chain, temperature_c, RandomGenerator::new(seed, SLOW_STREAM).between(0.0, TAU))
    }

    /// A chamber in equilibrium at `temperature_c` \[degC\], with the `phase` \[rad\] of the oscillation.
    pub(super) fn with_phase(chain: &Chain, temperature_c: f64, phase: f64) -> Self {
        Self {
            air_c: temperature_c,
            target_c: temperature_c,
            ramp_c_per_s: 0.0,
            head: FirstOrderLag::new(chain.head_lag_s, temperature_c, chain),
            board: FirstOrderLag::new(chain.board_lag_s, temperature_c, chain),
            element: None,
            time_s: 0.0,
            period_s: chain.oscillation_s,
            phase,
        }
    }

    /// The same with sensing elements in the heads that follow them with the time constant `tau_s` \[s\], over 0, from
    /// equilibrium.
    pub(super) fn with_elements(self, tau_s: f64, chain: &Chain) -> Self {
        Self { element: Some(self.head.followed_by(tau_s, chain)), ..self }
    }

    /// Moves heads, boards and elements by `case_c` away from equilibrium, and the elements by another `element_c`
    /// \[degC\].
    pub(super) fn displace(&mut self, case_c: f64, element_c: f64) {
        for lag in [Some(&mut self.head), Some(&mut self.board), self.element.as_mut()].into_iter().flatten() {
            lag.temperature_c += case_c;
        }
        if let Some(element) = &mut self.element {
            element.temperature_c += element_c;
        }
    }

    /// Starts a ramp to `target_c` \[degC\] at `ramp_c_per_s` \[degC/s\], which must be over 0.
    pub fn go_to(&mut self, target_c: f64, ramp_c_per_s: f64) {
        (self.target_c, self.ramp_c_per_s) = (target_c, ramp_c_per_s);
    }

    /// Temperature of the air, without the oscillation \[degC\].
    #[must_use]
    pub const fn air_c(&self) -> f64 {
        self.air_c
    }

    /// Advances by `time_s` \[s\].
    pub fn wait(&mut self, mut time_s: f64) {
        self.time_s += time_s;
        let distance = self.target_c - self.air_c;
        if distance != 0.0 {
            let left_s = distance.abs() / self.ramp_c_per_s;
            let ramp_s = left_s.min(time_s);
            let rate = self.ramp_c_per_s.copysign(distance);
            let air_c = if left_s <= time_s { self.target_c } else { self.air_c + rate * time_s };
            self.advance(air_c, rate, ramp_s);
            time_s -= ramp_s;
        }
        if time_s > 0.0 {
            self.advance(self.air_c, 0.0, time_s);
        }
    }

    fn advance(&mut self, air_c: f64, rate: f64, time_s: f64) {
        if let Some(element) = &mut self.element {
            element.advance_behind(&self.head, self.air_c, air_c, rate, time_s);
        }
        for lag in [&mut self.head, &mut self.board] {
            lag.advance(self.air_c, air_c, rate, time_s);
        }
        self.air_c = air_c;
    }

    /// Temperatures of the heads and of the boards, without their own offsets \[degC\].
    #[must_use]
    pub fn head_and_board_c(&self) -> (f64, f64) {
        let phase = self.phase();
        (self.head.at(phase), self.board.at(phase))
    }

    /// Temperature of the sensing elements, without the offsets of their heads \[degC\].
    pub(super) fn element_c(&self) -> f64 {
        self.element.as_ref().unwrap_or(&self.head).at(self.phase())
    }

    /// Mean temperature of the elements above that of their heads over the `time_s` since they were at `begin_c`
    /// \[degC\].
    pub(super) fn mean_element_above_head_c(&self, begin_c: f64, time_s: f64) -> f64 {
        self.element.as_ref().map_or(0.0, |element| (begin_c - self.element_c()) * element.tau_s / time_s)
    }

    /// Phase of the oscillation of the air \[rad\].
    fn phase(&self) -> f64 {
        TAU * (self.time_s / self.period_s).fract() + self.phase
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chamber() -> SimulatedChamber {
        let mut chamber = SimulatedChamber::with_phase(&Chain::default(), 20.0, 1.0);
        chamber.go_to(30.0, 1.0 / 60.0);
        chamber
    }

    #[test]
    fn the_step_length_does_not_matter() {
        let (mut one, mut many) = (chamber(), chamber());
        for seconds in [130.0, 470.0, 61.0, 4000.0] {
            one.wait(seconds);
            (0..10 * seconds as u32).for_each(|_| many.wait(0.1));
            let ((a, b), (c, d)) = (one.head_and_board_c(), many.head_and_board_c());
            assert!((a - c).abs() < 1e-9 && (b - d).abs() < 1e-9, "{a} {c}, {b} {d}");
        }
        assert_eq!(one.air_c(), 30.0);
    }

    #[test]
    fn heads_and_boards_obey_their_differential_equation() {
        let chain = Chain::default();
        let mut chamber = chamber();
        let (step, mut head, mut board) = (0.05, chamber.head_and_board_c().0, chamber.head_and_board_c().1);
        for count in 0..20_000 {
            // Euler's method, with the air temperature of the middle of the step.
            let middle = f64::from(count) * step + step / 2.0;
            let air = (20.0 + middle / 60.0).min(30.0)
                + chain.oscillation_c * libm::sin(TAU * middle / chain.oscillation_s + 1.0);
            head += (air - head) * step / chain.head_lag_s;
            board += (air - board) * step / chain.board_lag_s;
            chamber.wait(step);
        }
        let (exact_head, exact_board) = chamber.head_and_board_c();
        assert!((head - exact_head).abs() < 1e-3 && (board - exact_board).abs() < 1e-3);
        assert!(exact_head - exact_board > 0.5, "the board is slower");
    }

    /// Elements that are faster than their heads, as fast, almost as fast, and slower.
    #[test]
    fn elements_obey_their_differential_equation() {
        let chain = Chain::default();
        for lag_s in [2.0, 299.999, 300.0, 900.0] {
            let mut chamber = chamber().with_elements(lag_s, &chain);
            chamber.displace(3.0, -2.0);
            let mut many = chamber.clone();
            let (step_s, begin) = (0.05, chamber.element_c());
            assert!((begin - chamber.head_and_board_c().0 + 2.0).abs() < 0.1, "of the oscillation");
            let (mut element, mut sum) = (begin, 0.0);
            for _ in 0..20_000 {
                // Euler's method, with the head in the middle of the step.
                many.wait(step_s / 2.0);
                let head = many.head_and_board_c().0;
                many.wait(step_s / 2.0);
                let change = (head - element) * step_s / lag_s;
                sum += (element + change / 2.0 - head) * step_s;
                element += change;
            }
            // The end of the chamber's ramp is in it.
            chamber.wait(1000.0);
            assert!((chamber.element_c() - element).abs() < 2e-4, "{lag_s}: {} {element}", chamber.element_c());
            assert!((chamber.element_c() - many.element_c()).abs() < 1e-9, "{lag_s}: the step length matters");
            let mean = chamber.mean_element_above_head_c(begin, 1000.0);
            assert!((mean - sum / 1000.0).abs() < 2e-4, "{lag_s}: {mean} {}", sum / 1000.0);
        }
    }
}
