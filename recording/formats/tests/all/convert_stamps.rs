//! Each kind of bad stamps, with its words; clocks that start again; and where times come from instead.

use crate::convert_ros::{BEGIN, Bag, STEP, imu};
use isotherm_files::sources;
use isotherm_recording::Progress;
use isotherm_recording::foreign::LeftOutRows;
use isotherm_recording_formats::convert::{Conversion, Foreign, Settings, TimeSource};
use isotherm_recording_formats::read::{ImuChoice, Samples};
use isotherm_recording_formats::ros::ImuMessage;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::Exit;
use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\nresolution = 1e-4\n[temperature]\nconstant = 25\n";

/// A row: its number and its stamp \[us\].
type Row = (u64, u64);

/// Rows of 416 Hz, whose stamps are not exact in binary.
fn rows(count: u64) -> Vec<Row> {
    (0..count).map(|row| (row, 5_000_000 + (row as f64 * 1e6 / 416.0) as u64)).collect()
}

fn text(rows: &[Row]) -> String {
    let mut text = "t,x,y,z\n".to_owned();
    for (number, us) in rows {
        let noise = number * 7919 % 1000;
        writeln!(text, "{}.{:06},{number}.1,0.{noise:03},9.81", us / 1_000_000, us % 1_000_000).unwrap();
    }
    text
}

fn open(text: String, mapping: &str, settings: &Settings) -> Result<Conversion, (Exit, String)> {
    let mapping = Some((Path::new("m.toml"), mapping));
    let conversion = Conversion::of_text(Path::new("in.csv"), Cursor::new(text), mapping, settings);
    conversion.map_err(|failure| (failure.exit, failure.message))
}

fn convert(rows: &[Row], settings: &Settings) -> Result<(Vec<RawSample>, String), (Exit, String)> {
    let mut conversion = open(text(rows), MAPPING, settings)?;
    let samples = (&mut conversion).collect::<Result<Vec<_>, _>>();
    let samples = samples.map_err(|failure| (failure.exit, failure.message))?;
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    Ok((samples, findings.collect::<Vec<_>>().join("\n")))
}

/// Numbers and times \[us\] of the rows, and what is reported.
fn converted(rows: &[Row]) -> (Vec<Row>, String) {
    let (samples, told) = convert(rows, &Settings::default()).unwrap();
    let row = |sample: &RawSample| {
        (u64::from(sample.accelerometers.positive_pulses[0] / 10_000), (sample.timestamp_ns + 500) / 1000)
    };
    (samples.iter().map(row).collect(), told)
}

/// Converts rows, of which those with these numbers are left out, and the others keep their stamps. Returns the
/// samples.
fn without(rows: &[Row], left_out: &[u64]) -> Vec<RawSample> {
    let (found, told) = converted(rows);
    let expected: Vec<_> = rows.iter().copied().filter(|row| !left_out.contains(&row.0)).collect();
    assert!(found == expected, "{told}");
    let share = left_out.len() as f64 / rows.len() as f64 * 100.0;
    let words = format!("cannot be right, {share:.2} % of {}; the first is line ", rows.len());
    assert!(told.contains(&words) && told.contains(&format!("warning [stamps]: {} row", left_out.len())), "{told}");
    convert(rows, &Settings::default()).unwrap().0
}

#[test]
fn one_row_with_a_bad_stamp_is_left_out_and_missing() {
    let truth = rows(1500);
    for stamp in [
        truth[799].1,
        truth[801].1,
        0,
        truth[800].1 - 500_000,
        truth[800].1 + 500_000,
        // Between its neighbours, but off the line.
        truth[800].1 + 1800,
        // An hour ahead it is no rollover.
        truth[800].1 + 3_600_000_000,
    ] {
        let mut rows = truth.clone();
        rows[800].1 = stamp;
        let samples = without(&rows, &[800]);
        assert_eq!([799, 800].map(|row| samples[row].sequence), [799, 801], "{stamp}");
    }
    let mut rows = truth.clone();
    rows[800].1 = 0;
    assert!(converted(&rows).1.contains("the first is line 802, 0 ns after 6920673000 ns;"));
}

/// They have no usual step: a gap is one, and what the others are below is left out.
#[test]
fn a_handful_of_rows_has_gaps_too() {
    let text = |times: &[&str]| -> String {
        let row = |time: &&str| format!("{time},1.5,0.1,9.8\n");
        format!("t,x,y,z\n{}", times.iter().map(row).collect::<String>())
    };
    let settings = Settings { interval_ns: Some(10_000_000), ..Settings::default() };
    let sequences = |times: &[&str]| {
        let rows: Result<Vec<_>, _> = open(text(times), MAPPING, &settings).unwrap().collect();
        rows.map(|rows| rows.iter().map(|row| row.sequence).collect::<Vec<_>>())
    };
    assert_eq!(sequences(&["0", "0.01", "0.05"]).unwrap(), [0, 1, 5]);
    assert_eq!(sequences(&["0.3", "0.31", "0.35", "0.36"]).unwrap(), [0, 1, 5, 6]);
    assert_eq!(sequences(&["1.0", "0.5", "0.51"]).unwrap(), [0, 1]);
}

