//! Foreign data, as other programs write them, become the raw samples that they should.

use isotherm_files::source;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/convert");

fn data(name: &str) -> PathBuf {
    Path::new(DATA).join(name)
}

/// A conversion of a text in memory.
fn of_text(text: &str, mapping: Option<&str>, settings: &Settings) -> Result<Conversion, Failure> {
    let mapping = mapping.map(|mapping| (Path::new("m.toml"), mapping));
    Conversion::of_text(Path::new("in.csv"), Cursor::new(text.to_owned()), mapping, settings)
}

fn convert(text: &str, mapping: &str) -> Result<Vec<RawSample>, Failure> {
    of_text(text, Some(mapping), &Settings::default())?.collect()
}

/// The message of a refusal with this exit code.
fn refused(text: &str, mapping: &str, exit: Exit) -> String {
    let failure = convert(text, mapping).unwrap_err();
    assert_eq!(failure.exit, exit, "{failure}");
    failure.message
}

/// Positive less negative pulses.
fn net(sample: &RawSample) -> [i64; 6] {
    let (a, g) = (&sample.accelerometers, &sample.gyroscopes);
    let net = |positive: u32, negative: u32| i64::from(positive) - i64::from(negative);
    std::array::from_fn(|index| match index {
        0..3 => net(a.positive_pulses[index], a.negative_pulses[index]),
        _ => net(g.positive_pulses[index - 3], g.negative_pulses[index - 3]),
    })
}

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\ninterval_s = 0.01\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\n[temperature]\nconstant = 25\n";

/// The same numbers, with the separators and decimal marks of several countries.
#[test]
fn separators_and_decimal_commas_are_found() {
    let rows = [["0.5", "1.25", "-2.5", "3"], ["0.51", "1.5", "2", "-0.125"]];
    let right = convert(&text(&rows, ",", true, "."), MAPPING).unwrap();
    assert_eq!(net(&right[0]), [1_250_000, -2_500_000, 3_000_000, 0, 0, 0]);
    assert_eq!((right[0].timestamp_ns, right[1].timestamp_ns), (500_000_000, 510_000_000));
    for separator in [",", ";", "\t", " ", "  "] {
        for mark in [".", ","] {
            if (separator, mark) == (",", ",") {
                continue;
            }
            for (header, columns, key) in [
                (true, MAPPING.to_owned(), ""),
                (false, MAPPING.replace("\"t\"", "1").replace("\"x\", \"y\", \"z\"", "2, 3, 4"), "header = false\n"),
            ] {
                for decimal in ["", if mark == "," { "decimal = \",\"\n" } else { "decimal = \".\"\n" }] {
                    let mapping = columns.replace("[time]", &format!("{key}{decimal}[time]"));
                    let text = text(&rows, separator, header, mark);
                    let samples = convert(&text, &mapping).unwrap_or_else(|error| panic!("{error}\n{text}"));
                    assert_eq!(samples, right, "{text}");
                }
            }
        }
    }
    let quoted = "\"t\",\"x\",\"y\",\"z\"\r\n\"0,5\",\"1,25\",\"-2,5\",3\r\n\"0,51\",\"1,5\",2,\"-0,125\"\r\n";
    assert_eq!(convert(quoted, MAPPING).unwrap(), right);
    let skipped = format!("Logger 7, serial 12\n\n{}", text(&rows, ";", true, ","));
    assert_eq!(convert(&skipped, &MAPPING.replace("[time]", "skip = 2\n[time]")).unwrap(), right);
}

fn text(rows: &[[&str; 4]], separator: &str, header: bool, mark: &str) -> String {
    let line = |fields: &[&str; 4]| fields.join(separator).replace('.', mark) + "\n";
    let header = if header { ["t", "x", "y", "z"].join(separator) + "\n" } else { String::new() };
    header + &rows.iter().map(line).collect::<String>()
}

