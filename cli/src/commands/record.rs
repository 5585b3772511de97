//! `record`: writes the streams of running IMUs into files.

use super::common::{RotationArgs, options};
use crate::recorder::{Recorder, Streams, remove};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use isotherm_client::{Domain, ImuId, Realtime};
use isotherm_documents::load_table;
use isotherm_files::{Disk, Trust, check_stdout, check_written, end_signals};
use isotherm_offline::parse::seconds;
use isotherm_recording_formats::write::{Files, Format, IMU_PLACEHOLDER, RosTable, refuse_same_topics};
use isotherm_service::config::MAX_IMUS;
use isotherm_shared::names::StreamKind;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Record the streams of running IMUs
///
/// Records raw samples and increments of running IMUs, without disturbing them.
///
/// Waits for the service, continues after restarts of service and acquisition, and ends on SIGINT or SIGTERM. The files
/// always hold everything up to the last flush, even if the recorder is killed.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm record --imu imu-a -o flight.mcap\n  isotherm record --imu imu-a --imu imu-b -o flight-{imu}.csv --rotate-time 3600\n  isotherm record --imu imu-a -o - | head\n  isotherm record --imu imu-a --format ros --table imu-a.toml -o drive.mcap"
)]
pub(crate) struct Record {
    /// Record this IMU
    ///
    /// Can be repeated.
    #[arg(long = "imu", value_name = "ID", required = true)]
    imus: Vec<ImuId>,
    /// Write the rows to this file
    ///
    /// The name ends with .csv or .mcap. {imu} in the name stands for the IMU; - is stdout (CSV).
    ///
    /// CSV has one file per stream: FILE.csv for raw samples, and FILE.increments.csv. An existing file is
    /// never replaced.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Choose the format of the files
    ///
    /// Overrides the ending of the name. ros is MCAP with sensor_msgs/msg/Imu.
    #[arg(long, value_name = "FORMAT", value_parser = PossibleValuesParser::new(Format::NAMES.map(|(_, name)| name)).map(format))]
    format: Option<Format>,
    /// Read the table for the ROS messages
    ///
    /// The coefficient table of an IMU, for --format ros. The messages then name it. Can be repeated.
    ///
    /// Without it, the messages only contain the first 16 digits of the table's digest. There is then no
    /// sensor_msgs/msg/Temperature, since that requires a temperature known to be in degC.
    #[arg(long = "table", value_name = "TABLE")]
    tables: Vec<PathBuf>,
    /// Record only this stream
    ///
    /// Default: both streams, or raw on stdout.
    #[arg(long, value_name = "STREAM", value_parser = PossibleValuesParser::new(StreamKind::BOTH.map(StreamKind::name)).map(stream))]
    stream: Option<StreamKind>,
    #[command(flatten)]
    rotation: RotationArgs,
    /// Set the flush interval [s]
    ///
    /// Rows are visible to other programs, and survive a crash, after a flush.
    #[arg(long, value_name = "S", default_value = "1", value_parser = seconds)]
    flush: Duration,
    /// End this long after the first row [s]
    #[arg(long, value_name = "S", value_parser = seconds)]
    duration: Option<Duration>,
    /// Set the real-time priority of the sampling thread
    ///
    /// SCHED_FIFO, 1 to 99. This thread takes the samples; it sleeps most of the time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(i32).range(1..=99))]
    priority: Option<i32>,
}

