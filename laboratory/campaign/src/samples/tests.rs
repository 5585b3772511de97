use super::*;
use crate::plan::Plan;
use isotherm_calibration::campaign::{Campaign, read};
use isotherm_recording::CampaignCsvReader;
use std::path::Path;
use tempfile::TempDir;

const SECOND: u64 = 1_000_000_000;

fn plan(folder: &Path, row_s: f64) -> Plan {
    let text = include_str!("../../../../examples/plan.toml");
    let text = text.replace("row_s = 10 ", &format!("row_s = {row_s} ")).replace("time_s = 300", "time_s = 100");
    Plan::from_toml(&text.replace("output = \"imu-a-campaign\"", "output = \".\""), folder).unwrap()
}

/// Sample `number`, sent when it ends. The acquisition's clock is 1000 s ahead of laboratory time.
fn sample(clock: &LaboratoryClock, number: u64, interval_ns: u64) -> RawSample {
    let end_ns = number * interval_ns;
    RawSample {
        session: 7,
        sequence: number,
        timestamp_ns: 1000 * SECOND + end_ns,
        interval_ns,
        sent_ns: clock.origin_ns + end_ns,
        // The telemetry is read when the sample ends.
        telemetry_ns: 1000 * SECOND + end_ns,
        accelerometers: Triad {
            positive_pulses: [number as u32, 1, 2],
            head_temperature: [number as f64, 1.0, 1.0],
            board_temperature: [2.0; AXES],
            ..Triad::default()
        },
        ..RawSample::default()
    }
}

fn recorder(folder: &TempDir, row_s: f64) -> (SampleRecorder<'static>, LaboratoryClock) {
    let plan: &'static Plan = Box::leak(Box::new(plan(folder.path(), row_s)));
    // The clock began 10,000 s ago, so that no sample of the tests is in the future.
    let clock = LaboratoryClock { origin_ns: monotonic_ns().saturating_sub(10_000 * SECOND), speed: 1.0 };
    (SampleRecorder::new(plan, clock, None, 0.0), clock)
}

fn feed(recorder: &mut SampleRecorder<'_>, clock: &LaboratoryClock, numbers: std::ops::Range<u64>, interval_ns: u64) {
    for number in numbers {
        let sample = sample(clock, number, interval_ns);
        assert!(recorder.take(&sample, sample.sent_ns + 1000).unwrap(), "{number}");
    }
}

const DWELL: Unit = Unit::Dwell { visit: 0, position: 0 };

#[test]
fn only_samples_that_begin_after_the_table_has_settled_are_taken() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock) = recorder(&folder, 10.0);
    feed(&mut recorder, &clock, 1..10, 10 * SECOND);
    // The turntable settles in the middle of sample 10, which is received later.
    recorder.begin(DWELL, 95.0, 0).unwrap();
    feed(&mut recorder, &clock, 10..20, 10 * SECOND);
    assert!(!recorder.complete() && recorder.collected_s() == 90.0);
    feed(&mut recorder, &clock, 20..40, 10 * SECOND);
    assert!(recorder.complete() && recorder.collected_s() == 100.0);
    let kept = recorder.keep(0).unwrap().unwrap();
    assert_eq!((kept.rows, kept.from, kept.session, kept.end_ns), (10, 0, 7, 1200 * SECOND));
    let text = fs::read_to_string(folder.path().join(SAMPLES)).unwrap();
    assert_eq!(text.len() as u64, kept.to);
    assert!(text.lines().nth(1).unwrap().starts_with("-25,1,7,11,1110000000000,10000000000,11,0,11.0,2.0,"), "{text}");
}

#[test]
fn samples_that_come_late_are_not_taken_for_late_ones() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock) = recorder(&folder, 1.0);
    feed(&mut recorder, &clock, 1..100, SECOND);
    // The acquisition stalls for 500 s; meanwhile the turntable moves and settles at 590 s. Then all samples arrive at once.
    recorder.begin(DWELL, 590.0, 0).unwrap();
    for number in 100..1000 {
        let late = RawSample { sent_ns: clock.origin_ns + number.max(600) * SECOND, ..sample(&clock, number, SECOND) };
        recorder.take(&late, late.sent_ns + 5).unwrap();
    }
    recorder.keep(0).unwrap().unwrap();
    let text = fs::read_to_string(folder.path().join(SAMPLES)).unwrap();
    assert!(text.lines().any(|line| line.starts_with("-25,1,7,591,1591000000000,1000000000,")), "{text}");
    assert!(!text.contains(",7,590,"));
}

