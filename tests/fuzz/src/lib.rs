//! The fuzzed functions, without a fuzzer: each module takes any input and panics only when it finds a
//! defect.
//!
//! `targets/` holds the programs that cargo-fuzz builds with coverage. `corpus/` holds a valid input of each
//! kind (`seed-*`), so that a fuzzer need not find the grammar first, and every input that once found a
//! defect. The tests run all of them, so that a mended defect stays mended without a fuzzer.

pub mod arguments;
pub mod example;
pub mod filters;
pub mod printed;
pub mod requests;
pub mod scenes;
pub mod studies;

/// A target by name, with bytes that are no text passed over where it wants text.
pub fn target(name: &str) -> Option<fn(&[u8])> {
    Some(match name {
        "arguments" => |bytes| std::str::from_utf8(bytes).map_or((), arguments::run),
        "filters" => |bytes| std::str::from_utf8(bytes).map_or((), filters::run),
        "printed" => printed::run,
        "requests" => requests::run,
        "scenes" => scenes::run,
        "studies" => studies::run,
        _ => return None,
    })
}

/// The names of all targets.
pub const TARGETS: [&str; 6] = ["arguments", "filters", "printed", "requests", "scenes", "studies"];
