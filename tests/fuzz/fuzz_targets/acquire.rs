//! [`isotherm_fuzz_targets::acquire`] under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| isotherm_fuzz_targets::acquire::run(bytes));
