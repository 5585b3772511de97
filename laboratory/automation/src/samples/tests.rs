use super::*;
use crate::plan::{Plan, SAMPLES};
use isotherm_campaign::{Campaign, read_dwells};
use isotherm_client::monotonic_ns;
use isotherm_instruments::{Moment, RealTime, Time as _};
use isotherm_recording::CampaignCsvReader;
use isotherm_shared::wire::{AXES, Triad};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;

const SECOND: u64 = 1_000_000_000;

fn plan(folder: &Path, row_s: f64) -> Plan {
    let text = include_str!("../../../../examples/plan.toml");
    let text = text.replace("row_s = 10 ", &format!("row_s = {row_s} ")).replace("time_s = 300", "time_s = 100");
    Plan::from_toml(&text.replace("output = \"imu-a-campaign\"", "output = \".\""), folder).unwrap()
}

/// A clock that began so long ago \[s\].
fn clock_since(seconds: u64) -> LaboratoryClock {
    let origin = Moment::of_ns(RealTime.now().ns().saturating_sub(seconds * SECOND));
    LaboratoryClock { time: Arc::new(RealTime), origin, speed: 1.0 }
}

/// Sample `number`, sent when it ends. The acquisition's clock is 1000 s ahead of laboratory time.
fn sample(clock: &LaboratoryClock, number: u64, interval_ns: u64) -> RawSample {
    let end_ns = number * interval_ns;
    RawSample {
        session: 7,
        sequence: number,
        timestamp_ns: 1000 * SECOND + end_ns,
        interval_ns,
        sent_ns: clock.origin.ns() + end_ns,
        // The temperature is read when the sample ends.
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
    let clock = clock_since(10_000);
    (SampleRecorder::new(plan, clock.clone(), None, 0.0), clock)
}

fn feed(recorder: &mut SampleRecorder<'_>, clock: &LaboratoryClock, numbers: std::ops::Range<u64>, interval_ns: u64) {
    for number in numbers {
        let sample = sample(clock, number, interval_ns);
        assert!(recorder.take(&sample, sample.sent_ns + 1000).unwrap(), "{number}");
    }
}

const DWELL: CampaignStep = CampaignStep::Dwell { visit: 0, position: 0 };

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
    // The acquisition stalls for 500 s; meanwhile the turntable moves and settles at 590 s. Then all samples arrive at
    // once.
    recorder.begin(DWELL, 590.0, 0).unwrap();
    for number in 100..1000 {
        let late =
            RawSample { sent_ns: clock.origin.ns() + number.max(600) * SECOND, ..sample(&clock, number, SECOND) };
        recorder.take(&late, late.sent_ns + 5).unwrap();
    }
    recorder.keep(0).unwrap().unwrap();
    let text = fs::read_to_string(folder.path().join(SAMPLES)).unwrap();
    assert!(text.lines().any(|line| line.starts_with("-25,1,7,591,1591000000000,1000000000,")), "{text}");
    assert!(!text.contains(",7,590,"));
}

