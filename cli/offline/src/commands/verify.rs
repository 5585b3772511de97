//! `verify`: the stability of a recording under a table.

use super::common::{
    AcceptanceArgs, ForeignArgs, JsonOption, LagArgs, OfData, choice, inputs, joined, joined_paths, load_with_origin,
    or_document, refuse_other_imu,
};
use super::part::PartArgs;
use crate::parse::{gravity, seconds};
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_campaign::{STATIC_POSE_WINDOW_S, faults, magnitude_at_rest};
use isotherm_files::{StagedText, check_stdout, check_written, print, refuse_overlap};
use isotherm_fit::{Origin, tool};
use isotherm_pipeline::{CampaignFile, JobFailure, VerificationRun, now};
use isotherm_recording::other_device;
use isotherm_recording_formats::read::Input;
use isotherm_report as report;
use isotherm_report::verification::VerificationSource;
use isotherm_shared::names::ImuId;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_support::failure::{Exit, Failure};
use isotherm_support::finding::{Finding, name};
use isotherm_verification::{
    Attitude, LocalGravity, Magnitudes, MagnitudesError, Requirement, Setup, Stability, own_recording,
};
use std::path::PathBuf;
use std::time::Duration;
use tracing::{info, warn};

/// Length of the windows, if none is given \[s\].
const WINDOW_S: f64 = 10.0;
/// Most rows that are searched for static poses; each takes 256 bytes.
const MOST_ROWS: usize = 4_000_000;

/// Verify a table with a recording at rest
///
/// Shows how stable the output of a recording is, before and after compensation, and how large its errors are.
///
/// The IMU must be held still while its temperature changes. "Before" has the coefficients of the table frozen at the
/// mid temperature of the run; "after" is the full model. Constant error, variation and noise of every axis have 95 %
/// intervals. Where the IMU was still, the magnitude of the output is compared with local gravity. If it differs by
/// more than is possible anywhere on Earth, or if more than 1 % of the windows are not at the attitude, nothing is
/// claimed, and no requirement is met. The first line reports how many windows are left out, and why. A window is left
/// out if the output shows that the IMU moved; the drift of a bias does not count as motion.
///
/// In a run that heats and cools, the hysteresis band shows the distance between the errors in both directions, with
/// and without the transients of the table.
///
/// In a tumble, with a table of calibrate tumble or with --static-poses, the static poses are found, and the magnitude
/// of the output in each is compared with local gravity. Only the bound of scale is judged then.
///
/// Gyroscopes are judged if table and recording have them. At rest they measure Earth's rate, which is subtracted with
/// --angles and a table whose provenance contains it. Otherwise, only their variation is judged.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm verify --table imu-a.toml run.csv --attitude 0.6,-0.48,0.64 --report verify.html\n  isotherm verify --table imu-a.toml run.csv --attitude 0.6,-0.48,0.64 --require bias=20ug0,scale=50ppm,level=5arcsec\n  isotherm verify --table imu-g.toml run.csv --angles 50,130 --require bias=20ug0,rate=0.1deg/h"
)]
pub struct Verify {
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
    /// Set the length of the windows [s]
    ///
    /// Means are taken over windows of this length; static poses are searched with it [default: 10, and 0.5 for static
    /// poses]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = seconds)]
    window: Option<Duration>,
    /// Compare static poses with gravity
    ///
    /// Compares the magnitudes in the static poses of a tumble, also for a table that was made on a turntable.
    #[arg(long, conflicts_with_all = ["attitude", "angles"])]
    static_poses: bool,
    /// Fail unless every bound is shown met
    ///
    /// Give bounds such as bias=20ug0,scale=50ppm,level=5arcsec,rate=0.1deg/h, or a bare factor of stability.
    ///
    /// bias: the total error of every axis (ug0, mg0). scale: the error of the magnitude against gravity (ppm). level:
    /// the error across the specific force (arcsec, urad). rate: the total error of every gyroscope (deg/h). factor:
    /// the standard deviation of every accelerometer before compensation, divided by that after it. The upper end of
    /// the 95 % interval counts. bias and level need --attitude or --angles, bias and scale need local gravity, and
    /// rate needs --angles and a table with Earth's rate. The run must have at least 12 windows. It must not leave out
    /// more than a tenth of the table's range at one place, unless --accept not-covered is given
    #[arg(long, value_name = "BOUNDS", allow_negative_numbers = true)]
    require: Vec<Requirement>,
    /// Set the attitude of the IMU
    ///
    /// Give the direction of the specific force along A1, A2, A3; the angles of the turntable [deg]; or the number
    /// or name of a position of --campaign [default: the median of the compensated output]
    ///
    /// A direction is limited by its digits: with 5 decimals its error is up to 9e-6 g0. Angles and positions are
    /// exact, and include the tilt of the base that the provenance of the table states
    #[arg(long, value_name = "F1,F2,F3|OUTER,INNER|POSITION", allow_hyphen_values = true)]
    attitude: Option<Attitude>,
    /// Read the positions of this campaign file
    ///
    /// --attitude can name its positions. The file describes the mounting of the IMU on the turntable.
    #[arg(long, value_name = "CAMPAIGN.toml", requires = "attitude")]
    campaign: Option<PathBuf>,
    /// Set the turntable's angles in the run [deg]
    ///
    /// The turntable is the one of the table's campaign. With the provenance of the table, its angles give the attitude
    /// and Earth's rate along the gyroscopes.
    #[arg(long, value_name = "OUTER,INNER", allow_hyphen_values = true, value_parser = crate::parse::numbers::<2>)]
    angles: Option<[f64; 2]>,
    /// Set local gravity [m/s2]
    ///
    /// Default: gravity_local of the table's provenance
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_local: Option<f64>,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    lag: LagArgs,
    /// Accept samples of another device
    ///
    /// Samples of a device other than that of the table are refused otherwise.
    #[arg(long)]
    other_device: bool,
    /// Accept a recording of another IMU
    ///
    /// A recording that names an IMU other than that of the table (MCAP) is refused otherwise.
    #[arg(long)]
    other_imu: bool,
    /// Write the report to this file (HTML)
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    acceptance: AcceptanceArgs,
    #[command(flatten)]
    json: JsonOption,
    #[command(flatten)]
    foreign: ForeignArgs,
}

