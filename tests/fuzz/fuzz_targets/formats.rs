//! [`isotherm_fuzz_targets::formats`] under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| isotherm_fuzz_targets::formats::run(bytes));
