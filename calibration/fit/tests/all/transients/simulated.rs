//! Simulated IMUs with a lag or with hysteresis, on the ramps of one afternoon.

use isotherm_fit::{BiasTransient, CurveSource, LagChoice, RampRecording, TransientOptions, Transients, fit};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_simulation::{Chain, Noise, Play, RampSchedule, RandomGenerator, RunSchedule, Truth, ramp};

const PAPER: &str = include_str!("../../../../../examples/tables/imu-paper.toml");

/// Time constant of the usual case \[s\], and its transients \[ug0/V\].
pub(crate) const TAU_S: f64 = 240.0;
pub(crate) const TRANSIENTS: [f64; AXES] = [35.0, -20.0, 12.0];

/// The paper's accelerometers with a lag.
pub(crate) fn truth(tau_s: f64, transients: [f64; AXES], plays: Vec<Play>) -> Truth {
    let mut content = CoefficientTable::from_toml(PAPER, None).unwrap().content().clone();
    content.lag_s = Some(tau_s);
    content.format = content.least_format();
    for (axis, transient) in content.axes.iter_mut().zip(transients) {
        axis.transient = transient * 1e-6 / axis.bias_unit.factor();
    }
    Truth { plays, ..Truth::of(CoefficientTable::new(content).unwrap()) }
}

/// White noise of 2 ug0 in 10 s, a walk of the biases of 0.2 ug0 in an hour, 0.1 mV of temperature.
pub(crate) fn quiet() -> Noise {
    Noise { sensor_g0: 2e-6 * 10.0_f64.sqrt(), temperature: 1e-4, bias_walk: 0.2e-6, ..Noise::NONE }
}

/// Half an hour at -25 degC, up to 45, half an hour, down, half an hour, in rows of 10 s with A3 up.
pub(crate) fn schedule(rate_c_h: f64, noise: Noise) -> RampSchedule {
    let chain = Chain { telemetry_lsb_micro: 10, ..Chain::default() };
    let run = RunSchedule { ramp_c_per_s: rate_c_h / 3600.0, noise, chain, ..RampSchedule::default().run };
    RampSchedule { run, ..RampSchedule::default() }
}

/// An afternoon: 20 and 70 K/h.
pub(crate) fn afternoon(noise: Noise) -> Vec<RampSchedule> {
    [20.0, 70.0].map(|rate| schedule(rate, noise)).to_vec()
}

/// Recordings of the rows that `keep` keeps.
pub(crate) fn recorded_with(
    truth: &Truth,
    schedules: &[RampSchedule],
    seed: u64,
    keep: impl Fn(&RawSample) -> bool,
) -> Vec<RampRecording> {
    let record = |(number, schedule): (u64, &RampSchedule)| {
        let mut recording = RampRecording::new(format!("ramp-{number}"));
        for raw in ramp(truth, schedule, seed + 1000 * number).filter(|raw| keep(raw)) {
            recording.add(&raw).unwrap();
        }
        recording
    };
    (1..).zip(schedules).map(record).collect()
}

pub(crate) fn recorded(truth: &Truth, schedules: &[RampSchedule], seed: u64) -> Vec<RampRecording> {
    recorded_with(truth, schedules, seed, |_| true)
}

/// The fit next to a campaign whose static curves are exact.
pub(crate) fn fitted(truth: &Truth, recordings: &[RampRecording], lag: LagChoice) -> Transients {
    let options = TransientOptions { curves: CurveSource::Campaign, lag, predecessor_s: None };
    fit(recordings, &truth.table, &options).unwrap()
}

/// t tau of a bias \[ug0 s/V\].
pub(crate) fn transient_tau(found: &Transients, bias: &BiasTransient) -> f64 {
    bias.estimate * 1e6 * found.time_constant.value_s
}

/// A number between `low` and `high`, uniform in its logarithm, with either sign.
pub(crate) fn drawn(random: &mut RandomGenerator, low: f64, high: f64) -> f64 {
    let size = low * libm::pow(high / low, random.uniform());
    if random.uniform() < 0.5 { -size } else { size }
}
