//! `convert`: makes a recording of foreign data.

use super::common::Acceptance;
use crate::parse::interval;
use clap::Args;
use isotherm_client::ImuId;
use isotherm_failure::{Exit, Failure, tell};
use isotherm_files::{Output, check_written, refuse_overlap};
use isotherm_recording::RawCsvWriter;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_recording_formats::write::ParquetStream;
use isotherm_shared::stream::StreamKind;
use isotherm_shared::wire::{RawSample, StreamSample};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Make a recording of data from other programs: text, NovAtel logs, ROS messages
///
/// A text (CSV, with any separator) needs a mapping file, which says what its columns are; without one, the mapping
/// that would be is printed. NovAtel RAWIMU, RAWIMUX, RAWIMUS and RAWIMUSX in ASCII, and sensor_msgs/msg/Imu in MCAP,
/// need none.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm convert logger.csv --mapping logger.toml -o run.csv\n  isotherm convert span.log --temperature 31.5 -o run.parquet\n  isotherm convert drive.mcap --topic /imu/data_raw -o run.csv"
)]
pub(crate) struct Convert {
    /// The foreign data; - is stdin, for text
    #[arg(value_name = "INPUT")]
    input: PathBuf,
    /// What the columns are (TOML)
    #[arg(long, value_name = "M.toml")]
    mapping: Option<PathBuf>,
    /// Where the raw samples go: .csv or .parquet; - is stdout (CSV)
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
        let mut inputs = vec![(self.input.as_path(), "the data")];
        inputs.extend(self.mapping.iter().map(|mapping| (mapping.as_path(), "the mapping")));
        refuse_overlap(&inputs, &[Some(&self.output)])?;
        let extension = self.output.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let parquet = match extension.as_deref() {
            Some("parquet") => true,
            Some("mcap") => {
                let message = format!("{}: converted samples go to .csv or .parquet", self.output.display());
                return Err(Failure::new(Exit::Usage, message));
            }
            _ => false,
        };
        let settings = Settings {
            temperature: self.temperature,
            interval_ns: self.interval.map(|interval| interval.as_nanos() as u64),
            topic: self.topic,
            temperature_topic: self.temperature_topic,
            session: 0,
        };
        let mut conversion = Conversion::open(&self.input, self.mapping.as_deref(), &settings)?;
        let layout = conversion.layout();
        let path = Some(self.output.as_path());
        let writer = Output::create(path).and_then(|sink| {
            if parquet {
                let stream = ParquetStream::new(sink, &self.imu, StreamKind::Raw, layout)?;
                return Ok(Writer::Parquet(Box::new(stream)));
            }
            let writer = RawCsvWriter::with_layout(sink, "", false, layout)?;
            Ok(Writer::Csv(writer.with_plain_whole_numbers()))
        });
        let mut writer = match writer {
            Ok(writer) => writer,
            Err(error) => return check_written(path, Err(error)),
        };
        for sample in &mut conversion {
            if let Err(error) = writer.write(&sample?) {
                return check_written(path, Err(error));
            }
        }
        for note in conversion.notes() {
            tell("isotherm", note);
        }
        // Before the file is put in place: what is refused leaves none.
        self.acceptance.admit("", conversion.findings()).map_err(|refused| refused.failure)?;
        check_written(path, writer.finish())?;
        let to = if self.output == Path::new("-") { "stdout".into() } else { self.output.display().to_string() };
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
