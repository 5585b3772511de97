//! Stability of simulated runs whose truth is known.

use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::*;
use isotherm_shared::wire::*;
use isotherm_simulation::{Chain, MISALIGNMENT, Noise, RunSchedule, Truth, run};
use isotherm_verification::{Collector, LocalGravity, Requirement, Setup, Stability, StabilityError, Window};

fn truth() -> Truth {
    let table = CoefficientTable::from_toml(include_str!("../../../../examples/tables/imu-paper.toml"), None);
    Truth::new(table.unwrap().content().clone(), MISALIGNMENT, [0.0; 2], 9.79).unwrap()
}

fn stability(truth: &Truth, attitude: Option<[f64; AXES]>, change: impl Fn(usize, &mut RawSample)) -> Stability {
    stability_of(truth, &Setup::new(attitude, LocalGravity::Stated(9.79)), change)
}

fn stability_of(truth: &Truth, setup: &Setup, change: impl Fn(usize, &mut RawSample)) -> Stability {
    let schedule = RunSchedule {
        direction: [0.6, -0.48, 0.64],
        ramp_c_per_s: 70.0 / 3600.0,
        hold_s: 60.0,
        interval_ns: 1_000_000_000,
        chain: Chain::default(),
        noise: Noise::NONE,
        ..RunSchedule::default()
    };
    let mut collector = Collector::new(&truth.table, 10.0);
    for (index, mut raw) in run(truth, &schedule, 1).enumerate() {
        change(index, &mut raw);
        collector.add(&raw);
    }
    // After so short a hold the sensors are still behind the chamber.
    Stability { accepts_holes: true, ..collector.finish(setup).unwrap() }
}

#[test]
fn the_truth_is_stable_and_as_long_as_gravity() {
    let found = stability(&truth(), Some([0.6, -0.48, 0.64]), |_, _| {});
    assert_eq!(found.windows.len(), 372);
    assert!(found.windows.iter().all(|window| window.counts && window.still && !window.flagged));
    for axis in &found.axes {
        // Pulses are whole: the output of a window is uncertain by one or two pulses in 10 s.
        assert!(axis.rms_after < 3e-6 && axis.factor() > 50.0, "{axis:?}");
        assert!(axis.sd_before > 100e-6 && axis.rms_before >= axis.sd_before * 0.99, "{axis:?}");
    }
    assert_eq!((found.nothing_claimed(), found.verdict.missing()), (None, None));
    let length = found.verdict.length.unwrap();
    assert!(length.constant.unwrap().value.abs() < 0.5e-6 && length.largest_window < 5e-6, "{length:?}");
    assert!((found.resolution[0][0].unwrap() - 76e-6).abs() < 2e-6, "{:?}", found.resolution);
}

#[test]
fn a_constant_error_shows_only_at_a_stated_attitude() {
    let mut content = truth().table.content().clone();
    let bias = &mut content.axes[1].bias;
    let mut coefficients = bias.coefficients().to_vec();
    coefficients[0] += 50.0;
    *bias = Polynomial::new(&coefficients, 0.0, 1.0, bias.range()).unwrap();
    let (right, wrong) = (truth(), CoefficientTable::new(content).unwrap());
    let off = Truth { table: wrong, ..right.clone() };
    let run_with = |attitude| {
        let mut collector = Collector::new(&off.table, 10.0);
        for raw in
            run(&right, &RunSchedule { interval_ns: 10_000_000_000, noise: Noise::NONE, ..RunSchedule::default() }, 1)
        {
            collector.add(&raw);
        }
        collector.finish(&Setup::new(attitude, LocalGravity::Stated(9.79))).unwrap()
    };
    let stated = run_with(Some([0.6, -0.48, 0.64]));
    assert!(stated.stated && (stated.axes[1].rms_after - 50e-6).abs() < 2e-6 && stated.axes[1].sd_after < 2e-6);
    let median = run_with(None);
    assert!(!median.stated && median.axes[1].rms_after < 2e-6);
}

#[test]
fn windows_with_motion_do_not_count() {
    let found = stability(&truth(), None, |index, raw| {
        if (1000..1100).contains(&index) {
            raw.accelerometers.positive_pulses[0] += 4000;
        }
    });
    let count = |which: fn(&Window) -> bool| found.windows.iter().filter(|window| which(window)).count();
    assert_eq!((count(|window| !window.counts), count(|window| window.still)), (10, 372 - 4));
    assert!(found.axes[0].sd_after < 3e-6);
}