impl Verify {
    pub(crate) fn run(self) -> Result<(), Failure> {
        or_document(self.json, self.show())
    }

    /// The lengths over the static poses, if they are asked for, or if the table was measured that way and the
    /// recording has several attitudes. `whole` says whether `rows` are all rows.
    fn lengths(
        &self,
        table: &CoefficientTable,
        rows: &[RawSample],
        whole: bool,
        recording: &str,
    ) -> Result<Option<Magnitudes>, Failure> {
        if self.static_poses && !whole {
            let message = format!("{recording}: over {MOST_ROWS} rows; give the part with the static poses");
            return Err(Failure::new(Exit::Data, message));
        }
        if !whole {
            if rows.len() >= MOST_ROWS {
                let note = "no static poses are searched; of a tumble, give the part with the static poses";
                warn!("warning: {recording}: over {MOST_ROWS} rows: {note}");
            }
            return Ok(None);
        }
        let window_s = self.window.map(|window| window.as_secs_f64());
        let gravity = LocalGravity::of(self.gravity_local, table);
        let lengths = Magnitudes::of(table, rows, window_s, gravity, self.other_device);
        match lengths {
            Ok(lengths) => Ok(Some(lengths).filter(|lengths| self.static_poses || lengths.several_attitudes())),
            Err(error @ MagnitudesError::OtherDevice(_)) => {
                Err(Failure::new(Exit::Data, format!("{recording}: {error}")))
            }
            Err(error) if self.static_poses => Err(Failure::new(Exit::Data, format!("{recording}: {error}"))),
            Err(_) => Ok(None),
        }
    }

    fn show_lengths(
        &self,
        table: &CoefficientTable,
        lengths: &Magnitudes,
        recording: String,
        page: Option<StagedText>,
        require: Option<Requirement>,
    ) -> Result<(), JobFailure> {
        let window_s = self.window.map_or(STATIC_POSE_WINDOW_S, |window| window.as_secs_f64());
        let other = (lengths.other_device > 0).then(|| other_device(table, lengths.other_device as u64));
        self.acceptance.admit(&recording, other.into_iter().collect())?;
        if let Some(page) = page {
            let source = self.source(recording.clone(), window_s, require);
            page.write(&report::magnitudes::html(table, lengths, &source))?.finish()?;
        }
        if !self.json.is_given() {
            print(&report::magnitudes::text(lengths))?;
            if let Some(require) = require {
                print(&report::text::judgements(&lengths.judge(&require)))?;
            }
        }
        let verdict = require.map_or(Ok(()), |require| lengths.check(&require));
        let verdict = verdict.map_err(|message| Failure::new(Exit::Failed, format!("{recording}: {message}")));
        self.json.finish(report::magnitudes::json(lengths, window_s, require), verdict)
    }

    fn source(&self, recording: String, window_s: f64, required: Option<Requirement>) -> VerificationSource {
        let table = self.table.display().to_string();
        VerificationSource { tool: tool(), time: now(), table, recording, window_s, required }
    }

    fn accepts_holes(&self) -> bool {
        self.acceptance.accept.contains(&name::NOT_COVERED)
    }

