//! The SDK against a stand-in for the daemon that can be slow, absent, unwilling and forgetful.
//!
//! No test measures time. A deadline holds if an answer comes at all while the stand-in never answers.

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
