//! Rows of texts as programs write them: what stands around the rows, and rows that are spoilt.

use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\ninterval_s = 0.01\n[accelerometer]\n\
     columns = [\"ax\", \"ay\", \"az\"]\nkind = \"reading\"\nresolution = 1e-6\n[temperature]\ncolumns = \"temp\"\n";
const NUMBERS: &str = "format = 1\nheader = false\n[time]\ncolumn = 1\nunit = \"s\"\ninterval_s = 0.01\n[accelerometer]\n\
     columns = [2, 3, 4]\nkind = \"reading\"\nresolution = 1e-6\n[temperature]\ncolumns = 5\n";

fn convert(text: &[u8], mapping: &str) -> Result<(Vec<RawSample>, Vec<String>), Failure> {
    let mapping = Some((Path::new("m.toml"), mapping));
    let mut conversion =
        Conversion::of_text(Path::new("in"), Cursor::new(text.to_vec()), mapping, &Settings::default())?;
    let samples = (&mut conversion).collect::<Result<_, _>>()?;
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    let told = findings.chain(conversion.notes()).collect();
    Ok((samples, told))
}

fn refused(text: &[u8], mapping: &str) -> String {
    let failure = convert(text, mapping).unwrap_err();
    assert_eq!(failure.exit, Exit::Data, "{failure}");
    failure.message
}

/// The mapping that is found for a text, completed with these units.
fn completed(text: &str) -> String {
    let read = Conversion::of_text(Path::new("in"), Cursor::new(text.to_owned()), None, &Settings::default());
    let told = read.map_or_else(|failure| failure.message, |conversion| conversion.notes().concat());
    let mapping = told.split_once("\n\n").unwrap_or_else(|| panic!("{told}")).1;
    let mapping = mapping.replacen("unit = \"?\"", "unit = \"s\"\ninterval_s = 0.01", 1);
    mapping.replace("unit = \"?\"", "unit = \"m/s2\"")
}

/// The numbers of a row, from 0: none of them is exact in binary.
fn numbers(row: usize) -> [String; 5] {
    let hundredths = row + 101;
    let of = |value: usize| format!("{}.{:03}", value / 1000, value % 1000);
    [
        format!("{}.{:02}", hundredths / 100, hundredths % 100),
        of(301 + row % 7),
        format!("-{}", of(107 + row % 11)),
        of(9803 + row % 5),
        format!("2{}.{}", row % 9, 1 + row % 8),
    ]
}

/// Rows of [`numbers`], with their ends.
fn rows(count: usize, separator: &str, end: &str) -> String {
    (0..count).map(|row| numbers(row).join(separator) + end).collect()
}

/// Fails unless the sample has the numbers of this row.
fn check(sample: &RawSample, row: usize) {
    let [time, ax, ay, az, temperature] = numbers(row);
    let thousandths = |text: &str| (text.replace(['.', '-'], "")).parse::<u32>().unwrap();
    let a = &sample.accelerometers;
    assert_eq!(sample.timestamp_ns, u64::from(thousandths(&time)) * 10_000_000);
    assert_eq!(a.positive_pulses, [thousandths(&ax) * 1000, 0, thousandths(&az) * 1000]);
    assert_eq!(a.negative_pulses, [0, thousandths(&ay) * 1000, 0]);
    assert_eq!(a.head_temperature, [temperature.parse::<f64>().unwrap(); 3]);
}

/// Fails unless these rows come out, and only these are reported.
fn all(text: &str, mapping: &str, count: usize, told: &[&str]) {
    let (samples, found) = convert(text.as_bytes(), mapping).unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert_eq!(samples.len(), count, "{text}");
    samples.iter().enumerate().for_each(|(row, sample)| check(sample, row));
    assert_eq!(found, told, "{text}");
}

#[test]
fn rows_and_header_may_end_in_a_separator() {
    for separator in [",", ";", "\t", ", "] {
        let names = ["t", "ax", "ay", "az", "temp"].join(separator);
        for end in ["\n", "\r\n"] {
            let with = format!("{}{end}", separator.trim_end_matches(' '));
            for (of_header, of_rows) in [(&with[..], &with[..]), (end, &with), (&with, end)] {
                let text = format!("{names}{of_header}{}", rows(20, separator, of_rows));
                all(&text, MAPPING, 20, &[]);
                all(&text, &completed(&text), 20, &[]);
            }
            let text = rows(20, separator, &with);
            all(&text, NUMBERS, 20, &[]);
        }
    }
}

#[test]
fn blanks_of_any_number_separate_and_quotes_and_marks_of_the_beginning_are_none_of_a_name() {
    let spaces = rows(20, "   ", " \n").replacen("   ", " \t ", 3);
    all(&format!("  t ax\t ay   az temp\n{spaces}"), MAPPING, 20, &[]);
    // Columns that are filled up with tabs.
    all(&format!("t\tax\t\tay\t\taz\ttemp\n{}", rows(20, "\t", "\n")), MAPPING, 20, &[]);
    let quoted = format!("\u{feff}\"t\",\"ax\",\"ay\",\"az\",\"temp\"\r\n{}", rows(20, ",", "\r\n"));
    all(&quoted, MAPPING, 20, &[]);
    let comma = MAPPING.replace("\"ax\"", "\"ax, forward\"");
    all(&quoted.replace("\"ax\"", "\"ax, forward\""), &comma, 20, &[]);
}

#[test]
fn units_in_a_second_line_are_appended_to_the_names() {
    for (units, appended) in [
        ("s,m/s2,m/s2,m/s2,degC", "ax [m/s2]"),
        ("[s],[m/s^2],[m/s^2],[m/s^2],[\u{b0}C]", "ax [m/s^2]"),
        ("(s),(g),(g),(g),", "ax [g]"),
    ] {
        let text = format!("t,ax,ay,az,temp\n{units}\n{}", rows(20, ",", "\n"));
        let proposal = completed(&text);
        assert!(proposal.contains(&format!("\"{appended}\"")) && proposal.contains("\"t [s]\""), "{proposal}");
        // A mapping of names without them is as good.
        let told: &[&str] = match appended {
            "ax [g]" => &["accelerometer: the unit is g, as the header says"],
            _ => &[],
        };
        all(&text, MAPPING, 20, told);
        all(&text, &MAPPING.replace("\"ax\"", &format!("\"{appended}\"")), 20, told);
    }
    // A row of numbers is none of units, nor are names.
    let text = format!("t,ax,ay,az,temp\n{}", rows(20, ",", "\n"));
    assert!(completed(&text).contains("column = \"t\"\n"));
}

#[test]
fn names_in_a_comment_are_found_with_their_own_separator() {
    for (header, separator) in [
        ("# t ax ay az temp", " "),
        ("% t, ax, ay, az, temp", " "),
        ("// t ax ay az temp", ","),
        ("#t,ax,ay,az,temp", ","),
        ("## made by a logger\n#\n# t;ax;ay;az;temp\n# 100 Hz", ";"),
    ] {
        let text = format!("{header}\n{}", rows(20, separator, "\n"));
        let (samples, _) = convert(text.as_bytes(), MAPPING).unwrap();
        samples.iter().enumerate().for_each(|(row, sample)| check(sample, row));
        assert_eq!(samples.len(), 20);
        let proposal = completed(&text);
        assert!(proposal.contains("[\"ax\", \"ay\", \"az\"]") && proposal.contains("column = \"t\""), "{proposal}");
        assert_eq!(convert(text.as_bytes(), &proposal).unwrap().0, samples);
    }
    // A mapping may have the sign of the comment in the name.
    let text = format!("#t,ax,ay,az,temp\n{}", rows(20, ",", "\n"));
    all(&text, &MAPPING.replace("\"t\"", "\"#t\""), 20, &[]);
}

#[test]
fn names_with_blanks_do_not_make_blanks_the_separator() {
    let names = "#timestamp [ns],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2],temp [deg C]";
    let text = format!("{names}\n{}", rows(20, ",", "\n"));
    let message = refused(text.as_bytes(), MAPPING);
    let found = "found: timestamp [ns], a_RS_S_x [m s^-2], a_RS_S_y [m s^-2], a_RS_S_z [m s^-2], temp [deg C];";
    assert!(
        message.starts_with("in:1: missing columns: t, ax, ay, az, temp; ") && message.contains(found),
        "{message}"
    );
    let names = MAPPING.replace("\"t\"", "\"#timestamp [ns]\"").replace("\"temp\"", "\"temp [deg C]\"");
    let names = ["x", "y", "z"]
        .iter()
        .fold(names, |all, axis| all.replace(&format!("\"a{axis}\""), &format!("\"a_RS_S_{axis} [m s^-2]\"")));
    all(&text, &names, 20, &[]);
}

/// A row with its checksum of NMEA.
fn sealed(row: &str) -> String {
    let sum = row.bytes().skip(1).fold(0, |sum, byte| sum ^ byte);
    format!("{row}*{sum:02X}\r\n")
}

#[test]
fn checksums_are_checked_or_cut_off_and_words_before_the_numbers_are_no_header() {
    let row = |row: usize| sealed(&format!("$VNYMR,{}", numbers(row).join(",")));
    let text: String = (0..40).map(row).collect();
    let mapping = NUMBERS.replace("column = 1", "column = 2").replace("[2, 3, 4]", "[3, 4, 5]");
    let mapping = mapping.replace("columns = 5", "columns = 6");
    all(&text, &mapping, 40, &[]);
    let proposal = completed(&text);
    assert!(proposal.contains("header = false") && !proposal.contains("VNYMR"), "{proposal}");
    // A digit that is another one, and a row whose end is lost.
    let spoilt = text.replacen("1.25,", "1.26,", 1);
    let (samples, told) = convert(spoilt.as_bytes(), &mapping).unwrap();
    assert_eq!(samples.len(), 39);
    let bad =
        "warning [bad-rows]: 1 row is left out of 40: 1 with a wrong checksum; the first is line 25: the checksum is";
    assert!(told[0].starts_with(bad), "{told:?}");
    // Other checksums are no numbers, and not checked.
    let other: String = (0..40).map(|row| format!("{}*{:02x}\n", numbers(row).join(","), row + 1)).collect();
    all(&other, NUMBERS, 40, &[]);
}

#[test]
fn what_stands_above_the_table_is_passed_over_and_told() {
    let boot = "SD card online\nserial 12, rev 3\n\nIMU online\n";
    let numbered = format!("{boot}{}", rows(20, ",", ",\r\n"));
    let told = |what: &str| format!("{what} is line 5; what stands above it is passed over, 3 lines");
    all(&numbered, NUMBERS, 20, &[&told("the first row")]);
    all(&numbered, &NUMBERS.replace("header", "skip = 4\nheader"), 20, &[]);
    let named = format!("{boot}t,ax,ay,az,temp\n{}", rows(20, ",", "\n"));
    all(&named, MAPPING, 20, &[&told("the header")]);
    all(&named, &MAPPING.replace("[time]", "skip = 4\n[time]"), 20, &[]);
    all(&named, &completed(&named), 20, &[]);
    // The first row of a serial port is cut.
    let cut = format!("3,9.8,21.1\n{}", rows(20, ",", "\n"));
    all(&cut, NUMBERS, 20, &["the first row is line 2; what stands above it is passed over, 1 lines"]);
    assert!(completed(&cut).contains("skip = 1\nheader = false"));
    // Nothing that is far above.
    let far = format!("{}t,ax,ay,az,temp\n{}", "boot\n".repeat(100), rows(20, ",", "\n"));
    assert!(refused(far.as_bytes(), MAPPING).contains("missing columns"));
}

#[test]
fn lines_between_the_rows_that_are_none_are_passed_over() {
    let part = |from: usize, to: usize| (from..to).map(|row| numbers(row).join(",") + "\n").collect::<String>();
    let head = "IMU online\nt,ax,ay,az,temp\ns,m/s2,m/s2,m/s2,degC\n";
    let text = format!("{head}{}# paused\n\n,,,,\n{}{head}{}\n,,,,\n\n", part(0, 10), part(10, 20), part(20, 30));
    let above = "the header is line 2; what stands above it is passed over, 1 lines";
    all(&text, MAPPING, 30, &[above, "6 lines between the rows are not rows, as comments"]);
}

#[test]
fn a_few_spoilt_rows_are_left_out_and_counted_by_kind() {
    let mut lines = vec![b"t,ax,ay,az,temp".to_vec()];
    lines.extend((0..600).map(|row| numbers(row).join(",").into_bytes()));
    for (line, spoilt) in [
        (3, &b"1.03,0.30"[..]),
        (50, b"1.50,0.301,-0.107,9.803-0.107,21.1"),
        (300, b"4.00,0.301,,9.803,21.1"),
        (301, b"4.01,0.301,-0.107,9.803,nan"),
        (402, b"\0\0\0\0\0\0\0\0"),
        (500, b"6.00,0.301,-0.107,98030000000,21.1"),
    ] {
        lines[line] = spoilt.to_vec();
    }
    let (samples, told) = convert(&lines.join(&b'\n'), MAPPING).unwrap();
    assert_eq!(samples.len(), 594);
    for sample in &samples {
        check(sample, (sample.timestamp_ns / 10_000_000) as usize - 101);
    }
    let bad = "warning [bad-rows]: 6 rows are left out of 600: 2 with another number of fields, 1 with a field that is not a \
               number, 2 with a missing value, 1 with a number over the range; the first is line 4: 2 fields, but the \
               header has 5; is the row cut?";
    assert!(told.contains(&bad.to_owned()), "{told:?}");
    assert!(told.iter().any(|line| line.contains("5 gaps, 6 rows missing by the time")), "{told:?}");
    // One more is over 1 %.
    lines[550] = b"cut".to_vec();
    assert_eq!(
        refused(&lines.join(&b'\n'), MAPPING),
        "in:4: 2 fields, but the header has 5; is the row cut?; 7 of the 600 rows are bad (3 with another number of \
         fields, 1 with a field that is not a number, 2 with a missing value, 1 with a number over the range), and at \
         most 1 % are left out: correct the mapping if it does not fit them, otherwise take them out of the text"
    );
}

/// A text that does not fit its mapping is not read to its end.
#[test]
fn a_text_of_bad_rows_is_refused_at_the_first_opportunity() {
    let spoilt = |rows: usize| format!("t,ax,ay,az,temp\n{}", "1,2,3,x,5\n".repeat(rows));
    for rows in [1, 50, 100_000] {
        assert_eq!(refused(spoilt(rows).as_bytes(), MAPPING), "in:2: az is \"x\", give a number");
    }
    let endless = spoilt(500) + &"\"".repeat(200_000);
    assert!(refused(endless.as_bytes(), MAPPING).starts_with("in:2: az is \"x\""));
    let good = rows(30, ",", "\n");
    let message = refused(format!("t,ax,ay,az,temp\n{good}{}", "1,2,3\n".repeat(100_000)).as_bytes(), MAPPING);
    assert!(message.contains("; 101 of the first 131 rows are bad (101 with another number of fields)"), "{message}");
}

/// Without a column of the time the rows are counted: one that is left out takes its time with it.
#[test]
fn a_bad_row_without_a_time_leaves_its_place() {
    let mut lines: Vec<_> = (0..20).map(|row| numbers(row).join(",")).collect();
    lines[7] = "1,2".to_owned();
    let mapping = NUMBERS.replace("column = 1\nunit = \"s\"\n", "");
    let (samples, told) = convert(lines.join("\n").as_bytes(), &mapping).unwrap();
    let times: Vec<_> = samples.iter().map(|sample| sample.timestamp_ns / 10_000_000).collect();
    assert_eq!(times, (1..=20).filter(|time| *time != 8).collect::<Vec<_>>());
    assert_eq!((samples[6].sequence, samples[7].sequence), (6, 8));
    assert!(told[0].contains("the first is line 8: 2 fields, but the first row has 5"), "{told:?}");
}

/// A generator of numbers, each from the one before.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % limit
    }
}

