//! Campaigns with ramps next to positions and without them: what is refused, what is warned of, and what the table
//! says.

use isotherm_campaign::Campaign;
use isotherm_fit::{
    Calibration, CalibrationError, CalibrationOptions, CalibrationOutcome, CampaignSource, LagChoice, RampCalibration,
    RampRecording, TransientVerdict, calibrate, calibrate_accelerometers, calibrate_ramps, read_measurements,
};
use isotherm_recording::{CampaignCsvReader, RecordingError};
use isotherm_report as report;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::device;
use isotherm_support::finding::name;

const FILE: &str = include_str!("../../data/ramp/campaign.toml");
const SAMPLES: &str = include_str!("../../../../../examples/campaign/samples.csv");
const RAMPS: [(&str, &str); 2] = [
    ("ramp-1.csv", include_str!("../../data/ramp/ramp-1.csv")),
    ("ramp-2.csv", include_str!("../../data/ramp/ramp-2.csv")),
];

fn recorded() -> Vec<RampRecording> {
    RAMPS.iter().map(|(name, text)| RampRecording::from_csv(*name, text.as_bytes()).unwrap()).collect()
}

fn beside(options: CalibrationOptions) -> Result<Calibration, CalibrationError> {
    let campaign = Campaign::from_toml(FILE).unwrap();
    let mut measurements = read_measurements(&campaign, CampaignCsvReader::new(SAMPLES.as_bytes()).unwrap()).unwrap();
    measurements.ramps = recorded();
    calibrate(&campaign, measurements, options)
}

/// The campaign file with only its ramps, as `change` makes it.
fn file_alone(change: impl Fn(String) -> String) -> Campaign {
    let (head, _) = FILE.split_once("[[position]]").unwrap();
    let (_, ramps) = FILE.split_once("[[ramp]]").unwrap();
    let head: String = head.lines().filter(|line| !line.starts_with("samples")).flat_map(|line| [line, "\n"]).collect();
    Campaign::from_toml(&change(format!("curves = \"static.toml\"\n{head}[[ramp]]{ramps}"))).unwrap()
}

/// The table of the positions, which the ramps begin with.
fn static_table() -> CoefficientTable {
    let campaign = Campaign::from_toml(FILE).unwrap();
    let dwells = isotherm_campaign::read_dwells(&campaign, CampaignCsvReader::new(SAMPLES.as_bytes()).unwrap());
    calibrate_accelerometers(&campaign, dwells.unwrap(), CalibrationOptions::default()).unwrap().table
}

fn alone(campaign: &Campaign, options: CalibrationOptions) -> Result<RampCalibration, CalibrationError> {
    calibrate_ramps(campaign, &recorded(), &static_table(), options)
}

fn lag(lag: LagChoice) -> CalibrationOptions {
    CalibrationOptions { lag, ..CalibrationOptions::default() }
}

fn source() -> CampaignSource {
    CampaignSource {
        tool: "test".to_owned(),
        time: "2026-01-01T00:00:00Z".to_owned(),
        campaign: "campaign.toml".to_owned(),
        recordings_sha256: vec!["11".repeat(32), "22".repeat(32)],
        ..CampaignSource::default()
    }
}

#[test]
fn beside_positions_the_curves_are_the_campaigns() {
    let plain = static_table();
    let calibration = beside(CalibrationOptions::default()).unwrap();
    let (content, found) = (calibration.table.content(), calibration.transients.as_ref().unwrap());
    assert_eq!((content.format, content.lag_s), (2, Some(found.time_constant.value_s)));
    assert!((199.0..=321.0).contains(&found.time_constant.value_s));
    assert_eq!(calibration.table.gravity_local(), plain.gravity_local());
    for ((axis, right), (transient, part)) in
        content.axes.iter().zip(&plain.content().axes).zip([(35.0, 0.10), (-20.0, 0.10), (12.0, 0.30)])
    {
        let of_truth = axis.transient * found.time_constant.value_s / (transient * 240.0);
        assert!((of_truth - 1.0).abs() < part, "{of_truth}");
        let still = isotherm_shared::table::Axis { transient: 0.0, ..axis.clone() };
        assert_eq!(still, *right);
    }
    // A3 carries 1 g0: said, and with --strict refused unless it is accepted.
    assert_eq!(calibration.findings.iter().map(|finding| finding.name).collect::<Vec<_>>(), [name::TRANSIENT]);
    let strict = |accept| CalibrationOptions { strict: true, accept, ..CalibrationOptions::default() };
    assert!(matches!(beside(strict(Vec::new())), Err(CalibrationError::Faults { .. })));
    assert_eq!(beside(strict(vec![name::TRANSIENT])).unwrap().accepted, [name::TRANSIENT]);
    // Nothing else changes without transients.
    assert_eq!(beside(lag(LagChoice::None)).unwrap().table, plain);

    let campaign = Campaign::from_toml(FILE).unwrap();
    let text = CalibrationOutcome::Campaign(Box::new(calibration.clone())).sealed(&campaign, &source()).unwrap();
    for part in ["verdict = \"lag\"", "samples = \"ramp-2.csv\"", &"22".repeat(32), "left_out_written = "] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let page = report::calibration::html(&campaign, &calibration, &source(), &|line| line.to_string());
    for part in
        ["Search over the time constant", "A2 with transient: hysteresis band", "lag-not-hysteresis", "ramp-1.csv"]
    {
        assert!(page.contains(part), "{part}");
    }
}

