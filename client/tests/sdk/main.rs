//! The SDK against a stand-in for the daemon that can be slow, absent, unwilling and forgetful.
//!
//! No test measures time. That a deadline holds shows in an answer coming at all while the stand-in
//! holds its own back for ever.

#[path = "../support/mod.rs"]
mod support;

mod administration;
mod blocking;
mod newer;
mod outbox;
mod prefetching;
mod released;
mod suggesting;
mod tuner;
mod workers;
