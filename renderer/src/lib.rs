//! The Treewright path tracer: scenes, indicators, integrator and the tuning loop.
#![forbid(unsafe_code)]

pub mod camera_path;
pub mod cli;
pub mod converge;
pub mod film;
pub mod frame;
pub mod image_file;
pub mod indicators;
pub mod integrator;
pub mod limits;
pub mod measure;
pub mod recorder;
pub mod render_options;
pub mod report;
pub mod scene;
pub mod space;
pub mod statistics;
pub mod tuning;
