//! The Treewright path tracer: scenes, indicators, integrator and the tuning loop.
#![forbid(unsafe_code)]

pub mod scene;