/// All samples of a start may be late: how late, only those after them show it.
#[test]
fn the_clock_is_known_when_its_offset_no_longer_rises() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock) = recorder(&folder, 1.0);
    assert!(!recorder.knows_clock());
    let late = |recorder: &mut SampleRecorder<'_>, number: u64, by_ns: u64| {
        let sample = sample(&clock, number, SECOND);
        let late = RawSample { sent_ns: sample.sent_ns + by_ns, ..sample };
        recorder.take(&late, late.sent_ns + 5).unwrap();
        recorder.knows_clock()
    };
    // 20 s late, and then a burst that catches up: sample 20 is the first one in time, at 20 s.
    for number in 1..40 {
        assert!(!late(&mut recorder, number, 20_u64.saturating_sub(number) * SECOND), "{number}");
    }
    // A jitter of 50 ms, and a stall of 9 s.
    for number in 40..48 {
        assert!(!late(&mut recorder, number, (48 - number) * 50_000_000), "{number}");
    }
    assert!(!late(&mut recorder, 48, 0) && !late(&mut recorder, 49, 0));
    assert!((50..60).all(|number| late(&mut recorder, number, (60 - number) * SECOND)));
    // The next session begins anew, and so does the time after an interruption.
    recorder.reset_timing();
    assert!(!recorder.knows_clock() && !late(&mut recorder, 60, 0));
    assert!((61..90).all(|number| !late(&mut recorder, number, 0)) && late(&mut recorder, 90, 0));
    // A clock that is 2 % fast never stands still: its offset is taken when it is known for its span.
    recorder.reset_timing();
    let fast = |recorder: &mut SampleRecorder<'_>, number: u64| {
        let sample = sample(&clock, number, SECOND);
        let fast = RawSample { timestamp_ns: sample.timestamp_ns + number * SECOND / 50, ..sample };
        recorder.take(&fast, fast.sent_ns + 5).unwrap();
        recorder.knows_clock()
    };
    assert!((100..400).all(|number| !fast(&mut recorder, number)) && fast(&mut recorder, 400));
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
    recorder.begin(CampaignStep::Dwell { visit: 0, position: 1 }, 125.0, first.to).unwrap();
    feed(&mut recorder, &clock, 500..520, interval_ns);
    // The turntable moves while a row is in progress: nothing of the unit stays in the file.
    recorder.discard();
    recorder.begin(CampaignStep::Dwell { visit: 0, position: 1 }, 130.0, first.to).unwrap();
    feed(&mut recorder, &clock, 520..1000, interval_ns);
    let second = recorder.keep(1).unwrap().unwrap();
    assert_eq!((first.rows, second.rows, second.from), (10, 10, first.to));
    let plan = plan(folder.path(), 10.0);
    plan.write_campaign_file().unwrap();
    let campaign = Campaign::from_toml(&fs::read_to_string(folder.path().join("campaign.toml")).unwrap()).unwrap();
    let rows = CampaignCsvReader::new(File::open(folder.path().join(&campaign.samples[0])).unwrap()).unwrap();
    let dwells = read_dwells(&campaign, rows).unwrap();
    assert_eq!(dwells.len(), 2);
    assert_eq!((dwells[0].sums.seconds, dwells[0].rows, dwells[1].position), (100.0, 10, 1));
    // The dwell has samples 5 to 404, with their temperature averaged.
    assert_eq!(dwells[0].sums.positive[0], (5..405).sum::<u64>() as f64);
    assert!((dwells[0].sums.head(0) - 204.5).abs() < 1e-9);
    // The temperature changes by 1 per sample and is read half a sample after its middle, which `calibrate` corrects
    // by 0.5.
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
    recorder.begin(CampaignStep::Dwell { visit: 0, position: 1 }, 200.0, first.to).unwrap();
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
    recorder.begin(CampaignStep::Dwell { visit: 0, position: 1 }, 301.0, first.to).unwrap();
    for number in 2..150 {
        recorder.take(&restarted(number), clock.origin.ns() + (300 + number) * SECOND + 5).unwrap();
    }
    let second = recorder.keep(1).unwrap().unwrap();
    assert!(second.shift_ns > 0 && second.end_ns > first.end_ns + 100 * SECOND, "{first:?} {second:?}");
}

/// A recorder of the plan with turns, in rows of a second.
fn with_turns(folder: &TempDir) -> (SampleRecorder<'static>, LaboratoryClock, &'static Plan) {
    let text = include_str!("../../../../examples/plan-whole.toml");
    let text = text.replace("output = \"imu-a-campaign\"", "output = \".\"");
    let plan: &'static Plan = Box::leak(Box::new(Plan::from_toml(&text, folder.path()).unwrap()));
    let clock = clock_since(10_000);
    (SampleRecorder::new(plan, clock.clone(), None, 0.0), clock, plan)
}

/// A sample of an IMU with gyroscopes, of a known unit.
fn whole_sample(clock: &LaboratoryClock, number: u64, interval_ns: u64) -> RawSample {
    let sample = sample(clock, number, interval_ns);
    let gyroscopes = Triad { positive_pulses: [number as u32, 3, 0], ..sample.accelerometers };
    RawSample { gyroscopes, device: device("SN 42"), ..sample }
}

fn feed_whole(recorder: &mut SampleRecorder<'_>, samples: impl IntoIterator<Item = RawSample>) {
    for sample in samples {
        assert!(recorder.take(&sample, sample.sent_ns + 1000).unwrap(), "{sample:?}");
    }
}

const TURN: CampaignStep = CampaignStep::Turn { visit: 0, turn: 1 };

