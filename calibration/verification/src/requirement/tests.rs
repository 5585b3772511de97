//! Requirements, read and judged.

use super::*;
use crate::occupancy::Occupancy;
use crate::stability::{AxisStability, Coverage, LeftOut, LocalGravity, Loops};
use crate::verdict::Verdict;
use crate::verdict::tests::{FORCE, windows};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;

#[test]
fn requirements_are_read_and_printed() {
    for (text, factor, bias, scale, level) in [
        ("10", Some(10.0), None, None, None),
        ("factor=2.5", Some(2.5), None, None, None),
        ("bias=20ug0,scale=50ppm,level=5arcsec", None, Some(20e-6), Some(50e-6), Some(5.0 / 206_264.806_247)),
        ("12, bias = 0.02 mg0", Some(12.0), Some(20e-6), None, None),
        ("level=24.24urad", None, None, None, Some(24.24e-6)),
        ("scale=0.005%", None, None, Some(50e-6), None),
        ("bias=1e-5g0", None, Some(1e-5), None, None),
    ] {
        let found: Requirement = text.parse().unwrap();
        assert_eq!(found.factor, factor, "{text}");
        for (found, right) in [(found.bias, bias), (found.scale, scale), (found.level, level)] {
            assert!(found.is_some() == right.is_some(), "{text}");
            assert!(found.zip(right).is_none_or(|(found, right)| (found / right - 1.0).abs() < 1e-9), "{text}");
        }
        let again: Requirement = found.to_string().parse().unwrap();
        assert_eq!(again.to_string(), found.to_string());
    }
    for (text, rate) in [("rate=0.02deg/h", 0.02), ("bias=20ug0, rate = 0.5 arcsec/s", 0.5), ("rate=1e-4deg/s,3", 0.36)]
    {
        let found: Requirement = text.parse().unwrap();
        assert!((found.rate.unwrap() / rate - 1.0).abs() < 1e-12, "{text}");
        let again: Requirement = found.to_string().parse().unwrap();
        assert!((again.rate.unwrap() / rate - 1.0).abs() < 1e-9, "{found}");
    }
    for wrong in [
        "",
        "rate=0.02",
        "rate=0.02ug0",
        "rate=0deg/h",
        "rate=1e-7deg/h",
        "rate=11deg/s",
        "rate=1deg/h,rate=2deg/h",
        "x",
        "-3",
        "0",
        "nan",
        "inf",
        "bias=20",
        "bias=20ppm",
        "bias=ug0",
        "scale=5",
        "level=5",
        "bias=1ug0,bias=2ug0",
        "10,11",
        "10,",
        ",bias=1ug0",
        "bias=-20ug0",
        "bias=0ug0",
        "bias=nanug0",
        "bias=1e308g0",
        "bias=1.1g0",
        "bias=0.0001ug0",
        "scale=1e300%",
        "scale=101%",
        "level=91deg",
        "level=0.0001arcsec",
        "factor=1e-320",
        "1e10",
        "size=3ug0",
        "5arcsec",
        "5%",
        "factor=10x",
    ] {
        let message = wrong.parse::<Requirement>().unwrap_err();
        assert!(
            message.contains("give") || message.contains("must be") || message.contains("twice"),
            "{wrong}: {message}"
        );
    }
    for (wrong, words) in [
        ("bias=-20ug0", "bias must be over 0"),
        ("bias=20ug0,", "a bound next to a comma is empty"),
        ("bias=1e308g0", "bias must be from 0.001 ug0 to 1 g0"),
        ("5,6", "factor is given twice"),
    ] {
        assert!(wrong.parse::<Requirement>().unwrap_err().starts_with(words), "{wrong}");
    }
    for (text, right) in [
        ("bias=20\u{b5}g0", "bias=20ug0"),
        ("level=24\u{3bc}rad", "level=24urad"),
        ("level=90deg", "level=324000arcsec"),
    ] {
        let [found, right] = [text, right].map(|text| text.parse::<Requirement>().unwrap().to_string());
        assert_eq!(found, right);
    }
}