#[test]
fn commas_that_may_be_thousands_separators_are_refused() {
    let text = "t\tx\ty\tz\n1\t1,234\t2\t3\n2\t2,345\t2\t3\n";
    let message = refused(text, &MAPPING.replace("0.01", "1"), Exit::Data);
    assert!(message.starts_with("in.csv:2: 1,234 is 1.234 or 1234"), "{message}");
    let given = MAPPING.replace("[time]", "decimal = \",\"\n[time]").replace("0.01", "1");
    assert_eq!(net(&convert(text, &given).unwrap()[0]), [1_234_000, 2_000_000, 3_000_000, 0, 0, 0]);
    let message = refused("t;x;y;z\n1;1.5;2;3\n", &given, Exit::Data);
    assert!(message.starts_with("in.csv:2: x is \"1.5\", give a number with a decimal comma"), "{message}");
}

/// The offset is the digital zero of the number in the file: it is taken off before the sign of the axis.
#[test]
fn the_offset_is_taken_off_before_the_sign() {
    let mapping = MAPPING.replace("kind", "offset = 32768\nresolution = 2\nsign = [1, -1, -1]\nkind");
    let samples = convert("t,x,y,z\n1,33768,33768,31768\n", &mapping).unwrap();
    assert_eq!(net(&samples[0]), [500, -500, 500, 0, 0, 0]);
    assert_eq!(
        (samples[0].accelerometers.positive_pulses, samples[0].accelerometers.negative_pulses),
        ([500, 0, 500], [0, 500, 0])
    );
}

/// A reading is a rate: over a measured interval its jitter would look like a scale factor.
#[test]
fn readings_count_over_the_nominal_interval_and_increments_over_the_time() {
    let text = "t,x,y,z\n0.010,100,0,0\n0.019,100,0,0\n0.032,100,0,0\n";
    let intervals = |mapping: &str| convert(text, mapping).unwrap().iter().map(|s| s.interval_ns).collect::<Vec<_>>();
    assert_eq!(intervals(MAPPING), [10_000_000; 3]);
    assert_eq!(intervals(&MAPPING.replace("reading", "increment")), [10_000_000, 9_000_000, 13_000_000]);
}

#[test]
fn times_are_exact_in_every_unit() {
    let time_of = |unit: &str, time: &str| {
        let mapping = MAPPING.replace("\"s\"", &format!("{unit:?}"));
        Ok::<_, Failure>(convert(&format!("t,x,y,z\n{time},1,2,3\n"), &mapping)?[0].timestamp_ns)
    };
    for (unit, time, ns) in [
        ("s", "30.02660", 30_026_600_000),
        ("s", "1700000000.123456789", 1_700_000_000_123_456_789),
        ("s", "1.700000000123456789e9", 1_700_000_000_123_456_789),
        ("s", "0.1234567894", 123_456_789),
        ("ns", "340282366920938463463374607431768211455e-38", 3),
        ("ns", "250000000000000000000000000000000000000e-38", 3),
        ("s", "0.00000000050000000000000000000000000001", 1),
        ("ms", "1700000000123.4567", 1_700_000_000_123_456_700),
        ("us", "30026600.5", 30_026_600_500),
        ("ns", "18446744073709551615", u64::MAX),
        ("ns", "1e3", 1000),
        ("ms", "1000e-1", 100_000_000),
    ] {
        assert_eq!(time_of(unit, time).unwrap(), ns, "{time} {unit}");
    }
    for wrong in [
        "-1",
        "",
        "nan",
        "inf",
        "18446744073.709551616",
        "1e99",
        "1e999999999999",
        "340282366920938463463374607431768211455e-10",
        "0x10",
        "12:30",
        "1.2.3",
        "+",
        ".",
    ] {
        let failure = time_of("s", wrong).unwrap_err();
        assert!(failure.message.starts_with("in.csv:2: t is ") && failure.exit == Exit::Data, "{wrong}: {failure}");
    }
    let same = refused("t,x,y,z\n1.01,1,2,3\n1.01,1,2,4\n1.01,1,2,5\n", MAPPING, Exit::Data);
    assert!(same.starts_with("in.csv:2: all stamps of the first 3 rows are 1010000000 ns; give --time rate"), "{same}");
}

