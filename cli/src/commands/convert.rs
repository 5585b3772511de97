//! `convert`: makes a recording of foreign data.

use super::common::Acceptance;
use crate::parse::interval;
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_campaign::{LENGTH_ROWS, length_at_rest};
use isotherm_client::ImuId;
use isotherm_failure::{Exit, Failure, tell};
use isotherm_files::{Output, WorldWritable, check_written, load_table, refuse_overlap};
use isotherm_finding::Finding;
use isotherm_recording::RawCsvWriter;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_recording_formats::write::ParquetStream;
use isotherm_shared::stream::StreamKind;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{RawSample, StreamSample};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Make a recording of data from other programs: text, NovAtel logs, ROS messages, logs of autopilots
///
/// A text (CSV, with any separator) needs a mapping file, which says what its columns are; without one, the mapping
/// that would be is printed. NovAtel RAWIMU, RAWIMUX, RAWIMUS and RAWIMUSX in ASCII, sensor_msgs/msg/Imu in MCAP, ULog
/// of PX4, and DataFlash of ArduPilot (.bin, or .log as text) need none.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm convert logger.csv --mapping logger.toml -o run.csv\n  isotherm convert span.log --temperature 31.5 -o run.parquet\n  isotherm convert drive.mcap --topic /imu/data_raw -o run.csv\n  isotherm convert flight.ulg --instance 0 -o run.csv\n  isotherm convert cold.csv warm.csv --mapping logger.toml -o runs/"
)]
pub(crate) struct Convert {
    /// The foreign data; - is stdin, for text. Several files are sessions, each converted into a file of its own
    #[arg(value_name = "INPUT", required = true)]
    input: Vec<PathBuf>,
    /// What the columns are (TOML)
    #[arg(long, value_name = "M.toml")]
    mapping: Option<PathBuf>,
    /// Where the raw samples go: .csv or .parquet; - is stdout (CSV). Of several files the folder
    #[arg(short, long, value_name = "REC")]
    output: PathBuf,
    /// Telemetry of all rows, in the unit of the table, for data that have none
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
    /// Nominal interval [s] [default: that of the mapping, or found from the time]
    #[arg(long, value_name = "S", value_parser = interval)]
    interval: Option<Duration>,
    /// Topic of the sensor_msgs/msg/Imu, if there are several
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Topic of the sensor_msgs/msg/Temperature, if there are several
    #[arg(long, value_name = "TOPIC")]
    temperature_topic: Option<String>,
    /// IMU of an autopilot's log, if there are several: its number there, from 0
    #[arg(long, value_name = "N")]
    instance: Option<u32>,
    /// Number of the session, which the samples then have in a column; of several files that of the first [default:
    /// none, and 1 for several files]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    session: Option<u64>,
    /// Table of the IMU, by which the length of the specific force at rest is compared with gravity
    #[arg(long, value_name = "TABLE")]
    table: Option<PathBuf>,
    /// Name of the IMU, which a Parquet file has
    #[arg(long, value_name = "ID", default_value = "imu")]
    imu: ImuId,
    #[command(flatten)]
    acceptance: Acceptance,
}

enum Writer {
    Csv(RawCsvWriter<Output>),
    Parquet(Box<ParquetStream<Output>>),
}

impl Convert {
    pub(crate) fn run(self) -> Result<(), Failure> {
        let outputs = self.outputs()?;
        let mut inputs: Vec<_> = self.input.iter().map(|input| (input.as_path(), "the data")).collect();
        inputs.extend(self.mapping.iter().map(|mapping| (mapping.as_path(), "the mapping")));
        inputs.extend(self.table.iter().map(|table| (table.as_path(), "the table")));
        let all: Vec<_> = outputs.iter().map(|output| Some(output.as_path())).collect();
        refuse_overlap(&inputs, &all)?;
        let table = self.table.as_ref().map(|path| load_table(path, None, WorldWritable::Allow));
        let table = table.transpose()?.map(|(table, _)| table);
        let first = self.session.unwrap_or(u64::from(self.input.len() > 1));
        for (session, (input, output)) in (first..).zip(self.input.iter().zip(&outputs)) {
            self.convert(input, output, session, table.as_ref())?;
        }
        Ok(())
    }