#[test]
fn a_few_rows_that_are_ahead_are_left_out() {
    let mut rows = rows(1500);
    rows[700..705].iter_mut().for_each(|row| row.1 += 60_000_000);
    without(&rows, &[700, 701, 702, 703, 704]);
}

#[test]
fn a_row_that_steps_back_into_a_gap_is_left_out() {
    let mut rows = rows(1500);
    rows[700..].iter_mut().for_each(|row| row.1 += 10 * 2404);
    rows[702].1 = rows[700].1 - 6000;
    let (found, told) = converted(&rows);
    assert!(found.len() == 1499 && found.iter().all(|row| row.0 != 702 && *row == rows[row.0 as usize]), "{told}");
}

#[test]
fn of_overtaken_rows_those_that_are_ahead_are_left_out() {
    let truth = rows(1500);
    for (from, to, left_out) in [(700, 701, &[701][..]), (700, 703, &[701, 702, 703]), (703, 700, &[703])] {
        let mut rows = truth.clone();
        let row = rows.remove(from);
        rows.insert(to, row);
        without(&rows, left_out);
    }
}

#[test]
fn repeated_rows_are_left_out_whatever_their_share() {
    let truth = rows(1500);
    let twice: Vec<_> = truth.iter().flat_map(|row| vec![*row; 1 + usize::from(row.0 % 3 == 1)]).collect();
    let (found, told) = converted(&twice);
    assert_eq!(found, truth, "{told}");
    let expected = "warning [stamps]: 500 of 2000 rows repeat the stamp and the values of an earlier one, the first is \
                    line 4: repeated rows are left out";
    assert_eq!(told, expected);
    // Blocks, also longer ones than the rows that wait.
    for block in [2, 60, 700] {
        let rows = [&truth[..900], &truth[900 - block..900], &truth[900..]].concat();
        let (found, told) = converted(&rows);
        assert_eq!(found, truth, "{told}");
        assert!(told.contains(&format!("{block} of {} rows repeat", 1500 + block)), "{told}");
    }
}

#[test]
fn stamps_in_no_order_are_refused_with_a_remedy_that_works() {
    let truth = rows(1500);
    let bad = |parts: u64| truth.iter().map(|(row, us)| (*row, if row % 10 >= 10 - parts { 0 } else { *us })).collect();
    let few: Vec<Row> = bad(4);
    let zeros: Vec<_> = (0..1500).filter(|row| row % 10 >= 6).collect();
    without(&few, &zeros);
    let most: Vec<Row> = bad(6);
    let (exit, message) = convert(&most, &Settings::default()).unwrap_err();
    assert!(exit == Exit::Data && message.contains("% of 1500; the first is line "), "{message}");
    assert!(message.ends_with("give --time rate --interval S for rows that are S seconds apart"), "{message}");
    let rate = Settings { time: TimeSource::Rate, ..Settings::default() };
    let (exit, message) = convert(&most, &rate).unwrap_err();
    assert!(exit == Exit::Usage && message.contains("give --interval S, or time.interval_s"), "{message}");
    let (samples, told) = convert(&most, &Settings { interval_ns: Some(2_403_846), ..rate }).unwrap();
    assert!((1..).zip(&samples).all(|(row, sample)| sample.timestamp_ns == row * 2_403_846) && samples.len() == 1500);
    assert!(
        told.starts_with("warning [stamps]: the rows are one interval apart") && told.contains("cannot be detected")
    );
    let (exit, message) = convert(&truth, &Settings { time: TimeSource::Log, ..Settings::default() }).unwrap_err();
    assert!(
        exit == Exit::Usage && message.contains("--time log takes") && message.contains("no MCAP")
            || message.contains("not MCAP"),
        "{message}"
    );
}