#[test]
fn a_broken_line_is_an_error_with_its_number() {
    let good = "t,x,y,z\n0.01,1,2,3\n";
    for (line, message) in [
        ("0.02,1,2", "in.csv:3: 3 fields, but the header has 4; is the row cut?"),
        ("0.02,1,2,3,4", "in.csv:3: 5 fields"),
        ("0.02,1,,3", "in.csv:3: y is \"\", give a number"),
        ("0.02,1,nan,3", "in.csv:3: y is \"nan\", give a number"),
        ("0.02,1,1e999,3", "in.csv:3: y is \"1e999\", give a number"),
        ("0.02,1,ERR,3", "in.csv:3: y is \"ERR\", give a number"),
        ("0.02,1,2.5,3", "in.csv:3: x, y, z: not a whole number, as those of the first row are; give the resolution"),
        ("0.02,1,99999999999,3", "in.csv:3: y: 99999999999 is 99999999999 pulses of 1, over 4294967295"),
        ("0.02,1,\"2,3", "in.csv:3: a quotation mark is not closed"),
    ] {
        let refused = refused(&format!("{good}{line}\n"), MAPPING, Exit::Data);
        assert!(refused.starts_with(message), "{line}: {refused}");
    }
    let rows = MAPPING.replace("[time]", "header = false\n[time]").replace("\"t\"", "1");
    let rows = rows.replace("\"x\", \"y\", \"z\"", "2, 3, 4");
    let message = refused("0.01,1,2,3\n0.02,1,2\n", &rows, Exit::Data);
    assert!(message.starts_with("in.csv:2: 3 fields, but the first row has 4"), "{message}");
    for (empty, message) in
        [("", "there are no data"), ("\n\n", "there are no data"), ("t,x,y,z\n", "there are no rows")]
    {
        assert!(refused(empty, MAPPING, Exit::Data).contains(message), "{empty:?}");
    }
}

#[test]
fn missing_columns_are_answered_with_those_found_and_a_mapping() {
    let text = "time_ms,AccX [m/s2],AccY,AccZ\n10,1.5,2,3\n20,1,2,3\n";
    let message = refused(text, MAPPING, Exit::Data);
    let (message, proposal) = message.split_once("\n\n").unwrap();
    assert_eq!(
        message,
        "in.csv:1: missing columns: t, x, y, z; found: time_ms, AccX [m/s2], AccY, AccZ; a mapping for these columns would be"
    );
    let samples = convert(text, proposal).unwrap();
    assert_eq!((samples[1].timestamp_ns, samples[1].interval_ns), (20_000_000, 10_000_000));
    assert_eq!(net(&samples[0]), [1_500_000, 2_000_000, 3_000_000, 0, 0, 0]);
    let numbers = MAPPING.replace("[time]", "header = false\n[time]").replace("\"t\"", "9");
    let message = refused("1,2,3,4\n2,2,3,4\n", &numbers.replace("\"x\", \"y\", \"z\"", "2, 3, 4"), Exit::Data);
    assert!(message.starts_with("in.csv:1: missing columns: column 9; the row has 4; a mapping"), "{message}");
    assert!(message.contains("header = false") && message.contains("# three of 1, 2, 3, 4\n"), "{message}");
}

#[test]
fn faults_of_the_mapping_are_reported_together() {
    let mapping = MAPPING.replace("interval_s", "intervals_s").replace("\"reading\"", "\"rates\"");
    let message = refused("t,x,y,z\n1,2,3,4\n", &mapping, Exit::Config);
    assert_eq!(message.lines().count(), 2);
    assert!(message.starts_with("m.toml:5: time.intervals_s: unknown key"), "{message}");
    assert!(message.contains("\nm.toml:8: accelerometer.kind: is \"rates\""), "{message}");
}

