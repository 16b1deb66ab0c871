//! End to end: the daemon, the renderer and the command line as separate processes.

mod bad_input;
mod flood;
mod guard;
mod lifecycle;
mod replicas;
mod replicas_tls;
mod restart;
mod security;
mod storm;
mod tuning;
mod wire;