#[test]
fn a_clock_that_starts_again_begins_a_session() {
    let truth = rows(2000);
    // Restarted, and set back by 0.2 s.
    for (back_us, session) in [(6_000_000, 0), (200_000, 7)] {
        let rows: Vec<_> = truth.iter().map(|(row, us)| (*row, if *row < 1200 { *us } else { us - back_us })).collect();
        let (samples, told) = convert(&rows, &Settings { session, ..Settings::default() }).unwrap();
        assert_eq!(samples.len(), 2000, "{told}");
        for (number, sample) in (0..).zip(&samples) {
            let expected = if number < 1200 { (session, number) } else { (session + 1, number - 1200) };
            assert_eq!((sample.session, sample.sequence), expected, "{told}");
            assert_eq!(sample.timestamp_ns / 1000, rows[number as usize].1);
        }
        let [before, behind] = [rows[1199].1 * 1000, rows[1200].1 * 1000];
        let expected = format!(
            "warning [new-session]: the clock starts again at line 1202, at {behind} ns after {before} ns: the rows \
             from there on are session {}",
            session + 1
        );
        assert_eq!(told, expected);
    }
    // Stamps of arrivals, on an even clock.
    let jitter = |row: u64| row * 5000 + (row.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) % 6000 + 5_000_000;
    let rows: Vec<_> = (0..6000).map(|row| (row, jitter(if row < 4000 { row + 5000 } else { row - 4000 }))).collect();
    let (samples, told) = convert(&rows, &Settings::default()).unwrap();
    assert!(told.contains("even clock") && told.contains("[new-session]"), "{told}");
    assert_eq!((samples[3999].session, samples[4000].session, samples[4000].sequence), (0, 1, 0));
    let steps = |part: &[RawSample]| {
        part.windows(2).all(|pair| (pair[1].timestamp_ns - pair[0].timestamp_ns).abs_diff(5_000_000) < 50_000)
    };
    assert!(samples.len() == 6000 && steps(&samples[..4000]) && steps(&samples[4000..]));
}

/// The clock was set after the first rows, and the last one is ahead. A row between two pauses stays.
#[test]
fn few_rows_before_the_first_leap_and_behind_the_last_one_are_left_out() {
    let mut truth = rows(1500);
    truth[2..].iter_mut().for_each(|row| row.1 += 1_700_000_000_000_000);
    truth[700..].iter_mut().for_each(|row| row.1 += 4_000_000_000);
    truth[701..].iter_mut().for_each(|row| row.1 += 4_000_000_000);
    truth[1499].1 += 86_400_000_000;
    let (found, told) = converted(&truth);
    assert_eq!(found, truth[2..1499], "{told}");
    assert!(told.contains("3 rows have stamps that cannot be right"), "{told}");
}

#[test]
fn increments_keep_the_counts_of_a_row_that_is_left_out() {
    let mut rows = rows(1500);
    rows[800].1 = 0;
    rows.remove(801);
    let mapping = MAPPING.replace("reading", "increment");
    let mut conversion = open(text(&rows), &mapping, &Settings::default()).unwrap();
    let samples = (&mut conversion).collect::<Result<Vec<_>, _>>().unwrap();
    // Rows 800 and 802 have 800.1 and 802.1 in x.
    let sum = samples[800].accelerometers.positive_pulses[0];
    assert_eq!((samples.len(), sum, samples[800].interval_ns.abs_diff(3 * 2_403_846) < 2000), (1498, 16_022_000, true));
}

fn stamped(number: u64, stamp_ns: u64) -> ImuMessage {
    ImuMessage { stamp_ns, ..imu(number) }
}

#[test]
fn a_bag_without_stamps_is_refused_and_converted_by_its_log() {
    let bag = || {
        let mut bag = Bag::new();
        for number in 0..300 {
            bag.imu_at(BEGIN + number * STEP + 7, "/imu", &stamped(number, 0));
        }
        bag
    };
    let refused = bag().convert(&Settings::default()).unwrap_err();
    assert!(refused.message.contains("message 1: all stamps of the first 300 rows are 0 ns; give --time log for"));
    let (samples, _) = bag().convert(&Settings { time: TimeSource::Log, ..Settings::default() }).unwrap();
    assert!((0..).zip(&samples).all(|(number, sample)| sample.timestamp_ns == BEGIN + number * STEP + 7));
    assert_eq!((samples.len(), samples[0].interval_ns), (300, STEP));
    let rate = Settings { time: TimeSource::Rate, interval_ns: Some(STEP), ..Settings::default() };
    let (samples, told) = bag().convert(&rate).unwrap();
    assert!((1..).zip(&samples).all(|(row, sample)| sample.timestamp_ns == row * STEP), "{told:?}");
}

