use super::calibrate::{bytes_bar, now, tool};
use super::parse::{direction, gravity};
use super::{Aside, apart, seconds, written};
use crate::failure::{Exit, Failure};
use crate::files::{Guard, load_table};
use crate::samples::{Pick, Samples};
use clap::Args;
use isotherm_calibration::report::verification::{Source, html};
use isotherm_calibration::stability::{Collector, Force, Setup, Stability};
use isotherm_client::ImuId;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::PathBuf;
use std::time::Duration;

/// Show how stable the output of a recording is, before and after compensation
///
/// The IMU must be held still while its temperature runs. Before: the table's coefficients frozen at the run's mid
/// temperature. After: the full model. Where the IMU was still, the three outputs together are compared with gravity too.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm verify --table imu-a.toml run.csv --attitude 0.6,-0.48,0.64 --report verify.html\n  isotherm verify --table imu-a.toml run.csv --require 10"
)]
pub struct Verify {
    /// Coefficient table
    #[arg(long, value_name = "TABLE")]
    table: PathBuf,
    /// Whose samples, in a recording of several IMUs [default: the table's IMU's]
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Recording of raw samples (CSV, Parquet, MCAP); - is stdin
    #[arg(value_name = "RAW")]
    recording: PathBuf,
    /// Length of the windows that means are taken over [s]
    #[arg(long, value_name = "S", default_value = "10", allow_negative_numbers = true, value_parser = seconds)]
    window: Duration,
    /// Fail unless every axis is FACTOR times more stable after than before
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, value_parser = over_0)]
    require: Option<f64>,
    /// Direction of the specific force along A1, A2, A3 [default: the median of the compensated output]
    #[arg(long, value_name = "F1,F2,F3", allow_hyphen_values = true, value_parser = direction)]
    attitude: Option<[f64; AXES]>,
    /// Local gravity in m/s2 [default: the table's]
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_local: Option<f64>,
    /// Where the report goes (HTML)
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
}

fn over_0(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v: &f64| *v > 0.0 && v.is_finite()).ok_or_else(|| "give a number over 0".to_owned())
}

impl Verify {
    /// In windows of 10 s.
    #[cfg(feature = "campaign")]
    pub fn of(
        table: &std::path::Path,
        recording: &std::path::Path,
        require: Option<f64>,
        attitude: Option<[f64; AXES]>,
        gravity_local: f64,
        report: &std::path::Path,
    ) -> Self {
        Self {
            table: table.to_owned(),
            imu: None,
            recording: recording.to_owned(),
            window: Duration::from_secs(10),
            require,
            attitude,
            gravity_local: Some(gravity_local),
            report: Some(report.to_owned()),
        }
    }