#[test]
fn temperature_is_of_one_three_or_six_columns_or_a_constant() {
    let of = |temperature: &str, gyroscopes: bool| {
        let gyroscope = "[gyroscope]\ncolumns = [\"d\", \"e\", \"f\"]\nkind = \"reading\"\n";
        let mapping = MAPPING.replace("constant = 25", temperature) + if gyroscopes { gyroscope } else { "" };
        let sample = convert("t,x,y,z,a,b,c,d,e,f\n1,2,3,4,10,11,12,13,14,15\n", &mapping).unwrap()[0];
        [sample.accelerometers, sample.gyroscopes].map(|triad| (triad.head_temperature, triad.board_temperature))
    };
    let same = |triad: [f64; 3]| (triad, triad);
    assert_eq!(of("constant = -3.5", true), [same([-3.5; 3]), same([-3.5; 3])]);
    assert_eq!(of("columns = \"b\"", true), [same([11.0; 3]), same([11.0; 3])]);
    // An IMU without gyroscopes has none: their temperature is NaN.
    let [accelerometers, (head, board)] = of("columns = \"b\"", false);
    assert!(accelerometers == same([11.0; 3]) && head.iter().chain(&board).all(|temperature| temperature.is_nan()));
    assert_eq!(of("columns = [\"c\", \"b\", \"a\"]", true), [same([12.0, 11.0, 10.0]), same([12.0, 11.0, 10.0])]);
    let six = "columns = [\"a\", \"b\", \"c\", \"d\", \"e\", \"f\"]";
    assert_eq!(of(six, true), [same([10.0, 11.0, 12.0]), same([13.0, 14.0, 15.0])]);
    let boards = of("columns = \"a\"\nboard_columns = [\"d\", \"e\", \"f\"]", true);
    assert_eq!(boards, [([10.0; 3], [13.0, 14.0, 15.0]); 2]);
    let settings = Settings { temperature: Some(40.0), ..Settings::default() };
    let given = of_text("t,x,y,z\n1,2,3,4\n", Some(MAPPING), &settings).unwrap().next().unwrap().unwrap();
    assert_eq!(given.accelerometers.head_temperature, [40.0; 3]);
}

