//! Helpers of the end-to-end tests: the real programs, started, watched and killed.
//!
//! The tests run the binaries that lie beside them in the build folder, the way a user would run
//! them: separate processes, a real database file, real sockets on the loopback.

pub mod daemon;
pub mod ports;
pub mod programs;
pub mod sandbox;
