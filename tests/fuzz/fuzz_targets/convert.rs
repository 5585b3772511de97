//! [`isotherm_fuzz_targets::convert`] under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| isotherm_fuzz_targets::convert::run(bytes));