#[test]
fn the_time_constant_in_force_is_kept() {
    let with = |predecessor_lag_s| {
        let options = CalibrationOptions { predecessor_lag_s, ..CalibrationOptions::default() };
        let found = beside(options).unwrap();
        (found.table.content().lag_s, found.transients.unwrap().time_constant.kept)
    };
    assert_eq!(with(Some(240.0)), (Some(240.0), true));
    assert!(!with(Some(60.0)).1);
}

#[test]
fn ramps_alone_say_what_they_do_not_know() {
    let campaign = file_alone(|text| text);
    let found = alone(&campaign, CalibrationOptions::default()).unwrap();
    let (content, plain) = (found.table.content(), static_table());
    assert_eq!(found.transients.verdict, TransientVerdict::Lag);
    for (axis, right) in content.axes.iter().zip(&plain.content().axes) {
        assert_eq!(axis.positive_scale_factor, right.positive_scale_factor);
        assert!(axis.transient != 0.0 && axis.bias != right.bias);
        let [low, high] = axis.bias.range();
        let at = |axis: &isotherm_shared::table::Axis| axis.bias_at(low.midpoint(high)).0;
        assert!((at(axis) - at(right)).abs() < 1e-12, "the constant is that of curves");
    }
    assert_eq!(content.alignment, plain.content().alignment);
    let not_known = found.not_known().join("\n");
    let parts = [
        "scale factors, misalignments: not measured",
        "1 mrad is 1000 ug0",
        "a tilt of the fixture with temperature (1 urad is 1 ug0 on a horizontal axis)",
        "the new ranges are A1 1.",
        "A3 (1.00 g0)",
        "f dK/K",
    ];
    for part in parts {
        assert!(not_known.contains(part), "{not_known}");
    }
    let text = CalibrationOutcome::Ramps(Box::new(found.clone())).sealed(&campaign, &source()).unwrap();
    let printed = report::text::ramps(&found);
    let page = report::ramps::html(&campaign, &found, &source());
    let document = report::json::ramps(&found, |line| line.to_string());
    assert_eq!(document["not_known"].as_array().unwrap().len(), 5);
    assert_eq!(document["transients"]["verdict"], "lag");
    for part in found.not_known() {
        for text in [&text, &printed] {
            assert!(text.contains(&part), "{part}\n{text}");
        }
        // The page has the signs of print.
        let signs = [("ug0", "µg"), ("urad", "µrad"), ("deg/h", "°/h"), (" g0)", " g)"), (" .. ", " to ")];
        let shown = signs.iter().fold(part, |part, (ascii, sign)| part.replace(ascii, sign));
        assert!(page.replace("&#39;", "'").contains(&shown), "{shown}\n{page}");
    }
    // The time constant of the table that they begin with is its predecessor's.
    let mut with_lag = plain.content().clone();
    (with_lag.lag_s, with_lag.format) = (Some(240.0), 2);
    let with_lag = CoefficientTable::new(with_lag).unwrap();
    let kept = calibrate_ramps(&campaign, &recorded(), &with_lag, CalibrationOptions::default()).unwrap();
    assert!(kept.transients.time_constant.kept && kept.table.content().lag_s == Some(240.0));
    // What that table had of it does not outlive a decision against it.
    let none = calibrate_ramps(&campaign, &recorded(), &kept.table, lag(LagChoice::None)).unwrap();
    assert!(none.table.content().lag_s.is_none() && none.table.content().axes.iter().all(|axis| axis.transient == 0.0));
}

