//! See the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    isotherm_cli::main()
}
