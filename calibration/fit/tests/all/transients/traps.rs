//! What misleads an estimator of lags, each trap with its right answer.

use super::simulated::*;
use isotherm_fit::{CurveSource, LagChoice, RampRecording, TransientOptions, TransientVerdict, Transients, fit};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::AXES;
use isotherm_simulation::{Noise, Play, RampSchedule, Truth, ramp};
use isotherm_statistics::band;

fn moving() -> Truth {
    truth(TAU_S, TRANSIENTS, Vec::new())
}

fn search(truth: &Truth, schedules: &[RampSchedule]) -> Transients {
    fitted(truth, &recorded(truth, schedules, 11), LagChoice::Search)
}

/// t tau of every axis is within `part` of the truth; that of A3, whose transient is small and whose scale factor
/// counts too, within twice that.
fn assert_found(found: &Transients, part: f64, what: &str) {
    for (bias, right) in found.biases.iter().zip(TRANSIENTS) {
        let part = if bias.axis == 2 { 2.0 * part } else { part };
        let ratio = transient_tau(found, bias) / (right * TAU_S);
        println!(
            "{what}: {} t tau {ratio:.3} of the truth, time constant {:.0} s",
            bias.name(),
            found.time_constant.value_s
        );
        assert!(bias.transient != 0.0, "{what}: {:?}", found.words);
        assert!((ratio - 1.0).abs() < part, "{what}: {} {ratio}", bias.name());
    }
}

fn assert_refused(found: &Transients, what: &str) {
    println!("{what}: {:?}", found.words);
    assert!(found.biases.iter().all(|bias| bias.transient == 0.0), "{what}");
    assert_ne!(found.verdict, TransientVerdict::Lag);
    assert!(found.words[0].contains("no transient is written"), "{:?}", found.words);
    assert!(found.words.len() > 1, "the reasons are named");
}

#[test]
fn the_start_need_not_be_soaked() {
    for (case, element) in [(8.0, 0.0), (0.0, 8.0), (-8.0, 4.0)] {
        let mut schedules = afternoon(quiet());
        schedules.iter_mut().for_each(|s| (s.case_offset_c, s.element_offset_c) = (case, element));
        let found = search(&moving(), &schedules);
        assert_found(&found, 0.2, "start");
        let [low, high] = found.time_constant.interval_s;
        assert!((low..=high).contains(&TAU_S), "{low} .. {high} s");
        // The curves begin at -25 degC. What is colder is in no fit, and that is said.
        let outside = found.warnings.iter().any(|warning| warning.contains("% of the ramps are left out"));
        assert_eq!(outside, case < 0.0, "{:?}", found.warnings);
    }
}

#[test]
fn temperature_may_be_rare_and_coarse() {
    let mut schedules = afternoon(quiet());
    for schedule in &mut schedules {
        (schedule.run.chain.temperature_s, schedule.run.chain.telemetry_lsb_micro) = (30.0, 2400);
    }
    assert_found(&search(&moving(), &schedules), 0.2, "every 30 s in steps of 2.4 mV");
    // Without its time only a change shows that the temperature was read.
    let truth = moving();
    let mut recordings = Vec::new();
    for (schedule, seed) in schedules.iter().zip([1, 2]) {
        let mut recording = RampRecording::new("untimed");
        for raw in ramp(&truth, schedule, seed) {
            recording.add(&isotherm_shared::wire::RawSample { telemetry_ns: 0, ..raw }).unwrap();
        }
        recordings.push(recording);
    }
    let found = fitted(&truth, &recordings, LagChoice::Search);
    for (bias, right) in found.biases.iter().zip(TRANSIENTS).take(2) {
        let ratio = transient_tau(&found, bias) / (right * TAU_S);
        assert!(bias.transient != 0.0 && (ratio - 1.0).abs() < 0.2, "{ratio} {:?}", found.words);
    }
}

#[test]
fn samples_may_come_at_400_hz() {
    let mut fast = schedule(140.0, quiet());
    (fast.run.interval_ns, fast.run.chain.temperature_s, fast.run.hold_s) = (2_500_000, 1.0, 900.0);
    assert_found(&search(&moving(), &[fast]), 0.2, "400 Hz");
}

/// A reading is of the end of its row, and the pulses are of the whole row.
#[test]
fn the_time_of_the_temperature_does_not_shift_the_time_constant() {
    let found = search(&moving(), &afternoon(Noise { bias_walk: 0.0, ..quiet() }));
    assert_found(&found, 0.1, "10 s rows");
    let exact = search(&moving(), &afternoon(Noise { sensor_g0: 1e-8, temperature: 1e-6, ..Noise::NONE }));
    let ratio = exact.time_constant.value_s / TAU_S;
    assert!((ratio - 1.0).abs() < 0.03, "{ratio}");
    assert_found(&exact, 0.03, "without noise");
}

