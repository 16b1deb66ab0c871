//! Fuzzes scene files.
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| treewright_fuzz::scenes::run(input));
