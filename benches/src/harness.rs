//! The frame of every bench: its common arguments, its child processes, and how its figures are shown.

use crate::child::{BenchResult, CHILD, GUARDIAN};
use crate::domain::guard;
use crate::machine::{machine, unpin};
use crate::text;
use clap::{Args, Parser};
use rustix::process::{Signal, set_parent_process_death_signal};
use serde_json::Value;
use std::env;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;
use std::time::Instant;

/// The options of every bench that prints measurements.
#[derive(Args, Clone, Copy, Debug)]
pub struct Common {
    /// Print one JSON document
    #[arg(long, global = true)]
    json: bool,
    /// A few samples only, to see that everything works
    #[arg(long, global = true)]
    pub smoke: bool,
    /// Ten times the samples, for deep tails
    #[arg(long, global = true, conflicts_with = "smoke")]
    long: bool,
    /// Measure this number of rounds
    #[arg(long, global = true, value_name = "COUNT")]
    rounds: Option<usize>,
    #[arg(skip = Instant::now())]
    started: Instant,
}

impl Common {
    /// How much is measured: `smoke`, `usual`, or ten times `usual`.
    pub const fn of(self, smoke: usize, usual: usize) -> usize {
        match (self.smoke, self.long) {
            (true, _) => smoke,
            (_, true) => usual * 10,
            _ => usual,
        }
    }

    /// The number of rounds; without `--rounds` as in [`of`](Self::of).
    pub fn rounds(self, smoke: usize, usual: usize) -> usize {
        self.rounds.unwrap_or_else(|| self.of(smoke, usual))
    }

    /// The round trips of a block: `usual`, or as few as have a median.
    pub const fn block(self, usual: usize) -> usize {
        if self.smoke { 40 } else { usual }
    }

    /// Shows the figures, as text tables or as a JSON document. The machine and the time of the bench are added.
    pub fn show(self, document: Value) {
        let mut document = document;
        document["machine"] = machine();
        document["seconds"] = self.started.elapsed().as_secs_f64().into();
        match &document {
            Value::Object(figures) if !self.json => text::print(figures),
            _ => println!("{document:#}"),
        }
    }
}

/// Another build of the service, which is measured in the same run.
#[derive(Clone, Debug)]
pub struct OtherBuild {
    /// Its name in the figures.
    pub name: String,
    /// A program with the command `serve`, as `isotherm` and `isothermd` are.
    pub program: PathBuf,
}

impl FromStr for OtherBuild {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text
            .split_once('=')
            .filter(|(name, program)| !name.is_empty() && !name.contains('/') && !program.is_empty());
        let (name, program) = parts.ok_or("give NAME=PROGRAM, for example before=old/isotherm")?;
        let program = fs::canonicalize(program).map_err(|error| format!("{program}: {error}"))?;
        Ok(Self { name: name.to_owned(), program })
    }
}

/// Runs the program of a bench: `bench` with its arguments, or one of its child processes, see
/// [`child_of`](crate::child_of). Those are the service, and what `role` makes of other words.
pub fn run<A: Parser>(
    role: fn(&[&str]) -> BenchResult<ExitCode>,
    bench: impl FnOnce(A) -> BenchResult<()>,
) -> ExitCode {
    let words: Vec<_> = env::args().skip(1).collect();
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        _ if env::var_os(CHILD).is_none() => bench(A::parse()).map(|()| ExitCode::SUCCESS),
        [GUARDIAN] => guard(),
        words => {
            become_child();
            match words {
                ["serve" | "status", ..] => Ok(isotherm_service::main(env!("CARGO_PKG_VERSION"))),
                _ => role(words),
            }
        }
    };
    result.unwrap_or_else(|error| {
        let program = env::current_exe().unwrap_or_default();
        println!("{}: {error}", program.file_stem().unwrap_or_default().display());
        ExitCode::FAILURE
    })
}

/// For a bench without roles of its own.
///
/// # Errors
/// Always.
pub fn no_role(words: &[&str]) -> BenchResult<ExitCode> {
    Err(format!("unknown role {words:?}").into())
}

/// The child ends with its parent, and may use every core even if its parent is pinned.
fn become_child() {
    // Fails only where it is not supported. The guardian ends the child then.
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
    unpin();
}

/// The folder of this program.
///
/// # Errors
/// If the operating system does not report it.
pub fn own_folder() -> BenchResult<PathBuf> {
    Ok(env::current_exe()?.parent().ok_or("this program is in no folder")?.to_owned())
}
