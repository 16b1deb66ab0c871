//! Acceleration structures: Embree's builders, our own tree layout and traversal, Embree's native
//! scenes, and a brute-force oracle. Every `unsafe` line of the workspace lives in this crate.

mod brute_force;
mod embree;
mod error;
pub mod geometry;
pub mod limits;
pub mod parameters;
mod structure;

pub use brute_force::BruteForce;
pub use embree::{Device, DeviceError, NativeScene};
pub use error::BuildError;
pub use geometry::{GeometryError, Hit, Intersector, Ray, Triangles};
pub use parameters::{BuildChoice, NativeOptions, NativeQuality, Quality, TreeParameters};
pub use structure::{Statistics, Structure, Visitor, build};
