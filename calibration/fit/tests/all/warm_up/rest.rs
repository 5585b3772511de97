//! What is in a log in addition to a warm-up at rest: flights, carrying, bumps, and thermometers that stand still.

use super::bad_rows::seed;
use super::curves::{Course, Setting, WarmUp};
use isotherm_fit::{CalibrationError, LeftOutCause, WarmUpCalibration, WarmUpOptions};
use isotherm_shared::wire::AXES;
use isotherm_simulation::RandomGenerator;
use isotherm_support::finding::name;

/// Seconds of a row, and of what is in the rows from here on.
type Span = std::ops::Range<f64>;

/// A flight: vibration, and attitudes of some tens of degrees.
fn fly(log: &mut WarmUp, span: &Span, random: &mut RandomGenerator) {
    let phases: [f64; 6] = core::array::from_fn(|_| random.between(0.0, 6.0));
    let vibration = random.between(0.5, 4.0);
    for row in log.rows.iter_mut().filter(|row| span.contains(&row.seconds)) {
        for (sensor, (value, phase)) in row.sensors.iter_mut().zip(phases).enumerate() {
            let sway = libm::sin(row.seconds / (3.0 + sensor as f64) + phase);
            let (size, noise) = if sensor < AXES { (2.0, vibration) } else { (0.5, 0.1) };
            *value += size * sway + noise * random.normal();
        }
    }
}

/// Carried by hand: slow, without vibration.
fn carry(log: &mut WarmUp, span: &Span, random: &mut RandomGenerator) {
    let phases: [f64; 6] = core::array::from_fn(|_| random.between(0.0, 6.0));
    for row in log.rows.iter_mut().filter(|row| span.contains(&row.seconds)) {
        for (sensor, (value, phase)) in row.sensors.iter_mut().zip(phases).enumerate() {
            let sway = libm::sin(row.seconds / (1.5 + 0.3 * sensor as f64) + phase);
            let (size, noise) = if sensor < AXES { (1.5, 0.1) } else { (0.3, 0.02) };
            *value += size * sway + noise * random.normal();
        }
    }
}

/// Another attitude from here on, by this angle.
fn turn(log: &mut WarmUp, from_s: f64, degrees: f64, random: &mut RandomGenerator) {
    let angle = degrees.to_radians();
    let heading = random.between(0.0, core::f64::consts::TAU);
    let change = [
        libm::sin(angle) * libm::cos(heading) * 9.8,
        libm::sin(angle) * libm::sin(heading) * 9.8,
        9.8 * (1.0 - libm::cos(angle)),
    ];
    for row in log.rows.iter_mut().filter(|row| row.seconds >= from_s) {
        (0..AXES).for_each(|axis| row.sensors[axis] += change[axis]);
    }
}

fn worst(log: &WarmUp, found: &WarmUpCalibration) -> f64 {
    log.errors(found).into_iter().fold(0.0, f64::max)
}

fn names(found: &WarmUpCalibration) -> Vec<&'static str> {
    found.ramps.findings.iter().map(|finding| finding.name).collect()
}

fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// A setting in which a motion can be in the middle.
fn setting(random: &mut RandomGenerator) -> Setting {
    let mut setting = Setting::drawn(random, 20_000.0);
    setting.minutes = random.between(25.0, 60.0).min(20_000.0 / setting.rate / 60.0);
    setting.coarse = setting.coarse.min(1.0);
    setting.range[1] = setting.range[1].max(setting.range[0] + 30.0);
    setting
}

/// The curves of a log with a motion, of order 2.
fn curves(log: &WarmUp) -> Result<WarmUpCalibration, CalibrationError> {
    log.calibrated_with(WarmUpOptions { order: Some(2), ..WarmUpOptions::default() }, Vec::new())
}