/// Whatever is spoilt, all good rows come out with their values, and the others are counted.
#[test]
fn good_rows_of_random_texts_are_exact() {
    let mut random = Random(51);
    for text in 0..300 {
        let count = 20 + random.below(400);
        let separator = [",", ";", "\t", " ", "  ", ", "][random.below(6)];
        let end = ["\n", "\r\n"][random.below(2)];
        let is_named = random.below(2) == 0;
        let mut spoilt = vec![false; count];
        for _ in 0..random.below((count / 100).max(1) + 1) {
            spoilt[random.below(count)] = true;
        }
        let names = ["t", "ax", "ay", "az", "temp"].join(separator) + end;
        let mut bytes = ["", "boot\n", "# a comment\n"][random.below(3)].as_bytes().to_vec();
        if is_named {
            bytes.extend(names.as_bytes());
        }
        // The first row without a header is the one that is searched.
        spoilt[0] &= is_named;
        for (row, is_spoilt) in spoilt.iter().enumerate() {
            let mut fields = numbers(row).to_vec();
            let field = random.below(5);
            let mut line = String::new();
            match (is_spoilt, random.below(6)) {
                (false, _) => {}
                (true, 0) => fields.truncate(1 + field % 4),
                (true, 1) => fields[field] = "ERR".to_owned(),
                (true, 2) => fields[field].push_str("-0.5"),
                (true, 3) => fields[1 + field % 4] = "nan".to_owned(),
                (true, 4) => fields[field].insert(0, '\0'),
                (true, _) => fields.push("0.25".to_owned()),
            }
            write!(line, "{}{end}", fields.join(separator)).unwrap();
            bytes.extend(line.as_bytes());
        }
        let (samples, told) = convert(&bytes, if is_named { MAPPING } else { NUMBERS })
            .unwrap_or_else(|error| panic!("{text}: {error}\n{}", String::from_utf8_lossy(&bytes)));
        let good: Vec<_> = (0..count).filter(|row| !spoilt[*row]).collect();
        assert_eq!(samples.len(), good.len(), "{text}: {told:?}");
        samples.iter().zip(&good).for_each(|(sample, row)| check(sample, *row));
        let bad = count - good.len();
        let finding = told.iter().find(|line| line.contains("[bad-rows]"));
        let expected = format!("{bad} {} left out of {count}: ", if bad == 1 { "row is" } else { "rows are" });
        assert_eq!(finding.is_some_and(|line| line.contains(&expected)), bad > 0, "{text}: {told:?}");
    }
}
