//! The times of foreign data: jitter, bursts, rollovers, calendars, and what is no text.

use isotherm_recording_formats::convert::{Conversion, Settings, TimeSource};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::Exit;
use std::io::Cursor;
use std::path::Path;

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"us\"\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\n[temperature]\nconstant = 25\n";

fn open(data: impl Into<Vec<u8>>, mapping: &str, settings: &Settings) -> Result<Conversion, String> {
    let mapping = (!mapping.is_empty()).then_some((Path::new("m.toml"), mapping));
    let conversion = Conversion::of_text(Path::new("in.csv"), Cursor::new(data.into()), mapping, settings);
    conversion.map_err(|failure| failure.message)
}

/// The samples, the findings in lines, and the notes.
type Converted = (Vec<RawSample>, Vec<String>, Vec<String>);

fn convert(times: &[String], mapping: &str) -> Result<Converted, String> {
    let rows = times.iter().map(|time| format!("{time},1,2,3\n"));
    let text = rows.fold("t,x,y,z\n".to_owned(), |all, row| all + &row);
    let mut conversion = open(text, mapping, &Settings::default())?;
    let samples = (&mut conversion).collect::<Result<Vec<_>, _>>().map_err(|failure| failure.message)?;
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    Ok((samples, findings.collect(), conversion.notes()))
}

fn steps(samples: &[RawSample]) -> impl Iterator<Item = u64> {
    samples.windows(2).map(|pair| pair[1].timestamp_ns - pair[0].timestamp_ns)
}

#[test]
fn bursts_and_stamps_that_stand_are_converted_with_an_even_clock() {
    let increments = MAPPING.replace("reading", "increment");
    let given = MAPPING.replace("unit = \"us\"", "unit = \"us\"\ninterval_s = 0.005");
    for (burst, told) in [(10, "in bursts of about 10"), (64, "in bursts of about 64")] {
        // All rows of a burst have the stamp of the last one.
        let times: Vec<_> = (0..6400).map(|row| ((row / burst + 1) * burst * 5000).to_string()).collect();
        for mapping in [MAPPING, given.as_str(), increments.as_str()] {
            let (samples, findings, _) = convert(&times, mapping).unwrap();
            assert_eq!(samples.len(), 6400);
            assert!(steps(&samples).all(|step| step.abs_diff(5_000_000) < 20_000), "{burst}");
            assert!(samples.iter().all(|sample| sample.interval_ns.abs_diff(5_000_000) < 20_000), "{burst}");
            assert_eq!(samples.last().map(|sample| sample.sequence), Some(6399));
            assert!(findings[0].starts_with("warning [stamps]: ") && findings[0].contains(told), "{findings:?}");
            assert_eq!(findings.len(), 1, "{findings:?}");
        }
    }
}

#[test]
fn a_gap_between_bursts_is_told_and_leaves_a_gap_in_the_sequence() {
    let time = |row: u64| (row / 10 + 1) * 50_000 + if row >= 3000 { 60_000_000 } else { 0 };
    let times: Vec<_> = (0..6000).map(|row| time(row).to_string()).collect();
    let (samples, findings, _) = convert(&times, MAPPING).unwrap();
    assert_eq!(samples[3000].sequence - samples[2999].sequence, 12_001);
    assert!(findings.iter().any(|finding| finding.contains("1 gaps, 12000 rows missing")), "{findings:?}");
}

/// Stamps of whole seconds, and of bursts, of which rows are lost here and there: each loss is one of whole periods.
#[test]
fn rows_that_are_lost_between_stamps_of_arrival_are_missing() {
    for (burst, lost) in [(100, &[1234, 3456, 3457, 8765][..]), (100, &[5000]), (10, &[700, 701, 702, 4444]), (10, &[])]
    {
        let kept: Vec<u64> = (0..10_000).filter(|row| !lost.contains(row)).collect();
        let stamp = |row: &u64| ((row / burst + 1) * burst * 10_000).to_string();
        let (samples, findings, _) = convert(&kept.iter().map(stamp).collect::<Vec<_>>(), MAPPING).unwrap();
        let sequence = samples.last().map(|sample| sample.sequence);
        assert_eq!((samples.len(), sequence), (kept.len(), Some(9999)), "{burst} {lost:?}: {findings:?}");
        for (sample, row) in samples.iter().zip(&kept) {
            // Where a row is lost is known to a burst.
            assert!(sample.sequence.abs_diff(*row) <= 3, "{burst} {lost:?}: {row} {}", sample.sequence);
            let off_ns = (sample.timestamp_ns - samples[0].timestamp_ns).abs_diff((row - kept[0]) * 10_000_000);
            assert!(off_ns <= 30_100_000, "{burst} {lost:?}: row {row} is off by {off_ns} ns");
        }
        assert!(samples.iter().all(|sample| sample.interval_ns == 10_000_000), "{findings:?}");
    }
}

/// Where rows are lost everywhere between stamps of arrival, nothing shows how many.
#[test]
fn a_share_of_losses_that_cannot_be_told_is_refused_with_a_remedy() {
    let mut random = crate::joined::Random(5);
    for (burst, lost) in [(10, 0.05), (10, 0.5), (100, 0.02), (64, 0.3)] {
        let kept: Vec<u64> = (0..20_000).filter(|_| random.uniform().abs() >= lost).collect();
        let times: Vec<_> = kept.iter().map(|row| ((row / burst + 1) * burst * 5000).to_string()).collect();
        let text = times.iter().map(|time| format!("{time},1,2,3\n")).collect::<String>();
        let mapping = Some((Path::new("m.toml"), MAPPING));
        let open = |settings: &Settings| {
            let text = Cursor::new(format!("t,x,y,z\n{text}"));
            Conversion::of_text(Path::new("in.csv"), text, mapping, settings)
        };
        let failure = open(&Settings::default()).err().unwrap_or_else(|| panic!("{burst} {lost}"));
        assert!(failure.exit == Exit::Data && failure.message.contains("give --time rate --interval S"), "{failure}");
        let rate = Settings { time: TimeSource::Rate, interval_ns: Some(5_000_000), ..Settings::default() };
        assert_eq!(open(&rate).unwrap().filter(Result::is_ok).count(), kept.len());
    }
}