#[test]
fn a_window_that_is_not_a_number_on_any_axis_does_not_count() {
    for axis in 0..AXES {
        let found = stability(&truth(), Some([0.6, -0.48, 0.64]), |index, raw| {
            if index == 1_500 {
                raw.accelerometers.head_temperature[axis] = f64::NAN;
            }
        });
        let of_axis = &found.axes[axis];
        let left_out = &found.windows[150];
        assert!(left_out.after[axis].is_nan() && !left_out.counts && !left_out.still, "{left_out:?}");
        assert_eq!(found.windows.iter().filter(|window| !window.counts).count(), 1, "axis {axis}");
        assert!(of_axis.rms_after < 3e-6 && of_axis.factor() > 50.0, "{of_axis:?}");
        let length = found.verdict.length.unwrap();
        assert!(length.constant.unwrap().value.abs() < 0.5e-6 && length.largest_window < 5e-6, "{length:?}");
    }
}

#[test]
fn intervals_that_are_not_the_time_between_samples_are_refused() {
    let truth = truth();
    let check = |change: fn(&mut RawSample)| {
        let schedule = RunSchedule { interval_ns: 1_000_000_000, ..RunSchedule::default() };
        let mut collector = Collector::new(&truth.table, 10.0);
        for mut raw in run(&truth, &schedule, 1) {
            change(&mut raw);
            collector.add(&raw);
        }
        collector.finish(&Setup::new(None, LocalGravity::Stated(9.79))).map(|_| ())
    };
    assert_eq!(check(|_| {}), Ok(()));
    // The cause comes before the window that is never full.
    for (change, words) in [
        ((|raw| raw.interval_ns /= 1000) as fn(&mut RawSample), "multiply interval_ns by 1000"),
        (|raw| raw.interval_ns = 980_000_000, "interval_ns is 0.9800 of the time from row to row, 0.98 s against 1 s"),
    ] {
        let error = check(change).unwrap_err();
        assert!(matches!(error, StabilityError::Interval(_)) && error.to_string().contains(words), "{error}");
    }
    // Sums, gaps in the sequence and jitter say nothing.
    assert_eq!(check(|raw| raw.timestamp_ns += raw.sequence % 7 * 20_000_000), Ok(()));
    assert_eq!(check(|raw| (raw.sequence, raw.interval_ns) = (raw.sequence * 10, 999_000_000)), Ok(()));
}

#[test]
fn too_few_windows_are_refused() {
    let truth = truth();
    let setup = Setup::new(Some([0.0, 0.0, 1.0]), LocalGravity::Stated(9.8));
    let short = Collector::new(&truth.table, 10.0).finish(&setup).unwrap_err();
    assert!(
        matches!(short, StabilityError::TooShort { windows: 0, .. }) && short.to_string().contains("record longer")
    );
    let mut collector = Collector::new(&truth.table, 10.0);
    run(&truth, &RunSchedule { interval_ns: 10_000_000_000, ..RunSchedule::default() }, 1)
        .for_each(|raw| collector.add(&raw));
    let off = collector.clone().finish(&setup).unwrap_err().to_string();
    for words in [
        "only 0 of 1620 windows are still and within 0.1 g0 of the stated specific force (0.0000, 0.0000, 0.99",
        "the output is (0.5993, -0.47",
        "g0 long; this is another attitude than the one stated (--attitude, --angles), the table of another IMU, cables that are exchanged",
    ] {
        assert!(off.contains(words), "{words}: {off}");
    }
}

/// A whole run in microseconds has a single window, and an output that is 1000 times too long.
#[test]
fn all_times_in_microseconds_are_named() {
    let truth = truth();
    let finish = |divisor: u64, window_s: f64| {
        let mut collector = Collector::new(&truth.table, window_s);
        for mut raw in run(&truth, &RunSchedule { interval_ns: 1_000_000_000, ..RunSchedule::default() }, 1) {
            (raw.timestamp_ns, raw.interval_ns) = (raw.timestamp_ns / divisor, raw.interval_ns / divisor);
            collector.add(&raw);
        }
        collector.finish(&Setup::new(None, LocalGravity::Stated(9.79)))
    };
    let words =
        "all times look 1000 times too short; give timestamp_ns and interval_ns in nanoseconds (multiply both by 1000)";
    let short = finish(1000, 10.0).unwrap_err().to_string();
    assert!(short.starts_with("1 window of 10 s") && short.ends_with(words), "{short}");
    let mismatch = finish(1000, 0.1).unwrap().gravity_mismatch().unwrap();
    assert!(mismatch.starts_with("the output is 99") && mismatch.ends_with(words), "{mismatch}");
    assert_eq!(finish(1, 10.0).unwrap().gravity_mismatch(), None);
}