#[test]
fn a_turn_is_one_run_of_rows_of_both_triads_that_calibrate_reads() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock, plan) = with_turns(&folder);
    let interval_ns = SECOND / 4;
    let clock = &clock;
    let samples = |numbers: std::ops::Range<u64>| numbers.map(move |number| whole_sample(clock, number, interval_ns));
    feed_whole(&mut recorder, samples(1..8));
    recorder.begin(DWELL, 2.0, 0).unwrap();
    feed_whole(&mut recorder, samples(8..1300));
    let dwell = recorder.keep(0).unwrap().unwrap();
    recorder.begin(TURN, 325.0, dwell.to).unwrap();
    feed_whole(&mut recorder, samples(1300..1700));
    assert_eq!((recorder.spoiled(), recorder.collected_s()), (None, 99.0));
    let turn = recorder.keep(1).unwrap().unwrap();
    assert_eq!((turn.from, turn.rows, turn.name.as_str()), (dwell.to, 99, "-25 degC, turn 14 (outer 720 to 0 deg)"));
    let text = fs::read_to_string(folder.path().join(SAMPLES)).unwrap();
    let header = text.lines().next().unwrap();
    assert!(
        header.starts_with("set_point_c,position,session,sequence,")
            && header.ends_with(",g3_board,telemetry_ns,device")
    );
    let rows = CampaignCsvReader::new(text.as_bytes()).unwrap();
    let measurements = isotherm_fit::read_measurements(&plan.campaign, rows).unwrap();
    assert_eq!((measurements.dwells.len(), measurements.gyroscopes.turns.len()), (1, 1));
    let found = &measurements.gyroscopes.turns[0];
    assert!(!found.has_gap() && found.blocks.len() == 99 && found.run.sums.seconds == 99.0);
    // Four samples a row, from the first whose interval begins after the rest has begun.
    assert_eq!(found.blocks[0].pulses[0], [(1301..1305).sum::<u64>() as f64, 0.0]);
    assert_eq!(found.run.sums.positive[1], 99.0 * 12.0);
}

#[test]
fn rows_of_a_turn_have_the_same_number_of_samples_whatever_their_intervals() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock, plan) = with_turns(&folder);
    recorder.begin(TURN, 0.0, 0).unwrap();
    // Intervals of 70 to 130 ms.
    let mut end_ns = 0;
    for number in 1..1000_u64 {
        let interval_ns = SECOND / 1000 * (70 + number * 37 % 61);
        end_ns += interval_ns;
        let sample = whole_sample(&clock, number, interval_ns);
        let time = RawSample {
            timestamp_ns: 1000 * SECOND + end_ns,
            telemetry_ns: 1000 * SECOND + end_ns,
            sent_ns: clock.origin.ns() + end_ns,
            ..sample
        };
        feed_whole(&mut recorder, [time]);
    }
    recorder.keep(0).unwrap().unwrap();
    let file = File::open(folder.path().join(SAMPLES)).unwrap();
    let rows = CampaignCsvReader::new(file).unwrap();
    let measurements = isotherm_fit::read_measurements(&plan.campaign, rows).unwrap();
    let found = &measurements.gyroscopes.turns[0];
    assert!(!found.has_gap() && found.blocks.len() > 80, "{}", found.blocks.len());
}

#[test]
fn a_missing_sample_spoils_a_turn_and_nothing_of_it_stays() {
    type Change = fn(&LaboratoryClock) -> RawSample;
    let changes: [(Change, bool, &str); 5] = [
        (|clock| whole_sample(clock, 14, SECOND), true, "samples are missing"),
        (|clock| RawSample { session: 8, ..whole_sample(clock, 12, SECOND) }, true, "the acquisition was restarted"),
        (|clock| RawSample { interval_ns: 0, ..whole_sample(clock, 12, SECOND) }, false, "a sample cannot be used"),
        (
            |clock| {
                let sample = whole_sample(clock, 12, SECOND);
                let gyroscopes = Triad { board_temperature: [1.0, f64::NAN, 1.0], ..sample.gyroscopes };
                RawSample { gyroscopes, ..sample }
            },
            false,
            "a sample cannot be used",
        ),
        (
            |clock| {
                let sample = whole_sample(clock, 12, SECOND);
                RawSample { gyroscopes: Triad { negative_pulses: [0, 0, u32::MAX], ..sample.gyroscopes }, ..sample }
            },
            false,
            "a sample cannot be used",
        ),
    ];
    for (change, usable, reason) in changes {
        let folder = tempfile::tempdir().unwrap();
        let (mut recorder, clock, _) = with_turns(&folder);
        recorder.begin(DWELL, 0.0, 0).unwrap();
        feed_whole(&mut recorder, (1..6).map(|number| whole_sample(&clock, number, SECOND)));
        let kept = recorder.keep(0).unwrap().unwrap();
        recorder.begin(TURN, 6.0, kept.to).unwrap();
        // Before the turn has a sample, nothing is missing in it.
        let early = RawSample { interval_ns: 0, ..whole_sample(&clock, 6, SECOND) };
        assert!(!recorder.take(&early, early.sent_ns).unwrap() && recorder.spoiled().is_none());
        feed_whole(&mut recorder, (7..12).map(|number| whole_sample(&clock, number, SECOND)));
        assert_eq!((recorder.spoiled(), recorder.collected_s()), (None, 5.0));
        let wrong = change(&clock);
        assert_eq!(recorder.take(&wrong, wrong.sent_ns + 1000).unwrap(), usable);
        assert!(recorder.spoiled().is_some_and(|spoiled| spoiled.starts_with(reason)), "{:?}", recorder.spoiled());
        recorder.discard();
        assert_eq!(fs::metadata(folder.path().join(SAMPLES)).unwrap().len(), kept.to);
    }
}

