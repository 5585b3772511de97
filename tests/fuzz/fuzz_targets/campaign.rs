//! [`isotherm_fuzz_targets::campaign`] under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| isotherm_fuzz_targets::campaign::run(bytes));
