//! Acceleration structures: Embree's builders, our own tree layout and traversal, Embree's native
//! scenes, and a brute-force oracle. Every `unsafe` line of our programs lives in this crate.

#![cfg_attr(fewer_kernels, allow(dead_code, reason = "vectors of other instruction sets"))]

mod brute_force;
mod denormals;
mod embree;
mod error;
pub mod geometry;
mod instances;
mod layout;
pub mod limits;
mod masks;
mod memory;
mod native_options;
pub mod parameters;
mod prefetch;
mod rays;
pub mod recording;
mod structure;
mod traverse;
mod tree;

pub use brute_force::BruteForce;
pub use denormals::set_flush_denormals;
pub use embree::{Device, DeviceError, NativeInstances, NativeScene};
pub use error::BuildError;
pub use geometry::{GeometryError, Hit, Intersector, NO_INSTANCE, Packets, Ray, Triangles};
pub use instances::{Instance, InstanceError, Instances};
pub use masks::{Card, Mask, Wrap};
pub use memory::{keep_freed_memory, wish_for_huge_pages};
pub use parameters::{
    BuildChoice, Builder, Collapse, NativeOptions, NativeQuality, Quality, TreeParameters, Update,
};
pub use prefetch::prefetch;
pub use structure::{Statistics, Structure, Visitor, build, build_instanced};
pub use traverse::{Isa, Visits, Work};
pub use tree::{Tree, TreeFault, TreeStatistics, TwoLevel};
