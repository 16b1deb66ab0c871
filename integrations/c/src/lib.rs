//! `libtreewright`: the blocking client SDK behind a C interface.
//!
//! `include/treewright.h` is the interface and says for each function who owns which object. It is kept by
//! hand, and `tests/integrations/c_sdk.rs` compares it with the exports. This crate keeps to four rules:
//!
//! - A handle is a box. `NULL` is allowed wherever a handle is freed and is an error, never a crash,
//!   elsewhere. References and boxes in the signatures say what C has to keep: valid, aligned, not used by
//!   another thread at the same time unless the header says that it may be.
//! - There is no global state: a failure is handed out through the last argument of the call that failed.
//! - No panic leaves the library ([`edge::guard`]).
//! - `unsafe` code stands in [`edge`], where pointers from C become slices and text.

mod client;
mod configuration;
mod edge;
mod error;
mod front;
mod options;
mod scene;
mod spec;
mod study;
mod suggestion;