#[test]
fn even_stamps_stay_as_they_are() {
    let times: Vec<_> = (0..3000_u64).map(|row| (row * 5000 + row * 7919 % 900).to_string()).collect();
    let (samples, findings, _) = convert(&times, MAPPING).unwrap();
    let stamps = samples.iter().map(|sample| (sample.timestamp_ns / 1000).to_string());
    assert!(stamps.eq(times) && findings.is_empty(), "{findings:?}");
}

#[test]
fn a_counter_that_rolls_over_is_joined() {
    let begin = (1_u64 << 32) - 1_500_000;
    let times: Vec<_> = (0..3000).map(|row| ((begin + row * 5000) % (1 << 32)).to_string()).collect();
    let (samples, findings, _) = convert(&times, MAPPING).unwrap();
    assert!(steps(&samples).all(|step| step == 5_000_000));
    assert_eq!(
        findings,
        ["warning [rollover]: the time rolls over at 2^32 us, once, first at row 301; it is joined there"]
    );
    // A few rows are lost there.
    let times: Vec<_> = times.into_iter().enumerate().filter(|(row, _)| !(298..303).contains(row)).collect();
    let (samples, findings, _) =
        convert(&times.into_iter().map(|(_, time)| time).collect::<Vec<_>>(), MAPPING).unwrap();
    assert_eq!((samples[298].sequence, samples[298].session), (303, 0), "{findings:?}");
    assert!(findings[0].contains("rolls over at 2^32 us, once, first at row 299"), "{findings:?}");
}

#[test]
fn dates_and_times_of_a_day_are_read() {
    let iso = MAPPING.replace("\"us\"", "\"iso8601\"");
    let dates: Vec<_> =
        (0..300).map(|row| format!("2026-05-01T23:59:{:06.3}Z", 58.0 + f64::from(row) * 0.005)).collect();
    let (samples, _, _) = convert(&dates, &iso).unwrap();
    assert_eq!(samples[0].timestamp_ns, 1_777_679_998_000_000_000);
    assert!(steps(&samples).all(|step| step == 5_000_000));
    let day = |row: u32| {
        let ms = (86_399_000 + row * 5) % 86_400_000;
        format!("{:02}:{:02}:{:02}.{:03}", ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60, ms % 1000)
    };
    let (samples, findings, _) = convert(&(0..600).map(day).collect::<Vec<_>>(), &iso).unwrap();
    assert!(steps(&samples).all(|step| step == 5_000_000));
    assert!(findings[0].contains("rolls over at 24 h, once, first at row 201"), "{findings:?}");
    let refused = convert(&["2026-05-01".to_owned()], &iso).unwrap_err();
    assert!(refused.starts_with("in.csv:2: t is \"2026-05-01\", give a time of ISO 8601"), "{refused}");
}

#[test]
fn an_interval_that_no_imu_has_is_told() {
    let times: Vec<_> = (0..2000_u64).map(|row| (1_700_000_000_000 + row * 10).to_string()).collect();
    let (_, findings, _) = convert(&times, MAPPING).unwrap();
    assert!(
        findings[0].starts_with("warning [interval]: the interval is 0.00001 s, 1.000e5 Hz: no IMU"),
        "{findings:?}"
    );
    let (_, findings, _) = convert(&times, &MAPPING.replace("\"us\"", "\"ms\"")).unwrap();
    assert!(findings.is_empty(), "{findings:?}");
    let (_, findings, _) = convert(&["0".to_owned(), "200".to_owned()], &MAPPING.replace("\"us\"", "\"s\"")).unwrap();
    assert!(findings[0].contains("no IMU has under 0.01 Hz"), "{findings:?}");
}

#[test]
fn what_is_no_text_is_named() {
    let utf_16: Vec<_> = "t,x,y,z\n1,2,3,4\n".bytes().flat_map(|byte| [byte, 0]).collect();
    for (data, message) in [
        (&b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n"[..], "has no temperatures"),
        (b"t,x,y,z\r1,2,3,4\r2,2,3,4\r", "only a carriage return; make line feeds of them: tr"),
        (b"t,x\x02y,z\n", "not text: byte 0x02 at 3; a binary format"),
        (&utf_16, "a text in UTF-16; save it as UTF-8: iconv"),
    ] {
        for mapping in ["", MAPPING] {
            let refused = open(data, mapping, &Settings::default()).err().unwrap();
            assert!(refused.starts_with("in.csv: ") && refused.contains(message), "{refused}");
        }
    }
    let failure = Conversion::of_text(Path::new("in"), &b"\0"[..], None, &Settings::default()).err().unwrap();
    assert_eq!(failure.exit, Exit::Data);
}

#[test]
fn all_samples_have_the_session_that_is_given() {
    let settings = Settings { session: 7, ..Settings::default() };
    let samples = open("t,x,y,z\n1000,2,3,4\n2000,2,3,4\n", MAPPING, &settings).unwrap();
    assert!(samples.map(|sample| sample.unwrap().session).eq([7, 7]));
}