/// With a stated attitude the specific force is as long as gravity, whatever the output is.
#[test]
fn an_output_that_is_too_long_in_a_part_of_the_run_is_named() {
    let attitude = Some([0.6, -0.48, 0.64]);
    let found = |from: usize| {
        stability(&truth(), attitude, |index, raw| {
            if index >= from {
                raw.interval_ns = 1_050_000_000;
            }
        })
    };
    let part = found(2_000);
    let mismatch = part.gravity_mismatch().unwrap();
    assert!(mismatch.starts_with("the output is 0.95") && mismatch.contains(" windows, gravity is 0.99"), "{mismatch}");
    assert_eq!(part.nothing_claimed(), Some(mismatch.clone()));
    let judgements = "1,bias=1mg0".parse::<Requirement>().unwrap().judge(&part);
    assert!(judgements.iter().all(|judgement| !judgement.met && !judgement.message.contains("required: met")));
    // Why nothing is judged comes last.
    let text = isotherm_report::text::judgements(&judgements[..3]);
    assert_eq!(text.lines().last(), Some(format!("Nothing can be claimed: {mismatch}.").as_str()));
    assert_eq!(found(usize::MAX).gravity_mismatch(), None);
}

#[test]
fn intervals_that_are_a_little_off_give_a_warning_with_its_size() {
    let attitude = Some([0.6, -0.48, 0.64]);
    let of = |ppm: u64| stability(&truth(), attitude, |_, raw| raw.interval_ns += ppm * 1000);
    assert_eq!(of(0).interval_warning(), None);
    assert_eq!(of(150).interval_warning(), None);
    let off = of(300);
    let warning = off.interval_warning().unwrap();
    assert!(warning.starts_with("interval_ns is 300 ppm longer than the time from sample to sample"), "{warning}");
    assert!(isotherm_report::text::stability(&off, 10.0, true).contains(&warning));
    let json = isotherm_report::json::verification(&off, 10.0, None);
    assert!(json["interval_warning"] == warning.as_str() && json["interval_ratio"].as_f64().unwrap() > 1.00029);
}

#[test]
fn a_run_says_what_it_covers() {
    let truth = truth();
    let covered = |seconds: usize| {
        let mut collector = Collector::new(&truth.table, 10.0);
        let schedule =
            RunSchedule { interval_ns: 1_000_000_000, direction: [0.95, -0.3, 0.1], ..RunSchedule::default() };
        run(&truth, &schedule, 1).take(seconds).for_each(|raw| collector.add(&raw));
        collector.finish(&Setup::new(None, LocalGravity::Stated(9.79))).unwrap()
    };
    let part = covered(300);
    let words = part.covered.to_string();
    let (axis, k) = part.covered.least();
    assert!(part.covered.parts()[axis][k] < 0.1, "{words}");
    assert!(
        words.contains(" V of ") && words.contains(" %, the least; channels K+ of A1; not judged beyond"),
        "{words}"
    );
    assert!(isotherm_report::text::stability(&part, 10.0, true).contains(&format!("  covered: {words}\n")));
    let json = isotherm_report::json::verification(&part, 10.0, None);
    assert!(
        json["covered"]["channels"] == serde_json::json!(["K+ of A1"]) && json["covered"]["words"] == words,
        "{json}"
    );
    let whole = covered(usize::MAX);
    assert!(whole.covered.parts().as_flattened().iter().all(|part| *part > 0.8), "{}", whole.covered);
}

