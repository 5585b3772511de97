//! The report of a calibration: what its figures show of errors and temperatures.

use super::common::{calibrated, paper_truth};
use isotherm_fit::{CalibrationOptions, CampaignSource};
use isotherm_report::calibration::html;
use isotherm_simulation::{CampaignSchedule, TILT_RAD};

fn report(set_points_c: Vec<f64>) -> String {
    report_of_order(set_points_c, 1)
}

fn report_of_order(set_points_c: Vec<f64>, order: usize) -> String {
    let truth = paper_truth(TILT_RAD, 9.8);
    let schedule = CampaignSchedule { set_points_c, ..CampaignSchedule::default() };
    let options = CalibrationOptions { order: Some(order), ..CalibrationOptions::default() };
    let (file, calibration) = calibrated(&truth, &schedule, 1, options).unwrap();
    let source = CampaignSource::default();
    html(&file, &calibration, &source, &|line| line.to_string())
}

/// The figures whose label begins so.
fn figures<'a>(html: &'a str, label: &'a str) -> Vec<&'a str> {
    let parts = html.split("<svg ").skip(1).filter_map(|part| part.split("</svg>").next());
    parts.filter(|part| part.contains(&format!("aria-label=\"{label}"))).collect()
}

#[test]
fn curves_have_error_bars_bands_and_temperatures() {
    // 5 degC is visited twice, warming and cooling.
    let html = report(vec![-15.0, 5.0, 25.0, 45.0, 5.0]);
    for quantity in ["Bias", "K+", "K-"] {
        for axis in ["A1", "A2", "A3"] {
            for label in [format!("{quantity} of {axis}: {quantity}"), format!("{quantity} of {axis}: set point")] {
                let found = figures(&html, &label);
                let [figure] = found[..] else { panic!("{label}: {} figures", found.len()) };
                let bars = figure.split("<path class=\"er s2\" d=\"").nth(1).and_then(|path| path.split('"').next());
                assert_eq!(bars.map(|bars| bars.matches('V').count()), Some(5), "{label}: {figure}");
                assert!(
                    figure.contains("<path class=\"b s1\"") && figure.contains(">Set points, 95 %</text>"),
                    "{label}"
                );
                assert!(figure.contains(">Set point / °C</text>"), "{label}");
                assert!(["0", "20", "40"].iter().all(|c| figure.contains(&format!(">{c}</text>"))), "{figure}");
            }
        }
    }
    assert_eq!(html.matches(">Set point / °C</text>").count(), 18 + 3, "and the dwells' errors over temperature");
    assert!(html.contains("Bars: 95 % of each set point"), "what the bars are");
}

/// The first screen has what the instrument was, and what it is. If a curve misses the bars of its set points, it says
/// so, and no box is green; of a cubic through the set points of a cubic nothing is to be said.
#[test]
fn a_curve_that_misses_its_set_points_has_no_green_box() {
    let set_points_c: Vec<_> = (0..8).map(|point| -25.0 + 10.0 * f64::from(point)).collect();
    let missed = report_of_order(set_points_c.clone(), 0);
    let title = missed.find("The curve misses the set points").expect("a note");
    let table = missed.find("Error of the dwells that made the table, rms [µg]").expect("the result");
    assert!(table < title && title < missed.find("id=\"s-curves").unwrap(), "the result is first");
    assert!(missed[title..].contains(" of 8 error bars of K"), "the scale factors are no constants");
    assert!(!missed.contains("Nothing found"));
    let good = report_of_order(set_points_c, 3);
    assert!(good.contains("Nothing found") && !good.contains("The curve misses"));
}
