//! The Treewright path tracer: scenes, indicators, integrator and the tuning loop.
#![forbid(unsafe_code)]

pub mod film;
pub mod frame;
pub mod image_file;
pub mod integrator;
pub mod limits;
pub mod scene;
pub mod space;
