//! The hysteresis band of runs whose lag is known.

use isotherm_report as report;
use isotherm_report::verification::VerificationSource;
use isotherm_shared::lag::Lag;
use isotherm_shared::table::*;
use isotherm_shared::wire::*;
use isotherm_simulation::{Chain, Noise, RampSchedule, RunSchedule, Truth, ramp, typical_gyroscopes};
use isotherm_verification::{Collector, LocalGravity, LoopBand, Setup, Stability};

const TAU_S: f64 = 240.0;
/// Transients of the accelerometers \[ug0/V\] and of the gyroscopes \[deg/h/V\].
const TRANSIENTS: [[f64; AXES]; 2] = [[350.0, -200.0, 0.0], [40.0, 0.0, -20.0]];

/// The paper's IMU with gyroscopes, and with a lag if it has a time constant.
fn truth(lag_s: Option<f64>) -> Truth {
    let table = CoefficientTable::from_toml(include_str!("../../../../examples/tables/imu-paper.toml"), None);
    let mut content = table.unwrap().content().clone();
    let mut gyroscopes = typical_gyroscopes(&Chain::default()).unwrap();
    content.format = 2;
    content.lag_s = lag_s;
    if lag_s.is_some() {
        let [of_accelerometers, of_gyroscopes] = TRANSIENTS;
        for (axis, transient) in content.axes.iter_mut().zip(of_accelerometers) {
            axis.transient = transient * 1e-6 / axis.bias_unit.factor();
        }
        for (axis, transient) in gyroscopes.axes.iter_mut().zip(of_gyroscopes) {
            axis.transient = transient;
        }
    }
    content.gyroscopes = Some(gyroscopes);
    Truth::of(CoefficientTable::new(content).unwrap())
}

/// -25 to 45 degC at 40 degC/h and back, in rows of 1 s: in longer ones temperature that is read at their end is late
/// for the 7600 ppm/V of A3's K+.
fn schedule(legs: u32) -> RampSchedule {
    let noise = Noise { sensor_g0: 5e-6, temperature: 1e-4, random_walk: 0.003, ..Noise::NONE };
    let chain = Chain { telemetry_lsb_micro: 10, ..Chain::default() };
    let run = RunSchedule {
        ramp_c_per_s: 40.0 / 3600.0,
        interval_ns: 1_000_000_000,
        legs,
        noise,
        chain,
        ..RampSchedule::default().run
    };
    RampSchedule { run, ..RampSchedule::default() }
}

/// The samples of the IMU with the lagged temperature that an acquisition with this time constant fills in.
fn samples(schedule: &RampSchedule, lag_ns: u64) -> Vec<RawSample> {
    let mut lag = Lag::new(lag_ns);
    let filled = |mut raw: RawSample| {
        lag.follow(&raw);
        lag.fill(&mut raw);
        raw
    };
    ramp(&truth(Some(TAU_S)), schedule, 3).map(filled).collect()
}

fn verified(table: &CoefficientTable, samples: &[RawSample]) -> Stability {
    let mut collector = Collector::new(table, 10.0);
    samples.iter().for_each(|raw| collector.add(raw));
    collector.finish(&Setup::new(Some([0.0, 0.0, 1.0]), LocalGravity::Stated(table.content().gravity))).unwrap()
}

fn page(table: &CoefficientTable, found: &Stability) -> String {
    let (tool, time, name, recording) = Default::default();
    let source = VerificationSource { tool, time, table: name, recording, window_s: 10.0, required: None };
    report::verification::html(table, found, &source)
}