#[test]
fn rows_of_a_bag_without_those_that_are_left_out_have_the_temperature_of_their_time() {
    let mut bag = Bag::new();
    for number in 0..1000 {
        if number % 100 == 0 {
            bag.temperature("/t", BEGIN + number * STEP, 20.0 + number as f64 / 100.0);
        }
        let stamp_ns = match number {
            // The stamp of the message before, as drivers give it, and an hour ahead.
            120 => BEGIN + 119 * STEP,
            350 => BEGIN + 3_600_000_000_000,
            _ => BEGIN + number * STEP,
        };
        bag.imu("/imu", &stamped(number, stamp_ns));
    }
    let (samples, told) = bag.convert(&Settings::default()).unwrap();
    assert_eq!(samples.len(), 998, "{told:?}");
    for sample in &samples {
        assert_eq!(sample.timestamp_ns, BEGIN + sample.sequence * STEP, "{told:?}");
        let celsius = 20.0 + (sample.sequence / 100) as f64;
        assert_eq!(sample.accelerometers.head_temperature, [celsius; 3]);
    }
    assert!(told[0].contains("2 rows have stamps") && told[0].contains("the first is message 123, "), "{told:?}");
}

/// A driver that repeats the stamp of the message before in a quarter of the messages, in runs of any length.
#[test]
fn many_repeated_stamps_are_left_out_and_the_others_stay() {
    let mut bag = Bag::new();
    let stamp = |number: u64| BEGIN + number * 2_532_500;
    let is_right = |row: &u64| *row == 0 || row * 7919 % 1000 >= 250;
    for number in 0..2000 {
        bag.imu("/imu", &stamped(number, stamp((0..=number).rfind(is_right).unwrap())));
    }
    let (samples, told) = bag.convert(&Settings::default()).unwrap();
    let right: Vec<_> = (0..2000).filter(is_right).map(stamp).collect();
    assert!(samples.iter().all(|sample| right.contains(&sample.timestamp_ns)), "{told:?}");
    assert!(samples.len() + 2 >= right.len() && told[0].contains(" % of 2000; the first is"), "{told:?}");
    assert_eq!(samples[0].interval_ns, 2_532_500);
}

/// A bag that lost a third to two thirds of its messages, whose stamps jitter: no time is moved, and each loss is one.
#[test]
fn lost_messages_of_a_bag_are_gaps_at_any_share() {
    let mut random = crate::joined::Random(1);
    for lost in [0.2, 0.39, 0.5, 0.6] {
        for jitter in [0.0, 0.1] {
            let mut stamp =
                |number: u64| BEGIN + number * STEP + (random.uniform().abs() * jitter * STEP as f64) as u64;
            let all: Vec<_> = (0..5000).map(|number| (number, stamp(number))).collect();
            let kept: Vec<_> = all.into_iter().filter(|_| random.uniform().abs() >= lost).collect();
            let mut bag = Bag::new();
            for (number, stamp_ns) in &kept {
                bag.imu("/imu", &stamped(*number, *stamp_ns));
            }
            let (samples, told) = bag.convert(&Settings::default()).unwrap();
            assert_eq!(samples.len(), kept.len(), "{lost} {jitter}: {told:?}");
            for (sample, (number, stamp_ns)) in samples.iter().zip(&kept) {
                assert_eq!(sample.timestamp_ns, *stamp_ns, "{lost} {jitter}: {told:?}");
                assert_eq!(sample.sequence, number - kept[0].0, "{lost} {jitter}: {told:?}");
            }
            assert!(samples[0].interval_ns.abs_diff(STEP) < STEP / 200, "{}: {told:?}", samples[0].interval_ns);
        }
    }
}

/// Pieces whose clocks start again are read one after the other, each session with a number of its own.
#[test]
fn sessions_of_several_files_are_told_apart() {
    let folder = tempfile::TempDir::new().unwrap();
    let truth = rows(900);
    let paths: Vec<_> = (0..2_u64)
        .map(|piece| {
            let later = |us: u64| us + piece * 60_000_000;
            let back = |row: u64| if row < 300 { 0 } else { 2_000_000 };
            let mut rows: Vec<_> = truth.iter().map(|(row, us)| (row + piece, later(*us) - back(*row))).collect();
            // A bad stamp in one of the pieces.
            rows[100].1 *= 1 - piece;
            let path = folder.path().join(format!("{piece}.csv"));
            std::fs::write(&path, text(&rows)).unwrap();
            path
        })
        .collect();
    let foreign = Foreign { mapping: Some(("m.toml".into(), MAPPING.to_owned())), settings: Settings::default() };
    let samples = Samples::open(&sources(&paths).unwrap(), (ImuChoice::Any, foreign), &Progress::default());
    let mut reader = samples.unwrap();
    let samples: Vec<_> = reader.by_ref().collect::<Result<_, _>>().unwrap();
    assert_eq!(reader.recording().left_out_by_stamps(), LeftOutRows { rows: 1, of: 1800 });
    let mut sessions: Vec<_> = samples.iter().map(|sample| sample.session).collect();
    assert_eq!(sessions.len(), 1799);
    sessions.dedup();
    assert_eq!(sessions.len(), 4, "{sessions:?}");
    sessions.sort_unstable();
    sessions.dedup();
    assert!(sessions.len() >= 3, "{sessions:?}");
}
