//! `replay`: compensates a recording with the kernel.

use super::common::{AcceptanceArgs, ForeignArgs, GyroscopeCheck, LagArgs, OfData, joined_paths, load_with_origin};
use super::part::PartArgs;
use clap::Args;
use isotherm_campaign::{MAGNITUDE_ROWS, magnitude_at_rest};
use isotherm_files::{Output, check_written, refuse_overlap, sources};
use isotherm_pipeline::no_bar;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording::{Continuity, IncrementCsvWriter, IncrementLayout, other_device};
use isotherm_recording_formats::read::{Input, Samples};
use isotherm_recording_formats::write::{RosTable, RosWriter};
use isotherm_shared::compensate::answer;
use isotherm_shared::lag::ReadingLimits;
use isotherm_shared::names::ImuId;
use isotherm_shared::wire::Flags;
use isotherm_shared::wire::{CompensatedIncrement, RawSample, StreamSample};
use isotherm_support::failure::Failure;
use isotherm_support::finding::Finding;
use std::path::{Path, PathBuf};
use std::{fmt, io, slice};
use tracing::info;

/// Compensate a recording offline
///
/// Compensates a recording with exactly the arithmetic of the service.
///
/// The output equals that of `feed` byte for byte. If the name of the output ends with .mcap, it contains ROS messages
/// instead, sensor_msgs/msg/Imu. The last line on stderr counts the flags, and also missing rows, time steps and
/// changes of the session. The flags are those of the service, without the delivery flags.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm replay --table imu-a.toml run.csv -o increments.csv\n  isotherm replay --table imu-a.toml flight-????.mcap -o increments.csv\n  zcat run.csv.gz | isotherm replay --table imu-a.toml - | head\n  isotherm replay --table imu-a.toml run.csv -o run.mcap"
)]
pub struct Replay {
    /// Read this coefficient table
    #[arg(long, value_name = "TABLE")]
    table: PathBuf,
    /// Read the samples of this IMU
    ///
    /// For a recording of several IMUs [default: the IMU of the table]
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Read this recording of raw samples
    ///
    /// A recording of raw samples (CSV, MCAP) or third-party data, or the pieces of one recording in any
    /// order; - is stdin.
    #[arg(value_name = "RAW", required = true)]
    recording: Vec<PathBuf>,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    lag: LagArgs,
    /// Accept a recording of another IMU
    ///
    /// A recording that names an IMU other than that of the table (MCAP) is refused otherwise.
    #[arg(long)]
    other_imu: bool,
    /// Write the increments to this file
    ///
    /// CSV, or .mcap with sensor_msgs/msg/Imu. - is stdout.
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    #[command(flatten)]
    acceptance: AcceptanceArgs,
    #[command(flatten)]
    foreign: ForeignArgs,
}

