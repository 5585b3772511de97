//! The data that laboratories have: one simulated campaign as rows, as files by position, and as a sheet of means gives
//! one table; what is wrong with files has a message with file, line or key, and remedy.
#![allow(clippy::unwrap_used, clippy::panic, clippy::expect_used, reason = "in a test the panic is the report")]

use isotherm_campaign::Campaign;
use isotherm_fit::CalibrationOptions;
use isotherm_pipeline::{CampaignFile, InputOptions, Inputs, JobFailure, JobOutcome, no_bar, propose};
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::{CampaignSchedule, SimulatedRow, Truth, campaign};
use isotherm_support::failure::Exit;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A laboratory's folder, and the campaign in it.
struct Laboratory {
    folder: TempDir,
    rows: Vec<SimulatedRow>,
    /// The campaign file up to the samples, and from the positions on.
    head: String,
    positions: String,
}

const CHANNELS: &str = "positive = [\"A1+\", \"A2+\", \"A3+\"]\nnegative = [\"A1-\", \"A2-\", \"A3-\"]\n";
const TEMPERATURE: &str =
    "[samples.temperature]\ncolumns = [\"T1\", \"T2\", \"T3\"]\nboard_columns = [\"B1\", \"B2\", \"B3\"]\n";
const HEADER: &str = "Datum;Zeit;A1+;A1-;A2+;A2-;A3+;A3-;T1;T2;T3;B1;B2;B3\n";

fn comma(value: f64) -> String {
    value.to_string().replace('.', ",")
}

/// Day, hour, minute and second of a time of the campaign.
fn date(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    let (day, rest) = (seconds / 86_400 + 1, seconds % 86_400);
    format!("{day:02}.05.2026;{:02}:{:02}:{:02}", rest / 3600, rest / 60 % 60, rest % 60)
}

impl Laboratory {
    fn new(seed: u64, set_points_c: &[f64]) -> Self {
        let table = include_str!("../../../tests/data/imu-a.toml");
        let truth = Truth::of(CoefficientTable::from_toml(table, None).unwrap());
        let schedule =
            CampaignSchedule { set_points_c: set_points_c.to_vec(), dwell_s: 100.0, ..CampaignSchedule::default() };
        let rows = campaign(&truth, &schedule, seed).collect();
        let text = schedule.campaign_toml(&truth, "samples.csv");
        let (head, positions) = text.split_at(text.find("[[position]]").unwrap());
        let head =
            head.lines().filter(|line| !line.starts_with("samples")).fold(String::new(), |all, line| all + line + "\n");
        let folder = TempDir::new().unwrap();
        Self { folder, rows, head, positions: positions.to_owned() }
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join(name)
    }

    /// The dwells, in order.
    fn dwells(&self) -> Vec<(f64, u32, Vec<SimulatedRow>)> {
        let mut dwells: Vec<(f64, u32, Vec<SimulatedRow>)> = Vec::new();
        for row in &self.rows {
            match dwells.last_mut() {
                Some((set_point, position, rows)) if (*set_point, *position) == (row.set_point_c, row.position) => {
                    rows.push(*row);
                }
                _ => dwells.push((row.set_point_c, row.position, vec![*row])),
            }
        }
        dwells
    }

    fn write_rows(&self) {
        let mut text = String::from("set_point_c,position,sequence,timestamp_ns,interval_ns");
        for axis in 1..=3 {
            let _ = write!(text, ",a{axis}_positive,a{axis}_negative,a{axis}_head,a{axis}_board");
        }
        text.push('\n');
        for SimulatedRow { set_point_c, position, raw } in &self.rows {
            let _ = write!(text, "{set_point_c},{position},{},{},{}", raw.sequence, raw.timestamp_ns, raw.interval_ns);
            let triad = &raw.accelerometers;
            for axis in 0..3 {
                let [head, board] = [triad.head_temperature[axis], triad.board_temperature[axis]];
                let _ = write!(text, ",{},{},{head},{board}", triad.positive_pulses[axis], triad.negative_pulses[axis]);
            }
            text.push('\n');
        }
        fs::write(self.path("samples.csv"), text).unwrap();
        fs::write(self.path("rows.toml"), format!("samples = \"samples.csv\"\n{}{}", self.head, self.positions))
            .unwrap();
    }

