//! The program of the offline commands alone; all of its code is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    isotherm_offline::main()
}