/// The rows of the ramps are of 10 and of 1 s.
#[test]
fn ramps_keep_the_nominal_interval_of_the_table_that_they_begin_with() {
    let campaign = file_alone(|text| text);
    let with = |interval_s, accept| {
        let mut content = static_table().content().clone();
        (content.nominal_interval_s, content.format) = (Some(interval_s), 3);
        let curves = CoefficientTable::new(content).unwrap();
        let options = CalibrationOptions { accept, ..CalibrationOptions::default() };
        calibrate_ramps(&campaign, &recorded(), &curves, options)
    };
    for interval_s in [1.0, 0.5] {
        let found = with(interval_s, Vec::new()).unwrap();
        let content = found.table.content();
        assert_eq!((content.nominal_interval_s, content.format), (Some(interval_s), 3));
        let text = CalibrationOutcome::Ramps(Box::new(found)).sealed(&campaign, &source()).unwrap();
        assert!(text.contains(&format!("\nnominal_interval_s = {interval_s:?}\n")), "{text}");
    }
    let Err(CalibrationError::Faults { findings, .. }) = with(0.07, Vec::new()) else { panic!("not refused") };
    assert_eq!(findings.iter().map(|finding| finding.name).collect::<Vec<_>>(), [name::INTERVAL_NOT_NOMINAL; 2]);
    assert!(findings[1].message.starts_with("ramp-2.csv: the interval of the rows is 1 s, and the scale factors"));
    assert_eq!(with(0.07, vec![name::INTERVAL_NOT_NOMINAL]).unwrap().accepted, [name::INTERVAL_NOT_NOMINAL]);
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let right = file_alone(|text| text);
    let refused = |campaign: &Campaign, options| alone(campaign, options).unwrap_err().to_string();
    let changed =
        |from: &str, to: &str| refused(&file_alone(|text| text.replacen(from, to, 1)), CalibrationOptions::default());
    for (from, to, part) in [
        ("\"imu-paper\"", "\"other\"", "curves is the table of imu-paper, and the campaign is of other"),
        ("\"V\"", "\"degC\"", "the temperature of curves is in \"V\""),
        ("gravity_reference = 9.8015", "gravity_reference = 9.80665", "1 g0 of curves is 9.8015 m/s2"),
        ("[0, 0, 1]", "[0, 0, -1]", "ramp-1.csv: A3 indicates 1.000 g0 on average, and specific_force says -1.000 g0"),
    ] {
        let message = changed(from, to);
        assert!(message.contains(part), "{message}");
    }
    let options = [
        CalibrationOptions { order: Some(3), ..CalibrationOptions::default() },
        CalibrationOptions { exclude: vec![(20.0, 1)], ..CalibrationOptions::default() },
    ];
    for options in options {
        assert!(refused(&right, options).contains("are for positions"));
    }
    // The same recording under two names.
    let twice = [RAMPS[0], ("copy.csv", RAMPS[0].1)];
    let twice: Vec<_> =
        twice.iter().map(|(name, text)| RampRecording::from_csv(*name, text.as_bytes()).unwrap()).collect();
    let error = calibrate_ramps(&right, &twice, &static_table(), CalibrationOptions::default()).unwrap_err();
    assert!(error.to_string().contains("copy.csv has rows of ramp-1.csv"), "{error}");
    // A time constant without ramps.
    let no_ramps = Campaign::from_toml(FILE.split_once("[[ramp]]").unwrap().0).unwrap();
    let measurements = read_measurements(&no_ramps, CampaignCsvReader::new(SAMPLES.as_bytes()).unwrap()).unwrap();
    let error = calibrate(&no_ramps, measurements, lag(LagChoice::Given(240.0))).unwrap_err();
    assert!(matches!(error, CalibrationError::Options(_)), "{error}");
}

#[test]
fn an_unknown_key_of_a_ramp_names_every_known_one() {
    let text = "[[ramp]]\nsamples = \"ramp-1.csv\"\nspecific_forces = [0, 0, 1]\n";
    let faults = Campaign::from_toml(text).unwrap_err().to_string();
    assert!(
        faults.contains("line 3: ramp.1.specific_forces: unknown key; known here: samples, specific_force"),
        "{faults}"
    );
}

#[test]
fn ramps_of_another_device_are_refused() {
    let of = |serial: &str, number: usize| {
        let (name, text) = RAMPS[number];
        let rows = text.lines().enumerate().map(|(line, row)| match line {
            0 => format!("{row},device\n"),
            _ => format!("{row},{:016x}\n", device(serial)),
        });
        RampRecording::from_csv(name, rows.collect::<String>().as_bytes()).unwrap()
    };
    let campaign = file_alone(|text| format!("serial = \"S/N 1\"\n{text}"));
    let fitted = |ramps: &[RampRecording], accept: &[&'static str]| {
        let options = CalibrationOptions { accept: accept.to_vec(), ..CalibrationOptions::default() };
        calibrate_ramps(&campaign, ramps, &static_table(), options)
    };
    assert_eq!(
        fitted(&[of("S/N 1", 0), of("S/N 1", 1)], &[]).unwrap().table.content().serial.as_deref(),
        Some("S/N 1")
    );
    let others = [of("S/N 1", 0), of("S/N 2", 1)];
    let error = fitted(&others, &[]).unwrap_err().to_string();
    assert!(
        error.contains("ramp-2.csv: rows of this ramp are from device") && error.contains("the campaign file"),
        "{error}"
    );
    assert_eq!(fitted(&others, &[name::OTHER_DEVICE]).unwrap().accepted, [name::OTHER_DEVICE]);
}

#[test]
fn a_row_that_cannot_be_used_has_its_line() {
    let text = RAMPS[0].1;
    let (line, row) = text.lines().enumerate().nth(100).unwrap();
    let nan = row.split(',').enumerate().map(|(i, field)| if i == 6 { "NaN" } else { field }).collect::<Vec<_>>();
    let changed = text.replacen(row, &nan.join(","), 1);
    match RampRecording::from_csv("ramp-1.csv", changed.as_bytes()) {
        Err(RecordingError::Data { line: found, message }) => {
            assert_eq!(found, line as u64 + 1);
            assert!(message.contains("which is not a temperature"), "{message}");
        }
        other => panic!("{other:?}"),
    }
}