    /// A row of a file, of counts divided by this.
    fn line(row: &SimulatedRow, gate_s: f64) -> String {
        let triad = &row.raw.accelerometers;
        let mut line = date(row.raw.timestamp_ns);
        for axis in 0..3 {
            let both = [triad.positive_pulses[axis], triad.negative_pulses[axis]];
            both.iter().for_each(|pulses| line += &format!(";{}", comma(f64::from(*pulses) / gate_s)));
        }
        triad
            .head_temperature
            .iter()
            .chain(&triad.board_temperature)
            .for_each(|value| line += &format!(";{}", comma(*value)));
        line + "\n"
    }

    /// Files of rates over 10 s, with dates and decimal commas, in a folder for each set point.
    fn write_files(&self) -> String {
        for (set_point, position, rows) in self.dwells() {
            let folder = self.path(&format!("T{set_point}"));
            fs::create_dir_all(&folder).unwrap();
            let text = rows.iter().fold(HEADER.to_owned(), |text, row| text + &Self::line(row, 10.0));
            fs::write(folder.join(format!("P{position:02}.csv")), text).unwrap();
        }
        let text = format!(
            "{}[samples]\nfiles = \"T{{set_point_c}}/P{{position}}.csv\"\ndecimal = \",\"\n[samples.time]\n\
             column = [\"Datum\", \"Zeit\"]\nunit = \"iso8601\"\n[samples.accelerometer]\n{CHANNELS}kind = \"rate\"\n\
             gate_s = 10\n{TEMPERATURE}{}",
            self.head, self.positions
        );
        fs::write(self.path("files.toml"), &text).unwrap();
        text
    }

    fn write_means(&self) -> String {
        let mut text = HEADER.replace("Datum;Zeit", "T_set;Pos");
        for (set_point, position, rows) in self.dwells() {
            let mean = |of: &dyn Fn(&SimulatedRow) -> f64| rows.iter().map(of).sum::<f64>() / rows.len() as f64;
            let _ = write!(text, "{};{position}", comma(set_point));
            for axis in 0..3 {
                let positive = mean(&|row| f64::from(row.raw.accelerometers.positive_pulses[axis]) / 10.0);
                let negative = mean(&|row| f64::from(row.raw.accelerometers.negative_pulses[axis]) / 10.0);
                let _ = write!(text, ";{};{}", comma(positive), comma(negative));
            }
            for axis in 0..3 {
                let _ = write!(text, ";{}", comma(mean(&|row| row.raw.accelerometers.head_temperature[axis])));
            }
            for axis in 0..3 {
                let _ = write!(text, ";{}", comma(mean(&|row| row.raw.accelerometers.board_temperature[axis])));
            }
            text.push('\n');
        }
        fs::write(self.path("means.csv"), text).unwrap();
        let text = format!(
            "{}[samples]\nmeans = \"means.csv\"\nset_point_c = \"T_set\"\nposition = \"Pos\"\ndecimal = \",\"\n\
             [samples.accelerometer]\n{CHANNELS}kind = \"rate\"\n{TEMPERATURE}{}",
            self.head, self.positions
        );
        fs::write(self.path("means.toml"), &text).unwrap();
        text
    }

    fn made(&self, name: &str) -> JobOutcome {
        calibrate(&self.path(name)).unwrap_or_else(|refused| panic!("{}", refused.failure.message))
    }

    /// The exit code and the message of a refusal, with `text` as the campaign file.
    fn refused(&self, text: &str) -> (Exit, String) {
        let path = self.path("hostile.toml");
        fs::write(&path, text).unwrap();
        let Err(refused) = calibrate(&path) else { panic!("it is refused") };
        let failure = refused.failure;
        (failure.exit, failure.message.replace(&format!("{}/", self.folder.path().display()), ""))
    }
}

fn calibrate(path: &Path) -> Result<JobOutcome, JobFailure> {
    let file = CampaignFile::read(path)?;
    let campaign: Campaign = file.campaign(None)?;
    Inputs::turntable(&campaign, &file, Vec::new(), CalibrationOptions::default(), &InputOptions::default(), &no_bar)?
        .fit(&campaign, Some(&file))
}