#[test]
fn the_true_lag_closes_the_loop() {
    let table = truth(Some(TAU_S)).table;
    let found = verified(&table, &samples(&schedule(2), table.lag_ns()));
    let gyroscopes = found.judged_gyroscopes().unwrap();
    // d is tau dU/dt = 240 s * 0.04 V/K * 40 K/h, and heating less cooling is 2 t d, but for turns and holds.
    let expected = 2.0 * 240.0 * 0.04 * 40.0 / 3600.0;
    for (loops, transients, noise) in
        [(&found.loops, TRANSIENTS[0].map(|t| t * 1e-6), 1.5e-6), (&gyroscopes.loops, TRANSIENTS[1], 0.05)]
    {
        for (axis, transient) in transients.into_iter().enumerate() {
            let LoopBand { static_model, full, bins } = loops.band(axis).unwrap();
            let (static_model, right) = (static_model.unwrap(), (transient * expected).abs());
            println!("{axis}: {static_model} -> {full}, {right} by the slope, {bins} bins");
            assert!(full < noise && bins >= 11, "{full} {bins}");
            assert!((static_model - right).abs() < 0.15 * right + noise, "{static_model} {right}");
            assert!(right == 0.0 || static_model > 10.0 * full, "{static_model} {full}");
        }
    }
    // The filter begins soaked with the recording.
    assert_eq!(found.unsettled_s, Some(3.0 * TAU_S));
    assert_eq!(found.loops.full[0].len(), found.windows.len() - 72);
    let text = report::text::stability(&found, 10.0, true);
    for words in [
        "Hysteresis band: error in heating less that in cooling, rms over the bins of temperature that have both [1e-6 g0]",
        "rms over the bins of temperature that have both [deg/h]",
        " of 12\n  static model: the table without its transients\n  the first 720 s are left out of it, 3 time constants",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let json = report::json::verification(&found, 10.0, None);
    let band = found.loops.band(0).unwrap();
    let part = &json["axes"][0]["hysteresis"];
    assert_eq!((part["static_g0"].as_f64(), part["full_g0"].as_f64()), (band.static_model, Some(band.full)));
    assert!(part["shared_bins"] == band.bins && part["not_judged"].is_null(), "{part}");
    assert_eq!(json["hysteresis_left_out_s"], 720.0);
    let band = gyroscopes.loops.band(2).unwrap();
    assert_eq!(json["gyroscopes"]["axes"][2]["hysteresis"]["static_deg_h"].as_f64(), band.static_model);
    let page = page(&table, &found);
    for words in [
        "A1 without transient: hysteresis band",
        "A1 with transient: hysteresis band",
        "G3 with transient",
        "The first 720 s",
    ] {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn a_wrong_time_constant_or_none_leaves_the_loop_open() {
    let right = truth(Some(TAU_S)).table;
    let open = verified(&right, &samples(&schedule(2), right.lag_ns())).loops.band(0).unwrap().static_model.unwrap();
    let mut content = right.content().clone();
    content.lag_s = Some(60.0);
    let wrong = CoefficientTable::new(content).unwrap();
    let found = verified(&wrong, &samples(&schedule(2), wrong.lag_ns()));
    let LoopBand { static_model, full, .. } = found.loops.band(0).unwrap();
    assert!(full > 0.6 * open && (static_model.unwrap() / open - 1.0).abs() < 0.05, "{full} {static_model:?} {open}");
    assert_eq!(found.unsettled_s, Some(180.0));
    // A table without a lag has one model.
    let none = truth(None).table;
    let found = verified(&none, &samples(&schedule(2), 0));
    let LoopBand { static_model, full, .. } = found.loops.band(0).unwrap();
    assert!(static_model.is_none() && (full / open - 1.0).abs() < 0.05, "{full} {open}");
    assert_eq!(found.unsettled_s, None);
    let text = report::text::stability(&found, 10.0, true);
    assert!(
        text.contains("  the table has no lag: there is one model only\n") && !text.contains("time constants"),
        "{text}"
    );
    let page = page(&none, &found);
    assert!(page.contains("A1 without transient: hysteresis band") && !page.contains("A1 with transient"));
    // Samples without lagged temperature have the static model's output, and the windows are flagged.
    let found = verified(&right, &samples(&schedule(2), 0));
    let LoopBand { static_model, full, .. } = found.loops.band(0).unwrap();
    assert_eq!(static_model, Some(full));
    assert!(found.windows.iter().all(|window| window.flagged));
}

#[test]
fn one_direction_is_not_judged_and_neither_is_one_temperature() {
    let table = truth(Some(TAU_S)).table;
    let heating = verified(&table, &samples(&schedule(1), table.lag_ns()));
    let mut steady = schedule(2);
    steady.run.to_c = steady.run.from_c + 0.5;
    let steady = verified(&table, &samples(&steady, table.lag_ns()));
    for (found, why) in [(heating, "only one direction"), (steady, "the temperature hardly changes")] {
        assert!((0..AXES).all(|axis| found.loops.band(axis) == Err(why)));
        let text = report::text::stability(&found, 10.0, true);
        assert_eq!(text.matches(&format!("  hysteresis band not judged: {why}\n")).count(), 2, "{text}");
        let part = &report::json::verification(&found, 10.0, None)["axes"][0]["hysteresis"];
        assert!(part["static_g0"].is_null() && part["full_g0"].is_null() && part["not_judged"] == why, "{part}");
        assert!(page(&table, &found).contains(&format!("not judged: {why}")));
    }
}

/// The reason must be the true one where the temperature changes, and what shows it is left out.
#[test]
fn what_is_left_out_is_no_steady_temperature() {
    let table = truth(Some(TAU_S)).table;
    // 11 minutes of heating by 7 degC, over 0.2 V, in a session of their own: 3 time constants are 12 minutes.
    let mut lag = Lag::new(table.lag_ns());
    let filled = |mut raw: RawSample| {
        lag.follow(&raw);
        lag.fill(&mut raw);
        raw
    };
    let heating: Vec<_> = samples(&schedule(1), 0)[3000..3660].iter().copied().map(filled).collect();
    let found = verified(&table, &heating);
    let heads = found.windows.iter().map(|window| window.head[0]);
    let (low, high) = heads.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), u| (low.min(u), high.max(u)));
    assert!(high - low > 0.2, "{low} {high}");
    let why = "the temperature hardly changes after the 3 time constants in which the lagged temperature settles";
    assert_eq!(found.loops.band(0), Err(why));
    // A run that warms only while the IMU is at another attitude, on its side.
    let mut moved = samples(&schedule(2), table.lag_ns());
    let third = moved.len() / 3;
    for raw in &mut moved[..third] {
        raw.accelerometers.positive_pulses.rotate_left(1);
        raw.accelerometers.negative_pulses.rotate_left(1);
    }
    let steady = moved[third].accelerometers;
    for raw in &mut moved[third..] {
        raw.accelerometers.head_temperature = steady.head_temperature;
        raw.accelerometers.head_lagged = steady.head_temperature;
    }
    let mut collector = Collector::new(&table, 10.0);
    moved.iter().for_each(|raw| collector.add(raw));
    let found = collector.finish(&Setup::new(None, LocalGravity::Unknown)).unwrap();
    assert!(found.windows_left_out.count() >= third / 10 - 1, "{}", found.windows_left_out);
    assert_eq!(found.loops.band(0), Err("the temperature hardly changes in the windows that are judged"));
}

/// An IMU that does not begin soaked: at the start of a recording its filter does, and later it does not matter any
/// more.
#[test]
fn the_start_counts_only_where_the_lag_was_kept() {
    let table = truth(Some(TAU_S)).table;
    let cold = RampSchedule { element_offset_c: -8.0, ..schedule(2) };
    let all = samples(&cold, table.lag_ns());
    let found = verified(&table, &all);
    assert_eq!(found.unsettled_s, Some(3.0 * TAU_S));
    let band = |found: &Stability| found.loops.band(0).unwrap().full;
    assert!(band(&found) < 3e-6, "{}", band(&found));
    // A recording that begins later has a lag that remembers.
    let later = verified(&table, &all[2000..]);
    assert!(later.unsettled_s.is_none() && later.loops.full[0].len() == later.windows.len());
    assert!(band(&later) < 1.5e-6, "{}", band(&later));
    // A new session begins soaked again, in the middle of the ramp.
    let again: Vec<_> = {
        let mut lag = Lag::new(table.lag_ns());
        let restarted = |mut raw: RawSample| {
            raw.session = 77;
            lag.follow(&raw);
            lag.fill(&mut raw);
            raw
        };
        all[..4000].iter().copied().chain(all[4000..].iter().copied().map(restarted)).collect()
    };
    let found = verified(&table, &again);
    assert_eq!(found.loops.full[0].len(), found.windows.len() - 2 * 72);
    assert!(band(&found) < 3e-6, "{}", band(&found));
}
