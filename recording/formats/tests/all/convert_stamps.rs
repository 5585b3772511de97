//! Each kind of bad stamps, with its words; clocks that start again; and where times come from instead.

use crate::convert_ros::{BEGIN, Bag, STEP, imu};
use isotherm_files::sources;
use isotherm_recording::Progress;
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

/// Whether these rows have their true times, to half a step, and those that are not in `bad` exactly.
fn is_true(found: &[Row], truth: &[Row], bad: std::ops::Range<u64>) -> bool {
    let is_near = |(found, of): (&Row, &Row)| {
        found.0 == of.0 && found.1.abs_diff(of.1) <= if bad.contains(&of.0) { 1200 } else { 0 }
    };
    found.len() == truth.len() && found.iter().zip(truth).all(is_near)
}

#[test]
fn one_row_with_a_bad_stamp_gets_the_time_between_its_neighbours() {
    let truth = rows(1500);
    for (stamp, kind) in [
        (truth[799].1, "1 the stamp of a neighbour"),
        (truth[801].1, "1 the stamp of a neighbour"),
        (0, "1 the stamp 0"),
        (truth[800].1 - 500_000, "1 a stamp that goes back"),
        (truth[800].1 + 500_000, "1 a stamp that is ahead"),
        // An hour ahead it is no rollover.
        (truth[800].1 + 3_600_000_000, "1 a stamp that is ahead"),
    ] {
        let mut rows = truth.clone();
        rows[800].1 = stamp;
        let (found, told) = converted(&rows);
        assert!(is_true(&found, &truth, 800..801), "{kind}: {told}");
        let begins = format!("warning [stamps]: 1 of 1500 rows has a bad stamp: {kind}; the first is line ");
        assert!(told.starts_with(&begins), "{told}");
        assert!(told.ends_with(" ns; 1 gets a time between those of its neighbours"), "{told}");
    }
    let mut rows = truth.clone();
    rows[800].1 = 0;
    assert!(converted(&rows).1.contains("the first is line 802, 0 ns after 6920673000 ns;"));
}

/// They have no usual step: a gap is one, and what goes back is refused.
#[test]
fn in_a_handful_of_rows_no_stamp_is_fixed() {
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
    let refused = sequences(&["1.0", "0.5", "0.6"]).unwrap_err();
    assert!(refused.message.contains("the first is line 2, 1000000000 ns, over 1 %"), "{refused}");
}

#[test]
fn a_few_rows_that_are_ahead_go_back_between_their_neighbours() {
    let truth = rows(1500);
    let mut rows = truth.clone();
    rows[700..705].iter_mut().for_each(|row| row.1 += 60_000_000);
    let (found, told) = converted(&rows);
    assert!(is_true(&found, &truth, 700..705), "{told}");
    assert!(told.contains("5 of 1500 rows have bad stamps: 5 a stamp that is ahead; the first is line 702,"), "{told}");
}

