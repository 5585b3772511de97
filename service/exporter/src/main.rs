//! See the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    isotherm_exporter::main(isotherm_version::LONG_VERSION)
}
