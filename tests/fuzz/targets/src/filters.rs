//! Fuzzes filters, orders and page tokens.
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &str| treewright_fuzz::filters::run(input));