#[test]
fn rows_that_are_too_long_spoil_a_turn() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock, _) = with_turns(&folder);
    recorder.begin(TURN, 0.0, 0).unwrap();
    let tenth = SECOND / 10;
    feed_whole(&mut recorder, (1..3).map(|number| whole_sample(&clock, number, 29 * tenth)));
    assert_eq!(recorder.spoiled(), None, "29 deg");
    recorder.discard();
    recorder.begin(TURN, 0.0, 0).unwrap();
    feed_whole(&mut recorder, (3..5).map(|number| whole_sample(&clock, number, 30 * tenth)));
    assert!(recorder.spoiled().is_some_and(|spoiled| spoiled.starts_with("a row of 3.000 s turns by up to 30.0 deg")));
}

#[test]
fn a_file_keeps_the_columns_that_it_was_begun_with() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock, _) = with_turns(&folder);
    let unknown = |number| RawSample { device: 0, ..whole_sample(&clock, number, SECOND) };
    feed_whole(&mut recorder, (1..3).map(unknown));
    recorder.begin(DWELL, 2.0, 0).unwrap();
    feed_whole(&mut recorder, (3..10).map(unknown));
    let first = recorder.keep(0).unwrap().unwrap();
    // The acquisition reports the unit from now on.
    feed_whole(&mut recorder, (10..12).map(|number| whole_sample(&clock, number, SECOND)));
    recorder.begin(TURN, 11.0, first.to).unwrap();
    feed_whole(&mut recorder, (12..20).map(|number| whole_sample(&clock, number, SECOND)));
    recorder.keep(1).unwrap().unwrap();
    // A new file has the column.
    for (unit, begin) in [(CampaignStep::Ramp(0), 20), (CampaignStep::Run(0), 40)] {
        recorder.begin(unit, (begin - 1) as f64, 0).unwrap();
        feed_whole(&mut recorder, (begin..begin + 20).map(|number| whole_sample(&clock, number, SECOND)));
        recorder.keep(2).unwrap().unwrap();
    }
    let lines = |name: &str| {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        text.lines().map(|line| line.split(',').count()).collect::<Vec<_>>()
    };
    let samples = lines(SAMPLES);
    assert!(samples.len() > 8 && samples.iter().all(|columns| *columns == samples[0]), "{samples:?}");
    for file in ["ramp-1.csv", "verify-1.csv"] {
        let run = fs::read_to_string(folder.path().join(file)).unwrap();
        let header = run.lines().next().unwrap();
        assert!(header.starts_with("session,sequence,") && header.ends_with(",g3_board,telemetry_ns,device"));
        assert!(run.lines().nth(1).unwrap().ends_with(&format!(",{:016x}", device("SN 42"))), "{run}");
    }
}

#[test]
fn samples_of_another_device_or_without_gyroscopes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (mut recorder, clock, _) = with_turns(&folder);
    let right = whole_sample(&clock, 1, SECOND);
    let of = |serial: &str| RawSample { device: device(serial), ..right };
    let refused = |recorder: &mut SampleRecorder<'_>, sample: RawSample| {
        recorder.take(&sample, sample.sent_ns + 1000).map_err(|failure| (failure.exit, failure.to_string()))
    };
    let without = RawSample { gyroscopes: Triad::ABSENT, ..right };
    let (exit, message) = refused(&mut recorder, without).unwrap_err();
    assert!(
        exit == Exit::Data && message.contains("have no gyroscopes") && message.contains("leave [turns] out"),
        "{message}"
    );
    for sample in [right, of(" SN 42 "), RawSample { device: 0, ..right }] {
        assert!(refused(&mut recorder, sample).is_ok());
    }
    let (exit, message) = refused(&mut recorder, of("SN 43")).unwrap_err();
    assert!(
        exit == Exit::Data && message.contains("serial = \"SN 42\"") && message.contains("--other-device"),
        "{message}"
    );
    let mut recorder = recorder.with_other_device(true);
    assert!(refused(&mut recorder, of("SN 43")).is_ok());
    // A plan without a serial number takes any unit, and one without turns any IMU.
    let (mut plain, _) = self::recorder(&folder, 10.0);
    assert!(refused(&mut plain, RawSample { device: device("SN 43"), ..without }).is_ok());
}
