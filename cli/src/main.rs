//! The program `isotherm`; all of its code is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    isotherm_cli::main()
}