fn table(made: &JobOutcome) -> CoefficientTable {
    CoefficientTable::from_toml(&made.table, None).unwrap()
}

/// The largest differences of the biases \[g0\] and of the scale factors \[1\] of two tables.
fn differences(one: &CoefficientTable, other: &CoefficientTable) -> [f64; 2] {
    let mut most = [0.0_f64; 2];
    for (a, b) in one.content().axes.iter().zip(&other.content().axes) {
        let [low, high] = a.bias.range();
        for part in 0..=20 {
            let u = low + (high - low) * f64::from(part) / 20.0;
            most[0] = most[0].max((a.bias_at(u).0 - b.bias_at(u).0).abs());
            for (k, other) in [
                (a.positive_scale_factor_at(u).0, b.positive_scale_factor_at(u).0),
                (a.negative_scale_factor_at(u).0, b.negative_scale_factor_at(u).0),
            ] {
                most[1] = most[1].max((k / other - 1.0).abs());
            }
        }
    }
    most
}

fn names(made: &JobOutcome) -> Vec<&'static str> {
    made.fitted.findings().iter().map(|finding| finding.name).collect()
}

fn one_table_in_every_form(seed: u64) {
    let laboratory = Laboratory::new(seed, &[-20.0, 0.0, 22.5, 45.0]);
    laboratory.write_rows();
    laboratory.write_files();
    laboratory.write_means();
    let [rows, files, means] = ["rows.toml", "files.toml", "means.toml"].map(|name| laboratory.made(name));
    assert_eq!(table(&rows).digest(), table(&files).digest(), "seed {seed}");
    assert_eq!(names(&rows), names(&files), "seed {seed}");
    let [bias, scale] = differences(&table(&rows), &table(&means));
    // Far within any interval: the sums are the same but for the rounding of the means' digits.
    assert!(bias < 1e-9 && scale < 1e-9, "seed {seed}: {bias:e} g0, {scale:e}");
    let told: Vec<_> = names(&means).into_iter().filter(|name| *name == "no-times").collect();
    assert_eq!(told.len(), 1, "what means do not show is said once");
}

#[test]
fn rows_files_and_means_of_a_campaign_give_one_table() {
    (1..=3).for_each(one_table_in_every_form);
}

/// `cargo test --release -p isotherm-pipeline -- --ignored`
#[test]
#[ignore = "a study of a hundred campaigns"]
fn rows_files_and_means_of_a_hundred_campaigns_give_one_table() {
    (1..=100).for_each(one_table_in_every_form);
}

