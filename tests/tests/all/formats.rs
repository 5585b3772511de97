//! One recording in every format and in pieces: each command that reads recordings gives the same result.
//!
//! The tests write the files with the library of each format, as other programs do.
//!
//! Over 400 lines: every test needs these writers.

use isotherm_tests::{RUN, TABLE, TestDomain, WHOLE_TABLE, text};
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;

const WHOLE_RUN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/run-g.csv");
const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// The column names and rows of a CSV file.
struct CsvContent {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl CsvContent {
    fn of(csv: &str) -> Self {
        let mut rows = csv.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        Self { names: rows.next().unwrap(), rows: rows.collect() }
    }

    /// A range of the rows.
    fn part(&self, from: usize, to: usize) -> Self {
        Self { names: self.names.clone(), rows: self.rows[from..to].to_vec() }
    }

    /// Whether all values of a column are whole numbers.
    fn is_integer(&self, column: usize) -> bool {
        self.rows.iter().all(|row| row[column].is_empty() || row[column].parse::<i64>().is_ok())
    }

    /// Whether a column has texts.
    fn is_text(&self, column: usize) -> bool {
        self.names[column] == "device"
    }

    /// The same rows without these columns.
    fn without(&self, names: &[&str]) -> Self {
        let kept = |column: &usize| !names.contains(&self.names[*column].as_str());
        let select =
            |fields: &[String]| (0..self.names.len()).filter(kept).map(|column| fields[column].clone()).collect();
        Self { names: select(&self.names), rows: self.rows.iter().map(|row| select(row)).collect() }
    }

    fn write(&self, path: &Path) {
        match path.extension().unwrap().to_str().unwrap() {
            "csv" => self.write_csv(path),
            "mcap" => self.write_mcap(path),
            other => panic!("{other}"),
        }
    }

    fn write_csv(&self, path: &Path) {
        let lines = [&self.names].into_iter().chain(&self.rows);
        fs::write(path, lines.map(|fields| fields.join(",") + "\n").collect::<String>()).unwrap();
    }