#[test]
fn overtaken_rows_are_put_in_order() {
    let truth = rows(1500);
    for (from, to) in [(700, 701), (700, 703), (703, 700)] {
        let mut rows = truth.clone();
        let row = rows.remove(from);
        rows.insert(to, row);
        let (found, told) = converted(&rows);
        assert_eq!(found, truth, "{told}");
        assert!(told.contains("a stamp that is out of order; the first is line 70"), "{told}");
        assert!(told.contains("put in order"), "{told}");
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
fn a_row_whose_place_is_not_known_is_left_out() {
    let mut rows = rows(1500);
    rows[800].1 = 0;
    // A row next to it was lost.
    rows.remove(801);
    let (found, told) = converted(&rows);
    assert_eq!(found, [&rows[..800], &rows[801..]].concat(), "{told}");
    assert!(
        told.contains("1 of 1499 rows has a bad stamp: 1 the stamp 0;") && told.contains("; 1 is left out"),
        "{told}"
    );
}

#[test]
fn rows_of_which_over_one_in_a_hundred_has_a_bad_stamp_are_refused_with_a_remedy_that_works() {
    let truth = rows(1500);
    let bad = |every: u64| truth.iter().map(|(row, us)| (*row, if row % every == 50 { 0 } else { *us })).collect();
    let of_100: Vec<Row> = bad(100);
    assert!(is_true(&converted(&of_100).0.split_off(51), &truth[51..], 0..1500));
    let of_90: Vec<Row> = bad(90);
    let (exit, message) = convert(&of_90, &Settings::default()).unwrap_err();
    assert_eq!(exit, Exit::Data);
    assert!(message.starts_with("in.csv:52: 17 of 1500 rows have bad stamps: 17 the stamp 0; the first is line 52"));
    assert!(
        message.ends_with(
            "over 1 %, so the times cannot be fixed; give --time rate --interval S for rows that \
                               are S seconds apart"
        ),
        "{message}"
    );
    let rate = Settings { time: TimeSource::Rate, ..Settings::default() };
    let (exit, message) = convert(&of_90, &rate).unwrap_err();
    assert!(exit == Exit::Usage && message.contains("give --interval S, or time.interval_s"), "{message}");
    let (samples, told) = convert(&of_90, &Settings { interval_ns: Some(2_403_846), ..rate }).unwrap();
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
    assert!(
        told.contains("3 of 1500 rows have bad stamps: 2 a stamp that goes back, 1 a stamp that is ahead"),
        "{told}"
    );
    assert!(told.contains("3 are left out"), "{told}");
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
fn bad_stamps_of_a_bag_are_fixed_with_the_temperature_of_their_time() {
    let mut bag = Bag::new();
    for number in 0..1000 {
        if number % 100 == 0 {
            bag.temperature("/t", BEGIN + number * STEP, 20.0 + number as f64 / 100.0);
        }
        let stamp_ns = match number {
            // The stamp of the message before, as drivers give it, an hour ahead, and overtaken by 0.1 ms.
            120 => BEGIN + 119 * STEP,
            350 => BEGIN + 3_600_000_000_000,
            700 => BEGIN + 701 * STEP + 100_000,
            _ => BEGIN + number * STEP,
        };
        bag.imu("/imu", &stamped(number, stamp_ns));
    }
    let (samples, told) = bag.convert(&Settings::default()).unwrap();
    assert_eq!(samples.len(), 1000, "{told:?}");
    for (number, sample) in (0..).zip(&samples) {
        assert!(sample.timestamp_ns.abs_diff(BEGIN + number * STEP) <= STEP / 2, "{number}: {told:?}");
        let celsius = 20.0 + (number / 100) as f64;
        assert_eq!(sample.accelerometers.head_temperature, [celsius; 3], "{number}");
    }
    let stamps = told.iter().find(|line| line.contains("[stamps]")).unwrap();
    assert!(stamps.contains("3 of 1000 rows have bad stamps: 1 the stamp of a neighbour, 2 a stamp that is ahead"));
    assert!(stamps.contains("the first is message 123, "), "{stamps}");
}

/// Stamps that are repeated, with the step behind them as long as two, show the time of each row.
#[test]
fn many_repeated_stamps_do_no_harm_where_the_steps_have_the_places_of_their_rows() {
    let mut bag = Bag::new();
    let stamp = |number: u64| BEGIN + number * 2_532_500;
    for number in 0..2000 {
        let is_right = |row: &u64| [0, 1999].contains(row) || row * 7919 % 1000 >= 250;
        bag.imu("/imu", &stamped(number, stamp((0..=number).rfind(is_right).unwrap())));
    }
    let (samples, told) = bag.convert(&Settings::default()).unwrap();
    let off = |(number, sample): (u64, &RawSample)| sample.timestamp_ns.abs_diff(stamp(number));
    assert!(samples.len() == 2000 && (0..).zip(&samples).all(|row| off(row) <= 1), "{told:?}");
    assert_eq!(samples[0].interval_ns, 2_532_500);
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
            let rows: Vec<_> = truth.iter().map(|(row, us)| (row + piece, later(*us) - back(*row))).collect();
            let path = folder.path().join(format!("{piece}.csv"));
            std::fs::write(&path, text(&rows)).unwrap();
            path
        })
        .collect();
    let foreign = Foreign { mapping: Some(("m.toml".into(), MAPPING.to_owned())), settings: Settings::default() };
    let samples = Samples::open(&sources(&paths).unwrap(), (ImuChoice::Any, foreign), &Progress::default());
    let samples: Vec<_> = samples.unwrap().collect::<Result<_, _>>().unwrap();
    let mut sessions: Vec<_> = samples.iter().map(|sample| sample.session).collect();
    assert_eq!(sessions.len(), 1800);
    sessions.dedup();
    assert_eq!(sessions.len(), 4, "{sessions:?}");
    sessions.sort_unstable();
    sessions.dedup();
    assert!(sessions.len() >= 3, "{sessions:?}");
}
