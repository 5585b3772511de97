//! `acquire`: from a device to the service.

use super::common::{RotationArgs, options};
use clap::Args;
use clap::builder::PossibleValuesParser;
use isotherm_acquire::{
    Description, PROFILES, ProbeResult, RecordingTarget, RunSettings, Tally, Target, iio, probe, run, serial_ports,
};
use isotherm_client::{Domain, ImuId};
use isotherm_files::{StagedText, Trust, end_signals, print, print_data, refuse_overlap};
use isotherm_offline::parse::seconds;
use isotherm_service::logging::{self, LogFormat};
use isotherm_support::failure::{Exit, Failure, shown, tell_as_events};
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use tracing::info;

/// Acquire samples from a device
///
/// The device is a serial line, a TCP or UDP address, a file, or an IIO device of Linux.
///
/// A description defines the format of the bytes and the meaning of their numbers. Every control period becomes a
/// sample or a numbered gap. Every byte outside a frame is counted. Ends on SIGINT or SIGTERM; everything received
/// until then is sent and recorded.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm acquire --list\n  isotherm acquire --probe /dev/ttyUSB0\n  isotherm acquire --profile stim300 > stim300.toml\n  isotherm acquire stim300.toml --dry-run --rows 5\n  isotherm acquire stim300.toml --nominal imu-a.toml\n  isotherm acquire stim300.toml --record flight.mcap"
)]
pub(crate) struct Acquire {
    /// Read this description of the source
    #[arg(value_name = "SOURCE.toml", required_unless_present_any = ["list", "probe", "profile"])]
    source: Option<PathBuf>,
    /// Send the samples of this IMU
    ///
    /// Samples are sent as those of this IMU [default: the IMU of the description]
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Read this device instead of the description's
    ///
    /// A serial line, a file, or an IIO device.
    #[arg(long, value_name = "PATH")]
    device: Option<PathBuf>,
    /// Record all samples, sent or not
    ///
    /// The name of the file ends with .csv or .mcap.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    rotation: RotationArgs,
    /// Send nothing, and print the rows (CSV)
    ///
    /// The rows have the format that `feed` reads.
    #[arg(long)]
    dry_run: bool,
    /// End after this number of rows
    #[arg(long, value_name = "N", requires = "dry_run", value_parser = clap::value_parser!(u64).range(1..))]
    rows: Option<u64>,
    /// Wait this long for a service [s]
    ///
    /// Default: wait without a limit.
    #[arg(long, value_name = "S", value_parser = seconds)]
    timeout: Option<Duration>,
    /// Write the nominal table and end
    ///
    /// With the nominal table of the source, the increments are the readings of the device.
    #[arg(long, value_name = "TABLE", conflicts_with_all = ["record", "dry_run"])]
    nominal: Option<PathBuf>,
    /// Show IIO devices, serial ports and profiles
    #[arg(long, conflicts_with_all = ["source", "probe", "profile"])]
    list: bool,
    /// Show which profile decodes a stream
    ///
    /// Tries all profiles on the stream of this device, or on a file with its bytes.
    #[arg(long, value_name = "DEVICE", conflicts_with_all = ["source", "profile"])]
    probe: Option<PathBuf>,
    /// Set the rate of the line [Bd]
    ///
    /// Default: the rates of the profiles.
    #[arg(long, value_name = "B", requires = "probe", value_parser = clap::value_parser!(u32).range(50..=20_000_000))]
    baud: Option<u32>,
    /// Print this profile
    #[arg(long, value_name = "NAME", conflicts_with = "source", value_parser = PossibleValuesParser::new(PROFILES.map(|(name, _)| name)))]
    profile: Option<String>,
    /// Root of /sys and /dev for IIO
    #[arg(long, value_name = "ROOT", default_value = "/", hide = true)]
    sysfs: PathBuf,
    /// Print tally, list or probe as JSON
    ///
    /// If rows go to stdout, the tally goes to stderr.
    #[arg(long)]
    json: bool,
}

impl Acquire {
    /// Whether it goes on without an operator, and so writes a log: nobody may read that, and nothing waits for it.
    pub(crate) const fn logs(&self) -> bool {
        !(self.dry_run || self.list || self.probe.is_some() || self.profile.is_some() || self.nominal.is_some())
    }

