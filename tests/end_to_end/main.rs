//! End to end: the daemon, the renderer and the command line as separate processes.

mod bad_input;
mod lifecycle;
mod replicas;
mod restart;
mod storm;
mod tuning;
mod wire;
