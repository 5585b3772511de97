//! `calibrate`: makes a coefficient table from a campaign on a turntable, from a tumble or from a warm-up.

mod campaign;
mod outcome;
mod several;
mod table;
mod tumble;
mod turntable;
mod warm_up;

use clap::{Args, Subcommand};
use isotherm_support::failure::Failure;
use tumble::Tumble;
use turntable::Turntable;
use warm_up::WarmUp;

/// Make a coefficient table from measurements
///
/// There are three ways to measure: a campaign on a turntable in a temperature chamber, a tumble through many attitudes
/// by hand, and a warm-up at one attitude. Each command writes a sealed table with its provenance. A parameter that the
/// data cannot show is refused, never guessed.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    after_help = "Examples:
  isotherm calibrate turntable campaign.toml -o imu-a.toml --report imu-a.html
  isotherm calibrate tumble cold.csv warm.csv --imu imu-b --gravity-local 9.8123 --gravity-reference 9.80665 --temperature-unit degC -o imu-b.toml
  isotherm calibrate warm-up warm-up.ulg --imu imu-b -o imu-b.toml --export px4=imu-b.params"
)]
pub struct Calibrate {
    #[command(subcommand)]
    job: Job,
}

#[derive(Debug, Subcommand)]
enum Job {
    Turntable(Box<Turntable>),
    Tumble(Box<Tumble>),
    WarmUp(Box<WarmUp>),
}

impl Calibrate {
    /// Makes the table. With `verbose`, findings that a diagnosis explains are listed too.
    pub(crate) fn run(self, verbose: bool) -> Result<(), Failure> {
        match self.job {
            Job::Turntable(turntable) => turntable.run(verbose),
            Job::Tumble(tumble) => tumble.run(verbose),
            Job::WarmUp(warm_up) => warm_up.run(verbose),
        }
    }
}
