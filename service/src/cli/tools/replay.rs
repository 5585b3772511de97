use super::{apart, written};
use crate::failure::Failure;
use crate::files::{Guard, Output, load_table, open_recording};
use clap::Args;
use isotherm_shared::compensate::answer;
use isotherm_shared::recording::{IncrementWriter, RawReader};
use std::path::PathBuf;

/// Compensate a recording offline, with the very arithmetic of the service
///
/// The output equals that of `feed`, byte for byte.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm replay --table imu-a.toml run.csv -o increments.csv\n  zcat run.csv.gz | isotherm replay --table imu-a.toml - | head"
)]
pub struct Replay {
    /// Coefficient table
    #[arg(long, value_name = "TABLE")]
    table: PathBuf,
    /// Recording of raw samples (CSV); - is stdin
    #[arg(value_name = "RAW.csv")]
    recording: PathBuf,
    /// Where the increments go (CSV); - is stdout
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
}

impl Replay {
    pub fn run(self) -> Result<(), Failure> {
        apart(&[(&self.recording, "the recording itself"), (&self.table, "the table")], &[self.output.as_deref()])?;
        let (table, _) = load_table(&self.table, None, Guard::Lax)?;
        let source = open_recording(&self.recording);
        let source = source.map_err(|error| Failure::io("opening", &self.recording, &error))?;
        let failed = |error| Failure::recording(&self.recording, &error);
        let reader = RawReader::new(source).map_err(failed)?;
        let path = self.output.as_deref();
        let sink = Output::create(path);
        let mut writer = match sink.and_then(|sink| IncrementWriter::new(sink, false)) {
            Ok(writer) => writer,
            Err(error) => return written(path, Err(error)),
        };
        for sample in reader {
            let sample = sample.map_err(failed)?;
            if let Err(error) = writer.write(&answer(Some(&table), &sample)) {
                return written(path, Err(error));
            }
        }
        written(path, writer.finish().and_then(Output::finish))
    }
}
