//! The ramps of tests/data/ramp: made by an independent script, with a known lag.

use super::simulated::truth;
use isotherm_fit::{
    CurveSource, LagChoice, RampRecording, TransientOptions, TransientVerdict, Transients, TransientsError, fit,
};
use isotherm_recording::RawCsvReader;
use isotherm_shared::table::CoefficientTable;
use isotherm_statistics::band;

/// The truth of the files.
const TAU_S: f64 = 240.0;
const TRANSIENTS: [f64; 3] = [35.0, -20.0, 12.0];

fn read(name: &str, text: &str) -> RampRecording {
    let mut recording = RampRecording::new(name);
    for sample in RawCsvReader::new(text.as_bytes()).unwrap() {
        recording.add(&sample.unwrap()).unwrap();
    }
    recording
}

fn ramps() -> [RampRecording; 2] {
    [
        read("ramp-1.csv", include_str!("../../data/ramp/ramp-1.csv")),
        read("ramp-2.csv", include_str!("../../data/ramp/ramp-2.csv")),
    ]
}

/// The paper's curves, of which the files were made.
fn static_table() -> CoefficientTable {
    truth(TAU_S, [0.0; 3], Vec::new()).table
}

fn fitted(curves: CurveSource, lag: LagChoice) -> Transients {
    fit(&ramps(), &static_table(), &TransientOptions { curves, lag, predecessor_s: None }).unwrap()
}

#[test]
fn the_known_lag_is_found() {
    for curves in [CurveSource::Campaign, CurveSource::Ramps] {
        let found = fitted(curves, LagChoice::Search);
        let tau = &found.time_constant;
        println!("{curves:?}: time constant {} {:?} s", tau.value_s, tau.interval_s);
        assert_eq!(found.verdict, TransientVerdict::Lag, "{:?}", found.words);
        assert!((199.0..=321.0).contains(&tau.value_s), "{tau:?}");
        assert!(tau.interval_s[0] < TAU_S && TAU_S < tau.interval_s[1], "{tau:?}");
        let bounds = [(0.10, 6.0, 1.2), (0.10, 3.3, 1.3), (0.30, 2.2, 1.2)];
        for ((bias, transient), (part, before, after)) in found.biases.iter().zip(TRANSIENTS).zip(bounds) {
            let ratio = bias.transient * 1e6 * tau.value_s / (transient * TAU_S);
            let prediction = bias.prediction.unwrap();
            let [static_curve, written] = [prediction.static_curve, prediction.written].map(|rms| rms * 1e6);
            println!(
                "{}: {:.2} +- {:.2} ug0/V, t tau {ratio:.3} of the truth; left out {static_curve:.2} -> {written:.2} ug0; band {:.2} -> {:.2} ug0",
                bias.name(),
                bias.estimate * 1e6,
                bias.standard_error * 1e6,
                band(&bias.before).unwrap() * 1e6,
                band(&bias.after).unwrap() * 1e6,
            );
            assert!((ratio - 1.0).abs() < part, "{} {ratio}", bias.name());
            assert!(static_curve > before && written < after, "{} {prediction:?}", bias.name());
            assert!(band(&bias.after).unwrap() < 0.4 * band(&bias.before).unwrap());
        }
    }
}

#[test]
fn a_given_time_constant_is_taken() {
    let found = fitted(CurveSource::Campaign, LagChoice::Given(TAU_S));
    assert!(found.time_constant.given && found.time_constant.value_s == TAU_S);
    for (bias, transient) in found.biases.iter().zip(TRANSIENTS) {
        let off = (bias.transient * 1e6 - transient).abs();
        println!("{}: {:.2} +- {:.2} ug0/V", bias.name(), bias.estimate * 1e6, bias.standard_error * 1e6);
        assert!(off < 1.5, "{} {}", bias.name(), bias.transient * 1e6);
    }
    let found = fitted(CurveSource::Campaign, LagChoice::None);
    assert!(found.biases.iter().all(|bias| bias.transient == 0.0));
    assert_eq!(found.words, ["no transient is written, as asked for"]);
}