#[test]
fn what_is_wrong_with_a_file_is_told_with_file_key_and_remedy() {
    let laboratory = Laboratory::new(7, &[-20.0, 20.0]);
    let text = laboratory.write_files();
    let file = |name: &str| laboratory.path(name);
    let good = fs::read_to_string(file("T-20/P03.csv")).unwrap();
    let refused = |expected: &[&str]| {
        let (exit, message) = laboratory.refused(&text);
        assert!(expected.iter().all(|part| message.contains(part)), "{message}");
        exit
    };
    // A file that is missing.
    fs::remove_file(file("T-20/P03.csv")).unwrap();
    let exit = refused(&["[missing-position]", "no file is called T-20/P3.csv", "--exclude -20/3"]);
    assert_eq!(exit, Exit::Data);
    // One without rows, an empty one, one that is no text, one that leads nowhere.
    fs::write(file("T-20/P03.csv"), HEADER).unwrap();
    refused(&["T-20/P03.csv:", "there are no rows", "measure position 3 at -20 degC again"]);
    fs::write(file("T-20/P03.csv"), "").unwrap();
    refused(&["T-20/P03.csv: the file is empty", "--exclude -20/3"]);
    fs::write(file("T-20/P03.csv"), [1, 0, 255, 254, 3]).unwrap();
    refused(&["T-20/P03.csv", "--exclude -20/3"]);
    #[cfg(unix)]
    {
        fs::remove_file(file("T-20/P03.csv")).unwrap();
        std::os::unix::fs::symlink("/nowhere", file("T-20/P03.csv")).unwrap();
        assert_eq!(refused(&["T-20/P03.csv", "--exclude -20/3"]), Exit::Io);
        fs::remove_file(file("T-20/P03.csv")).unwrap();
    }
    fs::write(file("T-20/P03.csv"), &good).unwrap();
    // Two of one position, a copy, one of a position that is not in the file.
    fs::write(file("T-20/P3.csv"), &good).unwrap();
    refused(&["hostile.toml:", "samples.files:", "T-20/P03.csv and ", "T-20/P3.csv", "take one away"]);
    fs::rename(file("T-20/P3.csv"), file("T-20/P13.csv")).unwrap();
    refused(&["hostile.toml:", "samples.files: T-20/P13.csv is of position 13", "number = 13"]);
    fs::remove_file(file("T-20/P13.csv")).unwrap();
    let other = fs::read_to_string(file("T-20/P04.csv")).unwrap();
    fs::write(file("T-20/P04.csv"), &good).unwrap();
    refused(&["T-20/P04.csv is a copy of T-20/P03.csv"]);
    // Rows of the same time in two files that are no copies.
    fs::write(file("T-20/P04.csv"), good.lines().skip(2).fold(HEADER.to_owned(), |text, line| text + line + "\n"))
        .unwrap();
    refused(&["have rows of the same time", "correct the dates"]);
    fs::write(file("T-20/P04.csv"), other).unwrap();
    // A column that is called otherwise.
    let spoilt = good.replace(HEADER, &HEADER.replace("A1+", "A1p"));
    fs::write(file("T-20/P03.csv"), &spoilt).unwrap();
    refused(&["T-20/P03.csv:1: missing columns: A1+ (samples.accelerometer.positive)", "correct these keys"]);
    fs::write(file("T-20/P03.csv"), &good).unwrap();
    assert!(calibrate(&file("files.toml")).is_ok());
}

#[test]
fn counts_among_rates_and_a_wrong_gate_are_found_from_gravity() {
    let laboratory = Laboratory::new(8, &[-20.0, 20.0]);
    let text = laboratory.write_files();
    let path = laboratory.path("T-20/P03.csv");
    let good = fs::read_to_string(&path).unwrap();
    let dwells = laboratory.dwells();
    let (.., rows) = dwells.iter().find(|(set_point, position, _)| (*set_point, *position) == (-20.0, 3)).unwrap();
    let counts = rows.iter().fold(HEADER.to_owned(), |text, row| text + &Laboratory::line(row, 1.0));
    fs::write(&path, counts).unwrap();
    let (_, message) = laboratory.refused(&text);
    let expected =
        "fault [counts-or-rates]: T-20/P03.csv:2: set point -20 degC, position 3: A1, A2, A3 indicate 10 times gravity";
    assert!(message.contains(expected) && message.contains("give all files in one unit"), "{message}");
    fs::write(&path, good).unwrap();
    // Where all numbers are wrong alike, the nominal scale factor shows it.
    let nominal = format!("nominal_scale_factor = 90000\n{text}");
    fs::write(laboratory.path("nominal.toml"), &nominal).unwrap();
    laboratory.made("nominal.toml");
    let (_, message) = laboratory.refused(&format!("nominal_scale_factor = 9000\n{text}"));
    assert!(
        message.contains("[counts-or-rates]") && message.contains("10.2 times larger than nominal_scale_factor = 9000"),
        "{message}"
    );
    let (_, message) = laboratory.refused(&text.replace("kind = \"rate\"", "kind = \"count\""));
    assert!(
        message.contains("which is not a count") && message.contains("give kind = \"rate\" and gate_s"),
        "{message}"
    );
    let shorter = text.replace("gate_s = 10", "gate_s = 1");
    fs::write(laboratory.path("shorter.toml"), shorter).unwrap();
    let made = laboratory.made("shorter.toml");
    assert!(names(&made).contains(&"counts-or-rates"), "{:?}", names(&made));
}