    /// The output of each input: the one that is named, or of several a file of the same name in that folder.
    fn outputs(&self) -> Result<Vec<PathBuf>, Failure> {
        let usage = |message: String| Err(Failure::new(Exit::Usage, message));
        if let [_] = self.input[..] {
            return Ok(vec![self.output.clone()]);
        }
        let folder = self.output.display();
        if !self.output.is_dir() {
            return usage(format!("{folder}: several files are converted into a folder; make it, and name it with -o"));
        }
        let mut outputs: Vec<PathBuf> = Vec::new();
        for input in &self.input {
            let Some(stem) = input.file_stem().filter(|_| input != Path::new("-")) else {
                return usage(format!("{}: of several inputs each is a file", input.display()));
            };
            let output = self.output.join(stem).with_extension("csv");
            if outputs.contains(&output) {
                return usage(format!("two inputs would be {}; rename one", output.display()));
            }
            outputs.push(output);
        }
        Ok(outputs)
    }

    fn convert(
        &self,
        input: &Path,
        output: &Path,
        session: u64,
        table: Option<&CoefficientTable>,
    ) -> Result<(), Failure> {
        let extension = output.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let parquet = match extension.as_deref() {
            Some("parquet") => true,
            Some("mcap") => {
                let message = format!("{}: converted samples go to .csv or .parquet", output.display());
                return Err(Failure::new(Exit::Usage, message));
            }
            _ => false,
        };
        let progress = bytes_bar(&[input.to_owned()], "reading");
        let settings = Settings {
            temperature: self.temperature,
            interval_ns: self.interval.map(|interval| interval.as_nanos() as u64),
            topic: self.topic.clone(),
            temperature_topic: self.temperature_topic.clone(),
            session,
            instance: self.instance,
            progress: Some(progress.clone()),
        };
        let mut conversion = Conversion::open(input, self.mapping.as_deref(), &settings)?;
        let layout = conversion.layout();
        let path = Some(output);
        let writer = Output::create(path).and_then(|sink| {
            if parquet {
                let stream = ParquetStream::new(sink, &self.imu, StreamKind::Raw, layout)?;
                return Ok(Writer::Parquet(Box::new(stream)));
            }
            let writer = match session {
                0 => RawCsvWriter::with_layout(sink, "", false, layout)?,
                _ => RawCsvWriter::of_sessions(sink, layout)?,
            };
            Ok(Writer::Csv(writer.with_plain_whole_numbers()))
        });
        let mut writer = match writer {
            Ok(writer) => writer,
            Err(error) => return check_written(path, Err(error)),
        };
        let mut begin = Vec::new();
        for sample in &mut conversion {
            let sample = sample?;
            if table.is_some() && begin.len() < LENGTH_ROWS {
                begin.push(sample);
            }
            if let Err(error) = writer.write(&sample) {
                return check_written(path, Err(error));
            }
        }
        progress.finish_and_clear();
        let at_rest = table.and_then(|table| length_at_rest(table, &begin)).map(Finding::warned);
        let findings = conversion.findings().into_iter().chain(at_rest).collect();
        for note in conversion.notes() {
            tell("isotherm", note);
        }
        let name = if self.input.len() > 1 { input.display().to_string() } else { String::new() };
        // Before the file is put in place: what is refused leaves none.
        self.acceptance.admit(&name, findings).map_err(|refused| refused.failure)?;
        check_written(path, writer.finish())?;
        let to = if output == Path::new("-") { "stdout".into() } else { output.display().to_string() };
        tell("isotherm", format_args!("{} rows in {to}", conversion.rows()));
        Ok(())
    }
}

impl Writer {
    fn write(&mut self, sample: &RawSample) -> io::Result<()> {
        match self {
            Self::Csv(writer) => writer.write("", sample),
            Self::Parquet(writer) => {
                writer.write(&RecordedRow { imu: 0, recorded_ns: 0, sample: StreamSample::Raw(*sample) })
            }
        }
    }

    fn finish(self) -> io::Result<()> {
        match self {
            Self::Csv(writer) => writer.finish(),
            Self::Parquet(writer) => writer.finish(),
        }
        .and_then(Output::finish)
    }
}

/// Telemetry, in the unit of the table.
fn temperature(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| "give a number".to_owned())
}