/// Logs with a motion at a drawn place: the largest error of a curve, over that of the same log at rest.
fn motions(what: &str, count: u64, spoil: impl Fn(&mut WarmUp, &Span, &mut RandomGenerator)) {
    let seed = seed();
    let (mut ratios, mut silent, mut refused) = (Vec::new(), 0, 0);
    let mut i = 0;
    while ratios.len() + refused < count as usize {
        i += 1;
        let mut random = RandomGenerator::new(seed * 1000 + i, 8);
        let setting = setting(&mut random);
        if setting.minutes < 15.0 {
            continue;
        }
        let clean = WarmUp::new(&setting, seed * 1000 + i);
        let seconds = setting.minutes * 60.0;
        let begin_s = seconds * random.between(0.3, 0.6);
        let span = begin_s..begin_s + random.between(20.0, 0.2 * seconds);
        let mut log = clean.clone();
        spoil(&mut log, &span, &mut random);
        let Ok(of_clean) = curves(&clean) else { continue };
        match curves(&log) {
            Ok(found) => {
                let ratio = worst(&log, &found) / worst(&clean, &of_clean);
                let is_named = names(&found).contains(&name::MOTION);
                if ratio > 4.0 || !is_named {
                    println!("log {i}: {ratio:.2}, {span:?}, {:?} {setting:?}", found.rows[0].used_s);
                }
                silent += usize::from(!is_named);
                ratios.push(ratio);
            }
            Err(error) => {
                println!("log {i}: {error} {setting:?}");
                refused += 1;
            }
        }
    }
    let most = ratios.iter().copied().fold(0.0, f64::max);
    let far = ratios.iter().filter(|ratio| **ratio > 4.0).count();
    println!(
        "{what}: {count} logs, error over that of the log at rest: median {:.2}, most {most:.2}, {far} over 4; {silent} not named; {refused} refused",
        median(ratios.clone())
    );
    let few = count as usize / 50;
    assert!(median(ratios) < 1.5 && far <= few && silent <= few && refused <= few);
}

fn flights(count: u64) {
    motions("flights", count, |log, span, random| {
        fly(log, span, random);
        turn(log, span.end, random.between(0.0, 3.0), random);
    });
}

fn carryings(count: u64) {
    motions("carried", count, |log, span, random| {
        carry(log, span, random);
        turn(log, span.end, random.between(0.0, 20.0), random);
    });
}

fn bumps(count: u64) {
    motions("bumps of 0.5 degrees", count, |log, span, random| turn(log, span.start, 0.5, random));
}

#[test]
fn motions_are_left_out() {
    flights(8);
    carryings(8);
    bumps(8);
}

#[test]
#[ignore = "minutes; .ci/nightly"]
fn motions_of_every_kind_are_left_out() {
    flights(100);
    carryings(100);
    bumps(100);
}

#[test]
fn times_in_which_the_vehicle_was_armed_are_left_out() {
    let log = WarmUp::new(&Setting { minutes: 60.0, ..Setting::usual() }, 4);
    let armed = 1_000_000_000_000..1_300_000_000_000;
    let found = log.calibrated_with(WarmUpOptions::default(), core::iter::once(armed).collect()).unwrap();
    let account = &found.rows[0];
    assert_eq!(account.left_out[0].cause, LeftOutCause::InUse);
    assert_eq!(account.used_s, [[0.0, 999.0], [1299.0, 3600.0]]);
    assert!(names(&found).contains(&name::MOTION) && !names(&found).contains(&name::MISSING_ROWS));
    // Armed throughout.
    let always = core::iter::once(0..u64::MAX).collect();
    let refused = log.calibrated_with(WarmUpOptions::default(), always);
    let Err(CalibrationError::Faults { findings, .. }) = refused else { panic!("a table") };
    assert_eq!(findings[0].name, name::MOTION);
    assert!(findings[0].message.contains("the vehicle was armed or flew"), "{}", findings[0].message);
}

#[test]
fn a_log_that_never_rests_is_refused() {
    let mut random = RandomGenerator::new(3, 9);
    for rate in [1.0, 50.0] {
        let mut log = WarmUp::new(&Setting { rate, minutes: 10.0, ..Setting::usual() }, 4);
        fly(&mut log, &(0.0..1e9), &mut random);
        let Err(CalibrationError::Faults { findings, .. }) = log.calibrated() else { panic!("a table") };
        assert_eq!(findings[0].name, name::MOTION, "{}", findings[0].message);
    }
}