#[test]
fn samples_are_summed_into_rows_that_calibrate_reads() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock) = recorder(&folder, 10.0);
    let interval_ns = SECOND / 4;
    feed(&mut recorder, &clock, 1..5, interval_ns);
    recorder.begin(DWELL, 1.0, 0).unwrap();
    feed(&mut recorder, &clock, 5..500, interval_ns);
    let first = recorder.keep(0).unwrap().unwrap();
    recorder.begin(Unit::Dwell { visit: 0, position: 1 }, 125.0, first.to).unwrap();
    feed(&mut recorder, &clock, 500..520, interval_ns);
    // The turntable moves while a row is in progress: nothing of the unit stays in the file.
    recorder.discard();
    recorder.begin(Unit::Dwell { visit: 0, position: 1 }, 130.0, first.to).unwrap();
    feed(&mut recorder, &clock, 520..1000, interval_ns);
    let second = recorder.keep(1).unwrap().unwrap();
    assert_eq!((first.rows, second.rows, second.from), (10, 10, first.to));
    let plan = plan(folder.path(), 10.0);
    write_campaign_file(&plan).unwrap();
    let campaign = Campaign::from_toml(&fs::read_to_string(folder.path().join("campaign.toml")).unwrap()).unwrap();
    let rows = CampaignCsvReader::new(File::open(folder.path().join(&campaign.samples[0])).unwrap()).unwrap();
    let dwells = read(&campaign, rows).unwrap();
    assert_eq!(dwells.len(), 2);
    assert_eq!((dwells[0].sums.seconds, dwells[0].rows, dwells[1].position), (100.0, 10, 1));
    // The dwell has samples 5 to 404, with their telemetry averaged.
    assert_eq!(dwells[0].sums.positive[0], (5..405).sum::<u64>() as f64);
    assert!((dwells[0].sums.head(0) - 204.5).abs() < 1e-9);
    // The telemetry changes by 1 per sample and is read half a sample after its middle, which `calibrate` corrects by 0.5.
    assert!((dwells[0].head(0) - 204.0).abs() < 1e-9 && dwells[0].board(0) == 2.0);
}

#[test]
fn what_calibrate_could_not_use_is_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock) = recorder(&folder, 0.0);
    feed(&mut recorder, &clock, 1..3, SECOND);
    recorder.begin(DWELL, 2.0, 0).unwrap();
    feed(&mut recorder, &clock, 3..5, SECOND);
    let good = sample(&clock, 5, SECOND);
    for bad in [
        RawSample { accelerometers: Triad { head_temperature: [f64::NAN, 1.0, 1.0], ..good.accelerometers }, ..good },
        RawSample { interval_ns: 0, ..good },
        RawSample { interval_ns: u64::MAX, ..good },
        RawSample { accelerometers: Triad { positive_pulses: [0, u32::MAX, 0], ..good.accelerometers }, ..good },
        RawSample { timestamp_ns: 1, ..good },
        sample(&clock, 3, SECOND),
    ] {
        assert!(!recorder.take(&bad, bad.sent_ns).unwrap(), "{bad:?}");
    }
    feed(&mut recorder, &clock, 8..20, SECOND);
    let kept = recorder.keep(0).unwrap().unwrap();
    assert_eq!((kept.left_out, kept.gaps, kept.rows), (6, 1, 14));
}

#[test]
fn another_session_spoils_the_unit_and_its_time_goes_on_rising() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock) = recorder(&folder, 0.0);
    feed(&mut recorder, &clock, 1..3, SECOND);
    recorder.begin(DWELL, 2.0, 0).unwrap();
    feed(&mut recorder, &clock, 3..200, SECOND);
    let first = recorder.keep(0).unwrap().unwrap();
    recorder.begin(Unit::Dwell { visit: 0, position: 1 }, 200.0, first.to).unwrap();
    feed(&mut recorder, &clock, 200..202, SECOND);
    // The clock of the new session begins at 0.
    let restarted = |number: u64| RawSample {
        session: 8,
        sequence: number,
        timestamp_ns: number * SECOND,
        ..sample(&clock, 300 + number, SECOND)
    };
    recorder.take(&restarted(1), monotonic_ns()).unwrap();
    assert!(recorder.spoiled().is_some());
    recorder.discard();
    recorder.begin(Unit::Dwell { visit: 0, position: 1 }, 301.0, first.to).unwrap();
    for number in 2..150 {
        recorder.take(&restarted(number), clock.origin_ns + (300 + number) * SECOND + 5).unwrap();
    }
    let second = recorder.keep(1).unwrap().unwrap();
    assert!(second.shift_ns > 0 && second.end_ns > first.end_ns + 100 * SECOND, "{first:?} {second:?}");
}