    /// Each row is a protobuf message: string for texts, int64 for columns of whole numbers, otherwise double, and no
    /// field for an empty value.
    fn write_mcap(&self, path: &Path) {
        let (mut fields, mut descriptor) = (Vec::new(), Vec::new());
        for (name, number) in self.names.iter().zip(1..) {
            let kind = match (self.is_text(number as usize - 1), self.is_integer(number as usize - 1)) {
                (true, _) => 9,
                (false, true) => 3,
                (false, false) => 1,
            };
            let mut field = Vec::new();
            bytes(&mut field, 1, name.as_bytes());
            for (key, value) in [(3, number), (4, 1), (5, kind)] {
                varint(&mut field, key << 3);
                varint(&mut field, value);
            }
            bytes(&mut fields, 2, &field);
        }
        bytes(&mut descriptor, 1, b"Row");
        descriptor.extend(fields);
        let mut file = Vec::new();
        bytes(&mut file, 1, b"row.proto");
        bytes(&mut file, 2, b"lab");
        bytes(&mut file, 4, &descriptor);
        let mut set = Vec::new();
        bytes(&mut set, 1, &file);

        let mut writer = mcap::Writer::new(File::create(path).unwrap()).unwrap();
        let schema = writer.add_schema("lab.Row", "protobuf", &set).unwrap();
        let channel_id = writer.add_channel(schema, "isotherm/imu-a/raw", "protobuf", &BTreeMap::new()).unwrap();
        for (row, time) in self.rows.iter().zip(0..) {
            let mut message = Vec::new();
            for (column, value) in row.iter().enumerate().filter(|(_, value)| !value.is_empty()) {
                let number = column as u64 + 1;
                if self.is_text(column) {
                    bytes(&mut message, number, value.as_bytes());
                } else if self.is_integer(column) {
                    varint(&mut message, number << 3);
                    varint(&mut message, value.parse::<i64>().unwrap().cast_unsigned());
                } else {
                    varint(&mut message, number << 3 | 1);
                    message.extend(value.parse::<f64>().unwrap().to_le_bytes());
                }
            }
            let header = MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
        writer.finish().unwrap();
    }
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value > 0x7f {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn bytes(out: &mut Vec<u8>, number: u64, value: &[u8]) {
    varint(out, number << 3 | 2);
    varint(out, value.len() as u64);
    out.extend_from_slice(value);
}

/// Writes a recording as a whole in each format, and in three pieces of both formats. Returns the equivalent lists of
/// files.
fn variants(domain: &TestDomain, csv: &str) -> Vec<Vec<&'static str>> {
    let all = CsvContent::of(csv);
    for name in ["whole.csv", "whole.mcap"] {
        all.write(&domain.path(name));
    }
    let third = all.rows.len() / 3;
    let pieces = [("b.csv", 0, third), ("c.mcap", third, 2 * third), ("a.csv", 2 * third, all.rows.len())];
    for (name, from, to) in pieces {
        all.part(from, to).write(&domain.path(name));
    }
    vec![
        vec!["whole.csv"],
        vec!["whole.mcap"],
        vec!["b.csv", "c.mcap", "a.csv"],
        vec!["a.csv", "b.csv", "c.mcap"],
        vec!["c.mcap", "a.csv", "b.csv"],
    ]
}

/// Asserts that a command prints the same for all these lists of files.
fn assert_alike(domain: &TestDomain, variants: &[Vec<&str>], command: &[&str]) {
    let printed: Vec<_> = variants.iter().map(|files| domain.run_ok(&[command, files].concat())).collect();
    assert!(printed[0].lines().count() > 3, "{}", printed[0]);
    for (files, printed_now) in variants.iter().zip(&printed) {
        assert!(*printed_now == printed[0], "{command:?} {files:?}:\n{}\n{printed_now}", printed[0]);
    }
}

#[test]
fn replay_verify_and_feed_read_every_format_and_pieces_in_any_order() {
    let domain = TestDomain::new();
    let run = fs::read_to_string(RUN).unwrap();
    let variants = variants(&domain, &run.lines().take(1201).map(|line| format!("{line}\n")).collect::<String>());
    let service = domain.serve_recording();
    assert_alike(&domain, &variants, &["replay", "--table", "imu-a.toml"]);
    assert_alike(&domain, &variants, &["verify", "--table", "imu-a.toml", "--window", "1"]);
    assert_alike(&domain, &variants, &["feed", "--imu", "imu-a"]);
    service.terminate();
}

#[test]
fn calibrate_reads_every_format_and_pieces_in_any_order() {
    let domain = TestDomain::new();
    let campaign = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    let campaign = campaign.replace("imu-paper", "imu-a");
    let variants = variants(&domain, &fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap());
    let mut tables = Vec::new();
    for files in &variants {
        // The files are named in the campaign file, then on the command line.
        domain.write("campaign.toml", &campaign.replace("\"samples.csv\"", &format!("{files:?}")));
        let named = domain.run_ok(&["calibrate", "turntable", "campaign.toml", "-o", "-"]);
        domain.write("campaign.toml", &campaign);
        let given = domain.run_ok(&[&["calibrate", "turntable", "campaign.toml", "-o", "-"], &files[..]].concat());
        let content =
            |table: &str| table[table.find("[[axis]]").unwrap()..table.find("[provenance]").unwrap()].to_owned();
        assert_eq!(content(&named), content(&given), "{files:?}");
        tables.push(content(&given));
    }
    assert!(tables[0].matches("[[axis]]").count() == 3, "{}", tables[0]);
    for (files, table) in variants.iter().zip(&tables) {
        assert!(*table == tables[0], "{files:?}:\n{}\n{table}", tables[0]);
    }
}

#[test]
fn regress_reads_every_format_and_pieces_in_any_order() {
    let domain = TestDomain::new();
    let variants = variants(&domain, &fs::read_to_string(format!("{EXAMPLES}/cubic.csv")).unwrap());
    // Rows without a time are read in the order of the arguments. The fit does not depend on it.
    assert_alike(&domain, &variants, &["regress", "--x", "x", "--y", "y"]);
    assert_alike(&domain, &variants, &["regress", "--x", "x", "--y", "y-x"]);
}

#[test]
fn a_fault_is_reported_with_the_piece_that_has_it() {
    let domain = TestDomain::new();
    let run = CsvContent::of(&fs::read_to_string(RUN).unwrap());
    let service = domain.serve_recording();
    run.part(0, 500).write(&domain.path("one.mcap"));
    run.part(500, 1000).write(&domain.path("two.csv"));
    run.part(900, 1400).write(&domain.path("over.csv"));
    let mut lacking = run.part(1000, 1500);
    lacking.names[2] = "interval".to_owned();
    for name in ["lacking.csv", "lacking.mcap"] {
        lacking.write(&domain.path(name));
    }
    let columns = "missing columns: interval_ns; found: sequence, timestamp_ns, interval, a1_positive";
    for (files, code, cause) in [
        (&["two.csv", "one.mcap", "./two.csv"][..], 64, "./two.csv is named twice; name every piece once"),
        (&["two.csv", "-"], 64, "pieces of a recording must be files; a pipe is read by itself"),
        (&["over.csv", "one.mcap", "two.csv"], 65, "over.csv: its first row, of "),
        (&["two.csv", "none.csv"], 74, "opening none.csv: "),
        (&["lacking.csv", "two.csv"], 65, columns),
        (&["lacking.mcap"], 65, "missing columns: interval_ns; found: "),
    ] {
        for command in [
            &["replay", "--table", "imu-a.toml"][..],
            &["verify", "--table", "imu-a.toml"],
            &["feed", "--imu", "imu-a", "--timeout", "20"],
        ] {
            assert_refused(&domain, &[command, files].concat(), code, cause);
        }
    }
    service.terminate();
}

/// Asserts that a command fails with this exit code and a message that contains `cause`.
fn assert_refused(domain: &TestDomain, arguments: &[&str], code: i32, cause: &str) {
    let output = domain.run(arguments);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
    assert!(stderr.contains(cause), "{arguments:?}: {stderr}, not {cause}");
}

/// The column with this name.
fn column(content: &CsvContent, name: &str) -> usize {
    content.names.iter().position(|other| other == name).unwrap()
}

/// Writes a third of the rows as `one.mcap` and a third as `three.mcap`. The third between them is returned.
fn outer_thirds(domain: &TestDomain, csv: &str) -> CsvContent {
    let all = CsvContent::of(csv);
    let third = all.rows.len() / 3;
    all.part(0, third).write(&domain.path("one.mcap"));
    all.part(2 * third, all.rows.len()).write(&domain.path("three.mcap"));
    all.part(third, 2 * third)
}

#[test]
fn calibrate_reports_a_fault_with_the_piece_that_has_it() {
    let domain = TestDomain::new();
    let campaign = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    let samples = fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap();
    let middle = outer_thirds(&domain, &samples);
    domain.write("campaign.toml", &campaign.replace("imu-paper", "imu-a"));
    for (name, value, piece, cause) in [
        // A position that the campaign file does not have, and a temperature unlike the others.
        ("position", "99", "bad.csv", "bad.csv:9: set point 0 degC, position 99: no such position"),
        ("a1_head", "9.9", "bad.csv", "bad.csv:9: set point 0 degC, position 1: a1_head runs from "),
        ("a1_head", "9.9", "bad.mcap", "bad.mcap: message 8: set point 0 degC, position 1: a1_head runs from "),
    ] {
        let mut bad = middle.part(0, middle.rows.len());
        let column = column(&bad, name);
        bad.rows[7][column] = value.to_owned();
        bad.write(&domain.path(piece));
        for files in [["one.mcap", piece, "three.mcap"], ["three.mcap", "one.mcap", piece]] {
            let command = ["calibrate", "turntable", "campaign.toml", "-o", "table.toml"];
            assert_refused(&domain, &[&command[..], &files].concat(), 65, cause);
            assert!(!domain.path("table.toml").exists(), "{files:?}");
        }
    }
}

#[test]
fn regress_reports_a_fault_and_an_outlier_with_the_piece_that_has_it() {
    let domain = TestDomain::new();
    let middle = outer_thirds(&domain, &fs::read_to_string(format!("{EXAMPLES}/cubic.csv")).unwrap());
    let with_y = |y: &str, piece: &str| {
        let mut changed = middle.part(0, middle.rows.len());
        changed.rows[3][1] = y.to_owned();
        changed.write(&domain.path(piece));
    };
    with_y("low", "bad.csv");
    with_y("1e200", "far.csv");
    ["out.csv", "out.mcap"].iter().for_each(|piece| with_y("136000", piece));
    let command = |piece| ["regress", "--x", "x", "--y", "y", "one.mcap", piece, "three.mcap"];
    for (piece, cause) in
        [("bad.csv", "bad.csv:5: y is \"low\", give a finite number"), ("far.csv", "far.csv:5: y is ")]
    {
        assert_refused(&domain, &command(piece), 65, cause);
    }
    for (piece, place) in [("out.csv", "out.csv:5"), ("out.mcap", "out.mcap: message 4")] {
        let output = domain.run(&command(piece));
        let stderr = text(&output.stderr);
        assert!(output.status.success(), "{stderr}");
        assert!(stderr.contains(&format!("but kept: line {place}; look at them")), "{piece}: {stderr}");
    }
}

#[test]
fn temperature_in_whole_numbers_is_read() {
    let domain = TestDomain::new();
    let mut run = CsvContent::of(&fs::read_to_string(RUN).unwrap()).part(0, 100);
    let head = run.names.iter().position(|name| name == "a2_head").unwrap();
    run.rows.iter_mut().for_each(|row| row[head] = "1".to_owned());
    domain.write("imu-a.toml", TABLE);
    let variants = ["r.csv", "r.mcap"].map(|name| {
        run.write(&domain.path(name));
        vec![name]
    });
    assert_alike(&domain, &variants, &["replay", "--table", "imu-a.toml"]);
}

/// Rows of a whole IMU with a device, which some rows do not know.
fn whole() -> CsvContent {
    let mut whole = CsvContent::of(&fs::read_to_string(WHOLE_RUN).unwrap()).part(0, 900);
    whole.names.push("device".to_owned());
    for (number, row) in whole.rows.iter_mut().enumerate() {
        let unknown = ["", "0000000000000000", "0"];
        row.push(if number % 3 == 0 { "46a7426ef29cc83b" } else { unknown[number / 3 % 3] }.to_owned());
    }
    whole
}

#[test]
fn a_whole_imu_is_read_in_every_format_and_pieces_in_any_order() {
    let domain = TestDomain::new();
    // 46a7426ef29cc83b is the unit with the serial number SN 42.
    domain.write("imu-g.toml", &WHOLE_TABLE.replace("gravity =", "serial = \"SN 43\"\ngravity ="));
    let service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
    let (all, lag) = (whole(), &LAG_COLUMNS[..]);
    for (content, more) in [(&all, &[][..]), (&all.without(lag), &["--lag", "100"]), (&all.without(&["device"]), &[])] {
        let lines: String = [&content.names].into_iter().chain(&content.rows).map(|row| row.join(",") + "\n").collect();
        let variants = variants(&domain, &lines);
        let replay = [&["replay", "--table", "imu-g.toml", "--other-imu"], more].concat();
        assert_alike(&domain, &variants, &replay);
        assert_alike(&domain, &variants, &[&["feed", "--imu", "imu-g"], more].concat());
        let replayed = domain.run_ok(&[&replay[..], &["whole.mcap"]].concat());
        let flagged = if content.names.last().is_some_and(|name| name == "device") { 300 } else { 0 };
        assert_eq!(replayed.matches("other-device").count(), flagged);
        assert_eq!(replayed.matches("lag-unknown").count(), if more.is_empty() { 0 } else { 900 });
        for piece in fs::read_dir(domain.path("")).unwrap() {
            let piece = piece.unwrap().path();
            if piece.extension().is_some_and(|extension| extension != "toml") && piece.is_file() {
                fs::remove_file(piece).unwrap();
            }
        }
    }
    service.terminate();
}

const LAG_COLUMNS: [&str; 7] = [
    "lag_ns",
    "a1_head_lagged",
    "a2_head_lagged",
    "a3_head_lagged",
    "g1_head_lagged",
    "g2_head_lagged",
    "g3_head_lagged",
];

/// A program that writes the whole group of lagged columns, whatever the IMU has.
#[test]
fn the_lag_of_gyroscopes_that_an_imu_does_not_have_is_left_out() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", WHOLE_TABLE);
    let gyroscopes: Vec<_> = (1..=3)
        .flat_map(|axis| ["positive", "negative", "head", "board"].map(|part| format!("g{axis}_{part}")))
        .collect();
    let mut lacking: Vec<_> = gyroscopes.iter().map(String::as_str).collect();
    let replay = |lacking: &[&str], name: &str| {
        let half = whole().without(lacking);
        ["csv", "mcap"].map(|extension| {
            let piece = format!("{name}.{extension}");
            half.write(&domain.path(&piece));
            domain.run_ok(&["replay", "--table", "imu-g.toml", "--other-imu", &piece])
        })
    };
    let with = replay(&lacking, "with");
    lacking.extend(&LAG_COLUMNS[4..]);
    assert!(with == replay(&lacking, "without") && with[0].lines().count() == 901);
}

#[test]
fn a_part_of_the_columns_of_a_whole_imu_is_refused_by_name() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", WHOLE_TABLE);
    for lacking in [&["g2_board"][..], &["g1_positive", "g3_head"], &["lag_ns"], &["a2_head_lagged"], &LAG_COLUMNS[4..]]
    {
        let names = lacking.join(", ");
        for piece in ["part.csv", "part.mcap"] {
            whole().without(lacking).write(&domain.path(piece));
            let cause = format!("missing columns: {names}; found: ");
            assert_refused(&domain, &["replay", "--table", "imu-g.toml", piece], 65, &cause);
            assert_refused(&domain, &["replay", "--table", "imu-g.toml", piece], 65, "or none");
        }
    }
    let mut odd = whole();
    odd.rows[4].pop();
    odd.rows[4].push("SN 42".to_owned());
    odd.write(&domain.path("odd.mcap"));
    let cause = "message 5: device is not a text of 16 hexadecimal digits";
    assert_refused(&domain, &["replay", "--table", "imu-g.toml", "--other-imu", "odd.mcap"], 65, cause);
}