    /// The direction that --attitude states.
    fn direction(&self, table: &CoefficientTable, origin: &Origin) -> Result<Option<[f64; AXES]>, Failure> {
        let Some(attitude) = &self.attitude else { return Ok(None) };
        let file = self.campaign.as_deref().map(CampaignFile::read).transpose()?;
        let campaign = file.map(|file| file.campaign(Some(table.content().imu.as_str()))).transpose()?;
        let direction = attitude.direction(table, campaign.as_ref(), origin.tilt_rad);
        if let Some(note) = attitude.note() {
            info!("{note}");
        }
        direction.map(Some).map_err(|message| Failure::new(Exit::Usage, message))
    }

    /// Prints the results.
    fn show(self) -> Result<(), JobFailure> {
        let require = joined(&self.require)?;
        let mut files = inputs(&self.recording);
        files.push((&self.table, "the table"));
        files.extend(self.campaign.iter().map(|file| (file.as_path(), "the campaign file")));
        files.extend(self.foreign.inputs());
        refuse_overlap(&files, &[self.report.as_deref()])?;
        check_written(None, check_stdout())?;
        let (table, origin) = load_with_origin(&self.table)?;
        let attitude = self.direction(&table, &origin)?;
        let setup = Setup::new(attitude, LocalGravity::of(self.gravity_local, &table));
        let setup = Setup { other_device: self.other_device, ..setup }.at_angles(&table, self.angles);
        let setup = setup.map_err(|message| Failure::new(Exit::Usage, message))?;
        let page = self.report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let bar = bytes_bar(&self.recording, "reading");
        let window_s = self.window.map_or(WINDOW_S, |window| window.as_secs_f64());
        let input = Input::from((choice(self.imu.clone(), &table), self.foreign.read_for(Some(&table), &origin)?));
        let input = input.within(self.part.get()?);
        let mut run = VerificationRun::open(&table, &self.recording, input, self.lag.ns, window_s, &bar)?;
        let by_hand = table.is_gravity_only() && self.attitude.is_none() && self.angles.is_none();
        let mut rows = Vec::new();
        let mut keep = self.static_poses || by_hand;
        let mut first = true;
        while let Some(sample) = run.next() {
            let sample = sample?;
            if core::mem::take(&mut first) {
                refuse_other_imu(run.samples(), &self.recording, (&table, &self.table), self.other_imu)?;
            }
            if keep {
                rows.push(sample);
                keep = rows.len() < MOST_ROWS;
            }
        }
        bar.finish();
        let recording = joined_paths(&self.recording);
        let of_time = run.collector().of_time();
        let of_data = OfData::of(run.samples().recording()).with_unit(&origin, run.samples().recording());
        let of_data = if self.other_device { of_data.with_other_device() } else { of_data };
        let made_the_table = run.made(&origin);
        if let Some(lengths) = self.lengths(&table, &rows, keep, &recording)? {
            let lengths = Magnitudes { made_the_table, ..lengths };
            let at_rest: Vec<_> = lengths.poses.iter().map(|it| it.reading.rows.clone()).collect();
            let of_rows =
                magnitude_at_rest(&table, &rows).into_iter().chain(faults(&rows, &at_rest)).map(Finding::warned);
            let found = own_recording(made_the_table).into_iter().chain(of_rows).chain(of_time).collect();
            of_data.admit(&self.acceptance, &recording, found)?;
            return self.show_lengths(&table, &lengths, recording, page, require);
        }
        let accepts_holes = self.accepts_holes();
        let stability = run.finish(&setup).map(|stability| Stability { made_the_table, accepts_holes, ..stability });
        let stability = stability.inspect_err(|_| {
            // An interval that is wrong is the error itself.
            let of_time = of_time.into_iter().filter(|finding| finding.name != name::INTERVAL).collect();
            let _ = of_data.clone().admit(&AcceptanceArgs::default(), &recording, of_time);
        })?;
        // With a requirement the failure at the end says why nothing is claimed.
        of_data.admit(&self.acceptance, &recording, stability.findings(require.is_some()))?;
        // Before the results are printed: then nothing but the judgement can fail after them.
        if let Some(page) = page {
            let source = self.source(recording.clone(), window_s, require);
            page.write(&report::verification::html(&table, &stability, &source))?.finish()?;
        }
        if !self.json.is_given() {
            print(&report::text::stability(&stability, window_s, table.content().alignment.is_some()))?;
            if let Some(require) = require {
                print(&report::text::judgements(&require.judge(&stability)))?;
            }
        }
        let verdict = require.map_or(Ok(()), |require| require.check(&stability));
        let verdict = verdict.map_err(|message| Failure::new(Exit::Failed, format!("{recording}: {message}")));
        self.json.finish(report::json::verification(&stability, window_s, require), verdict)
    }
}