#[test]
fn faults_of_the_campaign_file_and_of_its_columns_are_told_together() {
    let laboratory = Laboratory::new(9, &[-20.0, 20.0]);
    let text = laboratory.write_files();
    let (exit, message) = laboratory.refused(&text.replace("gate_s = 10\n", "").replace("{position}", ""));
    assert_eq!(exit, Exit::Config);
    assert!(message.contains("samples.files: \"T{set_point_c}/P.csv\" has no {position}"), "{message}");
    assert!(message.contains("samples.accelerometer.gate_s: missing; kind = \"rate\" needs the time"), "{message}");
    for (from, to, expected) in [
        ("files = ", "decimel = 1\nfiles = ", "samples.decimel: unknown key"),
        ("kind = \"rate\"", "kind = \"rate\"\nunit = \"g\"", "samples.accelerometer.unit: is for readings"),
        ("kind = \"rate\"", "kind = \"reading\"", "samples.accelerometer.positive: is for pulses"),
        ("gate_s = 10", "gate_s = 0", "samples.accelerometer.gate_s: is 0, give a number of seconds"),
        ("gate_s = 10", "gate_s = \"?\"", "samples.accelerometer.gate_s: is \"?\", which is to be filled in"),
        (
            "negative = [\"A1-\"",
            "negative = [\"A1+\"",
            "samples.accelerometer.negative: has one column for two channels",
        ),
        ("unit = \"iso8601\"", "unit = \"s\"", "samples.time.column: has 2 columns"),
        ("[samples]", "temperature_unit2 = 1\n[samples]", "temperature_unit2: unknown key"),
    ] {
        let (exit, message) = laboratory.refused(&text.replacen(from, to, 1));
        assert!(exit == Exit::Config && message.contains(expected), "{expected}: {message}");
    }
    let means = laboratory.write_means();
    for (from, to, expected) in [
        ("position = \"Pos\"\n", "", "samples.position: missing; give the column of the sheet"),
        ("kind = \"rate\"", "kind = \"count\"", "samples.accelerometer.gate_s: missing; kind = \"count\" needs"),
        (
            "[samples.accelerometer]",
            "[samples.time]\ncolumn = \"t\"\nunit = \"s\"\n[samples.accelerometer]",
            "a mean has no time",
        ),
    ] {
        let (_, message) = laboratory.refused(&means.replacen(from, to, 1));
        assert!(message.contains(expected), "{expected}: {message}");
    }
    let sheet = fs::read_to_string(laboratory.path("means.csv")).unwrap();
    let lines: Vec<_> = sheet.lines().collect();
    for (text, expected) in [
        (
            sheet.clone() + lines[5] + "\n" + lines[5] + "\n",
            "means.csv:27: set point -20 degC, position 5: line 26 has this mean, too",
        ),
        (sheet.replace("\n-20;5;", "\n-20;15;"), "means.csv:6: set point -20 degC, position 15: no such position"),
        (sheet.replace("\n-20;5;", "\n-20;x;"), "means.csv:6: Pos is \"x\", give a number"),
        (lines[0].to_owned() + "\n", "there are no rows"),
    ] {
        fs::write(laboratory.path("means.csv"), text).unwrap();
        let (_, message) = laboratory.refused(&means);
        assert!(message.contains(expected), "{expected}: {message}");
    }
}