#[test]
fn a_bound_is_met_only_if_the_whole_interval_is_within_it() {
    let of = |count: usize, noise: f64, stated: bool| {
        let run = windows(count, 5, noise, |_| [18e-6, 0.0, 0.0]);
        let verdict = Verdict::of(&run, FORCE, stated, Some(1.0));
        Stability {
            windows: run,
            specific_force: FORCE,
            stated,
            axes: [AxisStability { sd_before: 10.0, rms_before: 10.0, sd_after: 1.0, rms_after: 1.0 }; AXES],
            gravity: 1.0,
            gravity_source: LocalGravity::Stated(9.8),
            verdict,
            resolution: [[None; 2]; AXES],
            left_out: 0,
            windows_left_out: LeftOut {
                kind: SensorKind::Accelerometer,
                windows: count,
                not_a_number: 0,
                moved: 0,
                elsewhere: 0,
                by_accelerometers: 0,
            },
            loops: Loops::default(),
            unsettled_s: None,
            middle: [[0.0; 2]; AXES],
            accepts_holes: false,
            covered: Coverage {
                kind: SensorKind::Accelerometer,
                temperature: [[[1.0, 1.5]; 2]; AXES],
                occupancy: [0, 1, 2].map(|_| [(); 2].map(|()| Occupancy::of([1.0, 2.0], [[1.0, 1.95]]))),
                unit: "V".to_owned(),
                driven: [[true, false]; AXES],
            },
            interval_ratio: None,
            gyroscopes: None,
            other_device: None,
            losses: Default::default(),
            time_fault: None,
            made_the_table: false,
            of_time: Vec::new(),
        }
    };
    let stability = |noise: f64, stated: bool| of(120, noise, stated);
    let bias: Requirement = "bias=20ug0".parse().unwrap();
    assert_eq!(bias.check(&stability(0.2e-6, true)), Ok(()));
    let noisy = bias.check(&stability(2e-6, true)).unwrap_err();
    assert!(noisy.contains("  bias: A1 ") && noisy.ends_with("reaches over it\nremedy: record longer"), "{noisy}");
    let message = bias.check(&stability(0.2e-6, false)).unwrap_err();
    assert!(
        message.contains("not judged, without a stated attitude only variation and length can be judged"),
        "{message}"
    );
    assert!(message.ends_with("\nremedy: state --attitude"), "{message}");
    // Two bounds and one remedy.
    let both: Requirement = "11,bias=10ug0".parse().unwrap();
    let message = both.check(&stability(0.2e-6, true)).unwrap_err();
    assert_eq!(message.lines().count(), 4, "{message}");
    assert!(message.ends_with("\nremedy: calibrate again, or look at the report"), "{message}");
    // A run that was cut to both ends of the table's range shows nothing between.
    let mut cut = stability(0.2e-6, true);
    cut.covered.occupancy[1][0] = Occupancy::of([1.0, 2.0], [[1.0, 1.05], [1.9, 2.0]]);
    let message = bias.check(&cut).unwrap_err();
    assert!(
        message.contains("is required: not shown over 1.07 to 1.90 V of bias of A2, 82 % of its range\n"),
        "{message}"
    );
    assert!(message.ends_with("or accept that a part of it is not judged: --accept not-covered"), "{message}");
    assert!(
        "15".parse::<Requirement>()
            .unwrap()
            .check(&cut)
            .unwrap_err()
            .contains("10.00, at least 15 is required: missed")
    );
    assert!("5".parse::<Requirement>().unwrap().check(&cut).is_err());
    let accepted = Stability { accepts_holes: true, ..cut };
    assert_eq!(bias.check(&accepted), Ok(()));
    let said = &bias.judge(&accepted)[0].message;
    assert!(said.ends_with("met; not shown over 1.07 to 1.90 V of bias of A2, 82 % of its range"), "{said}");
    // A run of 11 windows shows nothing, even if it is good.
    assert_eq!(bias.check(&of(12, 0.01e-6, true)), Ok(()));
    let short = bias.judge(&of(11, 0.01e-6, true));
    let [judged, why] = &short[..] else { panic!("{short:?}") };
    assert!(
        !judged.met && judged.message.ends_with("at most 20.000 ug0 is required: not judged, see below"),
        "{judged:?}"
    );
    assert_eq!((why.bound, why.met, why.remedy), ("length of the run", false, Some("record longer")));
    assert!(why.message.contains("a run of 11 windows, at least 12"), "{why:?}");
    assert!(
        "bias=15ug0".parse::<Requirement>().unwrap().check(&stability(0.2e-6, true)).unwrap_err().contains("missed")
    );
    assert!(
        "11".parse::<Requirement>()
            .unwrap()
            .check(&stability(0.2e-6, true))
            .unwrap_err()
            .contains("10.00, at least 11")
    );
    assert_eq!("10,scale=50ppm,level=10arcsec".parse::<Requirement>().unwrap().check(&stability(0.2e-6, true)), Ok(()));
}
