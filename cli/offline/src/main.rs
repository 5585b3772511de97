//! The program of only the offline commands; all of its code is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    isotherm_offline::main()
}
