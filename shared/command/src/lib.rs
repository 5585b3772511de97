//! What the command lines of all programs share, and what the commands `check` and `explain` do in each of them. It
//! links no transport.

pub mod check;
pub mod explain;

use isotherm_support::failure::{EXIT_CODES, Exit, Failure, printable, tell_plainly};
use std::borrow::Cow;
use std::io::{self, Write as _};
use std::process::ExitCode;

/// The meaning of the exit codes, shown below the help of every command.
fn exit_codes() -> String {
    let codes: Vec<_> = EXIT_CODES.iter().map(|code| format!("{} {}", code.number, code.short)).collect();
    format!("Exit codes: {}", codes.join(", "))
}

/// `--domain` of a command that joins no domain: hidden in its help, but still accepted.
#[must_use]
pub fn no_domain() -> clap::Arg {
    clap::Arg::new("domain").long("domain").value_name("NAME").global(true).hide(true)
}

/// Adds the exit codes to the help of every command, and makes the examples name this `program`.
#[must_use]
pub fn finish(command: clap::Command, program: &str) -> clap::Command {
    let help = command.get_after_help().map(|help| format!("{help}\n")).unwrap_or_default();
    let own = |line: &str| match line.trim_start().strip_prefix("isotherm ") {
        Some(rest) if command.get_name() != "isotherm" => format!("  {program} {rest}"),
        _ => line.to_owned(),
    };
    let help: Vec<_> = help.lines().map(own).collect();
    let help = help.join("\n") + if help.is_empty() { "" } else { "\n" } + &exit_codes();
    let names: Vec<_> = command.get_subcommands().map(|command| command.get_name().to_owned()).collect();
    let command = command.after_help(help);
    names.iter().fold(command, |command, name| command.mut_subcommand(name, |command| finish(command, program)))
}

/// Runs a program: prints help and version to stdout, errors to stderr, and turns the result of `run` into an exit
/// code. `tell_last` prints the message of a failure behind the name of the program.
pub fn exit_code(
    program: &str,
    tell_last: fn(&str, String),
    run: impl FnOnce() -> Result<Result<(), Failure>, clap::Error>,
) -> ExitCode {
    isotherm_files::report_file_limit();
    match run() {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(failure)) => {
            // The libraries' messages name the program `isotherm`. A vehicle has only `isothermd`, with these commands.
            let message = match program {
                "isothermd" => failure
                    .message
                    .replace("`isotherm serve", "`isothermd serve")
                    .replace("`isotherm status", "`isothermd status"),
                _ => failure.message,
            };
            tell_last(program, message);
            ExitCode::from(failure.exit as u8)
        }
        Err(error) => {
            if error.use_stderr() {
                // The message repeats arguments, which may be names of files that others have made.
                let plain = error.render().to_string();
                let _ = match printable(&plain) {
                    Cow::Borrowed(_) => error.print(),
                    Cow::Owned(escaped) => io::stderr().write_all(escaped.as_bytes()),
                };
                return ExitCode::from(Exit::Usage as u8);
            }
            // Help and version are no failure, and neither is a closed pipe.
            match isotherm_files::check_written(None, error.print()) {
                Ok(()) => ExitCode::SUCCESS,
                Err(failure) => {
                    tell_plainly(program, failure);
                    ExitCode::from(Exit::Io as u8)
                }
            }
        }
    }
}