#[test]
fn gaps_do_not_stop_the_filter() {
    for (lost, of) in [(3, 100), (7, 100)] {
        // Some stretches of 100 to 233 rows of ten seconds.
        let stretch = of * 3333 / 100 / 10;
        let keep = move |raw: &isotherm_shared::wire::RawSample| raw.sequence % stretch >= stretch * lost / of;
        let truth = moving();
        let recordings = recorded_with(&truth, &afternoon(quiet()), 3, keep);
        assert_found(&fitted(&truth, &recordings, LagChoice::Search), 0.2, "gaps");
    }
}

#[test]
fn a_lag_that_the_ramps_do_not_resolve_is_not_written() {
    let mut rare = afternoon(quiet());
    rare.iter_mut().for_each(|schedule| schedule.run.chain.temperature_s = 60.0);
    assert_refused(&search(&truth(8.0, [300.0, -200.0, 100.0], Vec::new()), &rare), "8 s, temperature every 60 s");
    assert_refused(&search(&moving(), &[schedule(4.0, quiet())]), "4 K/h");
}

#[test]
fn drifts_are_no_lag() {
    let still = truth(TAU_S, [0.0; AXES], Vec::new());
    let mut drifting = afternoon(quiet());
    drifting.iter_mut().for_each(|schedule| schedule.tilt_drift_rad = [5e-5, -5e-5]);
    assert_refused(&search(&still, &drifting), "tilt");
    for walk in [1e-6, 5e-6] {
        assert_refused(&search(&still, &afternoon(Noise { bias_walk: walk, ..quiet() })), "bias walk");
    }
    assert_refused(&search(&still, &afternoon(quiet())), "no lag");
}

#[test]
fn one_direction_or_noise_alone_show_nothing() {
    // The largest effect is 35 ug0/V of 0.19 V; white noise of 50 times as much in a block of 40 s.
    let noisy = Noise { sensor_g0: 50.0 * 6.5e-6 * 40.0_f64.sqrt(), ..quiet() };
    assert_refused(&search(&moving(), &afternoon(noisy)), "noise");
    let mut heating = afternoon(quiet());
    heating.iter_mut().for_each(|schedule| schedule.run.legs = 1);
    let found = search(&moving(), &heating);
    assert_refused(&found, "heating only");
    assert!(found.words.iter().any(|words| words.contains("heat and cool in one recording")), "{:?}", found.words);
    let mut cooling = heating[0];
    (cooling.run.from_c, cooling.run.to_c) = (cooling.run.to_c, cooling.run.from_c);
    assert_refused(&search(&moving(), &[heating[0], cooling]), "two files");
    // Not with a given time constant either.
    let found = fitted(&moving(), &recorded(&moving(), &heating, 1), LagChoice::Given(TAU_S));
    assert!(found.biases.iter().all(|bias| bias.transient == 0.0));
}

#[test]
fn a_play_is_no_lag() {
    for part in [0.01, 0.03, 0.1, 0.3] {
        let half_width = part * 2.8;
        let accelerometers = [8e-6, -5e-6, 3e-6].map(|size| size / half_width);
        let still = truth(TAU_S, [0.0; AXES], vec![Play { half_width, accelerometers, gyroscopes: [0.0; AXES] }]);
        let mut without_holds = afternoon(quiet());
        without_holds.iter_mut().for_each(|schedule| schedule.run.hold_s = 0.0);
        let one_rate = [schedule(40.0, quiet())];
        for (schedules, what) in
            [(&one_rate[..], "one rate"), (&afternoon(quiet()), "two rates"), (&without_holds, "no holds")]
        {
            let found = search(&still, schedules);
            assert_refused(&found, what);
            let named = found.words.iter().any(|words| words.contains("hysteresis"));
            assert!(named, "{what}, play of {part}: {:?}", found.words);
        }
    }
}

#[test]
fn lag_and_play_are_told_apart() {
    let half_width = 0.1 * 2.8;
    let play = Play { half_width, accelerometers: [3e-6 / half_width, 0.0, 0.0], gyroscopes: [0.0; AXES] };
    let found = search(&truth(TAU_S, TRANSIENTS, vec![play]), &afternoon(quiet()));
    assert_found(&found, 0.2, "lag and play");
    // Twice the half width of the play separates heating and cooling.
    let left = band(&found.biases[0].after).unwrap() * 1e6;
    assert!((3.0..7.0).contains(&left), "{left}");
    assert!(band(&found.biases[1].after).unwrap() * 1e6 < 1.5);
}

