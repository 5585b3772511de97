//! Child processes of a bench: its own program in another role.

use std::error::Error;
use std::path::Path;
use std::process::Command;

/// The result of a step of a bench.
pub type BenchResult<T> = Result<T, Box<dyn Error>>;

/// The environment variable that makes the program of a bench one of its child processes.
pub(crate) const CHILD: &str = "ISOTHERM_BENCH_CHILD";
/// The role of the process that outlives a bench that is killed.
pub(crate) const GUARDIAN: &str = "guardian";

/// A command whose program, if it is that of a bench, runs as a child process.
pub fn child_of(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.env(CHILD, "");
    command
}
