//! Fuzzes command lines.
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &str| treewright_fuzz::arguments::run(input));