#[test]
fn an_axis_without_a_transient_gets_none() {
    for axis in 0..AXES {
        let mut transients = TRANSIENTS;
        transients[axis] = 0.0;
        let found = search(&truth(TAU_S, transients, Vec::new()), &afternoon(quiet()));
        for bias in &found.biases {
            assert_eq!(bias.transient == 0.0, bias.axis == axis, "{} {:?}", bias.name(), found.words);
        }
    }
}

#[test]
fn a_wrong_static_curve_does_not_change_the_transient() {
    let truth = moving();
    let recordings = recorded(&truth, &afternoon(quiet()), 5);
    let mut content = truth.table.content().clone();
    for axis in &mut content.axes {
        let mut coefficients = axis.bias.coefficients().to_vec();
        let factor = axis.bias_unit.factor();
        coefficients.iter_mut().zip([50e-6, -30e-6, 20e-6, 5e-6]).for_each(|(c, wrong)| *c += wrong / factor);
        axis.bias = Polynomial::new(&coefficients, axis.bias.center(), axis.bias.scale(), axis.bias.range()).unwrap();
    }
    let wrong = CoefficientTable::new(content).unwrap();
    let options = TransientOptions { curves: CurveSource::Campaign, lag: LagChoice::Search, predecessor_s: None };
    let [right, found] = [&truth.table, &wrong].map(|table| fit(&recordings, table, &options).unwrap());
    let ratio = found.time_constant.value_s / right.time_constant.value_s;
    assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
    for (bias, right) in found.biases.iter().zip(&right.biases) {
        assert!((bias.estimate / right.estimate - 1.0).abs() < 1e-3, "{} {}", bias.estimate, right.estimate);
    }
}

#[test]
fn a_given_time_constant_that_the_ramps_contradict_is_warned_of() {
    let warned = |found: &Transients, words: &str| found.warnings.iter().any(|warning| warning.contains(words));
    let recordings = recorded(&moving(), &afternoon(quiet()), 7);
    let found = fitted(&moving(), &recordings, LagChoice::Given(TAU_S));
    assert_eq!(found.verdict, TransientVerdict::Given, "{:?}", found.words);
    assert!(!warned(&found, "but the ramps show") && !warned(&found, "hysteresis predicts"), "{:?}", found.warnings);
    let found = fitted(&moving(), &recordings, LagChoice::Given(1000.0));
    assert!(warned(&found, "the time constant given is 1000 s, but the ramps show"), "{:?}", found.warnings);
    // A play is no lag: written as asked for, but not without a word.
    let half_width = 0.1 * 2.8;
    let play =
        Play { half_width, accelerometers: [40e-6, -30e-6, 20e-6].map(|it| it / half_width), gyroscopes: [0.0; AXES] };
    let still = truth(TAU_S, [0.0; AXES], vec![play]);
    let found = fitted(&still, &recorded(&still, &afternoon(quiet()), 7), LagChoice::Given(TAU_S));
    let written = found.biases.iter().any(|bias| bias.transient != 0.0);
    assert_eq!(warned(&found, "hysteresis predicts the sweeps left out better"), written, "{:?}", found.warnings);
    println!("play with a time constant given: {:?}", found.words);
    // Longer than the recordings.
    let options =
        TransientOptions { curves: CurveSource::Campaign, lag: LagChoice::Given(86_400.0), predecessor_s: None };
    let message = fit(&recordings, &moving().table, &options).unwrap_err().to_string();
    assert!(message.contains("86400 s is too long"), "{message}");
}

#[test]
fn broken_readings_are_refused_and_gaps_are_named() {
    let truth = moving();
    let options = TransientOptions { curves: CurveSource::Campaign, lag: LagChoice::Search, predecessor_s: None };
    let schedule = schedule(20.0, quiet());
    let mut recording = RampRecording::new("spike");
    for (row, mut raw) in ramp(&truth, &schedule, 1).enumerate() {
        if row == 700 {
            raw.accelerometers.head_temperature[1] = 4.6;
        }
        recording.add(&raw).unwrap();
    }
    let message = fit(&[recording], &truth.table, &options).unwrap_err().to_string();
    assert!(
        message.starts_with("spike: the head temperature of A2 is 4.6 at ") && message.contains("leave its rows out"),
        "{message}"
    );
    let found = |gap: core::ops::Range<u64>| {
        let recordings = recorded_with(&truth, &[schedule], 1, |raw| !gap.contains(&raw.sequence));
        fit(&recordings, &truth.table, &options).unwrap().warnings.concat()
    };
    assert!(found(1000..1400).contains("ramp-1: no rows for 4000 s, 10000 s after its begin"), "{}", found(1000..1400));
    assert!(!found(1000..1005).contains("no rows"));
}
