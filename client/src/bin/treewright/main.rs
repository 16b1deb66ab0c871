//! Placeholder of the command line while the library is built.
#![forbid(unsafe_code)]

fn main() {}
