//! See the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    isotherm_service::main(isotherm_version::LONG_VERSION)
}