impl Replay {
    pub(crate) fn run(self) -> Result<(), Failure> {
        let mut inputs = super::common::inputs(&self.recording);
        inputs.push((&self.table, "the table"));
        inputs.extend(self.foreign.inputs());
        refuse_overlap(&inputs, &[self.output.as_deref()])?;
        let (table, origin) = load_with_origin(&self.table)?;
        let choice = super::common::choice(self.imu, &table);
        let input = Input::from((choice, self.foreign.read_for(Some(&table), &origin)?)).within(self.part.get()?);
        let mut samples = Samples::open(&sources(&self.recording)?, input, &no_bar(&[], ""))?;
        samples.set_lag(self.lag.ns.unwrap_or(table.lag_ns()));
        samples.set_limits(Some(ReadingLimits::of(&table)));
        let mut next = samples.next();
        if let Some(Ok(_)) = next {
            super::common::refuse_other_imu(&samples, &self.recording, (&table, &self.table), self.other_imu)?;
        }
        let path = self.output.as_deref();
        let layout = IncrementLayout { gyroscopes: table.content().gyroscopes.is_some(), delivery: false };
        let ros = RosTable::new(&table, &self.table);
        let mut writer = match Output::create(path).and_then(|sink| IncrementWriter::new(sink, path, layout, &ros)) {
            Ok(writer) => writer,
            Err(error) => return check_written(path, Err(error)),
        };
        let mut flags = FlagTally::default();
        let mut warning = GyroscopeCheck::new(layout.gyroscopes);
        let mut continuity = Continuity::default();
        let mut begin: Vec<RawSample> = Vec::new();
        while let Some(sample) = next {
            let sample = sample?;
            warning.check(&sample);
            continuity.add_recorded(&sample, samples.recorded_ns());
            if begin.len() < MAGNITUDE_ROWS {
                begin.push(sample);
            }
            let increment = answer(Some(&table), &sample);
            flags.add(increment.flags);
            if let Err(error) = writer.write(&sample, &increment) {
                return check_written(path, Err(error));
            }
            next = samples.next();
        }
        let tells_no_temperature = matches!(writer, IncrementWriter::Ros(_)) && !ros.is_celsius();
        let others = flags.count(Flags::OTHER_DEVICE);
        let other = (others > 0).then(|| other_device(&table, others));
        // Before the file is put in place: what is refused leaves none. Without --strict nothing is.
        let of_rows = continuity.findings(0.0).into_iter().chain(continuity.not_nominal(&table));
        let of_rows = of_rows.chain(magnitude_at_rest(&table, &begin));
        let found = of_rows.map(Finding::warned).chain(other).collect();
        let recording = samples.recording();
        let of_data = OfData::of(recording).with_unit(&origin, recording).with_other_device();
        of_data.admit(&self.acceptance, &joined_paths(&self.recording), found).map_err(|refused| refused.failure)?;
        check_written(path, writer.finish().and_then(Output::finish))?;
        if tells_no_temperature {
            let unit = &table.content().temperature_unit;
            info!("no sensor_msgs/msg/Temperature: the temperature is in {unit}, not in degC");
        }
        let losses = Some(continuity.losses()).filter(|losses| !losses.is_none() || losses.session_changes > 0);
        let losses = losses.map(|losses| format!("; {losses}")).unwrap_or_default();
        info!("{flags}{losses}");
        Ok(())
    }
}

enum IncrementWriter {
    Csv(IncrementCsvWriter<Output>),
    Ros(Box<RosWriter<Output>>),
}

impl IncrementWriter {
    fn new(sink: Output, path: Option<&Path>, layout: IncrementLayout, table: &RosTable) -> io::Result<Self> {
        let is_mcap = path.and_then(Path::extension).is_some_and(|extension| extension.eq_ignore_ascii_case("mcap"));
        if !is_mcap {
            return IncrementCsvWriter::new(sink, layout).map(Self::Csv);
        }
        RosWriter::new(sink, &[(0, table.imu())], slice::from_ref(table)).map(Box::new).map(Self::Ros)
    }

    fn write(&mut self, sample: &RawSample, increment: &CompensatedIncrement) -> io::Result<()> {
        match self {
            Self::Csv(writer) => writer.write(increment),
            Self::Ros(writer) => {
                let recorded_ns = increment.timestamp_ns;
                writer.write(&RecordedRow::new(0, recorded_ns, StreamSample::Raw(*sample)))?;
                writer.write(&RecordedRow::new(0, recorded_ns, StreamSample::Increment(*increment)))
            }
        }
    }

    fn finish(self) -> io::Result<Output> {
        match self {
            Self::Csv(writer) => writer.finish(),
            Self::Ros(writer) => writer.finish(),
        }
    }
}

/// How many increments there are, and how many have each flag.
struct FlagTally {
    increments: u64,
    flagged: u64,
    by_bit: [u64; 64],
}

impl Default for FlagTally {
    fn default() -> Self {
        Self { increments: 0, flagged: 0, by_bit: [0; 64] }
    }
}

impl FlagTally {
    /// How many increments have the one flag.
    const fn count(&self, flag: Flags) -> u64 {
        self.by_bit[flag.0.trailing_zeros() as usize % 64]
    }

    fn add(&mut self, flags: u64) {
        self.increments += 1;
        self.flagged += u64::from(flags != 0);
        for (bit, count) in self.by_bit.iter_mut().enumerate() {
            *count += (flags >> bit) & 1;
        }
    }
}

/// `4000 increments, 12 flagged: a1-head-above 12, telemetry-stale 3`
impl fmt::Display for FlagTally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} increments, ", self.increments)?;
        if self.flagged == 0 {
            return f.write_str("none flagged");
        }
        let counts = Flags::NAMES.iter().map(|(bit, name)| (name, self.by_bit[*bit as usize]));
        let counts: Vec<_> =
            counts.filter(|(_, count)| *count > 0).map(|(name, count)| format!("{name} {count}")).collect();
        write!(f, "{} flagged: {}", self.flagged, counts.join(", "))
    }
}
