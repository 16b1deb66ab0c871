//! Fuzzes the output of programs.
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| treewright_fuzz::printed::run(input));
