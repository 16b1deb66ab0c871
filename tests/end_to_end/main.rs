//! End to end: the daemon, the renderer and the command line as separate processes.

mod bad_input;
mod flood;
mod lifecycle;
mod replicas;
mod restart;
mod security;
mod storm;
mod tuning;
mod wire;