impl Record {
    pub(crate) fn run(self, domain: Domain) -> Result<(), Failure> {
        let (files, streams) = self.files()?;
        let end = Arc::new(AtomicBool::new(false));
        for signal in end_signals() {
            let registered = signal_hook::flag::register(signal, Arc::clone(&end));
            registered.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        let realtime = Realtime { priority: self.priority, ..Realtime::default() };
        let recorder = Recorder::start(self.imus, streams, files, options(domain, Duration::ZERO), realtime)?;
        recorder.run(&end, self.flush, self.duration)
    }

    /// Checks the command line, and creates the files with their streams.
    fn files(&self) -> Result<(Vec<Files>, Streams), Failure> {
        let usage = |message: String| Err(Failure::new(Exit::Usage, message));
        let (output, name) = (&self.output, self.output.to_string_lossy());
        if let Some(twice) = self.imus.iter().enumerate().find(|(place, imu)| self.imus[..*place].contains(imu)) {
            return usage(format!("--imu {} is given twice", twice.1));
        }
        if self.imus.len() > MAX_IMUS {
            return usage(format!("{} IMUs; a service has up to {MAX_IMUS}", self.imus.len()));
        }
        let stdout = output == Path::new("-");
        let format = match (self.format, Format::of_path(output)) {
            (Some(format), _) | (None, Some(format)) => format,
            (None, None) if stdout => Format::Csv,
            (None, None) => return usage(Format::named(output).err().unwrap_or_default() + ", or give --format"),
        };
        let (rotation, is_given) = self.rotation.get()?;
        if stdout && (format != Format::Csv || self.imus.len() > 1 || is_given) {
            return usage("stdout takes one stream of one IMU as CSV, without rotation; name a file".to_owned());
        }
        if stdout {
            check_written(None, check_stdout())?;
        }
        if format == Format::Ros && self.stream.is_some() {
            return usage(
                "--format ros takes the increments, and the temperature of the raw samples; leave out --stream"
                    .to_owned(),
            );
        }
        if format != Format::Ros && !self.tables.is_empty() {
            return usage("--table is for --format ros".to_owned());
        }
        let tables = self.tables.iter().map(|path| {
            let (table, _) = load_table(path, None, Trust::Any)?;
            let table = RosTable::new(&table, path);
            if self.imus.contains(table.imu()) {
                return Ok(table);
            }
            let message = format!("{}: a table of {}, which is not recorded", shown(path), table.imu());
            Err(Failure::new(Exit::Usage, message))
        });
        let tables = tables.collect::<Result<Vec<_>, _>>()?;
        let file_per_imu = name.contains(IMU_PLACEHOLDER);
        if self.imus.len() > 1 && !format.is_joint() && !file_per_imu {
            return usage(format!(
                "several IMUs need a file each: put {IMU_PLACEHOLDER} into the name {name}, or record MCAP"
            ));
        }
        if format == Format::Ros && !file_per_imu {
            refuse_same_topics(&self.imus).map_err(|message| {
                Failure::new(Exit::Usage, format!("{message}: put {IMU_PLACEHOLDER} into the name {name}"))
            })?;
        }
        let kinds = match self.stream {
            Some(stream) => vec![stream],
            None if stdout => vec![StreamKind::Raw],
            None => StreamKind::BOTH.to_vec(),
        };
        let all = |imu: usize| kinds.iter().map(move |stream| (imu, *stream));
        let streams: Vec<_> = (0..self.imus.len()).flat_map(all).collect();
        let groups: Vec<Vec<_>> = match file_per_imu {
            true => (0..self.imus.len()).map(|imu| all(imu).collect()).collect(),
            false => vec![streams.clone()],
        };
        let mut files: Vec<Files> = Vec::new();
        for group in groups {
            match Files::create_with_tables(&Disk, output, format, rotation, &self.imus, &group, &tables) {
                Ok(made) => files.push(made),
                Err(error) => {
                    // Either all files are created or none.
                    remove(&files);
                    return Err(error.into());
                }
            }
        }
        Ok((files, streams))
    }
}

/// A format, from its name.
fn format(name: String) -> Format {
    Format::NAMES.into_iter().find(|(_, known)| *known == name).map_or(Format::Csv, |(format, _)| format)
}

/// A stream, from its name.
fn stream(name: String) -> StreamKind {
    StreamKind::BOTH.into_iter().find(|kind| kind.name() == name).unwrap_or(StreamKind::Raw)
}