    pub(crate) fn run(self, domain: Domain) -> Result<(), Failure> {
        if self.logs() {
            logging::start(LogFormat::Human);
            tell_as_events();
        }
        if self.list {
            return self.list();
        }
        let end = Arc::new(AtomicBool::new(false));
        for signal in end_signals() {
            let registered = signal_hook::flag::register(signal, Arc::clone(&end));
            registered.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        if let Some(device) = &self.probe {
            return self.probe(device, &end);
        }
        let profile = PROFILES.iter().find(|(name, _)| self.profile.as_deref() == Some(*name));
        let source = match (profile, &self.source) {
            (Some((_, text)), _) => return print_data(text),
            (None, Some(source)) => source,
            (None, None) => return Err(Failure::new(Exit::Usage, "give the description of the source")),
        };
        let mut description = Description::load(source, Trust::Any)?;
        if let Some(imu) = &self.imu {
            description.imu = imu.clone();
        }
        if let Some(device) = &self.device {
            description.set_device(device)?;
        }
        if let Some(output) = &self.nominal {
            refuse_overlap(&[(source, "the description")], &[Some(output)])?;
            let staged = StagedText::create(Some(output))?;
            return staged.write(&description.nominal(&self.sysfs)?.to_toml())?.finish();
        }
        let target = match self.dry_run {
            true => Target::Rows(self.rows),
            false => Target::Service(options(domain, self.timeout.unwrap_or_default())),
        };
        let tell = match (self.json, self.dry_run) {
            (false, _) => tell_text,
            (true, false) => tell_json,
            (true, true) => tell_json_aside,
        };
        let (rotation, is_given) = self.rotation.get()?;
        if is_given && self.record.is_none() {
            return Err(Failure::new(Exit::Usage, "--rotate-size, --rotate-time and --keep-free are for --record"));
        }
        let Self { record, sysfs, .. } = self;
        let record = record.map(|path| RecordingTarget { path, rotation });
        run(&description, RunSettings { target, record, sysfs, end, tell }).map(drop)
    }

    fn list(&self) -> Result<(), Failure> {
        let devices = iio::list(&self.sysfs)?;
        let ports = serial_ports(&self.sysfs);
        let profiles = PROFILES.map(|(name, text)| (name, text.lines().next().unwrap_or_default()));
        if self.json {
            let profiles = profiles.map(|(name, _)| name);
            let document = serde_json::json!({ "iio": devices, "serial": ports, "profiles": profiles });
            return print_data(&format!("{document}\n"));
        }
        let mut text = String::new();
        // Writing to a String cannot fail.
        for device in &devices {
            let label = device.label.as_ref().map(|label| format!(", label {label}")).unwrap_or_default();
            let _ = writeln!(text, "iio:device{} {}{label}", device.index, device.name);
            for channel in &device.channels {
                let scan = channel.scan.as_deref().unwrap_or("polled");
                let scale = channel.scale.map(|scale| format!(", scale {scale}")).unwrap_or_default();
                let offset = channel.offset.map(|offset| format!(", offset {offset}")).unwrap_or_default();
                let _ = writeln!(text, "  {:<12} {scan}{scale}{offset}", channel.name);
            }
            for rate in &device.rates {
                let available = rate.available.as_ref().map(|all| format!(", of {all}")).unwrap_or_default();
                let _ = writeln!(text, "  {} {}{available}", rate.attribute, rate.now);
            }
        }
        for port in &ports {
            let _ = writeln!(text, "{}", shown(port));
        }
        if devices.is_empty() && ports.is_empty() {
            let _ = writeln!(text, "no IIO device and no serial port");
        }
        let _ = writeln!(text, "profiles, for --profile:");
        for (name, title) in profiles {
            let _ = writeln!(text, "  {name:<16} {}", sentences(title));
        }
        print(&text)
    }

    fn probe(&self, device: &Path, end: &AtomicBool) -> Result<(), Failure> {
        let all = probe(device, self.baud, end)?;
        if self.json {
            print_data(&format!("{}\n", serde_json::json!(all)))?;
        } else {
            all.iter().filter(|one| one.frames > 0).try_for_each(|one| print(&probed(one)))?;
        }
        let Some(best) = all.first().filter(|best| best.is_it()) else {
            let bytes = all.first().map_or(0, |one| one.bytes);
            let message = match bytes {
                0 => "no byte has come: is the device on, connected, and set to send?".to_owned(),
                _ => format!(
                    "no profile decodes the {bytes} bytes: give --baud, compare the output that the profile's comment \
                     names, or write a description (docs/acquire.md)"
                ),
            };
            return Err(Failure::new(Exit::Data, format!("{}: {message}", shown(device))));
        };
        if !self.json {
            let name = &best.profile;
            print(&format!("isotherm acquire --profile {name} > {name}.toml\n"))?;
        }
        Ok(())
    }
}

/// The whole sentences of a profile's first line, which may end within one.
fn sentences(title: &str) -> &str {
    let title = title.trim_start_matches("# ");
    if title.ends_with('.') { title } else { title.rsplit_once(". ").map_or(title, |(whole, _)| whole) }
}

fn probed(one: &ProbeResult) -> String {
    let ProbeResult { profile, baud, frames, damaged, bytes, skipped, rate_hz, has_checksum } = one;
    let line = if *baud > 0 { format!(" at {baud} Bd, {rate_hz:.1} Hz") } else { String::new() };
    let checksum = if *has_checksum { "right checksums" } else { "without checksum" };
    format!("{profile}{line}: {frames} frames, {checksum}, {damaged} damaged, {skipped} of {bytes} bytes in no frame\n")
}

fn tell_text(tally: &Tally) {
    info!("{tally}");
}

fn tell_json(tally: &Tally) {
    // The acquisition goes on when nobody reads this.
    let _ = print_data(&format!("{}\n", serde_json::json!(tally)));
}

fn tell_json_aside(tally: &Tally) {
    // As above.
    let _ = writeln!(io::stderr(), "{}", serde_json::json!(tally));
}