/// All pulses are 0.5 % too many: an error along the specific force. Without gravity the output's own length would hide
/// it.
#[test]
fn an_axis_is_judged_only_if_attitude_and_gravity_are_known() {
    let attitude = Some([0.6, -0.48, 0.64]);
    let judged = |attitude, gravity| {
        let found = stability_of(&truth(), &Setup::new(attitude, gravity), |_, raw| {
            let longer = |pulses: u32| (f64::from(pulses) * 1.005).round() as u32;
            raw.accelerometers.positive_pulses = raw.accelerometers.positive_pulses.map(longer);
            raw.accelerometers.negative_pulses = raw.accelerometers.negative_pulses.map(longer);
        });
        let require: Requirement = "bias=50ug0,scale=50ppm,level=10arcsec".parse().unwrap();
        let judgements = require.judge(&found);
        let met = [0, 1, 2].map(|k| judgements[k].met);
        (found, met, judgements)
    };
    let (found, met, judgements) = judged(attitude, LocalGravity::Unknown);
    assert!(found.verdict.axes.iter().all(|errors| errors.constant.is_none()) && found.verdict.length.is_none());
    assert_eq!(met, [false, false, true], "{judgements:?}");
    let words = ": not judged, without local gravity only variation and level";
    assert!(judgements[0].message.contains(words), "{judgements:?}");
    assert!(judgements[1].message.ends_with("not judged, local gravity is unknown"), "{judgements:?}");
    assert!(judgements[..2].iter().all(|it| it.remedy.unwrap().starts_with("state --gravity-local")), "{judgements:?}");
    let text = isotherm_report::text::stability(&found, 10.0, true);
    for words in
        ["its direction stated, its length the median", "  without local gravity only", "The largest error that could"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    let (found, met, judgements) = judged(None, LocalGravity::Unknown);
    assert_eq!(met, [false; 3], "{judgements:?}");
    assert!(judgements[2].message.contains("not judged, without a stated attitude and local gravity"));
    assert!(found.verdict.level.constant.is_none());
    let (found, met, _) = judged(attitude, LocalGravity::Stated(9.79));
    assert_eq!((met, found.verdict.missing()), ([false, false, true], None));
    let length = found.verdict.length.unwrap().constant.unwrap();
    assert!((length.value - 0.005 * 9.79 / truth().table.content().gravity).abs() < 5e-6, "{length:?}");
}

/// Only the level is judged whole, so it can be the largest error.
#[test]
fn without_gravity_the_level_can_be_the_largest_error() {
    let setup = Setup::new(Some([0.6001, -0.48, 0.64]), LocalGravity::Unknown);
    let (name, worst) = stability_of(&truth(), &setup, |_, _| {}).verdict.largest();
    assert!(name == "the level" && (worst.value - 80e-6).abs() < 5e-6, "{name} {worst:?}");
}

#[test]
fn a_run_that_is_judged_in_a_part_only_meets_no_requirement() {
    let attitude = Some([0.6, -0.48, 0.64]);
    let found = |seconds: usize| {
        stability(&truth(), attitude, |index, raw| {
            if index < seconds {
                raw.accelerometers.head_temperature[1] = f64::NAN;
            }
        })
    };
    let require: Requirement = "bias=20ug0".parse().unwrap();
    let page = |found: &Stability, required| {
        let source = isotherm_report::verification::VerificationSource {
            tool: String::new(),
            time: String::new(),
            table: String::new(),
            recording: String::new(),
            window_s: 10.0,
            required,
        };
        isotherm_report::verification::html(&truth().table, found, &source)
    };
    let whole = found(30);
    assert_eq!((require.check(&whole), whole.unjudged()), (Ok(()), None));
    assert!(page(&whole, None).contains("The largest error is that of"));
    // 332 of 372 windows.
    let part = found(3_320);
    let reason = part.nothing_claimed().unwrap();
    assert!(reason.starts_with("332 of 372 windows are not at the attitude"), "{reason}");
    let judgements = require.judge(&part);
    let [bias, why] = &judgements[..] else { panic!("{judgements:?}") };
    assert!(why.bound == "whole run" && !why.met && !bias.met && bias.remedy.is_none(), "{judgements:?}");
    assert!(bias.message.ends_with("is required: not judged, see below"), "{bias:?}");
    assert!(require.check(&part).unwrap_err().contains(&reason));
    let text = isotherm_report::text::stability(&part, 10.0, true);
    assert_eq!(text.lines().last(), Some(format!("Nothing can be claimed: {reason}.").as_str()));
    let json = isotherm_report::json::verification(&part, 10.0, Some(require));
    assert!(
        json["largest"].is_null() && json["met"] == false && json["not_the_whole_run"] == reason.as_str(),
        "{json}"
    );
    for required in [None, Some(require)] {
        let page = page(&part, required);
        assert!(page.contains(&reason) && !page.contains("The largest error"), "{page}");
    }
}

/// One window has rows of both ends: it touches nothing of what lies between them.
#[test]
fn a_run_that_is_cut_to_both_ends_shows_nothing_between() {
    let truth = truth();
    let schedule = RunSchedule { interval_ns: 1_000_000_000, noise: Noise::NONE, ..RunSchedule::default() };
    let mut collector = Collector::new(&truth.table, 10.0);
    let all: Vec<_> = run(&truth, &schedule, 1).collect();
    let ends = all[..1805].iter().chain(&all[all.len() - 1805..]);
    ends.for_each(|raw| collector.add(raw));
    let found = collector.finish(&Setup::new(Some([0.6, -0.48, 0.64]), LocalGravity::Stated(9.79))).unwrap();
    assert_eq!(found.windows.len(), 361);
    assert!(found.covered.parts().as_flattened().iter().all(|part| *part < 0.2), "{}", found.covered);
    let hole = found.covered.hole().unwrap();
    assert!(found.covered.to_string().ends_with(&format!("; no window is in {hole}")), "{}", found.covered);
    let require: Requirement = "bias=20ug0,scale=50ppm".parse().unwrap();
    let judged = require.judge(&found);
    assert!(judged.iter().all(|it| !it.met && it.message.contains("not shown over ")), "{judged:?}");
    let page = isotherm_report::json::verification(&found, 10.0, Some(require));
    assert_eq!(page["covered"]["hole"], hole.as_str());
}