/// Clean logs of every kind: nothing is left out.
fn clean_logs(count: u64) {
    let seed = seed();
    let mut wrong = 0;
    for i in 0..count {
        let mut random = RandomGenerator::new(seed * 1000 + i, 10);
        let setting = Setting::drawn(&mut random, 20_000.0);
        let log = WarmUp::new(&setting, seed * 1000 + i);
        let found = log.calibrated_with(WarmUpOptions { order: Some(0), ..Default::default() }, Vec::new());
        let Ok(found) = found else {
            println!("log {i}: {} {setting:?}", found.unwrap_err());
            continue;
        };
        let account = &found.rows[0];
        if !account.left_out.is_empty() || account.used_s.len() > 1 {
            println!("log {i}: {} {:?} {setting:?}", account.left_out_words(), account.bumps);
            wrong += 1;
        }
    }
    println!("{count} clean logs: something is left out of {wrong}");
    assert!(wrong as f64 <= 0.01 * count as f64);
}

#[test]
fn nothing_is_left_out_of_clean_logs() {
    clean_logs(40);
}

#[test]
#[ignore = "minutes; .ci/nightly"]
fn nothing_is_left_out_of_clean_logs_of_every_kind() {
    clean_logs(400);
}

/// A thermometer that stands still from a drawn time on, to the end or for a while.
fn stuck_thermometers(count: u64) {
    let seed = seed();
    let (mut found_it, mut all) = (0, 0);
    let mut ratios = Vec::new();
    for i in 0..count {
        let mut random = RandomGenerator::new(seed * 1000 + i, 11);
        let step = [0.0, 0.01, 0.1, 1.0][(random.uniform() * 4.0) as usize];
        let course = if random.uniform() < 0.5 { Course::Linear } else { Course::Exponential(0.4) };
        let setting = Setting { minutes: 40.0, thermometer: [step, 0.02], course, ..Setting::usual() };
        let clean = WarmUp::new(&setting, seed * 1000 + i);
        let mut log = clean.clone();
        let n = log.rows.len();
        let first = (n as f64 * random.between(0.3, 0.6)) as usize;
        let last = if random.uniform() < 0.5 { n } else { first + n / 5 };
        let value = log.rows[first].celsius;
        log.rows[first..last].iter_mut().for_each(|row| row.celsius = value);
        let options = || WarmUpOptions { order: Some(3), ..Default::default() };
        let found = log.calibrated_with(options(), Vec::new()).unwrap();
        let is_found = names(&found).contains(&name::TEMPERATURE_STUCK);
        all += 1;
        found_it += usize::from(is_found);
        let [low, high] = found.biases[0].curve.range();
        let error = (0..6)
            .map(|sensor| {
                let factor = if sensor < AXES { 9.80665 } else { core::f64::consts::PI / 180.0 / 3600.0 };
                let place = |k: i32| low + (high - low) * f64::from(k) / 40.0;
                let all: Vec<f64> = (2..=38)
                    .map(|k| found.biases[sensor].curve.at(place(k)) * factor - log.truth(sensor, place(k)))
                    .collect();
                let mean = all.iter().sum::<f64>() / all.len() as f64;
                (all.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
                    / setting.noise[sensor / AXES]
            })
            .fold(0.0, f64::max);
        if !is_found || error > 0.4 {
            println!(
                "log {i}: {is_found} {error:.2} {first} {last} {value} {:?} {:?}",
                found.rows[0].left_out, setting.thermometer
            );
        }
        ratios.push(error);
    }
    println!(
        "{found_it} of {all} stuck thermometers are found; the largest error of a curve is {:.2} of a row's noise",
        ratios.iter().copied().fold(0.0, f64::max)
    );
    assert!(found_it == all && ratios.iter().all(|error| *error < 1.0));
}

#[test]
fn a_thermometer_that_stands_still_is_named() {
    stuck_thermometers(24);
}