#[test]
fn the_table_gets_lag_transients_and_curves() {
    let table = static_table();
    let mut content = table.content().clone();
    let found = fitted(CurveSource::Campaign, LagChoice::Search);
    found.apply(&mut content);
    assert_eq!(content.format, 2);
    assert_eq!(content.lag_s, Some(found.time_constant.value_s));
    for (axis, (bias, before)) in content.axes.iter().zip(found.biases.iter().zip(&table.content().axes)) {
        assert!((axis.transient * axis.bias_unit.factor() / bias.transient - 1.0).abs() < 1e-12);
        assert_eq!(axis.bias, before.bias, "the campaign's");
    }
    let refused = fitted(CurveSource::Campaign, LagChoice::None);
    refused.apply(&mut content);
    assert_eq!((content.lag_s, content.format), (None, 1));
    assert!(content.axes.iter().all(|axis| axis.transient == 0.0));

    // By themselves, the ramps give the shape of the curves; the value at mid range is the table's.
    fitted(CurveSource::Ramps, LagChoice::Search).apply(&mut content);
    CoefficientTable::new(content.clone()).unwrap();
    // A1 is level in one ramp and A2 nearly: their curves are those of the bias. A3 carries 1 g0: its K+ is in its
    // curve.
    for (axis, right) in content.axes.iter().zip(&table.content().axes).take(2) {
        let [low, high] = axis.bias.range();
        let middle = low.midpoint(high);
        assert!((axis.bias_at(middle).0 - right.bias_at(middle).0).abs() < 1e-15);
        for part in [0.02, 0.25, 0.75, 0.98] {
            let at = low + part * (high - low);
            let off = (axis.bias_at(at).0 - right.bias_at(at).0).abs();
            assert!(off < 2e-6, "{at} {off}");
        }
    }
}

#[test]
fn the_time_constant_in_force_is_kept_within_the_interval() {
    let fitted = |predecessor_s| {
        let options = TransientOptions {
            curves: CurveSource::Campaign,
            lag: LagChoice::Search,
            predecessor_s: Some(predecessor_s),
        };
        fit(&ramps(), &static_table(), &options).unwrap().time_constant
    };
    let kept = fitted(TAU_S);
    assert!(kept.kept && kept.value_s == TAU_S);
    let new = fitted(100.0);
    assert!(!new.kept && new.value_s > 199.0);
}

#[test]
fn what_is_no_ramp_is_refused_by_name() {
    let options = TransientOptions { curves: CurveSource::Campaign, lag: LagChoice::Search, predecessor_s: None };
    let refused = |recordings: &[RampRecording]| fit(recordings, &static_table(), &options).unwrap_err();
    assert_eq!(refused(&[]), TransientsError::Empty);
    assert_eq!(refused(&[RampRecording::new("empty.csv")]).to_string(), "empty.csv: no rows");
    let text = include_str!("../../data/ramp/ramp-1.csv");
    let short: String = text.lines().take(20).flat_map(|line| [line, "\n"]).collect();
    let message = refused(&[read("short.csv", &short)]).to_string();
    assert!(
        message.starts_with(
            "short.csv: 190 s give 19 means of a second or a row, and 19 of them in blocks without a gap; 24 are needed"
        ),
        "{message}"
    );
    // The same temperature in every row.
    let (header, rows) = text.split_once('\n').unwrap();
    let constant = rows.lines().take(100).map(|row| {
        let mut fields: Vec<_> = row.split(',').collect();
        [6, 7, 10, 11, 14, 15].iter().for_each(|field| fields[*field] = "2.5");
        fields.join(",") + "\n"
    });
    let constant: String = [format!("{header}\n")].into_iter().chain(constant).collect();
    let message = refused(&[read("constant.csv", &constant)]).to_string();
    assert!(message.contains("the head temperature of A1 does not change"), "{message}");
}