    pub fn run(self) -> Result<(), Failure> {
        let inputs = [(self.recording.as_path(), "the recording"), (&self.table, "the table")];
        apart(&inputs, &[self.report.as_deref()])?;
        let (table, _) = load_table(&self.table, None, Guard::Lax)?;
        let report = self.report.as_deref().map(|path| Aside::create(Some(path))).transpose()?;
        let pick = self.imu.as_ref().map_or(Pick::Rather(&table.content().imu), Pick::Only);
        let bar = bytes_bar(&self.recording, "reading");
        let window_s = self.window.as_secs_f64();
        let mut collector = Collector::new(&table, window_s);
        for sample in Samples::open(&self.recording, pick, &bar)? {
            collector.add(&sample?);
        }
        bar.finish_and_clear();
        let setup = Setup {
            attitude: self.attitude.map(|direction| {
                let length = direction.iter().map(|f| f * f).sum::<f64>().sqrt();
                direction.map(|f| f / length)
            }),
            gravity_local: self.gravity_local.unwrap_or(table.content().gravity),
        };
        let stability = collector.finish(&setup);
        let stability =
            stability.map_err(|error| Failure::new(Exit::Data, format!("{}: {error}", self.recording.display())))?;
        if let Some(word) = stability.not_gravity() {
            let _ = writeln!(io::stderr(), "isotherm: warning: {}: {word}", self.recording.display());
        }
        let text = tell(&stability, window_s, table.content().alignment.is_some());
        written(None, io::stdout().write_all(text.as_bytes()))?;
        if let Some(report) = report {
            let source = Source {
                tool: tool(),
                time: now(),
                table: self.table.display().to_string(),
                recording: self.recording.display().to_string(),
                window_s,
                required: self.require,
            };
            report.write(&html(&table, &stability, &source))?.finish()?;
        }
        let short = |factor: f64| {
            let axes = AXIS_NAMES
                .iter()
                .zip(&stability.axes)
                .filter(|(_, axis)| axis.factor().is_nan() || axis.factor() < factor);
            let axes: Vec<_> = axes.map(|(name, axis)| format!("{name} {:.2}", axis.factor())).collect();
            Some(axes.join(", ")).filter(|axes| !axes.is_empty())
        };
        match self.require.and_then(|factor| Some((factor, short(factor)?))) {
            Some((factor, axes)) => Err(Failure::new(
                Exit::Failed,
                format!("stability: {axes} times better, {factor} are required; calibrate anew, or look at the report"),
            )),
            None => Ok(()),
        }
    }
}

/// Table 4 for people.
fn tell(stability: &Stability, window: f64, aligned: bool) -> String {
    let counted = stability.windows.iter().filter(|window| window.counts).count();
    let mut text = format!(
        "Output stability: means over {window} s of output minus specific force [1e-6 g0]\n          frozen at mid temperature        \
         full model\n          std. deviation  rms about zero   std. deviation  rms about zero   factor (std. dev.)\n"
    );
    // Writing to a String cannot fail.
    for (name, axis) in AXIS_NAMES.iter().zip(&stability.axes) {
        let _ = writeln!(
            text,
            "  {name} {:>18.3} {:>15.3} {:>16.3} {:>15.3} {:>12.2}",
            axis.sd_before * 1e6,
            axis.rms_before * 1e6,
            axis.sd_after * 1e6,
            axis.rms_after * 1e6,
            axis.factor()
        );
    }
    let origin =
        if stability.stated { "stated" } else { "the median of the output, so that a constant error does not show" };
    let _ = writeln!(text, "  specific force {}, {origin}", Force(stability.specific_force));
    if stability.stated && !aligned {
        text.push_str("  the table has no alignment matrix: the rms about zero includes what misalignments make of this attitude\n");
    }
    let _ = writeln!(text, "  {counted} of {} windows at this attitude", stability.windows.len());
    if stability.left_out > 0 {
        let _ = writeln!(text, "  {} samples left out: their interval is 0 or over an hour", stability.left_out);
    }
    let flagged = stability.windows.iter().filter(|window| window.flagged).count();
    if flagged > 0 {
        let _ = writeln!(
            text,
            "  {flagged} windows have flagged samples: telemetry out of the table's range, or not plausible"
        );
    }
    match &stability.modulus {
        Some(modulus) => {
            let _ = writeln!(
                text,
                "\nLength of the output against local gravity, {} still windows [1e-6 g0]: mean {:.3}, rms {:.3}, worst {:.3}{}",
                modulus.windows,
                modulus.mean * 1e6,
                modulus.rms * 1e6,
                modulus.worst * 1e6,
                if aligned { "" } else { "\n  (the table has no alignment matrix: misalignments are part of it)" }
            );
        }
        None => text.push_str("\nThe IMU was never still: its output cannot be compared with gravity.\n"),
    }
    let worst = stability.axes.iter().map(|axis| axis.rms_after).fold(0.0, f64::max);
    let _ = writeln!(
        text,
        "What is left, {:.2}e-6 g0 at most, tilts a level by {:.2} arc seconds.",
        worst * 1e6,
        worst.to_degrees() * 3600.0
    );
    text
}