#[test]
fn a_proposal_takes_no_temperatures_for_accelerations_and_needs_only_what_files_do_not_say() {
    let laboratory = Laboratory::new(10, &[-20.0, 0.0, 22.5, 45.0]);
    let text = laboratory.write_files();
    laboratory.write_means();
    // Temperature stands first, is called as accelerations are, and is as large.
    let exchange = |line: &str| {
        let fields: Vec<_> = line.split(';').collect();
        [&fields[..2], &fields[8..], &fields[2..8]].concat().join(";")
    };
    let named = HEADER.trim().replace("T1;T2;T3", "ax;ay;az");
    for (set_point, position, _) in laboratory.dwells() {
        let path = laboratory.path(&format!("T{set_point}/P{position:02}.csv"));
        let lines = fs::read_to_string(&path).unwrap().replace(HEADER.trim(), &named);
        fs::write(path, lines.lines().fold(String::new(), |all, line| all + &exchange(line) + "\n")).unwrap();
    }
    let proposed = propose(laboratory.folder.path(), laboratory.folder.path());
    let proposed = proposed.unwrap_or_else(|failure| panic!("{}", failure.message));
    for expected in [
        "# 3 files are called otherwise, and are not read: files.toml, means.csv, means.toml",
        "files = \"T{set_point_c}/P{position}.csv\"",
        "decimal = \",\"",
        "column = [\"Datum\", \"Zeit\"]",
        "positive = [\"A1+\", \"A2+\", \"A3+\"]",
        "negative = [\"A1-\", \"A2-\", \"A3-\"]",
        "kind = \"rate\"",
        "gate_s = 10",
        "columns = [\"ax\", \"ay\", \"az\"]",
        "board_columns = [\"B1\", \"B2\", \"B3\"]",
        "specific_force = [0, 0, 1]",
    ] {
        assert!(proposed.contains(expected), "{expected}\n{proposed}");
    }
    let is_line = |line: &str| line.is_empty() || !line.starts_with(' ') && line.len() <= 120;
    assert!(proposed.lines().all(is_line), "{proposed}");
    // As it is, it is refused: what the files do not say is open.
    let (exit, message) = laboratory.refused(&proposed);
    assert!(exit == Exit::Config && message.contains("imu") && message.contains("gravity_local"), "{message}");
    let values: BTreeMap<&str, &str> = text.lines().filter_map(|line| line.split_once(" = ")).collect();
    let filled = proposed.lines().map(|line| match line.split_once(" = ") {
        Some((key, value)) if value.starts_with("\"?\"") => format!("{key} = {}", values[key]),
        _ => line.to_owned(),
    });
    let filled: Vec<_> = filled.collect();
    fs::write(laboratory.path("filled.toml"), filled.join("\n")).unwrap();
    fs::write(laboratory.path("files.toml"), text.replace("\"T1\", \"T2\", \"T3\"", "\"ax\", \"ay\", \"az\"")).unwrap();
    let [files, filled] = ["files.toml", "filled.toml"].map(|name| table(&laboratory.made(name)));
    let [bias, scale] = differences(&files, &filled);
    // Without angles the tilt of the base is not estimated.
    assert!(bias < 5e-6 && scale < 20e-6, "{bias:e} g0, {scale:e}");
    let sheet = propose(&laboratory.path("means.csv"), laboratory.folder.path())
        .unwrap_or_else(|failure| panic!("{}", failure.message));
    for expected in [
        "means = \"means.csv\"",
        "set_point_c = \"T_set\"",
        "position = \"Pos\"",
        "positive = [\"A1+\", \"A2+\", \"A3+\"]",
        "columns = [\"T1\", \"T2\", \"T3\"]",
    ] {
        assert!(sheet.contains(expected), "{expected}\n{sheet}");
    }
}

#[test]
fn the_examples_of_the_guide_are_valid_and_fit_their_files() {
    let guide = include_str!("../../../docs/calibrate.md");
    let blocks: Vec<_> = guide.split("```toml\n").skip(1).filter_map(|rest| rest.split_once("```")).collect();
    let samples: Vec<_> =
        blocks.iter().map(|(block, _)| *block).filter(|block| block.starts_with("[samples]")).collect();
    assert_eq!(samples.len(), 2, "files by position, and means");
    let laboratory = Laboratory::new(11, &[-20.0, 20.0]);
    laboratory.write_files();
    laboratory.write_means();
    for block in samples {
        let path = laboratory.path("guide.toml");
        fs::write(&path, format!("{}{block}{}", laboratory.head, laboratory.positions)).unwrap();
        let campaigns = CampaignFile::read(&path).unwrap().campaigns();
        assert!(campaigns.is_ok(), "{block}\n{}", campaigns.err().unwrap().message);
        // Here the columns of the date are called otherwise.
        if block.contains("files = ") {
            let text = fs::read_to_string(&path).unwrap().replace("[\"Date\", \"Time\"]", "[\"Datum\", \"Zeit\"]");
            fs::write(&path, text).unwrap();
            laboratory.write_files();
            let made = laboratory.made("guide.toml");
            assert_eq!(table(&made).digest(), table(&laboratory.made("files.toml")).digest());
        }
    }
}