/// What is missing is visible in the sequence, as in a recording of Isotherm.
#[test]
fn gaps_are_told_and_leave_gaps_in_the_sequence() {
    let text = "t,x,y,z\n0.01,1,2,3\n0.021,1,2,3\n0.06,1,2,3\n0.07,1,2,3\n0.11,1,2,3\n0.12,1,2,3\n";
    let mut conversion = of_text(text, Some(MAPPING), &Settings::default()).unwrap();
    let sequences: Vec<_> = (&mut conversion).map(|sample| sample.unwrap().sequence).collect();
    assert_eq!(sequences, [0, 1, 5, 6, 10, 11]);
    assert_eq!(
        told(&conversion),
        [
            "warning [missing-rows]: 2 gaps, 6 rows missing by the time, the first before row 3; the sequence rises by them"
        ]
    );
    let wrong = MAPPING.replace("0.01", "0.001");
    let mut conversion = of_text(text, Some(&wrong), &Settings::default()).unwrap();
    assert_eq!((&mut conversion).count(), 6);
    assert!(told(&conversion)[0].ends_with("is 0.001 s right?"), "{:?}", told(&conversion));
    let increments = MAPPING.replace("reading", "increment");
    // A late row has all that was counted since the row before: nothing is missing.
    let mut conversion = of_text(text, Some(&increments), &Settings::default()).unwrap();
    let late: Vec<_> = (&mut conversion).map(|sample| sample.unwrap()).collect();
    let intervals: Vec<_> = late.iter().map(|sample| sample.interval_ns / 1_000_000).collect();
    assert_eq!(intervals, [10, 11, 39, 10, 40, 10]);
    assert_eq!(late.iter().map(|sample| sample.sequence).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
    assert_eq!(
        told(&conversion),
        [
            "warning [time-step]: 2 rows come over 1.5 nominal intervals after the row before, the first is row 3; their counts are taken as \
          those of this whole time"
        ]
    );
    let message = refused("t,x,y,z\n1,1,2,3\n3601.5,1,2,3\n", &increments, Exit::Data);
    assert!(
        message
            .starts_with("in.csv:3: the time steps by 3600500000000 ns, but an increment counts over 3600 s at most"),
        "{message}"
    );
    let far = "t,x,y,z\n1,1,2,3\n18446744073709551615,1,2,3\n";
    let nanoseconds = MAPPING.replace("\"s\"", "\"ns\"").replace("0.01", "0.000001");
    assert_eq!(convert(far, &nanoseconds).unwrap()[1].sequence, 18_446_744_073_709_552);
}

#[test]
fn the_nominal_interval_is_found_or_the_rows_are_counted() {
    let without = MAPPING.replace("interval_s = 0.01\n", "");
    let of = |text: &str, mapping: &str| {
        let mut conversion = of_text(text, Some(mapping), &Settings::default()).unwrap();
        let sample = (&mut conversion).last().unwrap().unwrap();
        (sample.interval_ns, sample.timestamp_ns, told(&conversion))
    };
    let rows =
        |times: &[&str]| format!("t,x,y,z\n{}", times.iter().map(|t| format!("{t},1,2,3\n")).collect::<String>());
    for (times, ns) in [
        (["1", "1.00798", "1.01601"], 8_000_000),
        (["1", "1.0333", "1.0667"], 33_333_333),
        (["10", "20.01", "29.99"], 10_000_000_000),
        (["1", "1.7", "2.4"], 700_000_000),
    ] {
        let (interval_ns, _, notes) = of(&rows(&times), &without);
        assert_eq!(interval_ns, ns, "{times:?}");
        assert!(notes[0].contains("found from the first 3 rows;"), "{notes:?}");
    }
    let message = refused(&rows(&["1"]), &without, Exit::Data);
    assert!(message.starts_with("in.csv:2: the nominal interval cannot be found"), "{message}");
    let counted = MAPPING.replace("column = \"t\"\nunit = \"s\"\n", "");
    assert_eq!(of("x,y,z\n1,2,3\n1,2,3\n", &counted), (10_000_000, 20_000_000, vec![]));
    let settings = Settings { interval_ns: Some(5_000_000), ..Settings::default() };
    let given = of_text(&rows(&["1", "1.005"]), Some(MAPPING), &settings).unwrap().last().unwrap().unwrap();
    assert_eq!(given.interval_ns, 5_000_000);
}

/// An interval that is not that of the rows scales all data: half of it is every rate twice.
#[test]
fn an_interval_that_is_not_that_of_the_rows_is_told() {
    let rows = |step_ns: u64| {
        (0..1000).map(|row| format!("{},1,2,3\n", row * step_ns)).fold("t,x,y,z\n".to_owned(), |all, row| all + &row)
    };
    let mapping = MAPPING.replace("\"s\"", "\"ns\"");
    let notes = |step_ns: u64, mapping: &str| {
        let mut conversion = of_text(&rows(step_ns), Some(mapping), &Settings::default()).unwrap();
        let intervals: Vec<_> = (&mut conversion).map(|sample| sample.unwrap().interval_ns).collect();
        (intervals[0], told(&conversion))
    };
    let warning =
        "warning [interval]: rows are 5 ms apart on average, but the interval is 10 ms; correct interval_s".to_owned();
    assert_eq!(notes(5_000_000, &mapping), (10_000_000, vec![warning]));
    assert_eq!(notes(10_000_500, &mapping), (10_000_000, vec![]));
    let (_, rounded) = notes(2_401_537, &mapping.replace("0.01", "0.002403846"));
    assert!(rounded[0].starts_with("warning [interval]: rows are 2.401537 ms apart on average"), "{rounded:?}");
    let (found, told) = notes(2_401_537, &mapping.replace("interval_s = 0.01\n", ""));
    assert_eq!((found, told.len()), (2_401_537, 1));
    assert!(told[0].contains("0.002401537 s, found from the first 1000 rows"), "{told:?}");
}

#[test]
fn formats_that_are_not_converted_are_refused_with_a_remedy() {
    for (bytes, remedy) in [
        (&b"SQLite format 3\0\x10\0"[..], "convert it to MCAP: ros2 bag convert"),
        (b"#ROSBAG V2.0\n", "convert it to MCAP: mcap convert"),
        (b"PAR1\x15\x04", "pandas.read_parquet"),
        (b"\xaa\x44\x13\x28", "RAWIMUSXA"),
        (b"\x1f\x8b\x08", "zcat"),
        (b"PK\x03\x04", "save it as CSV"),
        (b"\xff\xfet\0", "save it as UTF-8"),
        (b"\xb5\x62\x10\x03\x04\0\x01\x02\x03\x04\xaa\xbb", "UBX of u-blox; make CSV"),
        (b"$GNGGA,1*00\r\n\xb5\x62\x10\x03\x01\0\x01\xaa\xbb\xb5\x62\x10\x03\x01\0", "with pyubx2"),
        (b"$@\x12\x34\xd2\x0f", "SBF Converter of RxTools"),
        (b"\xff\x5a\x03\0\x3a\0", "sbgBasicLogger -i FILE -w --dir=FOLDER"),
        (b"\xfa\xff\x36\x10", "export them as ASCII with MT Manager"),
        (b"$IMURAW\0\0", "offset=512)], '%.9f', ',')\""),
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "s.loadmat('IN.mat')['NAME']"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64", "h5py.File('IN.mat')['NAME'][()].T"),
        (b"\x89HDF\r\n\x1a\n\0", "h5py.File('IN.h5')['NAME'][()], "),
        (b"\x93NUMPY\x01\0", "n.load('IN.npy'), "),
        (b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x07\0\0\0acc.npy", "n.load('IN.npz')['NAME']"),
        (b"\xd4\xc3\xb2\xa1\x02\0\x04\0", "tshark -r FILE"),
        (b"\x0a\x0d\x0d\x0a\x1c\0\0\0", "tshark -r FILE"),
        (b"\x28\xb5\x2f\xfd\x04", "zstd -dc FILE"),
        (b"\xfd7zXZ\0\0", "xzcat FILE"),
        (b"BZh91AY", "bzcat FILE"),
        (b"\x04\x22\x4d\x18", "lz4 -dc FILE"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("in");
        fs::write(&path, bytes).unwrap();
        for mapping in [None, Some(data("mapping.toml"))] {
            let text = mapping.as_ref().map(|mapping| fs::read_to_string(mapping).unwrap());
            let named = mapping.as_deref().zip(text.as_deref());
            let failure = Conversion::open(&source(&path), named, &Settings::default()).err().unwrap();
            assert_eq!(failure.exit, Exit::Data);
            assert!(failure.message.contains(remedy), "{failure}");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let failure = Conversion::open(&source(folder.path()), None, &Settings::default()).err().unwrap();
    assert!(failure.message.contains("name the .mcap file in it"), "{failure}");
    let failure = Conversion::open(&source(folder.path().join("none")), None, &Settings::default()).err().unwrap();
    assert_eq!(failure.exit, Exit::Io);
}

/// Every prefix of real data, and data with a byte that is wrong, are converted or refused as bad data.
#[test]
fn no_text_makes_it_panic() {
    let source = fs::read(data("source.csv")).unwrap();
    let mapping = fs::read_to_string(data("mapping.toml")).unwrap();
    let novatel = "%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,607017,-1009773*1fb76c28\n";
    let check = |bytes: Vec<u8>| {
        for mapping in [None, Some((Path::new("m"), mapping.as_str())), Some((Path::new("m"), "format = 1\n"))] {
            let conversion =
                Conversion::of_text(Path::new("in"), Cursor::new(bytes.clone()), mapping, &Settings::default());
            if let Err(failure) = conversion.and_then(|conversion| conversion.collect::<Result<Vec<_>, _>>()) {
                assert!([Exit::Data, Exit::Usage, Exit::Config].contains(&failure.exit), "{failure}");
            }
        }
    };
    for source in [&source[..400], novatel.as_bytes()] {
        for length in 0..source.len() {
            check(source[..length].to_vec());
        }
        for place in 0..source.len() {
            // Two of them a place, and in the nightly run all.
            let wrong = [0, b'\n', b',', b'"', b'-', b'.', b'e', 0xff];
            let first = place % 4 * 2;
            let all = std::env::var_os("ISOTHERM_NIGHTLY").is_some();
            for wrong in wrong.into_iter().skip(if all { 0 } else { first }).take(if all { 8 } else { 2 }) {
                let mut bytes = source.to_vec();
                bytes[place] = wrong;
                check(bytes);
            }
        }
    }
}

/// Findings and notes of a conversion, a line each.
fn told(conversion: &Conversion) -> Vec<String> {
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    findings.chain(conversion.notes()).collect()
}
